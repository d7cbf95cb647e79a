"""Laws of the tuning: margins as by hand, and as the simulated loop has them; what does not fit is lowered and said."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from math import atan, pi, sqrt
from pathlib import Path
from typing import Any

import control
import numpy as np
import pytest
import yaml
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq

from gimbal_pin.control import (
    ComputedTorque,
    JointPid,
    Pid,
    ReasonKind,
    Tuning,
    compute_inertia,
    compute_margins,
    read_controller,
    sample_poses,
    sampled_loop,
    stored,
    track,
    tune,
)
from gimbal_pin.dynamics import (
    Estimated,
    Model,
    Reference,
    Sensors,
    State,
    nominal,
    plant_with,
    reduce_parameters,
    simulate,
)
from gimbal_pin.effects import ActuatorLag, Coulomb, Term, Viscous, parse_effect
from gimbal_pin.errors import ModelError, UsageError
from gimbal_pin.log import Array, Motion
from gimbal_pin.report import list_shown_joints
from gimbal_pin.rig import Limits, Motor, Rig

KEYS = {"kp", "ki", "kd", "phase_margin_deg", "gain_margin_db", "disk_margin", "bandwidth_hz"}


@pytest.fixture(scope="module")
def thesis() -> Model:
    return nominal(Rig.load("thesis"))


@pytest.fixture(scope="module")
def tuned(thesis: Model) -> Tuning:
    return tune(thesis)


# --- Margins -----------------------------------------------------------------------------------------------------


def by_hand(gains: Pid, dt: float, samples: int, omega: Any) -> Any:
    """L of a PID around the held double integrator with whole samples of delay, from its z-transform."""
    z = np.exp(1j * np.asarray(omega) * dt)
    position = dt**2 / 2 * (z + 1) / (z - 1) ** 2
    rate = dt / (z - 1)
    law = (gains.kp + gains.ki * dt * z / (z - 1)) * position + gains.kd * rate
    return law * z**-samples


@given(st.floats(2, 12), st.floats(0.5, 1.5), st.floats(0, 0.3), st.integers(0, 4))
def test_margins_are_those_computed_by_hand(
    hz: float, damping: float, integral: float, samples: int
) -> None:
    """Crossings by root finding on the z-transform; the disk margin as the least 2 |1 + L|/|1 - L|."""
    dt = 0.001
    gains = Pid.placed(hz, damping, integral)
    found = compute_margins(gains, dt, samples * dt)
    w = 2 * pi * hz
    crossover = brentq(lambda omega: abs(by_hand(gains, dt, samples, omega)) - 1, 0.5 * w, 10 * w)
    phase = np.angle(by_hand(gains, dt, samples, crossover))
    loop = by_hand(
        gains, dt, samples, np.append(np.geomspace(w / 100, pi / dt * 0.9999, 20000), pi / dt)
    )
    assert found.crossover_hz == pytest.approx(crossover / 2 / pi, rel=1e-6)
    assert found.phase_margin_deg == pytest.approx(180 + np.degrees(phase), rel=1e-6)
    assert found.delay_margin == pytest.approx((pi + phase) / crossover, rel=1e-6)
    assert found.disk_margin == pytest.approx(
        (2 * np.abs(1 + loop) / np.abs(1 - loop)).min(), rel=2e-3
    )
    crossing = np.append(np.flatnonzero(loop.imag[:-2] * loop.imag[1:-1] < 0), len(loop) - 1)
    gains_there = np.abs(loop[crossing][loop[crossing].real < 0])
    assert found.gain_margin_db == pytest.approx(np.abs(20 * np.log10(gains_there)).min(), abs=0.05)


@given(
    st.floats(2, 12),
    st.floats(0.5, 1.5),
    st.floats(0, 0.3),
    st.floats(0, 0.004),
    st.floats(1e-4, 0.004),
)
@settings(max_examples=20)
def test_margins_are_those_of_python_control(
    hz: float, damping: float, integral: float, delay: float, lag: float
) -> None:
    """Which finds crossings on a spline through the loop's values."""
    gains = Pid.placed(hz, damping, integral)
    drive = (ActuatorLag("pan", lag),)
    found = compute_margins(gains, 1e-3, delay, drive=drive)
    assume(found.disk_margin > 0.05)
    loop = sampled_loop(gains, 1e-3, delay, drive=drive)
    omega = np.geomspace(1e-2 * sqrt(gains.kp), pi / 1e-3 * (1 - 1e-9), 2000)
    peer = control.frd(loop(np.exp(1j * omega * 1e-3)), omega, dt=1e-3)
    _, phases, _, _, crossovers, _ = control.stability_margins(peer, returnall=True)
    phases = np.abs(np.atleast_1d(phases))
    assert found.phase_margin_deg == pytest.approx(phases.min(), rel=1e-4)
    assert found.crossover_hz == pytest.approx(np.max(crossovers) / (2 * pi), rel=1e-4)
    assert found.delay_margin == pytest.approx(np.min(np.radians(phases) / crossovers), rel=1e-4)


def test_without_delay_and_hold_the_phase_margin_is_the_textbooks() -> None:
    """PD on 1/s²: ω_c² = ω² (2 ζ² + √(4 ζ⁴ + 1)), margin = atan(2 ζ ω_c/ω)."""
    w = 2 * pi * 5.0
    damping = 0.7
    crossover = w * sqrt(2 * damping**2 + sqrt(4 * damping**4 + 1))
    found = compute_margins(Pid.placed(5.0, damping, 0.0), 1e-5, 0.0)
    assert found.crossover_hz == pytest.approx(crossover / 2 / pi, rel=1e-3)
    assert found.phase_margin_deg == pytest.approx(
        np.degrees(atan(2 * damping * crossover / w)), abs=0.05
    )


def test_half_a_sample_of_delay_costs_its_phase() -> None:
    """Delay between whole samples is exact too: -ω_c T, and the delay margin shrinks by T itself."""
    gains = Pid.placed(8.0, 1.0, 0.2)
    less = compute_margins(gains, 0.001, 0.001)
    more = compute_margins(gains, 0.001, 0.0015)
    assert less.delay_margin - more.delay_margin == pytest.approx(0.0005, rel=0.02)
    assert less.phase_margin_deg - more.phase_margin_deg == pytest.approx(
        360 * less.crossover_hz * 0.0005, rel=0.02
    )


def free(rig: Rig) -> Model:
    """The rig weightless, unlimited, without friction: small errors see the linear loop alone."""
    model = rig.model.copy()
    model.gravity.linear = np.zeros(3)
    return Model(
        replace(rig, model=model, motors=(Motor(),) * rig.n, limits=(Limits(),) * rig.n), ()
    )


def growth(
    plant: Model, law: ComputedTorque | JointPid, delay: int, start: Array, steps: int = 2000
) -> float:
    """Amplitude in the last quarter of a run over that in its second quarter."""
    zero = np.zeros((steps, plant.rig.n))
    motion = Motion(law.dt * np.arange(steps), zero, zero, zero)
    rng = np.random.default_rng(0)
    sensors = Sensors.exact(plant.rig.n)
    start_state = State(start, 0 * start)
    log = simulate(plant, law, motion, rng=rng, sensors=sensors, delay=delay, start=start_state)
    quarter = steps // 4
    return float(np.abs(log.q[-quarter:]).max() / np.abs(log.q[quarter : 2 * quarter]).max())


def test_the_simulated_loop_has_the_delay_margin_that_is_stated() -> None:
    """A sample less than the margin dies out, a sample more grows: simulated in full, not on paper."""
    plant = free(Rig.load("turret"))
    tuning = tune(plant)
    spare = tuning.margins[0].delay_margin / tuning.wish.dt
    start = np.array([1e-9, 1e-9])
    assert growth(plant, tuning.controller, 1 + int(spare), start) < 1
    assert growth(plant, tuning.controller, 2 + int(spare), start) > 1


def test_the_simulated_loop_has_the_gain_margin_that_is_stated() -> None:
    """Gain errors are inertia errors: a plant lighter by the margin is at the edge."""
    plant = free(Rig.load("turret"))
    tuning = tune(plant, bandwidth_hz=15)
    ratio = 10 ** (tuning.margins[0].gain_margin_db / 20)
    start = np.array([1e-9, 1e-9])
    for share, stable in ((0.95, True), (1.05, False)):
        lighter = Model(plant.rig.with_phi(plant.rig.phi / (share * ratio)), ())
        assert (growth(lighter, tuning.controller, 1, start, steps=240) < 1) == stable


# --- Wishes ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["computed-torque", "pid"])
def test_a_model_and_a_controller_are_a_few_lines_at_a_prompt(thesis: Model, kind: str) -> None:
    """However much is in them; what a model has beside bodies and plain friction stands in its line."""
    cogging = parse_effect("cogging:yaw:amplitude=0.1,harmonic=42", thesis.rig)
    known = plant_with(
        replace(thesis, drive=(parse_effect("delay:roll:time=0.005", thesis.rig),)), [cogging]
    ).plant
    said = repr(known)
    assert "\n" not in said and len(said) < 150 and "cogging at yaw, delay at roll" in said
    assert known.rig.title in said and "coulomb" not in said
    assert len(str(tune(known, kind=kind, robust=kind != "pid").controller)) < 1000


def test_three_lines_at_a_prompt(thesis: Model) -> None:
    tuning = tune(thesis)
    softer = tuning.with_(bandwidth_hz=4)
    assert softer.controller.gains[0].kp == pytest.approx(tuning.controller.gains[0].kp / 4)
    assert softer.wish == replace(tuning.wish, bandwidth_hz=4)


def test_default_reaches_what_it_wishes_with_margin(tuned: Tuning) -> None:
    assert tuned.bandwidth_hz == (8.0,) * 3
    for found in tuned.margins:
        assert (
            found.disk_margin > 1.0 and found.phase_margin_deg > 60 and found.delay_margin > 0.004
        )


@pytest.mark.parametrize("kind", ["computed-torque", "pid"])
def test_too_much_bandwidth_is_lowered_to_the_disk_margin_and_said(
    thesis: Model, kind: str
) -> None:
    tuning = tune(thesis, bandwidth_hz=60, delay=0.005, kind=kind)
    for hz, found in zip(tuning.bandwidth_hz, tuning.margins):
        assert hz < 20 and 0.5 <= found.disk_margin < 0.52
    assert any(why.kind is ReasonKind.LOWERED and "60 Hz" in why.sentence for why in tuning.reasons)
    assert not any(
        why.kind is ReasonKind.LOWERED for why in tune(thesis, bandwidth_hz=5, kind=kind).reasons
    )


def test_more_delay_leaves_less_bandwidth_and_more_disk_margin_too(thesis: Model) -> None:
    delays = (0.0, 0.002, 0.005, 0.01)
    granted = [tune(thesis, bandwidth_hz=80, delay=delay).bandwidth_hz[0] for delay in delays]
    assert granted == sorted(granted, reverse=True) and len(set(granted)) == len(delays)
    careful = tune(thesis, bandwidth_hz=80, disk_margin=1.0)
    assert careful.bandwidth_hz[0] < tune(thesis, bandwidth_hz=80).bandwidth_hz[0]
    assert 1.0 <= careful.margins[0].disk_margin < 1.03


def test_each_joint_may_have_its_own_bandwidth(thesis: Model) -> None:
    tuning = tune(thesis, bandwidth_hz={"tilt": 10, "yaw": 4, "roll": 6})
    assert tuning.bandwidth_hz == (4, 6, 10)
    assert [pid.kd for pid in tuning.gains] == sorted(pid.kd for pid in tuning.gains)


@pytest.mark.parametrize("name", ["drone", "thesis"])
def test_pid_margins_are_the_worst_over_the_poses(name: str) -> None:
    """No pose within the limits has a smaller margin than what is stated."""
    model = nominal(Rig.load(name))
    tuning = tune(model, kind="pid")
    q = sample_poses(model.rig, 200)[0][::25]
    for D in compute_inertia(model, q):
        for j, (pid, stated) in enumerate(zip(tuning.gains, tuning.margins)):
            here = compute_margins(pid, 0.001, 0.001, float(tuning.inertia[j] / D[j, j]))
            assert here.disk_margin >= stated.disk_margin - 1e-3
            assert here.delay_margin >= stated.delay_margin - 1e-5


def test_pid_of_a_heavier_payload_has_the_same_loop() -> None:
    """Its torque gains scale with the inertia, its margins at home do not change."""
    light, heavy = (
        tune(nominal(Rig.load("thesis", payload)), kind="pid") for payload in ("none", "cinema")
    )
    assert light.gains == heavy.gains
    assert all(a < b for a, b in zip(light.inertia, heavy.inertia))


@pytest.mark.parametrize(
    ("wish", "place"),
    [
        ({"bandwidth_hz": 0.0}, "bandwidth_hz"),
        ({"bandwidth_hz": float("nan")}, "bandwidth_hz"),
        ({"bandwidth_hz": {"yaw": 5}}, "roll, tilt"),
        ({"damping": -1.0}, "damping"),
        ({"delay": -0.001}, "delay"),
        ({"kind": "lqr"}, "kind"),
        ({"kind": "pid", "robust": True}, "robust"),
        ({"disk_margin": 2.5}, "disk_margin"),
    ],
)
def test_impossible_wishes_are_refused_in_one_line(
    thesis: Model, wish: dict[str, object], place: str
) -> None:
    with pytest.raises(UsageError, match=place) as caught:
        tune(thesis, **wish)  # type: ignore[arg-type]
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("wish", [{}, {"kind": "pid"}, {"damping": 0.7}])
def test_a_margin_that_cannot_be_says_which_can(tuned: Tuning, wish: dict[str, object]) -> None:
    """Both figures of the refusal may be asked for, the second with what it takes."""
    with pytest.raises(UsageError) as refused:
        tuned.with_(disk_margin=1.9, **wish)
    said = r"is ([\d.]+); ask for that, or with damping=2, integral=0 for up to ([\d.]+)"
    found_in = re.search(said, str(refused.value))
    assert found_in is not None
    most, more = found_in.groups()
    assert 0.5 < float(most) < float(more) < 1.9
    for disk, rest in ((most, {}), (more, {"damping": 2.0, "integral": 0.0})):
        found = tuned.with_(disk_margin=float(disk), **{**wish, **rest})
        assert min(margins.disk_margin for margins in found.worst) >= float(disk) - 1e-9


def test_joints_that_share_a_loop_share_a_curve(tuned: Tuning) -> None:
    legend = tuned.with_(bandwidth_hz={"yaw": 4, "roll": 6, "tilt": 6}).plot().axes[0].get_legend()
    assert legend is not None
    assert [text.get_text().split(":")[0] for text in legend.get_texts()] == ["yaw", "roll, tilt"]


def test_unknown_change_names_the_known_ones(tuned: Tuning) -> None:
    with pytest.raises(UsageError, match="bandwidth_hz"):
        tuned.with_(bandwith=3)


# --- Lyapunov redesign and uncertainty ---------------------------------------------------------------------------


def test_redesign_keeps_the_margin_it_states(thesis: Model) -> None:
    """Within the layer it is more PID; the stated margins are those of that loop, and no less than wished for."""
    for disk in (0.5, 0.8):
        tuning = tune(thesis, robust=True, disk_margin=disk)
        assert tuning.robust is not None
        for pid, row, found in zip(tuning.gains, tuning.robust.rows, tuning.margins):
            gain = tuning.robust.gain
            inside = Pid(pid.kp + gain * row[1], pid.ki + gain * row[0], pid.kd + gain * row[2])
            assert compute_margins(inside, 0.001, 0.001) == found
            assert disk <= found.disk_margin < disk + 0.05


def test_redesign_is_left_out_where_there_is_no_margin_for_it(thesis: Model) -> None:
    tuning = tune(thesis, robust=True, bandwidth_hz=60)
    assert tuning.robust is None and any(
        "no Lyapunov redesign" in str(why) for why in tuning.reasons
    )


def with_std(rig: Rig, share: float) -> Model:
    """The nominal model, every base parameter known to `share` of the torque-weighted average."""
    model = nominal(rig)
    reduction = reduce_parameters(rig)
    names = reduction.base_names + tuple(
        f"{term.effect.joint}.{c.name}" for term in model.terms for c in term.effect.coefficients
    )
    leading = [reduction.names[j].rsplit(".", 1)[1] for j in reduction.independent]
    std = [share * (0.1 if symbol.startswith("I") else 0.0) for symbol in leading] + [0.0] * (
        2 * rig.n
    )
    return replace(
        model,
        estimated=Estimated(names, ("",) * len(names), np.zeros(len(names)), np.diag(std) ** 2),
    )


def test_a_doubtful_model_makes_pid_the_advice() -> None:
    rig = Rig.load("thesis")
    sure = tune(with_std(rig, 0.001))
    doubtful = tune(with_std(rig, 0.3))
    assert not any(why.kind is ReasonKind.PID_SAFER for why in sure.reasons)
    assert any(why.kind is ReasonKind.PID_SAFER for why in doubtful.reasons)


def test_more_uncertainty_asks_for_a_larger_correction() -> None:
    rig = Rig.load("thesis")
    small, large = (tune(with_std(rig, share), robust=True).robust for share in (0.001, 0.01))
    assert small is not None and large is not None
    assert small.bounds.alpha < large.bounds.alpha / 5
    assert small.size([10.0], [0.0]) < large.size([10.0], [0.0])


# --- Files -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "wish", [{"kind": "pid"}, {}, {"robust": True}, {"bandwidth_hz": {"pan": 5.0, "tilt": 7.0}}]
)
@pytest.mark.parametrize("through", ["json", "yaml"])
def test_a_controller_survives_its_file(wish: dict[str, object], through: str) -> None:
    rig = Rig.load("turret")
    terms = (*nominal(rig).terms, Term(Coulomb("pan"), (0.01,)), Term(Viscous("tilt"), (0.02,)))
    changed = Model(rig.with_phi(rig.phi * 1.03), terms)
    tuning = tune(changed, **wish)  # type: ignore[arg-type]
    data = tuning.to_dict()
    text = json.dumps(data, allow_nan=False) if through == "json" else yaml.safe_dump(data)
    law = stored(json.loads(text) if through == "json" else yaml.safe_load(text), rig).law
    rng = np.random.default_rng(0)
    memory = again = law.start()
    for _ in range(5):
        q = 0.3 * rng.standard_normal(2)
        v = rng.standard_normal(2)
        reference = Reference(q + 0.01 * rng.standard_normal(2), v + 0.1, rng.standard_normal(2))
        tau, memory = tuning.controller.torque(0.0, q, v, reference, memory)
        back, again = law.torque(0.0, q, v, reference, again)
        np.testing.assert_array_equal(back, tau)


def test_to_dict_has_the_contracts_keys(tuned: Tuning) -> None:
    data = tuned.to_dict()
    assert data["schema"] == 1 and data["controller"] == "computed-torque"
    assert tuple(data["joints"]) == ("yaw", "roll", "tilt")
    for row in data["joints"].values():
        assert set(row) >= KEYS and all(isinstance(row[key], float) for key in KEYS)


def test_a_foreign_or_broken_file_is_refused(tuned: Tuning) -> None:
    data = tuned.to_dict()
    with pytest.raises(ModelError, match="pan, tilt"):
        stored(data, Rig.load("turret"))
    for broken in (
        {},
        {**data, "joints": None},
        {**data, "wish": {"bandwith": 3}},
        {**data, "model": {"phi": [1.0]}},
    ):
        with pytest.raises(ModelError, match="controller"):
            stored(broken, Rig.load("thesis"))


def test_plot_shows_every_loop(tuned: Tuning) -> None:
    """Each joint in its colour, between the dashes of the next, as loops may be alike."""
    figure = tuned.with_(bandwidth_hz={"yaw": 4, "roll": 6, "tilt": 8}).plot()
    gain, _nyquist, phase, step = figure.axes
    legend = gain.get_legend()
    assert legend is not None and len(legend.get_texts()) == 3
    for axes in (gain, phase, step):
        lines = axes.get_lines()[:3]
        assert [line.get_color() for line in lines] == [
            one.colour for one in list_shown_joints(tuned.model.rig)
        ]
        assert [line.is_dashed() for line in lines] == [False, True, True]
    # The gain diagram crosses 0 dB where the margins say.
    for line, hz in zip(gain.get_lines(), (4, 6, 8)):
        f, magnitude = np.array(line.get_data(), dtype=float)
        crossing = f[np.flatnonzero(magnitude > 0)[-1]]
        assert 2 * hz < crossing < 2.5 * hz
    # With integral action the disturbance is taken back to nothing.
    for line in step.get_lines():
        answer = np.asarray(line.get_ydata(), dtype=float)
        assert abs(answer[np.isfinite(answer)][-1]) < 0.5 * np.nanmax(answer)
    assert np.asarray(phase.get_lines()[0].get_ydata(), dtype=float)[0] == pytest.approx(
        -270, abs=15
    )


# --- The rate ----------------------------------------------------------------------------------------------------


def test_the_rate_is_the_logs_unless_told_and_a_rate_that_nobody_knows_is_said(
    thesis: Model,
) -> None:
    known = Estimated((), (), np.zeros(0), np.zeros((0, 0)), dt=0.004)
    logged = replace(thesis, estimated=known)
    found = tune(logged, disk_margin=1.0)
    told = tune(logged, disk_margin=1.0, dt=0.002)
    assert (found.wish.dt, found.wish.delay, found.controller.dt) == (0.004, 0.004, 0.004)
    assert (told.wish.dt, told.wish.delay) == (0.002, 0.002)
    assert found.reasons[0].sentence.startswith("sampled at 250 Hz, as the logs were")
    assert not any(why.kind is ReasonKind.ASSUMED for why in told.reasons)
    # All of a loop's times scale with its interval, and so does the bandwidth that a margin leaves.
    assert told.bandwidth_hz == pytest.approx([2 * hz for hz in found.bandwidth_hz], rel=0.02)
    # Steps are simulated with the delay that was asked for, and not with a whole slow sample.
    asked = tune(logged, delay=0.001, dt=0.01)
    steps = track(
        thesis, {"own": asked.controller}, rng=0, delay=asked.wish.samples, one_by_one=False
    ).experiments[0]
    assert max(one.saturated for one in steps.joints.values()) < 0.2
    assert "not known" in tune(thesis).reasons[0].sentence and tune(thesis).wish.dt == 0.001


def test_a_drive_is_as_late_as_the_logs_show_unless_told(thesis: Model) -> None:
    """As with that delay stated; a drive that is sooner than one sample costs that sample."""
    late, soon = (
        replace(
            thesis, estimated=Estimated((), (), np.zeros(0), np.zeros((0, 0)), dt=0.002, lags=lags)
        )
        for lags in ((0.001, 0.005, 0.003), (0.001, -0.004, 0.0))
    )
    found = tune(late, disk_margin=1.0)
    told = tune(late, disk_margin=1.0, delay=0.005)
    assert found.wish.delay == 0.005 and found.bandwidth_hz == told.bandwidth_hz
    (said,) = [why.sentence for why in found.reasons if "delay of 5 ms" in why.sentence]
    assert thesis.rig.joints[1] in said and not any(
        "delay of" in why.sentence for why in told.reasons
    )
    assert tune(soon, disk_margin=1.0).wish.delay == 0.002
    (warned,) = tune(late, delay=0.002).warnings
    assert (
        "2 ms was stated" in warned
        and f"{thesis.rig.joints[1]}'s torque to act 5 ms late" in warned
    )
    assert told.warnings == found.warnings == ()


def test_a_tuning_saves_itself_as_the_verb_does(tmp_path: Path) -> None:
    rig = Rig.load("thesis")
    found = tune(nominal(rig), bandwidth_hz=4.0)
    found.save(tmp_path / "controller.yaml")
    read = read_controller(tmp_path / "controller.yaml", rig)
    assert read.law.gains == found.stored.law.gains and read.wish == found.wish


def test_what_is_no_model_is_refused_with_where_one_is() -> None:
    with pytest.raises(UsageError, match=r"diagnose\(…\)\.after"):
        tune({"torque_rmse": 1.0})  # type: ignore[arg-type]
