"""CSV: read with the separator, quotes, comments and line ends that loggers and spreadsheets leave; written exactly."""

from __future__ import annotations

import csv
import gzip
import io
import re
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import ClassVar

import numpy as np

from gimbal_pin.errors import LogError, visible
from gimbal_pin.log.io.csv_text import as_utf8, flaw, lines, number_in, sound, split, uneven, uneven_mend
from gimbal_pin.log.io.files import replacing, told
from gimbal_pin.log.log import Array
from gimbal_pin.rig.reading import largest, read_bytes

SEPARATORS = (";", "\t", ",")
COMMENT = re.compile(rb"(?m)^[ \t]*#.*$")
SPACES = re.compile(rb"(?m)^ +| +(?=\r?$)|( +)")
FOC = ("MOT:", "CS:")
"""How the lines begin that SimpleFOC writes before its numbers."""
FOC_COLUMNS = {
    4: ("target", "voltage.q", "velocity", "angle"),
    7: ("target", "voltage.q", "voltage.d", "current.q_ma", "current.d_ma", "velocity", "angle"),
}
"""What ``motor.monitor()`` writes by default and at most (docs.simplefoc.com/monitoring)."""
GZIP = b"\x1f\x8b"
BLOCK = 1 << 22  # bytes read at a time
LINE = 1 << 22  # bytes that no row has: 100 000 columns of 20 digits are 2.1 MB
ROWS = 1 << 14  # rows written at a time


@dataclass(frozen=True, eq=False)
class CsvTable:
    """A CSV file of which the header is known and the rows are text still.

    Attributes:
        name: The file's path.
        columns: Names in the header; ``column1, column2, …`` where the file starts with numbers.
        separator: One of `SEPARATORS`.
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
        """Return the named columns, (N,) each; `LogError` names the line and column of the first flaw."""
        from tqdm import tqdm

        index = {column: self.columns.index(column) for column in columns}
        arrays = []
        with tqdm(
            desc=visible(self.name), total=len(self.body), unit="B", unit_scale=True, delay=2, disable=None
        ) as bar:
            for part in self.parts():
                arrays.append(part.numbers(index))
                bar.update(len(part.body))
        if not arrays:
            raise LogError(f"{self.name}:{self.first}", "has a header but no rows", "give a file with samples")
        return {column: np.concatenate([array[place] for array in arrays]) for column, place in index.items()}

    def parts(self) -> Iterator[CsvTable]:
        """Yield the rows as tables of about `BLOCK` bytes, cut at line ends; as one where a field may hold a line end.

        A flaw is then looked for in one part only, and what is read at a time stays small.
        """
        size = len(self.body) if b'"' in self.body else BLOCK
        start, line = 0, self.first
        while start < len(self.body):
            end = self.body.find(b"\n", start + size) + 1 or len(self.body)
            body = self.body[start:end]
            # Where a part is cut, its last line is the one that is too long.
            begin = body.rfind(b"\n", 0, len(body) - 1) + 1
            check_length(f"{self.name}:{line + body[:begin].count(10)}", len(body) - begin)
            body = self.plain(body)
            if body.strip():
                yield replace(self, body=body, first=line)
            start, line = end, line + body.count(b"\n")

    def plain(self, body: bytes) -> bytes:
        """Return rows without comments, with tabs where spaces stand between the values."""
        body = COMMENT.sub(b"", body) if b"#" in body else body
        return SPACES.sub(lambda found: b"\t" if found[1] else b"", body) if self.spaced else body

    def numbers(self, index: Mapping[str, int]) -> dict[int, Array]:
        """Return column number → values of the columns `index`; `LogError` at the first flaw."""
        if uneven(self.body, self.separator, len(self.columns)):
            self.check(index)
        try:
            values = parse(self.body, self.separator, sorted(index.values()))
        except ValueError as error:
            self.check(index)
            raise self.odd(str(error)) from error
        if any(np.isinf(column).any() for column in values.values()):
            self.check(index)
            raise self.odd("a value is not finite")
        return values

    def odd(self, why: str) -> LogError:
        """Return the error for rows that pandas refuses though none of them shows why."""
        place = f"{self.name}: rows from line {self.first}"
        return LogError(place, f"are not the CSV that they seem ({why})", "write one row of plain numbers a line")

    def place(self, row: int, column: str) -> str:
        """Return ``file:line column 'name'`` of a sample, lines counted as an editor does."""
        line, _ = next(islice(self.records(), row, None))
        return f"{self.name}:{line} column '{column}'"

    def records(self) -> Iterator[tuple[int, list[str]]]:
        """Yield (line number, fields) of every row that is not blank. Slow: for finding the place of an error."""
        text = io.TextIOWrapper(io.BytesIO(self.plain(self.body)), encoding="utf-8", errors="replace", newline="")
        reader = csv.reader(text, delimiter=self.separator, skipinitialspace=True)
        line = self.first
        try:
            for fields in reader:
                if len(fields) > 1 or any(field.strip() for field in fields):
                    yield line, fields
                line = self.first + reader.line_num
        except csv.Error as error:
            raise LogError(f"{self.name}:{line}", f"is not CSV ({error})", "mend the quotes there") from error

    def check(self, index: Mapping[str, int]) -> None:
        """Raise `LogError` at the first row of another width than the header or with a flaw in the columns `index`."""
        width = len(self.columns)
        for line, fields in self.records():
            if len(fields) < width or any(field.strip() for field in fields[width:]):
                what = f"has {len(fields)} values under {width} column names"
                raise LogError(f"{self.name}:{line}", what, uneven_mend(len(fields), width, self.separator))
            if not sound(fields, index.values()):
                for column, place in index.items():
                    if found := flaw(fields[place].strip()):
                        raise LogError(f"{self.name}:{line} column '{column}'", *found)


def open_csv(path: Path) -> CsvTable:
    """Read a CSV file and its header: the first line that is neither blank nor a ``#`` comment.

    Where that line holds numbers only, the names stand in the comment before it (as `numpy.savetxt` writes them), are
    those of SimpleFOC's monitor behind its messages, or ``column1, column2, …``.

    Raises:
        LogError: The file is missing, empty, binary, or has one column only.
    """
    found = headed(str(path), as_utf8(unzipped(read_bytes(path, LogError), str(path))))
    if found is None:
        raise LogError(str(path), "is empty", "give a file with a header and one row per sample")
    return found


def unzipped(data: bytes, name: str) -> bytes:
    """Return what gzip packed, at most `largest` bytes; other data as they are. `LogError` where it is damaged."""
    if not data.startswith(GZIP):
        return data
    parts, room = list[bytes](), largest()
    try:
        with gzip.open(io.BytesIO(data)) as file:
            while part := file.read(BLOCK):
                parts.append(part)
                if (room := room - len(part)) < 0:
                    raise LogError(name, f"unfolds to more than {largest() / 1e6:.0f} MB", "give a smaller file")
    except (OSError, EOFError, zlib.error) as error:
        raise LogError(name, f"is a damaged gzip file ({error})", "pack it again") from error
    return b"".join(parts)


def headed(name: str, data: bytes) -> CsvTable | None:
    """Return the table that starts with `data`, whole lines; None where these hold neither header nor row."""
    if b"\0" in data[:4096]:
        raise LogError(name, "is binary, not CSV", "give it the suffix of its format")
    remark = ""
    for number, start, end, line in lines(data):
        if line.lstrip().startswith("#"):
            remark = line.lstrip().lstrip("#")
        elif line.startswith(FOC):
            remark = "MOT:"
        elif line.strip():
            return table(name, data, (number, start, end), line, remark)
    return None


def check_length(place: str, length: int) -> None:
    """Raise `LogError` for a line of more bytes than a row of numbers may have."""
    if length > LINE:
        raise LogError(place, f"has a line of {length / 1e6:.3g} MB", "write one row of plain numbers a line")


def table(name: str, data: bytes, span: tuple[int, int, int], line: str, remark: str) -> CsvTable:
    """Return the table whose first line in use is `line`: number, start and end of it in `data` are `span`."""
    number, start, end = span
    check_length(f"{name}:{number}", end - start)
    separator = max(SEPARATORS, key=re.sub('"[^"]*"', "", line).count)
    fields = split(line, separator)
    if spaced := len(fields) < 2:
        separator, fields = "\t", split(line.strip(), " ")
    if len(fields) < 2:
        raise LogError(f"{name}:{number}", "has one column only", "separate columns by commas, semicolons or tabs")
    begin, first = end, number + 1
    if all(number_in(field) is not None for field in fields if field):
        begin, first = start, number
        foc = FOC_COLUMNS.get(len(fields), ()) if remark == "MOT:" else ()
        names = list(foc) or split(remark.strip(), " " if spaced else separator)
        fields = names if len(names) == len(fields) else [f"column{i + 1}" for i in range(len(fields))]
    return CsvTable(name, tuple(fields), separator, data[begin:], first, spaced)


def parse(body: bytes, separator: str, places: list[int]) -> dict[int, Array]:
    """Return column number → values by pandas' C parser, nan where they are missing; ValueError of any other text."""
    import pandas

    # From 3.1 on, pandas parses exactly by itself and warns of the argument; before, exactness has to be asked for.
    version = tuple(int(part) for part in pandas.__version__.split(".")[:2])
    exact = {} if version >= (3, 1) else {"float_precision": "round_trip"}
    frame = pandas.read_csv(
        io.BytesIO(body),
        sep=separator,
        header=None,
        usecols=places,
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
    return {place: frame[place].to_numpy() for place in places}


def write_csv(columns: Mapping[str, Array], path: Path, separator: str = ",") -> None:
    """Write columns of equal length, the numbers in the shortest form that reads back exactly; whole or not at all."""
    header = io.StringIO()
    csv.writer(header, delimiter=separator, lineterminator="\n").writerow(columns)
    values = np.column_stack(list(columns.values()))
    with replacing(path) as temporary, told(path), temporary.open("w", encoding="utf-8", newline="") as file:
        file.write(header.getvalue())
        for start in range(0, len(values), ROWS):
            rows = values[start : start + ROWS].tolist()
            file.writelines(separator.join(map(repr, row)) + "\n" for row in rows)
