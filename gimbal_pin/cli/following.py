"""``gimbal-pin identify --follow``: a growing log, a line a second."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterator, Sequence
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gimbal_pin import text
from gimbal_pin.cli.cameras import tags_of
from gimbal_pin.cli.inputs import load_rig, mounted
from gimbal_pin.errors import UsageError

if TYPE_CHECKING:
    from gimbal_pin.log import Log


def followed(
    rig: str,
    payload: str | None,
    logs: Sequence[str],
    mapping: Sequence[str],
    known: str | None,
    wish: dict[str, Any],
    idle: float | None,
    output: Path | None,
    urdf: Path | None,
    plot: Path | None,
    json: Path | None,
) -> None:
    """Learn from a growing log until it ends or Ctrl-C is pressed, a line a second; then write what was learned."""
    from gimbal_pin.balance import reported
    from gimbal_pin.io.files import atomic_write, replacing, to_json, write_json
    from gimbal_pin.io.follow import follow
    from gimbal_pin.io.model import read_model, write_model
    from gimbal_pin.online import Online, progress, steps
    from gimbal_pin.online.chart import chart

    if len(logs) != 1:
        raise UsageError("LOG", f"names {len(logs)} logs", "follow one at a time")
    loaded = load_rig(rig, payload or tags_of(logs)[0])
    before = None if known is None else read_model(known, load_rig(rig, mounted(known)))
    online = Online.of(loaded, known=before, **wish)
    lines, history, told, spoken = json is not None and str(json) == "-", [], 0, 0
    memory = online.start(logs[0])
    with contextlib.suppress(KeyboardInterrupt):
        come = noted(follow(logs[0], loaded, mapping, idle=inf if idle is None else idle))
        for memory in steps(online, come, logs[0]):
            second = int(memory.t + 1e-6) if memory.samples else 0
            if second == spoken and len(memory.events) == told:
                continue
            now = progress(online, memory)
            history += [now] if plot is not None else []
            print(to_json(now.to_dict(), None)[:-1] if lines else text.following(now, told), flush=True)
            told, spoken = len(memory.events), second
    found = online.identified(memory)
    result = reported(found)
    if output is not None:
        write_model(found, output)
    if urdf is not None:
        atomic_write(urdf, found.to_urdf())
    if plot is not None:
        with replacing(plot) as temporary:
            chart(history).savefig(temporary)
    print(to_json({**result, "kind": "result"}, None)[:-1] if lines else text.identified(found))
    if json is not None and not lines:
        write_json(result, json)


def noted(logs: Iterator[Log]) -> Iterator[Log]:
    """Pass logs on; say each thing that was noticed about them once."""
    said: set[str] = set()
    for log in logs:
        for event in (event for event in log.events if event.split()[0] not in said):
            said.add(event.split()[0])
            print(f"gimbal-pin: note: {event}", file=sys.stderr)
        yield log
