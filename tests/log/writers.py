"""A log's columns written by each ecosystem's own writer."""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

Columns = Mapping[str, np.ndarray]
ULOG_START = b"ULog\x01\x12\x35\x01" + bytes(8)


def joints_of(columns: Columns) -> list[str]:
    """Return the joints that have an angle."""
    return [name[2:] for name in columns if name.startswith("q_") and name[:6] != "q_ref_"]


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


def write_bag(path: Path, storage: str, topics: Mapping[str, Columns]) -> None:
    """Write topics of JointState, whose joints change their order, or of an Imu at the base.

    A topic is an IMU's where it has no angles; `storage` is "ros1", "sqlite3" or "mcap".
    """
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import StoragePlugin
    from rosbags.rosbag2 import Writer as Writer2
    from rosbags.typesys import Stores, get_typestore

    is_ros1 = storage == "ros1"
    store = get_typestore(Stores.ROS1_NOETIC if is_ros1 else Stores.ROS2_HUMBLE)
    types = store.types
    serialize = store.serialize_ros1 if is_ros1 else store.serialize_cdr

    def message(columns: Columns, k: int, at: int) -> object:
        stamp = types["builtin_interfaces/msg/Time"](*divmod(at, 10**9))
        sequence = {"seq": 0} if is_ros1 else {}
        header = types["std_msgs/msg/Header"](**sequence, stamp=stamp, frame_id="base")
        joints = joints_of(columns)[:: -1 if k % 3 else 1]
        if joints:
            names = [[f"{of}_{joint}" for joint in joints] for of in ("q", "dq", "tau")]
            groups = [np.array([columns[x][k] for x in group if x in columns]) for group in names]
            return types["sensor_msgs/msg/JointState"](header, joints, *groups)
        turned, gyro, accel = (
            types[f"geometry_msgs/msg/{kind}"](*(columns[f"{of}_base_{axis}"][k] for axis in axes))
            for kind, of, axes in (
                ("Quaternion", "quat", "xyzw"),
                ("Vector3", "gyro", "xyz"),
                ("Vector3", "accel", "xyz"),
            )
        )
        none = np.zeros(9)
        return types["sensor_msgs/msg/Imu"](header, turned, none, gyro, none, accel, none)

    plugin = {} if is_ros1 else {"version": 9, "storage_plugin": StoragePlugin[storage.upper()]}
    with (Writer1 if is_ros1 else Writer2)(path, **plugin) as bag:
        for topic, columns in topics.items():
            name = message(columns, 0, 0).__msgtype__  # type: ignore[attr-defined]
            connection = bag.add_connection(topic, name, typestore=store)
            for k, t in enumerate(columns["t"]):
                at = round(t * 1e9)
                bag.write(connection, at, serialize(message(columns, k, at), name))


def as_bag(storage: str) -> Callable[[Columns, Path], None]:
    """Return what writes joint states, and the base's IMU, as two topics of a bag."""

    def write(columns: Columns, path: Path) -> None:
        imu = {name: x for name, x in columns.items() if name == "t" or "_base_" in name}
        states = {name: x for name, x in columns.items() if name == "t" or name not in imu}
        write_bag(path, storage, {"/joint_states": states, "/imu": imu})

    return write


def as_ulog(columns: Columns, path: Path) -> None:
    """Write a ULog as its published layout has it: flag bits, format, subscription, data."""

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
    """Write what a ground station records: a vehicle's IMU, and its gimbal at half the rate."""
    from pymavlink.dialects.v20 import ardupilotmega as mavlink

    vehicle = mavlink.MAVLink(None, 1, 1)
    camera = mavlink.MAVLink(None, 1, 154)
    packets = list[bytes]()
    for k, t in enumerate(columns["t"]):
        stamp = struct.pack(">Q", 1_700_000_000_000_000 + round(1e6 * t))
        imu = [float(columns[f"{of}_base_{axis}"][k]) for of in ("accel", "gyro") for axis in "xyz"]
        state = [round(1e6 * t), *imu, 0.0, 0.0, 0.0, 1000.0, 0.0, 0.0, 25.0, 63]
        packets.append(stamp + mavlink.MAVLink_highres_imu_message(*state).pack(vehicle))
        if k % 2 == 0:
            state = [round(1e3 * t), 10.0, -90.0, float(k)]
            packets.append(stamp + mavlink.MAVLink_mount_orientation_message(*state).pack(camera))
    path.write_bytes(b"".join(packets))


def as_candump(columns: Columns, path: Path) -> None:
    """Write what ``candump -l`` hears of one ODrive per joint, in turns and A."""
    lines = []
    for k, t in enumerate(columns["t"]):
        for node, joint in enumerate(joints_of(columns)):
            turns = [columns[f"{of}_{joint}"][k] / (2 * np.pi) for of in ("q", "dq")]
            for command, pair in ((9, turns), (0x14, [0.0, columns[f"tau_{joint}"][k]])):
                data = struct.pack("<ff", *pair).hex().upper()
                lines.append(f"({t:.6f}) can0 {node << 5 | command:03X}#{data}\n")
    path.write_text("".join(lines), "utf-8")
