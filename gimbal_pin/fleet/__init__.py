"""Beyond one rig: many units of work on any executor, and Monte Carlo over rigs that differ."""

from gimbal_pin.fleet.engine import Progress, Run, dask_executors, process_pool, run_units

__all__ = ["Progress", "Run", "dask_executors", "process_pool", "run_units"]
