"""A controller's C sources, compiled here, beside the Python that they were written from."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from gimbal_pin.control import Ahead, Aim, BaseState, LawMemory, StoredController, stored, tune
from gimbal_pin.control.laws.carried import CarriedMemory
from gimbal_pin.dynamics import Model, Reference, nominal, plant_with
from gimbal_pin.effects import parse_effect
from gimbal_pin.export import CompiledLaw, Library, export_controller
from gimbal_pin.export.compiled import at, single
from gimbal_pin.log import Array
from gimbal_pin.pointing import Measurement, Pointer
from gimbal_pin.pointing.navigator import Navigator
from gimbal_pin.rig import Rig

STRICT = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic")
STRICTER = (
    "-Wconversion",
    "-Wdouble-promotion",
    "-Wshadow",
    "-Wmissing-prototypes",
    "-Wstrict-prototypes",
)
ARM = ("-mcpu=cortex-m4", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16")
COMPILERS = {
    "gcc": ("gcc",),
    "clang": ("clang",),
    "gcc-m32": ("gcc", "-m32"),
    "arm": ("arm-none-eabi-gcc", *ARM),
}
"""Name → command; with those that a machine lacks."""

EVERYTHING = (
    "cogging:{0}:amplitude=0.05,harmonic=42",
    "stribeck:{0}:extra=0.03,speed=0.05",
    "load-dependent-friction:{0}:mu=0.05",
    "dead-zone:{0}:width=0.03",
    "actuator-lag:{1}:time_constant=0.002",
    "torque-ripple:{1}:amplitude=0.03,harmonic=6",
    "saturation:{1}:limit=3,knee=2",
)
"""Causes that need every way in which a term or a drive is written out."""


class CompiledMemory(NamedTuple):
    """Memory of a compiled controller that holds the camera.

    Attributes:
        state: The C structure, byte by byte.
    """

    state: bytes

    @property
    def events(self) -> tuple[str, ...]:
        """No events: the C side keeps flags and counts."""
        return ()


@dataclass(frozen=True, eq=False)
class CompiledPointer:
    """A compiled controller that holds the camera, in place of a `Pointer`.

    Attributes:
        library: The controller.
        navigator: Of the Python controller beside it, which says what is wanted.
    """

    library: Library
    navigator: Navigator

    @property
    def dt(self) -> float:
        """Sampling interval, s."""
        return float(self.library.about["dt"])

    def start(
        self, seen: Measurement, camera: Array, base: Array, eased: float = 0.0
    ) -> CompiledMemory:
        """Memory at the first sample, where the attitudes of camera and base link are known, (3, 3).

        `eased`: time in which levelling comes in, s; 0: there is none.
        """
        code = self.library.code
        state = ctypes.create_string_buffer(code.gimbal_holding_size())
        turns = Rotation.from_matrix([camera, base, self.navigator.wanted])
        arrays = [sampled(seen), single(turns.as_quat(scalar_first=True), np.array([eased]))]
        code.gimbal_holding_start(self.library.parameters, state, *map(at, arrays))
        return CompiledMemory(state.raw)

    def torque(self, seen: Measurement, memory: CompiledMemory) -> tuple[Array, CompiledMemory]:
        """Return the torque, N m, (n,), finite and within the limits, and the next memory."""
        state = ctypes.create_string_buffer(memory.state, len(memory.state))
        tau = np.empty(self.library.n, np.float32)
        arrays = [sampled(seen), tau]
        self.library.code.gimbal_holding_step(self.library.parameters, state, *map(at, arrays))
        return self.library.torque(tau), CompiledMemory(state.raw)


def sampled(seen: Measurement) -> np.ndarray:
    """Return ``struct gimbal_sensors``: a stamp in microseconds, which wraps around, and single-precision readings."""
    links = seen.links if len(seen.links) else np.zeros(3)
    out = single(np.zeros(1), seen.q, seen.gyro, seen.w, seen.f, links)
    out[:1].view(np.uint32)[0] = round(1e6 * seen.t) % 2**32
    return out


class Twin(NamedTuple):
    """A controller in both languages.

    Attributes:
        stored: The controller.
        pointer: What holds the camera with it, in Python.
        library: The compiled one.
        folder: Its sources.
    """

    stored: StoredController
    pointer: Pointer
    library: Library
    folder: Path

    @property
    def law(self) -> CompiledLaw:
        """The compiled controller that follows a reference."""
        return CompiledLaw(self.library)

    @property
    def compiled(self) -> CompiledPointer:
        """The compiled controller that holds the camera."""
        return CompiledPointer(self.library, self.pointer.navigator)


def has(compiler: str) -> bool:
    """Whether this machine can compile so, its library included."""
    command = COMPILERS[compiler]
    if shutil.which(command[0]) is None:
        return False
    program = "#include <math.h>\n#include <stdint.h>\n"
    probe = [*command, "-x", "c", "-fsyntax-only", "-"]
    return subprocess.run(probe, input=program, text=True, capture_output=True).returncode == 0


def modelled(rig: Rig, causes: Sequence[str] = ()) -> Model:
    """A rig's nominal model with some causes, `{0}` being its first joint and `{1}` its last."""
    planted = [parse_effect(cause.format(rig.joints[0], rig.joints[-1]), rig) for cause in causes]
    model, drive = plant_with(nominal(rig), planted)
    return Model(model.rig, model.terms, drive=(*model.drive, *drive))


def built(model: Model, folder: Path, kind: str = "computed-torque", robust: bool = False) -> Twin:
    """Tune, export and compile."""
    held = stored(tune(model, kind=kind, robust=robust).to_dict(), model.rig.stated, "here")
    made = export_controller(held)
    made.write(folder)
    library = ("-O1", "-fPIC", "-shared", "-o", "controller.so", *sources(folder), "-lm")
    compile_(folder, COMPILERS["gcc"], *library)
    return Twin(held, made.pointer, Library.load(folder / "controller.so", held.model.rig), folder)


def sources(folder: Path) -> list[str]:
    """Names of the sources of a library."""
    return sorted(path.name for path in folder.glob("gimbal_*.c"))


def compile_(folder: Path, command: Sequence[str], *options: str) -> None:
    """Compile, with every warning an error; what the compiler says is the failure."""
    done = subprocess.run([*command, *STRICT, *options], cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0 and not done.stderr, done.stderr


def floats(x: Array) -> Array:
    """Return what single precision makes of values: what both languages are given."""
    return np.asarray(x, np.float32).astype(np.float64)


def draw_aim(n: int, rng: np.random.Generator) -> tuple[Array, Array, Reference, Array]:
    """Draw angles, rates, an aim from far below an encoder's step to a tenth of a radian away, and integrals."""
    size = 10 ** rng.uniform(-6, -1.5)
    q = floats(rng.uniform(-np.pi, np.pi, n))
    v, e, r, a, s = floats(rng.normal(size=(5, n)))
    v = floats(0.5 * v)
    aim = Reference(floats(q + size * e), floats(v + 10 * size * r), a)
    return q, v, aim, floats(0.1 * size * s)


def compare(found: Array, right: Array, limit: Array) -> tuple[float, float]:
    """Return the largest difference of torques, in torque limits, and the share of joints at their limit."""
    return float(np.abs((found - right) / limit).max()), float(np.mean(np.abs(right) >= limit))


def tracking_gap(tested: Twin, rng: np.random.Generator) -> tuple[float, float]:
    """Compare the torques that follow a reference at one drawn state."""
    q, v, aim, integral = draw_aim(tested.library.n, rng)
    before = floats(aim.a + rng.normal(0, 0.1, len(q)))
    memory = LawMemory(tuple(integral), tuple(before))
    right, after = tested.stored.law.torque(0.5, q, v, aim, memory)
    held = single(integral, before).tobytes() + np.array([1, 0], np.uint32).tobytes()
    found, kept = tested.law.torque(0.5, q, v, aim, held)
    limit = tested.stored.model.tau_max
    gaps = np.abs(np.frombuffer(kept, np.float32, len(q)) - after.integral)
    assert gaps.max() < 1e-6 or np.abs(right).max() > 0.999 * limit.min()
    return compare(found, right, limit)


def holding_gap(tested: Twin, rng: np.random.Generator) -> tuple[float, float]:
    """Compare the torques that hold the camera on a base that moves."""
    q, v, near, integral = draw_aim(tested.library.n, rng)
    ahead = tuple(
        Ahead(floats(q + 1e-3), v, near.a, BaseState(*floats(rng.normal(0, 5, (3, 3)))))
        for _ in tested.pointer.navigator.forecast.leads
    )
    aim = Aim(near.q, near.v, near.a, ahead)
    owed = floats(0.01 * rng.normal(size=len(q)))
    memory = CarriedMemory(tuple(integral), tuple(owed))
    right, _ = tested.pointer.law.torque(0.5, q, v, aim, memory)
    tau = np.empty(len(q), np.float32)
    parts = [part for one in ahead for part in (one.q, one.v, one.a, *one.base)]
    arrays = [single(integral, owed), single(q), single(v), single(aim.q, aim.v, *parts), tau]
    held, *rest = map(at, arrays)
    tested.library.code.gimbal_hold(tested.library.parameters, held, ctypes.c_float(0.5), *rest)
    return compare(tau, right, tested.stored.model.tau_max)
