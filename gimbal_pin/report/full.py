"""The whole walk as one report."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial

from tqdm import tqdm

from gimbal_pin.identification import Identified
from gimbal_pin.log import Log
from gimbal_pin.report import sections
from gimbal_pin.report.base import Section, render
from gimbal_pin.report.evaluation import evaluate
from gimbal_pin.rig import Rig
from gimbal_pin.tracking import Tracking
from gimbal_pin.tuning import Tuning

STEPS = "All axes to and fro, with the model-based controller; the ghost is the reference."


def full(
    rig: Rig,
    logs: Sequence[Log],
    found: Identified,
    tunings: Mapping[str, Tuning],
    result: Tracking,
    animation: str,
    extra: Sequence[Section] = (),
    plant: str = "the identified model",
) -> str:
    """Return the report of a whole walk, from logs to a tuned controller, as HTML.

    Args:
        rig: The rig as given.
        logs: Its logs.
        found: What `identify` returned.
        tunings: Name → tuning, the model-based one first.
        result: What `track` returned.
        animation: What `view.record` returned.
        extra: Sections that go before the controller's.
        plant: What the steps were simulated on, within a sentence.
    """
    evaluated = evaluate(found, logs)
    steps: list[Callable[[], Section]] = [
        lambda: sections.summary(rig, found, next(iter(tunings.values())), result, logs, plant=plant),
        lambda: sections.animation(animation, STEPS),
        lambda: sections.rig_section(rig),
        lambda: sections.data(rig, logs),
        lambda: sections.parameters(found, evaluated, rig),
        lambda: sections.torque(found, evaluated),
        *(partial(replace, section) for section in extra),
        lambda: sections.margins(*tunings.values()),
        lambda: sections.tracking(
            result, rig, f"The plant is {plant}, with the rig's sensors, delay and torque limits."
        ),
    ]
    every = [step() for step in tqdm(steps, desc="report", unit="section", disable=None, leave=False)]
    mounted = f" with {rig.payload}" if rig.payload else ""
    return render(f"{rig.name}{mounted}", every, rig.config.description)
