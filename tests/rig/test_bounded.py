"""A process of its own is stopped for the processor time that it takes, not for the time that passes."""

from __future__ import annotations

import time

import pytest

from gimbal_pin.rig.bounded import ProcessStopped, run_bounded


def main(kind: str) -> str:
    """Wait, work without end, or raise an error: what `run_bounded` runs in its process."""
    if kind == "waits":  # as a process does that gets no turn on a busy machine
        time.sleep(2.5)
        return "ended"
    if kind == "fails":
        raise ValueError("no such joint")
    while True:
        pass


def test_a_process_that_waits_is_not_stopped() -> None:
    assert run_bounded(__name__, "waits", seconds=1) == "ended"


def test_a_process_that_works_too_long_is_stopped_and_the_reason_is_given() -> None:
    with pytest.raises(ProcessStopped, match="1 s of processor time"):
        run_bounded(__name__, "works", seconds=1)


def test_the_error_of_a_process_is_given() -> None:
    with pytest.raises(ProcessStopped, match="no such joint"):
        run_bounded(__name__, "fails")
