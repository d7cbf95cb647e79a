"""One root error; every message names the place and the mend in one line."""

from __future__ import annotations

FEW = 6
"""Most names in a message."""


class GimbalPinError(Exception):
    """``place: what is wrong; what mends it``, on one line.

    Attributes:
        place: File, line, column, joint or argument that the error speaks of.
        what: What is wrong there.
        mend: What the reader can do about it.
        exit_code: Status of the command line (CONTRACT: 2 bad input, 3 the data cannot answer).
    """

    exit_code = 2

    def __init__(self, place: str, what: str, mend: str) -> None:
        """Join the three parts; line breaks inside them are folded."""
        self.place, self.what, self.mend = (" ".join(part.split()) for part in (place, what, mend))
        super().__init__(f"{self.place}: {self.what}; {self.mend}")


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
        super().__init__(place, f"{what}: {', '.join(unseen[:FEW])}{rest}" if unseen else what, mend)
