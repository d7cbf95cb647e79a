"""Rows whitened by other gains: every row is known by its spectrum, so another pass over the log is not needed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy import fft

from gimbal_pin.diagnosis.evidence import Evidence, Part, band_edge
from gimbal_pin.diagnosis.state import Problem
from gimbal_pin.log import Array


def flat(evidence: Evidence) -> Evidence:
    """Return the evidence with the band's edge as its only filter: rows in N m."""
    edges = [edge_of(evidence, part) for part in evidence.parts]
    parts = [p._replace(whitener=np.tile(edge, (evidence.rig.n, 1))) for p, edge in zip(evidence.parts, edges)]
    return replace(evidence, parts=tuple(parts))


def modelled_torque(evidence: Evidence) -> Evidence:
    """Return evidence whose torque is the model's, wherever a column is built of it.

    The measured one's noise would stand on both sides, and be explained by itself.
    """
    return replace(evidence, parts=tuple(p._replace(trust=np.zeros_like(p.trust)) for p in evidence.parts))


def edge_of(evidence: Evidence, part: Part) -> Array:
    """Return the gain by which a part's band fades at its upper end, (f,)."""
    return band_edge(fft.rfftfreq(len(part.gate), part.dt)[: part.whitener.shape[1]], evidence.band)


def whitened(evidence: Evidence, noise: Sequence[Array]) -> Evidence:
    """Return flat evidence whitened by the noise's power at each frequency, (N m)², (n, f) for each part."""
    parts = [part._replace(whitener=part.whitener / np.sqrt(power)) for part, power in zip(evidence.parts, noise)]
    return replace(evidence, parts=tuple(parts))


def rewhitened(rows: Array, old: Evidence, new: Evidence, joint: int) -> Array:
    """Return one joint's rows, (rows,) or (rows, c), that `old` has whitened, as `new` whitens them."""
    out, first = [], 0
    for before, after in zip(old.parts, new.parts):
        own = fft.rfft(rows[first : first + before.rows], axis=0)
        first += before.rows
        ratio = np.zeros(len(own))
        was, now = before.whitener[joint][: len(own)], after.whitener[joint][: len(own)]
        ratio[: len(was)] = np.divide(now, was, out=np.zeros_like(now), where=was > 0)
        out.append(fft.irfft(own * (ratio[:, None] if own.ndim == 2 else ratio), before.rows, axis=0))
    return np.concatenate(out)


def rewhitened_problem(problem: Problem, new: Evidence) -> Problem:
    """Return a problem with the same rigid columns, whitened by other evidence."""
    joints = range(new.rig.n)
    rigid = [rewhitened(problem.rigid[:, j], problem.evidence, new, j) for j in joints]
    return replace(problem, evidence=new, rigid=np.stack(rigid, axis=1))
