"""One root error; every message names the place and the mend in one short line, its numbers as people write them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from math import floor, isfinite, log10

FEW = 6
"""Most names in a message."""
PLACE = 60
"""Most characters of the place where a message would be too long."""
LONGEST_MESSAGE = 280
"""Most characters of a message: a line of 300 has room for the program's name and ``note:`` before it."""

MOST_DIGITS = 8
"""Most significant digits of a value that is known very well."""
LARGEST_PLAIN = 1e7
"""From here on a number is written with a power of ten; below 1e-4, too."""
UNSAFE = re.compile(
    r"[\x00-\x09\x0b-\x1f\x7f-\x9f\u061c\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff\ud800-\udfff]"
)
"""What a terminal obeys or hides instead of showing it: control bytes but the line feed, marks of writing direction and
of no width, and the halves of pairs that bytes of a file's name become which are no UTF-8."""
NORMAL_95 = 1.96
"""Standard deviations to either side that hold 95 % of a normal distribution: of what a person reads, each ±."""


def visible(text: str) -> str:
    """Return a text with every character of `UNSAFE` written out as Python writes it, such as its code after an x."""
    return UNSAFE.sub(lambda found: repr(found[0])[1:-1], text)


def message(parts: Sequence[str], between: Sequence[str]) -> str:
    """Join parts on one line of at most `LONGEST_MESSAGE` characters, the longest of them shortened in their middles.

    Of several the first, the place, is shortened before all others: a path says least where it begins. The last, the
    mend, is shortened after all others: half a command is none.
    """
    shown = [visible(" ".join(part.split())) for part in parts]
    room = LONGEST_MESSAGE - sum(map(len, between))
    if between and sum(map(len, shown)) > room and len(shown[0]) > PLACE:
        shown[0] = f"…{shown[0][1 - PLACE :]}"
    if len(shown) == 3 and (left := room - len(shown[0]) - len(shown[2])) > PLACE // 2:
        shown[1] = shortened(shown[1], left)
    most = next(
        most for most in range(room, 0, -1) if sum(min(len(part), most) for part in shown) <= room
    )
    fitted = [shortened(part, most) for part in shown]
    return "".join(word for pair in zip(fitted, (*between, "")) for word in pair)


def shortened(text: str, most: int) -> str:
    """Return a text of at most that many characters, its middle left out where it is longer."""
    head = most // 2
    return text if len(text) <= most else f"{text[:head]}…{text[len(text) - (most - head - 1) :]}"


class GimbalPinError(Exception):
    """``place: what is wrong; what mends it``, on one line.

    Attributes:
        place: File, line, column, joint or argument that the error speaks of.
        what: What is wrong there.
        mend: What the reader can do about it.
        exit_code: Status of the command line (2 bad input, 3 the data cannot answer).
    """

    exit_code = 2

    def __init__(self, place: str, what: str, mend: str) -> None:
        """Join the three parts as `message` does."""
        self.place, self.what, self.mend = (
            visible(" ".join(part.split())) for part in (place, what, mend)
        )
        super().__init__(message((place, what, mend), (": ", "; ")))

    def __reduce__(self) -> tuple[type[GimbalPinError], tuple[str, str, str], dict[str, object]]:
        """Make it pass between processes, which by itself an exception of several arguments does not."""
        return type(self), (self.place, self.what, self.mend), vars(self)


class UsageError(GimbalPinError):
    """An argument that cannot be used as given."""


class RigError(GimbalPinError):
    """A URDF, a payload or a rig's YAML that does not describe a rig."""


class LogError(GimbalPinError):
    """A log or trajectory file that cannot be read as one."""


class ModelError(GimbalPinError):
    """A model or controller file, or a set of parameters, that cannot be used."""


class DataError(GimbalPinError):
    """The log is well formed but cannot answer the question (too short, no motion).

    Attributes:
        unseen: Names of the parameters that the data cannot show.
    """

    exit_code = 3

    def __init__(self, place: str, what: str, mend: str, unseen: tuple[str, ...] = ()) -> None:
        """Append the unseen parameters' names to what is wrong, the first `FEW` of them."""
        self.unseen = unseen
        rest = f" and {len(unseen) - FEW} more" if len(unseen) > FEW else ""
        super().__init__(
            place, f"{what}: {', '.join(unseen[:FEW])}{rest}" if unseen else what, mend
        )


def digits(value: float, count: int = 3) -> str:
    """Return a value with so many significant digits, and all of those before the point: ``0.021``, ``2.1``, ``213``.

    Zeros behind the point go; ``1.2e-05`` and ``2.1e+07`` have their powers.
    """
    text = f"{value:.{count}g}"
    return f"{value:.0f}" if "e+" in text and abs(value) < LARGEST_PLAIN else text


def finite_or_none(value: float) -> float | None:
    """Return a number as JSON holds it: null where there is none."""
    return value if isfinite(value) else None


def format_estimate(value: float, std: float, count: int = 3) -> str:
    """Return a value and half of its 95 % interval as `digits` has them: ``0.0213 ± 0.0042``.

    The value has `count` significant digits, and more where the interval's second digit lies beyond them, as in
    ``2.1804 ± 0.0024``.
    """
    half = NORMAL_95 * std
    if value and half > 0 and isfinite(half):
        count = max(count, min(floor(log10(abs(value))) - floor(log10(half)) + 2, MOST_DIGITS))
    return f"{digits(value, count)} ± {digits(half, 2)}"
