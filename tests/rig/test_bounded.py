"""A process of its own is stopped for the processor time that it takes, not for the time that passes."""

from __future__ import annotations

import time

import pytest

from gimbal_pin.rig.bounded import ProcessStopped, run_bounded


def main(kind: str) -> str:
    """Wait, work without end, or raise an error: what `run_bounded` runs in its process."""
    if kind == "waits":  # as a process does that gets no turn on a busy machine
        time.sleep(1.3)
        return "ended"
    if kind == "fails":
        raise ValueError("no such joint")
    while True:
        pass


def test_a_process_that_waits_is_not_stopped() -> None:
    assert run_bounded(__name__, "waits", seconds=1) == "ended"


@pytest.mark.parametrize(
    ("kind", "said"), [("works", "1 s of processor time"), ("fails", "no such joint")]
)
def test_a_process_that_works_too_long_or_fails_gives_the_reason(kind: str, said: str) -> None:
    with pytest.raises(ProcessStopped, match=said):
        run_bounded(__name__, kind, seconds=1)
