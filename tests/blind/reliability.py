"""Stated probabilities against the truth: of what was given p, how much is there (a reliability diagram)."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure as Picture

from .conventions import COMPANY, LOOK_ALIKES
from .judge import same_joint, visible
from .table import Figure, count_share, wilson

BINS = 10


@dataclass(frozen=True)
class Claim:
    """A probability that was stated, and whether what it was stated of is there."""

    probability: float
    right: bool


@dataclass(frozen=True)
class Bin:
    """Claims with low ≤ p < high (the last: ≤): how many, their mean p, how many are right, bounds of the share."""

    low: float
    high: float
    count: int
    mean: float
    right: int
    bounds: tuple[float, float]

    @property
    def share(self):
        """Share of right claims."""
        return self.right / self.count


@dataclass(frozen=True)
class Reliability:
    """Bins with claims in them; `error` = Σ n_k/n |share_k - mean p_k|; visible causes `planted`, and `unlisted`."""

    bins: tuple[Bin, ...]
    error: float
    planted: int
    unlisted: int

    @property
    def count(self):
        """Claims in all."""
        return sum(each.count for each in self.bins)


def alike(name):
    """The causes that no log tells from this one, itself among them."""
    return next((names for names in LOOK_ALIKES if name in names), frozenset({name}))


def is_right(case, names, joint):
    """Return whether one of some look-alikes acts visibly at a joint, or None where that is neither right nor wrong.

    Left out are planted causes that are not visible there, faults that the log has by its sensors, what a form brings
    along, and *unknown* where a known cause acts in a foreign form: its rest is no library's. *unknown* is right where
    a cause from outside the library is visible."""
    there = [cause for cause in case.causes if same_joint({"joint": joint}, cause)]
    besides = {COMPANY.get((cause["cause"], cause["form"])) for cause in there}
    if names & (besides | set(case.truth["faults"])):
        return None
    planted = [cause for cause in there if cause["cause"] in names]
    excused = planted
    if "unknown" in names:
        planted = [cause for cause in case.causes if cause["outside"]]
        excused = [cause for cause in there if cause["outside"] or cause["foreign"]]
    if any(visible(cause, joint) for cause in planted):
        return True
    return None if excused else False


def list_probabilities(diagnosis):
    """Return cause, joint and probability of every stated finding and of its rivals; schema 1 has a list of its own."""
    if "causes" in diagnosis:
        return diagnosis["causes"]
    stated = [one for one in diagnosis["findings"] if one["status"] in ("named", "ambiguous")]
    return [
        {"cause": said["cause"], "joint": one["joint"], "probability": said["probability"]}
        for one in stated
        for said in (one, *one.get("rivals", ()))
        if said.get("probability") is not None
    ]


def claims(case):
    """What a diagnosis states of each cause at each place; look-alikes at one place are one claim of their sum."""
    sums = defaultdict(float)
    for said in list_probabilities(case.diagnosis):
        sums[alike(str(said["cause"])), said["joint"]] += float(said["probability"])
    judged = [Claim(min(p, 1.0), is_right(case, *place)) for place, p in sums.items()]
    return [claim for claim in judged if claim.right is not None]


def _is_listed(case, cause):
    """Return whether a diagnosis states any probability of a planted cause."""
    names = {"unknown"} if cause["outside"] else alike(cause["cause"])
    return any(
        said["cause"] in names and same_joint(said, cause)
        for said in list_probabilities(case.diagnosis)
    )


def measure(cases):
    """The reliability of all probabilities in diagnoses that state them, of logs without a planted fault of the data.

    The bounds count claims, of which a log states several: as if they did not depend on each other.

    Raises: ValueError when no diagnosis states any."""
    stated = [
        case
        for case in cases
        if case.truth["data"] is None and case.verdict not in ("refused", "error")
    ]
    every = [claim for case in stated for claim in claims(case)]
    if not every:
        raise ValueError(
            "no diagnosis states a probability that can be judged: diagnose the logs again"
        )
    bins = []
    for k in range(BINS):
        inside = [claim for claim in every if min(int(claim.probability * BINS), BINS - 1) == k]
        if inside:
            mean = float(np.mean([claim.probability for claim in inside]))
            right = sum(claim.right for claim in inside)
            bounds = wilson(right, len(inside))
            bins.append(Bin(k / BINS, (k + 1) / BINS, len(inside), mean, right, bounds))
    error = sum(each.count * abs(each.share - each.mean) for each in bins) / len(every)
    listed = [_is_listed(case, one) for case in stated for one in case.causes if visible(one)]
    return Reliability(tuple(bins), error, len(listed), listed.count(False))


def as_figures(found):
    """The rows of the published table: the error, and how many claims of 50 % and more are right."""
    sure = [each for each in found.bins if each.low >= 0.5]
    right = sum(each.right for each in sure)
    count = sum(each.count for each in sure)
    name = "expected calibration error, ten bins"
    return [
        Figure(name, found.error, (0.0, 1.0), found.count, (0.0, 0.05)),
        count_share("causes of 50 % and more that are right", right, count),
        count_share("visible causes that are not listed", found.unlisted, found.planted),
    ]


def chart(found):
    """Share of right claims over their mean probability, with Wilson bounds."""
    picture = Picture(figsize=(5.0, 5.0), layout="constrained")
    axes = picture.subplots()
    mean, share, low, high = zip(*((x.mean, x.share, *x.bounds) for x in found.bins))
    axes.plot([0.0, 1.0], [0.0, 1.0], "--", label="calibrated")
    off = np.abs(np.array([low, high]) - share)
    axes.errorbar(mean, share, off, fmt="o-", label="measured, 95 % bounds")
    axes.set(xlabel="stated probability", ylabel="share that is right")
    axes.set_title(f"{found.count} probabilities, calibration error {found.error:.3f}")
    axes.legend()
    return picture
