"""Laws of several cameras on one gimbal: one gimbal in all, each camera its own; a new camera needs ten seconds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache, partial
from pathlib import Path

import numpy as np
import pytest

from gimbal_pin.control import bench_run, tune
from gimbal_pin.diagnosis import diagnose
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
)
from gimbal_pin.identification.payloads import CarrierEstimate, get_stated_payload
from gimbal_pin.log import Array, Log, read_log, write_log
from gimbal_pin.regression import Filtering
from gimbal_pin.report import show_cameras
from gimbal_pin.rig import Rig, find_payload
from tests.bench_logs import fourier, prescribed
from tests.command_line import Run, refused, result

ALIGNED = Filtering(alignment=0.0)


def log_of(rig: Rig, seed: int, seconds: float = 16.0) -> Log:
    return prescribed(nominal(rig), seed, seconds=seconds, torque_noise=0.02, dt=0.004)


@cache
def several(name: str, payloads: Sequence[str]) -> Several:
    rigs = {payload: Rig.load(name, payload) for payload in payloads}
    logs = {payload: [log_of(rig, k)] for k, (payload, rig) in enumerate(rigs.items())}
    return identify_several(rigs, logs, filtering=ALIGNED)


def own_of(found: Several) -> CarrierEstimate:
    return CarrierEstimate.of(found.first.model.rig, found.first.reduction)


@pytest.mark.parametrize(
    ("name", "payloads"),
    [
        ("handheld", ("mirrorless", "cinema", "infrared")),
        ("turret", ("cinema", "none")),
    ],
)
def test_every_camera_has_its_own_parameters(name: str, payloads: tuple[str, ...]) -> None:
    """Within their deviations of what its URDF says, and each model predicts its own held-out part."""
    found = several(name, payloads)
    z = []
    assert found.reference == ("none" if "none" in payloads else payloads[0])
    for payload in payloads:
        camera = found.cameras[payload]
        true = own_of(found).shown(get_stated_payload(Rig.load(name, payload)))
        assert np.allclose(camera.urdf, true)
        if payload != found.reference:
            z += ((camera.value - true) / camera.std).tolist()
        assert min(found.identified[payload].held_out.fit_percent.values()) > 97  # type: ignore[union-attr]
    assert np.max(np.abs(z)) < 4 and np.sqrt(np.mean(np.square(z))) < 1.7


def test_the_gimbal_is_one_and_the_same_in_all() -> None:
    """Base parameters differ only within the reach of the camera's body; friction does not differ at all."""
    found = several("handheld", ("mirrorless", "cinema", "infrared"))
    first = found.first
    width = len(found.first.reduction.independent)
    reach = own_of(found).columns
    for one in found.identified.values():
        change = one.estimate.theta - first.estimate.theta
        left = change[:width] - reach @ np.linalg.lstsq(reach, change[:width], rcond=None)[0]
        np.testing.assert_allclose(left, 0, atol=1e-9)
        np.testing.assert_array_equal(change[width:], 0)


def test_sharing_the_gimbal_is_surer_than_either_log() -> None:
    """Two logs teach more of friction than one, each camera's rows counting by their own noise."""
    both = several("turret", ("mirrorless", "infrared"))
    rig = Rig.load("turret", "mirrorless")
    alone = identify(rig, [log_of(rig, 0)], filtering=ALIGNED, holdout="last-third")
    width = len(alone.reduction.independent)
    assert np.mean(both.first.estimate.std[width:] / alone.estimate.std[width:]) < 0.9


@pytest.mark.parametrize("name", ["handheld", "turret"])
def test_a_new_camera_needs_ten_seconds(name: str) -> None:
    """Its mass moment within 2 %, its inertia within 5 %, from 10 s of motion on a gimbal that is known."""
    known = several(name, ("mirrorless", "cinema")).first
    error, z = new_camera(name, known, lambda rig: log_of(rig, 9, 10.0), ALIGNED)
    assert error["kg m"] < 0.02 and error["kg m^2"] < 0.05
    assert np.sqrt(np.mean(np.square(z))) < 2


def new_camera(name: str, known: Identified, record, filtering: Filtering):  # type: ignore[no-untyped-def]
    """Largest error by unit, as a share of the largest such parameter; every parameter's z."""
    rig = Rig.load(name, "zoom-lens")
    true = PayloadShift(0.01, -0.005, 0.012).apply(rig)
    found = identify_new(rig, [record(true)], known.model, filtering=filtering)
    camera = found.cameras["zoom-lens"]
    own = CarrierEstimate.of(rig, known.reduction)
    reference = Rig.load(name, "mirrorless")
    mine = slice(10 * own.body, 10 * own.body + 10)
    truth = own.shown(get_stated_payload(reference) + true.phi[mine] - reference.phi[mine])
    away = camera.value - truth
    return {
        unit: share(away, truth, camera.units, unit) for unit in ("kg m", "kg m^2")
    }, away / camera.std


def share(away: Array, truth: Array, units: Sequence[str], unit: str) -> float:
    """Largest error among the parameters of a unit over the largest of them."""
    these = [k for k, one in enumerate(units) if one == unit]
    return float(np.abs(away[these]).max() / np.abs(truth[these]).max())


def test_a_camera_whose_urdf_is_wrong_is_balanced_by_the_mass_that_was_found() -> None:
    known = several("handheld", ("mirrorless", "cinema")).first
    right = Rig.load("handheld", "zoom-lens")
    found = identify_new(
        Rig.load("handheld", "mirrorless"), [log_of(right, 9, 10.0)], known.model, filtering=ALIGNED
    )
    told = found.to_dict()["balance"]
    true = (
        right.phi[10 * CarrierEstimate.of(right, known.reduction).body]
        - Rig.load("handheld", "none").phi[10 * CarrierEstimate.of(right, known.reduction).body]
    )
    assert told["stated_mass"] == pytest.approx(1e3 * true, rel=0.02)


def test_the_known_camera_itself_is_found_as_it_was() -> None:
    """Slid, or put back: nothing, or next to nothing, is then left of the torque for it to differ by."""
    known = several("handheld", ("mirrorless", "cinema")).first
    rig = Rig.load("handheld", "mirrorless")
    camera = identify_new(rig, [log_of(rig, 9, 10.0)], known.model, filtering=ALIGNED).cameras[
        "mirrorless"
    ]
    assert np.abs((camera.value - camera.urdf) / camera.std).max() < 4


@pytest.mark.parametrize("name", ["turret", "handheld"])
@pytest.mark.parametrize("extra", [0.0, 0.05])
def test_a_camera_is_placed_relative_to_the_first_wherever_that_really_is(
    name: str, extra: float
) -> None:
    """The first one's URDF is lent for the new one, and wrong: the way from one to the other shows all the same."""
    rig = Rig.load(name, "mirrorless")
    z = []
    weighed = get_stated_payload(rig)[0] + extra
    for seed in range(4):
        away, way = np.random.default_rng(seed).uniform(-0.01, 0.01, (2, 3))
        first, second = (PayloadShift(*x.tolist()) for x in (away, away + way))
        known = identify(
            rig, [log_of(first.apply(rig), seed)], filtering=ALIGNED, holdout="none"
        ).model
        moved = PayloadMass(extra).apply(second.apply(rig)) if extra else second.apply(rig)
        several = identify_new(rig, [log_of(moved, seed + 9, 10.0)], known, filtering=ALIGNED)
        (told,) = replace(several, mass=weighed).payloads.values()
        assert (
            told.apart is not None
            and told.beside is not None
            and told.beside.sentence in told.lines
        )
        assert told.beside.masses == pytest.approx((weighed, weighed - extra))
        shown = np.array(told.beside.shift.axes)
        std = told.beside.shift.std
        z += ((told.beside.shift.change - way)[shown] / std[shown]).tolist()
        assert extra or std.max() < 1e-4, (
            "with equal masses it is as sharp as the logs, whoever carries the camera"
        )
        row = told.to_dict()["relative_to_known"]
        assert (
            row["payload"] == "mirrorless"
            and [x is not None for x in row["com_mm"]] == shown.tolist()
        )
    assert len(z) >= 8 and np.max(np.abs(z)) < 4 and np.sqrt(np.mean(np.square(z))) < 1.7


def test_nothing_is_relative_to_a_camera_that_is_as_its_urdf_says_or_is_not_there() -> None:
    for first, second in (("mirrorless", "mirrorless"), ("none", "mirrorless")):
        rig = Rig.load("turret", second)
        known = Rig.load("turret", first)
        before = identify(known, [log_of(known, 0)], filtering=ALIGNED, holdout="none").model
        log = log_of(PayloadShift(0.004, 0.0, 0.0).apply(rig), 9, 10.0)
        (told,) = identify_new(rig, [log], before, filtering=ALIGNED).payloads.values()
        assert told.beside is None and "relative_to_known" not in told.to_dict()
        assert told.apart is not None and told.apart.shift.change[0] == pytest.approx(
            0.004, abs=1e-4
        )


def test_ten_seconds_do_in_closed_loop_too() -> None:
    """A simulated rig with its own encoders and gyros, stick friction and 1 % torque noise."""

    def moved(rig: Rig, seed: int = 2) -> Log:
        plant = nominal(rig)
        rng = np.random.default_rng(seed)
        mover = tune(plant, bandwidth_hz=4.0, dt=0.002).controller
        return bench_run(plant, mover, rng=rng, reference=fourier(rig, seed, 10.0, 0.002))

    rig = Rig.load("turret", "mirrorless")
    known = identify(rig, [moved(rig, 1)], holdout="none")
    error, _ = new_camera("turret", known, moved, Filtering())
    assert error["kg m"] < 0.02 and error["kg m^2"] < 0.05


def test_known_without_uncertainty_or_of_another_rig_is_refused() -> None:
    rig = Rig.load("turret", "cinema")
    with pytest.raises(UsageError, match="no uncertainty"):
        identify_new(rig, [log_of(rig, 0)], nominal(rig))
    other = several("handheld", ("mirrorless", "cinema", "infrared")).first.model
    with pytest.raises(UsageError, match="other parameters"):
        identify_new(rig, [log_of(rig, 0)], other)
    with pytest.raises(UsageError, match="several payloads"):
        identify_several({"cinema": rig}, {"cinema": [log_of(rig, 0)]}, holdout="log:2")


def test_the_command_line_takes_tagged_logs_and_a_known_gimbal(run: Run, tmp_path: Path) -> None:
    """Two cameras at once write one model of both; a third is estimated on it; partly tagged logs are refused."""
    for k, payload in enumerate(("mirrorless", "cinema", "zoom-lens")):
        log = log_of(Rig.load("turret", payload), k, 10.0 if payload == "zoom-lens" else 16.0)
        write_log(log, tmp_path / f"{payload}.csv")
    tagged = [
        f"{tmp_path}/{payload}.csv@{payload}" for payload in ("mirrorless", "cinema", "zoom-lens")
    ]
    model = tmp_path / "model.yaml"
    exact = ("--alignment", "0")
    both = result(run, "identify", "turret", *tagged[:2], *exact, "-o", model)
    cinema = both["payloads"]["cinema"]
    assert (
        set(both["payloads"]) == {"mirrorless", "cinema"}
        and cinema["held_out"]["how"] == "last third"
    )
    assert cinema["balance"]["slide_mm"] and both["base_parameters"]
    third = result(run, "identify", "turret", tagged[2], *exact, "--known", model)["payloads"][
        "zoom-lens"
    ]
    moment = {one["name"]: one["value"] for one in third["camera"]}
    assert moment["camera.mx"] == pytest.approx(
        get_stated_payload(Rig.load("turret", "zoom-lens"))[1], rel=0.02
    )
    refused(run("identify", "turret", tagged[0], f"{tmp_path}/cinema.csv"), 2, "tag each of them")
    urdf = tmp_path / "new.urdf"
    again = result(
        run, "identify", "turret", tagged[2], *exact, "--known", model, "--urdf", urdf, "--refit"
    )
    assert again["held_out"]["how"] == "last third" and again["samples"] == third["samples"]
    assert again["base_parameters"] == third["base_parameters"] and any(
        "all data" in note for note in again["notes"]
    )
    written = Rig.load(urdf)
    true = Rig.load("turret", "zoom-lens")
    reduction = reduce_parameters(true)
    scale = np.abs(given_beta(true, reduction)) + 1e-2
    assert np.all(
        np.abs(given_beta(written, reduction) - given_beta(true, reduction)) < 0.05 * scale
    )
    refused(run("identify", "turret", *tagged[:2], *exact, "--urdf", urdf), 2, "--urdf")


def test_the_first_camera_of_a_known_gimbal_may_be_a_file_that_no_yaml_names(
    run: Run, tmp_path: Path
) -> None:
    """By its file beside the model, or given for the new log, the same is found as where the rig's YAML names it."""
    for name, payload in (("first", "mirrorless"), ("second", "cinema")):
        (tmp_path / f"{name}.urdf").write_text(Path(find_payload(payload)).read_text())
        write_log(log_of(Rig.load("turret", payload), 0, 16.0), tmp_path / f"{name}.csv")
    first, second, model = (tmp_path / name for name in ("first.csv", "second.csv", "model.yaml"))
    result(run, "identify", "turret", first, "--payload", tmp_path / "first.urdf", "-o", model)
    found = result(run, "identify", "turret", f"{second}@{tmp_path}/second.urdf", "--known", model)
    own = next(iter(found["payloads"].values()))
    shown = [x for x in own["given_model"]["camera"]["com_mm"] if x is not None]
    assert len(shown) == 2 and shown == pytest.approx([0.0, 0.0], abs=0.1)
    (tmp_path / "first.urdf").unlink()
    refused(
        run("identify", "turret", f"{second}@{tmp_path}/second.urdf", "--known", model),
        2,
        "payload first",
    )


def test_a_model_of_several_payloads_is_read_for_the_mounted_one(tmp_path: Path) -> None:
    from gimbal_pin.identification import read_model, write_model

    found = several("turret", ("mirrorless", "cinema"))
    write_model(found.first, tmp_path / "model.yaml", found.identified)
    for payload, one in found.identified.items():
        read = read_model(tmp_path / "model.yaml", replace(Rig.load("turret", payload)))
        np.testing.assert_allclose(read.rig.phi, one.model.rig.phi)
    with pytest.raises(ModelError, match="is of the payload mirrorless; the rig turret carries"):
        read_model(tmp_path / "model.yaml", Rig.load("turret", "zoom-lens"))


@cache
def toothed() -> Several:
    """Two cameras on a gimbal with five teeth per turn at a joint, of which the model has none."""
    name, teeth = "turret", "cogging:tilt:amplitude=0.1,harmonic=5"
    rigs = {payload: Rig.load(name, payload) for payload in ("mirrorless", "cinema")}
    plants = {
        payload: plant_with(nominal(rig), [parse_effect(teeth, rig)]).plant
        for payload, rig in rigs.items()
    }
    logs = {
        payload: [prescribed(plant, 10 + k, 60.0, torque_noise=0.01, dt=4e-3)]
        for k, (payload, plant) in enumerate(plants.items())
    }
    return identify_several(rigs, logs, filtering=ALIGNED)


def test_deviations_of_several_cameras_hold_what_the_model_lacks() -> None:
    """Parameters of the gimbal, its friction and the second camera: rms of their errors in deviations."""
    name = "turret"
    found = toothed()
    rig = Rig.load(name, "mirrorless")
    first = found.first
    camera = found.cameras["cinema"]
    true = np.concatenate([given_beta(rig, first.reduction), rig.friction.ravel()])
    own = own_of(found).shown(get_stated_payload(Rig.load(name, "cinema")))
    z = np.concatenate(
        [(first.estimate.theta - true) / first.estimate.std, (camera.value - own) / camera.std]
    )
    assert np.abs(z).max() < 4 and 0.4 < np.sqrt(np.mean(z**2)) < 1.3


def test_a_joint_that_is_not_explained_with_some_camera_is_said_first() -> None:
    found = toothed()
    said = [f"  with {payload}: tilt is not explained: " for payload in ("mirrorless", "cinema")]
    first, *lines = show_cameras(found).to_text().splitlines()
    assert (
        first == "Warning"
        and all(line.startswith(one) for line, one in zip(lines, said))
        and not any("pan is not" in x for x in lines)
    )
    assert found.to_dict()["warnings"][0] in lines[0]


def test_a_page_of_a_new_camera_says_when_torques_act() -> None:
    first, second = (Rig.load("turret", payload) for payload in ("mirrorless", "zoom-lens"))
    known = identify(first, [log_of(first, 0)], holdout="none").model
    found = identify_new(second, [log_of(second, 1, 10.0)], known)
    assert (
        "delay between a torque's time stamp and its effect, hold included (± 95 %): pan"
        in show_cameras(found).to_text()
    )


@pytest.mark.parametrize("off", ["nothing", "friction", "parameters"])
def test_what_is_known_is_no_truth_where_the_log_contradicts_it(off: str) -> None:
    """Friction that has grown, or a model off by a hundred of its deviations: said, and the deviations hold it."""
    name = "turret"
    grown = 1.3 if off == "friction" else 1.0
    reference = Rig.load(name, "mirrorless")
    rig = Rig.load(name, "zoom-lens")
    now = replace(rig, friction=grown * rig.friction)
    known = identify(reference, [log_of(reference, 0)], filtering=ALIGNED, holdout="none").model
    before = known.estimated
    assert before is not None
    if off == "parameters":
        away = 100 * before.std * np.random.default_rng(0).standard_normal(len(before.std))
        known = replace(known, estimated=replace(before, theta=before.theta + away))
    found = identify_new(rig, [log_of(now, 1, 10.0)], known, filtering=ALIGNED)
    one = found.first
    camera = found.cameras["zoom-lens"]
    true = np.concatenate([given_beta(rig, one.reduction), now.friction.ravel()])
    z = np.concatenate(
        [
            (one.estimate.theta - true) / one.estimate.std,
            (camera.value - own_of(found).shown(get_stated_payload(rig))) / camera.std,
        ]
    )
    assert np.abs(z).max() < 4 and np.sqrt(np.mean(z**2)) < 1.4
    assert any("not as --known has it" in said for said in found.warnings[:1]) == (off != "nothing")


@pytest.mark.parametrize("whole", [True, False])
def test_a_camera_is_no_surer_than_the_one_that_it_is_measured_against(whole: bool) -> None:
    """The first camera is millimetres off its URDF: its error is in all that stand on it, and in their deviations."""
    reference = Rig.load("turret", "mirrorless")
    rig = Rig.load("turret", "zoom-lens")
    logs = [log_of(PayloadShift(0.004, -0.003, 0.002).apply(reference), 1)], [log_of(rig, 2)]
    if whole:
        pairs = (
            dict(zip(("mirrorless", "zoom-lens"), (reference, rig))),
            dict(zip(("mirrorless", "zoom-lens"), logs)),
        )
        found = identify_several(*pairs, filtering=ALIGNED)
    else:
        found = identify_new(
            rig, logs[1], identify(reference, logs[0], filtering=ALIGNED).model, filtering=ALIGNED
        )
    camera = found.cameras["zoom-lens"]
    assert (
        np.abs((camera.value - own_of(found).shown(get_stated_payload(rig))) / camera.std).max() < 4
    )
    assert any("with mirrorless is not as the URDFs say" in said for said in found.warnings)
    right = identify_new(
        rig,
        logs[1],
        identify(reference, [log_of(reference, 1)], filtering=ALIGNED).model,
        filtering=ALIGNED,
    )
    assert not any("URDFs say" in said for said in right.warnings)


def test_a_swap_keeps_the_causes_that_were_found_with_the_first_camera(
    run: Run, tmp_path: Path
) -> None:
    """By --known of the extended model, and by --extended with both cameras; the teeth are then in the new model."""
    from gimbal_pin.identification import write_extended

    teeth = "cogging:tilt:amplitude=0.1,harmonic=7"
    for k, (payload, seconds) in enumerate({"mirrorless": 12.0, "cinema": 10.0}.items()):
        plant = plant_with(
            nominal(rig := Rig.load("turret", payload)), [parse_effect(teeth, rig)]
        ).plant
        write_log(
            prescribed(plant, k, seconds, torque_noise=0.01, dt=4e-3), tmp_path / f"{payload}.csv"
        )
    first, second = (f"{tmp_path}/{payload}.csv@{payload}" for payload in ("mirrorless", "cinema"))
    extended = tmp_path / "extended.yaml"
    exact = ("--alignment", "0")
    rig = Rig.load("turret", "mirrorless")
    log = read_log(tmp_path / "mirrorless.csv", rig)
    write_extended(
        identify(rig, [log], [Cogging("tilt", (7.0,))], filtering=ALIGNED).model, extended
    )
    swapped = result(
        run, "identify", "turret", second, *exact, "--known", extended, "-o", tmp_path / "new.yaml"
    )
    both = result(run, "identify", "turret", first, second, *exact, "--extended", extended)
    for each in (swapped, both):
        assert min(each["train"]["fit_percent"].values()) > 97 and not any(
            "explained" in x for x in each["warnings"]
        )
    true = get_stated_payload(Rig.load("turret", "cinema"))[1]
    for each in (swapped, both):
        moment = {one["name"]: one for one in each["payloads"]["cinema"]["camera"]}["camera.mx"]
        assert abs(moment["value"] - true) < 4 * moment["std"]
    refused(run("identify", "turret", second, *exact, "--known", tmp_path / "new.yaml"), 2, "twice")
    refused(
        run("identify", "turret", second, "--known", extended, "--extended", extended),
        2,
        "as --known",
    )


def test_auto_with_a_known_gimbal_says_what_identify_says(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The camera and its place are as `identify --known` has them; what was known counts as found, and is kept."""
    from gimbal_pin.identification import write_extended

    monkeypatch.setattr(
        "gimbal_pin.report.pipeline.diagnose", partial(diagnose, causes={"cogging": Cogging})
    )
    teeth = "cogging:tilt:amplitude=0.1,harmonic=7"
    for k, payload in enumerate(("mirrorless", "cinema")):
        plant = plant_with(
            nominal(rig := Rig.load("turret", payload)), [parse_effect(teeth, rig)]
        ).plant
        write_log(
            prescribed(plant, k, 12.0, torque_noise=0.01, dt=4e-3), tmp_path / f"{payload}.csv"
        )
    rig = Rig.load("turret", "mirrorless")
    known = tmp_path / "known.yaml"
    out = tmp_path / "out"
    log = read_log(tmp_path / "mirrorless.csv", rig)
    write_extended(identify(rig, [log], [Cogging("tilt", (7.0,))], filtering=ALIGNED).model, known)
    call = (
        "turret",
        f"{tmp_path}/cinema.csv@cinema",
        "--known",
        known,
        "--mass",
        "8.5",
        "--alignment",
        "0",
    )
    found = result(run, "auto", *call, "-o", out, "--plants", "2")
    alone = result(run, "identify", *call)
    assert found["identify"] == alone
    assert [one["cause"] for one in found["diagnose"]["findings"]] == ["cogging"]
    assert "cogging" in (out / "controller.yaml").read_text()
    assert "8.50 kg as weighed" in (out / "report.html").read_text()
    code, said, _ = run("auto", *call, "-o", out, "--plants", "2")
    assert code == 0 and len(said.splitlines()) <= 15
    (own,) = alone["payloads"].values()
    assert own["given_model"]["camera"]["sentence"][1:] in said


def test_an_inertia_under_zero_is_known_all_the_same(tmp_path: Path) -> None:
    """The log's noise may leave a sum of inertias under zero: no plant, but known to its deviation."""
    from gimbal_pin.identification import read_known, read_model, write_model

    found = several("turret", ("mirrorless", "cinema")).first
    rig = Rig.load("turret", "mirrorless")
    phi = found.model.rig.phi.copy()
    phi[9] -= 1.0
    write_model(
        replace(found, model=replace(found.model, rig=rig.with_phi(phi))), tmp_path / "model.yaml"
    )
    with pytest.raises(ModelError, match="not positive"):
        read_model(tmp_path / "model.yaml", rig)
    new = Rig.load("turret", "cinema")
    log = log_of(new, 9, 10.0)
    here, there = (
        identify_new(new, [log], known, filtering=ALIGNED).cameras["cinema"].value
        for known in (found.model, read_known(tmp_path / "model.yaml", rig))
    )
    np.testing.assert_allclose(here, there, rtol=1e-6, atol=1e-9)
