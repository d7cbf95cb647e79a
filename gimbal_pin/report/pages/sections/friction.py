"""Friction and other effects of every joint: coefficients, and what they come to over the joint's rates."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from math import isfinite
from typing import NamedTuple

import numpy as np
from markupsafe import Markup

from gimbal_pin.effects import Sample, Term
from gimbal_pin.estimation.identification import Identified
from gimbal_pin.log.log import Array
from gimbal_pin.report.pages import plots
from gimbal_pin.report.pages.evaluation import Evaluated
from gimbal_pin.report.pages.html import Content, table
from gimbal_pin.report.pages.joints import joints_of
from gimbal_pin.report.pages.numbers import DASH, SURE, figures, interval, unit
from gimbal_pin.report.pages.sections.known import Known

RATE = 2.0
"""Rate up to which friction is drawn where no row says how fast the joint moved, rad/s."""


class Coefficient(NamedTuple):
    """A term's coefficient: the term, its place in it, and its place among all parameters."""

    term: Term
    k: int
    place: int


def coefficients(found: Identified) -> Iterator[Coefficient]:
    """Yield the coefficients of all terms in the order of the parameters."""
    place = len(found.reduction.independent)
    for term in found.model.terms:
        for k in range(len(term.values)):
            yield Coefficient(term, k, place)
            place += 1


def friction(found: Identified, every: Sequence[Known], evaluated: Evaluated | None = None) -> list[Markup]:
    """Return a table of the effects' coefficients and a picture of their torque over the rate.

    Over the rates of the rows in `evaluated`.
    """
    head = ["Joint", "Effect", "Coefficient", "Unit", "Value", "95 % interval", "Relative deviation", "of torque limit"]
    head += ["URDF"] * any(one.given is not None for one in every)
    colours = {joint.name: joint.label for joint in joints_of(found.model.rig)}
    rows = [
        [colours[one.term.effect.joint], *row(found, one, every[one.place])[: len(head) - 1]]
        for one in coefficients(found)
    ]
    alt = f"Friction torque over rate of {', '.join(found.model.rig.joints)}"
    caption = "Torque of all effects over the joint's rate, with the 95 % band of their coefficients."
    return [
        table(head, rows, texts=4, label="Friction and other effects"),
        plots.picture(partial(curves, found, evaluated), alt, caption),
    ]


def row(found: Identified, one: Coefficient, entry: Known) -> list[Content]:
    """Return a coefficient's row but for its joint."""
    effect = one.term.effect
    value, half = interval(entry.value, entry.half)
    limit = float(found.model.rig.tau_max[found.model.rig.joint_index(effect.joint)])
    share = f"{100 * entry.value / limit:.1f} %" if entry.unit == "N m" and isfinite(limit) else DASH
    names = [effect.name, effect.coefficients[one.k].name, unit(entry.unit)]
    return [*names, value, half, entry.deviation, share, DASH if entry.given is None else figures(entry.given, 4)]


def curves(found: Identified, evaluated: Evaluated | None) -> plots.Figure:
    """Draw every joint's effects over its rate."""
    joints = joints_of(found.model.rig)
    figure, panels = plots.panels(1, len(joints), 2.6)
    for axes, (j, joint) in zip(panels[0], enumerate(joints)):
        reach = RATE if evaluated is None else 1.05 * float(np.abs(evaluated.stacked("v")[:, j]).max())
        v = np.concatenate([np.linspace(-reach, 0, 100), np.linspace(0, reach, 100)])
        slide = np.repeat([-1.0, 1.0], 100)
        torque, half = band(found, j, v, slide)
        rate = joint.scale * v
        axes.fill_between(rate, torque - half, torque + half, color=joint.colour, alpha=0.25)
        axes.plot(rate, torque, color=joint.colour)
        plots.zero_line(axes)
        axes.set_title(joint.name, color=joint.colour)
        axes.set(xlabel=f"rate, {joint.unit}/s", ylabel="torque, N m" if j == 0 else "")
    return figure


def band(found: Identified, j: int, v: Array, slide: Array) -> tuple[Array, Array]:
    """``A theta`` of one joint's effects at rates `v`, and half the width of its 95 % band, N m, (m,) each."""
    zero = np.zeros_like(v)
    at = Sample(zero, zero, v, zero, slide, zero)
    own = [one for one in coefficients(found) if one.term.effect.joint == found.model.rig.joints[j]]
    A = np.column_stack([one.term.effect.basis(at)[one.k] + zero for one in own])
    places = [one.place for one in own]
    covariance = found.estimate.covariance[np.ix_(places, places)]
    variance = np.einsum("mk,kl,ml->m", A, covariance, A)
    return A @ found.estimate.theta[places], SURE * np.sqrt(np.maximum(variance, 0.0))
