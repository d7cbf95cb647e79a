"""Every ecosystem's own writer of the same motion gives the same log."""

from __future__ import annotations

import json
import os
import resource
import sqlite3
import struct
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from pathlib import Path

import numpy as np
import pandas
import pyarrow
import pytest
import scipy.io
from pyarrow import parquet
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from gimbal_pin.errors import GimbalPinError, LogError
from gimbal_pin.log import Imu, Log, io, log_columns
from gimbal_pin.log.io import readers
from gimbal_pin.rig import Rig
from tests.command_line import Run, refused
from tests.log import bombs
from tests.log.test_io import same
from tests.log.writers import Columns, as_bag, as_hdf5, as_mat, as_npy, as_records, as_ulog

TURRET = Rig.load("turret")
SOON = 15.0
"""Longest that a damaged file may take, s: a process and a library begin in less than one."""


def motion(rows: int = 60) -> Log:
    """A log on whole microseconds, with the rates of an IMU at its base."""
    rng = np.random.default_rng(1)
    t = np.arange(rows) * 2000 / 1e6
    q, v, tau = (0.1 * np.cumsum(rng.normal(size=(rows, TURRET.n)), axis=0) for _ in range(3))
    imu = Imu(
        rng.normal(size=(rows, 3)), rng.normal(size=(rows, 3)), np.tile([1.0, 0, 0, 0], (rows, 1))
    )
    return Log("made", TURRET.joints, t, q, v, tau, imus={TURRET.base: imu})


def frame(columns: Columns) -> pandas.DataFrame:
    return pandas.DataFrame(dict(columns))


def plain_text(separator: str, header: bool = True) -> Callable[[Columns, Path], None]:
    return lambda columns, path: frame(columns).to_csv(
        path, sep=separator, index=False, header=header
    )


WRITERS: Mapping[str, tuple[str, Callable[[Columns, Path], None]]] = {
    "csv": ("log.csv", plain_text(",")),
    "semicolons": ("log.txt", plain_text(";")),
    "tabs": ("log.tsv", plain_text("\t")),
    "spaces": ("log.txt", plain_text(" ")),
    "no header": ("log.csv", plain_text(",", header=False)),
    "savetxt": ("log.txt", lambda c, path: np.savetxt(path, np.column_stack(list(c.values())), header=" ".join(c),
                                                      fmt="%25.17g")),
    "csv.gz": ("log.csv.gz", lambda c, path: frame(c).to_csv(path, index=False)),
    "parquet of pandas": ("log.parquet", lambda c, path: frame(c).to_parquet(path)),
    "parquet": ("log", lambda c, path: parquet.write_table(pyarrow.table(dict(c)), path)),
    "npy": ("log.npy", as_npy),
    "npy by columns": ("log.npy", lambda c, path: np.save(path, np.array(list(c.values())).T)),
    "record array": ("log.npy", as_records),
    "npz": ("log.npz", lambda c, path: np.savez(path, **c)),
    "packed npz": ("log", lambda c, path: path.with_suffix(".npz").rename(path)
                   if np.savez_compressed(path.with_suffix(".npz"), **c) is None else None),
    "mat": ("log.mat", as_mat),
    "mat 7.3": ("log.mat", as_hdf5),
    "ros1": ("log.bag", as_bag("ros1")),
    "ros2 sqlite3": ("log", as_bag("sqlite3")),
    "ros2 mcap": ("some.log", lambda c, path: as_bag("mcap")(c, path.parent / "bag") or
                  next((path.parent / "bag").glob("*.mcap")).rename(path)),
    "ulog": ("log.ulg", as_ulog),
}  # fmt: skip


def maps(writer: str, columns: Columns) -> list[str]:
    """What a format without names, or with longer ones, is mapped by."""
    if writer in ("no header", "npy", "npy by columns"):
        first, name = (1, "column") if writer == "no header" else (0, "c")
        return [f"{column}={name}{k}" for k, column in enumerate(columns, start=first)]
    if writer == "ulog":
        return ["t=rig.timestamp", *(f"{name}=rig.{name}" for name in columns if name != "t")]
    return [f"{name}=log.{name}" for name in columns] if writer == "mat 7.3" else []


@pytest.mark.parametrize("writer", WRITERS)
def test_every_writer_gives_the_same_log(writer: str, tmp_path: Path) -> None:
    log = motion()
    columns = log_columns(log)
    name, write = WRITERS[writer]
    write(columns, tmp_path / name)
    same(io.read_log(tmp_path / name, TURRET, maps(writer, columns)), log)


def drive_bag(path: Path) -> None:
    """Write a bag of joints, and 5 ms later a drive's message of a type of its own: no stamps, recorded in 2026."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    start = 1_790_000_000_123_456_789
    store.register(
        get_types_from_msg(
            "float64 current\nfloat32[3] heat\nbool on\nstring name", "drive_msgs/msg/Drive"
        )
    )
    drive = store.types["drive_msgs/msg/Drive"]
    joints = store.types["sensor_msgs/msg/JointState"]
    header = store.types["std_msgs/msg/Header"](
        store.types["builtin_interfaces/msg/Time"](0, 0), ""
    )
    with Writer2(path, version=9) as bag:
        one = bag.add_connection("/drive", drive.__msgtype__, typestore=store)
        two = bag.add_connection("/joints", joints.__msgtype__, typestore=store)
        for k in range(20):
            at = start + k * 10**7
            message = drive(current=0.1 * k, heat=np.full(3, k, np.float32), on=True, name="pan")
            bag.write(one, at + 5 * 10**6, store.serialize_cdr(message, drive.__msgtype__))
            state = joints(
                header, list(TURRET.joints), np.full(2, 0.01 * k), np.zeros(0), np.full(2, 0.5)
            )
            bag.write(two, at, store.serialize_cdr(state, joints.__msgtype__))


def test_a_type_of_ones_own_is_read_by_the_bags_definition_and_left_out_without(
    tmp_path: Path,
) -> None:
    drive_bag(tmp_path / "bag")
    log = io.read_log(
        tmp_path / "bag",
        TURRET,
        ["tau_pan=/drive.current", *(f"temp_{joint}=/drive.heat[2]" for joint in TURRET.joints)],
    )
    # Counted from a whole second, which is told; currents that lie between two drive messages are on their line.
    np.testing.assert_allclose(log.t, 0.123456789 + 0.01 * np.arange(1, 20), atol=1e-9)
    np.testing.assert_allclose(log.tau[:, 0], 0.1 * np.arange(1, 20) - 0.05, atol=1e-6)  # type: ignore[index]
    assert log.v is None and any("1790000000 s since 1970" in event for event in log.events)
    with closing(sqlite3.connect(next((tmp_path / "bag").glob("*.db3")))) as data:
        data.execute("DELETE FROM message_definitions")
        data.commit()
    left = readers.open_table(tmp_path / "bag")
    assert "/drive" in left.notes[-1] and not any("drive" in column for column in left.columns)


def test_rows_that_lack_a_value_or_come_before_time_goes_on_are_left_out_and_told(
    tmp_path: Path,
) -> None:
    """Some blanks, stale first rows and a column of another rate: what is left is the log, wherever they stand."""
    log = motion(100)
    table = frame(log_columns(log)).assign(temp_pan=np.nan, temp_tilt=20.0)
    table.loc[[0, 40, 99], "tau_tilt"] = np.nan
    stale = pandas.concat([table[60:62], table[3:4], table])
    kept = np.delete(np.arange(100), [0, 40, 99])
    for path in (tmp_path / "log.csv", tmp_path / "log.parquet", tmp_path / "log.npz"):
        writers = {".csv": lambda to: stale.to_csv(to, index=False), ".parquet": stale.to_parquet}
        writers.get(
            path.suffix, lambda to: np.savez(to, **{c: stale[c].to_numpy() for c in stale})
        )(path)
        read = io.read_log(path, TURRET)
        same(read, log.part(kept))
        told = " ".join(read.events)
        assert "3 of 103 rows lack" in told and "3 of 103 rows, is" in told and "'temp_pan'" in told
    table.loc[::2, "tau_tilt"] = np.nan
    table.to_csv(tmp_path / "half.csv", index=False)
    with pytest.raises(LogError, match=r"a.csv\+b.csv"):
        io.read_log(tmp_path / "half.csv", TURRET)
    pandas.DataFrame({"t": [np.nan] * 3, "asked": 0.0}).to_csv(
        tmp_path / "timeless.csv", index=False
    )
    with pytest.raises(LogError, match="no time in common"):
        io.read_log(
            f"{tmp_path / 'log.csv'}+{tmp_path / 'timeless.csv'}", TURRET, ["temp_pan=asked"]
        )


# --- What is damaged, hostile or not installed ----------------------------------------------------------------------


def soon(read: Callable[[], Log]) -> None:
    """Read, or refuse in one line, at once."""
    start = time.perf_counter()
    try:
        read()
    except GimbalPinError as error:
        assert "\n" not in str(error)
    assert time.perf_counter() - start < SOON


def test_what_unfolds_without_measure_is_refused(tmp_path: Path) -> None:
    """Kilobytes that stand for gigabytes are refused before these are in memory, also where they state less."""
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for name, content in {
        "bomb.npz": bombs.npz(bombs.FULL),
        "lying.npz": bombs.npz(1000),
        "bomb.mat": bombs.mat(),
        "bomb.h5": bombs.hdf5(),
        "bomb.parquet": bombs.parquet(9),
    }.items():
        (tmp_path / name).write_bytes(content)
        with pytest.raises(LogError, match="damaged" if name == "lying.npz" else "holds more than"):
            (table := readers.open_table(tmp_path / name)).read(table.columns)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 2**30 / 1024
    (tmp_path / "bomb.csv.gz").write_bytes(bombs.gz())
    with pytest.raises(LogError, match="holds more than"):
        readers.open_table(tmp_path / "bomb.csv.gz")


@pytest.mark.parametrize("name", ["x.mat", "x.h5", "x.bag", "x.ulg", "x.csv", "x.parquet", "x.npz"])
def test_a_pipe_that_nobody_fills_is_refused_at_once(name: str, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / name)
    soon(lambda: io.read_log(tmp_path / name, TURRET))
    (tmp_path / f"end{name}").symlink_to("/dev/zero")
    soon(lambda: io.read_log(tmp_path / f"end{name}", TURRET))


def test_objects_and_shapes_that_are_not_there_are_refused(tmp_path: Path) -> None:
    np.save(tmp_path / "objects.npy", np.array([{}, 1], dtype=object), allow_pickle=True)
    np.savez(tmp_path / "objects.npz", t=np.array([[], 1], dtype=object))
    np.save(tmp_path / "line.npy", np.zeros(9))
    huge = b"{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000, 9), }\n"
    (tmp_path / "huge.npy").write_bytes(b"\x93NUMPY\1\0" + struct.pack("<H", len(huge)) + huge)
    for name, word in (("objects.npy", "objects"), ("objects.npz", "objects"), ("line.npy", "1 dimension"),
                       ("huge.npy", "damaged")):  # fmt: skip
        with pytest.raises(LogError, match=word):
            io.read_log(tmp_path / name, TURRET)


@pytest.mark.parametrize(
    ("name", "extra"), [("x.bag", "ros"), ("x.ulg", "px4"), ("x.tlog", "mavlink"), ("x.h5", "mat")]
)
def test_a_missing_library_is_one_line(
    name: str, extra: str, tmp_path: Path, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / name).write_bytes(b"\x89HDF\r\n\x1a\n" if extra == "mat" else b"")
    monkeypatch.setattr(readers, "find_spec", lambda module: None)
    refused(run("identify", "turret", tmp_path / name), 2, f"pip install 'gimbal_pin[{extra}]'")


# --- STorM32 ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("separator", ["\t", ","])
def test_a_line_of_units_below_the_names_ends_them(separator: str, tmp_path: Path) -> None:
    """As STorM32's NTLoggerTool saves a log; the lines of errors count it."""
    names = ["Time", "State", "Imu1Pitch", "EncYaw*", "DPitch"]
    units = ["ms", "uint", "deg", "deg", "deg/s"]
    lines = [
        names,
        [f"[{unit}]" for unit in units],
        ["0", "6", "10.5", "-3", "1"],
        ["1.5", "6", "11", "-3.5", "2"],
    ]
    path = tmp_path / "log.dat"
    path.write_text("\n".join(map(separator.join, lines)) + "\n")
    table = io.open_table(path)
    assert table.columns == ("Time_ms", "State", "Imu1Pitch_deg", "EncYaw*_deg", "DPitch [deg/s]")
    data = table.read(["Time_ms", "Imu1Pitch_deg"])
    assert (data["Time_ms"].tolist(), data["Imu1Pitch_deg"].tolist()) == ([0.0, 1.5], [10.5, 11.0])
    assert table.place(1, "State") == f"{path}:4 column 'State'"


# --- LeRobot --------------------------------------------------------------------------------------------------------


FPS = 50


def write_lerobot(folder: Path, log: Log, episodes: Sequence[slice], names: object) -> None:
    """Write a data set of version 3.0: two files of data, as lists of either kind, and all of its metadata."""
    vectors = {
        "observation.state": log.q,
        "observation.velocity": log.v,
        "observation.effort": log.tau,
    }
    features = {
        key: {"dtype": "float32", "shape": [TURRET.n], "names": names}
        for key in (*vectors, "action")
    }
    features |= {"next.done": {"dtype": "bool", "shape": [1], "names": None}}
    features |= {
        "observation.images.front": {"dtype": "video", "shape": [480, 640, 3], "names": list("hwc")}
    }
    features |= {"observation.scan": {"dtype": "float32", "shape": [100], "names": None}}
    features |= {"timestamp": {"dtype": "float32", "shape": [1], "names": None}}
    counts = ("frame_index", "episode_index", "index", "task_index")
    features |= {key: {"dtype": "int64", "shape": [1], "names": None} for key in counts}
    data = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
    info = {
        "codebase_version": "v3.0",
        "robot_type": "turret",
        "fps": FPS,
        "features": features,
        "data_path": data,
    }
    info |= {
        "total_episodes": len(episodes),
        "total_frames": len(log),
        "total_tasks": 1,
        "chunks_size": 1000,
    }
    info |= {"data_files_size_in_mb": 100, "splits": {"train": f"0:{len(episodes)}"}}
    for part in ("meta/episodes/chunk-000", "data/chunk-000"):
        (folder / part).mkdir(parents=True)
    (folder / "meta" / "info.json").write_text(json.dumps(info, indent=4))
    parquet.write_table(
        pyarrow.table({"task_index": [0], "task": ["move"]}), folder / "meta" / "tasks.parquet"
    )
    rows = {
        "episode_index": range(len(episodes)),
        "length": [one.stop - one.start for one in episodes],
    }
    rows |= {
        "dataset_from_index": [one.start for one in episodes],
        "dataset_to_index": [one.stop for one in episodes],
    }
    parquet.write_table(pyarrow.table(rows), folder / "meta/episodes/chunk-000/file-000.parquet")
    for k, half in enumerate((episodes[0], slice(episodes[0].stop, len(log)))):
        lists = pyarrow.list_(pyarrow.float32(), TURRET.n if k == 0 else -1)
        table = {
            key: pyarrow.array(list(x[half].astype(np.float32)), lists)
            for key, x in vectors.items()
        }
        table |= {
            "action": table["observation.state"],
            "next.done": [False] * (half.stop - half.start),
        }
        wide = pyarrow.list_(pyarrow.float32(), 100)
        table |= {
            "observation.scan": pyarrow.array(
                [np.zeros(100, np.float32)] * (half.stop - half.start), wide
            )
        }
        own = [
            (number, row - one.start)
            for number, one in enumerate(episodes)
            for row in range(one.start, one.stop)
        ]
        episode, frame = np.array(own)[half].T
        table |= {
            "timestamp": pyarrow.array((frame / FPS).astype(np.float32)),
            "frame_index": frame,
        }
        table |= {
            "episode_index": episode,
            "index": np.arange(len(log))[half],
            "task_index": 0 * frame,
        }
        parquet.write_table(pyarrow.table(table), folder / f"data/chunk-000/file-{k:03d}.parquet")


NAMED = [
    ([f"{joint}.pos" for joint in TURRET.joints], [f".{joint}.pos" for joint in TURRET.joints]),
    ({"motors": [*TURRET.joints]}, [f".{joint}" for joint in TURRET.joints]),
    (None, [f"[{k}]" for k in range(TURRET.n)]),
]
"""What data sets call the numbers of a feature, and the ends of their columns' names."""


@pytest.mark.parametrize(("names", "ends"), NAMED)
def test_a_lerobot_data_set_is_one_log_with_pauses(
    names: object, ends: list[str], tmp_path: Path
) -> None:
    """Frames come at multiples of 1/fps to the last bit, though their stamps are rounded; vectors are float32."""
    log = motion()
    write_lerobot(tmp_path / "set", log, (slice(0, 25), slice(25, 45), slice(45, 60)), names)
    pairs = {"q": "state", "dq": "velocity", "tau": "effort", "q_ref": "action"}
    own = {
        column: f"observation.{key}" if column != "q_ref" else key for column, key in pairs.items()
    }
    mapping = [
        f"{c}_{j}={key}{end}" for c, key in own.items() for j, end in zip(TURRET.joints, ends)
    ]
    read = io.read_log(tmp_path / "set", TURRET, mapping)
    for found, true in ((read.q, log.q), (read.v, log.v), (read.tau, log.tau), (read.q_ref, log.q)):
        np.testing.assert_array_equal(found, true.astype(np.float32))
    steps = np.diff(read.t)
    np.testing.assert_allclose(np.delete(steps, [24, 44]), 1 / FPS, atol=1e-12)
    assert all(steps[[24, 44]] > 10.0)
    assert all(
        any(word in event for event in read.events) for word in ("3 episodes", "observation.scan")
    )
    (tmp_path / "set/data/chunk-000/file-001.parquet").unlink()
    rest = io.read_log(tmp_path / "set", TURRET, mapping)
    assert len(rest) == 25 and any("25 of 60 frames" in event for event in rest.events)


def test_a_damaged_lerobot_data_set_is_refused_in_one_line(tmp_path: Path, run: Run) -> None:
    write_lerobot(tmp_path / "set", motion(), (slice(0, 60),), None)
    info = tmp_path / "set/meta/info.json"
    data = tmp_path / "set/data/chunk-000/file-000.parquet"
    whole = data.read_bytes()
    stated = info.read_text()
    table = parquet.read_table(data)
    uneven = pyarrow.array(
        [[0.0] * (1 + row % 2) for row in range(60)], pyarrow.list_(pyarrow.float32())
    )
    place = table.schema.get_field_index("observation.state")
    cases = (
        (lambda: data.write_bytes(whole[:-200]), "is not Parquet"),
        (lambda: parquet.write_table(table.drop_columns(["index"]), data), "no column 'index'"),
        (
            lambda: parquet.write_table(table.set_column(place, "observation.state", uneven), data),
            "2 numbers a row",
        ),
        (
            lambda: info.write_text(stated.replace(f'"fps": {FPS}', '"fps": 0')),
            "no LeRobot data set",
        ),
        (lambda: info.write_text("{"), "is not YAML"),
        (lambda: [file.unlink() for file in data.parent.iterdir()], "no data"),
    )
    for damage, word in cases:
        data.write_bytes(whole)
        info.write_text(stated)
        damage()
        refused(run("identify", "turret", tmp_path / "set"), 2, word)


# --- MAVLink ---------------------------------------------------------------------------------------------------------


def write_tlog(path: Path, t: np.ndarray, imu: Imu, q: np.ndarray) -> None:
    """Write a telemetry log as ground stations do: the vehicle's IMU, a slower one of another device, its gimbal."""
    from pymavlink.dialects.v20 import ardupilotmega as mavlink

    vehicle = mavlink.MAVLink(None, 1, 1)
    camera = mavlink.MAVLink(None, 1, 154)
    flip = np.array([1.0, -1.0, -1.0])  # forward, left, up to forward, right, down
    gyro = imu.gyro * flip
    accel = imu.accel * flip
    with path.open("wb") as file:

        def write(link: object, message: object, at: float, old: bool = False) -> None:
            packet = message.pack(link, force_mavlink1=old)  # type: ignore[attr-defined]
            file.write(struct.pack(">Q", round(1.7e15 + 1e6 * at)) + packet)

        for k, at in enumerate(t.tolist()):
            write(vehicle, mavlink.MAVLink_heartbeat_message(2, 3, 81, 0, 4, 3), at, old=True)
            state = [round(1e6 * at), *accel[k], *gyro[k], *([0.0] * 3), 1000.0, 0.0, 0.0, 25.0, 63]
            write(vehicle, mavlink.MAVLink_highres_imu_message(*state), at)
            if k % 2 == 0:
                write(vehicle, mavlink.MAVLink_highres_imu_message(*state, id=1), at)
                device = [0, 0, round(1e3 * at), 0, q[k].tolist(), *gyro[k], 0]
                write(camera, mavlink.MAVLink_gimbal_device_attitude_status_message(*device), at)
                write(
                    camera,
                    mavlink.MAVLink_mount_orientation_message(round(1e3 * at), 10.0, -90.0, 45.0),
                    at,
                )


def test_a_telemetry_log_of_mavlink_carries_the_platform(tmp_path: Path) -> None:
    """The vehicle's IMU as the base's, in single precision; angles in radians; the gimbal's own attitude."""
    rng = np.random.default_rng(2)
    t = np.arange(200) / 250
    gyro, accel = rng.normal(size=(2, 200, 3))
    imu = Imu(gyro, accel, None)
    q = rng.normal(size=(200, 4))
    write_tlog(tmp_path / "flight.tlog", t, imu, q)
    signs = {"x": "", "y": "*-1", "z": "*-1"}
    own = [f"{kind}_{TURRET.base}_{axis}=HIGHRES_IMU.{axis}{of}{sign}"
           for kind, of in (("gyro", "gyro"), ("accel", "acc")) for axis, sign in signs.items()]  # fmt: skip
    clock, read = io.read_imu(
        tmp_path / "flight.tlog", TURRET, TURRET.base, ["t=HIGHRES_IMU.t", *own]
    )
    np.testing.assert_allclose(clock, t, atol=1e-6)
    for found, true in ((read.gyro, gyro), (read.accel, accel)):
        assert found is not None
        np.testing.assert_allclose(found, true, rtol=1e-6)
    table = io.open_table(tmp_path / "flight.tlog")
    expected = {
        "MOUNT_ORIENTATION.pitch": np.full(100, -np.pi / 2),
        "GIMBAL_DEVICE_ATTITUDE_STATUS.q[2]": q[::2, 2],
        "HIGHRES_IMU#2.zacc": -accel[::2, 2],
    }
    for name, values in expected.items():
        of = f"{name.partition('.')[0]}.t"
        data = table.read([of, name])
        np.testing.assert_allclose(data[name], values, rtol=1e-6)
        np.testing.assert_allclose(data[of], t[::2], atol=1e-6)
    assert not any("damaged" in note for note in table.notes)


def test_what_is_whole_of_a_damaged_telemetry_log_is_read(tmp_path: Path) -> None:
    """Bytes between packets, and one within a packet that is another: the others are all there, and that is said."""
    t = np.arange(40) / 250
    imu = Imu(np.ones((40, 3)), np.ones((40, 3)), None)
    write_tlog(tmp_path / "whole.tlog", t, imu, np.ones((40, 4)))
    whole = (tmp_path / "whole.tlog").read_bytes()
    broken = bytearray(whole)
    broken[whole.index(b"\xfd", len(whole) // 2) + 12] ^= 0x55
    for damaged in (whole[:500] + b"\xfd\xfe\xfd" + whole[500:], bytes(broken), whole[:-5]):
        (tmp_path / "damaged.tlog").write_bytes(damaged)
        table = io.open_table(tmp_path / "damaged.tlog")
        assert len(table.read(["HIGHRES_IMU.t"])["HIGHRES_IMU.t"]) >= 38
        assert any("damaged" in note for note in table.notes)
    (tmp_path / "empty.tlog").write_bytes(b"\xfd\xfe" * 500)
    with pytest.raises(LogError, match="holds no columns"):
        io.open_table(tmp_path / "empty.tlog")


# --- Several files are one log --------------------------------------------------------------------------------------


def swing(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Angles and rates of two joints that never repeat, (N, 2) each."""
    terms = [(0.5, 1.1, 0.3), (0.3, 2.3, 1.1), (0.2, 4.7, 2.0), (0.1, 7.9, 0.7)]
    q = sum(
        np.column_stack([a * np.sin(w * t + p), a * np.sin(1.3 * w * t + 2 * p)])
        for a, w, p in terms
    )
    v = sum(
        np.column_stack([a * w * np.cos(w * t + p), 1.3 * a * w * np.cos(1.3 * w * t + 2 * p)])
        for a, w, p in terms
    )
    return np.asarray(q), np.asarray(v)


def two_files(folder: Path, unit: float = 1.0, rate: float = 730.0) -> Path:
    """Write angles and torques in one file, rates at another rate and with times in another unit in a second one."""
    t = np.arange(0, 20, 0.002)
    u = np.arange(3, 16, 1 / rate)
    (q, _) = swing(t)
    (_, w) = swing(u)
    one = {"t": t, **{f"q_{j}": q[:, k] for k, j in enumerate(TURRET.joints)}}
    one |= {f"tau_{j}": np.cos(t) for j in TURRET.joints}
    other = {
        "t_ms" if unit < 1 else "time": u / unit,
        **{f"dq_{j}": w[:, k] for k, j in enumerate(TURRET.joints)},
    }
    frame(one).to_csv(folder / "a.csv", index=False)
    frame(other).assign(note="turning").to_csv(folder / "b.csv", index=False)
    return Path(f"{folder / 'a.csv'}+{folder / 'b.csv'}")


@pytest.mark.parametrize("unit", [1.0, 1e-3])
def test_files_of_two_rates_are_joined_at_the_times_of_the_first(
    unit: float, tmp_path: Path
) -> None:
    log = io.read_log(two_files(tmp_path, unit), TURRET)
    assert log.v is not None
    # Between samples the rate bends by less than max|d²v/dt²| h²/8 = 0.2e-3 rad/s.
    np.testing.assert_allclose(log.v, swing(log.t)[1], atol=1e-3)
    assert 3 <= log.t[0] < 3.01 and 15.99 < log.t[-1] <= 16
    assert any("samples are left out" in event for event in log.events)


def test_files_of_one_clock_are_joined_exactly_and_holes_stay(tmp_path: Path) -> None:
    log = motion(200)
    columns = log_columns(log)
    split = [name for name in columns if name.startswith("dq")]
    frame({name: values for name, values in columns.items() if name not in split}).to_csv(
        tmp_path / "a.csv"
    )
    rows = np.r_[0:80, 120:200]
    frame({name: columns[name][rows] for name in ["t", *split]}).to_parquet(tmp_path / "b.parquet")
    same(io.read_log(f"{tmp_path / 'a.csv'}+{tmp_path / 'b.parquet'}", TURRET), log.part(rows))


def test_topics_of_several_rates_are_joined_at_the_joints_times(tmp_path: Path) -> None:
    """The first column that is asked for says whose times they are; no topic is shifted."""
    t = np.arange(0, 10, 0.01)
    u = np.arange(0, 10, 0.0037)
    lead = 0.06
    arrays = {"t": t, "q": swing(t)[0], "imu": {"time": u, "gyro": swing(u)[1][:, [0, 1, 1]]}}
    arrays |= {"asked": {"time": u[:-1:2], "q_setpoint": swing(u[:-1:2] + lead)[0]}}
    arrays |= {"drive": {"time": u[1:-1:2], "torque": swing(u[1:-1:2] - lead)[1]}}
    scipy.io.savemat(tmp_path / "log.mat", arrays)
    sources = {"q": "q", "tau": "drive.torque", "q_ref": "asked.q_setpoint"}
    named = [
        f"{of}_{j}={name}[{k}]" for of, name in sources.items() for k, j in enumerate(TURRET.joints)
    ]
    named += [f"gyro_{TURRET.base}_{a}=imu.gyro[{k}]" for k, a in enumerate("xyz")]
    log = io.read_log(tmp_path / "log.mat", TURRET, named)
    assert 0 < len(t) - len(log) < 5 and set(log.t) < set(t)
    np.testing.assert_allclose(log.imus[TURRET.base].gyro, swing(log.t)[1][:, [0, 1, 1]], atol=2e-3)
    np.testing.assert_allclose(log.q_ref, swing(log.t + lead)[0], atol=2e-3)
    np.testing.assert_allclose(log.tau, swing(log.t - lead)[1], atol=2e-3)


def test_a_verb_writes_over_no_file_of_several(tmp_path: Path, run: Run) -> None:
    log = two_files(tmp_path)
    refused(run("identify", "turret", log, "-o", tmp_path / "b.csv"), 2, "would write over")
