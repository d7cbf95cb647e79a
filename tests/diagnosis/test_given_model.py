"""Laws of the given model against the refitted one, of the payload's statement, and of several logs."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from gimbal_pin.control import perturbed
from gimbal_pin.diagnosis import diagnose
from gimbal_pin.diagnosis.given_model import compute_base_difference
from gimbal_pin.dynamics import nominal, plant_with
from gimbal_pin.effects import parse_effect
from gimbal_pin.identification import given_beta
from gimbal_pin.identification.given_model import describe_friction, describe_inertia
from gimbal_pin.log import Array, Log
from gimbal_pin.rig import Rig, make_generator
from tests.bench_logs import prescribed
from tests.rigs import spelled

RIG = Rig.load("turret")
HANDHELD = Rig.load("handheld")
SHIFT = (0.0042, 0.002, -0.001)
MOVED = "payload-shift:x=0.0042,y=0.002,z=-0.001"
SIZE = re.compile(r"([\d.e-]+) ±")


def record(rig: Rig, planted: Sequence[str] = (), seed: int = 6, noise: float = 0.02) -> Log:
    """Return a log of 12 s of a nominal rig with causes planted."""
    model = plant_with(nominal(rig), [parse_effect(one, rig) for one in planted]).plant
    log = prescribed(model, seed, seconds=12.0, torque_noise=noise, dt=4e-3)
    return replace(log, name=f"{seed}.csv")


def trust(rig: Rig) -> Rig:
    """Return a rig whose URDF is trusted."""
    return replace(rig, config=replace(rig.config, inertia="trusted"))


# a URDF that is trusted


@pytest.mark.parametrize(
    ("cause", "joint", "sizes"),
    [
        ("payload-shift", None, dict(zip("xyz", SHIFT))),
        ("off-diagonal-inertia", "tilt", {"Ixy": 0.002, "Ixz": 0.001}),
    ],
)
def test_another_body_than_a_trusted_one_is_found_with_its_size(
    cause: str, joint: str | None, sizes: dict[str, float]
) -> None:
    """Within four deviations or a tenth."""
    place = cause if joint is None else f"{cause}:{joint}"
    planted = f"{place}:{','.join(f'{name}={size}' for name, size in sizes.items())}"
    found = diagnose(trust(HANDHELD), record(HANDHELD, [planted]))
    (one,) = found.findings
    assert (one.cause, found.verdict) == (cause, "named")
    told = {p.name: p for p in one.parameters}
    for name, size in sizes.items():
        assert told[name].value == pytest.approx(size, abs=max(4 * told[name].std, 0.1 * abs(size)))


def test_of_a_trusted_urdf_that_is_right_nothing_is_told() -> None:
    found = diagnose(trust(RIG), record(RIG))
    assert found.verdict == "nothing" and not found.findings and not found.notes


@pytest.mark.parametrize("trusted", [False, True])
def test_a_log_whose_time_runs_twice_as_fast_is_not_told_as_a_rig_that_is_right(
    trusted: bool,
) -> None:
    """All inertias are a quarter: a statement, whatever the bodies of a trusted URDF are changed by."""
    log = record(RIG)
    assert log.v is not None
    fast = replace(log, t=log.t / 2, v=2 * log.v)
    found = diagnose(trust(RIG) if trusted else RIG, fast)
    assert found.statements and found.verdict != "nothing"


# the payload of one that is not


@pytest.mark.parametrize(
    "cause",
    ["cogging:tilt:amplitude=0.03,harmonic=12", "torque-ripple:tilt:amplitude=0.3,harmonic=9"],
)
def test_the_payload_is_stated_beside_the_found_cause(cause: str) -> None:
    """Its place is true, also where `identify` lacks the cause, which then is the only finding."""
    found = diagnose(HANDHELD, record(HANDHELD, [MOVED, cause]), mass=1.0)
    assert [one.cause for one in found.findings] == [cause.partition(":")[0]]
    assert found.given.balance is not None and found.given.balance.mass == 1.0
    assert_place_is_true(found.to_dict()["given_model"]["camera"])


def assert_place_is_true(camera: dict[str, list[float | None]]) -> None:
    """Assert that what is shown of a payload's place is within three deviations of `SHIFT`."""
    shown = [k for k, x in enumerate(camera["com_mm"]) if x is not None]
    com, std = (np.array([camera[key][k] for k in shown]) for key in ("com_mm", "com_std_mm"))
    assert shown
    np.testing.assert_array_less(np.abs(com - 1e3 * np.array(SHIFT)[shown]), 3 * std)


def test_base_parameters_are_as_far_off_as_they_say() -> None:
    """Root mean square of 0.6 to 1.5 deviations over logs of perturbed rigs with a found cause."""
    off = list[Array]()
    for seed in range(10):
        true = perturbed(RIG, 0.1, make_generator(seed)[0])
        cogging = parse_effect("cogging:pan:amplitude=0.03,harmonic=12", RIG)
        plant = plant_with(true, [cogging]).plant
        found = diagnose(RIG, prescribed(plant, seed, 12.0, torque_noise=0.02, dt=4e-3))
        assert found.explanation is not None
        told = compute_base_difference(found.explanation, found.after)
        error = told.refitted - given_beta(true.rig, told.reduction)
        off.append(error / np.sqrt(np.diag(told.covariance)))
    assert 0.6 < np.sqrt(np.mean(np.square(off))) < 1.5


# friction and inertia


def test_friction_that_is_told_is_the_refitted_models_where_it_is_positive_and_known() -> None:
    """Of rigs without stated friction."""
    bare = replace(RIG, friction=np.zeros_like(RIG.friction))
    found = diagnose(bare, record(RIG, noise=0.01))
    known = found.before.estimated
    assert known is not None
    note = describe_friction(found.before, ())
    assert note in found.notes and note is not None
    np.testing.assert_allclose([float(x) for x in SIZE.findall(note)], known.theta[-4:], rtol=0.01)
    last = np.arange(len(known.theta)) == len(known.theta) - 4
    unsure = replace(known, covariance=known.covariance + np.diag(1.0 * last))
    pushing = replace(known, theta=known.theta - 1.0 * last)
    for one, count in ((unsure, 3), (pushing, 2)):
        note = describe_friction(replace(found.before, estimated=one), ())
        assert note is not None and len(SIZE.findall(note)) == count
    assert "tilt" not in (describe_friction(found.before, ("tilt",)) or "tilt")
    assert describe_friction(diagnose(RIG, record(RIG)).before, ()) is None


@pytest.mark.parametrize("change", np.linspace(-3.0, 3.0, 61).tolist())
@pytest.mark.parametrize("std", [1e-3, 0.1, 1.0])
def test_an_inertia_is_told_where_it_is_clear_material_and_of_a_body(
    change: float, std: float
) -> None:
    said = describe_inertia("pan", 1.0, change, std)
    if abs(change) < 0.05 or abs(change) < 2 * std:
        assert said is None
    if said is not None and SIZE.search(said):
        size = float(SIZE.findall(said)[0]) / 100
        assert size == pytest.approx(abs(change), rel=0.01)
        assert change > -1.0 and ("more" in said) == (change > 0)


PENDULUM = """<robot name="joint"><link name="base"/><link name="arm"><inertial><origin xyz="0 0 -0.3"/>
<mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="swing" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/></joint></robot>"""


def swing(shaken: float, inertia: float, noise: float = 0.0) -> Log:
    """Return a log of an arm whose joint shakes by so much from 4 to 12 Hz, rad; its controller damps that."""
    rng = np.random.default_rng(0)
    t = np.arange(0.0, 30.0, 4e-3)
    slow, fast = (2 * np.pi * rng.uniform(*band, 12) for band in ((0.1, 1.0), (4.0, 12.0)))

    def waves(w: Array, order: int) -> Array:
        angle = np.outer(t, w) + np.arange(12) + order * np.pi / 2
        return np.asarray(np.sin(angle) @ w**order)

    q, v, a = (0.2 * waves(slow, k) for k in range(3))
    tau = inertia * a + 9.80665 * 0.3 * np.sin(q) + 0.05 * v + 0.1 * np.tanh(v / 0.01)
    tau += 0.01 * rng.standard_normal(len(t)) - 0.5 * shaken * waves(fast, 1)
    read = q + shaken * waves(fast, 0) + noise * rng.standard_normal(len(t))
    return Log("swing", ("swing",), t, read[:, None], tau=tau[:, None])


@pytest.mark.parametrize(
    ("shaken", "noise", "inertia", "percent"),
    [
        (0.0, 0.0, 0.1, 0.0),
        (0.0, 0.0, 0.13, 30.0),
        (0.0, 0.0, 0.075, -25.0),
        (0.0, 3e-4, 0.13, 30.0),
        (0.02, 0.0, 0.13, 0.0),
        (0.0, 5e-3, 0.13, 0.0),
    ],
)
def test_a_quiet_motion_tells_the_inertia_and_a_shaken_one_does_not(
    shaken: float, noise: float, inertia: float, percent: float
) -> None:
    """The URDF's is 0.1 kg m² about the axis."""
    found = diagnose(spelled(PENDULUM), swing(shaken, inertia, noise))
    told = [note for note in found.notes if "inertia" in note]
    assert len(told) == (percent != 0)
    for note in told:
        assert float(SIZE.findall(note)[0]) == pytest.approx(abs(percent), rel=0.02)
        assert ("more" in note) == (percent > 0)


# several logs


@pytest.mark.parametrize("holdout", [None, "log:2"])
@pytest.mark.parametrize(
    "cameras", [("infrared", "infrared", "mirrorless"), ("infrared", "mirrorless")]
)
def test_logs_of_different_cameras_are_a_fault_of_the_data(
    cameras: tuple[str, ...], holdout: str | None
) -> None:
    """Whichever log is held out."""
    logs = [record(Rig.load("turret", name), seed=k) for k, name in enumerate(cameras)]
    found = diagnose(RIG, logs, holdout=holdout)
    assert found.verdict == "data" and not found.findings
    assert [fault.cause for fault in found.spoiling] == ["logs-disagree"]


def test_logs_at_different_temperatures_are_of_one_rig() -> None:
    """Of a motor with twice the friction."""
    warm = replace(RIG, friction=0.5 * RIG.friction)
    found = diagnose(RIG, [record(RIG, seed=0), record(warm, seed=1)])
    assert found.verdict != "data" and not found.faults


@pytest.mark.parametrize("last", [0.2, -0.2])
def test_a_cause_is_the_same_in_every_log_of_one_rig(last: float) -> None:
    """A constant torque explains the logs of one rig together, and not those of a rig that was touched in between."""
    logs = [
        record(RIG, [f"torque-bias:tilt:bias={x}"], seed=k) for k, x in enumerate((0.2, 0.2, last))
    ]
    found = diagnose(RIG, logs)
    faults = [fault.cause for fault in found.spoiling]
    assert faults == ([] if last > 0 else ["logs-disagree"])
    named = [one.alike for one in found.findings]
    assert len(named) == (last > 0) and all("torque-bias" in names for names in named)


def test_a_log_too_short_for_a_fit_of_its_own_is_not_judged() -> None:
    """One second of another camera is no rig of its own."""
    other = record(Rig.load("turret", "mirrorless"), seed=1)
    found = diagnose(RIG, [record(RIG, seed=0), other.part(slice(0, 300))])
    assert all(fault.cause != "logs-disagree" for fault in found.faults)
