"""Models that explain some rows: the search with its noise, its direction of gravity and its drives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gimbal_pin.diagnosis.commands import Drive, compute_drive_gain, find_drives
from gimbal_pin.diagnosis.library import Shelf
from gimbal_pin.diagnosis.mount import Mount, find_mount, find_turn
from gimbal_pin.diagnosis.noise import estimate_noise
from gimbal_pin.diagnosis.problem import (
    Problem,
    build_flat_whitening,
    build_problem,
    replace_torque,
)
from gimbal_pin.diagnosis.rest import Rest, describe_rest
from gimbal_pin.diagnosis.rig_causes import list_rig_changes
from gimbal_pin.diagnosis.rivals import exchange_for_better
from gimbal_pin.diagnosis.rows import Rows
from gimbal_pin.diagnosis.score import compute_gain, compute_standard_error
from gimbal_pin.diagnosis.search import (
    Found,
    Search,
    Solution,
    find_causes,
    refine_shapes,
    sum_squares_by_fold,
)
from gimbal_pin.diagnosis.settings import Settings
from gimbal_pin.dynamics.reduction import reduce_parameters
from gimbal_pin.effects import BaseTilt
from gimbal_pin.log.platform import BaseMotion, Platform
from gimbal_pin.rig.rig import Rig

MOST_DRIVES = 2
"""Most drives at a joint behind which the whole search is repeated."""


@dataclass(frozen=True, eq=False)
class Explanation:
    """Models that a search found on some rows.

    Attributes:
        search: What it worked with; its torque is the one that acts behind the drives.
        found: Its models.
        rest: What the final one leaves at each joint.
        mount: Direction of gravity that it took; None: the URDF's.
        commands: Drives that act on the torque.
        upright: The best model with the URDF's direction of gravity, where another was taken.
        original: The rows with the torque as it was measured and the URDF's direction of gravity.
        refitted: The model without causes on these.
    """

    search: Search
    found: Found
    rest: tuple[Rest, ...]
    original: Problem
    refitted: Solution
    mount: Mount | None = None
    commands: tuple[Drive, ...] = ()
    upright: Solution | None = None

    @property
    def worth(self) -> float:
        """Log density of the unwhitened held-out rows and of the bodies, less what each finding costs, nats."""
        final = self.found.final
        settings = self.search.problem.settings
        count = len(final.accepted) + len(self.commands) + (self.mount is not None)
        rows = final.fit.rows.sum(axis=0)
        density = -float(np.sum(rows * np.log(final.errors + 1e-300)))
        return density - 0.5 * final.fit.prior_squares - settings.gain_nats * count


def choose_explanation(rig: Rig, rows: Rows, base: BaseMotion, settings: Settings) -> Explanation:
    """Return the search's result, with another direction of gravity where that predicts better.

    Other directions are the one that predicts the torques best before any search, and the one that a search found as a
    small turn, which is no more small.
    """
    given = [part.samples.platform for part in rows.stretches]
    best = search_rows(rig, rows, base, given, settings)
    if base != "fixed":
        return best
    turns = [one for one in best.found.final.accepted if isinstance(one.cause, BaseTilt)]
    upright = best.search.fit_without(best.found.final, turns)
    for mount in (find_mount(rig, rows), find_turn(best.search.problem, best.found.final)):
        if mount is None or mount.share < settings.tilt_share:
            continue
        other = _search_turned(best, mount, upright)
        if _is_turn_clear(upright, other) and _is_turn_better(best, other, settings):
            best = other
    if best.mount is not None:
        other = _search_turned(best, best.mount.mirrored(), upright)
        if _is_nearer(best, other, settings):
            best = other
    return best


def _search_turned(best: Explanation, mount: Mount, upright: Solution) -> Explanation:
    """Return what a search finds with another direction of gravity."""
    problem = best.search.problem
    rows = problem.rows
    turned = _turn_base(rows, mount)
    other = search_rows(problem.rig, rows, "tilted", turned, problem.settings)
    return replace(
        other, mount=mount, upright=upright, original=best.original, refitted=best.refitted
    )


def _is_nearer(best: Explanation, mirrored: Explanation, settings: Settings) -> bool:
    """Return whether the opposite direction of gravity leaves the bodies nearer to the URDF's.

    With all first moments reversed it predicts the same torques: the bodies alone decide.
    """
    own, other = (one.found.final.fit.prior_squares for one in (best, mirrored))
    return other < own and mirrored.worth > best.worth - settings.gain_nats


def _is_turn_clear(upright: Solution, turned: Explanation) -> bool:
    """Return whether another direction of gravity gains by more than the error of that, over the URDF's."""
    search = turned.search
    final = turned.found.final
    problem = search.problem
    errors = [sum_squares_by_fold(problem, one) for one in (upright, final)]
    gain = compute_gain(errors[0], errors[1], final.fit.rows)
    return float(gain.sum()) > search.least_deviations * float(compute_standard_error(gain))


def _is_turn_better(best: Explanation, other: Explanation, settings: Settings) -> bool:
    """Return whether an explanation with another direction of gravity is the better one.

    It has to show for itself, unless the other has found a turn as well.
    """
    if any(isinstance(one.cause, BaseTilt) for one in best.found.final.accepted):
        return other.worth > best.worth
    is_clear = other.worth > best.worth + settings.gain_nats
    return is_clear and _is_material(best, other, settings)


def _turn_base(rows: Rows, mount: Mount) -> list[Platform]:
    """Return the motion of a base that stands with another direction of gravity, along each stretch."""
    out = list[Platform]()
    for part in rows.stretches:
        still = np.zeros((len(part.time), 3))
        out.append(Platform(part.time, np.tile(mount.force, (len(part.time), 1)), still, still))
    return out


def search_rows(
    rig: Rig,
    rows: Rows,
    base: BaseMotion,
    platforms: Sequence[Platform | None],
    settings: Settings,
) -> Explanation:
    """Estimate the noise and search for causes; then look for drives where something is left."""
    problem = build_problem(rows, reduce_parameters(rig, base=base), settings, platforms)
    rough = Search(problem, build_flat_whitening(problem), ())
    first = rough.solve(())
    whitening = estimate_noise(problem, first.torque)
    search = Search(problem, whitening, tuple(list_rig_changes(problem, platforms)))
    explanation = _search(search)
    least = settings.material_share * problem.torque_rms
    for j in problem.joints:
        if explanation.rest[j].left > least[j]:
            explanation = _add_drive(explanation, j)
    return explanation


def _search(search: Search, shelves: Sequence[Shelf] = ()) -> Explanation:
    """Return what a search finds, and what is left."""
    found = find_causes(search, shelves)
    final, shelves = exchange_for_better(search, found.final, found.shelves)
    final = refine_shapes(search, final)
    found = replace(found, final=final, shelves=shelves)
    rest = tuple(describe_rest(search, final))
    return Explanation(search, found, rest, search.problem, found.first)


def _add_drive(before: Explanation, joint: int) -> Explanation:
    """Return an explanation with a drive at a joint, where that predicts its acceleration better."""
    drives = find_drives(before.search, before.found.final, joint)
    best = before
    most = before.search.problem.settings.gain_nats
    for drive in drives[:MOST_DRIVES]:
        after, worth = _search_behind_drive(before, drive, joint)
        if worth > most and _lowers_error(before, after, joint):
            best = after
            most = worth
    return best


def _search_behind_drive(
    before: Explanation, drive: Drive, joint: int
) -> tuple[Explanation, float]:
    """Return what is found in the torque that acts behind a drive, and its gain with all priors, nats."""
    search = before.search
    final = before.found.final
    problem = replace_torque(search.problem, joint, drive.torque)
    after = _search(replace(search, problem=problem), before.found.shelves)
    gain = compute_drive_gain(search, final, after.found.final, drive)
    own, other = (
        sum(one.log_prior for one in solution.accepted) for solution in (after.found.final, final)
    )
    worth = float(gain.sum()) + drive.hit.candidate.log_prior + own - other
    drive = replace(drive, gain=gain, before=float(final.errors[joint]))
    after = replace(
        after,
        original=before.original,
        refitted=before.refitted,
        commands=(*before.commands, drive),
    )
    return after, worth


def _lowers_error(before: Explanation, after: Explanation, joint: int) -> bool:
    """Return whether a drive lowers a joint's error as a share of the torque that acts, by a material part of it."""
    problem = after.search.problem
    level = float(before.search.problem.torque_rms[joint])
    acting = problem.target[:, [joint]] - before.search.problem.target[:, [joint]]
    rows = problem.measured.copy()
    rows[:, [joint]] += acting
    share = level / float(problem.compute_rms(rows[problem.rows.inner])[joint])
    old = float(before.found.final.errors[joint])
    new = share * float(after.found.final.errors[joint])
    lowered = np.sqrt(max(old**2 - new**2, 0.0))
    settings = problem.settings
    return bool(lowered > settings.unwhitened_share * settings.material_share * level)


def _is_material(plain: Explanation, other: Explanation, settings: Settings) -> bool:
    """Return whether another explanation lowers some joint's error by more than the form error of the plain one."""
    rms = plain.search.problem.torque_rms
    explained = plain.found.first.errors**2 - plain.found.final.errors**2
    form = settings.cause_form_error**2 * np.maximum(explained, 0.0)
    lowered = plain.found.final.errors**2 - other.found.final.errors**2
    return bool(np.any(lowered > (settings.material_share * rms) ** 2 + form))
