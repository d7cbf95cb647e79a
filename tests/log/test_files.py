"""Files are written whole or not at all, and what they hold is read back."""

from __future__ import annotations

import json
import math
import os
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gimbal_pin.errors import UsageError
from gimbal_pin.log import atomic_write, to_json, write_json, write_yaml
from gimbal_pin.log.io.files import make_folder, open_replacement
from gimbal_pin.rig import read_yaml


def test_the_old_file_stays_when_writing_fails(tmp_path: Path) -> None:
    path = tmp_path / "out.csv"
    path.write_text("old")
    with pytest.raises(ZeroDivisionError), open_replacement(path) as temporary:
        temporary.write_text("half")
        assert path.read_text() == "old"
        raise ZeroDivisionError
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_who_reads_the_old_file_reads_all_of_it(tmp_path: Path) -> None:
    path = tmp_path / "out.csv"
    atomic_write(path, "old")
    os.link(path, tmp_path / "other")
    with path.open() as reader:
        atomic_write(path, "new, and longer")
        assert reader.read() == "old"
    assert (tmp_path / "other").read_text() == "old"


@pytest.mark.skipif(sys.platform == "win32", reason="POSIX access rights, links and devices")
def test_rights_links_and_devices_stay(tmp_path: Path) -> None:
    (tmp_path / "plain").write_text("")
    new = tmp_path / "new"
    atomic_write(new, "x")
    assert new.stat().st_mode == (tmp_path / "plain").stat().st_mode
    new.chmod(0o640)
    (tmp_path / "link").symlink_to("new")
    atomic_write(tmp_path / "link", "y")
    assert (tmp_path / "link").is_symlink()
    assert new.read_text() == "y"
    assert new.stat().st_mode & 0o777 == 0o640
    atomic_write(os.devnull, "x" * 1000)
    assert Path(os.devnull).is_char_device()


def test_places_that_cannot_be_written_are_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(UsageError, match="folder that does not exist"):
        atomic_write(tmp_path / "no" / "x.csv", "x")
    with pytest.raises(UsageError, match="is a folder"):
        atomic_write(tmp_path, "x")
    with pytest.raises(UsageError, match="would be a folder where file is a file"):
        make_folder(tmp_path / "file" / "x")


LETTERS = st.text(st.characters(exclude_categories=["C"]))
LEAVES = st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | LETTERS


@given(tree=st.dictionaries(st.text("abcxyz_0.:"), LEAVES | st.lists(LEAVES)))
def test_yaml_and_json_round_trip(tree: dict[str, object], tmp_path: Path) -> None:
    """JSON has no infinity, YAML no half of a character, which a file's name on Linux may be."""
    write_yaml({"logs": ["a\udcff.csv"]}, tmp_path / "x.yaml")
    assert read_yaml(tmp_path / "x.yaml") == {"logs": ["a\\udcff.csv"]}
    write_yaml(tree, tmp_path / "x.yaml")
    assert read_yaml(tmp_path / "x.yaml") == tree
    write_json(tree, tmp_path / "x.json")
    if "inf" not in repr(tree):
        assert json.loads((tmp_path / "x.json").read_text(encoding="utf-8")) == tree


def test_json_of_numpy_and_of_what_is_not_finite() -> None:
    values = [np.float64(0.1), np.array([1.0, math.nan]), np.bool_(True), -math.inf, Path("x")]
    assert json.loads(to_json({"b": values, "a": 1})) == {
        "b": [0.1, [1.0, None], True, None, "x"],
        "a": 1,
    }
    with pytest.raises(TypeError):
        to_json({"x": object()})
