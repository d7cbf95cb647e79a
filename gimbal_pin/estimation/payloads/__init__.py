"""One gimbal, many cameras: the gimbal's own parameters are shared, each camera has its own; a new one needs 10 s.

``tau = Y (phi_gimbal + phi_camera)``: a camera changes one body's ten parameters, of which joint torques show some. The
logs of camera p have the base parameters ``beta_p = beta_1 + K_c gamma_p``, gamma_p the change of those that show.
"""

from gimbal_pin.estimation.payloads.camera import BARE, Camera, Several
from gimbal_pin.estimation.payloads.known import estimated, identify_new
from gimbal_pin.estimation.payloads.parts import Carried, stated
from gimbal_pin.estimation.payloads.several import identify_several

__all__ = ["BARE", "Camera", "Carried", "Several", "estimated", "identify_new", "identify_several", "stated"]
