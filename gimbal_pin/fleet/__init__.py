"""Beyond one rig: many units of work on any executor, Monte Carlo over perturbed rigs, and fleets compared."""

from gimbal_pin.fleet.engine import Progress, Run, dask_executors, process_pool, run_units

__all__ = ["Progress", "Run", "dask_executors", "process_pool", "run_units"]
