"""A CAN bus as candump writes it: the ODrives on it, by the CANSimple protocol's published layout.

A frame's identifier is ``node << 5 | command``, its data are little-endian floats (docs/can-protocol.rst of ODrive,
firmware 0.5.1 and later: turns and turns/s; Get_Torques is firmware 0.6's). Lines are ``(seconds) can0 029#0011…`` of
``candump -l`` or ``-L``, or ``(seconds) can0 029 [8] 00 11 …`` of ``candump -t a``.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from gimbal_pin.errors import LogError
from gimbal_pin.log.io.tables import Stream, Table, listed, table_of
from gimbal_pin.rig.reading import read_bytes

MAGIC = tuple(b"%s(%d" % (space, digit) for space in (b"", b" ") for digit in range(10))
FRAME = re.compile(
    rb"(?m)^[ \t]*\((\d{1,12}\.\d{1,9})\)[ \t]+(\w+)[ \t]+([0-9A-F]{3})(?:#|[ \t]+\[\d\][ \t]+)((?:[0-9A-F]{2} ?){4,8})"
    rb"[ \t]*(?:[RT][ \t]*)?\r?$"
)
"""Time, interface, identifier of 11 bits, and data; a request (RTR) has none."""
SIGNALS: Mapping[int, tuple[str, ...]] = {
    0x09: ("Pos_Estimate_turns", "Vel_Estimate_turns"),
    0x14: ("Iq_Setpoint", "Iq_Measured"),
    0x1C: ("Torque_Target", "Torque_Estimate"),
    0x0C: ("Setpoint_Pos_turns",),
}
"""Command → the floats that its data begin with. The last is sent to the drive: its Input_Pos."""


def open_candump(path: Path) -> Table:
    """Read a capture: one stream per ODrive and command, all by the bus's clock; `LogError` if there is no ODrive."""
    found: dict[tuple[int, str, int], tuple[list[float], list[bytes]]] = {}
    others, lines = set[str](), 0
    for time, bus, identifier, data in (frame.groups() for frame in FRAME.finditer(read_bytes(path, LogError))):
        node, command = divmod(int(identifier, 16), 32)
        content, lines = bytes.fromhex(data.decode()), lines + 1
        if len(content) < 4 * len(SIGNALS.get(command, "one")):
            others.add(identifier.decode())
            continue
        times, frames = found.setdefault((command, bus.decode(), node), ([], []))
        times.append(float(time))
        frames.append(content[: 4 * len(SIGNALS[command])])
    if not found:
        what = f"holds no estimates of an ODrive in its {lines} frames of 11-bit identifiers"
        raise LogError(str(path), what, "decode it by the device's DBC (python -m cantools decode), and write CSV")
    many = len({bus for _, bus, _ in found}) > 1
    streams, notes = [], []
    for command, bus, node in sorted(found, key=lambda key: (list(SIGNALS).index(key[0]), key)):
        times, frames = found[command, bus, node]
        with np.errstate(invalid="ignore"):  # a signalling nan becomes a quiet one
            values = np.frombuffer(b"".join(frames), "<f4").reshape(len(frames), -1).astype(np.float64)
        fine = np.all(np.isfinite(values), axis=1)  # an ODrive that has not found its encoder's zero says nan
        label = f"{bus}.node{node}" if many else f"node{node}"
        name = f"{label}.{SIGNALS[command][0]}"
        if not fine.all():
            notes.append(f"{np.sum(~fine)} of {len(frames)} frames of {name} hold no numbers: left out")
        if fine.any():
            columns = {f"{name}.t": np.array(times), **dict(zip((f"{label}.{s}" for s in SIGNALS[command]), values.T))}
            streams.append(Stream(f"{name}.t", {column: x[fine] for column, x in columns.items()}))
    if others:
        notes.append(f"frames of the identifiers {listed(sorted(others))} are none that are read: left out")
    return table_of(str(path), streams, notes)
