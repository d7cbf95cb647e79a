"""Words on the command line become arguments, messages one safe line, limits of the system errors.

Laws: every option of every verb parses to what was spelled; every number has bounds that its
refusal names; a message is one short line that a terminal shows; a signal, a closed stream or a
lack of memory ends a verb orderly.
"""

from __future__ import annotations

import errno
import io
import os
import pickle
import shlex
import signal
import subprocess
import sys
from inspect import signature
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gimbal_pin.cli import VERBS, exit_on_signals, parse_arguments
from gimbal_pin.cli.paths import spell_call
from gimbal_pin.cli.present import say
from gimbal_pin.errors import LONGEST_MESSAGE, UNSAFE, GimbalPinError, UsageError
from gimbal_pin.log.io.files import open_replacement
from tests.cli.tree import fill, list_options
from tests.command_line import Run, refused


@pytest.mark.parametrize("verb", VERBS)
def test_every_option_of_every_verb_means_what_was_spelled(verb: str, run: Run) -> None:
    """What is as usual is not spelled; of absolute paths a page names the last parts alone."""
    code, page, _ = run(verb, "--help")
    assert code == 0
    for option in list_options(verb):
        assert option.called in page
        arguments = fill(verb, option)
        words = shlex.split(spell_call(VERBS[verb], arguments))
        call = parse_arguments(words[1:])
        found = signature(VERBS[verb]).bind(*call.args, **call.keywords).arguments  # type: ignore[attr-defined]
        assert {name: found[name] for name in arguments} == arguments
    assert spell_call(VERBS["check"], {"rig": "/somewhere/x.yaml"}) == "gimbal-pin check x.yaml"


HOSTILE = ("nan", "inf", "-1e11", "1" + "0" * 400, "9" * 6000, "", "x\x1b[31m", "None", "١")


@pytest.mark.parametrize("verb", VERBS)
def test_every_number_has_bounds_that_its_refusal_names(verb: str) -> None:
    for option in list_options(verb):
        if not {int, float} & {option.kind, *getattr(option.kind, "__args__", ())}:
            continue
        assert option.bounds, option.name
        low, _, rest = option.bounds.metavar.partition("..")
        high, *unit = rest.split()
        for end in (low, high):
            assert option.bounds.instance_from_str([end]) == float(end)
        for value in HOSTILE:
            with pytest.raises(UsageError) as caught:
                option.bounds.instance_from_str([value])
            said = str(caught.value)
            assert said.startswith(f"{option.called}: is ")
            assert said.endswith(" ".join([f"{low} to {high}", *unit]))


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("nonsense", "nonsense"),
        ("base nowhere.urdf", "nowhere.urdf"),
        ("check rig.yaml", "moters"),
        ("identify nowhere.urdf log.csv --cutoff nan", "--cutoff: is nan; give 0.1 to 1000 Hz"),
        ("track nowhere.urdf --seeds 2.5", "--seeds: is '2.5'; give a whole number from 1"),
        ("track turret", "--platform S"),
        ("track turret --platform S --platform-log x.csv", "--platform: is given beside"),
        ("track turret --platform S --learn x.csv --fault clock:3:-1", "--fault"),
        ("inspect", "at least one file"),
        (f"check {'a' * 5000}.csv", "aaa"),
        (f"identify turret x -o {'a' * 5000}.csv", "aaa"),
    ],
)
def test_bad_usage_is_one_line(
    words: str, said: str, run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("rig.yaml").write_text("urdf: turret\nmoters: {}\n")
    refused(run(*words.split()), 2, said)


# --- Messages -----------------------------------------------------------------------------------


@given(st.tuples(*[st.text() | st.text(min_size=200, max_size=2000)] * 3))
def test_a_message_is_one_short_line_that_a_terminal_shows(parts: tuple[str, str, str]) -> None:
    error = GimbalPinError(*parts)
    said = str(error)
    assert len(said) <= LONGEST_MESSAGE
    assert len(said.splitlines()) <= 1
    assert not UNSAFE.search(said)
    again = pickle.loads(pickle.dumps(error))
    assert (str(again), type(again)) == (said, GimbalPinError)


@pytest.mark.parametrize(("code", "shown"), [("ascii", rb"\xe9"), ("utf-8", "é".encode())])
def test_what_a_terminal_would_obey_is_written_out(
    code: str, shown: bytes, run: Run, tmp_path: Path
) -> None:
    stream = io.TextIOWrapper(io.BytesIO(), encoding=code)
    say("é \x1b[2J \udcff \u202e\nnext", stream)
    stream.seek(0)
    assert stream.buffer.read() == shown + rb" \x1b[2J \udcff \u202e" + b"\nnext\n"
    name = tmp_path / "a\x1b[31m\x9b\u202eb.csv"
    name.write_text("t,q_\x1b[2Jpan\n0,1\n")
    said = run("identify", "turret", name)
    refused(said, 2, r"\x1b[31m\x9b\u202eb.csv")
    assert not UNSAFE.search(said[2].rstrip("\n"))


# --- Limits of the system -----------------------------------------------------------------------


def test_a_signal_ends_it_orderly(tmp_path: Path) -> None:
    number = signal.SIGTERM
    before = signal.signal(number, signal.SIG_DFL)
    with (
        pytest.raises(SystemExit) as stop,
        exit_on_signals(),
        open_replacement(tmp_path / "x"),
    ):
        os.kill(os.getpid(), number)
    assert stop.value.code == 128 + number
    assert not list(tmp_path.iterdir())
    assert signal.signal(number, before) is signal.SIG_DFL


def test_a_working_folder_that_was_deleted_is_one_line(run: Run, tmp_path: Path) -> None:
    gone = tmp_path / "gone"
    gone.mkdir()
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(gone)
        gone.rmdir()
        refused(run("identify", "turret", tmp_path / "log.csv"), 2)
        refused(run("simulate", "turret", "-o", tmp_path / "log.csv"), 2)


LIMITED = "import resource as r; r.setrlimit(r.RLIMIT_AS, (5 * 10**8, 5 * 10**8))"


@pytest.mark.parametrize(
    ("program", "said"),
    [
        (f"{LIMITED}; from gimbal_pin.cli import main; main(['rigs'])", "ulimit -v"),
        (
            "import sys; sys.stdin = None; from gimbal_pin.cli import main; "
            "main(['identify', 'turret', '-', '--follow'])",
            "standard input: is closed",
        ),
    ],
)
def test_a_limit_that_no_verb_can_work_under_is_one_line(program: str, said: str) -> None:
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    refused((done.returncode, done.stdout, done.stderr), 2, said)


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (OSError(errno.EMFILE, "Too many open files"), "ulimit -n"),
        (MemoryError(), "memory"),
        (RuntimeError("can't start new thread"), "memory"),
        (OSError(errno.ENAMETOOLONG, "File name too long", "aaa.csv"), "aaa.csv"),
        (ZeroDivisionError(), None),
    ],
)
def test_what_the_system_lacks_is_one_line_and_a_defect_keeps_its_traceback(
    run: Run, monkeypatch: pytest.MonkeyPatch, error: Exception, said: str | None
) -> None:
    def fail(words: object) -> None:
        raise error

    monkeypatch.setattr("gimbal_pin.cli.parse_arguments", fail)
    if said is None:
        with pytest.raises(ZeroDivisionError):
            run("rigs")
    else:
        refused(run("rigs"), 2, said)
