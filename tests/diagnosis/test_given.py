"""Laws of the given model against the refitted one: a planted shift is recovered, nothing planted is nothing found."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from lxml import etree

from gimbal_pin.control import perturbed
from gimbal_pin.diagnosis import BAND, Bodies, Diagnosis, Difference, Given, Problem, compared, diagnose, gather, solved
from gimbal_pin.diagnosis.given import given
from gimbal_pin.dynamics import Model, compute_rnea, nominal, plant_with, reduce_parameters
from gimbal_pin.effects import CAUSES, OffDiagonalInertia, RigEffect, get_payload, parse_effect
from gimbal_pin.identification import identify
from gimbal_pin.log import Log
from gimbal_pin.rig import Rig, build_rig, to_urdf
from tests.bench_logs import prescribed

ALIGNED = replace(BAND, alignment=0.0)
RIGS = ("thesis", "handheld", "turret")
SHIFT, MOVED = np.array([4.2, 2.0, -1.0]), "payload-shift:x=0.0042,y=0.002,z=-0.001"


def plant(rig: Rig, *planted: str) -> Model:
    return plant_with(nominal(rig), [parse_effect(text, rig) for text in planted]).plant


def moved(rig: Rig, share: float) -> Rig:
    """The rig with a payload of a share of the mass, all of it elsewhere."""
    body, inertia, frame = get_payload(rig)
    phi = rig.phi.copy()
    there = pin.SE3(np.eye(3), 1e-3 * frame.rotation @ SHIFT).act(inertia)
    phi[10 * body : 10 * body + 10] += share * there.toDynamicParameters() - inertia.toDynamicParameters()
    return rig.with_phi(phi)


def recorded(model: Model, seed: int) -> Log:
    return prescribed(model, seed, seconds=16.0, torque_noise=0.02, dt=0.003)


def difference(rig: Rig, log: Log) -> Difference:
    problem = Problem.of(gather(rig, [log], ALIGNED, {log.name: 0.0}), reduce_parameters(rig))
    return Difference.of_state(solved(problem, (), solved(problem, ())))


def said(rig: Rig, log: Log) -> Given:
    found = given(difference(rig, log))
    assert found is not None
    return found


@pytest.mark.parametrize("name", RIGS)
def test_a_planted_shift_is_recovered_within_its_deviation(name: str) -> None:
    """In every direction that shows: within 3 standard deviations on average over seeds and directions (χ²)."""
    rig, z = Rig.load(name), []
    model = plant(rig, MOVED)
    for seed in range(2):
        row = said(rig, recorded(model, seed)).to_dict()["camera"]
        shown = [k for k in range(3) if row["com_mm"][k] is not None]
        assert len(shown) == rig.n if name != "turret" else shown == [0, 2]
        z += [(row["com_mm"][k] - SHIFT[k]) / row["com_std_mm"][k] for k in shown]
    assert np.max(np.abs(z)) < 4.0 and np.sqrt(np.mean(np.square(z))) < 1.8


@pytest.mark.parametrize("name", RIGS)
def test_nothing_planted_is_nothing_found(name: str) -> None:
    """Deviations are what they say, and no sentence sends anybody to slide a camera."""
    rig, z = Rig.load(name), []
    for seed in range(3):
        found = said(rig, recorded(nominal(rig), seed))
        assert found.alone and "sits where its URDF says" in found.sentence and not found.skew()
        for seen in (found.shift, found.mass, found.products):
            z += (seen.value / np.sqrt(np.diag(seen.covariance))).tolist()
    assert 0.5 < np.sqrt(np.mean(np.square(z))) < 1.6


def test_mass_shows_where_an_arm_carries_it_and_is_stated_elsewhere() -> None:
    row = {
        name: said(rig, recorded(plant(rig, "payload-mass:extra=0.1"), 1)).to_dict()["camera"]
        for name in RIGS
        for rig in [Rig.load(name)]
    }
    assert row["handheld"]["mass"] == pytest.approx(100.0, abs=4 * row["handheld"]["mass_std"])
    assert row["thesis"]["mass"] is None and row["turret"]["mass"] is None
    assert "taken as the stated 8425 g" in row["thesis"]["sentence"]


def test_a_mass_that_does_not_show_is_one_statement_with_the_place() -> None:
    """At the mass that was planted, the first moment is the stated one's; so it says in JSON and in words."""
    rig = Rig.load("ptu")
    found = said(rig, recorded(plant(rig, "payload-mass:extra=0.1"), 1))
    row = found.to_dict()["camera"]
    moved = found.shift.change + 0.1 * (found.per_mass + found.shift.change / found.stated)
    assert moved == pytest.approx(np.zeros(3), abs=4 * found.shift.std.max())
    assert np.abs(found.shift.change).max() > 20 * found.shift.std.max()
    np.testing.assert_allclose(row["com_mm_per_g"], found.per_mass)
    assert re.search(r"every 100 g more would mean [\d.]+ mm (forward|back|left|right|up|down)", row["sentence"])


def test_the_centre_is_that_of_the_mass_that_was_found() -> None:
    """A payload a fifth heavier, all of it elsewhere: its centre is where it is."""
    rig = Rig.load("handheld")
    row = said(rig, recorded(nominal(moved(rig, 1.2)), 6)).to_dict()["camera"]
    assert row["mass"] == pytest.approx(200 * get_payload(rig)[1].mass, abs=4 * row["mass_std"])
    assert max(row["com_std_mm"]) < 0.1
    np.testing.assert_array_less(np.abs(np.array(row["com_mm"]) - SHIFT), 4 * np.array(row["com_std_mm"]))


def test_rotors_that_no_urdf_holds_hide_no_mass() -> None:
    """Inertia about every axis that the URDF lacks, and an arm 2 % off: the mass shows, with a deviation that holds."""
    rig = Rig.load("handheld")
    body, inertia, _ = get_payload(rig)
    phi = rig.phi.copy().reshape(-1, 10)
    phi[:, [4, 6, 9]] *= 1.1
    phi[0, :4] *= 1.02
    phi[body] += 0.2 * inertia.toDynamicParameters()
    found = said(rig, recorded(nominal(rig.with_phi(phi.ravel())), 6))
    row = found.to_dict()["camera"]
    assert not found.alone and row["mass"] is not None
    assert row["mass"] == pytest.approx(200 * inertia.mass, abs=3 * row["mass_std"])


@pytest.mark.parametrize("joint", ["pan", "roll"])
def test_what_no_cause_explains_widens_the_payloads_interval(joint: str) -> None:
    """A detent of .05 N m between 10° and 20° at another joint: `diagnose` and `identify` hold the truth."""
    rig = Rig.load("handheld")
    log = recorded(plant(rig, MOVED), 1)
    q = log.q[:, rig.joint_index(joint)]
    tau = log.tau + np.outer(
        0.05 * ((q > np.radians(10)) & (q < np.radians(20))), np.eye(rig.n)[rig.joint_index(joint)]
    )
    log = replace(log, tau=tau)
    for found in (said(rig, log), compared(identify(rig, [log]))):
        assert found is not None
        row = found.to_dict()["camera"]
        np.testing.assert_array_less(np.abs(np.array(row["com_mm"]) - SHIFT), 3 * np.array(row["com_std_mm"]))
        assert abs(row["mass"] or 0.0) < 3 * (row["mass_std"] or 1.0) and max(row["com_std_mm"]) < 1.0


def test_what_no_body_can_have_is_no_figure() -> None:
    """A mass under zero; an inertia under zero, under that of the mass at its centre: the log does not show them."""
    rig = Rig.load("handheld")
    body, inertia, _ = get_payload(rig)
    phi = rig.phi.copy()
    phi[10 * body : 10 * body + 10] -= 1.05 * inertia.toDynamicParameters()
    still = recorded(nominal(rig), 1)
    acceleration = np.gradient(np.gradient(still.q, still.t, axis=0), still.t, axis=0)
    noise = 0.02 * np.random.default_rng(1).standard_normal(still.q.shape)
    backwards = replace(still, tau=compute_rnea(rig, still.q, 0 * still.q, -0.05 * acceleration) + noise)
    for log in (recorded(nominal(rig.with_phi(phi)), 1), backwards):
        found = said(rig, log)
        row = found.to_dict()["camera"]
        assert row["mass"] is None and row["com_mm"] == [None] * 3 and not found.weighs
        assert "no body's" in found.sentence and "further" not in found.sentence and "lighter" not in found.sentence


def test_units_are_millimetres_and_grams() -> None:
    """The numbers of the JSON are the SI ones times a thousand, and the contract's keys are there."""
    rig = Rig.load("handheld")
    found = said(rig, recorded(plant(rig, MOVED), 2))
    row = found.to_dict()["camera"]
    assert {"mass", "com_mm", "std", "sentence"} <= set(row)
    np.testing.assert_allclose(row["com_mm"], 1e3 * found.shift.change)
    assert row["std"] == max(row["com_std_mm"]) and row["stated_mass"] == pytest.approx(1310.0)
    assert re.search(r"4\.2\d* ± [\d.]+ mm further forward, (2|1\.99)\d* ± [\d.]+ mm further left", row["sentence"])
    assert "slide" not in row["sentence"], "what to do is balance's to say"


def test_other_bodies_that_differ_are_not_laid_on_the_payload() -> None:
    """Every body differs: only what shows whatever the others are is said, and it is true of the body."""
    rig = Rig.load("handheld")
    model = perturbed(rig, 0.1, np.random.default_rng(3))
    found = said(rig, recorded(model, 3))
    assert not found.alone and not len(found.mass.value)
    moment = (model.rig.model.inertias[3].mass * model.rig.model.inertias[3].lever) - (
        rig.model.inertias[3].mass * rig.model.inertias[3].lever
    )
    for direction, value, std in zip(found.shift.basis.T, found.shift.value, np.sqrt(np.diag(found.shift.covariance))):
        assert value == pytest.approx(direction @ moment / found.stated, abs=4 * std)


def test_the_sentence_does_not_know_how_a_frame_is_turned() -> None:
    """The same rig with the payload's and the cradle's link frames turned otherwise: the very same sentence."""
    rig = Rig.load("handheld")
    model = plant(rig, MOVED)
    other = turned(rig)
    log = recorded(model, 5)
    assert said(rig, log).sentence == said(other, log).sentence
    assert not np.allclose(said(rig, log).to_dict()["camera"]["com_mm"], said(other, log).to_dict()["camera"]["com_mm"])


def turned(rig: Rig) -> Rig:
    """The rig with the payload's root link drawn in another frame."""
    tree = etree.fromstring(rig.urdf.encode())
    joint = next(j for j in tree.findall("joint") if j.find("child").get("link") == rig.payload_link)
    origin = joint.find("origin") if joint.find("origin") is not None else etree.SubElement(joint, "origin")
    origin.set("rpy", "0 0 1.5707963267948966")
    link = tree.find(f"link[@name='{rig.payload_link}']")
    origin, tensor = link.find("inertial/origin"), link.find("inertial/inertia")
    x, y, z = map(float, origin.get("xyz").split())
    origin.set("xyz", f"{y} {-x} {z}")
    old = {key: float(tensor.get(key)) for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")}
    new = {"ixx": old["iyy"], "iyy": old["ixx"], "ixy": -old["ixy"], "ixz": old["iyz"], "iyz": -old["ixz"]}
    for key, value in new.items():
        tensor.set(key, repr(value))
    below = next(j for j in tree.findall("joint") if j.find("parent").get("link") == rig.payload_link)
    x, y, z = map(float, below.find("origin").get("xyz").split())
    below.find("origin").attrib.update({"xyz": f"{y} {-x} {z}", "rpy": "0 0 -1.5707963267948966"})
    made = build_rig(rig.path, etree.tostring(tree).decode(), rig.config, rig.payload, rig.payload_link, "test")
    np.testing.assert_allclose(made.phi, rig.phi, atol=1e-9)
    return made


def test_a_foreign_rig_carries_its_fixed_leaf_or_its_last_link() -> None:
    rig = Rig.load("turret")
    bare = replace(rig, payload_link=None, camera_frame=rig.links[-1], config=replace(rig.config, camera_frame=None))
    lumped = build_rig(rig.path, to_urdf(Rig.load("turret", "none"), rig.phi), bare.config, None, None, "test")
    log = recorded(plant(rig, MOVED), 4)
    before, after = (said(one, log).to_dict()["camera"] for one in (rig, lumped))
    np.testing.assert_allclose(
        before["com_mm"][0] * before["stated_mass"], after["com_mm"][0] * after["stated_mass"], rtol=1e-6
    )


def test_nothing_mounted_says_nothing() -> None:
    rig = Rig.load("turret", "none")
    assert given(difference(rig, recorded(nominal(rig), 0))) is None


# findings, where the URDF is trusted

BODIES = {name: kind for name, kind in CAUSES.items() if issubclass(kind, RigEffect)}


def diagnosed(rig: Rig, log: Log, inertia: str) -> Diagnosis:
    """The diagnosis over causes of the rig alone, which takes a tenth of the time."""
    stated = replace(rig, config=replace(rig.config, inertia=inertia))
    return diagnose(stated, [log], BODIES, rng=np.random.default_rng(0), filtering=ALIGNED)


BOTH = "off-diagonal-inertia:tilt:Ixy=0.0008,Ixz=0.0006,payload_Ixy=-0.0004,payload_Iyz=-0.0007"
SUMS = {"Ixy": 0.0004, "Ixz": 0.0006, "Iyz": -0.0007}
"""What shows of them where the payload is not mounted turned."""
PLANTED = {
    MOVED: {"x": 0.0042, "z": -0.001},
    "off-diagonal-inertia:tilt:Ixy=0.002,Ixz=0.001,Iyz=0": {"Ixy": 0.002, "Ixz": 0.001},
}


@pytest.mark.parametrize("text", PLANTED)
def test_a_trusted_urdf_makes_findings(text: str) -> None:
    """Named, with its figures and a gain; a nominal URDF's difference is told in `given_model`, and is no finding."""
    rig = Rig.load("handheld" if "off-diagonal" in text else "turret")
    log = recorded(plant(rig, text), 6)
    found = diagnosed(rig, log, "trusted")
    assert [one.cause for one in found.findings] == [text.split(":")[0]] and found.verdict == "named"
    first = found.findings[0]
    for parameter in first.parameters:
        if parameter.name in PLANTED[text]:
            assert parameter.value == pytest.approx(PLANTED[text][parameter.name], abs=4 * parameter.std)
    assert first.gain["torque_rmse_after"] < 0.5 * first.gain["torque_rmse_before"]
    assert first.gain["rollout_rmse_after"] < first.gain["rollout_rmse_before"]


def test_products_of_a_link_and_of_its_payload_are_one_cause() -> None:
    """A turned payload's are moments about the joint's axes, too, which a second cause would have to make up for."""
    rig = Rig.load("handheld")
    turned = replace(rig, config=replace(rig.config, inertia="trusted"))
    found = diagnosed(turned, recorded(plant(turned, BOTH), 6), "trusted")
    assert [(one.cause, one.joint) for one in found.findings] == [("off-diagonal-inertia", "tilt")]
    np.testing.assert_allclose(get_payload(turned)[2].rotation, np.eye(3), atol=1e-9)
    told = {one.name: one for one in found.findings[0].parameters}
    for name, value in SUMS.items():
        alike = [told[one] for one in (name, f"payload_{name}") if one in told]
        assert sum(one.value for one in alike) == pytest.approx(value, abs=4 * max(one.std for one in alike))


def test_products_of_a_link_that_turns_about_one_axis_only_stand_for_no_other_figure() -> None:
    """None of them shows, alone and beside each other: not tried in any form."""
    rig = Rig.load("handheld")
    bodies = Bodies(difference(rig, recorded(nominal(rig), 6)), {OffDiagonalInertia.name: OffDiagonalInertia})
    assert {form.joint for form in bodies.forms} == set(rig.joints[1:])


def test_a_weight_bolted_on_is_no_shifted_camera() -> None:
    """First moments change as if the camera had moved; the inertia tells that something was added out there."""
    rig = Rig.load("turret")
    log = recorded(plant(rig, "payload-mass:extra=0.12,x=0.05,y=0.03,z=0.04"), 8)
    found = diagnosed(rig, log, "trusted")
    assert found.findings[0].cause == "payload-mass"
    figures = {parameter.name: parameter.value for parameter in found.findings[0].parameters}
    assert figures["extra"] == pytest.approx(0.12, rel=0.2) and figures["x"] == pytest.approx(0.05, rel=0.2)


def test_a_heavier_payload_that_was_moved_is_both() -> None:
    """All of its mass has moved, what it has more included: both are what they are, in whatever order they are planted.

    A weight bolted on somewhere would move the centre of mass alike; the inertias tell that it is none.
    """
    rig = Rig.load("turret")
    truth, both = moved(rig, 1.15), (f"payload-mass:extra={0.15 * get_payload(rig)[1].mass}", MOVED)
    for planted in (both, both[::-1]):
        np.testing.assert_allclose(plant(rig, *planted).rig.phi, truth.phi, atol=1e-9)
    found = diagnosed(rig, recorded(nominal(truth), 9), "trusted")
    figures = {one.cause: {p.name: (p.value, p.std) for p in one.parameters} for one in found.findings}
    assert set(figures) == {"payload-mass", "payload-shift"}
    wanted = {**dict(zip("xyz", 1e-3 * SHIFT)), "extra": 0.15 * get_payload(rig)[1].mass}
    for figure, (value, std) in [*figures["payload-shift"].items(), ("extra", figures["payload-mass"]["extra"])]:
        assert value == pytest.approx(wanted[figure], abs=3 * std)
    assert figures["payload-shift"]["x"][1] < 5e-5


def test_a_faint_mass_beside_a_large_shift_is_found() -> None:
    """A few hundredths of the shift's torque: no error of the shift's form would point so exactly where a mass does."""
    rig = Rig.load("handheld")
    extra = f"payload-mass:extra={0.03 * get_payload(rig)[1].mass}"
    said = diagnosed(rig, recorded(plant(rig, "payload-shift:x=0.015,y=0.008,z=-0.006", extra), 10), "trusted")
    assert [one.cause for one in said.findings] == ["payload-shift", "payload-mass"]
    assert not said.immaterial


def test_a_nominal_urdf_makes_none_and_says_it_all_the_same() -> None:
    rig = Rig.load("turret")
    found = diagnosed(rig, recorded(plant(rig, MOVED), 6), "nominal")
    assert not found.findings and found.verdict == "nothing"
    assert re.search(r"sits 4\.2\d* ± [\d.]+ mm further forward", found.to_dict()["given_model"]["camera"]["sentence"])


def test_a_trusted_urdf_that_is_right_makes_none() -> None:
    rig = Rig.load("turret")
    found = diagnosed(rig, recorded(nominal(rig), 7), "trusted")
    assert found.verdict == "nothing" and not found.findings
    assert found.to_dict()["given_model"]["camera"]["com_mm"][1] is None
