"""Laws of the given model: causes in the rig are found with each other, and the payload is what `identify` says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gimbal_pin.diagnosis import Diagnosis, diagnose
from gimbal_pin.dynamics import nominal, plant_with
from gimbal_pin.effects import CAUSES, RigEffect, get_payload, parse_effect
from gimbal_pin.identification import compare_payload, identify, refittable_effects
from gimbal_pin.log import Log
from gimbal_pin.rig import Rig
from tests.bench_logs import prescribed
from tests.diagnosis.cases import few
from tests.refitted import ALIGNED

BODIES = {name: kind for name, kind in CAUSES.items() if issubclass(kind, RigEffect)}
MOVED = "payload-shift:x=0.0042,y=0.002,z=-0.001"
MASS = 0.15 * get_payload(Rig.load("turret"))[1].mass


def load(name: str, inertia: str = "trusted") -> Rig:
    rig = Rig.load(name)
    return replace(rig, config=replace(rig.config, inertia=inertia))


def record(rig: Rig, *planted: str) -> Log:
    model = plant_with(nominal(rig), [parse_effect(one, rig) for one in planted]).plant
    return prescribed(model, 6, seconds=12.0, torque_noise=0.02, dt=0.004)


def examine(rig: Rig, *planted: str) -> Diagnosis:
    """The diagnosis over causes of the rig alone, which takes a tenth of the time."""
    return diagnose(rig, record(rig, *planted), BODIES, filtering=ALIGNED)


@pytest.mark.parametrize(
    ("name", "planted"),
    [
        ("turret", ()),
        ("turret", (MOVED,)),
        ("handheld", ("off-diagonal-inertia:tilt:Ixy=0.002,Ixz=0.001",)),
        ("turret", ("payload-mass:extra=0.12,x=0.05,y=0.03,z=0.04",)),
        ("turret", (MOVED, f"payload-mass:extra={MASS}")),
    ],
)
def test_what_is_planted_in_a_trusted_urdf_is_found(name: str, planted: tuple[str, ...]) -> None:
    """Named, with its figures within four deviations, and a model that predicts better with it."""
    found = examine(load(name), *planted)
    wanted = {text.partition(":")[0]: text.rpartition(":")[2] for text in planted}
    assert {one.cause for one in found.findings} == set(wanted)
    assert found.verdict == ("named" if wanted else "nothing") and not found.immaterial
    for one in found.findings:
        told = {p.name: p for p in one.parameters}
        for figure, value in (pair.split("=") for pair in wanted[one.cause].split(",")):
            if figure in told:
                assert told[figure].value == pytest.approx(float(value), abs=4 * told[figure].std)
        for error in ("torque_rmse", "rollout_rmse"):
            assert one.gain[f"{error}_after"] < 0.8 * one.gain[f"{error}_before"]


def test_the_diagnosis_says_of_the_payload_what_identify_says() -> None:
    """Place, mass and balance are those of `identify` with the found causes, and true; of a nominal URDF no finding."""
    rig = load("handheld", "nominal")
    log = record(rig, MOVED, "cogging:tilt:amplitude=0.03,harmonic=12")
    found = diagnose(rig, log, few("cogging", "stribeck"))
    assert [one.cause for one in found.findings] == ["cogging"]
    told = compare_payload(identify(rig, log, refittable_effects(found.after))).to_dict()
    assert {key: found.to_dict()[key] for key in ("given_model", "balance")} == told
    row = told["given_model"]["camera"]
    shown = [k for k, x in enumerate(row["com_mm"]) if x is not None]
    com, std = (np.array([row[key][k] for k in shown]) for key in ("com_mm", "com_std_mm"))
    assert shown and row["mass"] is None, "the link that carries it may weigh what it does not"
    np.testing.assert_array_less(np.abs(com - np.array([4.2, 2.0, -1.0])[shown]), 3 * std)
    weighed = diagnose(rig, log, {}, mass=1.0).given
    assert weighed.balance is not None and weighed.balance.mass == pytest.approx(1.0)
    assert weighed.apart is not None and weighed.apart.is_weighed
