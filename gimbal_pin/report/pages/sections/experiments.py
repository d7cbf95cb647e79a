"""Which experiments there are, and which figure of several is clearly the better."""

from __future__ import annotations

from collections.abc import Sequence
from math import isnan

from gimbal_pin.control.tracking import Experiment, Tracking
from gimbal_pin.report.pages.html import Content, toned

TOGETHER = "all-axes"
"""Name of the experiment in which all axes move."""
BASELINE = "pid"
"""The controller that the model-based ones are compared with."""


def names(result: Tracking) -> list[str]:
    """Return the experiments' names, each once."""
    return list(dict.fromkeys(experiment.name for experiment in result.experiments))


def chosen(result: Tracking, name: str) -> list[Experiment]:
    """Return the experiments of a name, one per controller."""
    return [experiment for experiment in result.experiments if experiment.name == name]


def marked(text: str, own: float, every: Sequence[float], least: float = 0.0) -> Content:
    """Return the text, marked if its value is the smallest and another larger by more than `least` and a twentieth."""
    known = [value for value in every if not isnan(value)]
    clear = len(known) > 1 and own == min(known) and max(known) > 1.05 * own + least
    return toned(text, "good") if clear else text


def controller_looks(experiments: Sequence[Experiment]) -> list[str]:
    """Return the controllers' names in order."""
    return list(dict.fromkeys(experiment.controller for experiment in experiments))
