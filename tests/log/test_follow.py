"""A log that is still being written: whole lines, whatever the cuts, up to the first flaw."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gimbal_pin.dynamics import nominal
from gimbal_pin.errors import LogError
from gimbal_pin.log import Log, follow, write_log
from gimbal_pin.log.io.follow import join_whole_lines
from gimbal_pin.rig import Rig
from tests.bench_logs import prescribed


@cache
def short() -> Log:
    return prescribed(nominal(Rig.load("turret")), seconds=0.8)


@given(st.binary(max_size=60), st.lists(st.integers(0, 60), max_size=6))
def test_whole_lines_lose_nothing_but_an_open_end(data: bytes, cuts: list[int]) -> None:
    parts: Iterator[bytes] = (data[a:b] for a, b in pairwise(sorted({0, *cuts, len(data)})))
    lines = list(join_whole_lines(parts))
    assert b"".join(lines) == data[: data.rfind(b"\n") + 1] and all(
        part.endswith(b"\n") for part in lines
    )


def test_a_growing_file_is_followed(tmp_path: Path) -> None:
    """The header comes first, a line in two halves; flaws are named by their line in the file."""
    rig = Rig.load("turret")
    path = tmp_path / "log.csv"
    write_log(short().part(slice(0, 300)), path)
    lines = path.read_text().splitlines(keepends=True)
    path.write_text("".join(lines[:100]) + lines[100][:9])
    logs = follow(str(path), rig, idle=0.2)
    first = next(logs)
    with path.open("a") as file:
        file.write(lines[100][9:] + "".join(lines[101:200]) + "1.0,x" + lines[200])
    assert len(first) == 99
    np.testing.assert_array_equal(next(logs).q, short().q[99:199])
    with pytest.raises(LogError, match=r"log\.csv:201"):
        next(logs)
    path.write_text("".join(lines))
    np.testing.assert_array_equal(
        np.concatenate([log.q for log in follow(str(path), rig, idle=0.0)]), short().q[:300]
    )
    path.write_text("")
    with pytest.raises(LogError, match="empty"):
        list(follow(str(path), rig, idle=0.0))


@pytest.mark.parametrize("row", [1, 500, 799])
def test_all_samples_before_a_flaw_are_used(row: int, tmp_path: Path) -> None:
    rig = Rig.load("turret")
    path = tmp_path / "log.csv"
    log = short().part(slice(0, 800))
    write_log(log, path)
    lines = path.read_text().splitlines(keepends=True)
    for flaw, words in (
        ("-1.0" + lines[1 + row][lines[1 + row].index(",") :], "goes back"),
        ("x" + lines[1 + row], ""),
    ):
        path.write_text("".join([*lines[: 1 + row], flaw, *lines[2 + row :]]))
        logs = follow(str(path), rig, idle=0.0)
        np.testing.assert_array_equal(next(logs).q, log.q[:row])
        with pytest.raises(LogError, match=rf"log\.csv:{2 + row} column 't'.*{words}"):
            next(logs)
