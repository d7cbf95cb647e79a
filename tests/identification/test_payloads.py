"""Several cameras on one gimbal, and a new camera on a known gimbal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from gimbal_pin.dynamics import nominal, plant_with, reduce_parameters
from gimbal_pin.effects import Cogging, PayloadMass, PayloadShift, parse_effect
from gimbal_pin.errors import ModelError, UsageError
from gimbal_pin.identification import (
    Identified,
    Several,
    given_beta,
    identify,
    identify_new,
    identify_several,
    read_model,
    write_model,
)
from gimbal_pin.identification.payloads import CarrierEstimate, get_stated_payload
from gimbal_pin.log import Array, Log, write_log
from gimbal_pin.rig import Rig, find_payload
from gimbal_pin.rig import bundled as data_folder
from tests.bench_logs import EXACT, prescribed
from tests.command_line import Run, refused, result
from tests.identification.logs import hold, record
from tests.rigs import bundled


@cache
def find_several(name: str, payloads: Sequence[str]) -> Several:
    """Identify a gimbal from a log with each camera."""
    rigs = {payload: bundled(name, payload) for payload in payloads}
    logs = {payload: [record(rig, k)] for k, (payload, rig) in enumerate(rigs.items())}
    return identify_several(rigs, logs, filtering=EXACT)


def find_new(rig: Rig, known: Identified, seed: int = 9, given: Rig | None = None) -> Several:
    """Identify a camera from ten seconds on a known gimbal, from what is given of it."""
    return identify_new(given or rig, [record(rig, seed, 10.0)], known.model, filtering=EXACT)


@cache
def find_first(name: str, payload: str) -> Identified:
    """Identify a gimbal with one camera from all of a log."""
    rig = bundled(name, payload)
    return identify(rig, [record(rig, 0)], filtering=EXACT, holdout="none")


def score(found: Several, payload: str, true: Rig) -> Array:
    """Return the errors of a camera's parameters in deviations."""
    camera = found.cameras[payload]
    own = CarrierEstimate.of(true, found.first.reduction)
    return np.asarray((camera.value - own.shown(get_stated_payload(true))) / camera.std)


def score_gimbal(found: Several, true: Rig) -> Array:
    """Return the errors of the base parameters and friction with the first camera."""
    planted = np.append(given_beta(true, found.first.reduction), true.friction)
    return np.asarray((found.first.estimate.theta - planted) / found.first.estimate.std)


@pytest.mark.parametrize(
    ("name", "payloads"),
    [("handheld", ("mirrorless", "cinema", "infrared")), ("turret", ("cinema", "none"))],
)
def test_every_camera_has_its_own_parameters_and_the_gimbal_is_one(
    name: str, payloads: tuple[str, ...]
) -> None:
    """Base parameters differ within the reach of the camera's body, friction not at all."""
    found = find_several(name, payloads)
    assert found.reference == ("none" if "none" in payloads else payloads[0])
    others = [payload for payload in payloads if payload != found.reference]
    z = np.concatenate([score(found, payload, bundled(name, payload)) for payload in others])
    assert np.abs(z).max() < 4
    assert np.sqrt(np.mean(z**2)) < 1.7
    reach = CarrierEstimate.of(found.first.model.rig, found.first.reduction).columns
    width = len(reach)
    for one in found.identified.values():
        change = one.estimate.theta - found.first.estimate.theta
        fitted = reach @ np.linalg.lstsq(reach, change[:width], rcond=None)[0]
        np.testing.assert_allclose(change[:width], fitted, atol=1e-9)
        np.testing.assert_array_equal(change[width:], 0)
        assert one.held_out is not None
        assert min(one.held_out.fit_percent.values()) > 97


@pytest.mark.parametrize("name", ["handheld", "turret"])
def test_new_camera_needs_ten_seconds(name: str) -> None:
    """Its moment within 2 %, its inertia within 5 %; the known camera is found as it was."""
    known = find_several(name, ("mirrorless", "cinema")).first
    moved = PayloadShift(0.01, -0.005, 0.012).apply(bundled(name, "zoom-lens"))
    found = find_new(moved, known, given=bundled(name, "zoom-lens"))
    z = score(found, "zoom-lens", moved)
    assert np.sqrt(np.mean(z**2)) < 2
    camera = found.cameras["zoom-lens"]
    error = np.abs(z * camera.std)
    for unit, share in (("kg m", 0.02), ("kg m^2", 0.05)):
        these = np.array(camera.units) == unit
        assert error[these].max() < share * np.abs(camera.value[these]).max()
    same = bundled(name, "mirrorless")
    assert np.abs(score(find_new(same, known), "mirrorless", same)).max() < 4


@pytest.mark.parametrize(("name", "extra"), [("turret", 0.0), ("turret", 0.05), ("handheld", 0.05)])
def test_camera_is_placed_relative_to_the_known_one(name: str, extra: float) -> None:
    """The URDF of the first is given for the second, too, and wrong for both."""
    rig = bundled(name, "mirrorless")
    weighed = get_stated_payload(rig)[0] + extra
    z = []
    for seed in range(3):
        away, way = np.random.default_rng(seed).uniform(-0.01, 0.01, (2, 3))
        first, second = (PayloadShift(*x.tolist()).apply(rig) for x in (away, away + way))
        known = identify(rig, [record(first, seed)], filtering=EXACT, holdout="none")
        moved = PayloadMass(extra).apply(second) if extra else second
        found = find_new(moved, known, seed + 9, given=rig)
        (stated,) = replace(found, mass=weighed).payloads.values()
        assert stated.beside is not None
        assert stated.beside.masses == pytest.approx((weighed, weighed - extra))
        shown = np.array(stated.beside.shift.axes)
        z += ((stated.beside.shift.change - way)[shown] / stated.beside.shift.std[shown]).tolist()
        assert extra or stated.beside.shift.std[shown].max() < 1e-4
    assert np.abs(z).max() < 4
    assert np.sqrt(np.mean(np.square(z))) < 1.7


def load_meeting(folder: Path, payload: str) -> Rig:
    """Return the handheld gimbal with axes that meet to 0.1 mm, which hides the mass of a camera."""
    text = (data_folder() / "handheld.urdf").read_text()
    text = text.replace("-0.215 0.015 0.245", "-0.215 0 0.245")
    text = text.replace("0.245 0.105 -0.012", "0.215 0.105 0.0001")
    path = folder / "meeting.urdf"
    path.write_text(text)
    return Rig.load(path, payload)


@pytest.mark.parametrize("is_known", [True, False])
def test_camera_whose_mass_does_not_show_has_a_place_for_each_mass(
    is_known: bool, tmp_path: Path
) -> None:
    """On a known gimbal, and by both cameras at once."""
    first, second = (load_meeting(tmp_path, payload) for payload in ("mirrorless", "cinema"))
    way = (0.002, -0.0015, 0.001)
    true = PayloadMass(0.1).apply(PayloadShift(*way).apply(second))
    before = record(first, 2)
    log = record(true, 11, 10.0)
    if is_known:
        known = identify(first, [before], filtering=EXACT, holdout="none")
        found = identify_new(second, [log], known.model, filtering=EXACT)
    else:
        rigs = {"mirrorless": first, "cinema": second}
        logs = {"mirrorless": [before], "cinema": [log]}
        found = identify_several(rigs, logs, filtering=EXACT)
    stated = get_stated_payload(second)[0]
    for mass in (None, stated + 0.1):
        apart = replace(found, mass=mass).payloads["cinema"].apart
        assert apart is not None
        assert all(apart.shift.axes)
        change = apart.shift.change
        if mass is None:
            assert not apart.found_mass
            change = change + apart.per_mass * 0.1 * stated / (stated + 0.1)
        assert np.all(np.abs(change - way) < 3 * apart.shift.std)
        assert apart.shift.std.max() < 0.5e-3


@pytest.mark.parametrize(("name", "still"), [("turret", 0), ("turret", 1), ("drone", 0)])
def test_joint_that_stands_still_hides_only_what_it_hides(name: str, still: int) -> None:
    """At the weighed mass the place is true; on a known gimbal, and with both cameras at once."""
    first, given = (bundled(name, payload) for payload in ("mirrorless", "zoom-lens"))
    way = np.array([0.004, -0.003, 0.002])
    true = PayloadMass(0.05).apply(PayloadShift(*way.tolist()).apply(given))
    log = hold(true, record(true, 9, 10.0), still, noisy=False)
    rigs = {"mirrorless": first, "zoom-lens": given}
    logs = {"mirrorless": [record(first, 0)], "zoom-lens": [log]}
    known = find_first(name, "mirrorless").model
    for found in (
        identify_new(given, [log], known, filtering=EXACT),
        identify_several(rigs, logs, filtering=EXACT),
    ):
        mass = get_stated_payload(true)[0]
        apart = replace(found, mass=mass).payloads["zoom-lens"].apart
        assert apart is not None
        shown = list(apart.shift.axes)
        assert shown[0]
        error = (apart.shift.change - way)[shown] / apart.shift.std[shown]
        assert np.abs(error).max() < 3
        assert any("does not show" in note for note in found.identified["zoom-lens"].notes)


@pytest.mark.parametrize("off", ["nothing", "friction", "parameters"])
def test_known_gimbal_is_no_truth_where_the_log_contradicts_it(off: str) -> None:
    """Friction that has grown, or a model off by a hundred of its deviations."""
    known = find_first("turret", "mirrorless")
    rig = bundled("turret", "zoom-lens")
    now = replace(rig, friction=(1.3 if off == "friction" else 1.0) * rig.friction)
    before = known.model.estimated
    assert before is not None
    if off == "parameters":
        away = 100 * before.std * np.random.default_rng(0).standard_normal(len(before.std))
        wrong = replace(before, theta=before.theta + away)
        known = replace(known, model=replace(known.model, estimated=wrong))
    found = find_new(now, known, 1, given=rig)
    z = np.append(score_gimbal(found, now), score(found, "zoom-lens", now))
    assert np.abs(z).max() < 4
    assert np.sqrt(np.mean(z**2)) < 1.4
    warned = any("not as --known has it" in said for said in found.warnings[:1])
    assert warned == (off != "nothing")


def test_camera_is_no_surer_than_the_one_it_is_measured_against() -> None:
    """The first camera is millimetres off its URDF."""
    first, second = (bundled("turret", payload) for payload in ("mirrorless", "zoom-lens"))
    wrong = record(PayloadShift(0.004, -0.003, 0.002).apply(first), 1)
    found = find_new(second, identify(first, [wrong], filtering=EXACT), 2)
    assert np.abs(score(found, "zoom-lens", second)).max() < 4
    assert any("with mirrorless is not as the URDFs say" in said for said in found.warnings)
    right = find_new(second, find_first("turret", "mirrorless"), 2)
    assert not any("URDFs say" in said for said in right.warnings)
    bare = find_several("turret", ("cinema", "none")).first
    assert find_new(second, bare).payloads["zoom-lens"].beside is None


def add_teeth(rig: Rig, harmonic: int, seed: int, seconds: float) -> Log:
    """Return a log of a rig with teeth at tilt."""
    effect = parse_effect(f"cogging:tilt:amplitude=0.1,harmonic={harmonic}", rig)
    plant = plant_with(nominal(rig), [effect]).plant
    return prescribed(plant, seed, seconds, torque_noise=0.01, dt=4e-3)


def test_deviations_of_several_cameras_hold_what_the_model_lacks() -> None:
    rigs = {payload: bundled("turret", payload) for payload in ("mirrorless", "cinema")}
    logs = {
        payload: [add_teeth(rig, 5, 10 + k, 40.0)] for k, (payload, rig) in enumerate(rigs.items())
    }
    found = identify_several(rigs, logs, filtering=EXACT)
    z = np.append(score_gimbal(found, rigs["mirrorless"]), score(found, "cinema", rigs["cinema"]))
    assert np.abs(z).max() < 4
    assert 0.4 < np.sqrt(np.mean(z**2)) < 1.3
    assert "tilt is not explained" in found.warnings[0]


def test_causes_of_a_known_gimbal_are_kept_with_a_new_camera() -> None:
    first = bundled("turret", "mirrorless")
    teeth = [Cogging("tilt", (7.0,))]
    known = identify(first, [add_teeth(first, 7, 0, 12.0)], teeth, filtering=EXACT).model
    rig = bundled("turret", "cinema")
    found = identify_new(rig, [add_teeth(rig, 7, 1, 10.0)], known, filtering=EXACT)
    assert min(found.first.train.fit_percent.values()) > 97
    assert np.abs(score(found, "cinema", rig)).max() < 4
    assert teeth[0] in [term.effect for term in found.first.model.terms]


def test_model_of_several_payloads_is_read_for_the_mounted_one(tmp_path: Path) -> None:
    found = find_several("turret", ("mirrorless", "cinema"))
    path = tmp_path / "model.yaml"
    write_model(found.first, path, found.identified)
    for payload, one in found.identified.items():
        read = read_model(path, bundled("turret", payload))
        np.testing.assert_allclose(read.rig.phi, one.model.rig.phi)
    with pytest.raises(ModelError, match="is of the payload mirrorless"):
        read_model(path, bundled("turret", "zoom-lens"))


def test_known_model_without_uncertainty_or_of_another_rig_is_refused() -> None:
    rig = bundled("turret", "cinema")
    log = record(rig, 0)
    other = find_several("handheld", ("mirrorless", "cinema", "infrared")).first.model
    for known, words in ((nominal(rig), "no uncertainty"), (other, "other parameters")):
        with pytest.raises(UsageError, match=words):
            identify_new(rig, [log], known)
    with pytest.raises(UsageError, match="several payloads"):
        identify_several({"cinema": rig}, {"cinema": [log]}, holdout="log:2")


def test_command_line_takes_tagged_logs_and_a_known_gimbal(run: Run, tmp_path: Path) -> None:
    """A camera that no YAML names comes from a file, which the model of it needs."""
    first = tmp_path / "first.urdf"
    first.write_text(Path(find_payload("mirrorless")).read_text())
    tags = [str(first), "cinema", "zoom-lens"]
    for k, tag in enumerate(tags):
        write_log(record(Rig.load("turret", tag), k, 12.0), tmp_path / f"{k}.csv")
    tagged = [f"{tmp_path}/{k}.csv@{tag}" for k, tag in enumerate(tags)]
    model = tmp_path / "model.yaml"
    urdf = tmp_path / "new.urdf"
    call = ("identify", "turret", "--alignment", "0")
    assert set(result(run, *call, *tagged[:2], "-o", model)["payloads"]) == set(tags[:2])
    assert run(*call, tagged[2], "--known", model, "--urdf", urdf)[0] == 0
    true = bundled("turret", "zoom-lens")
    reduction = reduce_parameters(true)
    written = given_beta(Rig.load(urdf), reduction)
    np.testing.assert_allclose(written, given_beta(true, reduction), rtol=0.05, atol=5e-4)
    refused(run(*call, tagged[0], tmp_path / "1.csv"), 2, "tag each of them")
    first.unlink()
    refused(run(*call, tagged[2], "--known", model), 2, "payload first")
