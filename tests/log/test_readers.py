"""Every ecosystem's own writer of one motion gives the same log, whatever the format.

Laws: what `write_log` and `write_motion` write is read back bit by bit; so is what the writers of
other formats write; a bag, a table that ROS printed and JSON are read by the joints' names in each
message; a recorder's own types, LeRobot's episodes and MAVLink's messages become columns.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas
import pyarrow
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
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
from tests.log.planted import FEW, TURRET, agree, held, planted, same, swing, write_csv
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


def plain_text(separator: str, header: bool = True) -> Callable[[Columns, Path], None]:
    return lambda columns, path: pandas.DataFrame(dict(columns)).to_csv(
        path, sep=separator, index=False, header=header
    )


def as_text(columns: Columns, path: Path) -> None:
    """Write what `numpy.savetxt` does, the header behind a mark of comments."""
    values = np.column_stack(list(columns.values()))
    np.savetxt(path, values, header=" ".join(columns), fmt="%25.17g")


def as_mcap_file(columns: Columns, path: Path) -> None:
    """Write a bag's one file, under a name that does not say so."""
    as_bag("mcap")(columns, path.parent / "bag")
    next((path.parent / "bag").glob("*.mcap")).rename(path)


WRITERS: Mapping[str, tuple[str, Callable[[Columns, Path], None]]] = {
    "csv": ("log.csv", plain_text(",")),
    "semicolons": ("log.txt", plain_text(";")),
    "tabs": ("log.tsv", plain_text("\t")),
    "spaces": ("log.txt", plain_text(" ")),
    "no header": ("log.csv", plain_text(",", header=False)),
    "savetxt": ("log.txt", as_text),
    "csv.gz": ("log.csv.gz", plain_text(",")),
    "parquet": ("log", lambda c, path: parquet.write_table(pyarrow.table(dict(c)), path)),
    "npy": ("log.npy", as_npy),
    "npy by columns": ("log.npy", lambda c, path: np.save(path, np.array(list(c.values())).T)),
    "record array": ("log.npy", as_records),
    "npz": ("log.npz", lambda c, path: np.savez_compressed(path, **c)),
    "mat": ("log.mat", as_mat),
    "mat 7.3": ("log.mat", as_hdf5),
    "ros1": ("log.bag", as_bag("ros1")),
    "ros2 sqlite3": ("log", as_bag("sqlite3")),
    "ros2 mcap": ("some.log", as_mcap_file),
    "ulog": ("log.ulg", as_ulog),
}


def list_maps(writer: str, columns: Columns) -> list[str]:
    """Return what a format without names, or with longer ones, is mapped by."""
    if writer in ("no header", "npy", "npy by columns"):
        first, name = (1, "column") if writer == "no header" else (0, "c")
        return [f"{column}={name}{k}" for k, column in enumerate(columns, start=first)]
    if writer == "ulog":
        return ["t=rig.timestamp", *(f"{name}=rig.{name}" for name in columns if name != "t")]
    return [f"{name}=log.{name}" for name in columns] if writer == "mat 7.3" else []


@pytest.mark.parametrize("writer", WRITERS)
def test_every_writer_gives_the_same_log(writer: str, tmp_path: Path) -> None:
    log = planted(FEW, has_imu=True)
    columns = log_columns(log)
    name, write = WRITERS[writer]
    write(columns, tmp_path / name)
    same(read_log(tmp_path / name, TURRET, list_maps(writer, columns)), log)


# --- The package's own writers ------------------------------------------------------------------

TIMES = st.lists(st.floats(-5e5, 5e5), min_size=1, max_size=5, unique_by=lambda t: round(t, 3))


def block(channel: str, rows: int, width: int = 2) -> st.SearchStrategy[np.ndarray]:
    """Return a strategy for any values that a channel can have."""
    lower, upper, _ = PLAUSIBLE_RANGES[channel]
    values = st.floats(lower, upper).filter(lambda x: x == 0.0 or abs(x) >= 1e-40)
    return hnp.arrays(np.float64, (rows, width), elements=values)


@st.composite
def logs(draw: st.DrawFn) -> Log:
    """Draw a log of the turret with any subset of channels and any numbers."""
    t = np.array(sorted(draw(TIMES)))
    widths = {"gyro": 3, "accel": 3, "quat": 4}
    kinds = draw(st.sets(st.sampled_from([*widths])))
    imu = {kind: draw(block(kind, len(t), widths[kind])) for kind in kinds}
    names = draw(st.sets(st.sampled_from(["v", "tau", "q_ref", "temperature"])))
    channels = {name: draw(block(name, len(t))) for name in names}
    imus = {"head_mount": Imu(**imu)} if imu else {}
    return Log("drawn", TURRET.joints, t, draw(block("q", len(t))), imus=imus, **channels)


@pytest.mark.parametrize("suffix", ["csv", "tsv", "parquet"])
@given(log=logs(), data=st.data())
def test_what_is_written_reads_back_exactly(
    suffix: str, log: Log, data: st.DataObject, tmp_path: Path
) -> None:
    path = tmp_path / f"log.{suffix}"
    write_log(log, path)
    same(read_log(path, TURRET, need_tau=False), log)
    motion = Motion(log.t, log.q, *(data.draw(block(name, len(log))) for name in ("v", "a")))
    write_motion(motion, TURRET.joints, path)
    back = read_motion(path, TURRET)
    for name in ("t", "q", "v", "a"):
        assert getattr(back, name).tobytes() == getattr(motion, name).tobytes()
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("prefixes", [("dq_",), ("ddq_",), ("dq_", "ddq_")])
def test_rates_that_a_motion_lacks_are_its_derivatives(
    prefixes: tuple[str, ...], tmp_path: Path
) -> None:
    t = np.linspace(0, 2, 21)[:, None] ** 1.2
    cubic = Motion(t[:, 0], t**3 - [1, 0] * t, 3 * t**2 - [1, 0], 6 * t - [0, 0])
    path = tmp_path / "m.csv"
    write_motion(cubic, TURRET.joints, path)
    motion = read_motion(write_csv(without({**pandas.read_csv(path)}, *prefixes), path), TURRET)
    np.testing.assert_allclose(motion.v, cubic.v, atol=1e-10)
    np.testing.assert_allclose(motion.a, cubic.a, atol=1e-8)


def without(columns: Columns, *prefixes: str) -> Columns:
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


@pytest.mark.parametrize("efforts", ["nan", "empty", "empty, printed"])
def test_joint_states_without_efforts_hold_no_torque(efforts: str, tmp_path: Path) -> None:
    log = planted(FEW)
    columns = without(log_columns(log), "tau_")
    path = tmp_path / "bag"
    if efforts == "nan":
        columns |= {f"tau_{joint}": np.full(len(FEW), np.nan) for joint in TURRET.joints}
    if efforts == "empty, printed":
        path = tmp_path / "echo.csv"
        rows = zip(FEW, log.q, held(log.v))
        lines = [f"0,{1e9 * t:.0f},,pan,tilt,{q[0]},{q[1]},{v[0]},{v[1]}\n" for t, q, v in rows]
        path.write_text("".join(lines))
    else:
        write_bag(path, "sqlite3", {"/joint_states": columns})
    with pytest.raises(DataError, match="no torque"):
        read_log(path, TURRET)
    read = read_log(path, TURRET, need_tau=False)
    np.testing.assert_array_equal(read.q, log.q)


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
    np.testing.assert_array_equal(read.q, log.q)
    np.testing.assert_array_equal(held(read.tau), held(log.tau))
    np.testing.assert_allclose(read.t, 0.123456789 + FEW, atol=1e-9)
    assert "1790000000 s since 1970" in read.events[0]


# --- LeRobot ------------------------------------------------------------------------------------

VECTORS = {"observation.state": "q", "observation.velocity": "v", "observation.effort": "tau"}


def write_lerobot(folder: Path, log: Log, episodes: Sequence[int], names: object = None) -> None:
    """Write a data set of version 3.0 in two files, whose vectors are lists of either kind."""
    counts = {"frame_index": "int64", "episode_index": "int64", "index": "int64"}
    kinds = {"timestamp": "float32", **counts, **dict.fromkeys(VECTORS, "float32")}
    features = {
        key: {"dtype": kind, "shape": [1 + (key in VECTORS)], "names": names}
        for key, kind in kinds.items()
    }
    (folder / "meta").mkdir(parents=True)
    (folder / "data/chunk-000").mkdir(parents=True)
    info = {"fps": 50, "features": features, "total_frames": len(log)}
    (folder / "meta/info.json").write_text(json.dumps(info))
    frame = np.concatenate([np.arange(count) for count in episodes])
    columns = {
        "timestamp": (frame / 50).astype(np.float32),
        "frame_index": frame,
        "episode_index": np.repeat(np.arange(len(episodes)), episodes),
        "index": np.arange(len(log)),
    }
    for k, rows in enumerate((slice(episodes[0]), slice(episodes[0], None))):
        kind = pyarrow.list_(pyarrow.float32(), 2 if k == 0 else -1)
        table = {key: pyarrow.array(x[rows]) for key, x in columns.items()}
        for key, of in VECTORS.items():
            table[key] = pyarrow.array(list(held(getattr(log, of))[rows]), kind)
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
    write_lerobot(tmp_path / "set", log, (25, 20, 15), names)
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
    """The gimbal's angles in radians, the IMU in single precision; what is whole of a damaged one."""
    columns = log_columns(planted(FEW, has_imu=True))
    path = tmp_path / "flight.tlog"
    as_tlog(columns, path)
    table = io.open_table(path)
    times, pitch = table.read(["MOUNT_ORIENTATION.t", "MOUNT_ORIENTATION.pitch"]).values()
    np.testing.assert_allclose(times, FEW[::2], atol=1e-3)
    np.testing.assert_allclose(pitch, -np.pi / 2, rtol=1e-6)
    assert table.notes == []
    content = bytearray(path.read_bytes())
    content[content.index(b"\xfd", len(content) // 2) + 12] ^= 0x55
    path.write_bytes(content[:500] + b"\xfd\xfe\xfd" + content[500:-5])
    mapping = {f"gyro_base_{axis}": f"HIGHRES_IMU.{axis}gyro" for axis in "xyz"}
    t, imu = io.read_imu(path, TURRET, "base", {"t": "HIGHRES_IMU.t", **mapping})
    kept = np.isin(np.round(1e3 * FEW), np.round(1e3 * t))
    assert 57 <= len(t) == kept.sum() < 60
    np.testing.assert_allclose(held(imu.gyro)[:, 2], columns["gyro_base_z"][kept], rtol=1e-6)


# --- Several files and several rates are one log ------------------------------------------------


def test_files_of_two_rates_are_joined_at_the_times_of_the_first(tmp_path: Path) -> None:
    """The second one's times are in milliseconds."""
    u = np.arange(3, 6, 1 / 730)
    columns = without(log_columns(planted(np.arange(0, 8, 0.002))), "dq_")
    rates = swing(u)[1]
    write_csv(columns, tmp_path / "a.csv")
    write_csv({"t_ms": 1e3 * u, "dq_pan": rates[:, 0], "dq_tilt": rates[:, 1]}, tmp_path / "b.csv")
    log = read_log(f"{tmp_path / 'a.csv'}+{tmp_path / 'b.csv'}", TURRET)
    # Between samples the rate bends by less than max|d²v/dt²| h²/8 = 0.2e-3 rad/s.
    np.testing.assert_allclose(held(log.v), swing(log.t)[1], atol=1e-3)
    assert 3 <= log.t[0] < 3.01
    assert 5.99 < log.t[-1] <= 6
    assert any("samples are left out" in event for event in log.events)


def test_files_of_one_clock_are_joined_exactly_and_holes_stay(tmp_path: Path) -> None:
    log = planted()
    columns = log_columns(log)
    rows = np.r_[0:80, 120:600]
    write_csv(without(columns, "dq_"), tmp_path / "a.csv")
    rates = {name: columns[name][rows] for name in ("t", "dq_pan", "dq_tilt")}
    write_csv(rates, tmp_path / "b.csv")
    same(read_log(f"{tmp_path / 'a.csv'}+{tmp_path / 'b.csv'}", TURRET), log.part(rows))
