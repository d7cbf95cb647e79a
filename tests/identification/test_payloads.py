"""Laws of payloads.

A planted shift is found to its deviation, and the way that balances it; several cameras share one gimbal; a new camera
on a known gimbal needs ten seconds; nothing is surer than what it is measured against.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache, partial
from pathlib import Path

import numpy as np
import pytest

from gimbal_pin.dynamics import compute_rnea, nominal, plant_with, reduce_parameters
from gimbal_pin.dynamics.checking import spread_poses
from gimbal_pin.effects import Cogging, PayloadMass, PayloadShift, get_payload, parse_effect
from gimbal_pin.errors import ModelError, UsageError
from gimbal_pin.identification import (
    Balance,
    BaseDifference,
    IdentificationResult,
    PayloadDiscrepancy,
    Several,
    compare_payload,
    explain_by_payload,
    given_beta,
    identify,
    identify_new,
    identify_several,
    read_model,
    write_model,
)
from gimbal_pin.identification.payloads import CarrierEstimate, get_stated_payload
from gimbal_pin.log import Array, Log, write_log
from gimbal_pin.regression import TRUST, compute_deformation_root
from gimbal_pin.rig import Rig, find_payload
from gimbal_pin.rig import bundled as data_folder
from tests.bench_logs import EXACT, prescribed
from tests.command_line import Run, refused, result
from tests.identification.logs import hold, record
from tests.rigs import bundled

SHIFT = (0.0042, 0.002, -0.001)
"""Of the payload, m."""
HEAVIER = 0.1
"""Additional mass, kg."""
MOVED = (0.012, -0.006, 0.009)


def trust(name: str) -> Rig:
    """Return a rig whose YAML says that its bodies are as the URDF says."""
    rig = bundled(name)
    return replace(rig, config=replace(rig.config, inertia="trusted"))


def shift(rig: Rig, way: Array | Sequence[float] = SHIFT) -> Rig:
    """Return the rig with its payload moved, m."""
    return PayloadShift(*np.asarray(way).tolist()).apply(rig)


@cache
def find_alone(rig: Rig, true: Rig, seed: int = 1) -> IdentificationResult:
    """Identify a gimbal from all of a log of the true one."""
    return identify(rig, [record(true, seed)], filtering=EXACT, holdout="none")


def compare(rig: Rig, true: Rig, seed: int = 1, mass: float | None = None) -> PayloadDiscrepancy:
    """Return what a log of the true rig shows of the payload of a given one."""
    found = compare_payload(find_alone(rig, true, seed), mass).apart
    assert found is not None
    return found


def score_shift(found: PayloadDiscrepancy, way: Array | Sequence[float] = SHIFT) -> Array:
    """Return the errors of the place in deviations, along the axes that show."""
    shown = list(found.shift.axes)
    return np.asarray((found.shift.change - way)[shown] / found.shift.std[shown])


@pytest.mark.parametrize(
    ("name", "way"), [("thesis", SHIFT), ("handheld", (0.0, 0.0, 0.0)), ("turret", SHIFT)]
)
def test_planted_shift_is_recovered_within_its_deviation(name: str, way: Sequence[float]) -> None:
    """Neither mass nor products of inertia are found that were not planted."""
    rig = trust(name)
    z = []
    for seed in range(3):
        found = compare(rig, shift(rig, way), seed)
        assert list(found.shift.axes) == [True, name != "turret", True]
        assert found.is_sufficient
        z += score_shift(found, way).tolist()
        for none in (found.mass, found.products):
            z += (none.value / np.sqrt(np.diag(none.covariance))).tolist()
    assert np.abs(z).max() < 4.0
    assert 0.5 < np.sqrt(np.mean(np.square(z))) < 1.6


@pytest.mark.parametrize(("name", "shows"), [("handheld", True), ("thesis", False), ("ptu", False)])
def test_mass_shows_where_an_arm_carries_it(name: str, shows: bool) -> None:
    """Elsewhere the place is a function of the mass, which a weighed one leaves alone open."""
    rig = trust(name)
    true = PayloadMass(HEAVIER).apply(shift(rig))
    found = compare(rig, true)
    row = found.to_dict()["camera"]
    assert (row["mass"] is not None) == shows
    if shows:
        assert row["mass"] == pytest.approx(1e3 * HEAVIER, abs=4 * row["mass_std"])
        assert np.abs(score_shift(found)).max() < 4
    else:
        share = found.stated / (found.stated + HEAVIER)
        assert np.abs(score_shift(found, SHIFT - found.per_mass * HEAVIER * share)).max() < 4
    mass = float(get_payload(true)[1].mass)
    weighed = compare(rig, true, mass=mass)
    assert weighed.mass.change == pytest.approx(HEAVIER)
    assert np.abs(score_shift(weighed)).max() < 3
    with pytest.raises(UsageError, match="give it in kilograms"):
        compare(rig, true, mass=1000.0 * mass)


def test_place_is_calibrated_for_bodies_as_far_off_as_the_trust() -> None:
    """Each is stretched and sheared by `TRUST`, the payload is not; base parameters are known almost exactly."""
    rig = bundled("handheld")
    reduction = reduce_parameters(rig)
    noise = 1e-10 * np.eye(len(reduction.independent))
    exact = BaseDifference(rig, reduction, np.zeros(len(noise)), noise, noise)
    body, inertia, _ = get_payload(rig)
    bare = rig.phi.copy()
    bare[10 * body : 10 * body + 10] -= inertia.toDynamicParameters()
    bodies = TRUST * exact.responses @ compute_deformation_root(bare)
    rng = np.random.default_rng(2)
    z = []
    for _ in range(100):
        change = bodies @ rng.standard_normal(bodies.shape[1])
        found = explain_by_payload(replace(exact, change=change))
        assert found is not None
        z += score_shift(found, (0.0, 0.0, 0.0)).tolist()
    assert np.sqrt(np.mean(np.square(z))) == pytest.approx(1.0, abs=0.2)


def balance(found: IdentificationResult) -> Balance:
    """Return how to balance the payload."""
    out = compare_payload(found).balance
    assert out is not None
    return out


@pytest.mark.parametrize("name", ["thesis", "turret"])
def test_camera_that_was_moved_is_to_be_moved_back(name: str) -> None:
    """No other way loads the motors less on the fitted model: by gravity over their torque, over all poses."""
    rig = bundled(name)
    before, after = (balance(find_alone(rig, one)) for one in (rig, shift(rig, MOVED)))
    shown = np.abs(before.way) > 0
    assert shown.tolist() == [True, name != "turret", True]
    error = (after.way - before.way + MOVED)[shown]
    assert np.all(np.abs(error) < 4 * np.hypot(before.std, after.std)[shown] + 1e-6)
    fitted = find_alone(rig, shift(rig, MOVED)).model.rig
    q = spread_poses(rig, 200)

    def load(way: Array) -> float:
        torque = compute_rnea(shift(fitted, way), q, np.zeros_like(q), np.zeros_like(q))
        return float(np.mean((torque / rig.tau_max) ** 2))

    best = load(after.way)
    assert best < load(np.zeros(3))
    for other in np.random.default_rng(0).normal(0.0, [[0.001]] * 9 + [[0.05]] * 9, (18, 3)):
        assert load(after.way + other) >= best * (1 - 1e-9) - 1e-15


def test_rig_without_payload_has_no_statement() -> None:
    rig = bundled("turret", "none")
    found = compare_payload(find_alone(rig, rig))
    assert found.apart is None
    assert found.balance is None


# --- Several cameras ---------------------------------------------------------------------------------


@cache
def find_several(name: str, payloads: Sequence[str]) -> Several:
    """Identify a gimbal from a log with each camera."""
    rigs = {payload: bundled(name, payload) for payload in payloads}
    logs = {payload: [record(rig, k)] for k, (payload, rig) in enumerate(rigs.items())}
    return identify_several(rigs, logs, filtering=EXACT)


def find_new(
    rig: Rig, known: IdentificationResult, seed: int = 9, given: Rig | None = None
) -> Several:
    """Identify a camera from ten seconds on a known gimbal, from what is given of it."""
    return identify_new(given or rig, [record(rig, seed, 10.0)], known.model, filtering=EXACT)


def find_first(name: str) -> IdentificationResult:
    """Identify a gimbal with one camera."""
    rig = bundled(name, "mirrorless")
    return find_alone(rig, rig, 0)


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
    known = find_first(name)
    moved = shift(bundled(name, "zoom-lens"), MOVED)
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


@pytest.mark.parametrize(("name", "extra"), [("turret", 0.0), ("handheld", 0.05)])
def test_camera_is_placed_relative_to_the_known_one(name: str, extra: float) -> None:
    """The URDF of the first is given for the second, too, and wrong for both."""
    rig = bundled(name, "mirrorless")
    weighed = get_stated_payload(rig)[0] + extra
    z = []
    for seed in range(3):
        away, way = np.random.default_rng(seed).uniform(-0.01, 0.01, (2, 3))
        known = find_alone(rig, shift(rig, away), seed)
        moved = PayloadMass(extra).apply(shift(rig, away + way))
        found = find_new(moved, known, seed + 9, given=rig)
        (stated,) = replace(found, mass=weighed).payloads.values()
        assert stated.beside is not None
        assert stated.beside.masses == pytest.approx((weighed, weighed - extra))
        z += score_shift(stated.beside, way).tolist()
        assert extra or stated.beside.shift.std[list(stated.beside.shift.axes)].max() < 1e-4
    assert np.abs(z).max() < 4
    assert np.sqrt(np.mean(np.square(z))) < 1.7


def load_meeting(folder: Path, payload: str) -> Rig:
    """Return the handheld gimbal with axes that meet to 0.1 mm, which hides the mass of a camera."""
    text = (data_folder() / "handheld.urdf").read_text()
    text = text.replace("-0.215 0.015 0.245", "-0.215 0 0.245")
    path = folder / "meeting.urdf"
    path.write_text(text.replace("0.245 0.105 -0.012", "0.215 0.105 0.0001"))
    return Rig.load(path, payload)


@pytest.mark.parametrize(("name", "still"), [("meeting", None), ("turret", 0), ("turret", 1)])
def test_what_of_a_camera_does_not_show_leaves_its_place_at_each_mass(
    name: str, still: int | None, tmp_path: Path
) -> None:
    """On a known gimbal, and by both cameras at once; a joint that stands still hides only what it hides."""
    load = partial(load_meeting, tmp_path) if name == "meeting" else partial(bundled, name)
    first, given = (load(payload) for payload in ("mirrorless", "zoom-lens"))
    true = PayloadMass(HEAVIER).apply(shift(given))
    log = record(true, 9, 10.0)
    if still is not None:
        log = hold(true, log, still, noisy=False)
    rigs = {"mirrorless": first, "zoom-lens": given}
    logs = {"mirrorless": [record(first, 0)], "zoom-lens": [log]}
    known = find_alone(first, first, 0).model
    mass = float(get_payload(true)[1].mass)
    for found in (
        identify_new(given, [log], known, filtering=EXACT),
        identify_several(rigs, logs, filtering=EXACT),
    ):
        weighed, plain = (
            replace(found, mass=one).payloads["zoom-lens"].apart for one in (mass, None)
        )
        assert weighed is not None and plain is not None
        assert weighed.shift.axes[0]
        assert np.abs(score_shift(weighed)).max() < 3
        noted = any("does not show" in note for note in found.identified["zoom-lens"].notes)
        assert noted == (still is not None)
        if still is None:
            assert not plain.found_mass
            way = SHIFT - plain.per_mass * HEAVIER * plain.stated / mass
            assert np.abs(score_shift(plain, way)).max() < 3
            assert plain.shift.std.max() < 0.5e-3


@pytest.mark.parametrize("off", ["nothing", "friction", "parameters"])
def test_known_gimbal_is_no_truth_where_the_log_contradicts_it(off: str) -> None:
    """Friction that has grown, or a model off by a hundred of its deviations."""
    known = find_first("turret")
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
    found = find_new(second, find_alone(first, shift(first)), 2)
    assert np.abs(score(found, "zoom-lens", second)).max() < 4
    assert any("with mirrorless is not as the URDFs say" in said for said in found.warnings)
    right = find_new(second, find_first("turret"), 2)
    assert not any("URDFs say" in said for said in right.warnings)
    bare = find_several("turret", ("cinema", "none")).first
    assert find_new(second, bare).payloads["zoom-lens"].beside is None


def add_teeth(rig: Rig, harmonic: int, seed: int, seconds: float) -> Log:
    """Return a log of a rig with teeth at tilt."""
    effect = parse_effect(f"cogging:tilt:amplitude=0.1,harmonic={harmonic}", rig)
    plant = plant_with(nominal(rig), [effect]).plant
    return prescribed(plant, seed, seconds, torque_noise=0.01, dt=4e-3)


def test_causes_of_a_known_gimbal_are_kept_with_a_new_camera() -> None:
    first, rig = (bundled("turret", payload) for payload in ("mirrorless", "cinema"))
    teeth = [Cogging("tilt", (7.0,))]
    known = identify(first, [add_teeth(first, 7, 0, 12.0)], teeth, filtering=EXACT).model
    found = identify_new(rig, [add_teeth(rig, 7, 1, 10.0)], known, filtering=EXACT)
    assert min(found.first.train.fit_percent.values()) > 97
    assert np.abs(score(found, "cinema", rig)).max() < 4
    assert teeth[0] in [term.effect for term in found.first.model.terms]


def test_model_of_several_payloads_is_read_for_the_mounted_one(tmp_path: Path) -> None:
    """Others, and models of another rig or without uncertainty, are refused."""
    found = find_several("turret", ("cinema", "none"))
    path = tmp_path / "model.yaml"
    write_model(found.first, path, found.identified)
    for payload, one in found.identified.items():
        read = read_model(path, bundled("turret", payload))
        np.testing.assert_allclose(read.rig.phi, one.model.rig.phi)
    rig = bundled("turret", "zoom-lens")
    with pytest.raises(ModelError, match="is of the payload"):
        read_model(path, rig)
    other = find_first("handheld").model
    for known, words in ((nominal(rig), "no uncertainty"), (other, "other parameters")):
        with pytest.raises(UsageError, match=words):
            identify_new(rig, [record(rig, 0)], known)
    with pytest.raises(UsageError, match="several payloads"):
        identify_several({"cinema": rig}, {"cinema": [record(rig, 0)]}, holdout="log:2")


def test_command_line_takes_tagged_logs_and_a_known_gimbal(run: Run, tmp_path: Path) -> None:
    """A camera that no YAML names comes from a file."""
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
