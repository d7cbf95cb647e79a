"""Laws of the search: noise is no cause, what is planted explains what was there, unseen data confirm it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.signal import lfilter

from gimbal_pin.diagnosis import (
    Evidence,
    Explained,
    confirm_causes,
    diagnose,
    explain,
    gather,
    is_hidden_by_noise,
    solve_causes,
)
from gimbal_pin.diagnosis.engine.criterion import criterion
from gimbal_pin.dynamics import nominal, reduce_parameters
from gimbal_pin.effects import Armature, Cogging, Delay, JointFlexibility, Term, TorqueGain
from gimbal_pin.log import Array, Log
from tests.bench_logs import fourier
from tests.diagnosis.cases import few
from tests.refitted import ALIGNED, RIG, plant, record, refit
from tests.rigs import spelled

DT = 4e-3
PHI = 0.97
"""Of noise with a corner of 1.2 Hz at 250 samples a second: all of it within the motion's band."""
KINDS = few("cogging", "torque-bias", "asymmetric-friction", "stribeck", "actuator-lag")


def coloured_noise(shape: tuple[int, int], seed: int) -> Array:
    """AR(1) noise of unit power."""
    white = np.random.default_rng(seed).standard_normal(shape)
    return np.asarray(lfilter([np.sqrt(1 - PHI**2)], [1, -PHI], white, axis=0))


def log_of(size: float = 0.0, seed: int = 1, noise: float = 0.02) -> Log:
    """A motion with the torque that it takes, coloured noise, and cogging of that size at the first joint."""
    motion = fourier(RIG, seed, 24.0, DT)
    tau = nominal(RIG).inverse(motion.q, motion.v, motion.a)
    tau = tau + noise * np.std(tau, axis=0) * coloured_noise(tau.shape, seed)
    tau[:, 0] += size * np.sin(11 * motion.q[:, 0] + 0.3)
    return Log("log", RIG.joints, motion.t, motion.q, motion.v, tau)


def explain_log(log: Log, *more: str, without: str = "") -> Explained:
    kinds = {name: kind for name, kind in KINDS.items() if name != without}
    return explain(gather(RIG, [log], ALIGNED), reduce_parameters(RIG), {**kinds, **few(*more)})


@cache
def explained(size: float) -> Explained:
    return explain_log(log_of(size))


def test_noise_within_the_motions_band_is_no_cause() -> None:
    """It is whitened to about one, nothing is named, and δ predicts nothing of it."""
    found = explained(0.0)
    assert not found.state.causes
    assert np.all((found.first.fit.dispersion > 0.5) & (found.first.fit.dispersion < 1.3))
    assert all(lack.share < 0.1 for lack in found.before)


def test_what_is_planted_is_found_and_explains_what_was_there() -> None:
    found = explained(0.01)
    (cause,) = found.state.causes
    assert (cause.name, cause.place) == ("cogging", "pan")
    assert found.before[0].share > 0.3 and found.before[1].share < 0.1
    assert found.after[0].share < 0.1 and found.left(0) < 0.1
    assert found.final.causes == (cause,) and not any(found.structured)


def test_what_no_candidate_explains_is_left_and_seen() -> None:
    """Cogging, where nobody looks for it: nothing is named for most of it, and δ says that there is structure."""
    found = explain_log(log_of(0.01), without="cogging")
    assert found.after[0].share > 0.3 and found.left(0) > 0.5
    assert found.structured == (True, False)
    assert all(cause.place != "pan" for cause in found.final.causes)


def retimed_log(log: Log, late: Sequence[float]) -> Log:
    """Return a log whose torques were reported so much later than they acted."""
    tau = np.asarray(log.tau)
    shifted = [np.interp(log.t - by, log.t, x) for by, x in zip(late, tau.T)]
    return replace(log, tau=np.stack(shifted, axis=1))


def test_each_torques_time_is_estimated_and_is_no_finding() -> None:
    """Torques that are reported some milliseconds apart are aligned to a fifth of one, and cogging stays cogging."""
    late = (3e-3, -1e-3)
    found = explain_log(retimed_log(log_of(0.01, 3, noise=0.002), late))
    np.testing.assert_allclose(found.alignment, -np.array(late), atol=2e-4)
    assert [cause.name for cause in found.state.causes] == ["cogging"]


def test_a_drives_delay_is_a_cause_with_all_of_its_time() -> None:
    """15 ms are no shift of channels: they are named, and not 5 ms less than they are."""
    found = explain_log(retimed_log(log_of(0.0, 3, noise=0.002), (0.0, -15e-3)), "delay")
    (cause,) = found.state.causes
    assert isinstance(cause, Delay) and cause.place == "tilt"
    assert cause.time == pytest.approx(15e-3, abs=5e-4) and found.alignment[1] == 0.0


# unseen data


def teeth(amplitude: float, seed: int) -> Evidence:
    """A log of a motor that cogs."""
    model = plant(Term(Cogging("pan", (7.0,)), (amplitude, 0.0)))
    return gather(RIG, [record(model, seed, 16.0, 3e-4, DT)], ALIGNED)


def search(train: Evidence) -> Explained:
    return explain(train, reduce_parameters(RIG), few("cogging"), timed=False)


@pytest.mark.parametrize("amplitude", [0.004, 0.05])
def test_a_cause_that_unseen_data_deny_is_left_out_and_what_it_explained_is_unknown(
    amplitude: float,
) -> None:
    found = search(teeth(amplitude, 0))
    kept = confirm_causes(found, teeth(amplitude, 1))
    assert kept.found is found and not kept.denied
    before, after = (x["torque_rmse"]["pan"] for x in (kept.baseline, kept.figures))
    assert after < 0.5 * before
    refuted = confirm_causes(found, teeth(0.0, 2))
    assert refuted.found.final.causes == () and refuted.figures == refuted.baseline
    assert refuted.found.structured == (True, False)
    (said,) = refuted.denied
    assert "pan" in said and "cogging" in said


def test_what_is_less_than_an_error_of_the_models_form_is_no_cause() -> None:
    """However clear of the noise: every rigid model is off by half a per cent of the torque."""
    for amplitude, names in ((0.0015, []), (0.004, ["cogging"])):
        found = search(teeth(amplitude, 0))
        assert [cause.name for cause in found.final.causes] == names
        assert not any(found.structured)


def test_parameters_cost_more_than_they_gain_by_luck() -> None:
    """``log N`` each, of which noise gains about one."""
    state = refit(record(nominal(RIG), dt=DT))
    more = solve_causes(state.problem, (Cogging("pan", (7.0,)),), state)
    assert 0.0 < criterion(more) - criterion(state) < 2.0 * np.log(state.problem.evidence.rows)


# noise in the motion

PENDULUM = """<robot name="pendulum"><link name="base"/>
<link name="arm"><inertial><origin xyz="0 0 -0.3"/><mass value="1"/>
<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="swing" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
<limit lower="-3" upper="3" effort="20" velocity="20"/></joint></robot>
"""
INERTIA = 0.1
WEIGHT = 9.80665 * 0.3
"""About the axis, kg m², and what the arm weighs at its radius, N m."""


def swing(shaken: float, inertia: float = INERTIA) -> Log:
    """An arm whose joint shakes by so much from 4 to 12 Hz, rad; its controller damps that."""
    rng = np.random.default_rng(0)
    t = np.arange(0.0, 30.0, 0.004)
    slow, fast = (2 * np.pi * rng.uniform(*band, 12) for band in ((0.1, 1.0), (4.0, 12.0)))

    def waves(w: Array, order: int) -> Array:
        """A derivative of a sum of sines."""
        angle = np.outer(t, w) + np.arange(12) + order * np.pi / 2
        return np.asarray(np.sin(angle) @ w**order)

    q, v, a = (0.2 * waves(slow, k) for k in range(3))
    tau = inertia * a + WEIGHT * np.sin(q) + 0.05 * v + 0.1 * np.tanh(v / 0.01)
    tau += 0.01 * rng.standard_normal(len(t)) - 0.5 * shaken * waves(fast, 1)
    read = q + shaken * waves(fast, 0)
    return Log("swing", ("swing",), t, read[:, None], tau=tau[:, None])


@pytest.mark.parametrize(
    ("shaken", "inertia", "told"),
    [
        (0.0, INERTIA, ""),
        (0.0, 1.3 * INERTIA, "more than the URDF's"),
        (0.02, 1.3 * INERTIA, "noise in the motion may hide inertia"),
    ],
)
def test_a_quiet_motion_tells_the_inertia_and_a_shaken_one_does_not(
    shaken: float, inertia: float, told: str
) -> None:
    found = diagnose(spelled(PENDULUM), swing(shaken, inertia), {})
    said = [note for note in found.notes if "inertia" in note]
    assert len(said) == (told != "") and all(told in note for note in said)
    assert found.state is not None
    springy = JointFlexibility("swing", 8.0, rotor_share=0.3)
    for cause in (springy, Armature("swing"), TorqueGain("swing"), Delay("swing", 0.01)):
        hidden = shaken > 0 and not isinstance(cause, Delay)
        assert is_hidden_by_noise(found.state, cause) == hidden
