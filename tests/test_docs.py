"""Laws of README and docs/: every command and snippet runs, every call, link and name in them exists.

The blocks of a page run in their order, in an empty folder. A block that is titled is a file of
that name. ``<!-- slow -->`` before a block leaves it to ``scripts/docs --run``, which runs the
tests marked `slow`. Blocks of ``text`` are not run.
"""

from __future__ import annotations

import importlib
import re
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import pytest
import yaml

import gimbal_pin
from gimbal_pin.checks import CHECKS
from gimbal_pin.cli import VERBS, parse_arguments
from gimbal_pin.effects import CAUSES
from tests.command_line import Run, whole

ROOT = Path(__file__).parents[1]
SOURCES = ROOT / "docs" / "pages"
PAGES = [ROOT / "README.md", *sorted(SOURCES.glob("*.md"))]
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
        """Words of its calls of gimbal-pin."""
        lines = self.text.splitlines() if self.language == "sh" else []
        calls = [shlex.split(line, comments=True) for line in lines]
        return [words[1:] for words in calls if words and words[0] == "gimbal-pin"]


def list_blocks(page: Path) -> list[Block]:
    """Return the blocks of a page."""
    return [Block(*found) for found in BLOCK.findall(page.read_text(encoding="utf-8"))]


def write_files(page: Path) -> None:
    """Write the blocks that are files where the test runs."""
    for block in list_blocks(page):
        if block.title:
            Path(block.title).write_text(block.text, encoding="utf-8")


def list_runs() -> Iterator[Any]:
    """Yield the pages with blocks that run, each with whether its slow blocks do so too."""
    for page in PAGES:
        blocks = list_blocks(page)
        marks = {block.mark for block in blocks if block.language == "python" or block.commands}
        if marks - {"slow"}:
            yield pytest.param(page, False, id=page.stem)
        if "slow" in marks:
            yield pytest.param(page, True, id=f"{page.stem}-slow", marks=pytest.mark.slow)


@pytest.fixture(autouse=True)
def _in_an_empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize(("page", "slow"), [*list_runs()])
def test_what_a_page_shows_runs(page: Path, slow: bool, run: Run) -> None:
    write_files(page)
    names: dict[str, object] = {}
    for block in list_blocks(page):
        if block.mark == "slow" and not slow:
            continue
        if block.language == "python" and not block.title:
            exec(compile(block.text, str(page), "exec"), names)
        for words in block.commands:
            code, _, err = run(*words)
            assert code == 0, f"{shlex.join(words)}: {err}"
    if page.stem == "README" and slow:
        whole(Path("out"))


def list_calls(page: Path) -> list[list[str]]:
    """Return the calls of a page: of its blocks, and of one for language models those in its text."""
    if page.suffix == ".md":
        return [words for block in list_blocks(page) for words in block.commands]
    text = " ".join(page.read_text(encoding="utf-8").split())
    text = text.replace("RIG", "turret").replace("NEW.urdf", "cinema")
    calls = [shlex.split(call.removeprefix("gimbal-pin ")) for call in re.findall("`(.+?)`", text)]
    return [words for words in calls if len(words) > 1 and words[0] in VERBS]


@pytest.mark.parametrize("page", [*PAGES, SOURCES / "llms.txt"], ids=lambda page: page.stem)
def test_commands_and_links_of_a_page_are_there(page: Path) -> None:
    write_files(page)
    for words in list_calls(page):
        parse_arguments(words)
    text = page.read_text(encoding="utf-8")
    for program in re.findall(r"\bscripts/[\w-]+(?:\.py)?", text):
        assert (ROOT / program).is_file(), program
    for link in LINK.findall(text):
        place = page.parent / link
        assert place.exists() or place.with_suffix(".md").exists(), link


def test_the_reference_has_every_public_name() -> None:
    """Below *Results* it lists what these return and take as well; names of the rooms among it exist."""
    text = (SOURCES / "reference.md").read_text(encoding="utf-8")
    for place in re.findall(r"^::: ([\w.]+)$", text, re.M):
        room, _, name = place.rpartition(".")
        assert hasattr(importlib.import_module(room), name), place
    functions = re.findall(r"^::: [\w.]+\.(\w+)$", text.partition("## Results")[0], re.M)
    listed = [*functions, *re.findall(r"^::: gimbal_pin\.(\w+)$", text, re.M)]
    assert {*functions} <= {*gimbal_pin.__all__} <= {*listed}


def test_pages_name_every_cause_and_every_place() -> None:
    causes = (SOURCES / "causes.md").read_text(encoding="utf-8")
    assert {*CAUSES, *CHECKS, "platform-motion"} <= set(re.findall(r"`([a-z-]+)`", causes))
    contributing = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    for place in re.findall(r"`((?:gimbal_pin|tests|docs|urdf|scripts)/[\w./]*)`", contributing):
        assert (ROOT / place).exists(), place
    rooms = {path.parent.name for path in (ROOT / "gimbal_pin").glob("*/__init__.py")}
    assert set(re.findall(r"^\| `(\w+)/` ", contributing, re.M)) == rooms


def test_the_conda_recipe_asks_for_what_the_package_does() -> None:
    tomllib = pytest.importorskip("tomllib")
    names = {"pin": "pinocchio", "meshcat": "meshcat-python", "matplotlib": "matplotlib-base"}
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    recipe = yaml.safe_load((ROOT / "docs" / "conda" / "recipe.yaml").read_text(encoding="utf-8"))
    wanted = [re.fullmatch(r"([\w-]+)(.*)", line) for line in project["dependencies"]]
    asked = {f"{names.get(found[1], found[1])} {found[2]}" for found in wanted if found}
    assert {*recipe["requirements"]["run"][1:]} == asked
    assert recipe["context"]["version"] == project["version"]
