"""Laws of compensation: what is found is in the loop's margins, in the feed-forward, and in the file between them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gimbal_pin.control import ComputedTorque, Pid, compute_margins, stored, tune
from gimbal_pin.dynamics import Estimated, Model, nominal, plant_with, read_model_data
from gimbal_pin.effects import (
    ActuatorLag,
    CableSpring,
    DeadZone,
    Delay,
    JointFlexibility,
    Saturation,
    Signal,
    parse_effect,
)
from gimbal_pin.errors import ModelError
from gimbal_pin.identification import read_model, write_extended
from gimbal_pin.log import write_yaml
from gimbal_pin.rig import Rig

DT = 0.001
LINEAR = [
    Delay("pan", 0.0),
    Delay("pan", 0.0034),
    ActuatorLag("pan", 0.005),
    JointFlexibility("pan", 25.0, 0.1, 0.3),
]


@pytest.fixture(scope="module")
def rig() -> Rig:
    return Rig.load("turret")


def with_causes(rig: Rig, *texts: str) -> Model:
    """The nominal model that knows some causes."""
    causes = [parse_effect(text, rig) for text in texts]
    plant, drive = plant_with(nominal(rig), causes)
    return replace(plant, drive=drive)


@pytest.mark.parametrize("signal", LINEAR, ids=lambda signal: signal.name)
def test_matrices_do_what_the_steps_do(signal: Signal) -> None:
    A, B, C, D = signal.matrices(DT)
    state = np.zeros(len(A))
    memory = signal.start()
    for x in np.random.default_rng(0).standard_normal(60).tolist():
        told = C @ state + D * x
        state = A @ state + B * x
        memory, acts = signal.step(memory, x, DT)
        assert told == pytest.approx(acts, abs=1e-12)


@pytest.mark.parametrize(
    "signal, late", [(Delay("pan", 0.0034), 0.0034), (ActuatorLag("pan", 0.005), 0.005)]
)
def test_a_drive_is_as_late_as_it_says(signal: Signal, late: float) -> None:
    assert signal.late(DT) == pytest.approx(late, rel=1e-6)


@pytest.mark.parametrize("samples", [1, 4])
def test_a_delay_found_and_a_delay_stated_leave_the_same_margins(samples: int) -> None:
    gains = Pid.placed(6.0, 1.0, 0.2)
    found = compute_margins(gains, DT, DT, drive=(Delay("pan", samples * DT),))
    stated = compute_margins(gains, DT, (1 + samples) * DT)
    assert vars(found) == pytest.approx(vars(stated), rel=1e-6)


def test_a_found_lag_costs_bandwidth_at_its_joint_alone(rig: Rig) -> None:
    known = tune(with_causes(rig, "actuator-lag:tilt:time_constant=0.01"), bandwidth_hz=9.0)
    blind = tune(nominal(rig), bandwidth_hz=9.0)
    assert known.bandwidth_hz[0] == blind.bandwidth_hz[0] == 9.0
    assert known.bandwidth_hz[1] < blind.bandwidth_hz[1]
    assert known.margins[1].disk_margin >= 0.5
    assert any("actuator-lag" in str(reason) for reason in known.reasons)


def test_a_found_limit_is_the_controllers(rig: Rig) -> None:
    model = with_causes(rig, "saturation:tilt:limit=0.7")
    assert model.tau_max.tolist() == [rig.tau_max[0], 0.7]
    for kind in ("pid", "computed-torque"):
        assert tune(model, kind=kind).controller.outer.limits == tuple(model.tau_max.tolist())
    assert Saturation("tilt", 0.7).largest == 0.7


@pytest.mark.parametrize("torque", [-3.0, -0.02, 0.02, 0.5])
def test_a_dead_zone_gives_what_was_wanted(torque: float) -> None:
    zone = DeadZone("pan", 0.1)
    assert abs(torque) >= 0.05 * zone.width
    assert zone.step((), zone.command(torque), DT)[1] == pytest.approx(torque, abs=1e-12)
    assert zone.command(0.0) == 0.0


@pytest.mark.parametrize("torque", [-3.0, -0.02, 0.02, 0.5])
@pytest.mark.parametrize("sharpness", [1.5, 6.0, 60.0])
def test_a_sharp_dead_zone_gives_what_was_wanted(torque: float, sharpness: float) -> None:
    zone = DeadZone("pan", 0.1, sharpness)
    assert zone.step((), zone.command(torque), DT)[1] == pytest.approx(torque, abs=1e-9)
    assert zone.command(0.0) == 0.0


@pytest.mark.parametrize(
    "texts",
    [
        ("cogging:pan:amplitude=0.05,harmonic=12,phase=0.4", "cable-spring:tilt:stiffness=0.3"),
        ("load-dependent-friction:tilt:mu=0.2",),
        ("torque-gain:tilt:gain=0.8", "quadratic-drag:pan:drag=0.1"),
        ("base-tilt:roll=0.2", "encoder-offset:tilt:offset=0.1"),
    ],
)
def test_the_law_asks_for_the_models_own_torque(rig: Rig, texts: tuple[str, ...]) -> None:
    """On the reference, and sliding, the feed-forward is the extended model's inverse dynamics."""
    model = with_causes(rig, *texts)
    law = ComputedTorque(model, (Pid.placed(5.0, 1.0, 0.0),) * 2, DT)
    for seed in range(4):
        q, v, a = np.random.default_rng(seed).uniform(0.2, 1.0, (3, 2))
        wanted = model.inverse(q[None], v[None], a[None])[0]
        assert law.inverse(0.0, q, v, a.tolist(), v.tolist()) == pytest.approx(
            wanted.tolist(), rel=1e-9
        )


@pytest.fixture(scope="module")
def found(rig: Rig) -> Model:
    """A model with a cause of every kind, and with an uncertainty."""
    texts = (
        "cogging:pan:amplitude=0.05,harmonic=12",
        "delay:tilt:time=0.004",
        "dead-zone:pan:width=0.02",
    )
    model = with_causes(rig, *texts)
    changes = tuple(
        parse_effect(text, rig) for text in ("base-tilt:roll=0.2", "encoder-offset:tilt:offset=0.1")
    )
    turned = rig
    for change in changes:
        turned = change.apply(turned)
    known = Estimated(
        ("a", "b"),
        ("kg", "N m"),
        np.array([1.0, 2.0]),
        np.array([[4.0, 1.0], [1.0, 9.0]]),
        dt=0.002,
    )
    return replace(model, rig=turned, changes=changes, estimated=known)


def test_an_extended_model_comes_back_from_its_file(rig: Rig, found: Model, tmp_path: Path) -> None:
    write_extended(found, tmp_path / "extended.yaml")
    back = read_model(tmp_path / "extended.yaml", rig)
    assert (back.terms, back.drive, back.changes) == (found.terms, found.drive, found.changes)
    assert back.estimated is not None and found.estimated is not None
    assert (back.estimated.names, back.estimated.dt) == (found.estimated.names, found.estimated.dt)
    assert back.estimated.covariance.tolist() == found.estimated.covariance.tolist()
    q, v, a = np.random.default_rng(0).uniform(-1, 1, (3, 5, 2))
    assert back.inverse(q, v, a) == pytest.approx(found.inverse(q, v, a), rel=1e-12)


def test_a_controller_keeps_what_it_compensates(rig: Rig, found: Model, tmp_path: Path) -> None:
    tuning = tune(found, bandwidth_hz=4.0)
    law = tuning.controller
    back = stored(tuning.to_dict(), rig).law
    assert isinstance(law, ComputedTorque) and isinstance(back, ComputedTorque)
    assert back.leads == law.leads and back.leads[1] == pytest.approx(back.leads[0] + 0.004)
    q = np.array([0.3, 0.2])
    v = np.array([0.1, -0.4])
    y = [1.0, -2.0]
    assert back.inverse(0.0, q, v, y, v.tolist()) == pytest.approx(
        law.inverse(0.0, q, v, y, v.tolist())
    )


def test_a_file_whose_drive_holds_a_torque_effect_is_refused(
    rig: Rig, found: Model, tmp_path: Path
) -> None:
    data = {**found.to_dict(), "drive": [CableSpring("pan").to_dict()]}
    with pytest.raises(ModelError, match="belongs to the terms"):
        read_model_data(data, rig)
    kind = {"kind": "gimbal_pin model", "joints": list(rig.joints)}
    write_yaml(
        {**kind, **data, "drive": [{"effect": "delay", "joint": "nowhere", "time": 0.1}]},
        tmp_path / "x.yaml",
    )
    with pytest.raises(Exception, match="nowhere"):
        read_model(tmp_path / "x.yaml", rig)
