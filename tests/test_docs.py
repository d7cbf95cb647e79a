"""README and docs/: every command and snippet runs, in the order of its page, in an empty folder.

A block that is titled is a file of that name. ``<!-- slow -->`` before a block leaves it to ``scripts/docs --run``,
which runs the tests marked `slow`. Blocks of ``text`` are not run.
"""

from __future__ import annotations

import importlib
import json
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import pytest
import yaml

import gimbal_pin
from gimbal_pin.checks import CHECKS
from gimbal_pin.cli import VERBS, parse_arguments
from gimbal_pin.effects import CAUSES
from tests.browsing import OPEN, audit, media, needs_browser, pause, visit, wide
from tests.command_line import Run, whole

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs" / "pages").glob("*.md"))]
BLOCK = re.compile(r'(?:<!-- (\w+) -->\n)?```(\w+)(?: title="([^"]+)")?\n(.*?)```', re.S)
LINK = re.compile(r"\]\((?!https?:|#)([^)#]+)")


class Block(NamedTuple):
    """A fenced block: the mark before it, its language, its title and its text."""

    mark: str
    language: str
    title: str
    text: str

    @property
    def commands(self) -> list[list[str]]:
        """The words of its calls of gimbal-pin; scripts/… are commands of the checkout, which run elsewhere."""
        calls = (
            [shlex.split(line, comments=True) for line in self.text.splitlines()]
            if self.language == "sh"
            else []
        )
        return [words[1:] for words in calls if words and words[0] == "gimbal-pin"]


def blocks(page: Path) -> Iterator[Block]:
    return (Block(*found) for found in BLOCK.findall(page.read_text(encoding="utf-8")))


def held(folder: Path) -> None:
    """`auto` held the camera on a moving platform as well, better than a PID, and shows it."""
    found = json.loads((folder / "results.json").read_text())
    jitter = {row["controller"]: row["jitter_rms_deg"] for row in found["track"]["pointing"]}
    assert jitter["computed-torque"] < 0.5 * jitter["pid"] and found["not_held"] is None
    assert "camera" in found["files"] and 'class="gaze"' in (folder / "report.html").read_text()


RUN = [
    pytest.param(
        page,
        slow,
        marks=[pytest.mark.slow] if slow else [],
        id=f"{page.stem}{'-slow' if slow else ''}",
    )
    for page in PAGES
    for slow in (False, True)
    if any(
        (block.mark == "slow") == slow and (block.commands or block.language == "python")
        for block in blocks(page)
    )
]


@pytest.mark.parametrize(("page", "slow"), RUN)
def test_what_a_page_shows_runs(
    page: Path, slow: bool, run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    for block in blocks(page):
        if block.mark == "slow" and not slow:
            continue
        if block.title:
            Path(block.title).write_text(block.text, encoding="utf-8")
        elif block.language == "python":
            exec(compile(block.text, str(page), "exec"), names)
        for words in block.commands:
            code, _, err = run(*words)
            assert code == 0, f"{shlex.join(words)}: {err}"
    if page.stem == "README" and slow:
        whole(tmp_path / "out")
        held(tmp_path / "out")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_commands_and_links_of_a_page_are_there(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The slow ones, too: a call that the parser takes, a file that a link names, a program in scripts/."""
    monkeypatch.chdir(tmp_path)
    text = page.read_text(encoding="utf-8")
    for block in blocks(page):
        if block.title:
            Path(block.title).write_text(block.text, encoding="utf-8")
        for words in block.commands:
            parse_arguments(words)
    for program in re.findall(r"\bscripts/[\w-]+(?:\.py)?", text):
        assert (ROOT / program).is_file(), program
    for link in LINK.findall(text):
        assert (page.parent / link).exists(), link


def test_commands_and_links_for_language_models_are_there() -> None:
    """Each call in llms.txt is one that the parser takes, each page that it links has its source."""
    page = ROOT / "docs" / "pages" / "llms.txt"
    text = " ".join(page.read_text(encoding="utf-8").split())
    calls = [
        shlex.split(call.replace("RIG", "turret").replace("NEW.urdf", "cinema"))
        for call in re.findall(r"`([^`]+)`", text)
    ]
    calls = [words[words[0] == "gimbal-pin" :] for words in calls]
    verbs = [words for words in calls if words and words[0] in VERBS and len(words) > 1]
    assert {words[0] for words in verbs} >= {
        "check",
        "identify",
        "diagnose",
        "tune",
        "track",
        "export",
        "auto",
    }
    for words in verbs:
        parse_arguments(words)
    for link in LINK.findall(text):
        assert (page.parent / link).with_suffix(".md").exists(), link


def test_the_reference_has_every_public_name() -> None:
    """And, below *Results*, what these return: names of the rooms, which are there."""
    text = (ROOT / "docs" / "pages" / "reference.md").read_text(encoding="utf-8")
    functions, results = (
        re.findall(r"^::: ([\w.]+)$", part, re.M) for part in text.split("## Results")
    )
    functions += [name for name in results if name.count(".") == 1]
    assert sorted(name.rpartition(".")[2] for name in functions) == sorted(gimbal_pin.__all__)
    for room, _, name in (name.rpartition(".") for name in results):
        assert hasattr(importlib.import_module(room), name)


def test_readme_and_changelog_are_short() -> None:
    for name, most in (("README.md", 150), ("CHANGELOG.md", 100)):
        assert len((ROOT / name).read_text(encoding="utf-8").splitlines()) <= most


def test_places_that_contributing_names_are_there() -> None:
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    for place in re.findall(r"`((?:gimbal_pin|tests|docs|urdf|scripts)/[\w./]*)`", text):
        assert (ROOT / place).exists(), place
    rooms = {path.parent.name for path in (ROOT / "gimbal_pin").glob("*/__init__.py")}
    assert set(re.findall(r"^\| `(\w+)/` ", text, re.M)) == rooms


def test_the_page_of_causes_has_them_all() -> None:
    text = (ROOT / "docs" / "pages" / "causes.md").read_text(encoding="utf-8")
    assert {*CAUSES, *CHECKS, "platform-motion"} <= set(re.findall(r"`([a-z-]+)`", text))


def test_the_conda_recipe_asks_for_what_the_package_does() -> None:
    """Names as conda-forge has them, versions as pyproject.toml, and the command."""
    tomllib = pytest.importorskip("tomllib")
    names = {"pin": "pinocchio", "meshcat": "meshcat-python", "matplotlib": "matplotlib-base"}
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    recipe = yaml.safe_load((ROOT / "docs" / "conda" / "recipe.yaml").read_text(encoding="utf-8"))
    wanted = [re.match(r"([\w-]+)(.*)", line) for line in project["dependencies"]]
    asked = {f"{names.get(found[1], found[1])} {found[2]}" for found in wanted if found}
    assert {*recipe["requirements"]["run"][1:]} == asked
    assert recipe["context"]["version"] == project["version"]
    assert recipe["build"]["python"]["entry_points"] == [
        f"{k} = {v}" for k, v in project["scripts"].items()
    ]


@pytest.mark.slow
@needs_browser
def test_axe_has_nothing_against_the_built_pages_light_or_dark(tmp_path: Path) -> None:
    """Built as scripts/docs does; the page that servers show for what is not there is no page on a disk."""
    pytest.importorskip("mkdocs")
    build = [
        sys.executable,
        "-m",
        "mkdocs",
        "build",
        "--quiet",
        "--config-file",
        "docs/mkdocs.yml",
        "-d",
        str(tmp_path),
    ]
    subprocess.run(build, env={**os.environ, "PYTHONPATH": "docs"}, cwd=ROOT, check=True)
    for page in sorted(set(tmp_path.glob("*.html")) - {tmp_path / "404.html"}):
        found = list[Any]()
        audits = [
            step
            for scheme in ("light", "dark")
            for step in (media("screen", scheme), pause(1.0), audit(found))
        ]
        seen = visit(page.as_uri(), OPEN, wide(1280), *audits)
        assert (found, seen.complaints) == ([], [])
        assert all(one.startswith(tmp_path.as_uri()) for one in seen.requests)
