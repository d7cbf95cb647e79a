"""What a verb writes: never over what it reads, and a folder's files together."""

from __future__ import annotations

import platform
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from gimbal_pin.cli import VERBS
from gimbal_pin.errors import UsageError
from gimbal_pin.log import atomic_write, write_run
from gimbal_pin.log.io import files
from gimbal_pin.rig import bundled
from tests.cli.tree import list_options, list_required
from tests.command_line import Run, refused

CLASHES = [
    ("identify rig.urdf log.csv -o log.csv", "-o", "LOG"),
    ("identify rig.urdf soft.csv --urdf log.csv", "--urdf", "LOG"),
    ("identify rig.urdf log.csv@camera.urdf -o camera.urdf", "-o", "LOG"),
    ("identify named.yaml log.csv --urdf rig.urdf", "--urdf", "RIG"),
    ("identify rig.urdf log.csv --map map.yaml -o map.yaml", "-o", "--map"),
    ("identify rig.urdf log.csv -o new.yaml --json ../{here}/new.yaml", "--json", "-o"),
    ("identify rig.urdf log.csv --known model.yaml -o model.yaml", "-o", "--force"),
    ("identify rig.urdf log.csv --follow --plot log.csv", "--plot", "LOG"),
    ("simulate rig.urdf --reference log.csv -o log.csv", "-o", "--reference"),
    ("simulate rig.urdf --platform-log log.csv -o soft.csv", "-o", "--platform-log"),
    ("track rig.urdf --platform S --learn log.csv --report log.csv", "--report", "--learn"),
    ("track rig.urdf --platform S --plot x --animation x", "--animation", "--plot"),
    ("diagnose rig.urdf out/next_experiment.csv -o out", "-o", "LOG"),
    ("diagnose rig.urdf out/earlier.csv -o out", "-o", "LOG"),
    ("diagnose rig.urdf log.csv -o out --json out/diagnosis.json", "--json", "-o"),
    ("demo -o out --rig out/rig.urdf", "-o", "--rig"),
    ("check top.xacro --json inner.urdf", "--json", "RIG"),
    ("check top.xacro --mend inner.urdf", "--mend", "RIG"),
    ("check top.xacro --json sizes.yaml", "--json", "RIG"),
    ("check mj.xml --json arm.urdf", "--json", "RIG"),
]
"""A call, what it would write over a file, and what reads that file."""
XACRO = 'xmlns:xacro="http://www.ros.org/wiki/xacro"'
TOP = (
    f'<robot name="top" {XACRO}><xacro:include filename="inner.urdf"/>'
    '<xacro:property name="sizes" value="${xacro.load_yaml(\'sizes.yaml\')}"/>'
    "<link name=\"${sizes['name']}\"/></robot>"
)
ARM = (
    '<mujoco><body><geom size="1" mass="1"/><joint name="j" axis="0 0 1" range="-1 1"/></body>'
    "</mujoco>"
)
TEXTS = {
    "named.yaml": "urdf: rig.urdf\n",
    "top.xacro": TOP,
    "sizes.yaml": "name: spare",
    "arm.urdf": ARM,
    "mj.xml": '<mujoco><worldbody><include file="arm.urdf"/></worldbody></mujoco>',
    "out/run.json": '{"schema": 1, "files": {}}',
    **dict.fromkeys(["log.csv", "map.yaml", "model.yaml", "out/next_experiment.csv"], "{"),
}


def written(folder: Path, /, **texts: str) -> tuple[str, ...]:
    """Return what `write_run` says of files with these texts."""
    writers = {name: lambda path, name=name: path.write_text(texts[name]) for name in texts}
    return write_run(folder, writers, {})


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A rig, and files that are none: a verb that read one of them would say so."""
    monkeypatch.chdir(tmp_path)
    for place in (tmp_path, tmp_path / "out"):
        place.mkdir(exist_ok=True)
        shutil.copy(bundled() / "turret.urdf", place / "rig.urdf")
    shutil.copy(bundled() / "turret.yaml", tmp_path / "rig.yaml")
    shutil.copy(bundled() / "payloads" / "cinema.urdf", tmp_path / "camera.urdf")
    inner = (tmp_path / "rig.urdf").read_text().replace("<robot", f"<robot {XACRO}", 1)
    (tmp_path / "inner.urdf").write_text(inner)
    for name, text in TEXTS.items():
        (tmp_path / name).write_text(text)
    written(tmp_path / "out", **{"earlier.csv": "{"})
    (tmp_path / "soft.csv").symlink_to("log.csv")
    return tmp_path


def content(folder: Path) -> dict[Path, bytes]:
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize(("command", "writes", "reads"), CLASHES)
def test_no_verb_writes_over_what_it_reads(
    run: Run, folder: Path, command: str, writes: str, reads: str
) -> None:
    before = content(folder)
    said = run(*command.format(here=folder.name).split())
    refused(said, 2, f"gimbal-pin: {writes}: would write over", reads)
    assert content(folder) == before


def test_devices_and_what_is_forced_are_no_clash(run: Run, folder: Path) -> None:
    """The log, which leads nowhere, is what is wrong here."""
    (folder / "log.csv").unlink()
    (folder / "log.csv").symlink_to("log.csv")
    for options in ("-o /dev/null --json /dev/null", "--known model.yaml -o model.yaml --force"):
        said = run("identify", "rig.urdf", "log.csv", *options.split())
        refused(said, 2, "log.csv: cannot be read (")


@pytest.mark.parametrize("verb", VERBS)
def test_an_unknown_suffix_is_refused_before_the_work(run: Run, folder: Path, verb: str) -> None:
    """Before anything is read: the logs, models and controllers of these calls are none."""
    for option in list_options(verb):
        if option.writes and option.writes.run is None:
            words = []
            for one in list_required(verb):
                if one.called != option.called:
                    words += [one.called] if one.called.startswith("-") else []
                    words.append("new.csv" if one.kind is Path else "turret")
            said = run(verb, *words, option.called, "no.docx")
            refused(said, 2, f"{option.called}: names no.docx")


@pytest.mark.parametrize(
    ("command", "said"),
    [
        ("identify rig.urdf log.csv -o out", "-o: is a folder"),
        ("auto rig.urdf log.csv -o log.csv/out", "-o: would be a folder where log.csv is a file"),
        ("simulate rig.urdf -o no/x.csv", "-o: lies in a folder that does not exist (no)"),
        ("auto rig.urdf log.csv -o theirs", "-o: holds report.html, which is of no earlier run"),
        ("diagnose rig.urdf log.csv -o mine", "-o: holds diagnosis.json, which was changed"),
    ],
)
def test_a_place_that_cannot_be_written_to_is_told_before_the_work(
    run: Run, folder: Path, command: str, said: str
) -> None:
    """What somebody else wrote, or edited, is left as it is."""
    (folder / "theirs").mkdir()
    (folder / "theirs" / "report.html").write_text("my report")
    written(folder / "mine", **{"diagnosis.json": "{}"})
    (folder / "mine" / "diagnosis.json").write_text("edited")
    before = content(folder)
    refused(run(*command.split()), 2, said)
    assert content(folder) == before


# --- The files of one run -----------------------------------------------------------------------


def is_one_run(folder: Path) -> bool:
    """Whether a folder's run.json is there and says of every file in it what it holds."""
    listed = files.read_run(folder)
    return bool(listed) and all(
        files.hash_file(folder / name) == found for name, found in listed.items()
    )


def test_files_of_an_older_run_do_not_stay_beside_newer_ones(tmp_path: Path) -> None:
    (tmp_path / "foreign").write_text("mine")
    assert written(tmp_path, a="1", b="1", c="1") == ()
    (tmp_path / "c").write_text("changed")
    (note,) = written(tmp_path, a="2")
    assert note.startswith(f"{tmp_path / 'c'} ")
    assert is_one_run(tmp_path)
    (tmp_path / files.RUN_FILE).unlink()
    found = {path.name: path.read_text() for path in tmp_path.iterdir()}
    assert found == {"foreign": "mine", "a": "2", "c": "changed"}


def test_a_run_that_fails_leaves_the_older_one_whole(tmp_path: Path) -> None:
    written(tmp_path, a="1", b="1")
    before = content(tmp_path)
    writers = {"a": lambda path: path.write_text("2"), "b": lambda path: 1 / 0}
    with pytest.raises(ZeroDivisionError):
        write_run(tmp_path, writers, {})
    (tmp_path / "folder").mkdir()
    with pytest.raises(UsageError, match="is a folder"):
        written(tmp_path, a="2", folder="2")
    assert content(tmp_path) == before


@pytest.mark.parametrize("killed_at", range(4))
def test_a_folder_that_says_whose_it_is_is_never_a_mixture(tmp_path: Path, killed_at: int) -> None:
    """Cut off before the n-th file of three and run.json takes its place."""
    written(tmp_path, a="1", b="1", c="1")
    moved = iter([files.move_into_place] * killed_at)

    def move(temporary: Path, target: Path, special: bool = False) -> None:
        if target.parent == tmp_path:
            next(moved)(temporary, target, special)
        else:
            shutil.move(temporary, target)

    with pytest.MonkeyPatch.context() as patch, pytest.raises(StopIteration):
        patch.setattr(files, "move_into_place", move)
        written(tmp_path, a="2", b="2", c="2")
    assert not is_one_run(tmp_path)
    written(tmp_path, a="3", b="3", c="3")
    assert is_one_run(tmp_path)


def test_what_a_killed_run_left_goes_and_what_another_writes_stays(tmp_path: Path) -> None:
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    left = tmp_path / f"{files.STAGING_PREFIX}{platform.node()}-{ended.pid}-x"
    left.mkdir()
    (left / "a").write_text("half")
    with files.open_replacement(tmp_path / "a") as first:
        assert not left.exists()
        atomic_write(tmp_path / "b", "other")
        first.write_text("whole")
    assert content(tmp_path) == {tmp_path / "a": b"whole", tmp_path / "b": b"other"}
