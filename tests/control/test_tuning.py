"""Tuning: the highest bandwidth that keeps the margin, for every model that the covariance leaves possible.

What does not fit is lowered and said, what cannot be is refused; nothing that hurts gives more bandwidth.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from math import pi
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gimbal_pin.control import (
    Pid,
    ReasonKind,
    Tuning,
    compute_inertia,
    compute_margins,
    convert_gains,
    pair_rivals,
    sample_poses,
    tune,
)
from gimbal_pin.dynamics import Estimated, Model, Reference, nominal
from gimbal_pin.effects import (
    ActuatorLag,
    FrictionDrift,
    JointFlexibility,
    Saturation,
    Signal,
    Term,
)
from gimbal_pin.errors import UsageError
from gimbal_pin.log import Array
from gimbal_pin.rig import Motor
from tests.control.models import doubtful, estimated, name_parameters
from tests.rigs import bundled

DT = 0.001
KINDS = ("computed-torque", "pid")


@cache
def tuned(share: float = 0.1, **wish: Any) -> Tuning:
    """Return a tuning for a model that is known to a share of its size."""
    return tune(doubtful(share), **wish)


def has(tuning: Tuning, kind: ReasonKind) -> bool:
    """Return whether a tuning gives a reason of a kind."""
    return any(reason.kind is kind for reason in tuning.reasons)


# --- Bandwidth and margin ----------------------------------------------------------------------------------------


@given(st.floats(0.3, 1.1), st.integers(0, 6), st.floats(0.0, 0.2))
@settings(max_examples=5)
def test_the_bandwidth_is_the_highest_that_keeps_the_margin(
    margin: float, samples: int, integral: float
) -> None:
    wish = {"disk_margin": margin, "delay": samples * DT, "integral": integral}
    hz = tune(nominal(bundled("turret")), **wish).bandwidth_hz[0]
    least, more = (
        compute_margins(Pid.placed(scale * hz, 1.0, integral), DT, samples * DT).disk_margin
        for scale in (1.0, 1.01)
    )
    assert more < margin <= least * (1 + 1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_too_much_bandwidth_is_lowered_to_the_disk_margin_and_said(kind: str) -> None:
    asked = tune(nominal(bundled("thesis")), kind=kind)
    assert asked.bandwidth_hz == (8.0,) * 3
    lowered = asked.with_(bandwidth_hz=60.0, delay=0.005)
    assert [has(one, ReasonKind.LOWERED) for one in (asked, lowered)] == [False, True]
    assert all(0.5 <= found.disk_margin < 0.52 for found in lowered.margins)
    own = asked.with_(bandwidth_hz={"tilt": 10.0, "yaw": 4.0, "roll": 4.0})
    assert own.bandwidth_hz == (4.0, 4.0, 10.0)


@pytest.mark.parametrize("signal", [ActuatorLag("pan", 0.004), JointFlexibility("pan", 30.0, 0.05)])
@given(st.floats(0.0, 0.006), st.floats(0.2, 1.0), st.floats(1e-3, 0.02), st.floats(1e-6, 0.3))
@settings(max_examples=3)
def test_more_margin_lag_or_delay_never_gives_more_bandwidth(
    signal: Signal, delay: float, disk: float, more: float, further: float
) -> None:
    tuning = tune(
        replace(nominal(bundled("turret")), drive=(signal,)), delay=delay, disk_margin=disk
    )
    pan, tilt = tuning.bandwidth_hz
    assert tuning.with_(disk_margin=disk + further).bandwidth_hz[0] <= pan
    assert tuning.with_(delay=delay + more).bandwidth_hz[1] <= tilt
    assert pan < tilt


@pytest.mark.parametrize("kind", KINDS)
def test_more_uncertainty_never_gives_more_margin_or_bandwidth(kind: str) -> None:
    fixed = [tuned(share, bandwidth_hz=8.0, kind=kind) for share in (0.0, 0.05, 0.2)]
    assert fixed[0].worst[1].disk_margin == pytest.approx(fixed[0].margins[1].disk_margin, rel=1e-5)
    disks = [row.disk_margin for tuning in fixed for row in tuning.worst[1:]]
    asked = [tuning.with_(bandwidth_hz=None, disk_margin=0.7).bandwidth_hz[1] for tuning in fixed]
    for falling in (disks, asked):
        assert falling[0] >= falling[1] >= falling[2] < 0.97 * falling[0]


def see_inertia(model: Model, q: Array) -> Array:
    """Return what each joint turns while the others hold still, kg m², (N, n)."""
    return np.diagonal(compute_inertia(model, q), axis1=1, axis2=2)


def test_the_worst_margin_is_that_of_the_drawn_inertias() -> None:
    """With pan's inertia known to σ, the largest of 200 draws are about 2.75 σ off."""
    model = nominal(bundled("turret", "none"))
    least = see_inertia(model, sample_poses(model.rig)[0])[:, 0].min()
    variances = (0.2 * least) ** 2 * np.eye(len(name_parameters(model)))[0]
    tuning = tune(estimated(model, np.diag(variances)), disk_margin=0.8)
    low, _, high = tuning.ratios[0]
    assert (1 / low, 1 / high) == pytest.approx((1.55, 0.45), abs=0.12)
    weak, strong = (compute_margins(tuning.gains[0], DT, DT, ratio) for ratio in (low, high))
    assert tuning.worst[0].disk_margin == min(weak.disk_margin, strong.disk_margin)
    assert "pan" in tuning.doubts[0]  # its inertia may be half of what is believed


def test_a_pid_has_the_worst_margins_of_its_poses() -> None:
    tuning = tune(nominal(bundled("thesis")), kind="pid")
    moments = see_inertia(tuning.model, sample_poses(tuning.model.rig)[0][::5])
    for pid, stated, own, here in zip(tuning.gains, tuning.margins, tuning.inertia, moments.T):
        least = min(compute_margins(pid, DT, DT, own / one).disk_margin for one in here.tolist())
        assert least >= stated.disk_margin - 1e-3


@pytest.mark.parametrize("disk", [0.5, 0.9])
def test_redesign_keeps_the_margin_that_it_states(disk: float) -> None:
    """Within the layer it is more PID; the stated margins are those of that loop."""
    tuning = tuned(robust=True, disk_margin=disk)
    more = tuning.robust.gain * np.array(tuning.robust.rows)[:, [1, 0, 2]]
    for gains, found, drive in zip(tuning.gains + more, tuning.margins, tuning.model.drives):
        assert vars(compute_margins(Pid(*gains), DT, DT, drive=drive)) == pytest.approx(vars(found))
    least = min(row.disk_margin for row in tuning.worst)
    assert disk * (1 - 1e-9) <= least < disk + 0.02
    assert tuned(robust=True, bandwidth_hz=60.0).robust is None


# --- What is not known -------------------------------------------------------------------------------------------


def test_a_doubtful_model_is_told_and_refused_only_what_was_asked_for() -> None:
    sure = tuned(0.02)
    unsure = tuned(1.0)
    assert sure.doubts == ()
    assert not has(sure, ReasonKind.PID_SAFER)
    assert has(unsure, ReasonKind.PID_SAFER)
    assert unsure.doubts
    assert has(tuned(3.0), ReasonKind.UNCERTAIN)
    with pytest.raises(UsageError, match="disk_margin"):
        unsure.with_(disk_margin=1.5)


@pytest.mark.parametrize(
    ("wish", "place"),
    [
        ({"bandwidth_hz": 0.0}, "bandwidth_hz"),
        ({"bandwidth_hz": {"yaw": 5}}, "roll, tilt"),
        ({"damping": -1.0}, "damping"),
        ({"delay": -0.001}, "delay"),
        ({"dt": 2.0}, "dt"),
        ({"kind": "lqr"}, "kind"),
        ({"kind": "pid", "robust": True}, "robust"),
        ({"disk_margin": 2.5}, "disk_margin"),
        ({"model": {}}, "model"),
    ],
)
def test_wishes_that_cannot_be_are_refused(wish: dict[str, Any], place: str) -> None:
    with pytest.raises(UsageError, match=place):
        tune(**{"model": nominal(bundled("thesis")), **wish})
    with pytest.raises(UsageError, match="bandwidth_hz"):
        tuned().with_(bandwith=3)


def test_a_drift_that_no_log_shows_does_not_multiply_the_gain() -> None:
    """Its coefficients are known to so many N m and N m s/rad, and correlate with the bodies."""
    model = doubtful(0.02)
    known = model.estimated.covariance
    size = 1e10
    covariance = np.pad(known, (0, 2))
    covariance[-2:, -2:] = size**2 * np.eye(2)
    covariance[-2:, 0] = covariance[0, -2:] = 0.3 * np.sqrt(known[0, 0]) * size
    terms = (*model.terms, Term(FrictionDrift("pan", 1e5), (0.1, 0.0)))
    shown = estimated(replace(model, terms=terms), covariance)
    one, other = (tune(x, disk_margin=0.5) for x in (shown, model))
    np.testing.assert_allclose(one.bandwidth_hz, other.bandwidth_hz, rtol=0.02)
    np.testing.assert_allclose(one.ratios, other.ratios, rtol=0.02)


def test_rate_and_delay_are_the_logs_unless_told() -> None:
    model = nominal(bundled("turret"))
    known = Estimated((), (), np.zeros(0), np.zeros((0, 0)), dt=0.004, lags=(0.001, 0.009))
    found = tune(replace(model, estimated=known))
    assert (found.wish.dt, found.wish.delay) == (0.004, 0.009)
    told = found.with_(dt=0.002, delay=0.002)
    assert [has(one, ReasonKind.ASSUMED) for one in (found, told)] == [True, False]
    assert tune(model).wish.delay == 0.001


@pytest.mark.parametrize("kind", KINDS)
def test_a_found_limit_is_the_controllers(kind: str) -> None:
    model = replace(nominal(bundled("turret")), drive=(Saturation("tilt", 0.7),))
    assert tune(model, kind=kind).controller.outer.limits == (model.rig.tau_max[0], 0.7)


# --- What is made of it ------------------------------------------------------------------------------------------


def test_the_rival_is_a_pid_of_the_same_margin_with_gravity_fed_forward() -> None:
    tuning = tuned()
    _, rival = pair_rivals(tuning.stored).values()
    own = tuning.worst[0].disk_margin
    alone = tuning.with_(kind="pid", bandwidth_hz=None, disk_margin=own)
    assert rival.gains[0] == alone.gains[0]
    q = np.array([0.3, -0.2])
    still = np.zeros(2)
    torque, _ = rival.torque(0.0, q, still, Reference(q, still, still), rival.start())
    gravity = tuning.model.inverse_dynamics(q, still, still)
    np.testing.assert_allclose(torque, gravity)


def test_in_every_drives_unit_the_gains_give_the_pids_torque() -> None:
    """As transfer functions from the joint's error, at one complex frequency."""
    s = 3.0 + 2.0j
    motor = Motor(torque_constant=0.3, gear_ratio=-7.0, encoder_bits=14)
    gains = Pid.placed(5.0, 1.0, 0.1)
    found = convert_gains(gains, 0.2, motor)
    wanted, torque, current, count = (
        kp + ki / s + kd * s for kp, ki, kd in (gains, found.torque, found.current, found.count)
    )
    position, rate, integral, constant = found.odrive
    cascade = (position + s) * (rate + integral / s) / (2 * pi)
    acting = [torque, 0.3 * 7 * current, 0.3 * count / motor.encoder_step, 7**2 * cascade]
    np.testing.assert_allclose(acting, 0.2 * wanted)
    assert 7 * constant == pytest.approx(0.3)


def test_gains_are_left_out_in_units_that_a_motor_does_not_tell() -> None:
    gains = Pid.placed(5.0, 1.0, 0.2)
    assert convert_gains(gains, 0.1, Motor(encoder_bits=14)).current is None
    assert convert_gains(gains, 0.1, Motor(torque_constant=0.3), is_sliding=True).current is None


def test_the_curves_of_a_loop_are_shared_and_cross_where_its_margins_say() -> None:
    tuning = tune(nominal(bundled("thesis")), bandwidth_hz={"yaw": 4, "roll": 6, "tilt": 6})
    assert [curve.joints for curve in tuning.loop_curves] == [("yaw",), ("roll", "tilt")]
    for curve in tuning.loop_curves:
        crossing = curve.frequency[np.abs(curve.response) > 1].max()
        assert crossing == pytest.approx(curve.margins.crossover_hz, rel=0.05)
