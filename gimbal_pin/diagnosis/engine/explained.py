"""What explains some logs: causes with their rivals, and how much of what was there is still unexplained."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

from gimbal_pin.diagnosis.columns import Columns
from gimbal_pin.diagnosis.engine.alignment import align_torques, shifts
from gimbal_pin.diagnosis.engine.criterion import (
    OF_CAUSE,
    compute_cause_torque,
    fitted,
    leave_cause_out,
)
from gimbal_pin.diagnosis.engine.discrepancy import Lack, lack_of_fit
from gimbal_pin.diagnosis.engine.noise import coloured, remove_whitening, rewhitened_problem
from gimbal_pin.diagnosis.engine.selection import (
    MOST_CAUSES,
    FittedRival,
    Search,
    contested,
    polished,
    pruned,
    selected,
    worth,
)
from gimbal_pin.diagnosis.evidence import Evidence
from gimbal_pin.diagnosis.library import ColumnLibrary, kept, list_candidates
from gimbal_pin.diagnosis.state import Problem, State, solve_causes
from gimbal_pin.diagnosis.uncertainty import is_size_known
from gimbal_pin.dynamics.reduction import Reduction
from gimbal_pin.dynamics.threads import limit_to_one_thread
from gimbal_pin.effects import Cause, Effect, Signal
from gimbal_pin.log.log import Array
from gimbal_pin.regression import FORM_ERROR, STRUCTURED
from gimbal_pin.rig.rig import Rig

DENYING_SHARE = OF_CAUSE**2
"""Share of a structure's power from which what is left of it denies the names of what explained the rest: more than an
error of their forms."""
BITING_NOISE = 4.0
"""What is left where a drive bites, over the noise elsewhere, from which that is no chance."""
SEARCHES = 2
"""Searches: the second begins with what the first has found, and with the noise that is left beside it."""


@dataclass(frozen=True, eq=False)
class Explained:
    """A model of some logs.

    Attributes:
        search: The candidates, and from what gain one is a cause.
        first: The refitted rigid model with Coulomb and viscous friction, without any cause.
        state: The same with all causes that the search has ended with.
        final: The same with those that deserve a name.
        rivals: Of each cause of `state`, what else explains it.
        before: Lack of fit of `first` at each joint.
        after: The same of `state`.
    """

    search: Search
    first: State
    state: State
    final: State
    rivals: tuple[tuple[FittedRival, ...], ...]
    before: tuple[Lack, ...]
    after: tuple[Lack, ...]

    @property
    def alignment(self) -> Array:
        """By how much later than it was gathered each joint's torque acts, s, (n,)."""
        return shifts(self.first.problem.evidence)

    @property
    def structured(self) -> tuple[bool, ...]:
        """Whether a structure is left that no named cause explains, joint by joint.

        It is where δ predicts more than an error of form, where a cause has pieces that no one device makes, though δ
        follows no function so narrow, and where a search was stopped and δ predicts anything.
        """
        stray = {one.place for one in self.state.causes if has_stray_pieces(self.state, one)}
        return tuple(
            material(lack) or joint in stray or (stopped(self.state) and lack.power > 0)
            for joint, lack in zip(self.first.problem.evidence.rig.joints, self.unexplained)
        )

    @cached_property
    def unexplained(self) -> tuple[Lack, ...]:
        """Lack of fit of `final` at each joint."""
        if self.final is self.state:
            return self.after
        return tuple(lack_of_fit(self.final, j) for j in range(len(self.after)))

    def left(self, joint: int) -> float:
        """Structured power that is left at a joint over what there was before: one, where nothing was explained."""
        was = self.before[joint].power
        now = self.after[joint].power
        return now / was if was > 0 else float(now > 0)

    def rivals_of(self, cause: Cause) -> tuple[FittedRival, ...]:
        """Return what else explains one of the causes, the best first."""
        # How far a rig is turned is fitted anew with every model.
        return self.rivals[[kept(one) for one in self.state.causes].index(kept(cause))]


@limit_to_one_thread()
def explain(
    evidence: Evidence, reduction: Reduction, causes: Mapping[str, type[Cause]], timed: bool = True
) -> Explained:
    """Find which causes explain some logs.

    The torques' time and the noise's spectrum are estimated before the search, and again with what it has found; then
    the search goes on.

    Args:
        evidence: The logs.
        reduction: Base parameters that their motion shows.
        causes: The causes to look for.
        timed: Whether to estimate the torques' time; False: it is known.
    """
    given = replace(
        Problem.of(evidence, reduction), luck=1e-9
    )  # the noise is the data's own: no fit beats it by luck
    candidates = Candidates(evidence.rig, list_candidates(evidence, causes))
    found: tuple[Cause, ...] = ()
    for _ in range(SEARCHES):
        again = partial(refitted, given, found)
        plain = align_torques(evidence, found, again) if timed else again(evidence)
        search = listened(plain, candidates)
        state = selected(polished(fitted(search.problem, found, plain)), search)
        if not state.causes or stopped(state):
            break
        found = state.causes
    others: tuple[tuple[FittedRival, ...], ...] = ((),) * len(state.causes)
    if not stopped(state):
        state, others = contested(pruned(polished(state), search), search)
    first = fitted(search.problem, (), state)
    joints = range(first.problem.evidence.rig.n)
    before, after = (tuple(lack_of_fit(one, j) for j in joints) for one in (first, state))
    all_of_it = Explained(search, first, state, state, others, before, after)
    names = deserving(all_of_it)
    return (
        all_of_it
        if names == state.causes
        else replace(all_of_it, final=fitted(search.problem, names, state))
    )


def material(lack: Lack) -> bool:
    """Whether a lack of fit is a structure, and larger than an error of form that any model has."""
    return lack.share > STRUCTURED and lack.size > FORM_ERROR


def deserving(found: Explained) -> tuple[Cause, ...]:
    """Return the causes that deserve a name.

    Left out are all of a search that was stopped; those of a joint, and of a rig with a joint, where more than
    `DENYING_SHARE` of a structure is left; drives beside which much is left where they act; what has a size that
    nobody knows, what noise in the motion may make, and what has pieces of no one device.
    """
    joints = found.first.problem.evidence.rig.joints
    unknown = {
        joints[j]
        for j, lack in enumerate(found.after)
        if material(lack) and found.left(j) > DENYING_SHARE
    }
    every = () if stopped(found.state) else found.state.causes
    clear = (one for one in every if not (one.place in unknown if one.of_joint else unknown))
    seen = (one for one in clear if not (isinstance(one, Signal) and misses(found.state, one)))
    sure = (one for one in seen if is_size_known(found.state, one))
    physical = (one for one in sure if not is_hidden_by_noise(found.first, one))
    return tuple(one for one in physical if not has_stray_pieces(found.state, one))


def has_stray_pieces(state: State, cause: Cause) -> bool:
    """Whether pieces that no one device makes together hold more of a cause than an error of its form may."""
    if not isinstance(cause, Effect):
        return False
    evidence = state.problem.evidence
    seen = evidence.seen[evidence.rig.joint_index(cause.joint)]
    return (
        len(cause.pieces) > 1
        and cause.compute_stray_share(worth(state, cause), seen) > DENYING_SHARE
    )


def is_hidden_by_noise(first: State, cause: Cause) -> bool:
    """Whether a cause multiplies an acceleration that noise in the motion attenuates: then it may be that noise.

    A spring is felt by the link's acceleration; an armature, or a motor's gain, is an inertia.
    """
    if not (cause.like_inertia or (isinstance(cause, Signal) and cause.springy)):
        return False
    problem = first.problem
    return bool(problem.motion_noise.is_hiding[problem.evidence.rig.joint_index(cause.place)])


def misses(state: State, drive: Signal) -> bool:
    """Whether much is left where a drive takes most of the torque, though it should explain all of it there.

    ``Σ x² r² / Σ x²`` is what is left there, x what it takes and r the residual. What is local in the torque is no
    function of the state, and δ does not see it: a knock is clipped by a limit, too.
    """
    j = state.problem.evidence.rig.joint_index(drive.joint)
    taken = compute_cause_torque(state, drive)[:, j] ** 2
    base = leave_cause_out(state, drive)
    before, after = (
        float(
            taken
            @ (one.fit.residual[one.fit.rows(j)] / one.fit.scale[j]) ** 2
            / max(float(taken.sum()), 1e-300)
        )
        for one in (base, state)
    )
    noise = float(state.fit.dispersion[j])
    return after > BITING_NOISE * noise and after - noise > DENYING_SHARE * (before - noise)


def stopped(state: State) -> bool:
    """Whether a search was stopped, not ended: it has then sketched something with what it had."""
    return len(state.causes) >= MOST_CAUSES


def refitted(given: Problem, causes: Sequence[Cause], evidence: Evidence) -> State:
    """Fit the rigid model with causes to retimed logs; what reads the model's torque reads the rigid one's first."""
    problem = replace(given, evidence=evidence)
    return fitted(problem, causes, solve_causes(problem, ()))


class Candidates:
    """Columns of the candidates on flat logs, which every search begins with: no noise's spectrum changes them much.

    Attributes:
        drives: Signals on the model's torque.
        every: All, signals on the measured torque.
        still: All that is built from the model or the motion alone, but for what comes in pieces.
    """

    def __init__(self, rig: Rig, causes: Sequence[Cause]) -> None:
        """Remember what to build."""
        self.every = ColumnLibrary(rig, causes)
        drives = {
            one: isinstance(one, Signal) and not one.springy for one in causes
        }  # springs follow the motion
        self.drives = ColumnLibrary(
            rig, [one for one, drive in drives.items() if drive], of_model=True
        )
        # A harmonic is a line in the noise's spectrum, and no median moves by it.
        self.still = [one for one, drive in drives.items() if not drive and not one.pieces]

    def noiseless(self, state: State) -> list[Columns]:
        """Columns without the measured torque's noise, but of those that come in pieces."""
        return [*self.every.all_of(self.still, state), *self.drives.columns(state)]


def listened(state: State, candidates: Candidates) -> Search:
    """Return the search among candidates, on the logs of a model whitened by the noise's spectrum."""
    problem = rewhitened_problem(state.problem, remove_whitening(state.problem.evidence))
    plain = solve_causes(problem, state.causes, state)
    noisy = coloured(problem, plain, candidates.noiseless(plain))
    candidates.every.columns(plain)
    return Search.among(noisy, candidates.every.whitened(problem.evidence, noisy.evidence))
