"""Laws of the engine: noise from the data, discrepancy, one criterion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.signal import lfilter

from gimbal_pin.diagnosis import DIAGNOSIS_BAND, Evidence, Explained, explain, gather
from gimbal_pin.dynamics import nominal, reduce_parameters
from gimbal_pin.effects import CAUSES, Cause, Delay
from gimbal_pin.log import Array, Log
from gimbal_pin.rig import Rig
from tests.bench_logs import fourier

RIG = "turret"
DT = 4e-3
PHI = 0.97
"""Of noise with a corner of 1.2 Hz at 250 samples a second: all of it within the motion's band."""
KINDS = {
    name: CAUSES[name]
    for name in ("cogging", "torque-bias", "asymmetric-friction", "stribeck", "actuator-lag")
}


def coloured_noise(shape: tuple[int, int], seed: int) -> Array:
    """AR(1) noise of unit power."""
    white = np.random.default_rng(seed).standard_normal(shape)
    return np.asarray(lfilter([np.sqrt(1 - PHI**2)], [1, -PHI], white, axis=0))


def log_of(size: float = 0.0, seed: int = 1, noise: float = 0.02, seconds: float = 24.0) -> Log:
    """A motion with the torque that it takes, coloured noise, and cogging of that size at the first joint."""
    rig = Rig.load(RIG)
    motion = fourier(rig, seed, seconds, DT)
    tau = nominal(rig).inverse(motion.q, motion.v, motion.a)
    tau = tau + noise * np.std(tau, axis=0) * coloured_noise(tau.shape, seed)
    tau[:, 0] += size * np.sin(11 * motion.q[:, 0] + 0.3)
    return Log("log", rig.joints, motion.t, motion.q, motion.v, tau)


def evidence_of(log: Log, alignment: float = 0.0) -> Evidence:
    return gather(Rig.load(RIG), [log], replace(DIAGNOSIS_BAND, alignment=alignment))


def explain_log(log: Log, kinds: Mapping[str, type[Cause]] = KINDS) -> Explained:
    return explain(evidence_of(log), reduce_parameters(Rig.load(RIG)), kinds)


@cache
def explained(size: float = 0.0, seed: int = 1) -> Explained:
    return explain_log(log_of(size, seed))


def test_what_a_spring_takes_off_the_noise_of_an_acceleration_is_no_spring() -> None:
    """A slow motion whose rates are noisy, and nothing in it: a spring would smooth what is known of the motion."""
    rig = Rig.load(RIG)
    rng = np.random.default_rng(0)
    t = DT * np.arange(5000)
    w = np.array([[1.38, 2.28], [2.62, 3.2]])[:, None]
    size = np.array([0.125, 0.0875])
    phase = t[:, None] * w
    q, v, a = (
        np.sum(size * x, axis=0)
        for x in (np.sin(phase), w * np.cos(phase), -(w**2) * np.sin(phase))
    )
    tau = nominal(rig).inverse(q, v, a) + 3e-3 * rng.standard_normal(q.shape)
    q, v = (x + std * rng.standard_normal(x.shape) for x, std in ((q, 1e-5), (v, 1e-3)))
    assert not explain_log(
        Log("log", rig.joints, t, q, v, tau), {"joint-flexibility": CAUSES["joint-flexibility"]}
    ).state.causes


def test_noise_within_the_motions_band_is_no_cause() -> None:
    """It is whitened to about one, nothing is named, and δ predicts nothing of it."""
    found = explained()
    assert not found.state.causes
    assert np.all((found.first.fit.dispersion > 0.5) & (found.first.fit.dispersion < 1.3))
    assert all(lack.share < 0.1 for lack in found.before)


def test_what_is_planted_is_found_and_explains_what_was_there() -> None:
    found = explained(0.01)
    (cause,) = found.state.causes
    assert (cause.name, cause.place) == ("cogging", Rig.load(RIG).joints[0])
    assert found.before[0].share > 0.3 and found.before[1].share < 0.1
    assert found.after[0].share < 0.1 and found.left(0) < 0.1
    assert found.final.causes == (cause,) and not any(found.structured)


def test_what_no_candidate_explains_is_left_and_seen() -> None:
    """Cogging, where nobody looks for it: nothing is named for most of it, and δ says that there is structure."""
    kinds = {name: kind for name, kind in KINDS.items() if name != "cogging"}
    found = explain_log(log_of(0.01), kinds)
    assert found.after[0].share > 0.3 and found.left(0) > 0.5
    assert found.structured == (True, False)
    assert all(cause.place != Rig.load(RIG).joints[0] for cause in found.final.causes)


def retimed_log(log: Log, late: Sequence[float]) -> Log:
    """Return a log whose torques were reported so much later than they acted."""
    assert log.tau is not None
    shifted = [np.interp(log.t - by, log.t, tau) for by, tau in zip(late, log.tau.T)]
    return replace(log, tau=np.stack(shifted, axis=1))


def test_each_torques_time_is_estimated_and_is_no_finding() -> None:
    """Torques that are reported some milliseconds apart are aligned to a fifth of one, and cogging stays cogging."""
    late = (3e-3, -1e-3)
    found = explain_log(retimed_log(log_of(0.01, 3, noise=0.002), late))
    assert found.alignment == pytest.approx(-np.array(late), abs=2e-4)
    assert [cause.name for cause in found.state.causes] == ["cogging"]


def test_a_drives_delay_is_a_cause_with_all_of_its_time() -> None:
    """15 ms are no shift of channels: they are named, and not 5 ms less than they are."""
    found = explain_log(
        retimed_log(log_of(0.0, 3, noise=0.002), (0.0, -15e-3)), {**KINDS, "delay": CAUSES["delay"]}
    )
    (cause,) = found.state.causes
    assert (cause.name, cause.place) == ("delay", Rig.load(RIG).joints[1])
    assert isinstance(cause, Delay) and cause.time == pytest.approx(15e-3, abs=5e-4)
    assert found.alignment[1] == 0.0
