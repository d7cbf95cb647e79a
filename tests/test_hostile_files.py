"""Files that nobody would write on purpose: each is read, or refused in one line, at once."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from gimbal_pin.errors import GimbalPinError, UsageError
from gimbal_pin.reading import read_bytes, read_yaml

SOON = 2.0
"""Longest that anything here may take, s: what it guards against takes minutes or all of the memory."""


def soon(read: Callable[[], object], kind: type[GimbalPinError] = UsageError) -> object:
    """What is read, or the error of `kind` in one line; it took no time."""
    start = time.perf_counter()
    try:
        found = read()
    except kind as error:
        assert "\n" not in str(error)
        found = error
    assert time.perf_counter() - start < SOON
    return found


# --- YAML -----------------------------------------------------------------------------------------------------------

BOMB = "a0: &a0 [1, 1]\n" + "".join(f"a{k}: &a{k} [{', '.join(9 * [f'*a{k - 1}'])}]\n" for k in range(1, 40))
TRICKS = {
    "brackets": 20_000 * "[",
    "closed brackets": 20_000 * "[" + 20_000 * "]",
    "tables in tables": 20_000 * "{a: ",
    "dashes": 20_000 * "- ",
    "aliases of aliases": BOMB,
    "itself": "a: &a [*a]",
    "an alias of nothing": "a: *b",
    "a file larger than any": 17 * 2**20 * " ",
    "no boolean": "a: !!bool x",
    "no integer": "a: !!int x",
    "an integer without digits": "a: 0b_",
    "a long integer": "a: !!int " + 5000 * "1",
    "a long sexagesimal": "a: !!float 1" + 5000 * ":1" + ".5",
    "a date": "a: !!timestamp 2020-01-01",
    "bytes": "a: !!binary aGk=",
    "a set": "!!set {a, b}",
    "pairs": "!!omap [a: 1]",
    "code": "!!python/object/apply:os.getcwd []",
    "a list as key": "{[a]: 1}",
    "a number as key": "{1: 1}",
    "two documents": "a: 1\n---\na: 2",
    "a null character": "a: \0",
    "an escape": "a: \x1b[31m",
}


@pytest.mark.parametrize("trick", TRICKS)
def test_a_yaml_that_is_no_plain_data_is_refused_before_it_unfolds(tmp_path: Path, trick: str) -> None:
    path = tmp_path / "x.yaml"
    path.write_text(TRICKS[trick], encoding="utf-8")
    refusal = soon(lambda: read_yaml(path))
    assert isinstance(refusal, UsageError) and refusal.place.startswith(str(path))


def test_what_looks_like_a_date_a_merge_or_a_huge_number_is_a_text(tmp_path: Path) -> None:
    for text in ("2020-01-01", "<<", "=", 400 * "1", "1" + 9000 * ":1"):
        (tmp_path / "x.yaml").write_text(f"a: {text}")
        assert soon(lambda: read_yaml(tmp_path / "x.yaml")) == {"a": text}


def test_a_few_aliases_mean_what_they_stand_for(tmp_path: Path) -> None:
    (tmp_path / "x.yaml").write_text("yaw: &motor {slots: 24, size: [&n 1, 2]}\nroll: *motor\ntilt: *n")
    motor = {"slots": 24, "size": [1, 2]}
    assert read_yaml(tmp_path / "x.yaml") == {"yaw": motor, "roll": motor, "tilt": 1}


SPELLED = st.text("ab01.:-,[]{}&*!?|>#'\"% \n\t_enx", max_size=40)


@settings(max_examples=300)
@given(SPELLED.map(str.encode) | st.binary(max_size=60))
@example(b"\xff\xfea\0")
@example(b"\xef\xbb\xbfa: 1")
def test_any_bytes_are_a_value_or_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "x.yaml"
    path.write_bytes(content)
    found = soon(lambda: read_yaml(path))
    assert isinstance(found, UsageError) or is_plain(found)


def is_plain(value: object) -> bool:
    """Whether a value is of texts, numbers, booleans, nothing, lists, and tables with texts as keys."""
    if isinstance(value, dict):
        return all(isinstance(key, str) and is_plain(inner) for key, inner in value.items())
    return all(map(is_plain, value)) if isinstance(value, list) else isinstance(value, (str, int, float, type(None)))


# --- bytes ----------------------------------------------------------------------------------------------------------


def test_a_file_without_end_is_refused_and_a_pipe_that_nobody_fills_is_empty(tmp_path: Path) -> None:
    assert isinstance(soon(lambda: read_bytes("/dev/zero", most=10**6)), UsageError)
    os.mkfifo(tmp_path / "pipe")
    assert soon(lambda: read_bytes(tmp_path / "pipe")) == b""
    sparse = tmp_path / "sparse"
    with sparse.open("wb") as file:
        file.truncate(2**40)
    assert isinstance(soon(lambda: read_bytes(sparse)), UsageError)


def test_a_pipe_that_somebody_fills_is_read_to_its_end() -> None:
    end, start = os.pipe()
    os.write(start, b"abc")
    os.close(start)
    assert soon(lambda: read_bytes(f"/dev/fd/{end}")) == b"abc"
    os.close(end)
