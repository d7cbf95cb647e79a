"""Beyond one rig: many units of work on any executor, Monte Carlo over rigs that differ, and units of a fleet."""

from gimbal_pin.fleet.engine import Progress, Run, dask_executors, process_pool, run_units
from gimbal_pin.fleet.population import Comparison, Deviation, Kind, Parameter, UnitEstimate, compare_units

__all__ = [
    "Comparison",
    "Deviation",
    "Kind",
    "Parameter",
    "Progress",
    "Run",
    "UnitEstimate",
    "compare_units",
    "dask_executors",
    "process_pool",
    "run_units",
]
