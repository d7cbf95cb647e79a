"""A log's columns written by each ecosystem's own writer."""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

Columns = Mapping[str, np.ndarray]
ULOG_START = b"ULog\x01\x12\x35\x01" + bytes(8)


def as_npy(columns: Columns, path: Path) -> None:
    """Write a plain array, a column each."""
    with path.open("wb") as file:
        np.save(file, np.column_stack(list(columns.values())))


def as_records(columns: Columns, path: Path) -> None:
    """Write a record array."""
    np.save(path, np.rec.fromarrays(list(columns.values()), names=list(columns)))


def as_mat(columns: Columns, path: Path) -> None:
    """Write a MATLAB file of version 7."""
    import scipy.io

    scipy.io.savemat(path, dict(columns), do_compression=True)


def as_hdf5(columns: Columns, path: Path) -> None:
    """Write HDF5 as MATLAB 7.3 does: transposed, packed, behind a header of 512 bytes."""
    import h5py

    with h5py.File(path, "w", userblock_size=512) as file:
        group = file.create_group("log")
        for name, values in columns.items():
            group.create_dataset(name, data=values[None, :], compression="gzip")
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\0\2IM")


def as_bag(kind: str) -> Callable[[Columns, Path], None]:
    """Write what a log's columns say as JointState and Imu messages, as ROS 1, or ROS 2 with one of its storages.

    The columns hold angles, rates and torques of all joints, and at most one link's IMU, whole.
    """

    def write(columns: Columns, path: Path) -> None:
        from rosbags.rosbag1 import Writer as Writer1
        from rosbags.rosbag2 import StoragePlugin
        from rosbags.rosbag2 import Writer as Writer2
        from rosbags.typesys import Stores, get_typestore

        joints = [name.removeprefix("tau_") for name in columns if name.startswith("tau_")]
        links = [name[5:-2] for name in columns if name.startswith("gyro_") and name.endswith("_x")]
        store = get_typestore(Stores.ROS1_NOETIC if kind == "ros1" else Stores.ROS2_HUMBLE)
        types = store.types
        vector = types["geometry_msgs/msg/Vector3"]
        quaternion = types["geometry_msgs/msg/Quaternion"]
        states = types["sensor_msgs/msg/JointState"]
        imu = types["sensor_msgs/msg/Imu"]

        def header(at: int, frame: str) -> object:
            stamp = types["builtin_interfaces/msg/Time"](*divmod(at, 10**9))
            sequence = {"seq": 0} if kind == "ros1" else {}
            return types["std_msgs/msg/Header"](**sequence, stamp=stamp, frame_id=frame)

        def values(prefix: str, ends: str, k: int) -> list[float]:
            return [columns[f"{prefix}_{end}"][k] for end in ends]

        with (
            Writer1(path)
            if kind == "ros1"
            else Writer2(path, version=9, storage_plugin=StoragePlugin[kind.upper()]) as bag
        ):
            topics = [("/joint_states", states), *(("/imu", imu) for _ in links)]
            connections = [
                bag.add_connection(topic, of.__msgtype__, typestore=store) for topic, of in topics
            ]
            for k, t in enumerate(columns["t"]):
                at = round(t * 1e9)
                arrays = (
                    np.array([columns[f"{of}_{j}"][k] for j in joints]) for of in ("q", "dq", "tau")
                )
                messages = [states(header(at, ""), joints, *arrays)]
                messages += [
                    imu(header(at, link), quaternion(*values(f"quat_{link}", "xyzw", k)), np.zeros(9),
                        vector(*values(f"gyro_{link}", "xyz", k)), np.zeros(9),
                        vector(*values(f"accel_{link}", "xyz", k)), np.zeros(9))
                    for link in links
                ]  # fmt: skip
                for connection, message in zip(connections, messages):
                    name = type(message).__msgtype__
                    content = (store.serialize_ros1 if kind == "ros1" else store.serialize_cdr)(
                        message, name
                    )
                    bag.write(connection, at, content)

    return write


def as_ulog(columns: Columns, path: Path) -> None:
    """Write a ULog as its published layout has it: magic, version, start; flag bits, format, subscription, data."""

    def message(kind: bytes, content: bytes) -> bytes:
        return struct.pack("<HB", len(content), kind[0]) + content

    names = [name for name in columns if name != "t"]
    layout = "uint64_t timestamp;" + "".join(f"double {name};" for name in names)
    parts = [
        ULOG_START,
        message(b"B", bytes(40)),
        message(b"F", f"rig:{layout}".encode()),
        message(b"A", struct.pack("<BH", 0, 7) + b"rig"),
    ]
    for k, t in enumerate(columns["t"]):
        values = [columns[name][k] for name in names]
        parts.append(message(b"D", struct.pack(f"<HQ{len(values)}d", 7, round(t * 1e6), *values)))
    path.write_bytes(b"".join(parts))


def as_tlog(columns: Columns, path: Path) -> None:
    """Write the IMU of the base as a ground station records a vehicle's: HIGHRES_IMU messages behind their times."""
    from pymavlink.dialects.v20 import ardupilotmega as mavlink

    link = mavlink.MAVLink(None, 1, 1)
    packets = list[bytes]()
    for k, t in enumerate(columns["t"]):
        imu = [float(columns[f"{of}_base_{axis}"][k]) for of in ("accel", "gyro") for axis in "xyz"]
        message = mavlink.MAVLink_highres_imu_message(
            round(1e6 * t), *imu, *([0.0] * 3), 1000.0, 0.0, 0.0, 25.0, 63
        )
        packets.append(struct.pack(">Q", round(1.7e15 + 1e6 * t)) + message.pack(link))
    path.write_bytes(b"".join(packets))


def as_candump(columns: Columns, path: Path) -> None:
    """Write what ``candump -l`` hears of one ODrive per joint, in turns and A."""
    joints = [name.removeprefix("tau_") for name in columns if name.startswith("tau_")]
    lines = []
    for k, t in enumerate(columns["t"]):
        for node, joint in enumerate(joints):
            turns = [columns[f"{of}_{joint}"][k] / (2 * np.pi) for of in ("q", "dq")]
            for command, pair in ((9, turns), (0x14, [0.0, columns[f"tau_{joint}"][k]])):
                lines.append(
                    f"({t:.6f}) can0 {node << 5 | command:03X}#{struct.pack('<ff', *pair).hex().upper()}\n"
                )
    path.write_text("".join(lines), "utf-8")
