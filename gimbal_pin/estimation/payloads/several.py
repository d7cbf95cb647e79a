"""Several cameras on one gimbal, estimated together."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from gimbal_pin.dynamics.reduction import reduce
from gimbal_pin.estimation.channel_assignment import check_wiring
from gimbal_pin.estimation.estimators import Estimator, weighted
from gimbal_pin.estimation.estimators.base import residuals
from gimbal_pin.estimation.identification import assembled, check_seen, enough, faults
from gimbal_pin.estimation.payloads.camera import BARE, Several
from gimbal_pin.estimation.payloads.parts import Carried, camera, change, chosen, mapped, parted, rigid
from gimbal_pin.estimation.rows import Block, Filtering, kept
from gimbal_pin.log.log import Array, Log
from gimbal_pin.rig.rig import Rig


def identify_several(
    rigs: Mapping[str, Rig],
    logs: Mapping[str, Sequence[Log]],
    *,
    estimator: Estimator = weighted,
    holdout: str | None = None,
    filtering: Filtering | None = None,
) -> Several:
    """Estimate one gimbal with several cameras: base parameters of the first, what the others change, one friction.

    Args:
        rigs: Payload → the gimbal with it.
        logs: Payload → its logs; each is split at two thirds of its time.
        estimator: Blocks → `Estimate`.
        holdout: "last-third" or "none"; None: the last third.
        filtering: Cutoff and alignment.

    Raises:
        UsageError: Another way of holding out.
        DataError: The logs are too short, or some parameters leave no trace in them.
        LogError: A torque has the wrong sign, or two have changed places, see `channel_assignment.check_wiring`.
    """
    filters = filtering or Filtering()
    reference = BARE if BARE in rigs else next(iter(rigs))
    order = (reference, *(name for name in rigs if name != reference))
    reduction = reduce(rigs[reference])
    own = Carried.of(rigs[reference], reduction)
    parts = {name: parted(rigs[name], logs[name], holdout, filters, reduction) for name in order}
    blocks = {name: kept(rows) for name, (rows, _, _) in parts.items()}
    for name, (rows, _, _) in parts.items():
        enough(rows, blocks[name])
    wide = [list(widened(blocks[name], own, k, len(order))) for k, name in enumerate(order)]
    joint = alike(wide, estimator([block for part in wide for block in part]).theta)
    estimate = estimator(joint)
    first = parts[reference][0]
    names = (*first.names, *(f"{n}@{name}" for name in order[1:] for n in own.reduction.base_names))
    check_seen(first.logs[0].name, names, joint, estimate)
    maps = {name: chosen(own, k, len(order), len(first.names)) for k, name in enumerate(order)}
    identified = {
        name: replace(
            assembled(rows, blocks[name], mapped(estimate, maps[name]), tested, how),
            faults=faults(rigs[name], logs[name]),
        )
        for name, (rows, tested, how) in parts.items()
    }
    for part in blocks.values():  # by itself: in the sum with the others' a wrong sign may hide
        check_wiring(part, weighted(part))
    size = own.columns.shape[1]
    width, total = len(first.names), len(estimate.theta)
    pick = {name: change(size, k, width, total) for k, name in enumerate(order)}
    known = (estimate.theta, estimate.covariance)
    cameras = {name: camera(own, rigs[reference], rigs[name], *known, pick[name]) for name in order}
    return Several({name: identified[name] for name in rigs}, {name: cameras[name] for name in rigs}, reference)


def widened(blocks: Sequence[Block], own: Carried, place: int, count: int) -> Iterator[Block]:
    """Yield blocks with columns for `count - 1` further cameras, those of camera `place` filled in."""
    for block in blocks:
        size = own.columns.shape[1]
        extra = np.zeros((*block.b.shape, size * (count - 1)))
        if place:
            extra[:, :, size * (place - 1) : size * place] = rigid(block, own)
        yield block._replace(A=np.concatenate([block.A, extra], axis=2))


def alike(parts: Sequence[Sequence[Block]], theta: Array) -> list[Block]:
    """Scale each camera's rows so that their residuals are alike: a heavy camera's noise would drown a light one's."""
    left = [np.sqrt(np.mean(np.concatenate([residuals(b, theta) for b in part]) ** 2, axis=0)) for part in parts]
    weights = [np.mean(left, axis=0) / np.maximum(one, 1e-300) for one in left]
    return [
        block._replace(A=block.A * weight[:, None], b=block.b * weight)
        for part, weight in zip(parts, weights)
        for block in part
    ]
