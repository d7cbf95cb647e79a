"""Where a page comes from, in its head: when, by which call, of which files, and what was written beside it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime

from markupsafe import Markup

from gimbal_pin import __version__
from gimbal_pin.report.elements import Table, join


@dataclass(frozen=True)
class Origin:
    """The call that made a page.

    Attributes:
        time: When; it is passed in, as a page that is made again is otherwise the same.
        command: What was typed, or what means the same.
        inputs: Name and SHA-256, hexadecimal, of each file that was read.
        files: What was written beside the page → the file's name, which is linked.
    """

    time: datetime
    command: str
    inputs: Sequence[tuple[str, str]]
    files: Mapping[str, str] = field(default_factory=dict)

    def __html__(self) -> str:
        """Return it as an element of a page: one line, which opens."""
        line = Markup("{} · gimbal_pin {} · <code>{}</code>").format(
            f"{self.time:%Y-%m-%d %H:%M %Z}", __version__, self.command
        )
        rows = [
            [name, Markup("<code>{}</code>").format(digest[:12])] for name, digest in self.inputs
        ]
        links = Markup(", ").join(
            Markup('<a href="{}">{}</a> ({})').format(name, name, what)
            for what, name in self.files.items()
        )
        parts = (
            [Table(["Read", "SHA-256 begins with"], rows, texts=2, label="Files that were read")]
            if rows
            else []
        )
        more = [Markup("<p>Written beside this page: {}.</p>").format(links)] if links else []
        return Markup('<details class="origin"><summary>{}</summary>{}</details>').format(
            line, join([*parts, *more])
        )
