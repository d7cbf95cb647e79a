"""From logs to regression rows: the same filter on every column and on the torque, chunk by chunk.

log → uniform grid → smoothed q, v, a → decimated → columns → low-pass → one row every half period of the cutoff
"""

from gimbal_pin.estimation.rows.blocks import CHUNK as CHUNK
from gimbal_pin.estimation.rows.blocks import MEMORY as MEMORY
from gimbal_pin.estimation.rows.blocks import STANDSTILL as STANDSTILL
from gimbal_pin.estimation.rows.blocks import TAPER as TAPER
from gimbal_pin.estimation.rows.blocks import Block as Block
from gimbal_pin.estimation.rows.blocks import Regression as Regression
from gimbal_pin.estimation.rows.blocks import Rows as Rows
from gimbal_pin.estimation.rows.blocks import camera_body as camera_body
from gimbal_pin.estimation.rows.blocks import columns_of as columns_of
from gimbal_pin.estimation.rows.blocks import dilated as dilated
from gimbal_pin.estimation.rows.blocks import mask as mask
from gimbal_pin.estimation.rows.blocks import memory as memory
from gimbal_pin.estimation.rows.blocks import over_phi as over_phi
from gimbal_pin.estimation.rows.blocks import regression as regression
from gimbal_pin.estimation.rows.blocks import rows_behind as rows_behind
from gimbal_pin.estimation.rows.blocks import sliding as sliding
from gimbal_pin.estimation.rows.blocks import slow as slow
from gimbal_pin.estimation.rows.blocks import standstill as standstill
from gimbal_pin.estimation.rows.channels import FINE as FINE
from gimbal_pin.estimation.rows.channels import Channels as Channels
from gimbal_pin.estimation.rows.channels import Excerpt as Excerpt
from gimbal_pin.estimation.rows.channels import Filtering as Filtering
from gimbal_pin.estimation.rows.channels import Flags as Flags
from gimbal_pin.estimation.rows.channels import Logged as Logged
from gimbal_pin.estimation.rows.channels import Stretch as Stretch
from gimbal_pin.estimation.rows.channels import base_motion as base_motion
from gimbal_pin.estimation.rows.channels import excerpt as excerpt
from gimbal_pin.estimation.rows.channels import impulse as impulse
from gimbal_pin.estimation.rows.channels import moving_base_link as moving_base_link
from gimbal_pin.estimation.rows.channels import settling as settling
from gimbal_pin.estimation.rows.channels import smoothed as smoothed
from gimbal_pin.estimation.rows.channels import stretches as stretches
from gimbal_pin.estimation.rows.channels import thinning as thinning
