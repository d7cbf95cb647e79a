"""Every format of a log, in one table: how its files begin, their suffixes, what reads and what writes them.

MATLAB files, ULogs, MAVLink logs and bags are read in a process of its own (`bounded`): their libraries are not made
for untrusted files.
"""

from __future__ import annotations

import io
import struct
import zipfile
import zlib
from array import array
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from functools import partial
from importlib.util import find_spec
from math import prod
from pathlib import Path
from tempfile import TemporaryDirectory
from tokenize import TokenError
from typing import Any, NamedTuple

import numpy as np

from gimbal_pin.errors import GimbalPinError, LogError, UsageError
from gimbal_pin.log.io.candump import CANDUMP_MAGIC, open_candump
from gimbal_pin.log.io.csv import GZIP_MAGIC, open_csv, write_csv
from gimbal_pin.log.io.files import open_replacement, wrap_os_errors
from gimbal_pin.log.io.joint_states import (
    choose_names,
    drop_empty_columns,
    list_joint_values,
    open_topic_echo,
)
from gimbal_pin.log.io.json_log import open_json
from gimbal_pin.log.io.mavlink import read_tlog
from gimbal_pin.log.io.tables import (
    DEEPEST_NESTING,
    WIDEST_ARRAY,
    ArrayTable,
    ColumnTable,
    JoinedTable,
    Stream,
    find_time,
    group_streams,
    make_table,
    quote_names,
)
from gimbal_pin.log.log import PAUSE, Array
from gimbal_pin.rig.bounded import ProcessStopped, run_bounded
from gimbal_pin.rig.reading import (
    LARGEST_LOG,
    check_size,
    read_beginning,
    read_bytes,
    read_yaml,
    wrap_read_errors,
)

_HDF5 = b"\x89HDF\r\n\x1a\n"
_BAG_SUFFIXES = {b"#ROSBAG V2.0": ".bag", b"SQLite format 3\0": ".db3", b"\x89MCAP0\r\n": ".mcap"}
"""How a bag's file begins → the suffix that rosbags knows it by."""
_IMU_MESSAGE_COLUMNS = {
    "angular_velocity": "gyro",
    "linear_acceleration": "accel",
    "orientation": "quat",
}
_LARGEST_MESSAGE = 2**16
"""Largest message of a bag that is read, bytes: pictures and clouds of points are larger, a drive's are not."""
_EXACT_NANOSECONDS = 2**53
"""What a double holds exactly, 104 days: later stamps count from the whole second of the bag's first."""
_READER_MEMORY = 2**30 + 2 * LARGEST_LOG
"""Address space of a reading process, bytes: that of the libraries, and columns are held twice at most."""
_READER_SECONDS, _READER_RATE = 20.0, 5e5
"""Processor time of a reading process, s, of the smallest file, and the bytes beyond for which it may take another
second: bags of JointState and Imu messages pass at 6 MB/s, MATLAB files at 4 MB/s (2.5 GHz, start of the process
included)."""
_NPY_DAMAGE = (
    ValueError,
    TypeError,
    SyntaxError,
    TokenError,
    MemoryError,
    RecursionError,
    OverflowError,
    LookupError,
)
"""What NumPy raises of a header that is none: it reads one as Python's text."""
_NPZ_DAMAGE = (
    *_NPY_DAMAGE,
    zipfile.BadZipFile,
    zlib.error,
    struct.error,
    EOFError,
    OSError,
    RuntimeError,
)

Streams = tuple[list[Stream], list[str]]
"""What was sampled together, and notes."""


def open_table(path: Path) -> ColumnTable:
    """Return what a log's file holds, or several files: ``a.csv+b.csv``.

    Raises:
        LogError: A file is missing or cannot be read.
        UsageError: No format is known that begins so, nor one of the suffix; or a file to be joined has no times.
    """
    tables = [_open_file(file) for file in files_of(path)]
    return (
        tables[0]
        if len(tables) == 1
        else JoinedTable(str(path), tables, [find_time(table) for table in tables])
    )


def files_of(path: str | Path) -> list[Path]:
    """Return the files that a log's name means: itself, or the logs between its +."""
    parts = [Path(part) for part in str(path).split("+")]
    several = len(parts) > 1 and not Path(path).exists() and all(is_log(part) for part in parts)
    return parts if several else [Path(path)]


def is_log(path: Path) -> bool:
    """Whether a path is a log's, by its suffix or because it is there."""
    return path.suffix.lower() in FORMATS or path.exists()


def format_of(path: Path) -> Format:
    """Return the format of a path's suffix; `UsageError` lists the known ones."""
    if (suffix := path.suffix.lower()) not in FORMATS:
        what = (
            f"has the suffix '{suffix}', of no known format"
            if suffix
            else "has no suffix to tell its format by"
        )
        raise UsageError(str(path), what, f"use one of {', '.join(FORMATS)}")
    return FORMATS[suffix]


def _open_file(path: Path) -> ColumnTable:
    """Return what one file holds, or the folder of a bag or of a LeRobot data set."""
    if (path / "metadata.yaml").is_file():
        return _open_isolated("bag", path)
    if (path / "meta" / "info.json").is_file():
        return _open_lerobot(path)
    head = read_beginning(path, 16)  # of what cannot be read its reader says why
    begun = next(
        (form for form in FORMATS.values() if form.magic and head.startswith(form.magic)), None
    )
    return (begun or format_of(path)).open(path)


# --- NumPy ----------------------------------------------------------------------------------------------------------


def _open_text(path: Path) -> ColumnTable:
    """Read text of rows and columns, joint states by the names in each row; `LogError` as `open_csv`."""
    return open_topic_echo(open_csv(path))


def _open_npy(path: Path) -> ColumnTable:
    """Read a record array, or a row per sample of plain columns c0, c1, …."""
    values = _load_array(read_bytes(path, LogError), str(path))
    if values.dtype.names:
        return make_table(str(path), *group_streams({"": values}))
    if values.ndim != 2:
        shape = f"has {values.ndim} dimension{'' if values.ndim == 1 else 's'}"
        raise LogError(
            str(path),
            shape,
            "save a table of a row per sample, a record array, or an .npz of names",
        )
    return make_table(
        str(path), [Stream("", {f"c{k}": column for k, column in enumerate(values.T)})], []
    )


def _open_npz(path: Path) -> ColumnTable:
    """Read an archive of named arrays; `LogError` if it is none, or unfolds to more than memory allows."""
    packed = read_bytes(path, LogError)
    arrays = dict[str, Any]()
    size = 0
    try:
        with zipfile.ZipFile(io.BytesIO(packed)) as archive:
            for entry in archive.infolist():
                check_size(path, size := size + entry.file_size, LogError)
                with archive.open(
                    entry
                ) as file:  # so many bytes: to its end it may be more than it states
                    content = file.read(entry.file_size)
                arrays[entry.filename.removesuffix(".npy")] = _load_array(
                    content, f"{path}: {entry.filename}"
                )
    except _NPZ_DAMAGE as error:
        raise LogError(
            str(path), f"is a damaged .npz ({error})", "write it again, with numpy.savez"
        ) from error
    return make_table(str(path), *group_streams(arrays))


def _load_array(content: bytes, place: str) -> Array:
    """Return the array of an .npy file's bytes, never a pickle; `LogError` if it is none, or of objects."""
    try:
        return np.lib.format.read_array(io.BytesIO(content), allow_pickle=False)
    except _NPY_DAMAGE as error:
        mend = "write it again with numpy.save: a float64 array, or a record array of numbers"
        raise LogError(place, f"is a damaged .npy, or of Python objects ({error})", mend) from error


# --- Parquet --------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _ParquetColumns(Mapping[str, Array]):
    """The columns of an open `pyarrow.parquet.ParquetFile`, (N,) each, read one at a time when they are asked for."""

    name: str
    file: Any
    names: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.names)

    def __iter__(self) -> Iterator[str]:
        return iter(self.names)

    def __getitem__(self, column: str) -> Array:
        """Return a column as float64, nan where a value is missing; `LogError` if it is damaged or no numbers."""
        return self._to_numbers(column, self._load(column))

    def read_rows(self, column: str, width: int) -> Array:
        """Return a column of numbers, or of lists of so many, as float64, (N, width); `LogError` as above."""
        import pyarrow.compute
        from pyarrow.types import is_fixed_size_list, is_list

        data = self._load(column)
        lengths = [1]
        if is_list(data.type) or is_fixed_size_list(data.type):
            lengths = pyarrow.compute.list_value_length(data).unique().to_pylist()
            data = pyarrow.compute.list_flatten(data)
        if lengths not in ([], [width]):
            what = f"does not hold {width} numbers a row, as its shape says"
            raise LogError(f"{self.name} column '{column}'", what, "write it again")
        return self._to_numbers(column, data).reshape(-1, width)

    def _load(self, column: str) -> Any:
        """Return a column as pyarrow has it."""
        import pyarrow

        try:
            return self.file.read(columns=[column]).column(column)
        except (pyarrow.ArrowException, OSError) as error:
            raise LogError(
                self.name, f"is a damaged Parquet file ({error})", "write it again"
            ) from error

    def _to_numbers(self, column: str, data: Any) -> Array:
        """Return a column's values as float64."""
        import pyarrow
        from pyarrow.types import is_decimal, is_floating, is_integer

        if not (is_integer(data.type) or is_floating(data.type) or is_decimal(data.type)):
            raise LogError(
                f"{self.name} column '{column}'",
                f"holds {data.type}, not numbers",
                "write it as float64",
            )
        return np.array(data.cast(pyarrow.float64(), safe=False).to_numpy(), dtype=np.float64)


def _open_parquet(path: Path) -> ArrayTable:
    """Open a Parquet file as a table; `LogError` if it is missing or is none."""
    return ArrayTable(str(path), _load_parquet(path), row="row")


def _load_parquet(path: Path) -> _ParquetColumns:
    """Open a Parquet file and read its schema; `LogError` if it is missing or is none."""
    parquet = _import_parquet(path)
    import pyarrow

    try:
        file = parquet.ParquetFile(pyarrow.BufferReader(read_bytes(path, LogError)))
    except (pyarrow.ArrowException, OSError, UnicodeDecodeError) as error:
        raise LogError(
            str(path), f"is not Parquet ({error})", "give it the suffix of its format"
        ) from error
    groups = [file.metadata.row_group(k) for k in range(file.num_row_groups)]
    check_size(
        path, sum(max(group.total_byte_size, 8 * group.num_rows) for group in groups), LogError
    )
    return _ParquetColumns(str(path), file, tuple(file.schema_arrow.names))


def _write_parquet(columns: Mapping[str, Array], path: Path) -> None:
    """Write columns of equal length as float64; whole or not at all."""
    parquet = _import_parquet(path)
    import pyarrow

    table = pyarrow.table({name: np.ascontiguousarray(values) for name, values in columns.items()})
    with open_replacement(path) as temporary, wrap_os_errors(path):
        parquet.write_table(table, temporary)


def _import_parquet(path: Path) -> Any:
    """Return pyarrow's Parquet module; `UsageError` says how to install it."""
    try:
        import pyarrow.parquet
    except ImportError as error:
        mend = "install it (pip install 'gimbal_pin[parquet]'), or use CSV"
        raise UsageError(str(path), "is Parquet, which needs the package pyarrow", mend) from error
    return pyarrow.parquet


# --- LeRobot --------------------------------------------------------------------------------------------------------


def _open_lerobot(path: Path) -> ColumnTable:
    """Read a LeRobot data set's folder, version 2 or 3: ``feature.name`` of each number, all episodes in a row.

    ``t`` is ``frame_index / fps`` where `timestamp` says the same, and pauses between episodes. ``meta/info.json``
    names the numbers of a feature; units are the recorder's. Source:
    https://huggingface.co/docs/lerobot/lerobot-dataset-v3.

    Raises:
        LogError: It is damaged, or states no features and frames a second.
        UsageError: pyarrow is not installed.
    """
    files = sorted((path / "data").glob("*/*.parquet"))
    info = read_yaml(path / "meta" / "info.json", LogError)
    features, fps = (
        info.get(key) if isinstance(info, dict) else None for key in ("features", "fps")
    )
    if not (
        files and isinstance(features, dict) and isinstance(fps, (int, float)) and 0 < fps < np.inf
    ):
        what = (
            "is no LeRobot data set: no features or fps in meta/info.json, or no data/*/*.parquet"
        )
        raise LogError(str(path), what, "give the folder of a data set of version 2 or 3")
    tables = [_load_parquet(file) for file in files]
    read, wide = _read_features(path, features, tables)
    if lost := {"timestamp", "frame_index", "episode_index", "index"} - read.keys():
        raise LogError(
            str(path), f"has no column {quote_names(sorted(lost))}", "write it again with LeRobot"
        )
    order = np.argsort(read["index"][:, 0], kind="stable")
    stamp, frame, episode = (
        read[key][order, 0] for key in ("timestamp", "frame_index", "episode_index")
    )
    # LeRobot's own tolerance, and the rounding of its stamps.
    regular = np.all(np.abs(frame / fps - stamp) <= 1e-4 + np.finfo(np.float32).eps * np.abs(stamp))
    t = frame / fps if regular else stamp
    first = np.flatnonzero(np.diff(episode)) + 1
    jumps = np.zeros_like(t)
    jumps[first] = t[first - 1] - t[first] + PAUSE + 1 / fps
    columns = {"t": t + np.cumsum(jumps), "episode_index": episode}
    for key in [
        key
        for key in read
        if key not in ("timestamp", "frame_index", "episode_index", "index", "task_index")
    ]:
        columns |= _name_features(key, features[key].get("names"), read[key][order])
    notes = (
        [f"is {len(first) + 1} episodes, with a pause of {PAUSE:g} s between them"]
        if len(first)
        else []
    )
    stated = info.get("total_frames", len(t))
    notes += (
        [f"holds {len(t)} of {stated} frames: files of data/ are missing"]
        if stated != len(t)
        else []
    )
    notes += [f"left out for more than {WIDEST_ARRAY} numbers: {quote_names(wide)}"] if wide else []
    return make_table(str(path), [Stream("t", columns)], notes)


def _read_features(
    path: Path, features: Mapping[str, Any], tables: Sequence[_ParquetColumns]
) -> tuple[dict[str, Array], list[str]]:
    """Return feature → numbers of all files, (N, k), and which features have too many: neither pictures nor words."""
    read = dict[str, Array]()
    wide = list[str]()
    held = set(tables[0]).intersection(*tables[1:])
    for key, feature in features.items():
        shape, kind = (
            feature.get(name) if isinstance(feature, dict) else None for name in ("shape", "dtype")
        )
        if not str(kind).startswith(("float", "int", "uint")) or key not in held:
            continue
        if not isinstance(shape, list) or len(shape) != 1:
            continue
        if shape[0] not in range(1, WIDEST_ARRAY + 1):
            wide.append(key)
            continue
        rows = [table.read_rows(key, shape[0]) for table in tables]
        check_size(path, 8 * sum(one.size for one in (*rows, *read.values())), LogError)
        read[key] = np.concatenate(rows)
    return read, wide


def _name_features(key: str, names: Any, values: Array) -> dict[str, Array]:
    """Return the numbers of a feature, (N, k), by their names in ``info.json``, or ``key[0]`` where it has none."""
    stated = (
        next(iter(names.values()), None) if isinstance(names, dict) else names
    )  # {"motors": [...]} in version 2
    width = values.shape[1]
    if isinstance(stated, list) and len(set(map(str, stated))) == len(stated) == width:
        return {f"{key}.{name}": values[:, k] for k, name in enumerate(stated)}
    return {f"{key}[{k}]" if width > 1 else key: values[:, k] for k in range(width)}


# --- In a process of its own ----------------------------------------------------------------------------------------


def _open_isolated(reader: str, path: Path) -> ColumnTable:
    """Return the table of a file that one of `_ISOLATED` reads.

    Raises:
        LogError: The file is missing or damaged, or reading it takes more time or memory than it may.
        UsageError: The package is not installed.
    """
    kind, module, extra, _ = _ISOLATED[reader]
    if find_spec(module) is None:
        mend = f"install it (pip install 'gimbal_pin[{extra}]'), or write CSV"
        raise UsageError(str(path), f"is {kind}, which needs the package {module}", mend)
    with wrap_read_errors(path, LogError):
        parts = list(path.iterdir()) if path.is_dir() else [path]
        size = sum(file.stat().st_size for file in parts)
    if not all(file.is_file() or file.is_dir() for file in parts):
        raise LogError(
            str(path),
            f"is {kind} that is no file",
            "give the path of a file: it is not read from a pipe",
        )
    streamed = (
        size if reader == "bag" else 0
    )  # a bag may be larger than memory: of its messages only numbers are kept
    check_size(path, size - streamed, LogError)
    bounds: dict[str, Any] = {
        "memory": _READER_MEMORY + streamed,
        "seconds": _READER_SECONDS + size / _READER_RATE,
    }
    with TemporaryDirectory() as folder:
        try:
            found = run_bounded(__name__, reader, str(path.resolve()), folder, **bounds)
        except ProcessStopped as error:
            mend = "write it again, or give a shorter file"
            raise LogError(str(path), f"is {kind} that cannot be read ({error})", mend) from error
        if "wrong" in found:
            raise LogError(str(path), *found["wrong"])
        streams = [
            Stream(time, dict(zip(names, np.load(Path(folder, f"{k}.npy"), allow_pickle=False))))
            for k, (time, names) in enumerate(found["streams"])
        ]
    return make_table(str(path), streams, found["notes"])


def main(reader: str, path: str, folder: str) -> dict[str, Any]:
    """Write the streams that a reader finds into a folder, ``k.npy``, a row per column; return names and notes.

    An error of the package's own is returned in words.
    """
    try:
        streams, notes = _ISOLATED[reader].read(Path(path))
        values = [column for _, columns in streams for column in columns.values()]
        check_size(path, 8 * sum(map(len, values)), LogError)
    except GimbalPinError as error:
        return {"wrong": [error.what, error.mend]}
    for k, (_, columns) in enumerate(streams):
        np.save(
            Path(folder, f"{k}.npy"),
            np.array(list(columns.values()), dtype=np.float64),
            allow_pickle=False,
        )
    return {"streams": [[time, list(columns)] for time, columns in streams], "notes": list(notes)}


def _open_mat(path: Path) -> ColumnTable:
    """Read a MATLAB file, to version 7 or, as _HDF5 behind a header of 512 bytes or none, of 7.3."""
    head = read_beginning(path, 520)
    return _open_isolated("hdf5" if _HDF5 in (head[:8], head[512:]) else "mat", path)


def _read_mat(path: Path) -> Streams:
    """Return the streams of real numbers, those in structures as ``structure.field``; SciPy's errors of damage."""
    from scipy.io import loadmat, whosmat

    check_size(
        path, sum(8 * prod(shape) for _, shape, kind in whosmat(path) if kind != "sparse"), LogError
    )
    return group_streams(
        {k: v for k, v in loadmat(path, simplify_cells=True).items() if not k.startswith("__")}
    )


def _read_hdf5(path: Path) -> Streams:
    """Return the streams of real numbers, those in groups as ``group.name``; h5py's errors of damage."""
    import h5py

    with h5py.File(path, "r") as file:
        return group_streams(_hdf5_arrays(file))


def _hdf5_arrays(group: Any, depth: int = 0) -> dict[str, Any]:
    """Return name → array or group of an _HDF5 group: no links, which may lead anywhere, nothing of MATLAB's own."""
    import h5py

    found: dict[str, Any] = {}
    for name in group:
        if name.startswith("#") or not isinstance(group.get(name, getlink=True), h5py.HardLink):
            continue
        inner = group[name]
        if isinstance(inner, h5py.Group) and depth < DEEPEST_NESTING:
            found[name] = _hdf5_arrays(inner, depth + 1)
        elif isinstance(inner, h5py.Dataset) and (inner.dtype.names or inner.dtype.kind in "biuf"):
            check_size(group.file.filename, inner.nbytes, LogError)
            found[name] = inner[()]
    return found


def _read_ulog(path: Path) -> Streams:
    """Return a stream per topic and instance, ``topic_1.field`` for the second; pyulog's errors of damage."""
    from pyulog import ULog

    log = ULog(str(path))
    found = list[Stream]()
    for topic in log.data_list:
        name = f"{topic.name}_{topic.multi_id}" if topic.multi_id else topic.name
        columns = {f"{name}.{field}": values for field, values in topic.data.items()}
        time = f"{name}.timestamp"
        found.append(Stream(time, {**columns, time: topic.data["timestamp"] / 1e6}))
    notes = ["is damaged: what could be read of it is used"] if log.file_corruption else []
    if log.dropouts:
        notes.append(
            f"{len(log.dropouts)} dropouts of {sum(dropout.duration for dropout in log.dropouts)} ms in all"
        )
    return found, notes


def _read_bag(path: Path) -> Streams:
    """Return a stream per topic and set of fields, in order of time; rosbags' errors of damage.

    A message's time is its header's stamp, or when it was recorded. A JointState gives the columns q_<joint>,
    dq_<joint> and tau_<joint>, an Imu those of the link that its header's frame names, any other message every number
    as ``/topic.field``, by the definition in the bag.
    """
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    found: dict[tuple[str, tuple[str, ...]], tuple[list[int], dict[str, array[float]]]] = {}
    with TemporaryDirectory() as folder:
        if path.is_file():
            head = read_beginning(path, 16)
            suffix = next(
                (suffix for magic, suffix in _BAG_SUFFIXES.items() if head.startswith(magic)),
                path.suffix,
            )
            (link := Path(folder, f"bag{suffix}")).symlink_to(path)
            path = link
        with AnyReader([path], default_typestore=get_typestore(Stores.LATEST)) as bag:
            known = [
                connection
                for connection in bag.connections
                if connection.msgtype in bag.typestore.fielddefs
            ]
            lost = sorted(
                {connection.topic for connection in bag.connections if connection not in known}
            )
            for connection, recorded, content in bag.messages(known) if known else ():
                if len(content) > _LARGEST_MESSAGE:
                    continue
                message = bag.deserialize(content, connection.msgtype)
                values = dict(_message_values(message, connection.msgtype, connection.topic))
                if not values:
                    continue
                stamp = getattr(getattr(message, "header", None), "stamp", None)
                # The order of the joints may change from message to message.
                stamps, columns = found.setdefault(
                    (connection.topic, tuple(sorted(values))), ([], {})
                )
                stamps.append((stamp and int(stamp.sec) * 10**9 + int(stamp.nanosec)) or recorded)
                for name, value in values.items():
                    columns.setdefault(name, array("d")).append(value)
    notes = [f"no definition of the types of {quote_names(lost)}: left out"] if lost else []
    start = min((min(stamps) for stamps, _ in found.values()), default=0)
    late = max((max(stamps) for stamps, _ in found.values()), default=0) >= _EXACT_NANOSECONDS
    start = (start - start % 10**9) * late
    if start:
        notes.insert(0, f"its times count from {start // 10**9} s since 1970")
    joints_first = sorted(
        found.items(), key=lambda item: not any(name.startswith("q_") for name in item[0][1])
    )
    streams = list[Stream]()
    chosen = choose_names([(topic, [*columns]) for (topic, _), (_, columns) in joints_first])
    for (label, names), (_, (stamps, columns)) in zip(chosen, joints_first):
        time = "t" if len(found) == 1 else f"{label}.t"
        rows = np.argsort(stamps, kind="stable")
        data = {time: (np.array(stamps)[rows] - start) / 1e9}
        data |= {names[name]: np.array(series)[rows] for name, series in columns.items()}
        streams.append(drop_empty_columns(Stream(time, data)))
    return streams, notes


def _message_values(message: Any, kind: str, topic: str) -> Iterator[tuple[str, float]]:
    """Yield name and value of every number in a message."""
    if kind == "sensor_msgs/msg/JointState":
        yield from list_joint_values(message.name, vars(message))
    elif kind == "sensor_msgs/msg/Imu" and message.header.frame_id:
        for field, prefix in _IMU_MESSAGE_COLUMNS.items():
            if (
                getattr(message, f"{field}_covariance")[0] != -1
            ):  # by its definition: no estimate of this one
                of = getattr(message, field)
                axes = "wxyz" if prefix == "quat" else "xyz"
                yield from (
                    (f"{prefix}_{message.header.frame_id}_{axis}", getattr(of, axis))
                    for axis in axes
                )
    else:
        yield from _flat_values(message, topic)


def _flat_values(value: Any, name: str, depth: int = 0) -> Iterator[tuple[str, float]]:
    """Yield ``name.field`` and ``name[k]`` of the numbers in a message."""
    if isinstance(value, (bool, int, float, np.number)):
        yield name, float(value)
    elif is_dataclass(value) and depth < DEEPEST_NESTING:
        for field in fields(value):
            if not field.name.startswith("__"):
                yield from _flat_values(
                    getattr(value, field.name), f"{name}.{field.name}", depth + 1
                )
    elif isinstance(value, (list, np.ndarray)) and len(value) <= WIDEST_ARRAY:
        for k, inner in enumerate(value):
            yield from _flat_values(inner, f"{name}[{k}]", depth + 1)


# --- The table ------------------------------------------------------------------------------------------------------


class Isolated(NamedTuple):
    """A format that is read in a process of its own: what it is called, the package, its extra, and the reader."""

    kind: str
    package: str
    extra: str
    read: Callable[[Path], Streams]


_ISOLATED: Mapping[str, Isolated] = {
    "mat": Isolated("a .mat", "scipy", "mat", _read_mat),
    "hdf5": Isolated("an _HDF5 or MATLAB 7.3 file", "h5py", "mat", _read_hdf5),
    "ulog": Isolated("a PX4 ULog", "pyulog", "px4", _read_ulog),
    "tlog": Isolated("a MAVLink log", "pymavlink", "mavlink", read_tlog),
    "bag": Isolated("a ROS bag", "rosbags", "ros", _read_bag),
}


class Format(NamedTuple):
    """One file format.

    Attributes:
        open: Reads what is needed to know a file's columns.
        write: Writes columns to a file, whole or not at all; None for formats that are only read.
        magic: How its files begin, where that distinguishes them from all others.
    """

    open: Callable[[Path], ColumnTable]
    write: Callable[[Mapping[str, Array], Path], None] | None = None
    magic: tuple[bytes, ...] = ()


FORMATS: Mapping[str, Format] = {
    ".csv": Format(_open_text, write_csv),
    ".tsv": Format(_open_text, partial(write_csv, separator="\t")),
    ".txt": Format(_open_text, write_csv),
    ".parquet": Format(_open_parquet, _write_parquet, (b"PAR1",)),
    ".gz": Format(_open_text, magic=(GZIP_MAGIC,)),
    ".log": Format(_open_text),
    ".dat": Format(_open_text),
    ".json": Format(open_json, magic=(b'{"', b"{\n", b"{\r", b"{ ", b"[{", b"[\n")),
    ".jsonl": Format(open_json),
    ".ndjson": Format(open_json),
    ".candump": Format(open_candump, magic=CANDUMP_MAGIC),
    ".npy": Format(_open_npy, magic=(b"\x93NUMPY",)),
    ".npz": Format(_open_npz, magic=(b"PK\3\4",)),
    ".mat": Format(_open_mat, magic=(b"MATLAB 5.0", b"MATLAB 7.3", _HDF5)),
    ".h5": Format(_open_mat),
    ".hdf5": Format(_open_mat),
    **{
        suffix: Format(partial(_open_isolated, "bag"), magic=(magic,))
        for magic, suffix in _BAG_SUFFIXES.items()
    },
    ".tlog": Format(partial(_open_isolated, "tlog")),
    ".ulg": Format(partial(_open_isolated, "ulog"), magic=(b"ULog\x01\x12\x35",)),
}
"""Suffix → format."""
GROWING = (".csv", ".tsv", ".txt")
"""Suffixes of formats that can be read while they are written."""
