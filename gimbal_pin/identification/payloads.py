"""One gimbal, several cameras: the gimbal's parameters are shared, each camera has its own."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import zip_longest
from typing import Any, ClassVar, NamedTuple

import numpy as np
from scipy.linalg import block_diag

from gimbal_pin.checks import (
    CheckedLog,
    check_assignment,
    check_log,
    check_time,
    collect_alterations,
)
from gimbal_pin.dynamics.model import Estimated, Model, build_stated_effects
from gimbal_pin.dynamics.reduction import (
    Reduction,
    format_sum,
    list_units,
    reduce_parameters,
    scan_columns,
    stack_regressors,
)
from gimbal_pin.dynamics.regressor import SCAN
from gimbal_pin.effects import Effect
from gimbal_pin.effects.rig_effect import RigEffect, get_payload
from gimbal_pin.errors import UsageError, digits
from gimbal_pin.identification.bodies import update_bodies
from gimbal_pin.identification.difference import BaseDifference
from gimbal_pin.identification.estimators import find_estimator
from gimbal_pin.identification.fitting import (
    add_misfit_and_lags,
    assemble_result,
    compute_held_out_blocks,
    given_beta,
    keep_held_out_accuracy,
    split_logs,
)
from gimbal_pin.identification.identified import IdentificationResult, describe_faults
from gimbal_pin.identification.known_gimbal import (
    compute_limit,
    describe_contradiction,
    update_gimbal,
)
from gimbal_pin.identification.payload import (
    PayloadStatement,
    compare_payload,
    compare_places,
    report_with_payload,
    state_payload,
)
from gimbal_pin.identification.requirements import check_enough, check_seen, find_unseen
from gimbal_pin.log.log import Array, Log
from gimbal_pin.regression import (
    TRUST,
    Block,
    Design,
    DesignBlocks,
    Estimate,
    Estimator,
    Filtering,
    Misfit,
    add_lag_spread,
    add_misfit,
    align_rows,
    build_prior_rows,
    build_urdf_prior,
    compute_blocks,
    compute_wald,
    find_camera_body,
    fit_weighted,
    limit_cutoff,
    map_phi_to_base,
    solve,
)
from gimbal_pin.regression.consistency import compute_deformation_root, find_likeliest_bodies
from gimbal_pin.rig.brief import Record, brief
from gimbal_pin.rig.rig import PHI, Rig

BARE = "none"
"""The payload that weighs nothing: where there is a log of it, the others are measured from it."""
WIDE_TRUST = 10.0
"""Standard deviation of a camera's parameters before a log that hides some, as a multiple of what its URDF states.

Ten times the stated mass contains every camera, so what the log shows stays the log's; doubling it changes only the
stated deviation of what the log hides.
"""
UNSEEN_SHARE = 0.1
"""Share of the largest entry, each in units of the URDF's deformation, from which a sentence names a parameter."""


@dataclass(frozen=True, eq=False)
class CameraEstimate:
    """What joint torques show of one camera.

    Attributes:
        names: Parameters of the camera that show, regrouped; about the joint that carries it, in that joint's frame.
        units: Their SI units.
        value: Estimate, (r,).
        covariance: Its covariance, (r, r); zero where it was not estimated, but taken as its URDF says.
        urdf: What its URDF says, (r,).
        columns: Change of the gimbal's base parameters per parameter of the camera, (b, r).
        change: Estimate less the reference camera's own, as that is, and the covariance of this, (r,) and (r, r).
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    value: Array
    covariance: Array
    urdf: Array
    columns: Array
    change: tuple[Array, Array]

    __repr__ = brief

    @property
    def std(self) -> Array:
        """Standard deviations, (r,)."""
        return np.sqrt(np.diag(self.covariance))

    def to_dict(self) -> list[dict[str, Any]]:
        """Return rows of name, value, std, unit and the URDF's value."""
        rows = zip(
            self.names, self.value.tolist(), self.std.tolist(), self.units, self.urdf.tolist()
        )
        return [
            {"name": n, "value": x, "std": s, "unit": u, "urdf": given}
            for n, x, s, u, given in rows
        ]


@dataclass(frozen=True, eq=False)
class Several(Record):
    """The result of `identify_several` and of `identify_new`.

    Attributes:
        identified: Payload → model of the gimbal with it; the gimbal's own parameters and friction are the same in all.
        cameras: Payload → its own parameters.
        reference: The payload whose URDF the cameras' parameters stand on: `BARE`, or the first.
        mass: Of the payload, kg, where it is one and was weighed.
        known: The gimbal with the reference, as it was known before the logs; None where it was not.
    """

    identified: Mapping[str, IdentificationResult]
    cameras: Mapping[str, CameraEstimate]
    reference: str
    mass: float | None = None
    known: Model | None = None

    ROWS: ClassVar[str] = "payloads"
    __repr__ = brief

    @property
    def first(self) -> IdentificationResult:
        """The gimbal with the reference, or with the first payload where that has no log."""
        return self.identified.get(self.reference, next(iter(self.identified.values())))

    def __str__(self) -> str:
        """A few lines per camera: what was estimated, and how well it predicts."""
        return "\n".join([*(repr(one) for one in self.identified.values()), self.sentence])

    @cached_property
    def payloads(self) -> Mapping[str, PayloadStatement]:
        """Payload → where it sits and what it weighs, against its own URDF, and how to balance it."""
        known = self.known
        mass = self.mass
        return {
            name: compare_camera(one, self.cameras[name], mass, known)
            for name, one in self.identified.items()
        }

    @property
    def warnings(self) -> tuple[str, ...]:
        """What has to be known before the parameters are read, in sentences: the cameras' worst, then their next."""
        each = [
            [f"with {name}: {said}" for said in one.warnings]
            for name, one in self.identified.items()
        ]
        return tuple(said for rank in zip_longest(*each) for said in rank if said is not None)

    def refitted(self, whole: Several) -> Several:
        """Return an estimate from all data with the held-out accuracy of this one, which had not seen all of it."""
        each = {
            name: keep_held_out_accuracy(self.identified[name], one)
            for name, one in whole.identified.items()
        }
        return replace(whole, identified=each)

    @property
    def sentence(self) -> str:
        """Say what the cameras' parameters stand on."""
        if self.reference == BARE:
            return "the cameras' own parameters are measured against the gimbal without any"
        return f"the cameras' own parameters stand on {self.reference} being as its URDF says: add a log of '@{BARE}'"

    def to_dict(self) -> dict[str, Any]:
        """Return what `identify --json` writes: the reference's, and every payload's under `payloads`."""
        cameras = {name: one.to_dict() for name, one in self.cameras.items()}
        each = {
            name: {**report_with_payload(one, self.payloads[name]), "camera": cameras[name]}
            for name, one in self.identified.items()
        }
        first = each.get(self.reference, next(iter(each.values())))
        logs = [log for one in self.identified.values() for log in one.logs]
        whole = {
            "logs": logs,
            "warnings": list(self.warnings),
            "reference": self.reference,
            "note": self.sentence,
        }
        return {**first, **whole, "payloads": each}


def compare_camera(
    found: IdentificationResult,
    camera: CameraEstimate,
    mass: float | None,
    known: Model | None = None,
) -> PayloadStatement:
    """Compare a camera on a known gimbal with its URDF; one that was not estimated is compared with its gimbal.

    Args:
        found: The gimbal with it.
        camera: Its own parameters.
        mass: Its mass, kg, where it was weighed.
        known: The gimbal with another camera, relative to which it is then said where this one sits.
    """
    if not camera.covariance.any():
        return compare_payload(found, mass)
    whole = BaseDifference.of(found)

    def carry(value: Array, covariance: Array) -> BaseDifference:
        """Return what a change of the camera's parameters makes of the base parameters."""
        # A millionth of the gimbal's covariance makes it regular in directions that no camera moves.
        spread = camera.columns @ covariance @ camera.columns.T + 1e-6 * whole.covariance
        return replace(whole, change=camera.columns @ value, covariance=spread, weighting=spread)

    said = state_payload(whole, mass, own=carry(camera.value - camera.urdf, camera.covariance))
    if (
        known is None
        or known.estimated is None
        or known.rig.payload in (None, BARE)
        or said.apart is None
    ):
        return said
    body = find_camera_body(whole.rig)
    given = whole.rig.phi.copy()
    given[10 * body : 10 * body + 10] += get_stated_payload(known.rig) - get_stated_payload(
        whole.rig
    )
    rig = known.rig.with_phi(given)
    width = len(whole.change)
    spread = known.estimated.covariance[:width, :width]
    theta = known.estimated.theta[:width]
    first = BaseDifference(
        rig, whole.reduction, theta - given_beta(rig, whole.reduction), spread, spread
    )
    own = replace(carry(*camera.change), rig=rig)
    return replace(
        said, beside=compare_places(own, first, said.apart, known.rig.payload, mass, found.trust)
    )


class _Part(NamedTuple):
    """The logs with one payload, training rows and held-out logs, how they were parted, and what was said of them."""

    checked: tuple[CheckedLog, ...]
    blocks: DesignBlocks
    test: tuple[Log, ...]
    how: str
    notes: tuple[str, ...]


def _build_part(
    rig: Rig,
    logs: Sequence[Log],
    effects: Sequence[Effect],
    holdout: str | None,
    filtering: Filtering | None,
    reduction: Reduction,
) -> _Part:
    """Return the rows of the logs with one payload, parted at two thirds of every log."""
    if holdout not in (None, "none", "last-third"):
        raise UsageError(
            "--holdout", f"cannot be '{holdout}' for several payloads", "use last-third or none"
        )
    filters = filtering or limit_cutoff(Filtering(), logs)
    checked = tuple(check_log(rig, log, filtering=filtering) for log in logs)
    logs = [one.log for one in checked]
    notes = check_time(rig, logs, filters)
    train, test, how = split_logs(logs, holdout or "last-third", filters)
    blocks = compute_blocks(Design(rig, reduction, tuple(effects), train, filters))
    check_enough(blocks)
    return _Part(checked, blocks, test, how, notes)


def _align_parts(parts: Sequence[_Part], own: CarrierEstimate) -> tuple[list[_Part], Array]:
    """Return all payloads' rows with the lags of the gimbal's drives, and these' covariance, s², (n, n)."""
    aligned, late = align_rows([part.blocks for part in parts], partial(_join_cameras, own=own))
    return [part._replace(blocks=blocks) for part, blocks in zip(parts, aligned)], late


@dataclass(frozen=True, eq=False)
class CarrierEstimate:
    """The parameters of the body that carries the camera, as far as joint torques show them.

    Attributes:
        body: Which body, from 0.
        reduction: Its ten parameters' reduction: what of them shows.
        columns: K_c: base parameters per independent one of them, (b, r).
    """

    body: int
    reduction: Reduction
    columns: Array

    @staticmethod
    def of(rig: Rig, reduction: Reduction) -> CarrierEstimate:
        """Return what shows of the camera's body if all the others are known."""
        body = find_camera_body(rig)
        matrix, names = stack_regressors(rig)
        mine = [k for k, name in enumerate(names) if name.rsplit(".", 1)[0] == rig.links[body]]
        own = scan_columns(
            matrix[:, mine], tuple(f"camera.{names[k].rsplit('.', 1)[1]}" for k in mine)
        )
        places = [10 * body + PHI.index(SCAN[k]) for k in own.independent]
        return CarrierEstimate(body, own, map_phi_to_base(rig, reduction)[:, places])

    @property
    def parameters(self) -> slice:
        """Where its parameters stand among those of all bodies."""
        return slice(10 * self.body, 10 * self.body + 10)

    def shown(self, phi: Array) -> Array:
        """What of ten parameters shows, (r,); of several columns of them, (r, m)."""
        return np.asarray(self.reduction.mixing @ phi[[PHI.index(symbol) for symbol in SCAN]])

    def build_prior(self, rig: Rig, reference: Rig) -> Array:
        """Rows ``[U z]`` of what shows of a camera less the reference's: its URDF's, to `WIDE_TRUST`, (r, r + 1)."""
        root = WIDE_TRUST * self.shown(compute_deformation_root(rig.phi[self.parameters]))
        return build_prior_rows(
            root, self.shown(get_stated_payload(rig) - get_stated_payload(reference))
        )

    def compute_columns(self, block: Block) -> Array:
        """Torque per parameter that shows, (m, n, r): the base columns hold it already, filtered and masked."""
        return np.asarray(block.A[:, :, : len(self.columns)] @ self.columns)

    def describe_unseen(self, covariance: Array, whitener: Array) -> tuple[str, ...]:
        """Name each combination of a camera's parameters that the log shows less than the URDF is trusted for.

        Args:
            covariance: Of the camera's parameters, (r, r).
            whitener: U of `build_prior`, (r, r).
        """
        power, vectors = np.linalg.eigh(whitener @ covariance @ whitener.T)
        root = np.linalg.inv(whitener)
        size = np.linalg.norm(root, axis=1)
        said = list[str]()
        for way in (root @ vectors[:, power > (TRUST / WIDE_TRUST) ** 2]).T:
            share = np.abs(way / size)
            kept = np.flatnonzero(share > UNSEEN_SHARE * share.max())
            terms = {
                self.reduction.base_names[k]: float(f"{way[k] / way[kept[-1]]:.2g}")
                for k in kept[::-1].tolist()
            }
            said.append(
                f"the log does not show {format_sum(terms)}: any multiple in the camera leaves its torque as it is"
            )
        return tuple(said)

    def map_change(self, place: int, width: int, total: int) -> Array:
        """Map from theta, (width,), and every camera's gamma, (total,) together, to that of camera `place`, (r, total).

        Zero for the reference, the first.
        """
        size = self.columns.shape[1]
        return np.eye(size, total, width + size * (place - 1)) if place else np.zeros((size, total))


def _conclude_camera(
    part: _Part,
    own: CarrierEstimate,
    estimate: Estimate,
    place: int,
    reference: tuple[str, Rig],
    known: tuple[Array, Array],
    missed: Sequence[Misfit],
    late: Array,
) -> tuple[IdentificationResult, CameraEstimate]:
    """Return the gimbal with one camera, ``theta + K_c gamma``, and that camera: the reference's stated one and gamma.

    Args:
        part: The logs with it.
        own: What shows of it.
        estimate: Of theta, then of every camera's gamma.
        place: Which camera, from 0 for the reference.
        reference: The payload whose URDF the cameras' parameters stand on, and the rig with it.
        known: Parameters of the gimbal with the reference, and their covariance.
        missed: What the model misses at each joint.
        late: Covariance of the torques' lags, s², (n, n).
    """
    design = part.blocks.design
    width = len(design.names)
    pick = own.map_change(place, width, len(estimate.theta))
    whole = np.eye(width, len(estimate.theta))
    whole[: len(own.columns)] += own.columns @ pick
    one = replace(
        estimate, theta=whole @ estimate.theta, covariance=whole @ estimate.covariance @ whole.T
    )
    base = get_stated_payload(reference[1])
    urdf = get_stated_payload(design.rig)
    leading = [own.reduction.names[k].rsplit(".", 1)[1] for k in own.reduction.independent]
    gamma = pick @ estimate.theta
    spread = pick @ estimate.covariance @ pick.T
    units = list_units(leading)
    value = own.shown(base) + gamma
    stated = own.shown(urdf)
    mounted = CameraEstimate(
        own.reduction.base_names, units, value, spread, stated, own.columns, (gamma, spread)
    )
    unseen = own.describe_unseen(spread, own.build_prior(design.rig, reference[1])[:, :-1])
    given = design.rig.phi.copy()
    given[own.parameters] += base - urdf
    mounted, vague = _hedge_camera(mounted, own, reference[0], given, design.mixing, known)
    tested = compute_held_out_blocks(design, part.test)
    found = replace(
        add_misfit_and_lags(assemble_result(part.blocks, one, tested, part.how), missed, late),
        notes=(*part.notes, *unseen),
        holdout="last-third" if part.test else "none",
        faults=(*vague, *describe_faults(part.checked)),
        altered=collect_alterations(part.checked),
    )
    return found, mounted


def _hedge_camera(
    mounted: CameraEstimate,
    own: CarrierEstimate,
    reference: str,
    given: Array,
    mixing: Array,
    known: tuple[Array, Array],
) -> tuple[CameraEstimate, tuple[str, ...]]:
    """Return a camera with deviations that hold what its reference may differ from its URDF by, and say so.

    Torques show the reference together with the body that carries it. Where that sum is significantly not as the URDFs
    say, any share of the difference may be the reference's, and is then missing in the camera.

    `given`: the URDFs' bodies with the reference, (10 n,); `mixing`: K, (b, 10 n); others as for `_conclude_camera`.
    """
    if reference == BARE or not mounted.covariance.any():
        return mounted, ()
    width = len(mixing)
    beta = known[0][:width], known[1][:width, :width]
    phi = find_likeliest_bodies(given, mixing, *beta, TRUST)
    root = update_bodies(given, mixing, *beta, TRUST)[1]
    apart = own.shown((phi - given)[own.parameters])
    undecided = own.shown(root[own.parameters])
    spread = (
        mounted.covariance + undecided @ undecided.T
    )  # how the bodies share the sum is the log's to leave open
    if compute_wald(apart, spread)[0] < compute_limit(len(apart)) * len(apart):
        return mounted, ()
    size = np.sqrt(np.diag(spread))
    worst = int(np.argmax(np.abs(apart) / size))
    what = f"{mounted.names[worst]} by {digits(abs(apart[worst]) / size[worst], 2)} deviations"
    said = (
        f"the gimbal with {reference} is not as the URDFs say ({what}): how much of that is {reference}'s own is not "
        f"known, and this camera's deviations hold it; add a log of '@{BARE}'"
    )
    return replace(mounted, covariance=spread + np.outer(apart, apart)), (said,)


def get_stated_payload(rig: Rig) -> Array:
    """Ten parameters of the payload as its URDF states it, about the joint; zero where nothing is mounted."""
    try:
        return np.array(get_payload(rig)[1].toDynamicParameters())
    except UsageError:
        return np.zeros(10)


def identify_several(
    rigs: Mapping[str, Rig],
    logs: Mapping[str, Sequence[Log]],
    effects: Sequence[Effect] = (),
    *,
    estimator: Estimator | str = "weighted",
    trust: float = TRUST,
    holdout: str | None = None,
    filtering: Filtering | None = None,
) -> Several:
    """Estimate one gimbal with several cameras: base parameters of the first, what the others change, one friction.

    Args:
        rigs: Payload → the gimbal with it.
        logs: Payload → its logs; each is split at two thirds of its time.
        effects: Effects on top of Coulomb and viscous friction, the gimbal's.
        estimator: As for `identify`.
        trust: As for `identify`.
        holdout: "last-third" or "none"; None: the last third.
        filtering: Cutoff and alignment.

    Raises:
        UsageError: Another way of holding out.
        DataError: The logs are too short, or some parameters leave no trace in them.
        LogError: A torque has the wrong sign, or two have changed places, see `checks.check_assignment`; or
            one is in another unit, or acts too early or late, see `checks.check_time`.
    """
    reference = BARE if BARE in rigs else next(iter(rigs))
    order = (reference, *(name for name in rigs if name != reference))
    reduction = reduce_parameters(rigs[reference])
    own = CarrierEstimate.of(rigs[reference], reduction)
    everything = (*build_stated_effects(rigs[reference], reduction), *effects)
    each = [
        _build_part(rigs[name], logs[name], everything, holdout, filtering, reduction)
        for name in order
    ]
    aligned, late = _align_parts(each, own)
    parts = dict(zip(order, aligned))
    joint = _join_cameras([part.blocks for part in aligned], own)
    first = parts[reference].blocks.design
    priors = [
        build_urdf_prior(first, WIDE_TRUST),
        *(own.build_prior(rigs[name], rigs[reference]) for name in order[1:]),
    ]
    prior = np.column_stack(
        [block_diag(*(x[:, :-1] for x in priors)), np.concatenate([x[:, -1] for x in priors])]
    )
    alone = _fit_with_wide_prior(find_estimator(estimator, trust), joint, prior)
    check_seen(first.logs[0].name, first.names, joint, alone)
    estimate, missed = add_misfit(joint, alone, len(order))
    estimate = add_lag_spread(joint, estimate, late)
    cameras = {}
    identified = {}
    n = first.rig.n
    for k, (name, part) in enumerate(parts.items()):
        mine = slice(n * k, n * (k + 1))
        one = replace(estimate, residual_std=estimate.residual_std[mine])
        known = (estimate.theta, estimate.covariance)
        base = (reference, rigs[reference])
        identified[name], cameras[name] = _conclude_camera(
            part, own, one, k, base, known, missed[mine], late
        )
    for part in parts.values():  # by itself: in the sum with the others' a wrong sign may hide
        check_assignment(part.blocks, fit_weighted(part.blocks))
    return Several(
        {name: identified[name] for name in rigs}, {name: cameras[name] for name in rigs}, reference
    )


def _join_cameras(each: Sequence[Sequence[Block]], own: CarrierEstimate) -> list[Block]:
    """Return the rows of all cameras as one regression, see `_widen_blocks`."""
    return [
        block for k, blocks in enumerate(each) for block in _widen_blocks(blocks, own, k, len(each))
    ]


def _widen_blocks(
    blocks: Sequence[Block], own: CarrierEstimate, place: int, count: int
) -> Iterator[Block]:
    """Yield blocks with columns for `count - 1` further cameras, those of camera `place` filled in, (m, n count, …).

    The joints with each camera are joints of their own, a camera's after another's: each weighs by its own residual,
    as a heavy camera's noise would drown a light one's, and that has its own colour.
    """
    for block in blocks:
        (m, n, width) = block.A.shape
        size = own.columns.shape[1]
        A = np.zeros((m, n, count, width + size * (count - 1)))
        A[:, :, place, :width] = block.A
        if place:
            A[:, :, place, width + size * (place - 1) : width + size * place] = own.compute_columns(
                block
            )
        apart = np.eye(count)[place, :, None]
        placed = (block.b, block.share, block.slope, block.known)
        b, share, slope, known = ((apart * x[:, None]).reshape(m, -1) for x in placed)
        q, v = (np.tile(x, count) for x in (block.q, block.v))
        yield Block(
            block.t, A.swapaxes(1, 2).reshape(m, n * count, -1), b, q, v, share, slope, known
        )


def _fit_with_wide_prior(estimator: Estimator, blocks: Sequence[Block], prior: Array) -> Estimate:
    """Estimate parameters; where the log hides some, by weighted least squares with the rows `prior` of the URDF."""
    found = estimator(blocks)
    hidden = find_unseen([""] * len(found.theta), blocks, found)
    return solve(blocks, prior) if hidden else found


def identify_new(
    rig: Rig,
    logs: Sequence[Log],
    known: Model,
    *,
    estimator: Estimator | str = "weighted",
    trust: float = TRUST,
    holdout: str | None = None,
    filtering: Filtering | None = None,
) -> Several:
    """Estimate a new camera on a known gimbal, which the log corrects as far as it was uncertain; see `known_gimbal`.

    Where the log contradicts what was known, that is the first warning, and the known deviations are widened.

    Args:
        rig: The gimbal with the new camera.
        logs: Some 10 s of motion.
        known: A model that `identify` or `diagnose` wrote, of the gimbal with another camera; its causes are kept.
        estimator: As for `identify`.
        trust: As for `identify`.
        holdout: As for `identify`; None: "none", for there is little to hold out.
        filtering: Cutoff and alignment.

    Raises:
        UsageError: The known model was not identified, or is of another rig.
        DataError: The logs are too short, do not show the camera, or are of another gimbal.
        LogError: A torque has the wrong sign, or two have changed places, see `checks.check_assignment`; or
            one is in another unit, or acts too early or late, see `checks.check_time`.
    """
    method = find_estimator(estimator, trust)
    rig = apply_changes(rig, known.changes)
    before = get_known_parameters(known)
    if twice := [log.name for log in logs if log.digest in before.digests]:
        what = f"was identified from {twice[0]} itself, which would count twice"
        raise UsageError("--known", what, "give another log, or leave --known out")
    reduction = reduce_parameters(rig)
    effects = [term.effect for term in known.terms]
    width = len(reduction.independent)
    count = sum(len(effect.coefficients) for effect in effects)
    if before.names[:width] != reduction.base_names or len(before.names) != width + count:
        raise UsageError(
            "--known",
            "holds other parameters than this rig",
            f"identify {rig.name} with another camera",
        )
    own = CarrierEstimate.of(rig, reduction)
    (part,), late = _align_parts(
        [_build_part(rig, logs, effects, holdout or "none", filtering, reduction)], own
    )
    blocks = part.blocks
    design = part.blocks.design
    place = part.checked[0].log.name
    mine = [
        block._replace(A=own.compute_columns(block), b=block.b - block.A @ before.theta)
        for block in blocks
    ]
    # Against the whole torque: a camera that is as the known one leaves none of its own.
    heard = [some._replace(b=block.b) for some, block in zip(mine, blocks)]
    names = own.reduction.base_names
    prior = own.build_prior(rig, known.rig)
    shown = _fit_with_wide_prior(fit_weighted, mine, prior)
    if len(find_unseen(names, heard, shown)) == len(names):
        check_seen(place, names, heard, shown)
    alone, missed = add_misfit(
        blocks, _fit_with_wide_prior(method, blocks, build_urdf_prior(design, WIDE_TRUST))
    )
    alone = add_lag_spread(blocks, alone, late)
    reach = np.vstack([own.columns, np.zeros((len(design.names) - width, own.columns.shape[1]))])
    found = update_gimbal(before, alone, reach, place)
    joint = replace(alone, theta=found.theta, covariance=found.covariance, phi=None)
    name = rig.payload or "camera"
    mounted = known.rig.payload or BARE
    was = (before.theta, before.covariance)
    identified, one = _conclude_camera(part, own, joint, 1, (mounted, known.rig), was, missed, late)
    check_assignment(blocks, identified.estimate)
    model = identified.model
    digests = (*before.digests, *(log.digest for log in logs))
    if model.estimated is not None:
        model = replace(model, estimated=replace(model.estimated, digests=digests))
    faults = (*describe_contradiction(found, before), *identified.faults)
    identified = replace(identified, model=model, faults=faults)
    return Several({name: identified}, {name: one}, mounted, known=known)


def apply_changes(rig: Rig, changes: Sequence[RigEffect]) -> Rig:
    """Return a rig as it was found to stand: its encoders' offsets and its base; the bodies are as given."""
    for change in changes:
        rig = change.apply(rig).with_phi(rig.phi)
    return rig


def get_known_parameters(known: Model) -> Estimated:
    """Return what is known of a model's parameters; `UsageError` if it was not identified."""
    if known.estimated is None:
        raise UsageError(
            "--known", "holds no uncertainty", "give a model that 'gimbal-pin identify -o' wrote"
        )
    return known.estimated
