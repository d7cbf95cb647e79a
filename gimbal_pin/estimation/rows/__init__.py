"""From logs to regression rows: the same filter on every column and on the torque, chunk by chunk.

log → uniform grid → smoothed q, v, a → decimated → columns → low-pass → one row every half period of the cutoff
"""

from gimbal_pin.estimation.rows.blocks import CHUNK, Block, Rows
from gimbal_pin.estimation.rows.carrier import base_motion, carrying
from gimbal_pin.estimation.rows.channels import Channels, Flags, Logged, impulse, smoothed
from gimbal_pin.estimation.rows.choosing import Chosen, chosen
from gimbal_pin.estimation.rows.filtering import FINE, Filtering, settling, thinning
from gimbal_pin.estimation.rows.grid import Stretch, stretches
from gimbal_pin.estimation.rows.masking import (
    MEMORY,
    STANDSTILL,
    TAPER,
    dilated,
    mask,
    memory,
    sliding,
    slow,
    standstill,
)
from gimbal_pin.estimation.rows.places import camera_body, columns_of, over_phi
from gimbal_pin.estimation.rows.regression import Regression, kept, standing_for

__all__ = [
    "CHUNK",
    "FINE",
    "MEMORY",
    "STANDSTILL",
    "TAPER",
    "Block",
    "Channels",
    "Chosen",
    "Filtering",
    "Flags",
    "Logged",
    "Regression",
    "Rows",
    "Stretch",
    "base_motion",
    "camera_body",
    "carrying",
    "chosen",
    "columns_of",
    "dilated",
    "impulse",
    "kept",
    "mask",
    "memory",
    "over_phi",
    "settling",
    "sliding",
    "slow",
    "smoothed",
    "standing_for",
    "standstill",
    "stretches",
    "thinning",
]
