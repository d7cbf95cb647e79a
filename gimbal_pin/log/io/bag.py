"""ROS 1 and 2 bags (.bag, .db3, .mcap, or a bag's folder), by their own message definitions; needs rosbags.

Of a JointState come the columns q_<joint>, dq_<joint> and tau_<joint>, of an Imu those of the link that its header's
frame names, of any other message every number as ``/topic.field``.
"""

from __future__ import annotations

from array import array
from collections import Counter
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, TypeAlias

import numpy as np

from gimbal_pin.log.io.isolated import open_isolated
from gimbal_pin.log.io.tables import DEEPEST, WIDEST, Stream, Table, listed

SUFFIXES = {b"#ROSBAG V2.0": ".bag", b"SQLite format 3\0": ".db3", b"\x89MCAP0\r\n": ".mcap"}
"""How a bag's file begins → the suffix that rosbags knows it by."""
JOINT_STATE = {"position": "q", "velocity": "dq", "effort": "tau"}
IMU = {"angular_velocity": "gyro", "linear_acceleration": "accel", "orientation": "quat"}
BIGGEST = 2**16
"""Largest message that is read, bytes: pictures and clouds of points are larger, a drive's are not."""
EXACT = 2**53
"""Nanoseconds that a double holds exactly, 104 days: later stamps count from the whole second of the bag's first."""
Columns: TypeAlias = "dict[str, array[float]]"


def open_bag(path: Path) -> Table:
    """Read a bag; the time of each message is its header's stamp, or when it was recorded where it has none."""
    return open_isolated(path, "bag", "a ROS bag", "rosbags", "ros", streamed=True)


def streams(path: Path) -> tuple[list[Stream], list[str]]:
    """Return one stream per topic and set of fields, in order of time; rosbags' own errors where it is damaged."""
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    found: dict[tuple[str, tuple[str, ...]], tuple[list[int], Columns]] = {}
    with TemporaryDirectory() as folder:
        if path.is_file():
            with path.open("rb") as file:
                head = file.read(16)
            suffix = next((suffix for magic, suffix in SUFFIXES.items() if head.startswith(magic)), path.suffix)
            path = Path(folder, f"bag{suffix}")
            path.symlink_to(file.name)
        with AnyReader([path], default_typestore=get_typestore(Stores.LATEST)) as bag:
            known = [connection for connection in bag.connections if connection.msgtype in bag.typestore.fielddefs]
            lost = sorted({connection.topic for connection in bag.connections if connection not in known})
            for connection, recorded, content in bag.messages(known) if known else ():
                if len(content) > BIGGEST:
                    continue
                message = bag.deserialize(content, connection.msgtype)
                values = dict(named(message, connection.msgtype, connection.topic))
                stamps, columns = found.setdefault((connection.topic, tuple(values)), ([], {}))
                stamps.append(stamp(message) or recorded)
                for name, value in values.items():
                    columns.setdefault(name, array("d")).append(value)
    kept, notes = timed({key: one for key, one in found.items() if one[1]})
    return kept, [*notes, *([f"no definition of the types of {listed(lost)}: left out"] if lost else [])]


def timed(found: dict[tuple[str, tuple[str, ...]], tuple[list[int], Columns]]) -> tuple[list[Stream], list[str]]:
    """Return streams with their times, s, joints first; a name that several topics have gets its topic in front."""
    first = min((min(stamps) for stamps, _ in found.values()), default=0)
    last = max((max(stamps) for stamps, _ in found.values()), default=0)
    start = 0 if last < EXACT else first - first % 10**9
    counts = Counter(name for _, columns in found.values() for name in columns)
    many = Counter(topic for topic, _ in found)
    done = []
    order = sorted(found.items(), key=lambda item: not any(name.startswith("q_") for name in item[1][1]))
    for k, ((topic, _), (stamps, columns)) in enumerate(order):
        label = topic if many[topic] == 1 else f"{topic}#{k}"
        time = "t" if len(found) == 1 else f"{label}.t"
        rows = np.argsort(stamps, kind="stable")
        data = {time: (np.array(stamps)[rows] - start) / 1e9}
        for name, values in columns.items():
            own = name if name.startswith(topic) else f"{label}.{name}"
            data[name if counts[name] == 1 else own.replace(topic, label, 1)] = np.array(values)[rows]
        done.append(Stream(time, data))
    return done, [f"its times count from {start // 10**9} s since 1970"] if start else []


def named(message: Any, kind: str, topic: str) -> Iterator[tuple[str, float]]:
    """Yield name and value of every number in a message."""
    if kind == "sensor_msgs/msg/JointState":
        for field, prefix in JOINT_STATE.items():
            yield from ((f"{prefix}_{joint}", float(x)) for joint, x in zip(message.name, getattr(message, field)))
    elif kind == "sensor_msgs/msg/Imu" and message.header.frame_id:
        for field, prefix in IMU.items():
            if getattr(message, f"{field}_covariance")[0] != -1:  # by its definition: no estimate of this one
                of = getattr(message, field)
                axes = "wxyz" if prefix == "quat" else "xyz"
                yield from ((f"{prefix}_{message.header.frame_id}_{axis}", getattr(of, axis)) for axis in axes)
    else:
        yield from flat(message, topic)


def flat(value: Any, name: str, depth: int = 0) -> Iterator[tuple[str, float]]:
    """Yield ``name.field`` and ``name[k]`` of the numbers in a message."""
    if isinstance(value, (bool, int, float, np.number)):
        yield name, float(value)
    elif is_dataclass(value) and depth < DEEPEST:
        for field in fields(value):
            if not field.name.startswith("__"):
                yield from flat(getattr(value, field.name), f"{name}.{field.name}", depth + 1)
    elif isinstance(value, (list, np.ndarray)) and len(value) <= WIDEST:
        for k, inner in enumerate(value):
            yield from flat(inner, f"{name}[{k}]", depth + 1)


def stamp(message: Any) -> int:
    """Return the stamp of a message's header, ns, or 0."""
    at = getattr(getattr(message, "header", None), "stamp", None)
    return 0 if at is None else int(at.sec) * 10**9 + int(at.nanosec)
