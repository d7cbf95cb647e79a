"""Laws of the payload against its URDF: a planted shift is recovered, nothing planted is nothing said."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from lxml import etree
from plants import PLANTS

from gimbal_pin.control import perturbed
from gimbal_pin.dynamics import Model, nominal, plant_with, reduce_parameters
from gimbal_pin.effects import get_payload, parse_effect
from gimbal_pin.errors import UsageError
from gimbal_pin.identification import (
    BaseDifference,
    PayloadDiscrepancy,
    compare_payload,
    explain_by_payload,
    identify,
)
from gimbal_pin.log import Log
from gimbal_pin.regression import TRUST, compute_deformation_root
from gimbal_pin.rig import Rig, build_rig, to_urdf
from tests.bench_logs import prescribed
from tests.rigs import spelled

RIGS = ("thesis", "handheld", "turret")
SHIFT = np.array([4.2, 2.0, -1.0])
MOVED = "payload-shift:x=0.0042,y=0.002,z=-0.001"
ALONG = "payload-shift:x=0.0042,y=0.0,z=0.0"


def trust(rig: Rig) -> Rig:
    """The rig, whose YAML says that its bodies are as the URDF says."""
    return replace(rig, config=replace(rig.config, inertia="trusted"))


def plant(rig: Rig, *planted: str) -> Model:
    return plant_with(nominal(rig), [parse_effect(text, rig) for text in planted]).plant


def record(model: Model, seed: int) -> Log:
    return prescribed(model, seed, seconds=16.0, torque_noise=0.02, dt=0.003)


def compare(rig: Rig, log: Log) -> PayloadDiscrepancy:
    found = compare_payload(identify(rig, [log])).apart
    assert found is not None
    return found


def describe(rig: Rig, log: Log) -> dict[str, Any]:
    return dict(compare(rig, log).to_dict()["camera"])


@pytest.mark.parametrize("name", RIGS)
def test_a_planted_shift_is_recovered_within_its_deviation(name: str) -> None:
    """In every direction that shows: within 3 standard deviations on average over seeds and directions (χ²)."""
    rig = trust(Rig.load(name))
    z = []
    model = plant(rig, MOVED)
    for seed in range(2):
        row = describe(rig, record(model, seed))
        shown = [k for k in range(3) if row["com_mm"][k] is not None]
        assert shown == ([0, 2] if name == "turret" else [0, 1, 2])
        z += [(row["com_mm"][k] - SHIFT[k]) / row["com_std_mm"][k] for k in shown]
    assert np.max(np.abs(z)) < 4.0 and np.sqrt(np.mean(np.square(z))) < 1.8


@pytest.mark.parametrize("name", RIGS)
def test_nothing_planted_is_nothing_said(name: str) -> None:
    """Deviations are what they say, and no sentence sends anybody to slide a camera."""
    rig = trust(Rig.load(name))
    z = []
    for seed in range(3):
        found = compare(rig, record(nominal(rig), seed))
        assert (
            found.is_sufficient
            and len(found.lines) == 1
            and "sits where its URDF says" in found.sentence
        )
        for shown in (found.shift, found.mass, found.products):
            z += (shown.value / np.sqrt(np.diag(shown.covariance))).tolist()
    assert 0.5 < np.sqrt(np.mean(np.square(z))) < 1.6


def test_mass_shows_where_an_arm_carries_it_and_is_stated_elsewhere() -> None:
    rows = {
        name: describe(rig, record(plant(rig, "payload-mass:extra=0.1"), 1))
        for name in RIGS
        for rig in [trust(Rig.load(name))]
    }
    assert rows["handheld"]["mass"] == pytest.approx(100.0, abs=4 * rows["handheld"]["mass_std"])
    assert rows["thesis"]["mass"] is None and rows["turret"]["mass"] is None
    assert "taken as the stated 8425 g" in rows["thesis"]["sentence"]


def test_a_mass_that_does_not_show_is_one_statement_with_the_place() -> None:
    """At the mass that was planted, the first moment is the stated one's; so it says in JSON and in words."""
    rig = trust(Rig.load("ptu"))
    row = describe(rig, record(plant(rig, "payload-mass:extra=0.1"), 1))
    com, per_gram, std = (
        np.array(row[key], float) for key in ("com_mm", "com_mm_per_g", "com_std_mm")
    )
    shown = np.isfinite(com)
    at_the_mass = (com + 100.0 * (per_gram + com / row["stated_mass"]))[shown]
    np.testing.assert_allclose(at_the_mass, 0.0, atol=4 * np.nanmax(std))
    assert np.nanmax(np.abs(com)) > 20 * np.nanmax(std)
    assert re.search(
        r"if it weighs 100 g more, it sits [\d.]+ mm further (forward|back|left|right|up|down)",
        row["sentence"],
    )


def test_grams_are_not_taken_for_kilograms() -> None:
    rig = trust(Rig.load("turret"))
    found = identify(rig, [record(nominal(rig), 1)])
    with pytest.raises(UsageError, match="give it in kilograms"):
        compare_payload(found, 1000.0 * float(get_payload(rig)[1].mass))


def test_every_axis_is_spoken_of() -> None:
    """An axis that is as the URDF says has that said beside one that is not."""
    found = compare(
        trust(Rig.load("handheld")), record(plant(trust(Rig.load("handheld")), ALONG), 1)
    )
    said = found.sentence.partition("; ")[0]
    assert all(
        any(word in said for word in pair)
        for pair in (("forward", "back"), ("left", "right"), ("up", "down"))
    )
    assert "where that says, to" in said


@pytest.mark.parametrize("name", ["handheld", "turret"])
def test_a_mass_that_was_weighed_leaves_the_place_alone_open(name: str) -> None:
    """Place and balance agree with those of the log alone where the mass shows; where it does not, with the truth."""
    rig = trust(Rig.load(name))
    stated = float(get_payload(rig)[1].mass)
    found = identify(rig, [record(plant(rig, MOVED, "payload-mass:extra=0.1"), 1)])
    alone = compare_payload(found)
    weighed = compare_payload(found, stated + 0.1)
    assert weighed.apart is not None and alone.apart is not None and alone.balance is not None
    row, free = (one.apart.to_dict()["camera"] for one in (weighed, alone) if one.apart is not None)
    assert row["weighed"] and row["mass"] == pytest.approx(100.0) and row["mass_std"] == 0.0
    assert "that were weighed" in row["sentence"]
    for k, (x, std) in enumerate(zip(row["com_mm"], row["com_std_mm"])):
        if x is not None:
            assert x == pytest.approx(SHIFT[k], abs=3 * std)
            moments = (
                std * (1e3 * stated + 100.0),
                free["com_std_mm"][k] * (1e3 * stated + (free["mass"] or 0.0)),
            )
            assert (
                moments[0] <= moments[1] * 1.001
            )  # a place is the first moment, of which this is said, over the mass
    there = weighed.balance
    here = alone.balance
    assert there is not None and there.mass == pytest.approx(stated + 0.1)
    if name == "handheld":
        assert (np.abs(there.way - here.way) < 3 * here.std).all() and (there.std < here.std).all()
    else:
        assert here.source == "stated" and free["mass"] is None


def test_the_balance_is_as_uncertain_as_the_mass_it_stands_on() -> None:
    """Over logs it scatters as it says, with a mass that shows little; `(way - true) / std` over seeds and axes."""
    rig = trust(Rig.load("handheld"))
    z = []
    model = plant(rig, MOVED, "payload-mass:extra=0.1")
    exact = compare_payload(
        identify(rig, [prescribed(model, 9, seconds=16.0, torque_noise=1e-6, dt=0.003)])
    ).balance
    for seed in range(4):
        said = compare_payload(identify(rig, [record(model, seed)])).balance
        assert said is not None and exact is not None and said.source == "identified"
        z += ((said.way - exact.way) / said.std).tolist()
    assert np.max(np.abs(z)) < 4.0 and 0.3 < np.sqrt(np.mean(np.square(z))) < 1.8


def test_the_centre_is_that_of_the_mass_that_was_found() -> None:
    """A payload a fifth heavier, all of it elsewhere: its centre is where it is."""
    rig = trust(Rig.load("handheld"))
    body, inertia, frame = get_payload(rig)
    phi = rig.phi.copy()
    there = pin.SE3(np.eye(3), 1e-3 * frame.rotation @ SHIFT).act(inertia)
    phi[10 * body : 10 * body + 10] += (
        1.2 * there.toDynamicParameters() - inertia.toDynamicParameters()
    )
    row = describe(rig, record(nominal(rig.with_phi(phi)), 6))
    assert row["mass"] == pytest.approx(200 * inertia.mass, abs=4 * row["mass_std"])
    assert max(row["com_std_mm"]) < 0.1
    np.testing.assert_array_less(
        np.abs(np.array(row["com_mm"]) - SHIFT), 4 * np.array(row["com_std_mm"])
    )


def test_rotors_that_no_urdf_holds_hide_no_mass() -> None:
    """Inertia about every axis that the URDF lacks, and an arm 2 % off: the mass shows, with a deviation that holds."""
    rig = trust(Rig.load("handheld"))
    body, inertia, _ = get_payload(rig)
    phi = rig.phi.copy().reshape(-1, 10)
    phi[:, [4, 6, 9]] *= 1.1
    phi[0, :4] *= 1.02
    phi[body] += 0.2 * inertia.toDynamicParameters()
    row = describe(rig, record(nominal(rig.with_phi(phi.ravel())), 6))
    assert not row["alone"] and "other bodies of the rig differ" in row["sentence"]
    assert row["mass"] == pytest.approx(200 * inertia.mass, abs=3 * row["mass_std"])


@pytest.mark.parametrize("joint", ["pan", "roll"])
def test_what_no_cause_explains_widens_the_payloads_interval(joint: str) -> None:
    """A detent of .05 N m between 10° and 20° at another joint."""
    rig = trust(Rig.load("handheld"))
    log = record(plant(rig, MOVED), 1)
    j = rig.joint_index(joint)
    q = log.q[:, j]
    tau = log.tau.copy()
    tau[:, j] += 0.05 * ((q > np.radians(10)) & (q < np.radians(20)))
    row = describe(rig, replace(log, tau=tau))
    np.testing.assert_array_less(
        np.abs(np.array(row["com_mm"]) - SHIFT), 3 * np.array(row["com_std_mm"])
    )
    assert abs(row["mass"] or 0.0) < 3 * (row["mass_std"] or 1.0) and max(row["com_std_mm"]) < 1.0


@pytest.mark.parametrize(
    "share", [-1.05, [0, 0, 0, 0, -9, -9, -9, -9, -9, -9]], ids=["mass", "inertia"]
)
def test_what_no_body_can_have_is_no_figure(share: float | list[float]) -> None:
    """A mass under zero; an inertia under that of the mass at its centre: the log does not show them."""
    rig = trust(Rig.load("handheld"))
    reduction = reduce_parameters(rig)
    body, inertia, _ = get_payload(rig)
    noise = 1e-8 * np.eye(len(reduction.independent))
    difference = BaseDifference(rig, reduction, np.zeros(len(noise)), noise, noise)
    own = difference.responses[:, 10 * body : 10 * body + 10]
    change = own @ (np.array(share) * inertia.toDynamicParameters())
    found = explain_by_payload(replace(difference, change=change))
    assert (
        found is not None
        and not found.found_mass
        and found.to_dict()["camera"]["com_mm"] == [None] * 3
    )
    assert (
        "no body's" in found.sentence
        and "further" not in found.sentence
        and "lighter" not in found.sentence
    )


def test_units_are_millimetres_and_grams() -> None:
    rig = trust(Rig.load("handheld"))
    row = describe(rig, record(plant(rig, MOVED), 2))
    np.testing.assert_allclose(row["com_mm"], SHIFT, atol=0.1)
    assert row["std"] == max(row["com_std_mm"]) and row["stated_mass"] == pytest.approx(1310.0)
    assert re.search(
        r"4\.2\d* ± [\d.]+ mm further forward, (2|1\.9\d) ± [\d.]+ mm further left", row["sentence"]
    )
    assert "slide" not in row["sentence"], "what to do is balance's to say"


def test_other_bodies_that_differ_are_not_laid_on_the_payload() -> None:
    """Every body differs: only what shows whatever the others are is said, and it is true of the body."""
    rig = Rig.load("thesis")
    model = perturbed(rig, 0.1, np.random.default_rng(3))
    found = compare(rig, record(model, 3))
    assert not found.is_sufficient and not found.found_mass
    true, given = (one.model.inertias[3] for one in (model.rig, rig))
    moment = true.mass * true.lever - given.mass * given.lever
    for direction, value, std in zip(
        found.shift.basis.T, found.shift.value, np.sqrt(np.diag(found.shift.covariance))
    ):
        assert value == pytest.approx(direction @ moment / found.stated, abs=4 * std)


def test_the_sentence_does_not_know_how_a_frame_is_turned() -> None:
    """The same rig with the payload's and the cradle's link frames turned otherwise: the very same sentence."""
    rig = trust(Rig.load("handheld"))
    log = record(plant(rig, MOVED), 5)
    one = describe(rig, log)
    other = describe(turn_payload_frame(rig), log)
    assert one["sentence"] == other["sentence"] and not np.allclose(one["com_mm"], other["com_mm"])


def turn_payload_frame(rig: Rig) -> Rig:
    """The rig with the payload's root link drawn in another frame."""
    tree = etree.fromstring(rig.urdf.encode())
    joint = next(
        j for j in tree.findall("joint") if j.find("child").get("link") == rig.payload_link
    )
    origin = (
        joint.find("origin")
        if joint.find("origin") is not None
        else etree.SubElement(joint, "origin")
    )
    origin.set("rpy", "0 0 1.5707963267948966")
    link = tree.find(f"link[@name='{rig.payload_link}']")
    origin = link.find("inertial/origin")
    tensor = link.find("inertial/inertia")
    x, y, z = map(float, origin.get("xyz").split())
    origin.set("xyz", f"{y} {-x} {z}")
    old = {key: float(tensor.get(key)) for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")}
    new = {
        "ixx": old["iyy"],
        "iyy": old["ixx"],
        "ixy": -old["ixy"],
        "ixz": old["iyz"],
        "iyz": -old["ixz"],
    }
    for key, value in new.items():
        tensor.set(key, repr(value))
    below = next(
        j for j in tree.findall("joint") if j.find("parent").get("link") == rig.payload_link
    )
    x, y, z = map(float, below.find("origin").get("xyz").split())
    below.find("origin").attrib.update({"xyz": f"{y} {-x} {z}", "rpy": "0 0 -1.5707963267948966"})
    made = build_rig(
        rig.path, etree.tostring(tree).decode(), rig.config, rig.payload, rig.payload_link, "test"
    )
    np.testing.assert_allclose(made.phi, rig.phi, atol=1e-9)
    return made


def test_a_foreign_rig_carries_its_fixed_leaf_or_its_last_link() -> None:
    rig = trust(Rig.load("turret"))
    bare = replace(rig.config, camera_frame=None)
    lumped = build_rig(
        rig.path, to_urdf(Rig.load("turret", "none"), rig.phi), bare, None, None, "test"
    )
    log = record(plant(rig, MOVED), 4)
    moments = [
        row["com_mm"][0] * row["stated_mass"]
        for row in (describe(one, log) for one in (rig, lumped))
    ]
    assert moments[0] == pytest.approx(moments[1], rel=1e-6)


def test_nothing_mounted_says_nothing() -> None:
    rig = Rig.load("turret", "none")
    assert compare_payload(identify(rig, [record(nominal(rig), 0)])).apart is None


@pytest.mark.parametrize("seed", range(4))
def test_a_link_that_is_not_as_its_urdf_says_is_not_laid_on_the_payload(seed: int) -> None:
    """Every body 15 % off, the payload moved: place and mass are true to 3 deviations, and the balance stays sharp."""
    rig = Rig.load("handheld")
    body, inertia, frame = get_payload(rig)
    bare = perturbed(rig, 0.15, np.random.default_rng(seed)).rig.phi - rig.phi
    link = np.zeros((rig.n, 10))
    link[body] = (
        pin.SE3(np.eye(3), 1e-3 * frame.rotation @ SHIFT).act(inertia).toDynamicParameters()
    )
    link[body] -= inertia.toDynamicParameters()
    log = record(nominal(rig.with_phi(rig.phi + bare + link.ravel())), seed)
    said = compare_payload(identify(rig, [log]))
    assert said.apart is not None and said.balance is not None
    row = said.apart.to_dict()["camera"]
    for x, std, true in zip(row["com_mm"], row["com_std_mm"], SHIFT):
        assert x is None or abs(x - true) < 3 * std
    assert row["mass"] is None or abs(row["mass"]) < 3 * row["mass_std"]
    assert said.balance.std.max() < 5e-4


@pytest.mark.parametrize("name", ["drone", "handheld", "mast"])
def test_bodies_as_far_off_as_the_trust_says_leave_the_place_true(name: str) -> None:
    """Each is stretched and sheared by `TRUST`, the payload is not: over draws its place is true to its deviations."""
    rig = spelled(PLANTS[name].write_urdf(payload=True)) if name == "mast" else Rig.load(name)
    z = list[float]()
    rng = np.random.default_rng(2)
    reduction = reduce_parameters(rig)
    body, inertia, _ = get_payload(rig)
    bare = rig.phi.copy()
    bare[10 * body : 10 * body + 10] -= inertia.toDynamicParameters()
    noise = 1e-10 * np.eye(len(reduction.independent))
    exact = BaseDifference(rig, reduction, np.zeros(len(noise)), noise, noise)
    bodies = TRUST * exact.responses @ compute_deformation_root(bare)
    for _ in range(100):
        shift = explain_by_payload(
            replace(exact, change=bodies @ rng.standard_normal(bodies.shape[1]))
        ).shift
        z += (shift.change[shift.axes] / shift.std[shift.axes]).tolist()
    assert len(z) >= 100 and 0.8 < np.sqrt(np.mean(np.square(z))) < 1.2


def test_what_is_known_of_the_link_sharpens_the_payload_alone() -> None:
    """Less trust, wider: the place falls back to none known; the balance, of link and payload together, is the same."""
    rig = Rig.load("handheld")
    log = record(plant(rig, MOVED), 1)
    wide, known = (compare_payload(identify(one, [log])) for one in (rig, trust(rig)))
    assert wide.apart is not None and known.apart is not None and wide.balance is not None
    assert wide.apart.shift.std.max() > 10 * known.apart.shift.std.max()
    assert wide.apart.std_if_known == pytest.approx(known.apart.shift.std.max())
    assert (
        "if the gimbal is known" in wide.apart.sentence
        and "if the gimbal is known" not in known.apart.sentence
    )
    stated = compare_payload(identify(rig, [log]), wide.apart.stated).balance
    same = compare_payload(identify(trust(rig), [log]), wide.apart.stated).balance
    assert stated is not None and same is not None
    np.testing.assert_allclose(stated.way, same.way, atol=1e-9)
