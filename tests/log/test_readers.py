"""Every ecosystem's own writer of one motion gives the same log, whatever the format.

Laws: what `write_log` and `write_motion` write is read back bit by bit; so is what the writers of
other formats write; a bag, a table that ROS printed and JSON are read by the joints' names in each
message; a recorder's own types, LeRobot's episodes and MAVLink's messages become columns.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow
import pytest
from pyarrow import parquet
from rosbags.rosbag2 import Writer as BagWriter
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from gimbal_pin.errors import DataError
from gimbal_pin.log import (
    PLAUSIBLE_RANGES,
    Imu,
    Log,
    Motion,
    io,
    log_columns,
    read_log,
    read_motion,
    write_log,
    write_motion,
)
from tests.log.planted import FEW, TURRET, T, agree, held, planted, same, swing, write_csv
from tests.log.writers import (
    Columns,
    as_bag,
    as_hdf5,
    as_mat,
    as_npy,
    as_records,
    as_tlog,
    as_ulog,
    write_bag,
)


def as_text(columns: Columns, path: Path) -> None:
    """Write what `numpy.savetxt` does, the header behind a mark of comments."""
    values = np.column_stack(list(columns.values()))
    np.savetxt(path, values, header=" ".join(columns), fmt="%25.17g")


def as_mcap_file(columns: Columns, path: Path) -> None:
    """Write a bag's one file, under a name that does not say so."""
    as_bag("mcap")(columns, path.parent / "bag")
    next((path.parent / "bag").glob("*.mcap")).rename(path)


WRITERS: Mapping[str, tuple[str, Callable[[Columns, Path], object]]] = {
    "csv": ("log.csv", write_csv),
    "savetxt": ("log.txt", as_text),
    "csv.gz": ("log.csv.gz", write_csv),
    "parquet": ("log", lambda c, path: parquet.write_table(pyarrow.table(dict(c)), path)),
    "npy": ("log.npy", as_npy),
    "record array": ("log.npy", as_records),
    "npz": ("log.npz", lambda c, path: np.savez_compressed(path, **c)),
    "mat": ("log.mat", as_mat),
    "mat 7.3": ("log.mat", as_hdf5),
    "ros1": ("log.bag", as_bag("ros1")),
    "ros2 sqlite3": ("log", as_bag("sqlite3")),
    "ros2 mcap": ("some.log", as_mcap_file),
    "ulog": ("log.ulg", as_ulog),
}
LONGER = {"mat 7.3": "log.", "ulog": "rig."}
"""Writer → what stands before each column's name."""


@pytest.mark.parametrize("writer", WRITERS)
def test_every_writer_gives_the_same_log(writer: str, tmp_path: Path) -> None:
    log = planted(FEW, has_imu=True)
    columns = log_columns(log)
    name, write = WRITERS[writer]
    write(columns, tmp_path / name)
    mapping = {column: LONGER[writer] + column for column in columns if writer in LONGER}
    if writer == "npy":
        mapping = {column: f"c{k}" for k, column in enumerate(columns)}
    if writer == "ulog":
        mapping["t"] = "rig.timestamp"
    same(read_log(tmp_path / name, TURRET, mapping), log)


# --- The package's own writers ------------------------------------------------------------------


def drawn(channel: str, rng: np.random.Generator, width: int = 2) -> np.ndarray:
    """Return numbers of every size that a channel can have, and zeros of both signs."""
    lower, upper, _ = PLAUSIBLE_RANGES[channel]
    values = rng.choice([lower, upper], (40, width)) * 10.0 ** rng.uniform(-40, 0, (40, width))
    values[:2] = [[0.0], [-0.0]]
    return values


@pytest.mark.parametrize("suffix", ["csv", "tsv", "parquet"])
@pytest.mark.parametrize("names", [(), ("v", "q_ref"), ("v", "tau", "q_ref", "temperature")])
def test_what_is_written_reads_back_exactly(
    suffix: str, names: tuple[str, ...], tmp_path: Path
) -> None:
    rng = np.random.default_rng(len(names))
    t = np.sort(rng.uniform(-5e5, 5e5, 40))
    channels: dict[str, Any] = {name: drawn(name, rng) for name in names}
    imu = Imu(drawn("gyro", rng, 3), quat=drawn("quat", rng, 4) if names else None)
    log = Log("drawn", TURRET.joints, t, drawn("q", rng), imus={"head_mount": imu}, **channels)
    path = tmp_path / f"log.{suffix}"
    write_log(log, path)
    same(read_log(path, TURRET, need_tau=False), log)
    motion = Motion(t, *(drawn(name, rng) for name in "qva"))
    write_motion(motion, TURRET.joints, path)
    back = read_motion(path, TURRET)
    for name in "tqva":
        assert getattr(back, name).tobytes() == getattr(motion, name).tobytes()
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("prefixes", [("dq_",), ("ddq_",), ("dq_", "ddq_")])
def test_rates_that_a_motion_lacks_are_its_derivatives(
    prefixes: tuple[str, ...], tmp_path: Path
) -> None:
    t = np.linspace(0, 2, 21) ** 1.2
    columns = {"t": t, "q_pan": t**3, "dq_pan": 3 * t**2, "ddq_pan": 6 * t}
    columns |= {name.replace("pan", "tilt"): x for name, x in columns.items() if name != "t"}
    motion = read_motion(write_csv(without(columns, *prefixes), tmp_path / "m.csv"), TURRET)
    np.testing.assert_allclose(motion.v[:, 0], 3 * t**2, atol=1e-10)
    np.testing.assert_allclose(motion.a[:, 1], 6 * t, atol=1e-8)


def without(columns: Columns, *prefixes: str) -> dict[str, np.ndarray]:
    return {name: x for name, x in columns.items() if not name.startswith(prefixes)}


# --- ROS ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("lacking", [("dq_", "tau_"), ()])
def test_measured_joint_states_come_before_commanded_ones(
    lacking: tuple[str, ...], tmp_path: Path
) -> None:
    """Commands of another rate are joined at the joints' times, and not shifted."""
    log = planted(FEW)
    u = np.arange(0, 300_000, 3700) / 1e6
    asked = without({**log_columns(planted(u + 0.1)), "t": u}, *lacking)
    topics = {"/a/target_joints": asked, "/joint_states": log_columns(log)}
    write_bag(tmp_path / "bag", "sqlite3", topics)
    mapping = {f"q_ref_{joint}": f"/a/target_joints.q_{joint}" for joint in TURRET.joints}
    read = read_log(tmp_path / "bag", TURRET, mapping)
    agree(read, log)
    np.testing.assert_allclose(held(read.q_ref), swing(FEW + 0.1)[0], atol=1e-4)


@pytest.mark.parametrize("absent", [(), ("tau_",)])
def test_joint_states_whose_efforts_are_nan_or_absent_hold_no_torque(
    absent: tuple[str, ...], tmp_path: Path
) -> None:
    log = planted(FEW)
    columns = {n: x * np.nan if n[:4] == "tau_" else x for n, x in log_columns(log).items()}
    write_bag(tmp_path / "bag", "sqlite3", {"/joint_states": without(columns, *absent)})
    with pytest.raises(DataError, match="no torque"):
        read_log(tmp_path / "bag", TURRET)
    np.testing.assert_array_equal(read_log(tmp_path / "bag", TURRET, need_tau=False).q, log.q)


def test_a_type_of_ones_own_is_read_by_the_bags_definition(tmp_path: Path) -> None:
    """Its times are those of recording, counted from a whole second."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    definition = "float64[2] angle\nfloat64[2] current\nbool on\nstring name"
    store.register(get_types_from_msg(definition, "drive_msgs/msg/Drive"))
    drive = store.types["drive_msgs/msg/Drive"]
    log = planted(FEW)
    with BagWriter(tmp_path / "bag", version=9) as bag:
        topic = bag.add_connection("/drive", drive.__msgtype__, typestore=store)
        for t, q, tau in zip(FEW, log.q, held(log.tau)):
            content = store.serialize_cdr(drive(q, tau, True, "pan"), drive.__msgtype__)
            bag.write(topic, 1_790_000_000_123_456_789 + round(t * 1e9), content)
    mapping = {"q_pan": "/drive.angle[0]", "q_tilt": "/drive.angle[1]"}
    mapping |= {"tau_pan": "/drive.current[0]", "tau_tilt": "/drive.current[1]"}
    read = read_log(tmp_path / "bag", TURRET, mapping)
    same(replace(read, t=FEW), replace(log, v=None))
    assert read.t[0] == pytest.approx(0.123456789, abs=1e-9)
    assert "1790000000 s since 1970" in read.events[0]


# --- LeRobot ------------------------------------------------------------------------------------

VECTORS = {"observation.state": "q", "observation.velocity": "v", "observation.effort": "tau"}
EPISODES = (25, 20, 15)


def write_lerobot(folder: Path, log: Log, names: object) -> None:
    """Write a data set of version 3.0 in two files, whose vectors are lists of either kind."""
    (folder / "meta").mkdir(parents=True)
    (folder / "data/chunk-000").mkdir(parents=True)
    frame = np.concatenate([np.arange(count) for count in EPISODES])
    columns = {
        "timestamp": (frame / 50).astype(np.float32),
        "frame_index": frame,
        "episode_index": np.repeat(np.arange(len(EPISODES)), EPISODES),
        "index": np.arange(len(log)),
    }
    features = {key: {"dtype": x.dtype.name, "shape": [1]} for key, x in columns.items()}
    features |= {key: {"dtype": "float32", "shape": [2], "names": names} for key in VECTORS}
    info = {"fps": 50, "features": features, "total_frames": len(log)}
    (folder / "meta/info.json").write_text(json.dumps(info))
    for k, rows in enumerate((slice(25), slice(25, None))):
        table = {key: pyarrow.array(x[rows]) for key, x in columns.items()}
        kind = pyarrow.list_(pyarrow.float32(), 2 if k == 0 else -1)
        for key, of in VECTORS.items():
            table[key] = pyarrow.array(list(getattr(log, of)[rows]), kind)
        parquet.write_table(pyarrow.table(table), folder / f"data/chunk-000/file-{k}.parquet")


@pytest.mark.parametrize(
    ("names", "ends"),
    [
        (["pan.pos", "tilt.pos"], (".pan.pos", ".tilt.pos")),
        ({"motors": ["pan", "tilt"]}, (".pan", ".tilt")),
        (None, ("[0]", "[1]")),
    ],
)
def test_a_lerobot_data_set_is_one_log_with_pauses(
    names: object, ends: tuple[str, str], tmp_path: Path
) -> None:
    """Frames come at multiples of 1/fps to the last bit, though their stamps are rounded."""
    log = planted(FEW)
    write_lerobot(tmp_path / "set", log, names)
    mapping = {
        f"{prefix}_{joint}": key + end
        for prefix, key in zip(("q", "dq", "tau"), VECTORS)
        for joint, end in zip(TURRET.joints, ends)
    }
    read = read_log(tmp_path / "set", TURRET, mapping)
    for of in VECTORS.values():
        np.testing.assert_array_equal(getattr(read, of), getattr(log, of).astype(np.float32))
    steps = np.diff(read.t)
    np.testing.assert_allclose(np.delete(steps, [24, 44]), 1 / 50, atol=1e-12)
    assert (steps[[24, 44]] > 10.0).all()
    (tmp_path / "set/data/chunk-000/file-1.parquet").unlink()
    rest = read_log(tmp_path / "set", TURRET, mapping)
    np.testing.assert_array_equal(rest.q, read.q[:25])
    assert "25 of 60 frames" in " ".join(rest.events)


# --- MAVLink ------------------------------------------------------------------------------------


def test_a_telemetry_log_of_mavlink_carries_the_platform(tmp_path: Path) -> None:
    """The messages of a damaged file that are whole: the gimbal's angles in radians, the IMU in single precision."""
    columns = log_columns(planted(FEW, has_imu=True))
    path = tmp_path / "flight.tlog"
    as_tlog(columns, path)
    content = bytearray(path.read_bytes())
    content[content.index(b"\xfd", len(content) // 2) + 12] ^= 0x55
    path.write_bytes(content[:500] + b"\xfd\xfe\xfd" + content[500:-5])
    names = ("HIGHRES_IMU.t", "HIGHRES_IMU.zgyro", "MOUNT_ORIENTATION.pitch")
    t, gyro, pitch = io.open_table(path).read(names).values()
    t, gyro, pitch = (x[~np.isnan(x)] for x in (t, gyro, pitch))
    kept = np.isin(np.round(1e3 * FEW), np.round(1e3 * t))
    assert 57 <= len(t) == kept.sum() < 60
    np.testing.assert_allclose(gyro, columns["gyro_base_z"][kept], rtol=1e-6)
    np.testing.assert_allclose(pitch, -np.pi / 2, rtol=1e-6)


# --- Several files and several rates are one log ------------------------------------------------


@pytest.mark.parametrize("has_one_clock", [True, False])
def test_files_are_joined_at_the_times_of_the_first(has_one_clock: bool, tmp_path: Path) -> None:
    """Exactly where they have one clock; where not, the rate bends by less than max|d²v/dt²| h²/8 = 0.2e-3 rad/s."""
    log = planted()
    u = T[np.r_[0:80, 120:600]] if has_one_clock else np.arange(0.5, 2, 1 / 730)
    rates = swing(u)[1]
    write_csv(without(log_columns(log), "dq_"), tmp_path / "a.csv")
    write_csv({"t_ms": 1e3 * u, "dq_pan": rates[:, 0], "dq_tilt": rates[:, 1]}, tmp_path / "b.csv")
    read = read_log(f"{tmp_path / 'a.csv'}+{tmp_path / 'b.csv'}", TURRET)
    kept = np.isin(T, u) if has_one_clock else (u[0] <= T) & (u[-1] >= T)
    np.testing.assert_allclose(read.t, T[kept], atol=1e-12)
    np.testing.assert_array_equal(read.q, log.q[kept])
    within = 1e-12 if has_one_clock else 1e-3
    np.testing.assert_allclose(held(read.v), swing(read.t)[1], atol=within)
    assert any("samples are left out" in event for event in read.events)
