"""A log that is still being written: whole lines, whatever the cuts, up to the first flaw."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gimbal_pin.errors import GimbalPinError, LogError
from gimbal_pin.log import follow, write_log
from tests.log.planted import TURRET, planted

LOG = planted()


def write_lines(path: Path) -> list[str]:
    """Write the log; return its lines."""
    write_log(LOG, path)
    return path.read_text().splitlines(keepends=True)


def test_a_growing_file_is_followed_until_it_is_cut_off(tmp_path: Path) -> None:
    """The header comes first, a line in two halves."""
    path = tmp_path / "log.csv"
    lines = write_lines(path)
    path.write_text("".join(lines[:100]) + lines[100][:9])
    logs = follow(str(path), TURRET, idle=5.0)
    np.testing.assert_array_equal(next(logs).q, LOG.q[:99])
    with path.open("a") as file:
        file.write(lines[100][9:] + "".join(lines[101:]))
    np.testing.assert_array_equal(next(logs).q, LOG.q[99:])
    path.write_text(lines[0])
    with pytest.raises(LogError, match="became shorter"):
        next(logs)


@pytest.mark.parametrize(
    ("row", "flaw", "said"), [(1, "x,", "'x'"), (500, "-1.0,", "goes back"), (599, "x,", "'x'")]
)
def test_all_samples_before_a_flaw_are_used(row: int, flaw: str, said: str, tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    lines = write_lines(path)
    lines[1 + row] = flaw + lines[1 + row].partition(",")[2]
    path.write_text("".join(lines))
    logs = follow(str(path), TURRET, idle=0.0)
    np.testing.assert_array_equal(next(logs).q, LOG.q[:row])
    with pytest.raises(LogError, match=rf"log\.csv:{2 + row} column 't'.*{said}"):
        next(logs)


@pytest.mark.parametrize(
    ("name", "mapping", "said"),
    [("x.csv", (), "empty"), ("x.csv", "t=row*0.1", "write its times"), ("x.npz", (), "whole")],
)
def test_what_cannot_be_followed_is_refused(
    name: str, mapping: str, said: str, tmp_path: Path
) -> None:
    path = tmp_path / name
    path.write_text("q_pan,q_tilt,tau_pan,tau_tilt\n1,2,3,4\n" if mapping else "")
    with pytest.raises(GimbalPinError, match=said):
        list(follow(str(path), TURRET, mapping, idle=0.0))
