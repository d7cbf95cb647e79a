"""What a gimbal sends over UDP that begins anew, on a line that loses, doubles and garbles."""

from __future__ import annotations

import struct
from collections.abc import Callable

import numpy as np

from fuzzing import damaged_csv
from fuzzing.junk import one

Frames = list[bytes]
"""Each frame with its zero."""
RNG = np.random.Generator


def sample(number: int, t: float, values: list[float]) -> bytes:
    """Return one sample's frame: stamp in us, state, angles, rates and torques."""
    from gimbal_pin.log.io.link import LOG_FRAME, Frame, encode_frame

    body = struct.pack(f"<QI{len(values)}f", round(1e6 * t) % 2**64, 0, *values)
    return encode_frame(Frame(LOG_FRAME, number, body))


def sent(table: bytes, late: float = 0.0) -> Frames:
    """Return the frames of a log of one joint, its stamps so many seconds late."""
    columns = damaged_csv.shown(table)
    rows = np.column_stack([columns[name] for name in ("q_pan", "dq_pan", "tau_pan")])
    return [sample(k, late + t, row.tolist()) for k, (t, row) in enumerate(zip(columns["t"], rows))]


def garbled(rng: RNG, frames: Frames) -> None:
    """Bytes that are no frame, with zeros among them or without."""
    at = int(rng.integers(len(frames) + 1))
    frames[at:at] = [rng.bytes(int(rng.choice([1, 3, 50, 2000]))) for _ in range(int(rng.integers(1, 5)))]


def doubled(rng: RNG, frames: Frames) -> None:
    """Frames come twice, at once or later."""
    start = int(rng.integers(len(frames)))
    block = frames[start : start + int(rng.integers(1, 20))]
    at = start + len(block) + int(rng.choice([0, 5]))
    frames[at:at] = block


def cut(rng: RNG, frames: Frames) -> None:
    """Frames end too early, with their zero or without it."""
    for at in rng.integers(len(frames), size=3):
        frames[at] = frames[at][: int(rng.integers(len(frames[at])))] + one(rng, (b"", b"\0"))


def lost(rng: RNG, frames: Frames) -> None:
    """Frames do not come."""
    start = int(rng.integers(len(frames)))
    del frames[start : start + int(rng.integers(1, 20))]


def swapped(rng: RNG, frames: Frames) -> None:
    """A frame overtakes another."""
    at = int(rng.integers(len(frames) - 1))
    frames[at], frames[at + 1] = frames[at + 1], frames[at]


def wild(rng: RNG, frames: Frames) -> None:
    """Whole frames of what cannot be: stamps, values, joints, types."""
    from gimbal_pin.log.io.link import Frame, encode_frame

    t = float(rng.choice([0.0, 1e6, 9.2e12, 1.8e13]))
    value = float(rng.choice([np.nan, np.inf, 3e38, 1e-40, 0.0]))
    strange: tuple[bytes, ...] = (
        sample(0, t, [0.0, 0.0, 0.0]),
        sample(0, 1.0, [value] * 3),
        sample(0, 1.0, [0.0] * int(rng.choice([0, 1, 6, 300]))),
        encode_frame(Frame(int(rng.integers(256)), 0, rng.bytes(int(rng.integers(60))))),
    )
    at = int(rng.integers(len(frames) + 1))
    frames[at:at] = [one(rng, strange)] * int(rng.choice([1, 30]))


HARMLESS: tuple[Callable[[RNG, Frames], None], ...] = (garbled, doubled, cut, lost, swapped)
"""What a line does, and must not keep a log from being learned."""


def drawn(rng: RNG, table: bytes) -> tuple[tuple[bytes, ...], bool]:
    """Return datagrams, and whether they must be learned from: a few samples, then the whole log by a clock anew."""
    before = sent(table, float(rng.choice([2.0, 100.0, 1e6])))[: int(rng.choice([1, 10, 50]))]
    frames = [*before * bool(rng.random() < 0.8), *sent(table)]
    for _ in range(int(rng.integers(0, 4))):
        one(rng, HARMLESS)(rng, frames)
    harmless = bool(rng.random() < 0.7)
    if not harmless:
        wild(rng, frames)
    size = int(rng.choice([1, 10, 40]))
    return tuple(b"".join(frames[k : k + size]) for k in range(0, len(frames), size)), harmless
