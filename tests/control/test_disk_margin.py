"""Laws of asking for a disk margin: what is reported can be asked for, and nothing that hurts gives more bandwidth."""

from __future__ import annotations

import json
from dataclasses import replace
from math import inf

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq

from gimbal_pin.control import (
    Pid,
    ReasonKind,
    Wish,
    compute_inertia,
    compute_margins,
    estimate,
    sample_poses,
    stored,
    tune,
)
from gimbal_pin.control.laws.design import lowered
from gimbal_pin.control.laws.loop import smallest_disk
from gimbal_pin.control.laws.uncertainty import draw_changes, draw_inertia_ratios
from gimbal_pin.dynamics import Estimated, Model, nominal, reduce_parameters
from gimbal_pin.effects import ActuatorLag, Delay, JointFlexibility, Signal
from gimbal_pin.errors import UsageError
from gimbal_pin.log import Array
from gimbal_pin.regression import find_base_columns
from gimbal_pin.report import show_controller
from gimbal_pin.rig import Rig

DT = 0.001
KINDS = ("computed-torque", "pid")


def known(share: float, name: str = "turret") -> Model:
    """The nominal model, its base parameters known to a share of their size, correlated; one drive lags."""
    rig = Rig.load(name)
    reduction = reduce_parameters(rig)
    model = nominal(rig)
    names = reduction.base_names + tuple(f"{j}.{k}" for j in rig.joints for k in ("Fs", "Fv"))
    size = np.abs(rig.phi[find_base_columns(rig, reduction)])
    root = np.zeros((len(names), len(names)))
    mix = np.random.default_rng(1).standard_normal((len(size), len(size)))
    root[len(size) :, len(size) :] = 1e-9 * np.eye(len(names) - len(size))  # no estimate is exact
    root[: len(size), : len(size)] = (
        share * size[:, None] * mix / np.linalg.norm(mix, axis=1)[:, None]
    )
    estimated = Estimated(names, ("",) * len(names), np.zeros(len(names)), root @ root.T)
    return replace(model, estimated=estimated, drive=(ActuatorLag(rig.joints[-1], 0.002),))


@pytest.fixture(scope="module")
def model() -> Model:
    return known(0.1)


def by_hand(gains: Pid, samples: int) -> float:
    """Least 2 |1 + L|/|1 - L| of a PID around the held double integrator, from its z-transform."""
    z = np.exp(1j * DT * np.geomspace(0.01 * gains.kp**0.5, np.pi / DT, 4000))
    law = (gains.kp + gains.ki * DT * z / (z - 1)) * DT**2 / 2 * (z + 1) / (
        z - 1
    ) ** 2 + gains.kd * DT / (z - 1)
    loop = law * z**-samples
    return float((2 * np.abs(1 + loop) / np.abs(1 - loop)).min())


@given(st.floats(0.3, 1.1), st.integers(0, 6), st.floats(0.8, 1.5), st.floats(0.0, 0.2))
@settings(max_examples=8)
def test_the_search_is_exact_to_one_per_cent(
    margin: float, samples: int, damping: float, integral: float
) -> None:
    """Against root finding on the margin by hand."""
    found = lowered(
        inf, Wish(None, damping, samples * DT, DT, integral=integral, disk_margin=margin), (1.0,)
    )
    assert found is not None
    exact = brentq(
        lambda hz: by_hand(Pid.placed(hz, damping, integral), samples) - margin,
        0.7 * found,
        1.4 * found,
    )
    assert found <= exact * 1.0005 and found > 0.99 * exact


DRIVES: list[tuple[Signal, ...]] = [
    (),
    (ActuatorLag("pan", 0.004),),
    (Delay("pan", 0.0033),),
    (JointFlexibility("pan", 30.0, 0.05),),
]


@pytest.mark.parametrize("drive", DRIVES, ids=lambda drive: drive[0].name if drive else "plain")
@given(st.floats(0.0, 0.006), st.floats(0.2, 1.0), st.floats(1e-6, 0.02), st.floats(1e-6, 0.3))
@settings(max_examples=3)
def test_more_margin_or_delay_never_gives_more_bandwidth(
    drive: tuple[Signal, ...], delay: float, margin: float, more: float, further: float
) -> None:
    def highest(delay: float, margin: float) -> float:
        return (
            lowered(inf, Wish(None, 1.0, delay, DT, disk_margin=margin), (0.9, 1.0, 1.1), drive)
            or 0.0
        )

    if not any(
        isinstance(signal, JointFlexibility) for signal in drive
    ):  # a resonance may gain by a later phase
        assert highest(delay + more, margin) <= highest(delay, margin)
    assert highest(delay, margin + further) <= highest(delay, margin)


@pytest.mark.parametrize(("kind", "j"), [("computed-torque", 0), ("pid", 1)])
def test_what_a_tuning_reports_can_be_asked_for(model: Model, kind: str, j: int) -> None:
    """A bandwidth's disk margin, asked for, gives that bandwidth; and asked again, the very same gains."""
    planted = tune(model, bandwidth_hz={"pan": 5.0, "tilt": 7.0}, kind=kind, delay=0.002)
    margin = planted.worst[j].disk_margin
    asked = planted.with_(bandwidth_hz=None, disk_margin=margin)
    assert asked.bandwidth_hz[j] == pytest.approx(planted.bandwidth_hz[j], rel=0.01)
    assert all(row.disk_margin >= margin * (1 - 1e-9) for row in asked.worst)
    again = asked.with_(disk_margin=asked.worst[j].disk_margin)
    assert again.bandwidth_hz[j] == asked.bandwidth_hz[j] and again.gains[j] == asked.gains[j]


@pytest.mark.parametrize("kind", KINDS)
def test_more_uncertainty_never_gives_a_larger_worst_margin_or_more_bandwidth(kind: str) -> None:
    models = [known(share) for share in (0.0, 0.05, 0.2)]
    fixed = [tune(model, bandwidth_hz=8.0, kind=kind) for model in models]
    wish = Wish(disk_margin=0.7, kind=kind)
    asked = np.array(
        [
            [lowered(inf, wish, *row) for row in zip(f.ratios, m.drives)]
            for f, m in zip(fixed, models)
        ]
    )
    disks = np.array([[row.disk_margin for row in tuning.worst] for tuning in fixed])
    crossovers = np.array([[row.crossover_hz for row in tuning.worst] for tuning in fixed])
    assert all(tuning.bandwidth_hz == (8.0, 8.0) for tuning in fixed)
    # Ratios over the poses are rounded to six digits, those of the draws are not.
    assert disks[0] == pytest.approx([found.disk_margin for found in fixed[0].margins], rel=1e-5)
    assert np.all(np.diff(disks, axis=0) <= 0) and np.all(disks[-1] < 0.97 * disks[0])
    assert np.all(np.diff(crossovers, axis=0) >= 0)
    assert np.all(np.diff(asked, axis=0) <= 0) and asked[-1, 1] < 0.97 * asked[0, 1]


def drawn_models(model: Model, count: int) -> list[Model]:
    """The same parameter sets, as rigs of their own."""
    assert model.estimated is not None
    places = estimate(model)[1]
    assert places is not None
    sets = draw_changes(model.estimated.covariance, count, np.random.default_rng(0))
    changed = np.tile(model.rig.phi, (count, 1))
    changed[:, places] += sets[:, : len(places)]
    return [Model(model.rig.with_phi(phi), model.terms) for phi in changed]


def diagonal(model: Model, q: Array) -> Array:
    return np.asarray(np.diagonal(compute_inertia(model, q), axis1=1, axis2=2))


@pytest.fixture(scope="module")
def turned(model: Model) -> Array:
    """Inertia that each joint turns, kg m², (200, poses, n): each drawn rig's own, by Pinocchio."""
    q = sample_poses(model.rig)[0]
    return np.array([diagonal(one, q) for one in drawn_models(model, 200)])


@pytest.mark.parametrize("kind", KINDS)
def test_the_worst_is_that_of_every_drawn_rig(model: Model, turned: Array, kind: str) -> None:
    """None of the 200 has less margin at any pose, and one has that."""
    tuning = tune(model, disk_margin=0.8, kind=kind)
    q = sample_poses(model.rig)[0]
    believed = diagonal(model, q) if kind == "computed-torque" else np.array(tuning.inertia)
    ratios = believed / turned
    assert tuning.draws == len(turned) and np.all(turned > 0)
    for j, (pid, least, drive) in enumerate(zip(tuning.gains, tuning.worst, model.drives)):
        every = np.concatenate([ratios[:, :, j].min(axis=1), ratios[:, :, j].max(axis=1)])
        lowest = smallest_disk(pid, DT, 0.001, tuple(every.tolist()), drive)
        assert lowest >= least.disk_margin * (1 - 1e-6)
        if kind == "computed-torque":  # a PID's poses are more, and may be worse
            assert lowest == pytest.approx(least.disk_margin, rel=1e-6)
            assert least.crossover_hz == pytest.approx(
                compute_margins(pid, DT, 0.001, every.max(), drive).crossover_hz
            )


def test_a_clock_twice_as_slow_halves_the_bandwidth() -> None:
    """Hz are per second, margins have no unit: all times doubled, the same loop."""
    plain = nominal(Rig.load("turret"))
    fast, slow = (
        tune(plain, disk_margin=0.9, delay=scale * 0.0015, dt=scale * DT) for scale in (1, 2)
    )
    assert slow.bandwidth_hz == pytest.approx([hz / 2 for hz in fast.bandwidth_hz])
    for a, b in zip(fast.worst, slow.worst):
        assert (a.disk_margin, a.phase_margin_deg) == pytest.approx(
            (b.disk_margin, b.phase_margin_deg), rel=1e-6
        )
        assert a.crossover_hz == pytest.approx(2 * b.crossover_hz, rel=1e-6)
    light = Model(plain.rig.with_phi(plain.rig.phi / 7), plain.terms)
    assert tune(light, disk_margin=0.9, delay=0.0015).gains == fast.gains


def test_the_other_wishes_are_kept(model: Model) -> None:
    tuning = tune(model, disk_margin=1.0, delay=0.002)
    slower = tuning.with_(bandwidth_hz=2.0)
    faster = tuning.with_(bandwidth_hz=80.0)
    assert slower.bandwidth_hz == (2.0, 2.0) and slower.wish == replace(
        tuning.wish, bandwidth_hz=2.0
    )
    assert (
        faster.bandwidth_hz == tuning.bandwidth_hz and faster.reasons[0].kind is ReasonKind.LOWERED
    )
    assert any("highest that keeps a disk margin of 1 " in str(reason) for reason in tuning.reasons)
    late = tuning.with_(delay=0.004)
    assert late.wish.disk_margin == 1.0 and all(
        a < b for a, b in zip(late.bandwidth_hz, tuning.bandwidth_hz)
    )


def test_redesign_leaves_its_share_and_keeps_the_margin(model: Model) -> None:
    tuning = tune(model, disk_margin=0.9, robust=True)
    assert tuning.robust is not None and min(
        row.disk_margin for row in tuning.worst
    ) == pytest.approx(0.9, abs=0.02)
    assert all(row.disk_margin >= 0.9 * (1 - 1e-9) for row in tuning.worst)


def test_a_margin_that_no_bandwidth_keeps_is_refused_and_one_that_nobody_asked_for_is_not() -> None:
    doubtful = known(3.0)
    with pytest.raises(UsageError, match="disk_margin") as caught:
        tune(doubtful, disk_margin=1.0)
    assert "\n" not in str(caught.value) and "identify the inertias better" in str(caught.value)
    with pytest.raises(UsageError, match="disk_margin"):
        tune(nominal(Rig.load("turret")), disk_margin=1.9)
    unsure = tune(doubtful)
    assert unsure.bandwidth_hz == (8.0, 8.0) and min(row.disk_margin for row in unsure.worst) < 0.5
    assert any(reason.kind is ReasonKind.UNCERTAIN for reason in unsure.reasons)


@pytest.mark.parametrize("kind", KINDS)
def test_a_loop_is_doubted_where_half_the_inertia_is_possible(kind: str) -> None:
    """Deviations of a share of the inertias: small ones leave no doubt, large ones do, and that is told first."""
    sure = tune(known(0.02), kind=kind)
    unsure = tune(known(1.0), kind=kind)
    assert sure.doubts == () and sure.to_dict()["doubts"] == []
    assert unsure.doubts and show_controller(unsure).to_text().startswith(
        f"Warning\n  {unsure.doubts[0]}"
    )
    gains = draw_inertia_ratios(unsure.model, kind, np.random.default_rng(0))
    assert gains is not None
    doubted = {joint for line in unsure.doubts for joint in line.split(": ")[0].split(", ")}
    assert doubted == {
        joint for joint, (_, _, most) in zip(unsure.model.rig.joints, gains) if most >= 2
    }


def test_it_is_told_in_json_and_text(model: Model) -> None:
    tuning = tune(model, disk_margin=1.0)
    plain = tune(nominal(model.rig), disk_margin=1.0)
    data = json.loads(json.dumps(tuning.to_dict(), allow_nan=False))
    assert (
        data["draws"] == 200
        and data["wish"]["disk_margin"] == 1.0
        and data["wish"]["bandwidth_hz"] is None
    )
    for found, row in zip(tuning.worst, data["joints"].values()):
        assert row["worst_of_draws"]["disk_margin"] == found.disk_margin
        assert {"phase_margin_deg", "crossover_hz"} <= set(row["worst_of_draws"])
    assert stored(data, Rig.load("turret")) is not None
    assert "worst of 200 draws" in show_controller(tuning).to_text()
    assert "worst of 200" not in show_controller(plain).to_text()
    rows = plain.to_dict()
    assert rows["draws"] == 0 and all(
        row["worst_of_draws"] is None for row in rows["joints"].values()
    )
    assert draw_inertia_ratios(plain.model, "pid", np.random.default_rng(0)) is None


def test_plot_keeps_every_draw_off_the_disk(model: Model) -> None:
    nyquist = tune(model, disk_margin=0.7).plot().axes[1]
    edge = nyquist.patches[0].get_xy()
    centre = edge.mean(axis=0)
    radius = np.ptp(edge[:, 0]) / 2
    lines = [np.array(line.get_data(), dtype=float) for line in nyquist.get_lines()[:-1]]
    nearest = [np.hypot(*(line - np.array([[centre[0]], [0.0]]))).min() for line in lines]
    assert (
        len(lines) == 6
        and min(nearest) == pytest.approx(radius, rel=0.02)
        and min(nearest) > 0.98 * radius
    )
