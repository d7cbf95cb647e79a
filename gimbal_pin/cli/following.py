"""``gimbal-pin identify --follow``: a growing log, a line a second."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from tyro.conf import arg

from gimbal_pin.cli.cameras import tags_of
from gimbal_pin.cli.inputs import alone, load_rig, mounted
from gimbal_pin.cli.options import Plotted, between, optional
from gimbal_pin.cli.present import noted, present, say
from gimbal_pin.errors import LogError, UsageError
from gimbal_pin.report import text

if TYPE_CHECKING:
    from gimbal_pin.identification import Identified, Online
    from gimbal_pin.log.log import Log
    from gimbal_pin.regression import Filtering


@dataclass(frozen=True)
class Following:
    """Options of a log that is still being written."""

    follow: Annotated[
        bool,
        arg(help="learn from a growing CSV file, - (standard input), or a gimbal: udp://HOST:PORT, serial:DEVICE@BAUD"),
    ] = False
    forget: Annotated[
        float | None,
        between("--forget", 0.1, 1e6, "s"),
        optional(None, "with --follow: what is older counts less", "never"),
    ] = None
    anew: Annotated[
        Literal["payload", "everything"], arg(help="with --follow: what is estimated anew when the payload has changed")
    ] = "payload"
    idle: Annotated[
        float | None,
        between("--idle", 0, 1e6, "s"),
        optional(None, "with --follow: end when the file has not grown for so long", "never"),
    ] = None
    plot: Annotated[Plotted, optional("FILE", "with --follow: write the estimates over time: .png, .svg or .pdf")] = (
        None
    )

    def check(self, batch_only: Mapping[str, bool]) -> None:
        """Raise `UsageError` for what does not go with following, or with a log that is whole."""
        if self.follow:
            alone("--follow", batch_only, "it learns by weighted least squares and is tested on what comes next")
            return
        given = {"--forget": self.forget, "--idle": self.idle, "--plot": self.plot}
        moot = {name: value is not None for name, value in given.items()}
        alone("a log that is whole", {**moot, "--anew": self.anew != "payload"}, "add --follow")

    def start(
        self, rig: str, payload: str | None, logs: Sequence[str], known: str | None, filters: Filtering
    ) -> Online:
        """Return the estimator of the one log; it knows a gimbal already where a model's YAML is given."""
        from gimbal_pin.identification import Online
        from gimbal_pin.identification.model_file import read_model

        if len(logs) != 1:
            raise UsageError("LOG", f"names {len(logs)} logs", "follow one at a time")
        loaded = load_rig(rig, payload or tags_of(logs)[0])
        before = None if known is None else read_model(known, load_rig(rig, mounted(known)))
        fading, everything = inf if self.forget is None else self.forget, self.anew == "everything"
        return Online.of(loaded, known=before, filtering=filters, fading=fading, everything=everything)


WHOLE = Following()
"""Nothing is asked of a log that is whole."""


def followed(online: Online, log: str, mapping: Sequence[str], wish: Following, lines: bool) -> Identified:
    """Learn from a growing log until it ends, cannot be used any longer or Ctrl-C is pressed, a line a second.

    With `lines` as JSON, else as text; `wish` says how long to wait for more, and where the way is drawn in the end.
    """
    from gimbal_pin.identification import iterate_progress, report_progress
    from gimbal_pin.log.io.files import open_replacement, to_json
    from gimbal_pin.log.io.follow import follow
    from gimbal_pin.report.progress_chart import chart

    history, told, spoken, memory, broken = [], 0, 0, online.start(log), list[str]()
    try:
        come = heard(follow(log, online.design.rig, mapping, idle=inf if wish.idle is None else wish.idle))
        for memory in iterate_progress(online, come, log):
            second = int(memory.t + 1e-6) if memory.samples else 0
            if second == spoken and len(memory.events) == told:
                continue
            now = report_progress(online, memory)
            history += [now] if wish.plot is not None else []
            say(to_json(now.to_dict(), None)[:-1] if lines else text.following(now, told))
            told, spoken = len(memory.events), second
    except KeyboardInterrupt:
        pass
    except LogError as error:
        if not online.is_ready(memory):
            raise
        broken = [f"learned up to {memory.t:.1f} s; from there on the log cannot be used: {error}"]
    found = online.identified(memory)
    found = replace(found, notes=(*found.notes, *broken))
    if wish.plot is not None:
        with open_replacement(wish.plot) as temporary:
            chart(history).savefig(temporary)
    return found


def concluded(found: Identified, json: Path | None) -> None:
    """Say what was learned: the last line of JSON where every second had one, else as for a log that is whole."""
    from gimbal_pin.identification import compare_payload, report_with_payload
    from gimbal_pin.log.io.files import to_json

    about = compare_payload(found)
    if by_line(json):
        say(to_json({**report_with_payload(found, about), "kind": "result"}, None)[:-1])
    else:
        present(text.identified(found, about), report_with_payload(found, about), json)


def by_line(json: Path | None) -> bool:
    """Tell whether standard output gets a line of JSON a second."""
    return json is not None and str(json) == "-"


def heard(logs: Iterator[Log]) -> Iterator[Log]:
    """Pass logs on; say each thing that was noticed about them once."""
    said: set[str] = set()
    for log in logs:
        for event in (event for event in log.events if event.split()[0] not in said):
            said.add(event.split()[0])
            noted([event])
        yield log
