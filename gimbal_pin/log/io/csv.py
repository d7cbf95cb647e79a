"""CSV: read with the separator, quotes, comments and line ends that loggers and spreadsheets leave; written exactly."""

from __future__ import annotations

import csv
import gzip
import io
import math
import re
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from gimbal_pin.errors import LogError, visible
from gimbal_pin.log.io.files import open_replacement, wrap_os_errors
from gimbal_pin.log.io.stamps import is_date, is_stamp, parse_stamps, unwrap_midnight
from gimbal_pin.log.log import Array
from gimbal_pin.rig.reading import LARGEST_LOG, check_size, read_bytes

if TYPE_CHECKING:
    import pandas

COMMENT_LINE = re.compile(rb"(?m)^[ \t]*#.*$")
_SPACES = re.compile(rb"(?m)^ +| +(?=\r?$)|( +)")
_FOC_COLUMNS = {
    4: ("target", "voltage.q", "velocity", "angle"),
    7: ("target", "voltage.q", "voltage.d", "current.q_ma", "current.d_ma", "velocity", "angle"),
}
"""What ``motor.monitor()`` writes by default and at most (docs.simplefoc.com/monitoring)."""
GZIP_MAGIC: bytes = b"\x1f\x8b"
BLOCK = 1 << 22  # bytes read at a time
LONGEST_LINE = 1 << 22  # bytes that no row has: 100 000 columns of 20 digits are 2.1 MB
_SI_COLUMN = re.compile(r"t|(?:q|dq|ddq|tau|q_ref|temp)_.+")
_PREAMBLE_LINES = 200
"""Most lines before the header; loggers write a few dozen settings there."""
_DECIMAL_COMMA = re.compile(rb"(?m)(?:^|[;\t ])[ ]*[+-]?\d*,\d")
_UNIT = re.compile(
    r"\[[^\[\]]*\]|\([^()]*\)|[numµμk]?(?:s|sec|rad|deg|[AVgNG%°-]|Nm|N ?m|N·m|Hz|°C|rpm)(?:/s(?:\^?2|²)?)?|"
)
"""What stands for one column in a line of units below the names: in brackets, or a usual unit."""


@dataclass(frozen=True, eq=False)
class CsvTable:
    """A CSV file of which the header is known and the rows are text still.

    Attributes:
        name: The file's path.
        columns: Names in the header; ``column1, column2, …`` where the file starts with numbers.
        separator: What stands between values.
        text: The file's text, or a part of it.
        first: Number of the first row's line in the file, from 1.
        begin: Byte of `text` where the first row begins. Rows are not copied out: a text may fill half of the memory.
        spaced: Whether spaces stand between values: read as tabs.
        decimal: What stands before a number's fraction, a point or a comma.
        stamps: Places of the columns of dates and times of day, read as seconds.
        date: Place of the column of dates that belongs to a column of times of day; -1 where there is none.
        notes: What was left out.
    """

    name: str
    columns: tuple[str, ...]
    separator: str
    text: bytes
    first: int
    begin: int = 0
    spaced: bool = False
    decimal: str = "."
    stamps: tuple[int, ...] = ()
    date: int = -1
    notes: Sequence[str] = ()

    @property
    def body(self) -> bytes:
        """The text of the rows."""
        return self.text[self.begin :]

    def read(self, columns: Sequence[str]) -> dict[str, Array]:
        """Return the named columns, (N,) each; `LogError` names the line and column of the first flaw.

        Read in parts of about `BLOCK` bytes, cut at line ends (whole where a quoted field may hold a line end): a flaw
        is then looked for in one part only, and what is read at a time stays small.
        """
        from tqdm import tqdm

        index = {column: self.columns.index(column) for column in columns}
        # As many rows as there are lines, some of them blank: no part is held twice. One array per column: the caller
        # frees each as soon as it is converted.
        text = self.text
        values = {column: np.empty(text.count(b"\n", self.begin) + 1) for column in index}
        count = 0
        line = self.first
        start = self.begin
        size = BLOCK if text.find(b'"', self.begin) < 0 else len(text)
        bar = tqdm(
            desc=visible(self.name),
            total=len(text) - self.begin,
            unit="B",
            unit_scale=True,
            delay=2,
            disable=None,
        )
        with bar:
            while start < len(text):
                end = text.find(b"\n", start + size) + 1 or len(text)
                body = text[start:end]
                # Where a part is cut, its last line is the one that is too long.
                begin = body.rfind(b"\n", 0, len(body) - 1) + 1
                _check_length(f"{self.name}:{line + body[:begin].count(10)}", len(body) - begin)
                part = replace(self, text=self._plain(body), first=line, begin=0)
                if part.text.strip():
                    numbers = part._numbers(index)
                    rows = slice(count, count + len(next(iter(numbers.values()))))
                    for column, place in index.items():
                        values[column][rows] = numbers[place]
                    count = rows.stop
                bar.update(end - start)
                start = end
                line = line + body.count(b"\n")
        if not count:
            raise LogError(
                f"{self.name}:{self.first}", "has a header but no rows", "give a file with samples"
            )
        return {
            column: unwrap_midnight(x[:count]) if index[column] in self.stamps else x[:count]
            for column, x in values.items()
        }

    def _plain(self, body: bytes) -> bytes:
        """Return rows without comments, with tabs where spaces stand between the values."""
        body = COMMENT_LINE.sub(b"", body) if b"#" in body else body
        return _SPACES.sub(lambda found: b"\t" if found[1] else b"", body) if self.spaced else body

    def _numbers(self, index: Mapping[str, int]) -> dict[int, Array]:
        """Return place → values of columns, nan where they are missing; `LogError` at the first flaw."""
        if _is_uneven(self.body, self.separator, len(self.columns)):
            self._check(index)
        places = set(index.values())
        if self.date >= 0 and places & {*self.stamps}:
            places.add(self.date)
        try:
            frame = self.parse(places)
            values = {place: frame[place].to_numpy() for place in places - {*self.stamps}}
            if any(np.isinf(x).any() for x in values.values()):
                raise ValueError("a value is not finite")
            values |= {place: parse_stamps(frame[place]) for place in places & {*self.stamps}}
        except ValueError as error:
            self._check(index)
            place = f"{self.name}: rows from line {self.first}"
            what = f"are not the CSV that they seem ({error})"
            raise LogError(place, what, "write one row of plain numbers a line") from error
        if self.date in places:
            values |= {
                place: values[self.date] + x for place, x in values.items() if place in self._clocks
            }
        return values

    @property
    def _clocks(self) -> set[int]:
        """Places of the columns of times of day to which the dates of another column are added."""
        return {*self.stamps} - {self.date} if self.date >= 0 else set()

    def parse(self, places: Iterable[int], texts: bool = False) -> pandas.DataFrame:
        """Return columns by place, as numbers or, where they are stamps or `texts` is set, as texts.

        From 3.1 on, pandas parses exactly by itself and warns of the argument; before, exactness has to be asked for.
        """
        import pandas

        exact = (
            {}
            if tuple(map(int, pandas.__version__.split(".")[:2])) >= (3, 1)
            else {"float_precision": "round_trip"}
        )
        types = {
            place: object if texts or place in self.stamps else np.float64
            for place in sorted(places)
        }
        return pandas.read_csv(
            io.BytesIO(self._plain(self.body) if texts else self.body),
            sep=self.separator,
            header=None,
            usecols=list(types),
            index_col=False,
            dtype=types,
            decimal=self.decimal,
            keep_default_na=False,
            na_values={
                place: ["", "nan", "NaN", "NAN"]
                for place, kind in types.items()
                if kind is np.float64
            },
            skipinitialspace=True,
            encoding_errors="replace",
            low_memory=False,
            engine="c",
            **exact,
        )

    def place(self, row: int, column: str) -> str:
        """Return ``file:line column 'name'`` of a sample, lines counted as an editor does."""
        line, _ = next(islice(self._records(), row, None))
        return f"{self.name}:{line} column '{column}'"

    def _records(self) -> Iterator[tuple[int, list[str]]]:
        """Yield (line number, fields) of every row that is not blank. Slow: for finding the place of an error."""
        text = io.TextIOWrapper(
            io.BytesIO(self._plain(self.body)), encoding="utf-8", errors="replace", newline=""
        )
        reader = csv.reader(text, delimiter=self.separator, skipinitialspace=True)
        line = self.first
        try:
            for fields in reader:
                if len(fields) > 1 or any(field.strip() for field in fields):
                    yield line, fields
                line = self.first + reader.line_num
        except csv.Error as error:
            raise LogError(
                f"{self.name}:{line}", f"is not CSV ({error})", "mend the quotes there"
            ) from error

    def _check(self, index: Mapping[str, int]) -> None:
        """Raise `LogError` at the first row of another width than the header or with a flaw in the columns `index`."""
        width = len(self.columns)
        for line, fields in self._records():
            if len(fields) < width or any(field.strip() for field in fields[width:]):
                mend = "quote or delete the surplus" + "; decimal commas must be points" * (
                    self.separator == ","
                )
                if len(fields) < width:
                    mend = "complete the row, or delete it (a recording that was cut off ends so)"
                what = f"has {len(fields)} values under {width} column names"
                raise LogError(f"{self.name}:{line}", what, mend)
            for column, place in index.items():
                field = fields[place].strip()
                if place in self.stamps and is_stamp(field):
                    continue
                if found := _find_flaw(field, self.decimal):
                    raise LogError(f"{self.name}:{line} column '{column}'", *found)


def open_csv(path: Path) -> CsvTable:
    """Read a CSV file and its header: the first line, neither blank nor a ``#`` comment, above rows of its width.

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
    parts = list[bytes]()
    size = 0
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
    lines = list(islice(_list_lines(name, data), _PREAMBLE_LINES))
    if not lines:
        return None
    rows = [_split_line(line.text) for line in lines]
    k = _find_header(rows)
    line = lines[k]
    (separator, fields) = rows[k]
    if len(fields) < 2:
        place = f"{name}:{line.number}"
        raise LogError(
            place, "has one column only", "separate columns by commas, semicolons or tabs"
        )
    spaced = separator == " "
    first = line.number
    start = line.start
    names = fields
    sample = rows[k][1]
    if echoed := _list_echoed_columns(fields):
        names = echoed
    elif any(not _is_value(field) for field in fields):
        first = line.number + 1
        start = line.end
        below = lines[k + 1 : k + 2]
        if units := _read_units_line(below[0].text, separator, len(fields)) if below else []:
            first = below[0].number + 1
            start = below[0].end
            names = [_add_unit(field, unit) for field, unit in zip(fields, units)]
        after = next((row for line, row in zip(lines, rows) if line.start >= start), None)
        sample = after[1] if after is not None else []
    else:
        foc = _FOC_COLUMNS.get(len(fields), ()) if line.remark == "MOT:" else ()
        names = list(foc) or _split_fields(line.remark.strip(), separator)
        if len(names) != len(fields):
            names = [f"column{i + 1}" for i in range(len(fields))]
    stamps = tuple(i for i, field in enumerate(sample[: len(names)]) if is_stamp(field))
    dates = [i for i in stamps if is_date(sample[i])]
    notes = (
        (f"{name}: lines 1 to {line.number - 1} stand before the table and are left out",)
        if k
        else ()
    )
    return CsvTable(
        name,
        tuple(names),
        "\t" if spaced else separator,
        data,
        first,
        start,
        spaced,
        ","
        if separator != "," and _DECIMAL_COMMA.search(data, start, start + LONGEST_LINE)
        else ".",
        stamps,
        dates[0] if 0 < len(dates) < len(stamps) else -1,
        notes,
    )


class _Line(NamedTuple):
    """A line that is neither blank nor a comment: its number, where it stands, and the last comment before it."""

    number: int
    start: int
    end: int
    text: str
    remark: str


def _list_lines(name: str, data: bytes) -> Iterator[_Line]:
    """Yield the lines of a table's text, up to the first, if any, that is longer than a row may be."""
    remark, end, number = "", 0, 0
    while end < len(data):
        start = end
        number = number + 1
        end = data.find(b"\n", start) + 1 or len(data)
        if end - start > LONGEST_LINE and number > 1:
            return
        _check_length(f"{name}:{number}", end - start)
        line = data[start:end]
        try:
            text = line.decode("utf-8").rstrip("\r\n")
        except UnicodeDecodeError:
            text = line.decode("latin-1").rstrip("\r\n")
        if text.lstrip().startswith("#"):
            remark = text.lstrip().lstrip("#")
        elif text.startswith(("MOT:", "CS:")):  # what SimpleFOC writes before its numbers
            remark = "MOT:"
        elif text.strip():
            yield _Line(number, start, end, text, remark)


def _split_line(line: str) -> tuple[str, list[str]]:
    """Return the separator of a line, a space where there is no other, and its fields."""
    separator = max((";", "\t", ","), key=re.sub('"[^"]*"', "", line).count)
    for other in (";", "\t"):  # decimal commas may outnumber the separators
        if other in line and all(_is_value(field) for field in _split_fields(line, other)):
            separator = other
    fields = _split_fields(line, separator)
    return (separator, fields) if len(fields) > 1 else (" ", _split_fields(line.strip(), " "))


def _find_header(rows: Sequence[tuple[str, list[str]]]) -> int:
    """Return which line begins the table: the first above a row of its width with two values; 0 where there is none.

    A line of values begins one only where no line above has several fields: those would be its names.
    """
    for k, (separator, fields) in enumerate(rows[:-1]):
        width = len(fields) - (fields[-1] == "")
        below = rows[k + 1][1]
        if k + 2 < len(rows) and all(_UNIT.fullmatch(field) for field in below):
            below = rows[k + 2][1]
        if (
            width < 2
            or width != len(below) - (below[-1] == "")
            or sum(map(_is_value, filter(None, below))) < 2
        ):
            continue
        named = not any(_is_value(field) for field in fields if field)
        if k == 0 or named or all(len(above) < 2 or mark != separator for mark, above in rows[:k]):
            return k
    return 0


def _list_echoed_columns(fields: Sequence[str]) -> list[str]:
    """Return the columns of a row that ``ros2 topic echo --csv`` printed of a JointState; none of another row.

    Seconds, nanoseconds and frame, then the names of the joints, and a position, velocity and effort of each, or fewer.
    """
    count = sum(not _is_value(field) for field in fields[3:])
    known = fields[3 : 3 + count]
    numbers = fields[3 + count :]
    stamped = all(field.isdecimal() for field in fields[:2])
    if not (
        count
        and stamped
        and all(map(_is_value, numbers))
        and len(numbers) in (count, 2 * count, 3 * count)
    ):
        return []
    if any(map(_is_value, known)):
        return []
    kinds = ("name", "position", "velocity", "effort")[: 1 + len(numbers) // count]
    return [
        "header.stamp.sec",
        "header.stamp.nanosec",
        "frame",
        *(f"{kind}{k}" for kind in kinds for k in range(count)),
    ]


def _is_value(field: str) -> bool:
    """Whether a field is a number, with a decimal point or comma, a time, or empty."""
    return (
        not field or any(_parse_number(field, mark) is not None for mark in ".,") or is_stamp(field)
    )


def _read_units_line(line: str, separator: str, width: int) -> list[str]:
    """Return the unit of each column in a line of nothing but units, '' for those without; none of another line.

    STorM32's loggers write one below the names, ``[ms] [deg]``, and many others ``s,rad,N m``.
    """
    fields = _split_fields(line, separator)
    if (
        len(fields) != width
        or not all(_UNIT.fullmatch(field) for field in fields)
        or not any(fields)
    ):
        return []
    units = [field.strip("[]()- ") for field in fields]
    return ["" if unit in ("int", "uint", "hex") else unit for unit in units]


def _add_unit(name: str, unit: str) -> str:
    """Return a column's name with its unit: ``pitch_deg``, ``pitch [deg/s]``; a log's own column in SI stays."""
    if not unit or (
        _SI_COLUMN.fullmatch(name) and unit in ("s", "rad", "rad/s", "Nm", "N m", "N·m", "°C")
    ):
        return name
    return f"{name}_{unit}" if re.fullmatch(r"\w+", unit) else f"{name} [{unit}]"


def _check_length(place: str, length: int) -> None:
    """Raise `LogError` for a line of more bytes than a row of numbers may have."""
    if length > LONGEST_LINE:
        raise LogError(
            place, f"has a line of {length / 1e6:.3g} MB", "write one row of plain numbers a line"
        )


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


def _find_flaw(field: str, decimal: str = ".") -> tuple[str, str] | None:
    """Return what is wrong with a number's text and the mend; None for a number, or where it is missing."""
    value = _parse_number(field, decimal)
    if not field or (value is not None and not math.isinf(value)):
        return None
    if value is not None:
        return f"is {field}", "repair the value, or delete the row"
    if re.fullmatch(r"[+-]?\d*,\d+(?:[eE][+-]?\d+)?", field):
        return f"has a decimal comma ({field})", "write decimal points"
    return f"holds the text '{field[:40]}'", "write a number, or leave the row out"


def _parse_number(field: str, decimal: str = ".") -> float | None:
    """Return the number that a field spells, or None; ``1_000`` and digits of other scripts are none."""
    if decimal == ",":
        field = field.replace(".", "_").replace(",", ".")
    try:
        return None if "_" in field or not field.isascii() else float(field)
    except ValueError:
        return None


def write_csv(columns: Mapping[str, Array], path: Path, separator: str = ",") -> None:
    """Write columns of equal length, the numbers in the shortest form that reads back exactly; whole or not at all."""
    header = separator.join(map(_quote_name, columns))
    values = np.column_stack(list(columns.values()))
    with (
        open_replacement(path) as new,
        wrap_os_errors(path),
        new.open("w", encoding="utf-8", newline="") as file,
    ):
        file.write(f"{header}\n")
        for part in np.array_split(
            values, len(values) // 2**14 + 1
        ):  # Python's numbers take four times the memory
            file.writelines(separator.join(map(repr, row)) + "\n" for row in part.tolist())


def _quote_name(name: str) -> str:
    """Return a column's name in quotes where it holds a quote or a separator that `read_header` knows."""
    return '"{}"'.format(name.replace('"', '""')) if set(name) & set('",;\t') else name
