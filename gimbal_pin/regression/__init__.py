"""The regression core: logs to smooth samples, samples to weighted rows with named columns, rows to an estimate.

log → uniform grid → smoothed q, v, a, tau → decimated → columns → low-pass → one row every half period of the cutoff
"""

from gimbal_pin.regression.design import CHUNK_SAMPLES as CHUNK_SAMPLES
from gimbal_pin.regression.design import MASK_TAPER as MASK_TAPER
from gimbal_pin.regression.design import SMOOTHER_MEMORY as SMOOTHER_MEMORY
from gimbal_pin.regression.design import STANDSTILL_DEVIATIONS as STANDSTILL_DEVIATIONS
from gimbal_pin.regression.design import Block as Block
from gimbal_pin.regression.design import Design as Design
from gimbal_pin.regression.design import DesignBlocks as DesignBlocks
from gimbal_pin.regression.design import build_mask as build_mask
from gimbal_pin.regression.design import compute_blocks as compute_blocks
from gimbal_pin.regression.design import compute_direction as compute_direction
from gimbal_pin.regression.design import count_smoother_memory as count_smoother_memory
from gimbal_pin.regression.design import dilate_flags as dilate_flags
from gimbal_pin.regression.design import find_base_columns as find_base_columns
from gimbal_pin.regression.design import find_camera_body as find_camera_body
from gimbal_pin.regression.design import find_slow_samples as find_slow_samples
from gimbal_pin.regression.design import find_standstill as find_standstill
from gimbal_pin.regression.design import get_design as get_design
from gimbal_pin.regression.design import map_phi_to_base as map_phi_to_base
from gimbal_pin.regression.samples import Excerpt as Excerpt
from gimbal_pin.regression.samples import Filtering as Filtering
from gimbal_pin.regression.samples import Flags as Flags
from gimbal_pin.regression.samples import Samples as Samples
from gimbal_pin.regression.samples import Segment as Segment
from gimbal_pin.regression.samples import UnfilteredTorque as UnfilteredTorque
from gimbal_pin.regression.samples import classify_base_motion as classify_base_motion
from gimbal_pin.regression.samples import compute_decimation as compute_decimation
from gimbal_pin.regression.samples import compute_lost_impulse as compute_lost_impulse
from gimbal_pin.regression.samples import compute_settling_time as compute_settling_time
from gimbal_pin.regression.samples import find_moving_base as find_moving_base
from gimbal_pin.regression.samples import resample_torque as resample_torque
from gimbal_pin.regression.samples import smooth_samples as smooth_samples
from gimbal_pin.regression.samples import split_segments as split_segments
from gimbal_pin.regression.samples import subsample_log as subsample_log
