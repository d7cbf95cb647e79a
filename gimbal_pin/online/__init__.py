"""Identification on the running gimbal, sample by sample; see `Online`."""

from gimbal_pin.online.follower import Memory as Memory
from gimbal_pin.online.follower import Online as Online
from gimbal_pin.online.learning import Event as Event
from gimbal_pin.online.progress import Progress as Progress
from gimbal_pin.online.progress import progress as progress
from gimbal_pin.online.progress import steps as steps
