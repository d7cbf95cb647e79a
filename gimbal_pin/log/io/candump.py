"""A CAN bus as candump writes it: the ODrives and the moteus controllers on it, by their protocols' published layouts.

An ODrive's identifier is ``node << 5 | command``, its data are little-endian floats (docs/can-protocol.rst of ODrive,
firmware 0.5.1 and later: turns and turns/s; Get_Torques is firmware 0.6's). A moteus answers by ``source << 8 |
destination`` with subframes of registers (docs/reference.md of mjbots/moteus, A.1 and A.2). Lines are ``(seconds) can0
029#0011…`` of ``candump -l`` or ``-L``, ``029##10011…`` with CAN-FD, or ``(seconds) can0 029 [8] 00 11 …`` of ``candump
-t a``.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Mapping
from math import nan
from pathlib import Path

import numpy as np

from gimbal_pin.errors import LogError
from gimbal_pin.log.io.tables import ColumnTable, Stream, make_table, quote_names
from gimbal_pin.rig.reading import read_bytes

CANDUMP_MAGIC = tuple(b"%s(%d" % (space, digit) for space in (b"", b" ") for digit in range(10))
_CAN_FRAME = re.compile(
    rb"(?m)^[ \t]*\((\d{1,12}\.\d{1,9})\)[ \t]+(\w+)[ \t]+([0-9A-F]{8}|[0-9A-F]{3})"
    rb"(?:##[0-9A-F]|#|[ \t]+\[\d\d?\][ \t]+)((?:[0-9A-F]{2} ?){3,64})[ \t]*(?:[RT][ \t]*)?\r?$"
)
"""Time, interface, identifier, and data; a request (RTR) has none."""
_ODRIVE_SIGNALS: Mapping[int, tuple[str, ...]] = {
    0x09: ("Pos_Estimate_turns", "Vel_Estimate_turns"),
    0x14: ("Iq_Setpoint", "Iq_Measured"),
    0x1C: ("Torque_Target", "Torque_Estimate"),
    0x0C: ("Setpoint_Pos_turns",),
}
"""Command → the floats that an ODrive's data begin with. The last is sent to the drive: its Input_Pos."""
_MOTEUS_REGISTERS: Mapping[int, tuple[str, tuple[float, ...]]] = {
    1: ("Position_turns", (1e-2, 1e-4, 1e-5, 1.0)),
    2: ("Velocity_turns", (1e-1, 2.5e-4, 1e-5, 1.0)),
    3: ("Torque", (0.5, 1e-2, 1e-3, 1.0)),
    4: ("Iq_Measured", (1.0, 1e-1, 1e-3, 1.0)),
}
"""Register of a moteus → its name, and one unit of an int8, int16, int32 or float."""
_REPLY, _NOP, _NUMBER_FORMS = 0x20, 0x50, "bhif"


def open_candump(path: Path) -> ColumnTable:
    """Read a capture: one stream per drive and kind of frame, all by the bus's clock; `LogError` if there is none."""
    found: dict[tuple[tuple[str, ...], str, int], list[tuple[float, ...]]] = {}
    others = set[str]()
    lines = 0
    for time, bus, identifier, data in (
        frame.groups() for frame in _CAN_FRAME.finditer(read_bytes(path, LogError))
    ):
        content = bytes.fromhex(data.decode())
        lines = lines + 1
        at = int(identifier, 16)
        node = at >> 5
        signals = _decode_odrive(at & 31, content) if len(identifier) == 3 else {}
        if not signals and at < 0x8000:  # beyond, a host asks for a reply
            node = at >> 8
            signals = _decode_moteus(content)
        if signals:
            found.setdefault((tuple(signals), bus.decode(), node), []).append(
                (float(time), *signals.values())
            )
        else:
            others.add(identifier.decode())
    if not found:
        what = f"holds no estimates of an ODrive or a moteus in its {lines} frames"
        raise LogError(
            str(path),
            what,
            "decode it by the device's DBC (python -m cantools decode), and write CSV",
        )
    many = len({bus for _, bus, _ in found}) > 1
    streams = []
    notes = []
    order = [names[0] for names in _ODRIVE_SIGNALS.values()]
    for names, bus, node in sorted(
        found, key=lambda key: (order.index(key[0][0]) if key[0][0] in order else 0, key)
    ):
        table = np.array(found[names, bus, node])
        fine = np.all(
            np.isfinite(table), axis=1
        )  # a drive that has not found its encoder's zero says nan
        columns = [f"{bus}.node{node}.{name}" if many else f"node{node}.{name}" for name in names]
        if not fine.all():
            notes.append(
                f"{np.sum(~fine)} of {len(table)} frames of {columns[0]} hold no numbers: left out"
            )
        if fine.any():
            streams.append(
                Stream(f"{columns[0]}.t", dict(zip((f"{columns[0]}.t", *columns), table[fine].T)))
            )
    if others:
        notes.append(
            f"frames of the identifiers {quote_names(sorted(others))} are none that are read: left out"
        )
    return make_table(str(path), streams, notes)


def _decode_odrive(command: int, data: bytes) -> dict[str, float]:
    """Return signal → value of an ODrive's frame; empty for another's."""
    names = _ODRIVE_SIGNALS.get(command, ())
    return (
        dict(zip(names, struct.unpack_from(f"<{len(names)}f", data)))
        if len(data) >= 4 * len(names)
        else {}
    )


def _decode_moteus(data: bytes) -> dict[str, float]:
    """Return signal → value of a moteus's reply, nan where it knows none; empty for another frame."""
    out = dict[str, float]()
    at = 0
    while at + 1 < len(data):
        kind = data[at]
        at = at + 1
        if kind == _NOP:
            continue
        if kind & 0xF0 != _REPLY:
            return {}
        count = kind & 3
        resolution = kind >> 2 & 3
        if not count:
            count = data[at]
            at = at + 1
        values = struct.Struct(f"<{count}{_NUMBER_FORMS[resolution]}")
        if at + 1 + values.size > len(data):
            return {}
        for register, value in enumerate(values.unpack_from(data, at + 1), start=data[at]):
            if register in _MOTEUS_REGISTERS:
                name, units = _MOTEUS_REGISTERS[register]
                lost = resolution < 3 and value == -(1 << 8 * (1 << resolution) - 1)
                out[name] = nan if lost else value * units[resolution]
        at += 1 + values.size
    return out
