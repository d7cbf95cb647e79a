"""What the simulation gets wrong, why, and how much is gained by knowing.

log → audit → refitted model → evidence in rows of unit noise → causes tried, composed and pruned → rivals → verdict
"""

from gimbal_pin.diagnosis.band import BAND as BAND
from gimbal_pin.diagnosis.band import usual as usual
from gimbal_pin.diagnosis.diagnose import diagnose as diagnose
from gimbal_pin.diagnosis.next_experiment import next_experiment as next_experiment
from gimbal_pin.diagnosis.next_experiment import planned as planned
from gimbal_pin.diagnosis.parting import NextExperiment as NextExperiment
from gimbal_pin.diagnosis.result import Diagnosis as Diagnosis
from gimbal_pin.diagnosis.result import Finding as Finding
