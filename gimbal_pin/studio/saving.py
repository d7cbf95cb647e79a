"""What the studio leaves behind: the controller as `tune` writes it, and a report, in a folder of one run."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

from gimbal_pin.control.judging import judge_controllers
from gimbal_pin.control.tuning import Tuning, pair_rivals, write_controller
from gimbal_pin.log.io.files import atomic_write
from gimbal_pin.report.elements import join_documents
from gimbal_pin.report.pages import describe_record

Writer = Callable[[Path], object]


def list_studio_files() -> tuple[str, str]:
    """Return the names of the files that may come to stand in the folder: the controller's and the report's."""
    return "controller.yaml", "report.html"


def keep_earlier_files(folder: Path) -> dict[str, Writer]:
    """Return what writes again the files of an earlier session in the same folder."""
    there = (folder / name for name in list_studio_files())
    return {
        path.name: partial(atomic_write, content=path.read_bytes())
        for path in there
        if path.is_file()
    }


def keep_controller(tuning: Tuning, folder: Path) -> Writer:
    """Return what writes a controller into a folder as ``tune -o`` does."""
    return partial(write_controller, tuning, folder=folder)


def keep_report(tuning: Tuning, plants: int = 20) -> Writer:
    """Return what writes the report of a controller: gains, margins, loops, and its judgement beside a PID.

    `plants`: perturbed plants that it is judged on, a fifth of a second each; `tune` takes 50.
    """
    model = tuning.model
    judged = judge_controllers(
        model, pair_rivals(tuning.stored), rng=0, plants=plants, delay=tuning.wish.delay
    )
    return join_documents([describe_record(tuning), describe_record(judged)]).write
