"""Identification on the running gimbal, sample by sample; see `Online`."""

from gimbal_pin.online.follower import Memory as Memory
from gimbal_pin.online.follower import Online as Online
from gimbal_pin.online.follower import Progress as Progress
from gimbal_pin.online.follower import progress as progress
from gimbal_pin.online.follower import steps as steps
from gimbal_pin.online.learning import Event as Event
