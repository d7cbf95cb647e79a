"""Laws of causes in the rig itself: payload, inertia, encoder zero and base, against rigid-body mechanics."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gimbal_pin.dynamics import compute_regressor, compute_rnea
from gimbal_pin.effects import (
    BaseTilt,
    EncoderOffset,
    OffDiagonalInertia,
    PayloadMass,
    PayloadShift,
    RigEffect,
    get_payload,
)
from gimbal_pin.errors import UsageError
from gimbal_pin.rig import PHI, Rig
from tests.effects.test_effects import KINDS, SEEDS, rig
from tests.rigs import states

RIGS = sorted(name for name, kind in KINDS.items() if issubclass(kind, RigEffect))
SHIFT = np.array([0.004, -0.002, 0.003])
R = pin.rpy.rpyToMatrix(0.1, -0.2, 0.3)


def mounted(name: str = "thesis") -> Rig:
    """A bundled rig whose payload is turned by `R`."""
    where = replace(rig(name), model=rig(name).model.copy())
    frame = where.model.frames[where.model.getFrameId(str(where.payload_link))]
    frame.placement = pin.SE3(R, frame.placement.translation)
    return where


@pytest.mark.parametrize("name", RIGS)
def test_a_rig_effect_of_nothing_changes_nothing_and_none_touches_its_rig(name: str) -> None:
    where = rig()
    motion = states(3, 0, 5)
    before = compute_rnea(where, *motion)
    kind = KINDS[name]
    nothing, something = (
        kind.planted("tilt", {p.name: min(size, p.upper) for p in kind.stated()})
        for size in (0.0, 0.004)
    )
    np.testing.assert_allclose(compute_rnea(nothing.apply(where), *motion), before, atol=1e-11)
    assert np.abs(compute_rnea(something.apply(where), *motion) - before).max() > 1e-6
    np.testing.assert_array_equal(compute_rnea(where, *motion), before)


@pytest.mark.parametrize("name", ["thesis", "turret", "handheld"])
def test_a_shifted_payload_takes_its_mass_and_its_own_inertia_along(name: str) -> None:
    """There and back is where it was."""
    where = mounted(name)
    moved = PayloadShift(*SHIFT).apply(where)
    _, own, frame = get_payload(where)
    change = moved.phi - where.phi
    assert not change[:-10].any()
    moment = own.mass * frame.rotation @ SHIFT
    np.testing.assert_allclose(change[-10:-6], [0.0, *moment], atol=1e-12)
    np.testing.assert_allclose(get_payload(moved)[1].inertia, own.inertia, atol=1e-12)
    np.testing.assert_allclose(PayloadShift(*-SHIFT).apply(moved).phi, where.phi, atol=1e-12)


def test_payload_mass_scales_the_payload_or_bolts_a_weight_on() -> None:
    where = mounted()
    _, own, frame = get_payload(where)
    place = own.lever + frame.rotation @ SHIFT
    bolted = pin.Inertia(0.1, place, np.zeros((3, 3))).toDynamicParameters()
    scaled = own.toDynamicParameters() * 0.5 / own.mass
    for effect, added in ((PayloadMass(0.5), scaled), (PayloadMass(0.1, *SHIFT), bolted)):
        change = effect.apply(where).phi - where.phi
        np.testing.assert_allclose(change, [*np.zeros(20), *added], atol=1e-12)


@pytest.mark.parametrize(
    ("effect", "payload", "names"),
    [
        (PayloadMass(-20.0), None, "payload-mass"),
        (PayloadShift(0.01), "none", "payload"),
        (OffDiagonalInertia("roll", Ixy=5.0), None, "fork"),
        (OffDiagonalInertia("roll", payload_Ixy=1e-4), None, "roll"),
    ],
)
def test_no_body_can_be_so(effect: RigEffect, payload: str | None, names: str) -> None:
    with pytest.raises(UsageError, match=names):
        effect.apply(Rig.load("thesis", payload))


@given(st.floats(-3, 3), st.sampled_from(["yaw", "roll", "tilt"]), SEEDS)
def test_an_offset_encoder_reads_another_angle_of_the_same_rig(
    offset: float, joint: str, seed: int
) -> None:
    where = rig()
    q, v, a = states(3, seed, 4)
    read = q.copy()
    read[:, where.joint_index(joint)] += offset
    turned = EncoderOffset(joint, offset).apply(where)
    expected = compute_rnea(where, q, v, a)
    np.testing.assert_allclose(compute_rnea(turned, read, v, a), expected, atol=1e-8)


def test_a_leaning_base_turns_gravity() -> None:
    tilt = BaseTilt(roll=0.3, pitch=-0.2).apply(rig()).model.gravity.linear
    R = pin.rpy.rpyToMatrix(0.3, -0.2, 0.0)
    np.testing.assert_allclose(R @ tilt, [0, 0, -9.81], atol=1e-12)


def test_products_of_inertia_are_those_of_the_regressor() -> None:
    where = rig()
    motion = states(3, 0, 4)
    changed = OffDiagonalInertia("roll", Ixy=1e-3, Iyz=-2e-3).apply(where)
    Y = compute_regressor(where, *motion)
    column = 1e-3 * Y[..., 10 + PHI.index("Ixy")] - 2e-3 * Y[..., 10 + PHI.index("Iyz")]
    change = compute_rnea(changed, *motion) - compute_rnea(where, *motion)
    np.testing.assert_allclose(change, column, atol=1e-11)


def test_products_of_a_payload_stand_in_the_frame_it_is_mounted_in() -> None:
    """``I' - I = R P Rᵀ``."""
    where = mounted()
    effect = OffDiagonalInertia("tilt", payload_Ixy=1e-4, payload_Iyz=-2e-4)
    before, after = (one.model.inertias[3].inertia for one in (where, effect.apply(where)))
    P = np.array([[0.0, 1e-4, 0.0], [1e-4, 0.0, -2e-4], [0.0, -2e-4, 0.0]])
    np.testing.assert_allclose(after - before, R @ P @ R.T, atol=1e-12)
