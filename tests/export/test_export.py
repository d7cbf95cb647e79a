"""Controllers as C99: they compile everywhere, give Python's torques, and bear what Python bears."""

from __future__ import annotations

import subprocess
from dataclasses import replace
from math import inf, nan
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gimbal_pin.control import Ahead, BaseState, tune
from gimbal_pin.dynamics import Model, Reference, nominal
from gimbal_pin.effects import Sample, Term
from gimbal_pin.errors import ModelError
from gimbal_pin.export import Chain, LawEquations, Library, NavigationEquations
from gimbal_pin.export.compiled import at, single
from gimbal_pin.export.symbolic import checked, table, terms
from gimbal_pin.log import write_yaml
from gimbal_pin.pointing import (
    WANTED,
    Level,
    Measurement,
    Sight,
    attitude,
    draw_profile,
    leveled,
    simulate_holding,
)
from gimbal_pin.pointing.sight import STEEP
from gimbal_pin.rig import Rig
from tests.command_line import Run, refused, result
from tests.effects.test_effects import TORQUES, planted
from tests.exported import (
    COMPILERS,
    EVERYTHING,
    STRICTER,
    CompiledPointer,
    Side,
    Twin,
    built,
    compile_,
    floats,
    has,
    holding_gap,
    modelled,
    sources,
    tracking_gap,
)
from tests.failing_sensors import FailingSensors, SensorFault
from tests.rigs import bundled, chain, spelled

pytest.importorskip("casadi")
compiled_here = pytest.mark.skipif(not has("gcc"), reason="no C compiler")


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Twin:
    """Computed torque of the thesis's rig."""
    return built(modelled(bundled("thesis", "mirrorless")), tmp_path_factory.mktemp("plain"))


@pytest.fixture(scope="module")
def full(tmp_path_factory: pytest.TempPathFactory) -> Twin:
    """Everything that a controller may have: Lyapunov redesign, terms of every kind, drives that differ."""
    model = modelled(bundled("handheld", "cinema"), EVERYTHING)
    return built(model, tmp_path_factory.mktemp("full"), robust=True)


@pytest.fixture(scope="module")
def pid(tmp_path_factory: pytest.TempPathFactory) -> Twin:
    """A PID of a rig with two axes and no gyro between."""
    return built(
        modelled(bundled("turret", "zoom-lens")), tmp_path_factory.mktemp("pid"), kind="pid"
    )


# --- Equations -----------------------------------------------------------------------------------------------------


SEVERAL = pytest.mark.parametrize(
    "rig", [bundled("thesis"), bundled("turret"), chain(1), chain(5)], ids=lambda rig: rig.name
)


@SEVERAL
def test_the_equations_are_pinocchios(rig: Rig) -> None:
    """`checked` refuses what differs by more than 1e-12, and finds a rig whose bodies weigh otherwise."""
    chained = Chain(rig)
    functions = [chained.torque(), chained.camera(), chained.drift(), chained.between()]
    assert checked(rig, functions, Sight(rig), np.random.default_rng(0)) < 1e-12
    with pytest.raises(ModelError, match="Pinocchio"):
        checked(rig, functions, Sight(rig.with_phi(rig.phi * 1.001)), np.random.default_rng(0))


@SEVERAL
def test_the_view_is_pythons_near_singular_poses_too(rig: Rig) -> None:
    sight = Sight(rig)
    rng = np.random.default_rng(0)
    view = NavigationEquations(Chain(rig)).build_view()
    steep = []
    for _ in range(200):
        q = rng.uniform(-np.pi, np.pi, rig.n)
        right = sight.view(q)
        R, against, damped = (np.array(x) for x in view(STEEP, 1 / (2 * STEEP), q))
        assert R.ravel() == pytest.approx(right.R.ravel(), abs=1e-12)
        assert against.ravel() == pytest.approx(right.against.ravel(), rel=1e-9, abs=1e-9)
        assert bool(damped.item()) == right.steep
        steep.append(right.steep)
    assert any(steep) or rig.n > 3


@pytest.mark.parametrize("name", TORQUES)
def test_a_term_is_the_causes_own_formula(name: str) -> None:
    """At a sample whose memory nobody keeps, as a controller evaluates it."""
    rng = np.random.default_rng(1)
    rig = bundled("thesis")
    term: Term = planted(name, rng)
    function, values = terms(Model(rig, (term,)))
    j = rig.joint_index("tilt")
    for _ in range(20):
        columns = rng.normal(size=(6, rig.n))
        columns[3] = np.clip(columns[3], -1, 1)
        q, v, a, slide, tau, weight = columns[:, j].tolist()
        right = (
            0.0
            if term.effect.affine
            else float(term.torque(Sample(2.0, q, v, a, slide, tau, weight=weight)))
        )
        found = np.array(function(values or [0.0], 2.0, *columns)).ravel()
        assert found[j] == pytest.approx(right, rel=1e-12, abs=1e-15)
        assert not np.delete(found, j).any()


def test_the_laws_equations_are_pythons(full: Twin) -> None:
    """In double precision, before the drives: what C is generated from gives what Python's law gives."""
    model = Model(full.stored.model.rig, full.stored.model.terms)
    rng = np.random.default_rng(0)
    law = replace(full.pointer.law, model=model)
    made = LawEquations(Chain(model.rig), model, True)
    n = model.rig.n
    feedback = made.build_feedback()
    torque = made.build_moving_torque()
    loops = list(zip(*law.outer.rows))
    robust = law.robust
    redesign = (
        np.ravel(robust.rows),
        robust.bounds.alpha,
        robust.bounds.inverse * robust.bounds.phi,
        robust.gain,
    )
    friction = law.friction.constant, law.friction.per_slide, law.friction.per_rate, made.values
    for _ in range(50):
        e, rate, integral, a, v = rng.normal(0, (0.1, 1, 0.01, 2, 0.1), (n, 5)).T
        base = rng.normal((0, 0, 9.81), 1), rng.normal(0, 0.5, 3), rng.normal(0, 5, 3)
        y = law.outer.feedback(e.tolist(), (integral + law.dt * e).tolist(), rate.tolist())
        right = y + np.array(law.robust.correction(integral + law.dt * e, e, rate, a, y))
        found = feedback(law.dt, *loops, *redesign, np.zeros(n), np.zeros(n), e, rate, integral, a)[
            3
        ]
        assert np.array(found).ravel() == pytest.approx(right, rel=1e-9)
        right = law.at(0.5, Ahead(e, v, a, BaseState(*base)), y)
        found = torque(law.dt, *friction, 0.5, e, v, a, *base, y)
        assert np.array(found).ravel() == pytest.approx(np.array(right), rel=1e-9)


def test_the_levels_equation_is_pythons(full: Twin) -> None:
    """In double precision, from a world that is a tenth of a radian askew, seen from any attitude that is wanted."""
    sight = full.pointer.navigator.sight
    rng = np.random.default_rng(0)
    level = Level(0.01, span=1.0)
    step = NavigationEquations(Chain(sight.rig)).build_level()
    memory = level.start(sure=False)
    wanted = attitude(0.4, 0.3)
    count = 0.0
    means = np.zeros(9)
    for _ in range(200):
        to = sight.attitude(rng.normal(0, 0.5, sight.rig.n))
        camera = attitude(*rng.normal(0, 0.5, 3))
        f = to @ camera.T @ attitude(0, 0.1) @ rng.normal((0, 0, 9.81), 0.1)
        memory = level.step(memory, camera @ to.T @ f)
        here, own = Rotation.from_matrix([to, wanted.T @ camera]).as_quat(scalar_first=True)
        given = wanted[2], level.eased, count, means, here, f, own
        count, means, turned = step(level.dt, 9.81, level.span / level.dt, *given)
        found = Rotation.from_quat(np.array(turned).ravel(), scalar_first=True).as_matrix()
        assert np.abs(found - wanted.T @ memory.turn @ camera).max() < 1e-12


SHAPES = [
    "dead-zone:tilt:width=0.1",
    "dead-zone:tilt:width=0.01,sharpness=3",
    "saturation:tilt:limit=2,knee=3",
]


@pytest.mark.parametrize("cause", SHAPES)
def test_a_table_of_commands_is_as_close_as_it_says(cause: str) -> None:
    from gimbal_pin.control.laws.computed_torque import invert_drive

    (drive,) = [own for own in modelled(bundled("thesis"), [cause]).drives if own]
    points = np.array(table(lambda torque: invert_drive(drive, torque), 3.6))
    assert (np.diff(points[:, 0]) > 0).all()
    torque = np.random.default_rng(0).uniform(-3.6, 3.6, 2000)
    right = np.array([invert_drive(drive, float(x)) for x in torque])
    off = np.abs(np.interp(torque, *points.T) - right)[np.abs(right) < 3.6]
    assert off.max() < 3e-6 * 3.6
    assert table(lambda torque: torque, 3.6) == []


# --- Sources -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("which", "compiler"), [*zip(["full"] * len(COMPILERS), COMPILERS), ("pid", "gcc")]
)
def test_it_compiles_without_a_warning(
    compiler: str, which: str, request: pytest.FixtureRequest
) -> None:
    if not has(compiler):
        pytest.skip(f"no {compiler}")
    tested: Twin = request.getfixturevalue(which)
    compile_(
        tested.folder,
        COMPILERS[compiler],
        *STRICTER,
        "-O1",
        "-fsyntax-only",
        *sources(tested.folder),
        "main.c",
    )


# --- Torques -------------------------------------------------------------------------------------------------------


@compiled_here
@pytest.mark.parametrize("which", ["plain", "full", "pid"])
def test_torques_are_pythons(which: str, request: pytest.FixtureRequest) -> None:
    """Within 1e-5 of the limit, and most of them not at the limit, where anything agrees."""
    tested: Twin = request.getfixturevalue(which)
    rng = np.random.default_rng(0)
    gaps = np.array([tracking_gap(tested, rng) for _ in range(200)])
    assert gaps[:, 0].max() < 1e-5 and gaps[:, 1].mean() < 0.6
    if which != "pid":
        gaps = np.array([holding_gap(tested, rng) for _ in range(200)])
        assert gaps[:, 0].max() < 1e-5 and gaps[:, 1].mean() < 0.6


FAULTS = [
    (
        SensorFault("frozen", ("w", "f"), 0.05, 0.12),
        SensorFault("nan", ("links",), 0.3, 0.35),
        SensorFault("dropped", (), 0.4, 0.41),
        SensorFault("clock", (), 0.45, step=-1.0),
    ),
    (
        SensorFault("nan", ("q",), 0.05, 0.1),
        SensorFault("nan", ("gyro",), 0.3, 0.35),
        SensorFault("nan", ("w", "f"), 0.5, 0.51),
    ),
]
"""Faults of the sensors, one case each."""


@compiled_here
@pytest.mark.parametrize("kind", ["computed-torque", "pid"])
def test_a_continuous_joints_torque_does_not_jump_where_its_encoder_wraps(
    kind: str, tmp_path: Path
) -> None:
    """The error of a joint without stops is that of the shorter way round, in C and in Python; tilt has stops."""
    text = bundled("turret").urdf.replace(
        'name="pan" type="revolute"', 'name="pan" type="continuous"'
    )
    tested = built(nominal(spelled(text)), tmp_path, kind)
    assert tested.stored.model.rig.continuous == (True, False)
    v = np.array([1.0, 0.0])
    zero = np.zeros(2)
    for law in (tested.stored.law, tested.law, tested.pointer.fallback):
        for turns in (-3, -1, 1):
            for angle in (3.1, np.pi, 3.2):
                q = np.array([angle, 0.1])
                goal = Reference(q + np.array([0.01, -0.01]), v, zero)
                inside, wrapped = (
                    law.torque(0.0, q + 2 * np.pi * np.array([k, 0]), v, goal, law.start())[0]
                    for k in (0, turns)
                )
                assert wrapped == pytest.approx(
                    inside, abs=2e-3 * tested.stored.model.tau_max.max()
                )
        lost = law.torque(
            0.0, np.array([0.0, 2 * np.pi]), zero, Reference(zero, zero, zero), law.start()
        )[0]
        assert abs(lost[1]) > 0.9 * tested.stored.model.tau_max[1]


@compiled_here
@pytest.mark.parametrize("faults", FAULTS)
def test_the_same_sensors_give_the_same_torques(
    plain: Twin, faults: tuple[SensorFault, ...]
) -> None:
    """Sample by sample from profile S with failing sensors, nothing fed back: what differs is rounding, integrated."""
    model = plain.stored.model
    side = Side(plain)
    ground = draw_profile(model.rig, 0.6, 0)
    holder = FailingSensors(side, faults)  # type: ignore[arg-type]
    simulate_holding(model, holder, ground, rng=np.random.default_rng(0), seconds=0.6)
    assert max(side.gaps) < 2e-3 and float(np.median(side.gaps)) < 2e-4


@compiled_here
@pytest.mark.parametrize("which", ["plain", "pid"])
def test_the_turn_at_the_start_is_the_same(which: str, request: pytest.FixtureRequest) -> None:
    """Sensors of a camera that turns as it should, on a base that stands: the same torques all along."""
    tested: Twin = request.getfixturevalue(which)
    side = Side(tested)
    navigator = tested.pointer.navigator
    rng = np.random.default_rng(0)
    sight = navigator.sight
    n = tested.library.n
    q = floats(np.array([1.0, -0.3, 0.4])[:n])
    turn = navigator.pace.turn(sight, np.eye(3), q, WANTED, 0.0)
    assert turn is not None
    seen = resting(tested, rng, 0)._replace(q=q)
    memory = None
    for k in range(1200):
        left, speed, _ = turn.progress(1e-3 * k)
        q = turn.goal + left * turn.way
        v = speed * turn.way
        seen = resting(tested, rng, k)
        rates = sight.rates(q, v, np.zeros(3))
        seen = seen._replace(q=q, gyro=seen.gyro + rates[:3], links=seen.links + rates[3:])
        memory = side.start(seen, sight.attitude(q), np.eye(3)) if memory is None else memory
        _, memory = side.torque(seen, memory)
    assert max(side.gaps) < 2e-3 and float(np.median(side.gaps)) < 2e-4


@compiled_here
def test_a_base_that_is_not_level_is_leveled_alike(plain: Twin) -> None:
    """The accelerometer says that the world is a milliradian askew: the same torques while that is corrected."""
    navigator = plain.pointer.navigator
    rng = np.random.default_rng(0)
    level = Level(1e-3)
    pointer = replace(plain.pointer, navigator=replace(navigator, level=level))
    camera = navigator.sight.attitude
    start = resting(plain, rng, 0)
    held = pointer.start(start, camera(start.q), np.eye(3))
    held = held._replace(known=held.known._replace(upright=level.start(sure=False)))
    c = plain.compiled.start(start, camera(start.q), np.eye(3), level.eased)
    gaps = []
    sizes = []
    for k in range(1500):
        seen = resting(plain, rng, k)
        seen = seen._replace(
            **{name: floats(getattr(seen, name)) for name in ("q", "gyro", "w", "links")}
        )
        seen = seen._replace(f=floats(attitude(0, 1e-3, -5e-4) @ seen.f))
        right, held = pointer.torque(seen, held)
        found, c = plain.compiled.torque(seen, c)
        gaps.append(float(np.abs((found - right) / plain.stored.model.tau_max).max()))
        sizes.append(float(np.abs(right / plain.stored.model.tau_max).max()))
    assert max(gaps) < 2e-3 and float(np.median(gaps)) < 2e-4 and max(sizes) > 0.1


@compiled_here
def test_one_sample_levels_alike(plain: Twin) -> None:
    """Attitudes of camera, base and what is wanted, by the accelerometer of one sample."""
    rng = np.random.default_rng(0)
    library = plain.library
    sight = plain.pointer.navigator.sight
    for _ in range(50):
        seen = resting(plain, rng, 0)._replace(
            f=rng.normal(0, 10, 3), q=rng.normal(0, 1, library.n)
        )
        known = np.zeros(13, np.float32)
        sensors = single(0.0, *seen[1:])
        library.code.gimbal_attitudes_level(library.parameters, at(sensors), at(known))
        found = Rotation.from_quat(known[:12].reshape(3, 4), scalar_first=True).as_matrix()
        base = leveled(seen.f)
        camera = leveled(seen.f) @ sight.attitude(seen.q)
        assert np.abs(found - [camera, base, camera]).max() < 1e-6
        assert known[12] == 1.0


@compiled_here
def test_what_is_out_of_reach_is_refused_alike(plain: Twin) -> None:
    """Then the camera is held where it looks: torques are those of a start that wanted nothing else."""
    navigator = plain.pointer.navigator
    rng = np.random.default_rng(0)
    library = plain.library
    sight = navigator.sight
    outcomes = []
    for _ in range(60):
        wanted = attitude(*rng.uniform(-np.pi, np.pi, 3))
        seen = resting(plain, rng, 0)
        camera = sight.attitude(seen.q)
        refused = (
            sight.obstacle(sight.reached(np.eye(3), wanted, sight.home), np.eye(3), wanted)
            is not None
        )
        turned, held = (
            CompiledPointer(library, replace(navigator, wanted=R)) for R in (wanted, camera)
        )
        memories = [holder.start(seen, camera, np.eye(3)) for holder in (turned, held)]
        same = True
        for k in range(1, 30):
            seen = resting(plain, rng, k)
            torques, memories = zip(
                *[holder.torque(seen, m) for holder, m in zip((turned, held), memories)]
            )
            same = same and bool((torques[0] == torques[1]).all())
        assert same == refused
        outcomes.append(refused)
    assert 5 < sum(outcomes) < 55


@compiled_here
def test_hostile_sensors_never_give_a_torque_that_is_none(full: Twin) -> None:
    rng = np.random.default_rng(0)
    c = full.compiled
    n = full.library.n
    good = Measurement(0.0, np.zeros(n), *(rng.normal(0, 0.1, 3) for _ in range(4)))
    memory = c.start(good, np.eye(3), np.eye(3))
    for k in range(1000):
        seen = Measurement(1e-3 * k, *(rng.normal(0, 0.1, size) for size in (n, 3, 3, 3, 3)))
        for name in ("q", "gyro", "w", "f", "links"):
            if rng.random() < 0.2:
                getattr(seen, name)[rng.integers(3)] = rng.choice(
                    [nan, inf, -inf, 1e30, -3e38, 1e5, 1e-42]
                )
        tau, memory = c.torque(seen._replace(t=rng.choice([seen.t, 0.0, 1e6])), memory)
        assert (np.abs(tau) <= full.stored.model.tau_max * (1 + 1e-6)).all()
    still = np.zeros(n)
    tau, _ = full.law.torque(
        0.0, np.full(n, nan), still, Reference(still, still, still), full.law.start()
    )
    assert not tau.any()


def resting(twin: Twin, rng: np.random.Generator, k: int) -> Measurement:
    """A sample of a gimbal that looks where it shall, on a base that stands."""
    links = 3 * len(twin.pointer.navigator.sight.moved)
    q, gyro, w, more = (1e-4 * rng.standard_normal(size) for size in (twin.library.n, 3, 3, links))
    return Measurement(
        1e-3 * k, q, gyro, w, np.array([0.0, 0.0, 9.81]) + 1e-3 * rng.standard_normal(3), more
    )


@compiled_here
@pytest.mark.parametrize(
    ("channels", "huge"), [(("q",), 1e6), (("f",), 1e20), (("q", "gyro", "w", "f", "links"), 3e38)]
)
def test_huge_finite_readings_are_refused_and_the_torque_comes_back(
    plain: Twin, channels: tuple[str, ...], huge: float
) -> None:
    for holder in (plain.compiled, plain.pointer):
        rng = np.random.default_rng(0)
        looking = plain.pointer.navigator.sight.attitude(np.zeros(plain.library.n))
        memory = holder.start(resting(plain, rng, 0), WANTED, WANTED @ looking.T)
        torques = []
        for k in range(1, 600):
            seen = resting(plain, rng, k)
            for name in channels if 100 <= k < 200 else ():
                getattr(seen, name)[:] = huge
            tau, memory = holder.torque(seen, memory)
            torques.append(tau)
        before = np.mean(torques[50:99], axis=0)
        after = np.mean(torques[-50:], axis=0)
        assert np.abs(after - before).max() < 0.05 * plain.library.limit.min() and after.any()


@compiled_here
def test_a_law_without_numbers_begins_anew(plain: Twin) -> None:
    for holder in (plain.compiled, plain.pointer):
        rng = np.random.default_rng(0)
        memory = holder.start(resting(plain, rng, 0), np.full((3, 3), nan), np.eye(3))
        torques = []
        for k in range(1, 60):
            tau, memory = holder.torque(resting(plain, rng, k), memory)
            torques.append(tau)
        assert not np.any(torques[:19]) and np.all(np.any(torques[22:], axis=1))
        assert np.abs(torques[-1]).max() < plain.library.limit.min()
    assert any("begins anew" in event for event in memory.events)


@compiled_here
@pytest.mark.parametrize("huge", [1e6, 1e20, 3e38])
def test_a_reference_is_followed_again_after_huge_readings(plain: Twin, huge: float) -> None:
    n = plain.library.n
    law = plain.law
    still = np.zeros(n)
    memory = law.start()
    reference = Reference(still, still, still)
    before, memory = law.torque(0.0, still, still, reference, memory)
    for q, v in ((huge, 0.0), (0.0, huge), (-huge, huge)):
        for k in range(100):
            tau, memory = law.torque(1e-3 * k, np.full(n, q), np.full(n, v), reference, memory)
            assert not tau.any()
        tau, memory = law.torque(0.1, still, still, reference, memory)
        np.testing.assert_allclose(tau, before, atol=1e-6)


# --- The verb ------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def controller(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("yaml") / "controller.yaml"
    write_yaml(tune(nominal(bundled("turret"))).to_dict(), path)
    return path


def test_export_writes_sources_that_say_what_they_cost(
    run: Run, controller: Path, tmp_path: Path
) -> None:
    found = result(run, "export", controller, "--c", tmp_path / "out")
    assert {path.name for path in (tmp_path / "out").iterdir()} == {*found["files"], "run.json"}
    readme = (tmp_path / "out" / "README.md").read_text()
    assert (
        str(found["memory_bytes"]) in readme and str(found["operations"]["moving_torque"]) in readme
    )
    assert found["difference_from_pinocchio"] < 1e-12


def test_export_refuses_what_is_no_controller_of_the_rig(
    run: Run, controller: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    refused(
        run("export", controller, "--c", out, "--rig", "thesis"), 2, "is for the joints pan, tilt"
    )
    (tmp_path / "model.yaml").write_text("rig: turret\n")
    refused(run("export", tmp_path / "model.yaml", "--c", out), 2, "holds no controller")
    text = controller.read_text()
    (tmp_path / "own.yaml").write_text(text.replace("rig: turret", "rig: mine"))
    refused(run("export", tmp_path / "own.yaml", "--c", out), 2, "--rig", "mine")
    (tmp_path / "bad.yaml").write_text(text.replace("kp:", "kq:"))
    refused(run("export", tmp_path / "bad.yaml", "--c", out), 2, "kp")
    assert not out.exists()


@compiled_here
def test_a_library_of_another_rig_or_none_is_refused(pid: Twin, tmp_path: Path) -> None:
    with pytest.raises(ModelError, match="is for the joints pan, tilt"):
        Library.load(pid.library.path, bundled("thesis"))
    (tmp_path / "text.so").write_text("no library")
    with pytest.raises(ModelError, match="cannot be loaded"):
        Library.load(tmp_path / "text.so", bundled("turret"))
    (tmp_path / "other.c").write_text(
        "int nothing(void);\nint nothing(void)\n{\n    return 0;\n}\n"
    )
    compile_(tmp_path, COMPILERS["gcc"], "-fPIC", "-shared", "-o", "other.so", "other.c")
    with pytest.raises(ModelError, match="holds no controller"):
        Library.load(tmp_path / "other.so", bundled("turret"))


@compiled_here
def test_the_compiled_controller_runs_beside_pythons(run: Run, pid: Twin, tmp_path: Path) -> None:
    """A PID has no feed-forward that chatters: on the same seed both logs agree but for rounding."""
    write_yaml(
        tune(nominal(bundled("turret", "zoom-lens")), kind="pid").to_dict(), tmp_path / "pid.yaml"
    )
    logs = []
    for index, law in enumerate((pid.library.path, tmp_path / "pid.yaml")):
        path = tmp_path / f"{index}.csv"
        words = (
            "--payload",
            "zoom-lens",
            "--controller",
            law,
            "--seconds",
            0.3,
            "--encoder-bits",
            40,
            "-o",
            path,
        )
        code, _, err = run("simulate", "turret", *words)
        assert code == 0, err
        logs.append(np.genfromtxt(path, delimiter=",", names=True))
    for name in logs[0].dtype.names:
        np.testing.assert_allclose(logs[0][name], logs[1][name], atol=1e-4)


@compiled_here
def test_the_compiled_controller_holds_the_camera_as_pythons(plain: Twin) -> None:
    """On profile S both leave the same jitter, the sensors' noise and the encoders' steps fed back."""
    model = plain.stored.model
    ground = draw_profile(model.rig, 2.6, 0)
    python, compiled = (
        simulate_holding(model, holder, ground, rng=np.random.default_rng(0), seconds=2.6).jitter[0]
        for holder in (plain.pointer, plain.compiled)
    )
    assert compiled == pytest.approx(python, rel=0.02)


@compiled_here
def test_a_foreign_library_is_refused_before_its_constructor_runs(tmp_path: Path) -> None:
    touched = tmp_path / "touched"
    code = tmp_path / "other.c"
    code.write_text(
        f'#include <stdio.h>\n__attribute__((constructor)) static void run(void) {{ fopen("{touched}", "w"); }}\n'
        "const char *gimbal_about(void) { return 0; }\n"
    )
    subprocess.run(["gcc", "-shared", "-fPIC", "-o", tmp_path / "other.so", code], check=True)
    with pytest.raises(ModelError, match="holds no controller"):
        Library.load(tmp_path / "other.so", bundled("turret"))
    assert not touched.exists()
