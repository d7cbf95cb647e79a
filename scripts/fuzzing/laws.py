"""What must hold of every call, whatever it was given."""

from __future__ import annotations

import csv
import io
import json
import re
import unicodedata
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Any

import lxml.html
import yaml

from fuzzing.running import Ran

SECONDS, WAITING = 10.0, 60.0
"""Work of one call, s, and the same with what a busy machine makes it wait."""
MEMORY = 3 << 29
"""What a call may take, B: a log of the largest size that is read, and half of it again for its reader."""
LONGEST = 300
"""Characters of a message."""
OWN, NOTE = "gimbal-pin: ", "gimbal-pin: note: "
CODES = (0, 2, 3)
WARNING = re.compile(r"(?:.*/(?:gimbal_pin|site-packages)/)?(\S+):\d+: (\w+Warning: .*)")
"""How Python writes a warning: file, line, kind and text."""


@dataclass(frozen=True)
class Failure:
    """A law that did not hold.

    Attributes:
        kind: Which one.
        signature: What makes it the same failure as another: an exception's type and place, a message's shape.
        detail: What came out.
    """

    kind: str
    signature: str
    detail: str

    def to_dict(self) -> dict[str, str]:
        """As plain data."""
        return asdict(self)


def failures(run: Ran, code: int | None = None, plain: Ran | None = None) -> list[Failure]:
    """Return every law that a call broke: also that it ends with `code`, and has the pages of the `plain` one."""
    return [*ended(run, code), *said(run), *written(run), *(paged(run, plain) if plain is not None else ())]


def ended(run: Ran, code: int | None) -> Iterator[Failure]:
    """Its own errors only, in time and in bounded memory."""
    if run.code is None:
        yield Failure("exception", f"{run.error} in {run.frame}", run.trace)
    elif run.code not in CODES:
        yield Failure("exit code", f"exit code {run.code}", run.err.decode(errors="replace")[-2000:])
    elif code is not None and run.code != code:
        yield Failure("exit code", f"{run.code} instead of {code}", run.err.decode(errors="replace")[-2000:])
    if run.memory > MEMORY:
        yield Failure("memory", f"over {MEMORY >> 20} MiB", f"{run.memory >> 20} MiB")
    if run.seconds > WAITING:
        yield Failure("slow", "over the time", f"{run.seconds:.1f} s")


def said(run: Ran) -> Iterator[Failure]:
    """Each message one line, short, without control bytes, and the package's own."""
    for name, stream in (("standard error", run.err), ("standard output", run.out)):
        text = stream.decode("utf-8", errors="replace")
        marks = sorted({mark for mark in text if control(mark)})
        if marks:
            line = next(line for line in text.split("\n") if any(control(mark) for mark in line))
            yield Failure("control bytes", f"{name}: {shape(line)}", f"{marks!r} in {line[:600]!r}")
    lines = run.err.decode("utf-8", errors="replace").split("\n")
    if lines[-1]:
        yield Failure("message", "no line end on standard error", repr(lines[-1][-300:]))
    complaints = 0
    for line, above in zip(lines, ("", *lines)):
        if not line or (WARNING.match(above) and line.startswith("  ")):  # the line of source below a warning
            continue
        if (warning := WARNING.match(line)) is not None:
            yield Failure("foreign line", f"{warning[2]} in {warning[1]}", repr(line[:600]))
            continue
        if not line.startswith(OWN):
            yield Failure("foreign line", shape(line), repr(line[:600]))
            continue
        start = NOTE if line.startswith(NOTE) else OWN
        complaints += start == OWN
        if len(line) - len(start) > LONGEST:
            yield Failure("long message", shape(line[len(start) :]), f"{len(line)} characters: {line[:400]!r}")
    if run.code in (2, 3) and complaints != 1:
        yield Failure("message", f"{complaints} lines of error", run.err.decode(errors="replace")[:2000])


def control(mark: str) -> bool:
    """Whether a character steers a terminal, or turns the text around."""
    return mark not in "\n\t" and (
        unicodedata.category(mark) in ("Cc", "Cs") or mark in "\u202d\u202e\u2066\u2067\u2068"
    )


def shape(line: str) -> str:
    """Return a message without what differs from case to case."""
    plain = "".join("?" if control(mark) else mark for mark in line)
    plain = re.sub(r"'[^']*'|\"[^\"]*\"|`[^`]*`", "'…'", plain)
    return re.sub(r"\S*[\d/\\]\S*", "#", plain)[:90]


def written(run: Ran) -> Iterator[Failure]:
    """Inputs as they were; files whole, and no others."""
    for name in run.changed:
        yield Failure("input changed", name.rpartition(".")[2], name)
    for name, content in run.left.items():
        last = name.rpartition("/")[2]
        if last.startswith("."):
            yield Failure("partial file", "a temporary file is left", name)
        elif (why := broken(last, content)) is not None:
            yield Failure("partial file", f"{last.rpartition('.')[2]}: {why[:60]}", f"{name}, {len(content)} B: {why}")


def paged(run: Ran, plain: Ran) -> Iterator[Failure]:
    """The elements of the plain one's pages; of those in drawings, which grow with a text's width, the kinds alone."""
    found, wanted = elements(run), elements(plain)
    if run.code == plain.code and found != wanted:
        other = {name: (found[name], wanted[name]) for name in found | wanted if found[name] != wanted[name]}
        yield Failure("foreign element", ", ".join(sorted(other))[:90], f"{other}")


def elements(run: Ran) -> Counter[str]:
    """Return how often each kind of element, and of attribute that is code, stands in the pages that were written."""
    count: Counter[str] = Counter()
    for content in (content for name, content in run.left.items() if name.endswith(".html")):
        for element in lxml.html.fromstring(content).iter():
            kinds = [str(element.tag), *(f"{element.tag} {name}" for name in element.attrib if name.startswith("on"))]
            drawn = any(above.tag == "svg" for above in element.iterancestors())
            count.update({f"drawn {kind}": 1 for kind in kinds if count[f"drawn {kind}"] == 0} if drawn else kinds)
    return count


def broken(name: str, content: bytes) -> str | None:
    """Return why a file is not whole, or None; a suffix that is not known says nothing.

    One that is whole in another format is whole, too.
    """
    suffix = name.rpartition(".")[2].lower()
    reasons = {}
    for kind in (suffix, *WHOLE):
        try:
            if kind not in WHOLE or WHOLE[kind](content):
                return None
            reasons[kind] = "is not whole"
        except (ValueError, csv.Error, yaml.YAMLError, ET.ParseError) as error:
            reasons[kind] = " ".join(str(error).split())
    return reasons[suffix]


def table(content: bytes) -> bool:
    """Whether a table has a header and whole rows."""
    rows = list(csv.reader(io.StringIO(content.decode())))
    return content.endswith(b"\n") and len({len(row) for row in rows}) == 1


def tree(content: bytes) -> bool:
    """Whether it is YAML with a table or a list in it."""
    loader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    return content.endswith(b"\n") and isinstance(yaml.load(content, loader), (dict, list))


def ends(first: bytes, last: bytes) -> Callable[[bytes], bool]:
    """Whether it begins and ends as its format does."""
    return lambda content: content.startswith(first) and content.rstrip().endswith(last)


WHOLE: Mapping[str, Callable[[bytes], bool]] = {
    "json": lambda content: json.loads(content) is not None,
    "yaml": tree,
    "yml": tree,
    "csv": table,
    "html": ends(b"<", b"</html>"),
    "svg": ends(b"<?xml", b"</svg>"),
    "pdf": ends(b"%PDF", b"%%EOF"),
    "png": ends(b"\x89PNG", b"IEND\xaeB`\x82"),
    "parquet": ends(b"PAR1", b"PAR1"),
    "urdf": lambda content: ET.fromstring(content) is not None,
}
"""Suffix → whether a file of it is whole."""
