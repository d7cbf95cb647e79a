"""Stated probabilities against the truth: of what was given p, how much is there (a reliability diagram)."""

from __future__ import annotations

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


def is_right(case, name, joint):
    """Whether a cause, or its look-alike, acts visibly at a joint (None: anywhere); None: neither right nor wrong.

    Left out are planted causes that are not visible there, faults that the log has by its sensors, what a form brings
    along, and *unknown* where a known cause acts in a foreign form: its rest is no library's. *unknown* is right where
    a cause from outside the library is visible."""
    there = [cause for cause in case.causes if same_joint({"joint": joint}, cause)]
    besides = {COMPANY.get((cause["cause"], cause["form"])) for cause in there}
    if name in case.truth["faults"] or besides & alike(name):
        return None
    if name == "unknown":
        if any(cause["outside"] and visible(cause, joint) for cause in case.causes):
            return True
        return None if any(cause["outside"] or cause["foreign"] for cause in there) else False
    planted = [cause for cause in there if cause["cause"] in alike(name)]
    if any(visible(cause, joint) for cause in planted):
        return True
    return None if planted else False


def claims(case):
    """What a diagnosis states of each cause at each place; look-alikes at one place are one claim of their sum."""
    sums = {}
    for said in case.diagnosis["causes"]:
        place = alike(str(said["cause"])), said["joint"]
        sums[place] = sums.get(place, 0.0) + float(said["probability"])
    judged = [(p, is_right(case, min(names), joint)) for (names, joint), p in sums.items()]
    return [Claim(min(p, 1.0), right) for p, right in judged if right is not None]


def _is_listed(case, cause):
    names = frozenset({"unknown"}) if cause["outside"] else alike(cause["cause"])
    return any(
        said["cause"] in names and same_joint(said, cause) for said in case.diagnosis["causes"]
    )


def measure(cases):
    """The reliability of all probabilities in diagnoses that state them, of logs without a planted fault of the data.

    The bounds count claims, of which a log states several: as if they did not depend on each other.

    Raises: ValueError when no diagnosis states any."""
    stated = [case for case in cases if "causes" in case.diagnosis and case.truth["data"] is None]
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
    seen = [(case, cause) for case in stated for cause in case.causes if visible(cause)]
    return Reliability(tuple(bins), error, len(seen), sum(not _is_listed(*one) for one in seen))


def as_figures(found):
    """The rows of the published table: the error, and how many claims of 50 % and more are right."""
    sure = [each for each in found.bins if each.low >= 0.5]
    right = sum(each.right for each in sure)
    count = sum(each.count for each in sure)
    ranges = ((0.0, 0.05), (0.0, 0.02))
    name = "expected calibration error, ten bins"
    return [
        Figure(name, found.error, 0.0, 1.0, found.count, *ranges),
        count_share("causes of 50 % and more that are right", right, count),
        count_share("visible causes that are not listed", found.unlisted, found.planted),
    ]


def chart(found):
    """Share of right claims over their mean probability, with Wilson bounds."""
    picture = Picture(figsize=(5.0, 5.0), layout="constrained")
    axes = picture.subplots()
    mean = np.array([each.mean for each in found.bins])
    share = np.array([each.share for each in found.bins])
    bounds = np.array([each.bounds for each in found.bins]).T
    axes.plot([0.0, 1.0], [0.0, 1.0], "--", label="calibrated")
    axes.errorbar(mean, share, np.abs(bounds - share), fmt="o-", label="measured, 95 % bounds")
    axes.set(xlabel="stated probability", ylabel="share that is right")
    axes.set_title(f"{found.count} probabilities, calibration error {found.error:.3f}")
    axes.legend()
    return picture
