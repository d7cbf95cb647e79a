"""CSV: read with the separator, quotes, comments and line ends that loggers and spreadsheets leave; written exactly."""

from __future__ import annotations

import csv
import gzip
import io
import math
import re
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import ClassVar

import numpy as np

from gimbal_pin.errors import LogError, visible
from gimbal_pin.log.io.files import open_replacement, wrap_os_errors
from gimbal_pin.log.log import Array
from gimbal_pin.rig.reading import LARGEST_LOG, check_size, read_bytes

COMMENT_LINE = re.compile(rb"(?m)^[ \t]*#.*$")
_SPACES = re.compile(rb"(?m)^ +| +(?=\r?$)|( +)")
_FOC_COLUMNS = {
    4: ("target", "voltage.q", "velocity", "angle"),
    7: ("target", "voltage.q", "voltage.d", "current.q_ma", "current.d_ma", "velocity", "angle"),
}
"""What ``motor.monitor()`` writes by default and at most (docs.simplefoc.com/monitoring)."""
GZIP_MAGIC = b"\x1f\x8b"
BLOCK = 1 << 22  # bytes read at a time
LONGEST_LINE = 1 << 22  # bytes that no row has: 100 000 columns of 20 digits are 2.1 MB


@dataclass(frozen=True, eq=False)
class CsvTable:
    """A CSV file of which the header is known and the rows are text still.

    Attributes:
        name: The file's path.
        columns: Names in the header; ``column1, column2, …`` where the file starts with numbers.
        separator: What stands between values.
        body: What follows the header.
        first: Number of the body's first line in the file, from 1.
        spaced: Whether spaces stand between values: read as tabs.
    """

    notes: ClassVar[Sequence[str]] = ()

    name: str
    columns: tuple[str, ...]
    separator: str
    body: bytes
    first: int
    spaced: bool = False

    def read(self, columns: Sequence[str]) -> dict[str, Array]:
        """Return the named columns, (N,) each; `LogError` names the line and column of the first flaw.

        Read in parts of about `BLOCK` bytes, cut at line ends (whole where a quoted field may hold a line end): a flaw
        is then looked for in one part only, and what is read at a time stays small.
        """
        from tqdm import tqdm

        index = {column: self.columns.index(column) for column in columns}
        arrays, line, start = [], self.first, 0
        size = len(self.body) if b'"' in self.body else BLOCK
        bar = tqdm(desc=visible(self.name), total=len(self.body), unit="B", unit_scale=True, delay=2, disable=None)
        with bar:
            while start < len(self.body):
                end = self.body.find(b"\n", start + size) + 1 or len(self.body)
                body = self.body[start:end]
                # Where a part is cut, its last line is the one that is too long.
                begin = body.rfind(b"\n", 0, len(body) - 1) + 1
                _check_length(f"{self.name}:{line + body[:begin].count(10)}", len(body) - begin)
                part = replace(self, body=self._plain(body), first=line)
                if part.body.strip():
                    arrays.append(part._numbers(index))
                bar.update(end - start)
                start, line = end, line + body.count(b"\n")
        if not arrays:
            raise LogError(f"{self.name}:{self.first}", "has a header but no rows", "give a file with samples")
        return {column: np.concatenate([array[place] for array in arrays]) for column, place in index.items()}

    def _plain(self, body: bytes) -> bytes:
        """Return rows without comments, with tabs where spaces stand between the values."""
        body = COMMENT_LINE.sub(b"", body) if b"#" in body else body
        return _SPACES.sub(lambda found: b"\t" if found[1] else b"", body) if self.spaced else body

    def _numbers(self, index: Mapping[str, int]) -> dict[int, Array]:
        """Return column number → values by pandas' C parser, nan where they are missing; `LogError` at the first flaw.

        From 3.1 on, pandas parses exactly by itself and warns of the argument; before, exactness has to be asked for.
        """
        import pandas

        exact = (
            {} if tuple(map(int, pandas.__version__.split(".")[:2])) >= (3, 1) else {"float_precision": "round_trip"}
        )
        if _is_uneven(self.body, self.separator, len(self.columns)):
            self._check(index)
        try:
            frame = pandas.read_csv(
                io.BytesIO(self.body),
                sep=self.separator,
                header=None,
                usecols=sorted(index.values()),
                index_col=False,
                dtype=np.float64,
                keep_default_na=False,
                na_values=["", "nan", "NaN", "NAN"],
                skipinitialspace=True,
                encoding_errors="replace",
                low_memory=False,
                engine="c",
                **exact,
            )
            if np.isinf(frame.to_numpy()).any():
                raise ValueError("a value is not finite")
        except ValueError as error:
            self._check(index)
            place = f"{self.name}: rows from line {self.first}"
            what = f"are not the CSV that they seem ({error})"
            raise LogError(place, what, "write one row of plain numbers a line") from error
        return {place: frame[place].to_numpy() for place in index.values()}

    def place(self, row: int, column: str) -> str:
        """Return ``file:line column 'name'`` of a sample, lines counted as an editor does."""
        line, _ = next(islice(self._records(), row, None))
        return f"{self.name}:{line} column '{column}'"

    def _records(self) -> Iterator[tuple[int, list[str]]]:
        """Yield (line number, fields) of every row that is not blank. Slow: for finding the place of an error."""
        text = io.TextIOWrapper(io.BytesIO(self._plain(self.body)), encoding="utf-8", errors="replace", newline="")
        reader = csv.reader(text, delimiter=self.separator, skipinitialspace=True)
        line = self.first
        try:
            for fields in reader:
                if len(fields) > 1 or any(field.strip() for field in fields):
                    yield line, fields
                line = self.first + reader.line_num
        except csv.Error as error:
            raise LogError(f"{self.name}:{line}", f"is not CSV ({error})", "mend the quotes there") from error

    def _check(self, index: Mapping[str, int]) -> None:
        """Raise `LogError` at the first row of another width than the header or with a flaw in the columns `index`."""
        width = len(self.columns)
        for line, fields in self._records():
            if len(fields) < width or any(field.strip() for field in fields[width:]):
                mend = "quote or delete the surplus" + "; decimal commas must be points" * (self.separator == ",")
                if len(fields) < width:
                    mend = "complete the row, or delete it (a recording that was cut off ends so)"
                what = f"has {len(fields)} values under {width} column names"
                raise LogError(f"{self.name}:{line}", what, mend)
            for column, place in index.items():
                if found := _find_flaw(fields[place].strip()):
                    raise LogError(f"{self.name}:{line} column '{column}'", *found)


def open_csv(path: Path) -> CsvTable:
    """Read a CSV file and its header: the first line that is neither blank nor a ``#`` comment.

    Where that line holds numbers only, the names stand in the comment before it (as `numpy.savetxt` writes them), are
    those of SimpleFOC's monitor behind its messages, or ``column1, column2, …``.

    Raises:
        LogError: The file is missing, empty, binary, or has one column only.
    """
    data = read_bytes(path, LogError)
    if data.startswith(GZIP_MAGIC):
        data = unzip(data, str(path))
    found = read_header(str(path), decode_utf8(data))
    if found is None:
        raise LogError(str(path), "is empty", "give a file with a header and one row per sample")
    return found


def unzip(data: bytes, name: str, most: int = LARGEST_LOG) -> bytes:
    """Return what gzip packed; `LogError` where it is damaged or unfolds to more than `most` bytes."""
    parts, size = list[bytes](), 0
    try:
        with gzip.open(io.BytesIO(data)) as file:
            while part := file.read(BLOCK):
                parts.append(part)
                check_size(name, size := size + len(part), LogError, most)
    except (OSError, EOFError, zlib.error) as error:
        raise LogError(name, f"is a damaged gzip file ({error})", "pack it again") from error
    return b"".join(parts)


def decode_utf8(data: bytes) -> bytes:
    """Return text without its byte order mark, UTF-16 turned to UTF-8, lone carriage returns to line feeds."""
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        data = data.decode("utf-16", errors="replace").encode()
    data = data.removeprefix(b"\xef\xbb\xbf")
    return data if b"\n" in data else data.replace(b"\r", b"\n")


def read_header(name: str, data: bytes) -> CsvTable | None:
    """Return the table that starts with `data`, whole lines; None where these hold neither header nor row."""
    if b"\0" in data[:4096]:
        raise LogError(name, "is binary, not CSV", "give it the suffix of its format")
    remark, start, number = "", 0, 0
    while start < len(data):
        number, end = number + 1, data.find(b"\n", start) + 1 or len(data)
        try:
            line = data[start:end].decode("utf-8").rstrip("\r\n")
        except UnicodeDecodeError:
            line = data[start:end].decode("latin-1").rstrip("\r\n")
        if line.lstrip().startswith("#"):
            remark = line.lstrip().lstrip("#")
        elif line.startswith(("MOT:", "CS:")):  # what SimpleFOC writes before its numbers
            remark = "MOT:"
        elif line.strip():
            break
        start = end
    else:
        return None
    _check_length(f"{name}:{number}", end - start)
    separator = max((";", "\t", ","), key=re.sub('"[^"]*"', "", line).count)
    fields = _split_fields(line, separator)
    if spaced := len(fields) < 2:
        separator, fields = "\t", _split_fields(line.strip(), " ")
    if len(fields) < 2:
        raise LogError(f"{name}:{number}", "has one column only", "separate columns by commas, semicolons or tabs")
    if any(_parse_number(field) is None for field in fields if field):
        units, after = _read_units_line(data, end, len(fields), " " if spaced else separator)
        names = [f"{field}_{unit}" if unit else field for field, unit in zip(fields, units)] or fields
        return CsvTable(name, tuple(names), separator, data[after:], number + 1 + (after > end), spaced)
    foc = _FOC_COLUMNS.get(len(fields), ()) if remark == "MOT:" else ()
    names = list(foc) or _split_fields(remark.strip(), " " if spaced else separator)
    if len(names) != len(fields):
        names = [f"column{i + 1}" for i in range(len(fields))]
    return CsvTable(name, tuple(names), separator, data[start:], number, spaced)


def _read_units_line(data: bytes, start: int, width: int, separator: str) -> tuple[list[str], int]:
    """Return the words in a line of nothing but ``[unit]`` at `start`, '' for the others, and where it ends; or none.

    STorM32's loggers write one below the names.
    """
    end = data.find(b"\n", start) + 1 or len(data)
    if end - start > LONGEST_LINE or not data.startswith(b"[", start):
        return [], start
    fields = _split_fields(data[start:end].decode("utf-8", "replace").rstrip("\r\n"), separator)
    if len(fields) != width or not all(re.fullmatch(r"\[.*\]", field) for field in fields):
        return [], start
    plain = ("", "int", "uint", "hex")
    units = [field[1:-1].strip() for field in fields]
    return [unit if re.fullmatch(r"\w+", unit) and unit not in plain else "" for unit in units], end


def _check_length(place: str, length: int) -> None:
    """Raise `LogError` for a line of more bytes than a row of numbers may have."""
    if length > LONGEST_LINE:
        raise LogError(place, f"has a line of {length / 1e6:.3g} MB", "write one row of plain numbers a line")


def _split_fields(line: str, separator: str) -> list[str]:
    """Return the trimmed fields of one line; quotes around them go."""
    try:
        fields = next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])
    except csv.Error:
        return [line]
    return [field.strip() for field in fields]


def _is_uneven(body: bytes, separator: str, width: int) -> bool:
    """Whether any line that is not blank has another number of separators than ``width - 1`` (quotes ignored)."""
    mark = separator.encode()
    return any(line.count(mark) != width - 1 for line in body.split(b"\n") if line.strip(b" \r"))


def _find_flaw(field: str) -> tuple[str, str] | None:
    """Return what is wrong with a number's text and the mend; None for a number, or where it is missing."""
    value = _parse_number(field)
    if not field or (value is not None and not math.isinf(value)):
        return None
    if value is not None:
        return f"is {field}", "repair the value, or delete the row"
    if re.fullmatch(r"[+-]?\d*,\d+(?:[eE][+-]?\d+)?", field):
        return f"has a decimal comma ({field})", "write decimal points"
    return f"holds the text '{field[:40]}'", "write a number, or leave the row out"


def _parse_number(field: str) -> float | None:
    """Return the number that a field spells, or None; ``1_000`` and digits of other scripts are none."""
    try:
        return None if "_" in field or not field.isascii() else float(field)
    except ValueError:
        return None


def write_csv(columns: Mapping[str, Array], path: Path, separator: str = ",") -> None:
    """Write columns of equal length, the numbers in the shortest form that reads back exactly; whole or not at all."""
    header = separator.join(map(_quote_name, columns))
    values = np.column_stack(list(columns.values()))
    with open_replacement(path) as new, wrap_os_errors(path), new.open("w", encoding="utf-8", newline="") as file:
        file.write(f"{header}\n")
        for part in np.array_split(values, len(values) // 2**14 + 1):  # Python's numbers take four times the memory
            file.writelines(separator.join(map(repr, row)) + "\n" for row in part.tolist())


def _quote_name(name: str) -> str:
    """Return a column's name in quotes where it holds a quote or a separator that `read_header` knows."""
    return '"{}"'.format(name.replace('"', '""')) if set(name) & set('",;\t') else name
