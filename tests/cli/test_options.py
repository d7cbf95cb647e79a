"""Numbers on the command line, work that is too much, and what a terminal is shown."""

from __future__ import annotations

import io
import os
import pickle
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from inspect import get_annotations, signature
from pathlib import Path
from typing import Any, get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tyro.constructors import PrimitiveConstructorSpec

from gimbal_pin.cli import VERBS, ending_orderly, options
from gimbal_pin.cli.paths import label
from gimbal_pin.cli.present import say
from gimbal_pin.cli.work import check_cost
from gimbal_pin.errors import LONGEST_MESSAGE, UNSAFE, DataError, GimbalPinError, UsageError
from gimbal_pin.identification import ESTIMATORS
from gimbal_pin.log.io import files
from tests.command_line import Run, refused

HOSTILE = ("nan", "inf", "-inf", "-1e11", "1e11", "1e300", "1" + "0" * 400, "9" * 6000, "", "x\x1b[31m", "None", "١")


def numbers(of: Any) -> Iterator[tuple[str, Any, list[PrimitiveConstructorSpec[Any]]]]:
    """Name, default and bounds of every option of a verb that is a number, nested ones too."""
    for name, parameter in signature(of).parameters.items():
        hint, default = get_annotations(of, eval_str=True)[name], parameter.default
        kind, *marks = get_args(hint) if hasattr(hint, "__metadata__") else (hint,)
        if hasattr(default, "__dataclass_fields__"):
            yield from numbers(type(default))
        elif {int, float} & {kind, *get_args(kind)}:
            yield label(name, tuple(marks)), default, [m for m in marks if isinstance(m, PrimitiveConstructorSpec)]


def test_every_estimator_can_be_asked_for() -> None:
    assert set(get_args(get_args(options.EstimatorName)[0])) == {str(method) for method in ESTIMATORS}


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
            assert said.startswith(f"{name}: is ") and said.endswith(" ".join([f"{low} to {high}", *unit]))
            assert len(said) < 120 and not UNSAFE.search(said)


def test_a_number_is_refused_before_anything_is_read(run: Run) -> None:
    refused(run("identify", "nowhere.urdf", "log.csv", "--cutoff", "nan"), 2, "--cutoff: is nan; give 0.1 to 1000 Hz")
    refused(run("track", "nowhere.urdf", "--seeds", "2.5"), 2, "--seeds: is '2.5'; give a whole number from 1 to 10000")


@pytest.mark.parametrize(
    "call",
    [
        "simulate turret --seconds 86400 -o x.csv",
        "excite turret --harmonics 200 --starts 1000 -o x.csv",
        "excite turret --seconds 3600 --rate 20000 -o x.csv",
        "demo --seconds 3600 -o x",
        "track turret --platform S --seeds 10000",
        "montecarlo turret --count 100000 -o x",
    ],
)
def test_work_of_hours_is_asked_for_twice(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, call: str) -> None:
    monkeypatch.chdir(tmp_path)
    refused(run(*call.split()), 2, "would take about", " GB; add --yes")
    assert not list(tmp_path.iterdir())


def test_work_asks_where_it_needs_more_than_half_of_what_a_limit_leaves(monkeypatch: pytest.MonkeyPatch) -> None:
    check_cost(False, frame_of_a_joint=1e6)
    monkeypatch.setattr(resource, "getrlimit", lambda _: (10**9, 10**9))
    monkeypatch.setattr(Path, "exists", lambda _: False)
    with pytest.raises(UsageError, match=r"0\.6 GB; add --yes"):
        check_cost(False, frame_of_a_joint=1e6)
    check_cost(True, frame_of_a_joint=1e6)


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
    with pytest.raises(SystemExit) as stop, ending_orderly(), files.open_replacement(tmp_path / "x"):
        os.kill(os.getpid(), number)
    assert stop.value.code == 128 + number and not list(tmp_path.iterdir())
    assert signal.signal(number, before) is signal.SIG_DFL


def test_a_signal_that_a_library_swallows_as_it_is_loaded_is_heard_all_the_same() -> None:
    """trimesh keeps whatever an import raises, to raise what it likes when it is used."""
    number = signal.SIGTERM
    with pytest.raises(SystemExit) as stop, ending_orderly():
        with suppress(BaseException):
            os.kill(os.getpid(), number)
        time.sleep(2.0)
    assert stop.value.code == 128 + number
    with pytest.raises(SystemExit) as stop, ending_orderly():
        with suppress(BaseException):
            os.kill(os.getpid(), number)
        raise TypeError("half of a library is there")
    assert stop.value.code == 128 + number
    assert signal.getitimer(signal.ITIMER_REAL)[0] == 0.0


def test_a_closed_stream_is_one_line() -> None:
    call, word = "identify turret - --follow <&-", "standard input: is closed"
    done = subprocess.run(f"'{sys.executable}' -m gimbal_pin.cli {call}", shell=True, capture_output=True, text=True)
    refused((done.returncode, done.stdout, done.stderr), 2, word)


def test_no_verb_minds_which_window_matplotlib_would_open(tmp_path: Path) -> None:
    program = "from gimbal_pin.cli import main; main(['rigs']); import matplotlib; print(matplotlib.get_backend())"
    environment = {**os.environ, "MPLBACKEND": "nonsense"}
    done = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "agg"
