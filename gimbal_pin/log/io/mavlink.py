"""Telemetry logs of MAVLink: attitude of gimbals and vehicles, IMUs."""

from __future__ import annotations

import re
import struct
from array import array
from collections import Counter
from math import pi
from pathlib import Path
from typing import Any

import numpy as np

from gimbal_pin.errors import LogError
from gimbal_pin.log.io.tables import WIDEST_ARRAY, Stream
from gimbal_pin.rig.reading import read_bytes


def read_tlog(path: Path) -> tuple[list[Stream], list[str]]:
    """Return a stream per message, ``MESSAGE.field`` in SI units and radians, of what states the time since the start.

    A packet of MAVLink 1 or 2 follows its receiver's stamp of 8 bytes; what is damaged is passed over. Of several
    senders, or devices of one, the second's are ``MESSAGE#2``. Angles, rates and quaternions keep MAVLink's axes: x
    forward, y right, z down.
    """
    from pymavlink.dialects.v20.ardupilotmega import MAVError, MAVLink

    factors = {"deg": pi / 180, "cdeg": pi / 18000, "deg/s": pi / 180, "ms": 1e-3, "us": 1e-6}
    factors |= {
        "mrad/s": 1e-3,
        "mG": 9.80665e-3,
        "cm/s": 1e-2,
        "mm": 1e-3,
        "cm": 1e-2,
        "degE7": pi / 180e7,
    }
    content = read_bytes(path, LogError)
    link = MAVLink(None)
    at = 0
    damaged = False
    found: dict[tuple[Any, ...], dict[str, array[float]]] = {}
    for start in (match.start() for match in re.finditer(rb"[\xfd\xfe]", content)):
        if start < at or len(content) < start + 3:
            continue
        second = content[start] == 0xFD
        end = start + content[start + 1] + (12 + 13 * (content[start + 2] & 1) if second else 8)
        try:
            message = link.decode(bytearray(content[start:end]))
            fields = message.to_dict()
        except (MAVError, struct.error, ValueError, LookupError, AttributeError):
            continue
        if message.get_type().startswith("UNKNOWN"):  # its check sum is not known either
            continue
        damaged = damaged or start != at + 8
        at = end
        clock = next((key for key in ("time_boot_ms", "time_usec") if key in fields), None)
        if (
            clock is None
            or (seconds := fields[clock] * (1e-3 if clock == "time_boot_ms" else 1e-6)) > 1e9
        ):
            continue  # by the calendar: no clock that the others have
        device = fields[message.instance_field] if message.instance_field else None
        key = (message.get_type(), message.get_srcSystem(), message.get_srcComponent(), device)
        row = found.setdefault(key, {})
        row.setdefault("t", array("d")).append(seconds)
        for field, value in fields.items():
            factor = factors.get(message.fieldunits_by_name.get(field, ""), 1.0)
            values = value if isinstance(value, list) else [value]
            for k, number in enumerate(values if len(values) <= WIDEST_ARRAY else ()):
                if isinstance(number, (int, float)) and field != clock:
                    name = f"{field}[{k}]" if isinstance(value, list) else field
                    row.setdefault(name, array("d")).append(factor * number)
    streams = list[Stream]()
    seen = Counter[str]()
    for (kind, *_), columns in sorted(found.items(), key=lambda item: -len(item[1]["t"])):
        seen[kind] += 1
        label = kind if seen[kind] == 1 else f"{kind}#{seen[kind]}"
        _, rows = np.unique(np.array(columns["t"]), return_index=True)
        streams.append(
            Stream(
                f"{label}.t", {f"{label}.{name}": np.array(x)[rows] for name, x in columns.items()}
            )
        )
    return streams, ["is damaged: what could be read of it is used"] if damaged or at < len(
        content
    ) else []
