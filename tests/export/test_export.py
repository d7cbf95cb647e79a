"""Controllers as C99: they compile everywhere, give Python's torques, and bear what Python bears."""

from __future__ import annotations

from dataclasses import replace
from math import inf, nan
from pathlib import Path

import numpy as np
import pytest

from gimbal_pin.control import tune
from gimbal_pin.dynamics import Model, Reference, nominal
from gimbal_pin.effects import Sample
from gimbal_pin.errors import ModelError
from gimbal_pin.export import Chain, Library, NavigationEquations
from gimbal_pin.export.symbolic import checked, terms
from gimbal_pin.log import Array
from gimbal_pin.pointing import (
    WANTED,
    Level,
    Measurement,
    Sight,
    attitude,
    draw_profile,
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
LEVEL = np.eye(3)
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
    """A PID of a rig with two axes and no gyro between, whose first joint has no stops."""
    text = bundled("turret").urdf
    endless = text.replace('name="pan" type="revolute"', 'name="pan" type="continuous"')
    return built(nominal(spelled(endless)), tmp_path_factory.mktemp("pid"), kind="pid")


# --- Equations -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("rig", [bundled("thesis"), chain(1), chain(5)], ids=lambda rig: rig.name)
def test_the_equations_are_pinocchios(rig: Rig) -> None:
    """To 1e-12; a rig whose bodies weigh otherwise is found."""
    chained = Chain(rig)
    functions = [chained.torque(), chained.camera(), chained.drift(), chained.between()]
    assert checked(rig, functions, Sight(rig), np.random.default_rng(0)) < 1e-12
    with pytest.raises(ModelError, match="Pinocchio"):
        checked(rig, functions, Sight(rig.with_phi(rig.phi * 1.001)), np.random.default_rng(0))


@pytest.mark.parametrize("rig", [bundled("thesis"), bundled("turret"), chain(5)])
def test_the_view_is_pythons_near_singular_poses_too(rig: Rig) -> None:
    sight = Sight(rig)
    view = NavigationEquations(Chain(rig)).build_view()
    for q in np.random.default_rng(0).uniform(-np.pi, np.pi, (200, rig.n)):
        right = sight.view(q)
        R, against, damped = map(np.array, view(STEEP, 1 / (2 * STEEP), q))
        np.testing.assert_allclose(R.ravel(), right.R.ravel(), atol=1e-12)
        np.testing.assert_allclose(against.ravel(), right.against.ravel(), rtol=1e-9, atol=1e-9)
        assert bool(damped.item()) == right.steep


@pytest.mark.parametrize("name", TORQUES)
def test_a_term_is_the_causes_own_formula(name: str) -> None:
    """At a sample whose memory nobody keeps, as a controller evaluates it; affine terms are written out elsewhere."""
    rng = np.random.default_rng(1)
    term = planted(name, rng)
    function, values = terms(Model(bundled("thesis"), (term,)))
    for columns in rng.normal(size=(20, 6, 3)):
        columns[3] = np.clip(columns[3], -1, 1)
        *first, weight = columns[:, 2].tolist()
        right = 0.0 if term.effect.affine else term.torque(Sample(2.0, *first, weight=weight))
        found = np.array(function(values or [0.0], 2.0, *columns)).ravel()
        np.testing.assert_allclose(found, [0.0, 0.0, right], rtol=1e-12, atol=1e-15)


# --- Torques -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("compiler", COMPILERS)
def test_it_compiles_without_a_warning(compiler: str, full: Twin) -> None:
    if not has(compiler):
        pytest.skip(f"no {compiler}")
    files = [*sources(full.folder), "main.c"]
    compile_(full.folder, COMPILERS[compiler], *STRICTER, "-O1", "-fsyntax-only", *files)


@compiled_here
@pytest.mark.parametrize("which", ["plain", "full", "pid"])
def test_torques_are_pythons(which: str, request: pytest.FixtureRequest) -> None:
    """Within 1e-5 of the limit, and most of them not at the limit, where anything agrees."""
    tested: Twin = request.getfixturevalue(which)
    rng = np.random.default_rng(0)
    for gap in (tracking_gap, holding_gap)[: 1 if which == "pid" else 2]:
        gaps = np.array([gap(tested, rng) for _ in range(200)])
        assert gaps[:, 0].max() < 1e-5
        assert gaps[:, 1].mean() < 0.6


@compiled_here
@pytest.mark.parametrize("turns", [-3, 1])
def test_a_continuous_joints_torque_does_not_jump_where_its_encoder_wraps(
    pid: Twin, turns: int
) -> None:
    """The error of a joint without stops is that of the shorter way round."""
    zero = np.zeros(2)
    goal = Reference(np.array([3.15, 0.1]), zero, zero)
    start = pid.law.start()
    inside, _ = pid.law.torque(0.0, np.array([3.14, 0.1]), zero, goal, start)
    q = np.array([3.14 + 2 * np.pi * turns, 0.1])
    wrapped, _ = pid.law.torque(0.0, q, zero, goal, start)
    np.testing.assert_allclose(wrapped, inside, atol=2e-3 * pid.stored.model.tau_max.max())


class Side:
    """Both controllers on the same sensors: Python's torque acts, and what C would have given is kept."""

    def __init__(self, tested: Twin) -> None:
        """Take the two."""
        self.python = tested.pointer
        self.c = tested.compiled
        self.navigator = tested.pointer.navigator
        self.dt = tested.pointer.dt
        self.limit = tested.stored.model.tau_max
        self.gaps: list[float] = []

    def start(self, seen: Measurement, camera: Array, base: Array):  # type: ignore[no-untyped-def]
        """Return Python's memory; C's is kept."""
        self.memory = self.c.start(seen, camera, base)
        return self.python.start(seen, camera, base)

    def torque(self, seen: Measurement, memory):  # type: ignore[no-untyped-def]
        """Return Python's torque."""
        seen = seen._replace(**{name: floats(getattr(seen, name)) for name in seen._fields[1:]})
        right, memory = self.python.torque(seen, memory)
        found, self.memory = self.c.torque(seen, self.memory)
        self.gaps.append(float(np.abs((found - right) / self.limit).max()))
        return right, memory

    def check(self) -> None:
        """Require that what differs is rounding, integrated."""
        assert max(self.gaps) < 2e-3
        assert np.median(self.gaps) < 2e-4


def rest(twin: Twin, steps: int) -> list[Measurement]:
    """Return samples of a gimbal that looks where it shall, on a base that stands."""
    noise = np.random.default_rng(0).standard_normal((steps, 5, 3))
    up = np.array([0.0, 0.0, 9.81])
    n = twin.library.n
    links = 3 * len(twin.pointer.navigator.sight.moved)
    return [
        Measurement(
            1e-3 * k, 1e-4 * x[0, :n], *1e-4 * x[1:3], up + 1e-3 * x[3], 1e-4 * x[4, :links]
        )
        for k, x in enumerate(noise)
    ]


@compiled_here
@pytest.mark.parametrize(
    "faults",
    [
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
    ],
)
def test_failing_sensors_give_the_same_torques(
    plain: Twin, faults: tuple[SensorFault, ...]
) -> None:
    """Sample by sample from profile S, nothing fed back."""
    model = plain.stored.model
    side = Side(plain)
    ground = draw_profile(model.rig, 0.6, 0)
    holder = FailingSensors(side, faults)  # type: ignore[arg-type]
    simulate_holding(model, holder, ground, rng=np.random.default_rng(0), seconds=0.6)
    side.check()


@compiled_here
@pytest.mark.parametrize("which", ["plain", "pid"])
def test_the_turn_at_the_start_is_the_same(which: str, request: pytest.FixtureRequest) -> None:
    """Sensors of a camera that turns as it should, on a base that stands."""
    tested: Twin = request.getfixturevalue(which)
    side = Side(tested)
    sight = side.navigator.sight
    q = floats(np.array([1.0, -0.3, 0.4])[: tested.library.n])
    turn = side.navigator.pace.turn(sight, np.eye(3), q, WANTED, 0.0)
    memory = None
    for k, seen in enumerate(rest(tested, 1200)):
        left, speed, _ = turn.progress(1e-3 * k)
        q = turn.goal + left * turn.way
        rates = sight.rates(q, speed * turn.way, np.zeros(3))
        seen = seen._replace(q=q, gyro=seen.gyro + rates[:3], links=seen.links + rates[3:])
        memory = side.start(seen, sight.attitude(q), np.eye(3)) if memory is None else memory
        _, memory = side.torque(seen, memory)
    side.check()


@compiled_here
def test_a_base_that_is_not_level_is_leveled_alike(plain: Twin) -> None:
    """The accelerometer says that the world is a milliradian askew."""
    side = Side(plain)
    level = Level(1e-3)
    side.python = replace(plain.pointer, navigator=replace(side.navigator, level=level))
    first, *others = rest(plain, 1500)
    camera = side.navigator.sight.attitude(first.q)
    memory = side.start(first, camera, np.eye(3))
    memory = memory._replace(known=memory.known._replace(upright=level.start(sure=False)))
    side.memory = side.c.start(first, camera, np.eye(3), level.eased)
    largest = 0.0
    for seen in others:
        torque, memory = side.torque(seen._replace(f=attitude(0, 1e-3, -5e-4) @ seen.f), memory)
        largest = max(largest, float(np.abs(torque / side.limit).max()))
    side.check()
    assert largest > 0.1


@compiled_here
def test_what_is_out_of_reach_is_refused_alike(plain: Twin) -> None:
    """Then the camera is held where it looks: torques are those of a start that wanted nothing else."""
    navigator = plain.pointer.navigator
    sight = navigator.sight
    stream = rest(plain, 30)
    camera = sight.attitude(stream[0].q)

    def start(wanted: Array) -> Array:
        pointer = CompiledPointer(plain.library, replace(navigator, wanted=wanted))
        return follow(pointer, stream, camera)

    held = start(camera)
    turned = []
    for angles in np.random.default_rng(0).uniform(-np.pi, np.pi, (40, 3)):
        wanted = attitude(*angles)
        q = sight.reached(LEVEL, wanted, sight.home)
        turned.append(not np.array_equal(start(wanted), held))
        assert turned[-1] == (sight.obstacle(q, LEVEL, wanted) is None)
    assert 5 < sum(turned) < 35


def follow(holder, stream: list[Measurement], camera: Array, base: Array = LEVEL) -> Array:  # type: ignore[no-untyped-def]
    """Return a holder's torques along a stream of samples."""
    memory = holder.start(stream[0], camera, base)
    torques = []
    for seen in stream[1:]:
        tau, memory = holder.torque(seen, memory)
        torques.append(tau)
    return np.array(torques)


# --- Hostile readings ----------------------------------------------------------------------------------------------


@compiled_here
def test_hostile_sensors_never_give_a_torque_that_is_none(full: Twin) -> None:
    rng = np.random.default_rng(0)
    stream = rest(full, 1000)
    hostile = [nan, inf, -inf, 1e30, -3e38, 1e5, 1e-42]
    for k, seen in enumerate(stream[1:], 1):
        for values in seen[1:]:
            if rng.random() < 0.2:
                values[rng.integers(3)] = rng.choice(hostile)
        stream[k] = seen._replace(t=rng.choice([seen.t, 0.0, 1e6]))
    torques = follow(full.compiled, stream, np.eye(3))
    assert (np.abs(torques) <= full.stored.model.tau_max * (1 + 1e-6)).all()


# --- The verb ------------------------------------------------------------------------------------------------------


def test_export_writes_sources_and_refuses_what_is_no_controller_of_the_rig(
    run: Run, tmp_path: Path
) -> None:
    controller = tmp_path / "controller.yaml"
    tune(nominal(bundled("turret"))).save(controller)
    found = result(run, "export", controller, "--c", tmp_path / "out")
    assert {path.name for path in (tmp_path / "out").iterdir()} == {*found["files"], "run.json"}
    assert found["difference_from_pinocchio"] < 1e-12
    call = ("export", controller, "--c", tmp_path / "no")
    refused(run(*call, "--rig", "thesis"), 2, "pan, tilt")
    controller.write_text(controller.read_text().replace("rig: turret", "rig: mine"))
    refused(run(*call), 2, "--rig")
    controller.write_text("rig: turret\n")
    refused(run(*call), 2, "holds no controller")
    assert not (tmp_path / "no").exists()


@compiled_here
def test_a_library_of_another_rig_or_none_is_refused_before_its_code_runs(
    pid: Twin, tmp_path: Path
) -> None:
    with pytest.raises(ModelError, match="is for the joints pan, tilt"):
        Library.load(pid.library.path, bundled("thesis"))
    (tmp_path / "text.so").write_text("no library")
    with pytest.raises(ModelError, match="cannot be loaded"):
        Library.load(tmp_path / "text.so", bundled("turret"))
    code = '#include <stdio.h>\n__attribute__((constructor)) static void run(void) { fopen("x", "w"); }\n'
    (tmp_path / "other.c").write_text(code)
    library = ("-fPIC", "-shared", "-o", "other.so", "other.c")
    compile_(tmp_path, COMPILERS["gcc"], *library)
    with pytest.raises(ModelError, match="holds no controller"):
        Library.load(tmp_path / "other.so", bundled("turret"))
    assert not Path("x").exists()
