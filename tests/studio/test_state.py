"""Laws of the studio without its page: choices that go back, figures that are the records', files that are `tune`'s."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from gimbal_pin import read_log, write_log
from gimbal_pin.control import bench_run, stored, tune
from gimbal_pin.dynamics import nominal
from gimbal_pin.effects import Coulomb
from gimbal_pin.errors import UsageError
from gimbal_pin.log import Array, Log
from gimbal_pin.log.io.files import to_plain
from gimbal_pin.studio import (
    Desk,
    History,
    Slider,
    StudioSource,
    StudioState,
    Subject,
    build_model,
    build_plant,
    compute_residual,
    keep_controller,
    keep_report,
    list_causes,
    list_sliders,
    prepare_subject,
    simulate_pointing,
    tune_state,
)
from tests.command_line import Run
from tests.rigs import bundled

RIG = "turret"


@cache
def bench_log(seed: int = 0) -> Log:
    """Return a log of a turret on the bench."""
    return bench_run(nominal(bundled(RIG)), rng=np.random.default_rng(seed), seconds=20.0)


@cache
def identified() -> Subject:
    """Return a turret that was identified from a log."""
    return prepare_subject(StudioSource(bundled(RIG), (bench_log(),)))


@cache
def stated() -> Subject:
    """Return the same as its URDF states it."""
    return prepare_subject(StudioSource(bundled(RIG)))


def residual_of(subject: Subject, state: StudioState) -> Array:
    """Return what a state's model leaves of the judged torque, rms, (n,)."""
    found = compute_residual(subject, build_model(subject, state))
    assert found is not None
    return found.rms


def values(slider: Slider) -> st.SearchStrategy[float]:
    """Any value of a slider."""
    return st.floats(slider.low, slider.high)


MOVES = st.lists(
    st.one_of(
        *[
            st.tuples(st.just(name), st.none() | values(slider))
            for name, slider in list_sliders().items()
        ],
        st.tuples(st.just("off"), st.lists(st.sampled_from(["coulomb at pan", "viscous at tilt"]))),
        st.tuples(st.just("payload"), st.none() | st.just("cinema")),
        st.tuples(st.just("judged"), st.none() | st.just((1.0, 2.0))),
    ),
    max_size=8,
)


@given(MOVES)
def test_what_was_moved_and_undone_is_as_it_was(moves: list[tuple[str, Any]]) -> None:
    history = [History()]
    for move in moves:
        history.append(history[-1].moved(*move))
    back = history[-1]
    shown = [
        one.present for one, before in zip(history[1:], history) if one.present != before.present
    ]
    for state in reversed([StudioState(), *shown][:-1] if shown else []):
        back = back.undone()
        assert back.present == state
    assert back.present == StudioState() == back.undone().present
    for state in shown:
        back = back.redone()
        assert back.present == state
    assert back == history[-1]


@pytest.mark.parametrize("name", ["x", "mass"])
def test_another_camera_has_its_own_place_and_mass(name: str) -> None:
    moved = StudioState().moved(name, 0.02).moved("bandwidth_hz", 6.0)
    assert moved.moved("payload", "cinema") == StudioState(bandwidth_hz=6.0, payload="cinema")
    assert moved.moved("payload", None) == moved


def test_what_cannot_be_is_nowhere_in_the_history() -> None:
    """The choice before it is shown, by whichever way it was come to; a first one that cannot be stays."""
    good, bad, later = (StudioState(bandwidth_hz=hz) for hz in (1.0, 2.0, 3.0))
    assert History(bad, (good, bad), (later,)).refused(bad) == History(good, (), (later,))
    assert History(later, (good, bad)).refused(bad) == History(later, (good,))
    assert History(bad).refused(bad) == History(bad)


@pytest.mark.parametrize("name", list_sliders())
def test_a_value_out_of_bounds_is_refused_with_the_bounds(name: str) -> None:
    slider = list_sliders()[name]
    ends = f"{slider.factor * slider.low:g} to {slider.factor * slider.high:g} {slider.unit}"
    for value in (slider.low - 1e-6, slider.high * 1.01 + 1, float("nan"), "1", True):
        with pytest.raises(UsageError, match=f"^{slider.label}: is .*; give {ends.rstrip()}"):
            StudioState().moved(name, value)


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [("colour", 1, "has no 'colour'"), ("judged", (2.0, 1.0), "ends at 1 s, not after 2")],
)
def test_a_move_that_cannot_be_is_refused(name: str, value: Any, words: str) -> None:
    with pytest.raises(UsageError, match=words):
        StudioState().moved(name, value)


@pytest.mark.parametrize("subject", [identified, stated], ids=["identified", "stated"])
@settings(max_examples=3)
@given(
    st.none() | st.floats(2, 30), st.none() | st.floats(0.3, 0.8), st.none() | st.floats(0, 0.004)
)
def test_a_state_is_tuned_as_tune_does(
    subject: Any, hz: float | None, margin: float | None, delay: float | None
) -> None:
    own = subject()
    state = replace(StudioState(), bandwidth_hz=hz, disk_margin=margin, delay=delay)
    found = tune_state(own, state)
    asked = tune(own.model, bandwidth_hz=hz, disk_margin=margin, delay=delay)
    assert to_plain(found.to_dict()) == to_plain(asked.to_dict())


def test_the_residual_is_noise_until_a_cause_is_off_or_the_payload_moves() -> None:
    subject = identified()
    at_rest, without, moved = (
        residual_of(subject, state)
        for state in (StudioState(), StudioState(off=("coulomb at pan",)), StudioState(z=0.02))
    )
    (dry,) = (term.values[0] for term in subject.model.terms if term.effect == Coulomb("pan"))
    assert without[0] == pytest.approx(dry, rel=0.25)
    assert without[1] == at_rest[1] < 0.1 * moved[1]


def test_a_cause_that_is_off_is_in_the_gimbal_and_not_in_the_controller() -> None:
    subject = identified()
    every = list_causes(subject.model)
    state = StudioState(off=every[:1])
    known = build_model(subject, state)
    assert build_plant(subject, state) is subject.model
    assert list_causes(known) == every[1:]
    assert len(known.estimated.names) == len(subject.model.estimated.names) - 1
    assert tune_state(subject, state).draws > 0


def test_untouched_it_saves_what_tune_writes(tmp_path: Path, run: Run) -> None:
    """Of two logs whose torque was stamped 2.4 samples before it acted: the delay that both take is no whole one."""
    rig = bundled(RIG)
    files = [tmp_path / "one.csv", tmp_path / "two.csv"]
    for seed, file in enumerate(files):
        log = bench_log(seed).part(slice(0, 10000))
        early = np.column_stack(
            [np.interp(log.t + 0.0024, log.t, column) for column in np.transpose(log.tau)]
        )
        write_log(replace(log, tau=early), file)
    assert run("tune", RIG, *files, "-o", tmp_path / "tuned.yaml", "--plants", "1")[0] == 0
    desk = Desk(
        StudioSource(rig, tuple(read_log(file, rig) for file in files)), tmp_path / "out", {}
    )
    tuning = tune_state(desk.find_subject(desk.history.present), desk.history.present)
    saved = desk.save_file("controller.yaml", keep_controller(tuning, desk.folder))
    assert saved.read_bytes() == (tmp_path / "tuned.yaml").read_bytes()
    assert tuning.wish.delay == pytest.approx(0.0024, abs=0.0002)


def test_a_saved_controller_is_tuned_again_from_its_own_model(tmp_path: Path) -> None:
    """With the payload moved and a cause off, too: the file holds the model that it was made for."""
    subject = identified()
    state = StudioState(bandwidth_hz=6.0, x=0.01, mass=1.5, off=("viscous at tilt",))
    keep_controller(tune_state(subject, state), tmp_path)(tmp_path / "saved.yaml")
    filed = yaml.safe_load((tmp_path / "saved.yaml").read_text())
    found = stored(filed, subject.rig)
    again = tune(found.model, bandwidth_hz=6.0).to_dict()["joints"]
    for joint, row in filed["joints"].items():
        for name in ("kp", "ki", "kd", "inertia"):
            assert again[joint][name] == pytest.approx(row[name], rel=1e-9)
    kept = {*list_causes(subject.model)} - {"viscous at tilt"}
    assert {*list_causes(found.model)} == kept


def test_a_camera_swapped_there_and_back_is_the_same(tmp_path: Path) -> None:
    """And the report of the other one is of it alone."""
    own = identified()
    other = prepare_subject(StudioSource(own.rig, (), own.model), "cinema")
    back = prepare_subject(StudioSource(other.rig, (), other.model), own.rig.payload)
    assert other.rig.payload == "cinema"
    keep_report(tune_state(other, StudioState()), plants=1)(tmp_path / "report.html")
    report = (tmp_path / "report.html").read_text()
    assert "turret with cinema" in report
    assert "turret with infrared" not in report
    np.testing.assert_allclose(back.model.rig.phi, own.model.rig.phi, atol=1e-12)
    np.testing.assert_allclose(back.model.estimated.theta, own.model.estimated.theta, atol=1e-12)
    plain = prepare_subject(StudioSource(bundled(RIG)), "cinema")
    np.testing.assert_array_equal(plain.model.rig.phi, bundled(RIG, "cinema").phi)


def test_what_cannot_be_prepared_is_refused() -> None:
    bare = prepare_subject(StudioSource(bundled(RIG)), "none")
    with pytest.raises(UsageError, match="carries no payload of its own; mount one"):
        build_plant(bare, StudioState(mass=1.0))
    with pytest.raises(UsageError, match="judged part: leaves nothing"):
        prepare_subject(StudioSource(bundled(RIG), (bench_log(),)), judged=(0.0, 99.0))


def test_what_judges_does_not_train() -> None:
    """The marked part with another torque: the model is the same, the residual is not."""
    log = bench_log()
    late = (log.t - log.t[0] >= 14.0)[:, None]
    wrong = replace(log, tau=np.asarray(log.tau) + 0.3 * late)
    one, other = (
        prepare_subject(StudioSource(bundled(RIG), (each,)), judged=(14.0, 21.0))
        for each in (log, wrong)
    )
    np.testing.assert_array_equal(one.model.rig.phi, other.model.rig.phi)
    assert np.all(residual_of(other, StudioState()) > 3 * residual_of(one, StudioState()))


def test_of_several_logs_any_part_judges() -> None:
    """Marked in the second of two logs, what judges is that part, and the model that of the rest in any order."""
    logs = (bench_log(0), bench_log(1))
    late = logs[1].t - logs[1].t[0] >= 10.0
    cut = (logs[1].part(~late), logs[0], logs[1].part(late))
    marked = prepare_subject(StudioSource(bundled(RIG), logs), judged=(30.0, 41.0))
    alone = prepare_subject(StudioSource(bundled(RIG), cut))
    np.testing.assert_allclose(marked.model.rig.phi, alone.model.rig.phi, rtol=1e-6, atol=1e-9)
    found, asked = (residual_of(each, StudioState()) for each in (marked, alone))
    np.testing.assert_allclose(found, asked, rtol=1e-6)


def test_a_wider_loop_holds_the_camera_more_still() -> None:
    subject = stated()
    errors = []
    for hz in (3.0, 12.0):
        state = StudioState(bandwidth_hz=hz, off=list_causes(subject.model))
        found = simulate_pointing(subject, state, tune_state(subject, state))
        assert found is not None and found.jitter == found.run.jitter[0]
        errors.append(found.jitter)
    assert errors[1] < 0.5 * errors[0]
