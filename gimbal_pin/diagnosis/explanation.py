"""Models that explain some rows: the search with its noise, its direction of gravity and its drives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

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
from gimbal_pin.diagnosis.structure import measure_curve
from gimbal_pin.diagnosis.uncertainty import compute_covariance
from gimbal_pin.dynamics.reduction import reduce_parameters
from gimbal_pin.effects import BaseTilt
from gimbal_pin.log.log import Array
from gimbal_pin.log.platform import BaseMotion, Platform
from gimbal_pin.rig.rig import Rig


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

    @cached_property
    def covariance(self) -> Array:
        """Covariance of the final model's coefficients."""
        return compute_covariance(self.search, self.found.final)

    @property
    def worth(self) -> float:
        """Log density of the unwhitened held-out rows and of the bodies, less what each finding costs, nats."""
        final = self.found.final
        count = len(final.accepted) + len(self.commands) + (self.mount is not None)
        density = -float(np.sum(final.fit.rows * np.log(final.errors + 1e-300)))
        cost = self.search.problem.settings.gain_nats * count
        return density - 0.5 * final.fit.prior_squares - cost


def choose_explanation(rig: Rig, rows: Rows, base: BaseMotion, settings: Settings) -> Explanation:
    """Return the search's result, with another direction of gravity where that predicts better.

    Other directions are the one that predicts the torques best before any search, and the one that a search found as a
    small turn, which is no more small.
    """
    given = [part.samples.platform for part in rows.stretches]
    best = search_rows(rig, rows, base, given, settings)
    if base != "fixed":
        return best
    final = best.found.final
    turns = [one for one in final.accepted if isinstance(one.cause, BaseTilt)]
    upright = best.search.fit_without(final, turns)
    for mount in (find_mount(rig, rows, settings), find_turn(best.search.problem, final)):
        if mount is not None and mount.share >= settings.tilt_share:
            other = _search_turned(best, mount, upright)
            if _is_turn_better(best, other, upright):
                best = other
    if best.mount is not None:
        # With all first moments reversed the opposite direction predicts the same torques: the bodies alone decide.
        other = _search_turned(best, best.mount.mirrored(), upright)
        is_nearer = other.found.final.fit.prior_squares < best.found.final.fit.prior_squares
        if is_nearer and other.worth > best.worth - settings.gain_nats:
            best = other
    return best


def _search_turned(best: Explanation, mount: Mount, upright: Solution) -> Explanation:
    """Return what a search finds where the base stands with another direction of gravity."""
    problem = best.search.problem
    turned = list[Platform]()
    for part in problem.rows.stretches:
        still = np.zeros((len(part.time), 3))
        turned.append(Platform(part.time, still + mount.force, still, still))
    other = search_rows(problem.rig, problem.rows, "tilted", turned, problem.settings)
    return replace(
        other, mount=mount, upright=upright, original=best.original, refitted=best.refitted
    )


def _is_turn_better(best: Explanation, other: Explanation, upright: Solution) -> bool:
    """Return whether an explanation with another direction of gravity is the better one.

    Its gain over the URDF's direction must be clear. Unless the other explanation has found a turn as well, it must
    gain as a cause does, and lower some joint's error by more than the form error of the other's causes.
    """
    problem = other.search.problem
    settings = problem.settings
    before = best.found.final
    after = other.found.final
    left, least = (sum_squares_by_fold(problem, one) for one in (upright, after))
    gain = compute_gain(left, least, after.fit.rows)
    if gain.sum() <= other.search.least_deviations * compute_standard_error(gain):
        return False
    if any(isinstance(one.cause, BaseTilt) for one in before.accepted):
        return other.worth > best.worth
    explained = np.maximum(best.found.first.errors**2 - before.errors**2, 0.0)
    form = (settings.material_share * problem.torque_rms) ** 2
    form += settings.cause_form_error**2 * explained
    is_material = bool(np.any(before.errors**2 - after.errors**2 > form))
    return is_material and other.worth > best.worth + settings.gain_nats


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
    first = rough.solve((), rough.solve(()))
    whitening = estimate_noise(problem, first.torque)
    explanation = _search(Search(problem, whitening, tuple(list_rig_changes(problem, platforms))))
    return _add_drives(explanation, problem.joints)


def _search(search: Search, shelves: Sequence[Shelf] = ()) -> Explanation:
    """Return what a search finds, and what is left."""
    found = find_causes(search, shelves)
    final, shelves = exchange_for_better(search, found.final, found.shelves)
    found = replace(found, final=refine_shapes(search, final), shelves=shelves)
    rest = tuple(describe_rest(search, found.final))
    return Explanation(search, found, rest, search.problem, found.first)


def _add_drives(before: Explanation, joints: Sequence[int]) -> Explanation:
    """Return an explanation with drives at some joints, each confirmed beside all others."""
    problem = before.search.problem
    least = problem.settings.material_share * problem.torque_rms
    after = before
    for j in joints:
        if after.rest[j].left > least[j] and problem.ranges[j].peak > 0.0:
            after = _add_drive(after, j)
    unsure = [x.hit.candidate.joint for x in after.commands if not _is_confirmed(after, x)]
    return _add_drives(before, [j for j in joints if j not in unsure]) if unsure else after


def _add_drive(before: Explanation, joint: int) -> Explanation:
    """Return an explanation with a drive at a joint, where that predicts its acceleration better.

    Behind each of the likeliest drives the whole search is repeated. A drive must lower the joint's error as a share of
    the torque that acts, by a material part of it. It alters the torque by which all else is judged, so that one which
    does not explain enough for a name is not kept.
    """
    search = before.search
    old = before.found.final
    settings = search.problem.settings
    level = float(search.problem.torque_rms[joint])
    least = settings.unwhitened_share * settings.material_share * level
    best = before
    most = settings.gain_nats
    for drive in find_drives(search, old, joint)[: settings.max_drives]:
        problem = replace_torque(search.problem, joint, drive.torque)
        after = _search(replace(search, problem=problem), before.found.shelves)
        new = after.found.final
        gain = compute_drive_gain(search, old, new, drive)
        prior = drive.hit.candidate.log_prior
        prior += sum(one.log_prior for one in new.accepted)
        prior -= sum(one.log_prior for one in old.accepted)
        worth = float(gain.sum()) + prior
        rows = problem.measured + problem.target - search.problem.target
        share = level / float(problem.compute_rms(rows[problem.rows.inner])[joint])
        lowered = old.errors[joint] ** 2 - (share * new.errors[joint]) ** 2
        drive = replace(drive, gain=gain, before=float(old.errors[joint]))
        if worth > most and lowered > least**2 and _is_confirmed(after, drive):
            most = worth
            best = replace(
                after,
                original=before.original,
                refitted=before.refitted,
                commands=(*before.commands, drive),
            )
    return best


def _is_confirmed(explanation: Explanation, drive: Drive) -> bool:
    """Return whether a drive's gain is clear and explains as much of the predictable error as a name asks for."""
    search = explanation.search
    final = explanation.found.final
    joint = drive.hit.candidate.joint
    assert joint is not None
    after = measure_curve(search, final, joint, drive.signal.name) * float(final.errors[joint])
    share = explanation.rest[joint].compute_share(drive.before, after)
    deviations = search.least_deviations * float(compute_standard_error(drive.gain))
    return share >= search.problem.settings.name_share and float(drive.gain.sum()) >= deviations
