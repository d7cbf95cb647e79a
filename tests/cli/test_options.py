"""Numbers on the command line, limits of the system, and text for a terminal."""

from __future__ import annotations

import errno
import io
import os
import pickle
import signal
import subprocess
import sys
from collections.abc import Iterator
from inspect import get_annotations, signature
from pathlib import Path
from typing import Any, get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tyro.constructors import PrimitiveConstructorSpec

from gimbal_pin.cli import VERBS, exit_on_signals, options
from gimbal_pin.cli.paths import label
from gimbal_pin.cli.present import say
from gimbal_pin.errors import LONGEST_MESSAGE, UNSAFE, DataError, GimbalPinError, UsageError
from gimbal_pin.identification import ESTIMATORS
from gimbal_pin.log.io import files
from tests.command_line import Run, refused

HOSTILE = (
    "nan",
    "inf",
    "-inf",
    "-1e11",
    "1e11",
    "1e300",
    "1" + "0" * 400,
    "9" * 6000,
    "",
    "x\x1b[31m",
    "None",
    "١",
)


def numbers(of: Any) -> Iterator[tuple[str, Any, list[PrimitiveConstructorSpec[Any]]]]:
    """Name, default and bounds of every option of a verb that is a number, nested ones too."""
    for name, parameter in signature(of).parameters.items():
        hint = get_annotations(of, eval_str=True)[name]
        default = parameter.default
        kind, *marks = get_args(hint) if hasattr(hint, "__metadata__") else (hint,)
        if hasattr(default, "__dataclass_fields__"):
            yield from numbers(type(default))
        elif {int, float} & {kind, *get_args(kind)}:
            yield (
                label(name, tuple(marks)),
                default,
                [m for m in marks if isinstance(m, PrimitiveConstructorSpec)],
            )


def test_every_estimator_can_be_asked_for() -> None:
    assert set(get_args(get_args(options.EstimatorName)[0])) == {
        str(method) for method in ESTIMATORS
    }


@pytest.mark.parametrize("verb", VERBS)
def test_every_number_has_bounds_that_its_message_names(verb: str) -> None:
    for name, default, bounds in numbers(VERBS[verb]):
        (bound,) = bounds
        low, _, rest = bound.metavar.partition("..")
        high, *unit = rest.split()
        for end in (low, high, *([] if default is None else [str(default)])):
            assert float(low) <= bound.instance_from_str([end]) == float(end) <= float(high)
        for value in HOSTILE:
            with pytest.raises(UsageError) as error:
                bound.instance_from_str([value])
            said = str(error.value)
            assert said.startswith(f"{name}: is ") and said.endswith(
                " ".join([f"{low} to {high}", *unit])
            )
            assert len(said) < 120 and not UNSAFE.search(said)


def test_a_number_is_refused_before_anything_is_read(run: Run) -> None:
    refused(
        run("identify", "nowhere.urdf", "log.csv", "--cutoff", "nan"),
        2,
        "--cutoff: is nan; give 0.1 to 1000 Hz",
    )
    refused(
        run("track", "nowhere.urdf", "--seeds", "2.5"),
        2,
        "--seeds: is '2.5'; give a whole number from 1 to 10000",
    )


@given(parts=st.tuples(*[st.text() | st.text(min_size=200, max_size=2000)] * 3))
def test_a_message_is_one_short_line_that_a_terminal_shows(parts: tuple[str, str, str]) -> None:
    error = GimbalPinError(*parts)
    said = str(error)
    assert len(said) <= LONGEST_MESSAGE and len(said.splitlines()) <= 1 and not UNSAFE.search(said)
    assert (str(again := pickle.loads(pickle.dumps(error))), type(again)) == (said, GimbalPinError)
    assert str(DataError(*parts, unseen=("a",) * 9)).count("; ") >= 1


def test_each_part_of_a_long_message_survives() -> None:
    said = str(GimbalPinError("place" + "p" * 500 + "end", "what" + "w" * 500 + "end", "a mend"))
    assert said.startswith("…p") and "pend: whatw" in said and said.endswith("wend; a mend")


@pytest.mark.parametrize(("code", "shown"), [("ascii", rb"\xe9"), ("utf-8", "é".encode())])
def test_what_a_terminal_would_obey_is_written_out(code: str, shown: bytes) -> None:
    stream = io.TextIOWrapper(io.BytesIO(), encoding=code)
    say("é \x1b[2J \udcff \u202e\nnext", stream)
    stream.seek(0)
    assert stream.buffer.read() == shown + rb" \x1b[2J \udcff \u202e" + b"\nnext\n"
    assert files.to_json(["\x9b\udcff"], None) == '["\\u009b\\\\udcff"]\n'


def test_a_name_that_holds_escapes_is_told_without_them(run: Run, tmp_path: Path) -> None:
    name = tmp_path / "a\x1b[31m\x9b\u202eb.csv"
    name.write_text("t,q_\x1b[2Jpan\n0,1\n")
    said = run("identify", "turret", name)
    refused(said, 2, r"\x1b[31m\x9b\u202eb.csv")
    assert not UNSAFE.search(said[2].rstrip("\n"))


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_it_orderly(number: int, tmp_path: Path) -> None:
    before = signal.signal(number, signal.SIG_DFL)  # under nohup it is ignored
    with (
        pytest.raises(SystemExit) as stop,
        exit_on_signals(),
        files.open_replacement(tmp_path / "x"),
    ):
        os.kill(os.getpid(), number)
    assert stop.value.code == 128 + number and not list(tmp_path.iterdir())
    assert signal.signal(number, before) is signal.SIG_DFL


@pytest.mark.parametrize(
    "call", ["identify turret {}", "simulate turret -o {}", "montecarlo turret --count 1 -o out"]
)
def test_a_working_folder_that_was_deleted_is_one_line(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, call: str
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir("gone")
    (tmp_path / "gone").rmdir()
    try:
        refused(run(*call.format(tmp_path / "log.csv").split()), 2, "")
    finally:
        monkeypatch.chdir(tmp_path)


LIMITED = "import resource as r, sys; r.setrlimit(r.{0}, ({1}, {1})); from gimbal_pin.cli import main; main(['rigs'])"


@pytest.mark.parametrize(("kind", "limit"), [("RLIMIT_NOFILE", 4), ("RLIMIT_AS", 500_000_000)])
def test_a_limit_that_no_verb_can_work_under_is_one_line(kind: str, limit: int) -> None:
    done = subprocess.run(
        [sys.executable, "-c", LIMITED.format(kind, limit)], capture_output=True, text=True
    )
    refused((done.returncode, done.stdout, done.stderr), 2, "ulimit", str(limit))


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (OSError(errno.EMFILE, "Too many open files"), "ulimit -n"),
        (MemoryError(), "memory"),
        (ImportError("pandas.so: failed to map segment from shared object"), "memory"),
        (RuntimeError("can't start new thread"), "memory"),
        (OSError(errno.ENAMETOOLONG, "File name too long", "aaa.csv"), "aaa.csv"),
    ],
)
def test_what_the_system_lacks_is_one_line(
    run: Run, monkeypatch: pytest.MonkeyPatch, error: Exception, said: str
) -> None:
    """Also where a library raises an error of its own over it."""

    def fail(*words: object) -> None:
        try:
            raise error
        except (OSError, MemoryError, ImportError, RuntimeError):
            if said == "aaa.csv":
                raise
            raise AttributeError("half of a library is there")  # noqa: B904

    monkeypatch.setattr("gimbal_pin.cli.parse_arguments", fail)
    refused(run("rigs"), 2, said)


def test_a_defect_keeps_its_traceback(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gimbal_pin.cli.parse_arguments", lambda words: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        run("rigs")


def test_a_closed_stream_is_one_line() -> None:
    call, word = "identify turret - --follow <&-", "standard input: is closed"
    done = subprocess.run(
        f"'{sys.executable}' -m gimbal_pin.cli {call}", shell=True, capture_output=True, text=True
    )
    refused((done.returncode, done.stdout, done.stderr), 2, word)


def test_no_verb_minds_which_window_matplotlib_would_open(tmp_path: Path) -> None:
    program = "from gimbal_pin.cli import main; main(['rigs']); import matplotlib; print(matplotlib.get_backend())"
    environment = {**os.environ, "MPLBACKEND": "nonsense"}
    done = subprocess.run(
        [sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True
    )
    assert done.stdout.splitlines()[-1] == "agg"
