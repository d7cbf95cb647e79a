"""``gimbal-pin identify --follow``: a growing log, a line a second."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf
from typing import TYPE_CHECKING, Annotated, Literal

from gimbal_pin.cli import options as opt
from gimbal_pin.cli.cameras import list_tags
from gimbal_pin.cli.inputs import load_rig, read_payload
from gimbal_pin.cli.present import draw, say, tell
from gimbal_pin.errors import LogError, UsageError
from gimbal_pin.report import text

if TYPE_CHECKING:
    from gimbal_pin.identification import Identified, Online
    from gimbal_pin.log.log import Log
    from gimbal_pin.regression import Filtering


@dataclass(frozen=True)
class Following:
    """Options of a log that is still being written.

    Attributes:
        follow: learn from a growing CSV file, - (standard input), or a gimbal: udp://HOST:PORT, serial:DEVICE@BAUD
        forget: with --follow: what is older counts less (default: never)
        anew: with --follow: what is estimated anew when the payload has changed
        idle: with --follow: end when the file has not grown for so long (default: never)
        plot: with --follow: write the estimates over time: .png, .svg or .pdf
    """

    follow: bool = False
    forget: Annotated[opt.Maybe[float], opt.between("--forget", 0.1, 1e6, "s")] = None
    anew: Literal["payload", "everything"] = "payload"
    idle: Annotated[opt.Maybe[float], opt.between("--idle", 0, 1e6, "s")] = None
    plot: opt.Plotted = None

    def check(self, batch_only: Mapping[str, bool]) -> None:
        """Raise `UsageError` for what does not go with following, or with a log that is whole."""
        mine = {"--forget": self.forget, "--idle": self.idle, "--plot": self.plot}
        moot = {**{name: value is not None for name, value in mine.items()}, "--anew": self.anew != "payload"}
        what, mend = "--follow", "it learns by weighted least squares and is tested on what comes next"
        if not self.follow:
            what, mend = "a log that is whole", "add --follow"
        for option, is_given in (batch_only if self.follow else moot).items():
            if is_given:
                raise UsageError(option, f"does not go with {what}", mend)

    def start(
        self, rig: str, payload: str | None, logs: Sequence[str], known: str | None, filters: Filtering | None
    ) -> Online:
        """Return the estimator of the one log; it knows a gimbal already where a model's YAML is given."""
        from gimbal_pin.identification import Online
        from gimbal_pin.identification.model_file import read_model

        if len(logs) != 1:
            raise UsageError("LOG", f"names {len(logs)} logs", "follow one at a time")
        loaded = load_rig(rig, payload or list_tags(logs)[0])
        before = None if known is None else read_model(known, load_rig(rig, read_payload(known)))
        fading = inf if self.forget is None else self.forget
        return Online.of(loaded, filtering=filters, fading=fading, everything=self.anew == "everything", known=before)

    def learn(self, online: Online, log: str, mapping: Sequence[str], as_lines: bool) -> Identified:
        """Learn from a growing log until it ends, cannot be used any longer or Ctrl-C is pressed, a line a second.

        `as_lines`: of JSON, else of text.
        """
        from gimbal_pin.identification import iterate_progress, report_progress
        from gimbal_pin.log.io.files import to_json
        from gimbal_pin.log.io.follow import follow
        from gimbal_pin.report.progress_chart import chart

        history, told, spoken, memory, broken = [], 0, 0, online.start(log), list[str]()
        come = follow(log, online.design.rig, mapping, idle=inf if self.idle is None else self.idle)
        try:
            for memory in iterate_progress(online, tell_events(come), log):
                second = int(memory.t + 1e-6) if memory.samples else 0
                if second == spoken and len(memory.events) == told:
                    continue
                now = report_progress(online, memory)
                history += [now] if self.plot is not None else []
                say(to_json(now.to_dict(), None)[:-1] if as_lines else text.following(now, told))
                told, spoken = len(memory.events), second
        except KeyboardInterrupt:
            pass
        except LogError as error:
            if not online.is_ready(memory):
                raise
            broken = [f"learned up to {memory.t:.1f} s; from there on the log cannot be used: {error}"]
        found = online.identified(memory)
        draw(lambda: chart(history), self.plot)
        return replace(found, notes=(*found.notes, *broken))


def tell_events(logs: Iterator[Log]) -> Iterator[Log]:
    """Pass logs on; say each thing that was noticed about them once."""
    said: set[str] = set()
    for log in logs:
        for event in (event for event in log.events if event.split()[0] not in said):
            said.add(event.split()[0])
            tell([event])
        yield log


WHOLE = Following()
"""Nothing is asked of a log that is whole."""
