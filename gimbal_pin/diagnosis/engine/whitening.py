"""Evidence and problems with other whitening gains than the sensors' noise asks for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy import fft

from gimbal_pin.diagnosis.evidence import Evidence, Part, band_edge
from gimbal_pin.diagnosis.state import Problem
from gimbal_pin.log.log import Array


def flat(evidence: Evidence) -> Evidence:
    """Return the evidence with the band's edge as its only filter: rows in N m."""
    edges = [edge_of(evidence, part) for part in evidence.parts]
    parts = [p._replace(whitener=np.tile(edge, (evidence.rig.n, 1))) for p, edge in zip(evidence.parts, edges)]
    return replace(evidence, parts=tuple(parts))


def edge_of(evidence: Evidence, part: Part) -> Array:
    """Return the gain by which a part's band fades at its upper end, (f,)."""
    return band_edge(fft.rfftfreq(len(part.gate), part.dt)[: part.whitener.shape[1]], evidence.band)


def whitened(evidence: Evidence, noise: Sequence[Array]) -> Evidence:
    """Return flat evidence whitened by the noise's power at each frequency, (N m)², (n, f) for each part."""
    parts = [part._replace(whitener=part.whitener / np.sqrt(power)) for part, power in zip(evidence.parts, noise)]
    return replace(evidence, parts=tuple(parts))


def rewhitened_problem(problem: Problem, new: Evidence) -> Problem:
    """Return a problem with the same rigid columns, whitened by other evidence."""
    return replace(problem, evidence=new, rigid=new.rewhiten(problem.rigid, problem.evidence, None))
