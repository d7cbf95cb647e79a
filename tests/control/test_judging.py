"""Controllers on perturbed plants: what is claimed of them is what a true plant shows."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from plants import PLANTS, Flaws, Mover, Peer, draw_body, measure_truth

from gimbal_pin.control import RIVAL, judge_controllers, pair_rivals, plan_step, tune
from gimbal_pin.dynamics import Estimated, Model, Sensors, nominal, reduce_parameters, simulate
from gimbal_pin.identification import identify
from gimbal_pin.log import Log, Motion
from gimbal_pin.regression import find_base_columns
from gimbal_pin.rig import Motor, Rig
from tests.bench_logs import prescribed

DT = 0.004


def known(share: float, name: str = "turret") -> Model:
    """The nominal model, its parameters known to a share of their size."""
    rig = Rig.load(name)
    reduction = reduce_parameters(rig)
    model = nominal(rig)
    values = np.array(
        [*rig.phi[find_base_columns(rig, reduction)], *(x for t in model.terms for x in t.values)]
    )
    names = (*reduction.base_names, *(f"{t.effect.joint}.{t.effect.name}" for t in model.terms))
    return replace(
        model,
        estimated=Estimated(names, ("",) * len(names), values, np.diag((share * values) ** 2)),
    )


def test_without_doubt_and_noise_every_plant_is_the_single_simulation() -> None:
    model = known(0.0)
    tuned = tune(model, dt=DT, delay=0.0)
    laws = pair_rivals(tuned.stored)
    exact = Sensors.exact(model.rig.n)
    found = judge_controllers(model, laws, rng=0, plants=2, delay=0.0, sensors=exact, rest=0.5)
    reference = plan_step(model, DT, 0.5)
    for name, law in laws.items():
        log = simulate(model, law, reference, rng=0, sensors=exact, delay=0)
        error = (reference.q - log.q)[reference.t >= 0.5 - DT / 2]
        np.testing.assert_allclose(
            found.errors[name], np.sqrt(np.mean(error**2, axis=0))[None].repeat(2, 0), rtol=1e-9
        )


def test_more_doubt_never_lowers_the_worst_error() -> None:
    laws = pair_rivals(tune(known(0.0), dt=DT).stored)
    each = [
        judge_controllers(known(share), laws, rng=1, plants=6, sensors=Sensors.exact(2))
        for share in (0, 0.1, 0.3)
    ]
    worst = [found.errors["computed-torque"].max(axis=0) for found in each]
    assert (np.diff(worst, axis=0) >= 0).all() and (worst[2] > worst[0]).all()


def test_friction_near_standstill_is_in_doubt_where_logs_told_it() -> None:
    """A step begins at rest, where rows of a log do not show which way dry friction acts: nothing else is in doubt."""
    sure = known(0.0)
    assert sure.estimated is not None
    laws = pair_rivals(tune(sure, dt=DT, delay=0.0).stored)
    exact = Sensors.exact(sure.rig.n)
    known_by = [
        replace(sure, estimated=replace(sure.estimated, missed=one)) for one in ((), (0.0, 0.0))
    ]
    stated, logged = (
        judge_controllers(x, laws, rng=0, plants=4, delay=0.0, sensors=exact) for x in known_by
    )
    for name in laws:
        assert np.ptp(stated.errors[name], axis=0).max() < np.ptp(logged.errors[name], axis=0).min()


def test_a_torque_that_the_model_misses_and_noise_cost_error() -> None:
    sure = known(0.0)
    assert sure.estimated is not None
    laws = pair_rivals(tune(sure, dt=DT).stored)
    blind = [
        replace(sure.estimated, **more)
        for more in ({}, {"missed": (0.05, 0.05)}, {"noise": (0.02, 0.02)})
    ]
    clear, missed, noisy = (
        judge_controllers(replace(sure, estimated=one), laws, rng=0, plants=4).errors[
            "computed-torque"
        ]
        for one in blind
    )
    assert (np.median(missed, axis=0) > np.median(clear, axis=0)).all()
    assert (np.median(noisy, axis=0) > np.median(clear, axis=0)).all()


def test_no_error_is_smaller_than_the_encoders_resolve() -> None:
    rig = Rig.load("turret")
    coarse = replace(
        rig, motors=tuple(Motor(motor.tau_max, encoder_bits=8) for motor in rig.motors)
    )
    model = nominal(coarse)
    found = judge_controllers(model, pair_rivals(tune(model, dt=DT).stored), rng=0, plants=2)
    np.testing.assert_allclose(found.resolved, 2 * np.pi / 2**8 / np.sqrt(12))
    assert all((rows >= found.resolved).all() for rows in found.errors.values())


def test_an_encoder_that_nobody_states_is_the_one_of_the_log() -> None:
    """Rounding to a step has a deviation of step/√12; a stated encoder is believed."""
    rig = Rig.load("turret")
    step = 2 * np.pi / 2**14
    bare = replace(rig, motors=tuple(replace(motor, encoder_bits=None) for motor in rig.motors))
    log = prescribed(nominal(rig), dt=2e-3)
    model = identify(bare, [replace(log, q=step * np.round(log.q / step))], holdout="none").model
    found, told = (
        judge_controllers(one, pair_rivals(tune(one, dt=DT).stored), rng=0, plants=2).resolved
        for one in (model, replace(model, rig=rig))
    )
    np.testing.assert_allclose(found, step / np.sqrt(12), rtol=0.1)
    np.testing.assert_allclose(told, [motor.encoder_step / np.sqrt(12) for motor in rig.motors])


def test_the_pid_keeps_the_disk_margin_of_the_controller() -> None:
    """At the worst pose and draw; nothing faster would."""
    model = known(0.1)
    tuned = tune(model, dt=DT, delay=DT)
    laws = pair_rivals(tuned.stored)
    assert list(laws) == ["computed-torque", RIVAL]
    placed = dict(zip(model.rig.joints, bandwidths(laws[RIVAL].gains)))
    pid = tune(model, kind="pid", dt=DT, delay=DT, bandwidth_hz=placed)
    for own, rival in zip(tuned.worst, pid.worst):
        assert own.disk_margin <= rival.disk_margin < 1.02 * own.disk_margin


def test_a_judgement_is_repeatable_and_goes_to_json() -> None:
    model = known(0.1)
    laws = pair_rivals(tune(model, dt=DT).stored)
    first, again = (judge_controllers(model, laws, rng=3, plants=3).to_dict() for _ in range(2))
    assert first == again == json.loads(json.dumps(first, allow_nan=False)) and first["plants"] == 3
    ratios = first["ratios"]["computed-torque"]
    assert all(
        ratios["worst"][place] <= ratios["median"][place] for place in ("pan", "tilt", "all")
    )


@pytest.mark.parametrize("name", ["pan-tilt", "heavy-pan-tilt", "ring", "handheld"])
def test_the_ratio_that_is_claimed_is_that_on_the_true_plant(name: str, tmp_path: Path) -> None:
    """Another engine, bodies 10 to 20 % off, friction of another form, 14-bit encoders, 2 to 6 ms of delay."""
    gimbal = PLANTS[name]
    rng = np.random.default_rng([0, *map(ord, name)])
    bodies = tuple(replace(each, body=draw_body(each.body, rng)) for each in gimbal.axes)
    truth = replace(gimbal, axes=bodies, camera=draw_body(gimbal.camera, rng))
    late = float(rng.uniform(0.002, 0.006))
    friction = rng.uniform([[0.01], [0.005]], [[0.03], [0.02]], (2, len(bodies)))
    plant = Peer(truth, Flaws(friction, late, bits=14, stribeck=0.4))
    (tmp_path / "rig.urdf").write_text(gimbal.write_urdf(payload=True))
    rig = Rig.load(str(tmp_path / "rig.urdf"))
    rig = replace(rig, motors=tuple(Motor(motor.tau_max, encoder_bits=14) for motor in rig.motors))
    log = record_sines(plant, rig, rng)
    model = identify(rig, [log]).model
    tuned = tune(model, delay=late)
    laws = pair_rivals(tuned.stored)
    found = judge_controllers(model, laws, rng=0, plants=11, delay=late)
    claimed = float(np.median(found.compute_ratios("computed-torque")[:, -1]))
    _, true = measure_truth(plant, laws, model, rng)
    assert true / 1.5 < claimed < 1.5 * true


def record_sines(plant: Peer, rig: Rig, rng: np.random.Generator) -> Log:
    """A log of sines of all axes."""
    t = np.arange(0, 30, plant.dt)[:, None]
    q = sum(
        0.25 / k**0.5 * np.sin(2 * np.pi * 0.22 * k * t * (1 + 0.17 * np.arange(rig.n)) + k)
        for k in (1, 2, 4)
    )
    v = np.gradient(q, plant.dt, axis=0)
    mover = Mover(plant.inertia(q[0]), plant.dt, 12.0)
    seen, _, torque = plant.run(mover, Motion(t[:, 0], q, v, 0 * v), rng)
    return Log("sines.csv", rig.joints, t[:, 0], seen, None, torque, q_ref=q)


def bandwidths(gains: tuple) -> list[float]:
    """Of outer loops that were placed with the usual damping and integral action, Hz."""
    return [pid.kd / 2.2 / (2 * np.pi) for pid in gains]
