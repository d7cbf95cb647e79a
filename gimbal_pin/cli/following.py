"""``gimbal-pin identify --follow``: a growing log, a line a second."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING

from gimbal_pin.cli.present import say, tell, write_figure
from gimbal_pin.errors import NORMAL_95, LogError, digits

if TYPE_CHECKING:
    from gimbal_pin.identification import IdentificationResult, Online, Progress
    from gimbal_pin.log.log import Log


def learn(
    online: Online,
    log: str,
    mapping: Sequence[str],
    idle: float | None,
    plot: Path | None,
    as_lines: bool,
) -> IdentificationResult:
    """Learn from a growing log until it ends, cannot be used any longer or Ctrl-C is pressed, a line a second.

    `as_lines`: of JSON, else of text.
    """
    from gimbal_pin.identification import iterate_progress, report_progress
    from gimbal_pin.log.io.files import to_json
    from gimbal_pin.log.io.follow import follow
    from gimbal_pin.report.progress_chart import draw_progress_chart

    history = []
    told = 0
    spoken = 0
    memory = online.start(log)
    broken = list[str]()
    come = follow(log, online.design.rig, mapping, idle=inf if idle is None else idle)
    try:
        for memory in iterate_progress(online, tell_events(come), log):
            second = int(memory.t + 1e-6) if memory.samples else 0
            if second == spoken and len(memory.events) == told:
                continue
            now = report_progress(online, memory)
            history += [now] if plot is not None else []
            say(to_json(now.to_dict(), None)[:-1] if as_lines else describe_progress(now, told))
            told = len(memory.events)
            spoken = second
    except KeyboardInterrupt:
        pass
    except LogError as error:
        if not online.is_ready(memory):
            raise
        broken = [f"learned up to {memory.t:.1f} s; from there on the log cannot be used: {error}"]
    found = online.identified(memory)
    write_figure(partial(draw_progress_chart, history), plot)
    return replace(found, notes=(*found.notes, *broken))


def tell_events(logs: Iterator[Log]) -> Iterator[Log]:
    """Pass logs on; say each thing that was noticed about them once."""
    said: set[str] = set()
    for log in logs:
        for event in (event for event in log.events if event.split()[0] not in said):
            said.add(event.split()[0])
            tell([event])
        yield log


def describe_progress(found: Progress, said: int) -> str:
    """Return events after `said`, and a line on an online estimate: time, torque error, the most telling parameters."""
    error = ", ".join(f"{joint} {digits(value, 2)}" for joint, value in found.torque_error.items())
    parts = [f"{found.t:8.1f} s", *([f"off by {error} N m;"] if error else [])]
    if found.hidden:
        parts.append(f"{len(found.hidden)} of {len(found.names)} parameters do not show yet")
    else:
        rows = [
            (found.names[k], found.value[k], NORMAL_95 * found.std[k], found.units[k])
            for k in found.telling[:3]
        ]
        parts.append(
            ", ".join(
                f"{name} {digits(x, 4)} ± {digits(half, 1)} {unit}" for name, x, half, unit in rows
            )
        )
    events = [f"{event.t:8.1f} s  {event.sentence}" for event in found.events[said:]]
    return "\n".join([*events, "  ".join(parts)])
