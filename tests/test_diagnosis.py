"""Laws of the diagnosis: noise is not named, what is planted is found with its size, what cannot be told is said so."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import pytest

from gimbal_pin.diagnosis import BAND, Diagnosis, diagnose
from gimbal_pin.diagnosis.agreement import agreement, alone, outright
from gimbal_pin.diagnosis.diagnose import unjudged
from gimbal_pin.diagnosis.evidence import Evidence, gather
from gimbal_pin.diagnosis.extended import Extended
from gimbal_pin.diagnosis.heldout import rollout_rmse, torque_rmse
from gimbal_pin.diagnosis.score import chance
from gimbal_pin.effects import CAUSES
from gimbal_pin.effects.parse import parse_effect
from gimbal_pin.errors import DataError
from gimbal_pin.excitation import excite
from gimbal_pin.experiment import bench_run, repeated
from gimbal_pin.log import Array, Log, Motion
from gimbal_pin.model import nominal
from gimbal_pin.rig import Rig
from gimbal_pin.simulation import plant_with
from tests.bench_logs import fourier, prescribed

SECONDS, DT = 20.0, 0.004


@pytest.fixture(scope="module")
def rig() -> Rig:
    return Rig.load("turret")


@pytest.fixture(scope="module")
def motion(rig: Rig) -> Motion:
    design = excite(rig, seconds=10.0, starts=1, rng=np.random.default_rng(5), torque_model=nominal(rig), dt=DT)
    return repeated(design.motion, SECONDS, DT)


def recorded(rig: Rig, motion: Motion, planted: tuple[str, ...] = (), seed: int = 0) -> Log:
    """A log of the turret with causes planted, 1 % torque noise, its own encoders and gyros."""
    from gimbal_pin.tuning import tune

    altered = plant_with(nominal(rig), [parse_effect(text, rig) for text in planted])
    mover = tune(nominal(rig), bandwidth_hz=4.0, dt=DT).controller
    rng = np.random.default_rng(seed)
    return bench_run(altered.plant, mover, rng=rng, reference=motion, drive=altered.drive)


def said(rig: Rig, log: Log, causes: Iterable[str] = CAUSES) -> Diagnosis:
    return diagnose(rig, [log], {name: CAUSES[name] for name in causes}, rng=np.random.default_rng(1))


# the evidence


@pytest.fixture(scope="module")
def clean(rig: Rig, motion: Motion) -> Log:
    return recorded(rig, motion)


@pytest.fixture(scope="module")
def evidence(rig: Rig, clean: Log) -> Evidence:
    return gather(rig, [clean], BAND, {clean.name: 0.0})


def test_a_joint_of_which_the_held_out_part_shows_nothing_is_told(evidence: Evidence) -> None:
    """Where no sample counts an error of zero is none."""
    first = np.arange(len(evidence.rig.joints)) == 0
    shut = replace(evidence, parts=[part._replace(gate=np.where(first, 0.0, part.gate)) for part in evidence.parts])
    assert not unjudged(evidence)
    assert [line.split(":")[0] for line in unjudged(shut)] == [evidence.rig.joints[0]]


def test_white_torque_noise_becomes_rows_of_unit_noise(rig: Rig) -> None:
    """A rig whose only misfit is white torque noise: unit variance after whitening, whatever the joint's torque."""
    t, steady = 0.002 * np.arange(15_001), 1e-3 * np.ones((15_001, rig.n))
    noise = np.random.default_rng(3).standard_normal(steady.shape) * [0.02, 0.3]
    still = Log("still", rig.joints, t, np.cumsum(steady, axis=0), None, noise)
    found = gather(rig, [still], BAND, {still.name: 0.0})
    inner = slice(40, -40)
    for j in range(rig.n):
        white = found.whiten([part.channels.tau[:, j] for part in found.parts], j)[inner]
        # The pass band of the whitener is seven eighths of the rows' band.
        assert np.var(white) == pytest.approx(0.875, abs=0.12)


def test_whitening_is_linear(evidence: Evidence) -> None:
    rng = np.random.default_rng(0)
    a, b = ([rng.standard_normal(len(part.gate)) for part in evidence.parts] for _ in range(2))
    both = evidence.whiten([2.0 * x - y for x, y in zip(a, b)], 1)
    np.testing.assert_allclose(both, 2.0 * evidence.whiten(a, 1) - evidence.whiten(b, 1), atol=1e-9)


def test_mixed_torque_lies_between_its_sources(evidence: Evidence) -> None:
    """Where both agree the mixture is what both say; its weights are shares."""
    for part in evidence.parts:
        np.testing.assert_allclose(part.mixed(part.channels.tau, part.channels.tau), part.channels.tau, atol=1e-12)
        assert np.all((part.trust >= 0) & (part.trust <= 1))


@pytest.mark.parametrize(("width", "blocks"), [(1, 20), (2, 40), (4, 40)])
def test_chance_is_uniform_under_noise(width: int, blocks: int) -> None:
    """Hotelling's T² of pure noise: its chances are uniform, a hundredth of them under a hundredth."""
    rng = np.random.default_rng(0)
    x = rng.standard_normal((20_000, blocks, width))
    s = x.sum(axis=1)
    centred = x - x.mean(axis=1, keepdims=True)
    scatter = np.einsum("tbi,tbj->tij", centred, centred)
    p = np.asarray(
        chance(np.einsum("ti,tij,tj->t", s, np.linalg.inv(scatter), s) * (blocks - 1) / blocks, width, blocks)
    )
    assert np.mean(p) == pytest.approx(0.5, abs=0.01)
    assert np.mean(p < 0.01) == pytest.approx(0.01, abs=0.003)


def test_inertias_that_no_body_has_are_not_simulated(rig: Rig, evidence: Evidence) -> None:
    """What slow motion makes of an inertia that it does not show may be negative: that denies no cause."""
    sound, absurd = (Extended(nominal(rig.with_phi(size * rig.phi))) for size in (1.0, -0.2))
    assert np.all(np.isfinite(rollout_rmse(evidence, sound)))
    assert np.all(np.isnan(rollout_rmse(evidence, absurd))) and np.all(np.isfinite(torque_rmse(evidence, absurd)))


# the verdict


@pytest.fixture(scope="module")
def nothing(rig: Rig, clean: Log) -> Diagnosis:
    return said(rig, clean)


def test_nothing_is_found_where_nothing_is(nothing: Diagnosis) -> None:
    found = nothing
    assert found.verdict == "nothing" and not found.findings
    assert all(0 < limit < 0.05 for limit in found.detection_limit.values())
    assert found.baseline == found.extended


DRIVE = ("actuator-lag", "delay", "joint-flexibility", "backlash", "armature", "torque-gain", "saturation")
FRICTION = (*(name for name in CAUSES if "friction" in name), "stribeck", "presliding", "torque-bias")
PLANTED: list[tuple[tuple[str, ...], Iterable[str]]] = [
    (("cogging:pan:amplitude=0.02,harmonic=14", "stribeck:tilt:extra=0.03,speed=0.2"), CAUSES),
    (
        ("position-dependent-friction:pan:amplitude=0.02,harmonic=3", "dead-zone:tilt:width=0.02"),
        (*FRICTION, "cogging", "cable-spring", "dead-zone", "backlash"),
    ),
    (("actuator-lag:tilt:time_constant=0.012",), DRIVE),
    (("load-dependent-friction:tilt:mu=0.1",), FRICTION),
]
"""What one log hides, a cause a joint, and among which it is looked for: all, or its kin, which are its rivals."""
IDS = [" and ".join(text.split(":")[0] for text in texts) for texts, _ in PLANTED]


@pytest.mark.parametrize(("texts", "causes"), PLANTED, ids=IDS)
def test_what_is_planted_is_found(rig: Rig, motion: Motion, texts: tuple[str, ...], causes: Iterable[str]) -> None:
    """The right name, or a class that holds it; its figures within four deviations or a tenth; a gain."""
    found = said(rig, recorded(rig, motion, texts, seed=2), causes)
    assert found.verdict in ("named", "ambiguous")
    assert found.findings[0].joint in {text.split(":")[1] for text in texts}
    for text in texts:
        cause, joint, figures = text.split(":")
        first = next(one for one in found.findings if one.joint == joint)
        assert cause in first.alike
        assert first.gain["torque_rmse_after"] < 0.8 * first.gain["torque_rmse_before"]
        assert first.gain["rollout_rmse_after"] < 1.05 * first.gain["rollout_rmse_before"]
        if first.cause == cause:
            true = {name: float(value) for name, value in (pair.split("=") for pair in figures.split(","))}
            for parameter in (p for p in first.parameters if p.name in true):
                away = abs(parameter.value - true[parameter.name])
                assert away < max(4 * np.nan_to_num(parameter.std), 0.1 * true[parameter.name])


def test_bias_and_asymmetric_friction_are_one_class(rig: Rig, motion: Motion) -> None:
    """Constant torque and Coulomb friction that differs by direction are the same torque: no log parts them."""
    found = said(rig, recorded(rig, motion, ("torque-bias:pan:bias=0.03",), seed=6), FRICTION)
    assert found.verdict == "ambiguous"
    assert {"torque-bias", "asymmetric-friction"} <= set(found.findings[0].alike)
    assert found.findings[0].next_experiment


@pytest.mark.parametrize(
    ("planted", "rivals"),
    [
        ("torque-bias:pan:bias=0.03", ("torque-bias", "base-tilt", "cable-spring")),
        ("torque-bias:tilt:bias=0.05", ("torque-bias", "asymmetric-friction")),
    ],
)
def test_what_agrees_within_a_third_of_a_radian_is_not_told_apart(
    rig: Rig, planted: str, rivals: tuple[str, ...]
) -> None:
    """A leaning base is as good as a constant there, whatever joint it acts at, and gravity hides most of a bias."""
    motion = fourier(rig, 0, 15.0, DT)
    middle = motion.q.mean(axis=0)
    size = 0.3 / np.abs(motion.q - middle).max(axis=0)
    small = Motion(motion.t, (motion.q - middle) * size, motion.v * size, motion.a * size)
    log = recorded(rig, small, (planted,), seed=0)
    found = said(rig, log, rivals)
    assert found.verdict == "ambiguous"
    assert set(rivals[:2]) <= set(found.findings[0].alike)


def test_foreign_torque_is_unknown(rig: Rig, motion: Motion) -> None:
    """A resonance that no cause of the library makes: unknown, and said to be structured."""
    log = recorded(rig, motion, seed=8)
    t = log.t
    slosh = 0.3 * np.sin(2 * np.pi * 3.1 * t + 4 * np.sin(0.7 * t))
    foreign = replace(log, tau=np.asarray(log.tau) + np.stack([slosh, 0 * slosh], axis=1))
    found = said(rig, foreign)
    assert not any(f.status == "named" for f in found.findings)
    assert found.residual["pan"].state == "structured"


def test_json_holds_what_others_read(nothing: Diagnosis) -> None:
    data = json.loads(json.dumps(nothing.to_dict()))
    keys = (
        "schema rig logs verdict findings residual immaterial alignment_s untestable detection_limit baseline extended"
    )
    assert set(keys.split()) <= set(data)
    assert set(data["residual"]["pan"]) >= {"state", "noise_floor", "dispersion", "where"}


UNANSWERABLE = ["one second", "one joint", "still"]


@pytest.mark.parametrize("kind", UNANSWERABLE)
def test_a_log_that_cannot_answer_is_refused(rig: Rig, clean: Log, kind: str) -> None:
    """One second of motion, or joints that never moved: exit code 3, and no name."""
    with pytest.raises(DataError):
        said(rig, spoilt(clean, kind))


def spoilt(log: Log, kind: str) -> Log:
    """The log cut short, with one joint held, or never moved."""
    if kind == "one second":
        return log.part(slice(0, round(1.0 / DT)))
    held = slice(0, 1) if kind == "one joint" else slice(0, 2)

    def stopped(x: Array | None) -> Array | None:
        if x is None:
            return None
        out = np.array(x)
        out[:, held] = 0.0
        return out

    return replace(log, q=stopped(log.q), v=stopped(log.v))


@pytest.mark.parametrize("kind", ["every channel", "the torque", "a rig at rest"])
def test_pure_noise_is_never_named(rig: Rig, clean: Log, kind: str) -> None:
    """Noise in the place of some channels: refused, or a verdict that names nothing."""
    rng = np.random.default_rng(0)

    def noise(x: Array, size: float) -> Array:
        return size * rng.standard_normal(x.shape)

    tau = noise(np.asarray(clean.tau), 0.3)
    log = replace(clean, tau=tau)
    if kind == "every channel":
        log = replace(log, q=noise(clean.q, 0.5), v=noise(clean.q, 1.0))
    elif kind == "a rig at rest":
        log = replace(log, q=noise(clean.q, 1e-4), v=None)
    try:
        found = said(rig, log)
    except DataError as error:
        assert error.exit_code == 3
        return
    assert found.verdict in ("nothing", "data", "unknown") and not found.findings


def of_another(rig: Rig, payload: str, seed: int) -> Log:
    return prescribed(nominal(Rig.load(rig.name, payload)), seed, seconds=16.0, torque_noise=0.02, dt=0.002)


@pytest.mark.parametrize("payloads", [("infrared", "cinema"), ("infrared", "infrared", "mirrorless")])
def test_logs_of_different_payloads_are_a_fault_of_the_data(rig: Rig, payloads: tuple[str, ...]) -> None:
    """Cameras swapped and not told: the verdict is data whichever log is held out, and no cause is named."""
    logs = [replace(of_another(rig, payload, k), name=f"{k}.csv") for k, payload in enumerate(payloads)]
    few = {name: CAUSES[name] for name in ("cable-spring", "base-tilt", "torque-bias")}
    found = diagnose(rig, logs, few, rng=np.random.default_rng(0), filtering=replace(BAND, alignment=0.0))
    assert found.verdict == "data" and not found.findings
    assert [fault.cause for fault in found.spoiling] == ["logs-disagree"]
    assert "one at a time" in found.spoiling[0].next_experiment


@pytest.mark.parametrize(
    "planted", ["", "cogging:tilt:amplitude=0.05,harmonic=14", "stribeck:tilt:extra=0.1,speed=0.2"]
)
def test_logs_of_one_rig_agree(rig: Rig, planted: str) -> None:
    """Whatever else is wrong with it, and even before that is known."""
    model = plant_with(nominal(rig), [parse_effect(planted, rig)] if planted else []).plant
    logs = [prescribed(model, k, seconds=16.0, torque_noise=0.02, dt=0.002) for k in range(3)]
    each = alone(rig, logs, replace(BAND, alignment=0.0))
    assert outright(rig, each) is None and agreement(rig, each, ()) is None


@pytest.mark.parametrize("sizes", [(0.2, 0.2, 0.2), (0.2, 0.2, -0.2)])
def test_a_cause_is_the_same_in_every_log_of_one_rig(rig: Rig, sizes: tuple[float, ...]) -> None:
    """A constant torque explains the logs of one rig together, and not those of a rig that was touched in between."""
    models = [plant_with(nominal(rig), [parse_effect(f"torque-bias:tilt:bias={x}", rig)]).plant for x in sizes]
    logs = [prescribed(model, k, seconds=16.0, torque_noise=0.02, dt=0.002) for k, model in enumerate(models)]
    fault = agreement(rig, alone(rig, logs, replace(BAND, alignment=0.0)), (CAUSES["torque-bias"]("tilt"),))
    assert (fault is None) == (len(set(sizes)) == 1)


@pytest.mark.parametrize("beside", ["torque-bias:tilt:bias=0.02", "asymmetric-friction:tilt:coulomb=0.02"])
def test_what_pulls_one_way_beside_a_spring_is_told_to_be_in_where_it_rests(rig: Rig, beside: str) -> None:
    """``k (q - rest) + c = k (q - (rest - c/k))``: the angle is off by that, and the sentence says so per N m."""
    spring = "cable-spring:tilt:stiffness=0.5,rest=0.2"
    plant = plant_with(nominal(rig), [parse_effect(one, rig) for one in (spring, beside)]).plant
    few = {name: CAUSES[name] for name in ("cable-spring", "torque-bias", "asymmetric-friction")}
    log = prescribed(plant, seconds=16.0, torque_noise=0.01, dt=0.002)
    (found,) = diagnose(rig, [log], few, rng=np.random.default_rng(0), filtering=replace(BAND, alignment=0.0)).findings
    figures = {figure.name: figure.value for figure in found.parameters}
    assert found.cause == "cable-spring" and figures["rest"] == pytest.approx(0.2 - 0.02 / 0.5, abs=0.01)
    assert (
        "torque-bias or asymmetric-friction" in found.sentence
        and "another rest angle, by 2 rad per N m" in found.sentence
    )


def test_every_cause_of_the_contract_is_looked_for() -> None:
    """The library is what `effects` exports: nothing is listed twice."""
    assert all(kind.name == name for name, kind in CAUSES.items())
