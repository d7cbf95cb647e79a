"""A controller as C99: parameters, generated equations, and the sources that are the same for every gimbal."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from importlib.resources import files
from math import exp, inf
from pathlib import Path
from typing import Any

import numpy as np

from gimbal_pin.control.laws import ComputedTorque, JointPid
from gimbal_pin.control.laws.base import Outer
from gimbal_pin.control.laws.carried import MOST_UNREALISED_TORQUE, PAID, CarriedTorque
from gimbal_pin.control.laws.computed_torque import Robust
from gimbal_pin.control.tuning import StoredController, Tuning
from gimbal_pin.effects.resistance import Resistance
from gimbal_pin.export.ccode import c_function, number
from gimbal_pin.export.equations import LawEquations
from gimbal_pin.export.navigation import NavigationEquations
from gimbal_pin.export.symbolic import Chain, checked, table
from gimbal_pin.log.io.files import atomic_write, write_run
from gimbal_pin.log.log import Array, Imu
from gimbal_pin.pointing import guard
from gimbal_pin.pointing.bench import WANTED, rehearse_platform
from gimbal_pin.pointing.forecast import FALL, RISE, TAPS, Spectrum
from gimbal_pin.pointing.level import Level
from gimbal_pin.pointing.measurement import Station
from gimbal_pin.pointing.pointer import Pointer
from gimbal_pin.pointing.recipe import Recipe
from gimbal_pin.pointing.sight import DAMPING, STEEP, gyros_between, unable
from gimbal_pin.rig.arguments import check_arguments
from gimbal_pin.rig.brief import brief

C_SOURCES = (
    "gimbal_controller.h",
    "gimbal_sizes.h",
    "gimbal_attitude.h",
    "gimbal_attitude.c",
    "gimbal_guard.h",
    "gimbal_guard.c",
    "gimbal_law.h",
    "gimbal_law.c",
    "gimbal_holding.c",
    "gimbal_model.h",
    "gimbal_model.c",
    "gimbal_parameters.c",
)
"""What a controller is compiled from."""
EXPORTED_FILES = (
    *C_SOURCES,
    "gimbal_link.h",
    "gimbal_link.c",
    "gimbal_about.c",
    "main.c",
    "CMakeLists.txt",
    "platformio.ini",
    "README.md",
)
"""All files of an exported controller."""


@dataclass(frozen=True, eq=False)
class Exported:
    """A controller as C99.

    Attributes:
        files: Name → content.
        operations: Part of a step that holds the camera → floating-point operations; a sine counts as one.
        memory: Bytes of the state of a controller that holds the camera.
        difference: Largest difference of the equations from Pinocchio in double precision, relative over one.
        pointer: The Python controller that holds the camera with the same parameters.
    """

    files: Mapping[str, str]
    operations: Mapping[str, int]
    memory: int
    difference: float
    pointer: Pointer

    __repr__ = brief

    def write(self, folder: str | Path) -> None:
        """Write the sources into a folder, all of them or none."""
        writers = {
            name: partial(atomic_write, content=content) for name, content in self.files.items()
        }
        write_run(folder, writers, {"verb": "export"})

    def to_dict(self) -> dict[str, Any]:
        """Return what JSON holds."""
        return {
            "schema": 1,
            "files": list(self.files),
            "operations": dict(self.operations),
            "memory_bytes": self.memory,
            "difference_from_pinocchio": self.difference,
        }


def holder(stored: StoredController, imu: tuple[Any, Imu] | None = None) -> Pointer:
    """Return the Python controller that holds the camera with the gains of a file, as `track --platform` does.

    Its forecast does not learn in flight, as the exported one's does not: both only give way to none.

    Args:
        stored: The controller.
        imu: Time, s, and readings of the base's IMU, which say how the platform moves; None: as if shaken by hand.
    """
    rig = stored.model.rig
    wish = stored.wish
    t, readings = rehearse_platform(rig) if imu is None else imu
    spectrum = Spectrum.of(readings, float(np.median(np.diff(t))))
    station = Station.of(rig)
    step = float(station.step.max())
    late = wish.samples
    recipe = Recipe(
        stored.model,
        WANTED,
        spectrum,
        station.noise,
        step,
        dt=wish.dt,
        delay=late,
        law=stored.law,
        learns=False,
    )
    return recipe.pointer(recipe.kind)


@check_arguments
def export_controller(
    controller: Tuning | StoredController, imu: tuple[Array, Imu] | None = None
) -> Exported:
    """Return a controller's C99 sources; `Exported.write` puts them into a folder.

    Args:
        controller: From `tune`, or read from its file.
        imu: Time, s, and readings of the base's IMU, which say how the platform moves; None: as if shaken by hand.

    Raises:
        ModelError: casadi is not installed, or the rig moves in a way that the equations do not know.
    """
    stored = controller.stored if isinstance(controller, Tuning) else controller
    pointer = holder(stored, imu)
    model = stored.model
    rig = model.rig
    sight = pointer.navigator.sight
    chain = Chain(rig)
    kinematics = [chain.torque(), chain.camera(), chain.drift(), chain.between()]
    difference = checked(rig, kinematics, sight, np.random.default_rng(0))
    law = LawEquations(
        chain, model, isinstance(stored.law, ComputedTorque) and stored.law.robust is not None
    )
    functions = [*NavigationEquations(chain).list_functions(), *law.list_functions()]
    equations = [c_function(*function) for function in functions]
    links = gyros_between(rig)
    points = [table(*drive) for drive in drives(stored)]
    context: dict[str, Any] = {
        "joints": rig.n,
        "links": len(links),
        "leads": len(pointer.navigator.forecast.leads),
        "taps": TAPS,
        "due": pointer.navigator.forecast.due,
        "others": max(len(law.values), 1),
        "functions": equations,
        "joint_names": [quoted(name) for name in rig.joints],
        "link_names": [quoted(name) for name in links or ("",)],
        "points": [point for own in points for point in own] or [(0.0, 0.0)],
        "parameters": list_parameters_of(stored, pointer, law.values, [len(own) for own in points]),
        "about": json.dumps(describe_library(stored)),
        "rig": rig,
        "gyro_links": links,
        "unable": unable(rig, WANTED),
        "stored": stored,
    }
    counts = {function.name(): count for (function, _), (*_, count) in zip(functions, equations)}
    cost = {
        name: times * counts.get(name, PER_TAP * TAPS)
        for name, times in calls(stored, pointer).items()
    }
    memory = state_bytes(rig.n, len(links), pointer.navigator.forecast.due)
    made = rendered({**context, "operations": cost, "memory": memory}, EXPORTED_FILES)
    return Exported(made, cost, memory, difference, pointer)


PER_TAP = 18
"""Operations of a forecast for each sample that it looks back on: a product and a sum for three axes of three rows."""


def calls(stored: StoredController, pointer: Pointer) -> dict[str, int]:
    """Return how often a step that holds the camera calls the functions of its model, and the forecast."""
    leads = len(pointer.navigator.forecast.leads)
    if not isinstance(stored.law, ComputedTorque):
        return {"view": 1}
    return {
        "moving_torque": leads,
        "view": leads,
        "wish": leads,
        "fusion": 1,
        "level": 1,
        "feedback": 1,
        "forecast": leads,
    }


def state_bytes(n: int, links: int, due: int) -> int:
    """Size of ``struct gimbal_holding`` where 64-bit integers align to eight bytes, for gyros on so many `links`.

    `due`: samples after which a forecast comes due.
    """
    sensors = 10 + n + 3 * max(links, 1)
    guarded = 3 * sensors + 20 + 4 * n
    gyros = links + 1
    after = 37 + 4 * n + 17 * gyros + 6 * TAPS + 1 + 12 * due + 21 + 5
    return 8 * -(-4 * guarded // 8) + 8 + 8 * -(-4 * after // 8)


def describe_library(stored: StoredController) -> dict[str, Any]:
    """Return what a loaded library says of itself."""
    rig = stored.model.rig
    return {
        "schema": 1,
        "rig": rig.name,
        "payload": rig.payload,
        "joints": list(rig.joints),
        "links": list(gyros_between(rig)),
        "controller": stored.wish.kind,
        "dt": stored.wish.dt,
        "delay": stored.wish.delay,
    }


def drives(stored: StoredController) -> list[tuple[Any, float]]:
    """Return, per joint, what to command for a torque, and the motor's limit, N m; a PID compensates no drive."""
    from gimbal_pin.control.laws.computed_torque import invert_drive

    model = stored.model
    own = model.drives if isinstance(stored.law, ComputedTorque) else ((),) * model.rig.n
    return [
        (partial(invert_drive, drive), min(limit, 1e6))
        for drive, limit in zip(own, model.tau_max.tolist())
    ]


def list_parameters_of(
    stored: StoredController, pointer: Pointer, coefficients: Sequence[float], counts: Sequence[int]
) -> dict[str, Any]:
    """Return ``struct gimbal_parameters`` as plain data, in its order."""
    law = stored.law
    model = stored.model
    navigator = pointer.navigator
    n = model.rig.n
    dt = stored.law.dt
    forecast = navigator.forecast
    friction = Resistance(model.by_joint)
    back = pointer.fallback
    level = Level(dt)
    holding = pointer.law
    pace = pointer.navigator.pace
    checks = pointer.guard
    assert isinstance(holding, (JointPid, CarriedTorque))
    computed = isinstance(law, ComputedTorque)
    robust = law.robust if isinstance(law, ComputedTorque) else None
    firsts = np.cumsum([0, *counts])[:-1].tolist()
    return {
        "law": "GIMBAL_COMPUTED_TORQUE" if computed else "GIMBAL_PID",
        "dt": dt,
        "dt_us": round(1e6 * dt),
        "gravity": float(np.linalg.norm(model.rig.model.gravity.linear)),
        "limit": model.tau_max.tolist(),
        "tracking": list_loops(law.outer, inertia(law, n)),
        "holding": list_loops(holding.outer, inertia(holding, n)),
        "fallback": list_loops(back.outer, back.inertia),
        "robust": redesign(robust, n),
        "terms": {
            "constant": friction.constant,
            "per_slide": friction.per_slide,
            "per_rate": friction.per_rate,
            "others": list(coefficients) or [0.0],
        },
        "drive": [{"first": first, "count": count} for first, count in zip(firsts, counts)],
        "still": law.still if isinstance(law, ComputedTorque) else 0.0,
        "tracking_lead": list(law.leads) if isinstance(law, ComputedTorque) else [0.0] * n,
        "holding_lead": list(forecast.leads),
        "lead_of": list(holding.which) if isinstance(holding, CarriedTorque) else [0] * n,
        "forecast": [weights.tolist() for weights in forecast.weights],
        "lasting": exp(-dt / PAID),
        "most_owed": MOST_UNREALISED_TORQUE,
        "judging": dict(
            zip(("slow", "mean", "rise", "fall"), (*forecast.shares, dt / RISE, dt / FALL))
        ),
        "fusion_gain": 0.0 if navigator.fusion is None else navigator.fusion.gain,
        "fusion_share": 0.0 if navigator.fusion is None else navigator.fusion.share,
        "fusion_bound": 0.0 if navigator.fusion is None else navigator.fusion.bound,
        "level_span": round(level.span / dt),
        "level_eased": level.eased,
        "pace": {
            "home": navigator.sight.home.tolist(),
            "rate": pace.rates.tolist(),
            "torque": pace.torques.tolist(),
            "inertia": pace.inertias.ravel().tolist(),
            "near": pace.near,
            "ramp": pace.ramp,
            "lower": [limit.lower for limit in model.rig.limits],
            "upper": [limit.upper for limit in model.rig.limits],
        },
        "limits": {
            "noisy": checks.noisy,
            "held": guard.HELD,
            "repeats": guard.REPEATS,
            "back": guard.BACK,
            "moved": guard.MOVED,
            "longest": guard.GAP,
            "fastest": guard.FASTEST,
            "farthest": guard.FARTHEST,
            "strongest": guard.STRONGEST,
            "times": checks.times,
            "kept": 1 - dt / checks.lasting,
            "first": checks.first,
            "least": list(checks.least),
            "smoothing": guard.SMOOTHING,
            "steep": STEEP,
            "damping": DAMPING,
        },
    }


def inertia(law: Any, n: int) -> Sequence[float]:
    """Return what a law multiplies the accelerations of its outer loop by, kg m²; one where it has a model for that."""
    return law.inertia if isinstance(law, JointPid) else (1.0,) * n


def list_loops(outer: Outer, inertias: Sequence[float]) -> list[dict[str, float]]:
    """Return ``struct gimbal_loop`` of every joint."""
    keys = ("kp", "ki", "kd", "knee", "braking")
    return [{**dict(zip(keys, row)), "inertia": own} for row, own in zip(outer.rows, inertias)]


def redesign(robust: Robust | None, n: int) -> dict[str, Any]:
    """Return ``struct gimbal_robust``."""
    if robust is None:
        return {"direction": [0.0] * 3 * n, "alpha": 0.0, "disturbance": 0.0, "gain": 0.0}
    return {
        "direction": [x for row in robust.rows for x in row],
        "alpha": robust.bounds.alpha,
        "disturbance": robust.bounds.inverse * robust.bounds.phi,
        "gain": robust.gain,
    }


def written(value: Any, depth: int = 0) -> str:
    """Return plain data as a C99 initialiser: mappings by field, sequences in order, floats in single precision."""
    inner = "    " * (depth + 1)
    outer = "    " * depth
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return value
    if isinstance(value, int):
        return str(value)
    if isinstance(value, float):
        return number(value if abs(value) < 1e30 else float(np.copysign(inf, value)))
    if isinstance(value, Mapping):
        rows = [f"{inner}.{key} = {written(own, depth + 1)},\n" for key, own in value.items()]
        return f"{{\n{''.join(rows)}{outer}}}"
    parts = [written(own, depth + 1) for own in value]
    if all(isinstance(own, (int, float, str)) for own in value):
        parts = [", ".join(parts[i : i + 8]) for i in range(0, len(parts), 8)]
        if len(parts) == 1:
            return f"{{{parts[0]}}}"
    return "{\n" + "".join(f"{inner}{part},\n" for part in parts) + f"{outer}}}"


def quoted(text: str) -> str:
    """Return a C string of ASCII: every other byte of its UTF-8 as an octal escape, so that none is a trigraph."""
    plain = set(b"abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-. ,:{}[]")
    return (
        '"'
        + "".join(chr(byte) if byte in plain else f"\\{byte:03o}" for byte in text.encode())
        + '"'
    )


def escape_markdown(text: str) -> str:
    """Return a text that Markdown shows as it is: the characters that begin code, links, emphasis or HTML escaped."""
    return re.sub(r"([\\`*\[\]<>&!|~$])", r"\\\1", text)


def rendered(context: Mapping[str, Any], names: Sequence[str]) -> dict[str, str]:
    """Return name → content of templates; a file without ``.j2`` is copied as it is."""
    from jinja2 import Environment, StrictUndefined

    environment = Environment(  # of several languages: each template passes names through the filter of its own
        undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True
    )
    environment.filters |= {"c": written, "string_c": quoted, "markdown": escape_markdown}
    environment.filters["json"] = partial(json.dumps, ensure_ascii=False)  # YAML, too
    out = dict[str, str]()
    folder = files("gimbal_pin.export") / "templates"
    for name in names:
        made = folder / f"{name}.j2"
        text = (made if made.is_file() else folder / name).read_text("utf-8")
        out[name] = environment.from_string(text).render(context) if made.is_file() else text
    return out
