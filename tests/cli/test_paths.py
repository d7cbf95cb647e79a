"""What a verb writes: never over what it reads, and a folder's files together."""

from __future__ import annotations

import json
import platform
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from inspect import get_annotations, signature
from pathlib import Path
from typing import Any, get_args

import pytest

from gimbal_pin.cli import VERBS, parse_arguments, paths
from gimbal_pin.errors import UsageError
from gimbal_pin.log.io import files
from gimbal_pin.rig import bundled
from tests.command_line import Run, refused

CLASHES = [
    ("identify rig.urdf log.csv -o log.csv", "-o", "LOG"),
    ("identify rig.urdf soft.csv --urdf log.csv", "--urdf", "LOG"),
    ("identify rig.urdf log.csv@camera.urdf -o camera.urdf", "-o", "LOG"),
    ("identify rig.urdf log.csv --urdf rig.urdf", "--urdf", "RIG"),
    ("identify rig.urdf log.csv -o rig.yaml", "-o", "RIG"),
    ("identify named.yaml log.csv -o named.yaml", "-o", "RIG"),
    ("identify named.yaml log.csv --urdf rig.urdf", "--urdf", "RIG"),
    ("identify rig.urdf log.csv --map map.yaml -o map.yaml", "-o", "--map"),
    ("identify rig.urdf log.csv -o new.yaml --json ../{here}/new.yaml", "--json", "-o"),
    ("identify rig.urdf log.csv --known model.yaml -o model.yaml", "-o", "--force"),
    ("identify rig.urdf log.csv --known model.yaml --force --json log.csv", "--json", "LOG"),
    ("identify rig.urdf log.csv --follow --plot log.csv", "--plot", "LOG"),
    ("check rig.urdf --payload camera.urdf --json camera.urdf", "--json", "--payload"),
    ("simulate rig.urdf --reference log.csv -o log.csv", "-o", "--reference"),
    ("simulate rig.urdf --controller model.yaml -o model.yaml", "-o", "--controller"),
    ("simulate rig.urdf --platform-log log.csv -o soft.csv", "-o", "--platform-log"),
    ("excite rig.urdf --after log.csv --json log.csv -o x.csv", "--json", "--after"),
    ("animate rig.urdf log.csv -o log.csv", "-o", "LOG"),
    ("tune rig.urdf model.yaml -o model.yaml", "-o", "LOG|MODEL"),
    ("tune rig.urdf model.yaml -o x.yaml --plot x.yaml", "--plot", "-o"),
    ("track rig.urdf model.yaml --json model.yaml", "--json", "CONTROLLER"),
    ("track rig.urdf --platform S --learn log.csv --report log.csv", "--report", "--learn"),
    ("track rig.urdf --platform S --plot x --animation x", "--animation", "--plot"),
    ("diagnose rig.urdf out/next_experiment.csv -o out", "-o", "LOG"),
    ("diagnose rig.urdf out/earlier.csv -o out", "-o", "LOG"),
    ("diagnose rig.urdf log.csv -o out --json out/diagnosis.json", "--json", "-o"),
    ("auto out/rig.urdf log.csv -o out", "-o", "RIG"),
    ("auto rig.urdf out/motion.csv -o out", "-o", "LOG"),
    ("demo -o out --rig out/rig.urdf", "-o", "--rig"),
]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A rig, and files that are none: a verb that read one of them would say so."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "out").mkdir()
    for name in ("rig.urdf", "out/rig.urdf"):
        shutil.copy(bundled() / "turret.urdf", tmp_path / name)
    shutil.copy(bundled() / "turret.yaml", tmp_path / "rig.yaml")
    shutil.copy(bundled() / "payloads" / "cinema.urdf", tmp_path / "camera.urdf")
    (tmp_path / "named.yaml").write_text("urdf: rig.urdf\n")
    for name in (
        "log.csv",
        "map.yaml",
        "model.yaml",
        "out/next_experiment.csv",
        "out/motion.csv",
        "out/earlier.csv",
    ):
        (tmp_path / name).write_text("{")
    earlier = {"earlier.csv": files.hash_file(tmp_path / "out" / "earlier.csv")}
    (tmp_path / "out" / "run.json").write_text(json.dumps({"schema": 1, "files": earlier}))
    (tmp_path / "soft.csv").symlink_to("log.csv")
    return tmp_path


def content(folder: Path) -> dict[Path, bytes]:
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize(
    ("command", "writes", "reads"), CLASHES, ids=[command for command, *_ in CLASHES]
)
def test_no_verb_writes_over_what_it_reads(
    run: Run, folder: Path, command: str, writes: str, reads: str
) -> None:
    before = content(folder)
    refused(
        run(*command.format(here=folder.name).split()),
        2,
        f"gimbal-pin: {writes}: would write over",
        reads,
    )
    assert content(folder) == before


@pytest.mark.parametrize(
    "options", ["-o /dev/null --json /dev/null", "--known model.yaml -o model.yaml --force"]
)
def test_devices_and_what_is_forced_are_no_clash(run: Run, folder: Path, options: str) -> None:
    """The log, which is none, is what is wrong here."""
    said = run("identify", "rig.urdf", "log.csv", *options.split())
    refused(said, 2)
    assert "would write over" not in said[2]


@pytest.mark.parametrize(
    "call", ["check {}", "check turret --json {}", "identify turret {}", "identify turret x -o {}"]
)
def test_a_path_that_the_system_refuses_is_told(run: Run, call: str) -> None:
    refused(run(*call.format("a" * 5000 + ".csv").split()), 2, "aaa")


def every_option(of: Any) -> Iterator[tuple[str, Any, tuple[Any, ...]]]:
    """Name, type and annotations of every option of a verb, nested ones too."""
    defaults = {name: given.default for name, given in signature(of).parameters.items()}
    nested = {id(value) for value in defaults.values() if hasattr(value, "__dataclass_fields__")}
    for name, hint in get_annotations(of, eval_str=True).items():
        if id(defaults.get(name)) in nested:
            yield from every_option(type(defaults[name]))
        else:
            kind, *marks = get_args(hint) if hasattr(hint, "__metadata__") else (hint,)
            yield name, kind, tuple(marks)


@pytest.mark.parametrize("verb", VERBS)
def test_every_option_has_a_name_of_its_own(verb: str) -> None:
    given = dict.fromkeys(signature(VERBS[verb]).parameters, "value")
    assert len({label for label, *_ in paths.list_options(VERBS[verb], given)}) == len(given)


OUTPUTS = [
    (verb, paths.label(name, marks), mark)
    for verb in VERBS
    for name, _, marks in every_option(VERBS[verb])
    for mark in marks
    if isinstance(mark, paths.Writes) and mark.run is None
]
"""Verb, name on its command line and mark of every file that it may write."""


@pytest.mark.parametrize(
    ("verb", "option", "mark"), OUTPUTS, ids=[f"{verb} {option}" for verb, option, _ in OUTPUTS]
)
@pytest.mark.parametrize("suffix", [".docx", ""])
def test_an_unknown_suffix_is_refused_before_the_work(
    run: Run, folder: Path, verb: str, option: str, mark: paths.Writes, suffix: str
) -> None:
    """Before anything is read: the logs, models and controllers of these calls are a rig's name."""
    words = []
    for name, kind, marks in every_option(VERBS[verb]):
        given = signature(VERBS[verb]).parameters.get(name)
        called = paths.label(name, marks)
        if given is not None and given.default is given.empty and called != option:
            words += [called, "new.csv"] if called.startswith("-") or kind is Path else ["turret"]
    known = ", ".join(mark.list_suffixes())
    said = run(verb, *words, option, f"no{suffix}")
    refused(said, 2, f"gimbal-pin: {option}: names no{suffix}; give it a name that ends in {known}")
    assert known and not Path(f"no{suffix}").exists()


def one_run(folder: Path) -> bool:
    """Whether a folder's run.json is there and says of every file in it what it holds."""
    listed = files.read_run(folder)
    return bool(listed) and all(
        files.hash_file(folder / name) == found for name, found in listed.items()
    )


def written(folder: Path, /, **text: str) -> tuple[str, ...]:
    """What `write_run` says of files with these texts."""
    return files.write_run(
        folder, {name: lambda path, name=name: path.write_text(text[name]) for name in text}, {}
    )


def test_files_of_an_older_run_do_not_stay_beside_newer_ones(tmp_path: Path) -> None:
    (tmp_path / "foreign").write_text("mine")
    assert written(tmp_path, a="1", b="1", c="1") == () and one_run(tmp_path)
    (tmp_path / "c").write_text("changed")
    (note,) = written(tmp_path, a="2")
    assert note.startswith(f"{tmp_path / 'c'} ") and one_run(tmp_path)
    assert {
        path.name: path.read_text() for path in tmp_path.iterdir() if path.name != files.RUN_FILE
    } == {
        "foreign": "mine",
        "a": "2",
        "c": "changed",
    }


def test_a_run_that_fails_leaves_the_older_one_whole(tmp_path: Path) -> None:
    written(tmp_path, a="1", b="1")
    before = content(tmp_path)
    with pytest.raises(ZeroDivisionError):
        files.write_run(
            tmp_path, {"a": lambda path: path.write_text("2"), "b": lambda path: 1 / 0}, {}
        )
    (tmp_path / "folder").mkdir()
    with pytest.raises(UsageError, match="is a folder"):
        written(tmp_path, a="2", folder="2")
    assert content(tmp_path) == before and not list(tmp_path.glob(f"{files.STAGING_PREFIX}*"))


@pytest.mark.parametrize("killed_at", range(4))
def test_a_folder_that_says_whose_it_is_is_never_a_mixture(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, killed_at: int
) -> None:
    """Cut off before the n-th file of three and run.json takes its place, in a folder that has others' files, too."""
    (tmp_path / "foreign").write_text("mine")
    written(tmp_path, a="1", b="1", c="1")
    calls = [0]
    put = files.move_into_place

    def cut_off(temporary: Path, target: Path, special: bool = False) -> None:
        calls[0] += target.parent == tmp_path
        if calls[0] > killed_at:
            raise KeyboardInterrupt
        put(temporary, target)

    monkeypatch.setattr(files, "move_into_place", cut_off)
    with pytest.raises(KeyboardInterrupt):
        written(tmp_path, a="2", b="2", c="2")
    assert not one_run(tmp_path)
    monkeypatch.setattr(files, "move_into_place", put)
    written(tmp_path, a="3", b="3", c="3")
    assert one_run(tmp_path)


def test_what_a_killed_run_left_goes_and_what_another_writes_stays(tmp_path: Path) -> None:
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    left = tmp_path / f"{files.STAGING_PREFIX}{platform.node()}-{ended.pid}-x"
    left.mkdir()
    (left / "a").write_text("half")
    with files.open_replacement(tmp_path / "a") as first:
        assert not left.exists()
        files.atomic_write(tmp_path / "b", "other")
        first.write_text("whole")
    assert content(tmp_path) == {tmp_path / "a": b"whole", tmp_path / "b": b"other"}


@pytest.mark.parametrize(
    ("command", "said"),
    [
        (
            "identify rig.urdf log.csv -o notes.csv",
            "-o: names notes.csv; give it a name that ends in .yaml",
        ),
        (
            "tune rig.urdf log.csv -o notes.csv",
            "-o: names notes.csv; give it a name that ends in .yaml",
        ),
        (
            "check rig.urdf --json notes.csv",
            "--json: names notes.csv; give it a name that ends in .json",
        ),
        (
            "identify rig.urdf log.csv --urdf notes.csv",
            "--urdf: names notes.csv; give it a name that ends in .urdf",
        ),
        ("identify rig.urdf log.csv -o out", "-o: is a folder"),
        ("auto rig.urdf log.csv -o log.csv/out", "-o: would be a folder where log.csv is a file"),
        ("simulate rig.urdf -o no/x.csv", "-o: lies in a folder that does not exist (no)"),
        ("auto rig.urdf log.csv -o theirs", "-o: holds report.html, which is of no earlier run"),
        (
            "diagnose rig.urdf log.csv -o mine",
            "-o: holds diagnosis.json, which was changed after the run that wrote it",
        ),
    ],
)
def test_a_place_that_cannot_be_written_to_is_told_before_the_work(
    run: Run, folder: Path, command: str, said: str
) -> None:
    """Before anything is read: the log is none. What somebody else wrote, or edited, is left as it is."""
    (folder / "notes.csv").write_text("my notes")
    (folder / "theirs").mkdir()
    (folder / "theirs" / "report.html").write_text("my report")
    (folder / "mine").mkdir()
    written(folder / "mine", **{"diagnosis.json": "{}"})
    (folder / "mine" / "diagnosis.json").write_text("edited")
    before = content(folder)
    refused(run(*command.split()), 2, said)
    assert content(folder) == before


def test_what_a_rig_includes_is_read_as_well(run: Run, folder: Path) -> None:
    """By a macro's include, by its load_yaml, and by an include of MJCF."""
    text = (folder / "rig.urdf").read_text()
    inner = text.replace("<robot", '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"', 1)
    (folder / "inner.urdf").write_text(inner)
    top = '<robot name="top" xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:include filename="inner.urdf"/>'
    sizes = '<xacro:property name="sizes" value="${xacro.load_yaml(\'sizes.yaml\')}"/>'
    spare = "<link name=\"${sizes['name']}\"/></robot>"
    (folder / "top.xacro").write_text(top + sizes + spare)
    (folder / "sizes.yaml").write_text("name: spare")
    body = '<body><geom size="1" mass="1"/><joint name="j" axis="0 0 1" range="-1 1"/></body>'
    (folder / "arm.urdf").write_text(f"<mujoco>{body}</mujoco>")
    (folder / "mj.xml").write_text(
        '<mujoco><worldbody><include file="arm.urdf"/></worldbody></mujoco>'
    )
    before = content(folder)
    for words in (
        "top.xacro --json inner.urdf",
        "top.xacro --mend inner.urdf",
        "top.xacro --json sizes.yaml",
    ):
        refused(run("check", *words.split()), 2, "would write over", "which RIG reads")
    pytest.importorskip("mujoco")
    refused(run("check", "mj.xml", "--json", "arm.urdf"), 2, "would write over", "which RIG reads")
    assert content(folder) == before


CALLS = (
    "auto turret log.csv -o out --plants 5 --verbose --map tau_pan=i*0.1 --map tau_tilt=j",
    "diagnose turret log.csv other.csv --cutoff 8.0 --seed 3",
    "track turret controller.yaml --platform S --effect a --effect b --report page.html",
    "demo -o out --rig handheld --seconds 10.0",
)


def parse(words: list[str]) -> tuple[Callable[..., None], dict[str, Any]]:
    """Return the verb that words name, and its arguments."""
    call: Any = parse_arguments(words)
    return call.func, dict(signature(call.func).bind(*call.args, **call.keywords).arguments)


@pytest.mark.parametrize("words", CALLS)
def test_the_call_that_a_page_names_means_what_was_typed(words: str) -> None:
    """Spelled and parsed again, the arguments are the same; what is as usual is not spelled."""
    spelled = paths.spell_call(*parse(words.split()))
    assert parse(shlex.split(spelled)[1:]) == parse(words.split())
    assert len(spelled.split()) <= len(words.split()) + 1


def test_a_page_names_what_was_read_without_where_it_lies(folder: Path) -> None:
    call = parse(
        ["diagnose", str(folder / "rig.urdf"), str(folder / "log.csv"), "-o", str(folder / "new")]
    )
    assert paths.spell_call(*call) == "gimbal-pin diagnose rig.urdf log.csv -o new"
    assert {file.name for file in paths.list_read_files(*call)} >= {"rig.urdf", "log.csv"}


@pytest.mark.parametrize(("target", "name"), [("log.csv", "log.csv"), ("/proc/self/mem", "mem")])
def test_a_log_that_leads_nowhere_or_cannot_be_read_is_refused_by_name(
    folder: Path, run: Run, target: str, name: str
) -> None:
    """A link to itself is no file, and a process's memory begins with what nobody may read: neither has a hash."""
    (folder / "log.csv").unlink()
    (folder / "log.csv").symlink_to(target)
    refused(run("inspect", "log.csv"), 2, f"{name}: cannot be read (")
