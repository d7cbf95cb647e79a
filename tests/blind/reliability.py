"""Stated probabilities against the truth: of what was given p, how much is there (a reliability diagram)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from matplotlib.figure import Figure as Picture

from .conventions import COMPANY, LOOK_ALIKES
from .judge import Json, Judged, same_joint, visible
from .table import Figure, wilson

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
    def share(self) -> float:
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
    def count(self) -> int:
        """Claims in all."""
        return sum(each.count for each in self.bins)


def alike(name: str) -> frozenset[str]:
    """The causes that no log tells from this one, itself among them."""
    return next((names for names in LOOK_ALIKES if name in names), frozenset({name}))


def is_right(case: Judged, name: str, joint: str | None) -> bool | None:
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


def claims(case: Judged) -> list[Claim]:
    """What a diagnosis states of each cause at each place; look-alikes at one place are one claim of their sum."""
    sums: dict[tuple[frozenset[str], str | None], float] = {}
    for said in case.diagnosis["causes"]:
        place = alike(str(said["cause"])), said["joint"]
        sums[place] = sums.get(place, 0.0) + float(said["probability"])
    judged = [(p, is_right(case, min(names), joint)) for (names, joint), p in sums.items()]
    return [Claim(min(p, 1.0), right) for p, right in judged if right is not None]


def _is_listed(case: Judged, cause: Json) -> bool:
    names = frozenset({"unknown"}) if cause["outside"] else alike(cause["cause"])
    return any(
        said["cause"] in names and same_joint(said, cause) for said in case.diagnosis["causes"]
    )


def measure(cases: Iterable[Judged]) -> Reliability:
    """The reliability of all probabilities in diagnoses that state them, of logs without a planted fault of the data.

    The bounds count claims, of which a log states several: as if they did not depend on each other.

    Raises: ValueError when no diagnosis states any."""
    stated = [case for case in cases if "causes" in case.diagnosis and case.truth["data"] is None]
    every = [claim for case in stated for claim in claims(case)]
    if not every:
        raise ValueError(
            "no diagnosis states a probability that can be judged: diagnose the logs again"
        )
    edges = np.linspace(0.0, 1.0, BINS + 1)
    rows = np.minimum(
        (np.array([claim.probability for claim in every]) * BINS).astype(int), BINS - 1
    )
    bins = []
    for k, (low, high) in enumerate(pairwise(edges)):
        inside = [claim for claim, row in zip(every, rows, strict=True) if row == k]
        if inside:
            mean = float(np.mean([claim.probability for claim in inside]))
            right = sum(claim.right for claim in inside)
            bins.append(
                Bin(float(low), float(high), len(inside), mean, right, wilson(right, len(inside)))
            )
    error = sum(each.count * abs(each.share - each.mean) for each in bins) / len(every)
    seen = [(case, cause) for case in stated for cause in case.causes if visible(cause)]
    return Reliability(tuple(bins), error, len(seen), sum(not _is_listed(*one) for one in seen))


def as_figures(found: Reliability) -> list[Figure]:
    """The rows of the published table: the error, and how many claims of 50 % and more are right."""
    sure = [each for each in found.bins if each.low >= 0.5]
    right = sum(each.right for each in sure)
    count = sum(each.count for each in sure)
    error = Figure(
        "expected calibration error, ten bins",
        found.error,
        0.0,
        1.0,
        found.count,
        (0.0, 0.05),
        (0.0, 0.02),
    )
    share = right / count if count else None
    return [
        error,
        Figure("causes of 50 % and more that are right", share, *wilson(right, count), count),
        Figure("visible causes that are not listed", found.unlisted / found.planted if found.planted else None,
               *wilson(found.unlisted, found.planted), found.planted),
    ]  # fmt: skip


def text(bins: Sequence[Bin]) -> str:
    """The bins as a Markdown table."""
    lines = ["| probability | claims | mean | right | 95 % bounds |", "|---" * 5 + "|"]
    for each in bins:
        low, high = each.bounds
        lines.append(
            f"| {100 * each.low:.0f}–{100 * each.high:.0f} % | {each.count} | {100 * each.mean:.1f} % | "
            f"{100 * each.share:.1f} % | {100 * low:.1f} … {100 * high:.1f} % |"
        )
    return "\n".join(lines) + "\n"


def chart(found: Reliability) -> Picture:
    """Share of right claims over their mean probability with Wilson bounds; below, how many claims there are."""
    picture = Picture(figsize=(5.0, 6.0), layout="constrained")
    above, below = picture.subplots(2, 1, sharex=True, height_ratios=(4, 1))
    mean = np.array([each.mean for each in found.bins])
    share = np.array([each.share for each in found.bins])
    bounds = np.array([each.bounds for each in found.bins]).T
    above.plot(
        [0.0, 1.0], [0.0, 1.0], color="0.6", linestyle="--", linewidth=1.0, label="calibrated"
    )
    above.errorbar(
        mean,
        share,
        np.abs(bounds - share),
        color="C0",
        marker="o",
        capsize=3,
        label="measured, 95 % bounds",
    )
    above.set(
        ylabel="share that is right",
        xlim=(0.0, 1.0),
        ylim=(-0.02, 1.22),
        yticks=np.linspace(0, 1, 6),
    )
    above.set_title(
        f"{found.count} stated probabilities, calibration error {found.error:.3f}",
        fontsize="medium",
    )
    above.legend(loc="upper center", ncols=2, frameon=False)
    lows = [each.low for each in found.bins]
    widths = [each.high - each.low for each in found.bins]
    below.bar(
        lows,
        [each.count for each in found.bins],
        widths,
        align="edge",
        color="C0",
        edgecolor="white",
    )
    below.set(xlabel="stated probability", ylabel="claims", yscale="log", ylim=(0.5, None))
    for axes in (above, below):
        axes.grid(color="0.9", linewidth=0.6)
        axes.set_axisbelow(True)
    return picture
