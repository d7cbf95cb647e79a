"""The notebooks run in IPython, and every cell of code ends in something that shows itself."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.py"))


def cells_of(path: Path) -> list[str]:
    """The cells of code of a script in the percent format."""
    _, *parts = re.split(r"^# %%", path.read_text(encoding="utf-8"), flags=re.M)
    return [code.partition("\n")[2] for code in parts if not code.startswith(" [markdown]")]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_every_cell_of_a_notebook_shows_its_last_line(
    path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    interactive = pytest.importorskip("IPython.core.interactiveshell")
    from traitlets.config import Config

    monkeypatch.chdir(tmp_path)
    config = Config(
        {"HistoryManager": {"enabled": False}, "InteractiveShell": {"colors": "nocolor"}}
    )
    shell = interactive.InteractiveShell(config=config, ipython_dir=str(tmp_path))
    for code in cells_of(path):
        done = shell.run_cell(code)
        done.raise_error()
        shown = shell.display_formatter.format(done.result)[0]
        assert len(shown["text/html"]) > 100 and shown["text/plain"], code
