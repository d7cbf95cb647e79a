"""Ten plants of three public gimbals with a hidden payload, and what `auto` says of it, against the truth.

Every plant is a MuJoCo model: a gimbal's geometry, a camera that is heavier than its URDF's and sits elsewhere, one
thing more that is wrong, and a base that stands, leans or is shaken. `auto` is run as a user would, as a process; a
refusal that says which ``--map`` mends it is answered with that. Printed per plant: the mass's and centre's error, in
the tolerance's unit and in stated deviations, or that it is said to be unknown, which is right only where the
Cramér-Rao deviation, all effects and the arms known, exceeds a third of the tolerance; whether a wrong figure has a
mark; the lines on the terminal.
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from tests.blind.calibrate import calibrate
from tests.blind.control import draw_gains, feed_forward
from tests.blind.effects import CATALOGUE, Effect, PlatformMotion
from tests.blind.excitation import draw_reference
from tests.blind.files import csv_text
from tests.blind.logbook import columns_of, imu, noisy_channels
from tests.blind.motion import BaseMotion
from tests.blind.rigs import EYE, Array, Inertia, Link, Motor, Payload, Rig
from tests.blind.rnea import motion as rigid_motion
from tests.blind.rnea import torque
from tests.blind.scene import Scene
from tests.blind.sensors import draw_sensors
from tests.blind.urdf import urdf_text, yaml_text

Arms = tuple[tuple[str, tuple[float, ...], tuple[float, ...], tuple[float, ...], float], ...]
"""Joint's name, its place in the parent, its axis, its link's centre of mass, m, and the link's mass, kg."""
PX4: Arms = (
    ("yaw", (-0.02552, 0, 0), (0, 0, -1), (0.02, 0, -0.1283), 0.1),
    ("roll", (0, 0, -0.1619), (-1, 0, 0), (-0.0213, 0, 0), 0.1),
    ("pitch", (-0.0412, 0, 0), (0, 1, 0), (0, 0, 0), 0.02),
)
SMALL: Arms = (
    ("yaw", (0.0105, 0.065, -0.002), (0, 1, 0), (0, -0.01, -0.02), 0.05),
    ("roll", (0, -0.063, -0.048), (0, 0, 1), (0.02, 0, 0.03), 0.04),
    ("pitch", (0.035, 0, 0.07), (1, 0, 0), (0, 0, 0), 0.02),
)
TWO: Arms = (
    ("roll", (0.01, 0, -0.04), (0, 0, 1), (0.02, 0, 0.03), 0.04),
    ("tilt", (0.03, 0, 0.06), (1, 0, 0), (0, 0, 0), 0.02),
)
GIMBALS: dict[str, tuple[Arms, float]] = {"px4": (PX4, 0.26), "ardupilot-3d": (SMALL, 0.18), "ardupilot-2d": (TWO, 0.2)}
"""PX4-gazebo-models' gimbal, ardupilot_gazebo's gimbal_small_3d and _2d, and a camera's mass, kg: places and axes are
theirs, arms and cameras are ours, which simulators leave at a round figure."""
PLANTS = (
    ("px4", "cogging", "level"),
    ("px4", "backlash", "leaning"),
    ("px4", "delay", "shaken"),
    ("px4", "wrong sign", "level"),
    ("ardupilot-3d", "cogging", "shaken"),
    ("ardupilot-3d", "unlogged", "leaning"),
    ("ardupilot-3d", "backlash", "level"),
    ("ardupilot-2d", "delay", "leaning"),
    ("ardupilot-2d", "cogging", "shaken"),
    ("ardupilot-2d", "wrong sign", "shaken"),
)
"""Gimbal, what is wrong beside the payload, and the base."""
RATE, SECONDS = 500.0, 40.0
SHARES = {"cogging": 0.3, "backlash": 0.1, "delay": 0.1}
"""Size of what is wrong, rms over the torque's."""
IMU = {"gyro": 1e-3, "accel": 1e-2}
"""White noise, rad/s and m/s²."""
MASS, CENTRE = 0.05, 0.3
"""Tolerances: of the mass, a share; of the centre, mm."""
MOST = 3.0
"""Most stated deviations."""
LINES = 25
"""Most lines on the terminal."""


@dataclass(frozen=True)
class Leaning(PlatformMotion):
    """A base that leans by `size` rad about x and y and stands still."""

    def motion(self) -> BaseMotion:
        """The path: attitude alone, constant."""
        turn = self.size * np.array([0, 0, 0, 0, 0.8, 0.6])[:, None]
        return BaseMotion(turn, np.full((6, 1), 1e-9), np.full((6, 1), np.pi / 2))


def box(mass: float, edges: Sequence[float], com: Array) -> Inertia:
    """A box, kg, m."""
    squares = np.square(edges)
    return Inertia(mass, com, mass / 12 * np.diag(squares.sum() - squares))


def gimbal(name: str) -> Rig:
    """The rig as its URDF has it."""
    arms, mass = GIMBALS[name]
    links = tuple(
        Link(f"{joint}_link", joint, EYE, np.array(place, float), np.array(axis, float),
             box(own, (0.05, 0.04, 0.06), np.array(com, float)), -1.0, 1.0)
        for joint, place, axis, com, own in arms
    )  # fmt: skip
    motors = tuple(Motor(0.05, 0.4, 12, 14, 16, 0.004, 0.002, 20.0) for _ in links)
    camera = Payload(
        "camera", "camera_mount", EYE, np.zeros(3), box(mass, (0.06, 0.05, 0.05), np.array([4e-3, 3e-3, 2e-3]))
    )
    return Rig(name, "base", links, motors, camera, (0.0,) * len(links), 8.0)


@dataclass(frozen=True)
class Made:
    """A plant's files and truth.

    Attributes:
        rig: YAML of the rig, as given.
        log: The log.
        mass: Of the camera, g.
        com: Its centre in its own frame, mm, (3,).
        stated: The URDF's mass, g, and centre, mm.
        bound: Cramér-Rao deviations of mass, g, and centre, mm, (4,).
    """

    rig: Path
    log: Path
    mass: float
    com: Array
    stated: tuple[float, Array]
    bound: Array


def made(plant: tuple[str, str, str], seed: int, folder: Path) -> Made:
    """Simulate a plant and write what a user has of it."""
    name, wrong, base = plant
    rng, given = np.random.default_rng(seed), gimbal(name)
    camera = given.payload.inertia
    size = float(rng.uniform(0.08, 0.25))
    shift = rng.normal(size=3)
    com = camera.com + 1e-3 * rng.uniform(3, 6) * shift / np.linalg.norm(shift)
    true = given.with_payload(Inertia((1 + size) * camera.mass, com, (1 + size) * camera.tensor))
    if wrong == "unlogged":  # the first joint is clamped at its zero
        true = clamped(true)
    reference = draw_reference(rng, true, "multisine", SECONDS, RATE)
    gains = draw_gains(rng, true, reference, True)
    forward = feed_forward(given if wrong != "unlogged" else clamped(given), reference, gains)
    sensors = replace(draw_sensors(rng, "clean", RATE), has_rate=True)
    scene = Scene(true, reference, gains, forward, sensors, RATE, int(rng.integers(2**31)))
    bases = {
        "leaning": Leaning(None, "sines", 0.5, 0),
        "shaken": PlatformMotion(None, "sines", 1.0, int(rng.integers(2**31))),
    }
    carried = [moved for name, moved in bases.items() if name == base]
    joint = int(rng.integers(len(true.links)))
    effects: list[Effect] = []
    if wrong in SHARES:
        kind = CATALOGUE[wrong]
        guess = kind.draw(rng, scene.context(joint, SHARES[wrong]), kind.known[0])
        effects = [calibrate(scene.first(20.0), guess, SHARES[wrong])]
    _, trace = scene.run([*effects, *carried], scene.substeps(scene.step))
    shown = noisy_channels(scene, trace, rng, False)
    columns = columns_of(true, trace.t, shown)
    for moved in carried:
        for key, x in imu(true, trace.t, moved.motion()).items():
            columns[key] = x + IMU[key.split("_")[0]] * rng.normal(size=len(x))
    if wrong == "wrong sign":
        columns[f"tau_{true.joints[joint]}"] = -columns[f"tau_{true.joints[joint]}"]
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "rig.urdf").write_text(urdf_text(given), encoding="utf-8")
    (folder / "rig.yaml").write_text(yaml_text(given, sensors.encoder_bits, False), encoding="utf-8")
    (folder / "log.csv").write_text(csv_text(columns), encoding="utf-8")
    noise = sensors.torque_white * np.sqrt(np.mean(trace.command**2, axis=0))
    moving = carried[0].motion() if carried else None
    bound = cramer_rao(true, trace, moving, noise)
    about = 1e3 * camera.mass, 1e3 * camera.com
    return Made(folder / "rig.yaml", folder / "log.csv", 1e3 * true.payload.inertia.mass, 1e3 * com, about, bound)


def clamped(rig: Rig) -> Rig:
    """The rig with its first joint held at zero: the next one stands on the base."""
    first, second, *rest = rig.links
    joined = replace(second, position=first.position + first.rotation @ second.position)
    return replace(rig, links=(joined, *rest), motors=rig.motors[1:], armature=rig.armature[1:])


def cramer_rao(rig: Rig, trace: Any, moving: BaseMotion | None, noise: Array) -> Array:
    """Least deviations of the camera's mass, g, and centre, mm, (4,): its ten parameters and friction are unknown.

    Args:
        rig: The true rig.
        trace: Its run: t, q, v of every sample.
        moving: The base's motion, whose specific force and turning are in the equations; None: it stands.
        noise: Of the torque, N m, (n,).
    """
    few = slice(None, None, 5)
    q, v = trace.q[few], trace.v[few]
    a = np.gradient(trace.v, trace.t, axis=0)[few]
    unit = camera_torques(rig, trace.t[few], q, v, a, moving)
    n = q.shape[1]
    rows = [
        np.hstack([unit[:, j], np.sign(v[:, [j]]) * (np.arange(n) == j), v[:, [j]] * (np.arange(n) == j)]) / noise[j]
        for j in range(n)
    ]
    columns = np.vstack(rows) * np.sqrt(few.step)
    scale = np.linalg.norm(columns, axis=0)
    live = scale > 0
    _, size, right = np.linalg.svd(columns[:, live] / scale[live], full_matrices=False)
    body = rig.payload.inertia
    gradient = np.zeros((4, columns.shape[1]))  # of m and c = h/m, per m and h
    gradient[0, 0] = 1.0
    for k in range(3):
        gradient[1 + k, 0], gradient[1 + k, 1 + k] = -body.com[k] / body.mass, 1 / body.mass
    weights = gradient[:, live] / scale[live] @ right.T
    seen = size > 1e-9 * size[0]
    hidden = np.linalg.norm(weights[:, ~seen], axis=1) > 1e-6 * np.linalg.norm(weights, axis=1)
    std = np.linalg.norm(weights[:, seen] / size[seen], axis=1)
    return 1e3 * np.where(hidden | np.any(gradient[:, ~live] != 0, axis=1), inf, std)


def camera_torques(rig: Rig, t: Array, q: Array, v: Array, a: Array, moving: BaseMotion | None) -> Array:
    """Torque per parameter of the camera's body, (N, n, 10), on a base that moves: as a chain that begins with it."""
    chain, extra = rig, 0
    if moving is not None:  # its attitude as three more joints; it goes nowhere
        value, rate, second = moving.at(t)
        axes = np.array([[0.0, 0, 1], [0, 1, 0], [1, 0, 0]])
        spans = [Link(f"b{k}", f"b{k}", EYE, np.zeros(3), axis, Inertia(0.0, np.zeros(3), np.zeros((3, 3))), -9, 9)
                 for k, axis in enumerate(axes)]  # fmt: skip
        chain, extra = replace(rig, links=(*spans, *rig.links)), 3
        q, v, a = (np.hstack([own[:, 3:], x]) for own, x in zip((value, rate, second), (q, v, a)))
    count = len(chain.links)
    parts = []
    moved = rigid_motion(chain, q, v, a)
    for unit in np.eye(10):
        thetas = np.zeros((count, 10))
        thetas[-1] = unit
        parts.append(torque(chain, moved, thetas)[:, extra:])
    return np.stack(parts, axis=2)


def ran(made: Made, folder: Path) -> tuple[subprocess.CompletedProcess[str], str]:
    """Run `auto`; where it refuses and says what mends it, once more with that, which is returned, too."""
    command = [sys.executable, "-m", "gimbal_pin.cli", "auto", str(made.rig), str(made.log), "-o", str(folder / "auto")]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=600)
    still = re.search(r"fixed: {\S+: 0.0}", done.stderr)
    mapped = re.search(r"--map ((\S+)=[^\s,;']+)", done.stderr)
    if done.returncode != 2 or not (still or mapped):
        return done, ""
    if still:
        made.rig.write_text(f"{made.rig.read_text(encoding='utf-8')}{still[0]}\n", encoding="utf-8")
    elif mapped:
        command += ["--map", mapped[1].replace("COLUMN", mapped[2])]
    again = subprocess.run(command, capture_output=True, text=True, check=False, timeout=600)
    return again, still[0] if still else command[-1]


@dataclass(frozen=True)
class Judged:
    """A figure against the truth: error and its stated deviation, or None where it is said to be unknown."""

    error: float | None
    std: float
    tolerance: float
    bound: float

    @property
    def good(self) -> bool:
        """Within the tolerance and `MOST` deviations; or unknown, and rightly."""
        if self.error is None:
            return self.bound > self.tolerance / 3
        return abs(self.error) <= self.tolerance and abs(self.error) <= MOST * self.std

    def __str__(self) -> str:
        """Error over tolerance and over deviation; `?` where unknown; `!` where that is not good."""
        said = "?" if self.error is None else f"{self.error:.3g}/{abs(self.error) / max(self.std, 1e-12):.1f}σ"
        return said + ("" if self.good else "!")


def judged(told: dict[str, Any], made: Made) -> list[Judged]:
    """Judge what is said of the payload: mass, g, then centre, mm; with the true mass where that is unknown."""
    stated, extra = made.stated[0], made.mass - made.stated[0]
    weighed = told["mass"] is not None
    error = told["mass"] - extra if weighed else None
    out = [Judged(error, told["mass_std"] or inf, MASS * made.mass, made.bound[0])]
    shift = made.com - made.stated[1]
    for k in range(3):
        found, per = told["com_mm"][k], told["com_mm_per_g"][k]
        std = told["com_std_mm"][k] or inf
        at = found if found is None or weighed else (found + extra * (per + found / stated)) * stated / made.mass
        out.append(Judged(None if at is None else at - shift[k], std, CENTRE, made.bound[1 + k]))
    return out


def main() -> None:
    """Print a line per plant, and how many are as asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", type=int, nargs="*", default=range(len(PLANTS)), help="numbers of plants, from 0")
    parser.add_argument("--keep", type=Path, help="folder that keeps every file")
    asked = parser.parse_args()
    passed = 0
    with TemporaryDirectory() as temporary:
        for number in asked.only:
            plant = PLANTS[number]
            folder = (asked.keep or Path(temporary)) / f"{asked.seed}-{number}"
            own = made(plant, 1000 * asked.seed + number, folder)
            good, said = line(own, folder)
            passed += good
            sys.stdout.write(f"{number} {' '.join(plant):34s} {said}\n")
            sys.stdout.flush()
    sys.stdout.write(f"{passed} of {len(list(asked.only))} plants as asked\n")


def line(own: Made, folder: Path) -> tuple[bool, str]:
    """Run `auto` on a plant and return whether all is as asked, and a line."""
    done, mend = ran(own, folder)
    (folder / "terminal.txt").write_text(done.stdout + done.stderr, encoding="utf-8")
    bound = "bound " + " ".join(f"{x:.2g}" for x in own.bound)
    mapped = f", after '{mend}'" if mend else ""
    if done.returncode:
        return False, f"exit {done.returncode}{mapped}: {done.stderr.strip().splitlines()[-1][:150]}; {bound}"
    result = json.loads((folder / "auto" / "results.json").read_text(encoding="utf-8"))
    told = ((result["diagnose"] or {}).get("given_model") or {}).get("camera")
    if told is None:
        return False, f"nothing is said of the payload{mapped}; {bound}"
    rows, lines = judged(told, own), len(done.stdout.splitlines())
    marks = result["identify"]["warnings"]
    wrong = any(row.error is not None and not row.good for row in rows)
    verdict = f"{result['diagnose']['verdict']}, {len(marks)} warnings, {lines} lines"
    wrong_text = (
        " WRONG" + ("" if marks or result["diagnose"]["verdict"] == "data" else " AND UNMARKED") if wrong else ""
    )
    good = all(row.good for row in rows) and lines <= LINES
    return good, f"mass {rows[0]} g, centre {' '.join(map(str, rows[1:]))} mm; {bound}; {verdict}{mapped}{wrong_text}"


if __name__ == "__main__":
    main()
