"""What the verbs state about MuJoCo plants of camera gimbals that differ from their URDFs, against the truth.

Geometries are those of well-known kinds of gimbals; sizes are typical, not measured. Bodies are off by 10 to 20 %,
joints rub, encoders step, torques are noisy and late. A plant and a situation of the payload give a log of the motion
from `excite`; `identify`, `diagnose`, `tune` and `track` read it as a user would let them.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from lxml import etree

sys.path.insert(0, str(Path(__file__).parents[1]))

from gimbal_pin.log import Array
from tests.mujoco_peer import rigid_bodies

Vector = tuple[float, float, float]
COMMAND = str(Path(sys.executable).with_name("gimbal-pin"))
SITUATIONS = ("urdf", "shifted", "other", "weighed")
"""The camera as its URDF says; moved by 3 to 8 mm; another one; another one whose mass is told."""
SUBSTEPS = 8
MASS_SHARE, CENTRE_MM, DEVIATIONS = 0.05, 0.3, 3.0
"""What is asked: mass within 5 %, centre within 0.3 mm, both within three stated deviations."""


@dataclass(frozen=True)
class Body:
    """Mass (kg), centre of mass (m), box (m) whose uniform density gives the inertia about the centre."""

    mass: float
    centre: Vector
    box: Vector

    def write_link(self, name: str) -> str:
        """The body as a link of a URDF."""
        x, y, z = (side**2 * self.mass / 12 for side in self.box)
        return (
            f'<link name="{name}"><inertial><origin xyz="{self.centre[0]} {self.centre[1]} {self.centre[2]}"/>'
            f'<mass value="{self.mass}"/><inertia ixx="{y + z}" iyy="{x + z}" izz="{x + y}" ixy="0" ixz="0" iyz="0"/>'
            "</inertial></link>"
        )


@dataclass(frozen=True)
class Axis:
    """A joint: its axis and place in the body before it (m), and the body that it turns."""

    name: str
    axis: str
    place: Vector
    body: Body


@dataclass(frozen=True)
class Gimbal:
    """`modelled_on`: whose geometry; `rate` of the log, Hz; `delay` of the drive, samples."""

    modelled_on: str
    axes: tuple[Axis, ...]
    camera: Body
    rate: int
    delay: int

    def write_urdf(self, payload: bool) -> str:
        """The rig's URDF; with `payload` the camera is fixed to the mount."""
        text = '<robot name="plant"><link name="base"/>'
        before = "base"
        for each in self.axes:
            text += each.body.write_link(f"{each.name}_body")
            text += (
                f'<joint name="{each.name}" type="revolute"><parent link="{before}"/><child link="{each.name}_body"/>'
                f'<origin xyz="{each.place[0]} {each.place[1]} {each.place[2]}"/><axis xyz="{each.axis}"/>'
                '<limit lower="-1" upper="1" velocity="3" effort="3"/></joint>'
            )
            before = f"{each.name}_body"
        text += '<link name="camera_mount"/><joint name="mounted" type="fixed">'
        text += f'<parent link="{before}"/><child link="camera_mount"/></joint>'
        if payload:
            text += self.camera.write_link("camera_body") + '<joint name="carried" type="fixed">'
            text += '<parent link="camera_mount"/><child link="camera_body"/></joint>'
        return text + "</robot>"


YAW, ROLL, PITCH = "0 0 1", "1 0 0", "0 1 0"
PLANTS = {
    "handheld": Gimbal(
        "brushless three-axis handheld with offset arms",
        (
            Axis("yaw", YAW, (0, 0, 0), Body(0.35, (-0.06, 0, 0.03), (0.14, 0.04, 0.05))),
            Axis("roll", ROLL, (-0.12, 0, 0.05), Body(0.3, (0.02, -0.06, 0), (0.05, 0.15, 0.04))),
            Axis("pitch", PITCH, (0.12, 0, 0), Body(0.25, (0, -0.05, -0.03), (0.1, 0.1, 0.03))),
        ),
        Body(0.9, (0.004, 0.002, 0.006), (0.07, 0.12, 0.08)),
        500,
        1,
    ),
    "storm32": Gimbal(
        "Storm32-like gimbal under a multicopter, for an action camera with a housing",
        (
            Axis("yaw", YAW, (0, 0, -0.04), Body(0.12, (-0.03, 0, -0.03), (0.09, 0.03, 0.06))),
            Axis("roll", ROLL, (-0.06, 0, -0.06), Body(0.1, (0.02, 0.03, 0), (0.04, 0.09, 0.03))),
            Axis("pitch", PITCH, (0.06, 0, 0), Body(0.08, (0, 0.03, 0), (0.06, 0.06, 0.03))),
        ),
        Body(0.35, (0.003, -0.002, 0.002), (0.05, 0.08, 0.06)),
        1000,
        1,
    ),
    "pan-tilt": Gimbal(
        "two-axis pan-tilt head",
        (
            Axis("pan", YAW, (0, 0, 0.06), Body(1.1, (0, 0.01, 0.06), (0.1, 0.16, 0.14))),
            Axis("tilt", PITCH, (0, 0, 0.13), Body(0.5, (0.005, 0, -0.02), (0.1, 0.12, 0.04))),
        ),
        Body(1.4, (0.01, 0, 0.015), (0.16, 0.09, 0.08)),
        250,
        1,
    ),
    "basecam": Gimbal(
        "yaw-roll-pitch frame in the manner of BaseCam's builds, for a mirrorless camera",
        (
            Axis("yaw", YAW, (0, 0, -0.05), Body(0.5, (-0.08, 0, -0.06), (0.18, 0.05, 0.12))),
            Axis("roll", ROLL, (-0.14, 0, -0.12), Body(0.4, (0.03, 0, 0), (0.06, 0.25, 0.04))),
            Axis("pitch", PITCH, (0.14, 0, 0), Body(0.45, (0, 0, -0.05), (0.12, 0.24, 0.04))),
        ),
        Body(1.3, (0.002, 0.003, 0.01), (0.09, 0.13, 0.09)),
        400,
        1,
    ),
    "heavy-pan-tilt": Gimbal(
        "two-axis surveillance head with a long lens",
        (
            Axis("pan", YAW, (0, 0, 0.1), Body(3.0, (0.01, 0, 0.08), (0.2, 0.26, 0.2))),
            Axis("tilt", PITCH, (0, 0, 0.2), Body(1.2, (0, 0.01, -0.03), (0.16, 0.2, 0.06))),
        ),
        Body(2.2, (0.02, 0, 0.01), (0.3, 0.12, 0.12)),
        200,
        1,
    ),
    "mast": Gimbal(
        "roll-pitch stabilised head on a mast",
        (
            Axis("roll", ROLL, (0, 0, 0.08), Body(0.6, (0.02, 0, 0.02), (0.08, 0.16, 0.06))),
            Axis("pitch", PITCH, (0.05, 0, 0.02), Body(0.4, (0, 0.02, -0.02), (0.1, 0.12, 0.04))),
        ),
        Body(0.8, (0.005, -0.003, 0.008), (0.1, 0.08, 0.07)),
        500,
        2,
    ),
    "tilted-arm": Gimbal(
        "pocket three-axis gimbal with a roll arm beside the camera",
        (
            Axis("yaw", YAW, (0, 0, 0.02), Body(0.06, (-0.02, 0.01, 0.02), (0.04, 0.03, 0.05))),
            Axis("roll", ROLL, (-0.03, 0, 0.04), Body(0.05, (0.01, 0.02, 0), (0.03, 0.05, 0.02))),
            Axis("pitch", PITCH, (0.03, 0.0, 0), Body(0.05, (0, 0.02, 0), (0.03, 0.04, 0.03))),
        ),
        Body(0.16, (0.002, -0.002, 0.001), (0.03, 0.05, 0.04)),
        1000,
        1,
    ),
    "cable": Gimbal(
        "cable camera: pan over roll over tilt, arms far out",
        (
            Axis("yaw", YAW, (0, 0, -0.1), Body(1.4, (-0.1, 0, -0.1), (0.3, 0.08, 0.2))),
            Axis("roll", ROLL, (-0.2, 0, -0.18), Body(0.9, (0.05, 0.02, 0), (0.1, 0.35, 0.06))),
            Axis("pitch", PITCH, (0.2, 0, 0), Body(0.8, (0, 0.02, -0.06), (0.2, 0.32, 0.05))),
        ),
        Body(3.0, (0.01, 0.004, 0.012), (0.2, 0.15, 0.14)),
        500,
        1,
    ),
    "ring": Gimbal(
        "two-axis ring head: yaw ring, pitch trunnions",
        (
            Axis("yaw", YAW, (0, 0, 0), Body(0.7, (0, 0, 0.01), (0.2, 0.2, 0.04))),
            Axis("pitch", PITCH, (0, 0, 0), Body(0.3, (0.003, 0, 0.002), (0.12, 0.16, 0.03))),
        ),
        Body(0.6, (0.004, 0.001, -0.003), (0.1, 0.07, 0.07)),
        250,
        1,
    ),
    "pitch-last-offset": Gimbal(
        "three-axis head whose axes do not meet",
        (
            Axis("yaw", YAW, (0, 0, 0.05), Body(0.4, (-0.04, 0.02, 0.04), (0.12, 0.05, 0.1))),
            Axis("roll", ROLL, (-0.09, 0.01, 0.08), Body(0.3, (0.03, 0.03, 0), (0.05, 0.14, 0.04))),
            Axis("pitch", PITCH, (0.08, 0.03, 0.01), Body(0.25, (0, -0.03, -0.02), (0.1, 0.1, 0.03))),
        ),
        Body(1.0, (0.003, 0.002, 0.005), (0.08, 0.11, 0.08)),
        800,
        2,
    ),
}


def draw_body(body: Body, rng: np.random.Generator) -> Body:
    """10 to 20 % heavier or lighter, its centre up to 2 mm elsewhere."""
    share = 1 + rng.choice([-1, 1]) * rng.uniform(0.1, 0.2)
    x, y, z = np.array(body.centre) + rng.uniform(-0.002, 0.002, 3)
    return Body(float(body.mass * share), (float(x), float(y), float(z)), body.box)


def swap_camera(gimbal: Gimbal, situation: str, rng: np.random.Generator) -> Gimbal:
    """What the camera's URDF should have said."""
    camera, way = gimbal.camera, rng.normal(size=3)
    far = {"urdf": 0.0, "shifted": rng.uniform(0.003, 0.008)}.get(situation, rng.uniform(0.005, 0.012))
    x, y, z = np.array(camera.centre) + far * way / np.linalg.norm(way)
    camera = replace(camera, centre=(float(x), float(y), float(z)))
    if situation in ("other", "weighed"):
        a, b, c = np.array(camera.box) * rng.uniform(0.8, 1.3, 3)
        camera = Body(float(camera.mass * rng.uniform(0.7, 1.4)), camera.centre, (float(a), float(b), float(c)))
    return replace(gimbal, camera=camera)


def record(truth: Gimbal, friction: Array, motion: Path, log: Path, rng: np.random.Generator) -> None:
    """A PID of each joint follows the motion in MuJoCo against Coulomb and viscous friction (2, n); writes its log."""
    table = np.genfromtxt(motion, delimiter=",", names=True)
    names = [each.name for each in truth.axes]
    reference = np.column_stack([table[f"q_{name}"] for name in names])
    dt = 1 / truth.rate
    wanted = np.gradient(reference, dt, axis=0)
    model = rigid_bodies(etree.fromstring(truth.write_urdf(payload=True)))
    model.opt.timestep = dt / SUBSTEPS
    data, step = mujoco.MjData(model), 2 * np.pi / 2**16
    at = [int(model.joint(name).dofadr[0]) for name in names]
    inertia = np.zeros((model.nv, model.nv))
    data.qpos[at] = reference[0]
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, inertia)
    gains = np.diag(inertia)[at]
    coulomb, viscous = friction
    pole, integral = min(25.0, truth.rate / 16), np.zeros(len(at))  # what delay and rate's filter leave stable
    late = [np.array(data.qfrc_bias[at])] * (truth.delay + 1)
    angles, torques, before = [], [], step * np.round(reference[0] / step)
    rate = np.zeros(len(at))
    for aim, speed in zip(reference, wanted):
        angle = step * np.round(data.qpos[at] / step)
        rate += 0.3 * ((angle - before) / dt - rate)
        before, error = angle, aim - angle
        integral += error * dt
        torque: Array = gains * (3 * pole**2 * error + 3 * pole * (speed - rate) + pole**3 * integral)
        late = [*late[1:], torque + rng.normal(0, 0.002, len(at))]
        angles.append(angle)
        torques.append(torque)
        for _ in range(SUBSTEPS):
            v = data.qvel[at]
            data.qfrc_applied[at] = late[0] - coulomb * np.tanh(v / 0.02) - viscous * v
            mujoco.mj_step(model, data)
    head = ["t", *(f"{kind}_{name}" for kind in ("q", "tau", "q_ref") for name in names)]
    rows = np.column_stack([np.arange(len(angles)) * dt, angles, torques, reference])
    np.savetxt(log, rows, delimiter=",", header=",".join(head), comments="", fmt="%.9g")


def call(folder: Path, verb: str, *arguments: str, name: str = "") -> dict[str, Any]:
    """The verb's JSON; of one that fails, `error` and its exit code."""
    out = folder / f"{name or verb}.json"
    told = [COMMAND, verb, *arguments, "--json", str(out)]
    done = subprocess.run(told, cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode:
        return {"error": done.stderr.strip(), "exit": done.returncode}
    result: dict[str, Any] = json.loads(out.read_text())
    return result


def examine(name: str, situation: str, seed: int, folder: Path) -> dict[str, Any]:
    """All verbs on one log; their results and the truth."""
    gimbal = PLANTS[name]
    drawn = [seed, list(PLANTS).index(name)]
    rng = np.random.default_rng(drawn)
    rig = replace(gimbal, axes=tuple(replace(each, body=draw_body(each.body, rng)) for each in gimbal.axes))
    friction = rng.uniform([[0.01], [0.005]], [[0.03], [0.02]], (2, len(rig.axes)))
    rng = np.random.default_rng([*drawn, SITUATIONS.index(situation)])
    truth = swap_camera(rig, situation, rng)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "plant.urdf").write_text(gimbal.write_urdf(payload=False))
    camera = f'<robot name="camera">{gimbal.camera.write_link("camera_body")}</robot>'
    (folder / "camera.urdf").write_text(camera)
    joints = "".join(f"  {each.name}: {{acceleration: 20}}\n" for each in gimbal.axes)
    (folder / "rig.yaml").write_text(f"urdf: plant.urdf\npayload: camera.urdf\nlimits:\n{joints}")
    results = {"excite": call(folder, "excite", "rig.yaml", "-o", "motion.csv", "--rate", str(gimbal.rate))}
    if "error" not in results["excite"]:
        record(truth, friction, folder / "motion.csv", folder / "log.csv", rng)
        told = ["--mass", str(truth.camera.mass)] if situation == "weighed" else []
        results["identify"] = call(folder, "identify", "rig.yaml", "log.csv", *told, "-o", "model.yaml")
        known = folder.parent / f"{name}-urdf" / "model.yaml"
        if situation != "urdf" and known.exists():
            told = [*told, "--known", str(known)]
            results["swap"] = call(folder, "identify", "rig.yaml", "log.csv", *told, "-o", "swapped.yaml", name="swap")
            told = told[:-2]
        results["diagnose"] = call(folder, "diagnose", "rig.yaml", "log.csv", *told, "-o", "findings")
        results["tune"] = call(folder, "tune", "rig.yaml", "model.yaml", "-o", "controller.yaml")
        results["track"] = call(folder, "track", "rig.yaml", "controller.yaml", "--model", "model.yaml")
    result = {
        "plant": name,
        "situation": situation,
        "stated": {"mass": gimbal.camera.mass, "centre": gimbal.camera.centre},
        "last_body": [
            {"mass": each.axes[-1].body.mass, "centre": each.axes[-1].body.centre} for each in (gimbal, truth)
        ],
        "truth": {"mass": truth.camera.mass, "centre": truth.camera.centre},
        "results": results,
    }
    (folder / "result.json").write_text(json.dumps(result))
    return result


HEAD = (
    "plant", "situation", "verb", "mass error %", "deviations", "centre error mm", "deviations",
    "with the last body mm", "beyond", "verdict", "claimed ratio",
)  # fmt: skip


def judge(result: dict[str, Any], verb: str) -> tuple[list[str], bool]:
    """A row of the table; whether all that was stated is within what is asked.

    A mass that is not known leaves the place a function of it, which is asked at the true mass. A place or mass whose
    deviation is beyond what is asked is no figure, if it is told what makes it one (a known gimbal, or the structure
    that is left at a joint): it may be wrong by three deviations alone.
    `with the last body` compares the first moment of camera and last body together, across the last axis, y: the
    torques show no more than this sum.
    """
    results, stated, truth = result["results"], result["stated"], result["truth"]
    told = results.get(verb, {"error": "not run"})
    row = [result["plant"], result["situation"], verb]
    if "error" in told:
        return [*row, told["error"][:80], *[""] * (len(HEAD) - 4)], False
    camera = (told.get("given_model") or {}).get("camera") or {}
    opinions = {each["opinion"] for each in told.get("misfit", {}).values()}
    is_told = camera.get("com_std_if_known_mm") is not None or opinions != {"explained"}
    mass, weighed = camera.get("mass"), bool(camera.get("weighed"))
    found = stated["mass"] + (mass or 0) / 1000
    beyond, good, mass_words = 0, True, ["unknown", ""]
    if mass is not None and weighed:
        mass_words = ["told", ""]
    elif mass is not None:
        share, score = found / truth["mass"] - 1, abs(found - truth["mass"]) * 1000 / camera["mass_std"]
        mass_words = [f"{100 * share:.1f}", f"{score:.1f}"]
        beyond += score > DEVIATIONS
        good &= abs(share) <= MASS_SHARE or (camera["mass_std"] > 1000 * MASS_SHARE * truth["mass"] and is_told)
    errors, scores, sums = [], [], []
    first, last = result["last_body"]
    unknown = 1000 * (truth["mass"] - found) * np.array(camera.get("com_mm_per_g") or np.zeros(3))
    for axis, (moved, std) in enumerate(zip(camera.get("com_mm") or [], camera.get("com_std_mm") or [])):
        if moved is None or not std:
            continue
        centre = stated["centre"][axis] + (moved + unknown[axis]) / 1000
        errors.append(abs(centre - truth["centre"][axis]) * 1000)
        scores.append(errors[-1] / std)
        good &= errors[-1] <= CENTRE_MM or (std > CENTRE_MM and is_told)
        if axis == 1:
            continue
        moment = truth["mass"] * truth["centre"][axis] + last["mass"] * last["centre"][axis]
        sums.append(abs(found * centre + first["mass"] * first["centre"][axis] - moment) / found * 1000)
    beyond += sum(score > DEVIATIONS for score in scores)
    good &= not beyond
    largest = [f"{max(each):.2f}" if each else "unknown" for each in (errors, scores, sums)]
    experiments = results.get("track", {}).get("experiments", [])
    rms = {
        each["controller"]: np.mean([joint["rms_error"] for joint in each["joints"].values()])
        for each in experiments
        if each["name"] == "all-axes"
    }
    ratio = f"{rms['pid'] / rms['computed-torque']:.1f}" if {"pid", "computed-torque"} <= set(rms) else "none"
    verdict = results.get("diagnose", {}).get("verdict", "error")
    return [*row, *mass_words, *largest, str(beyond), verdict, ratio], bool(good)


def main(arguments: Sequence[str] | None = None) -> int:
    """Examine, print the table; 1 if something is not within what is asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--plants", type=int, default=len(PLANTS), help="how many of them")
    parser.add_argument("--situations", nargs="+", choices=SITUATIONS, default=SITUATIONS)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--output", type=Path, default=Path("out/plants"), help="goes on there where it stopped")
    told = parser.parse_args(arguments)
    print("| " + " | ".join(HEAD) + " |\n" + "|---" * len(HEAD) + "|")
    outcomes = []
    for name in list(PLANTS)[: told.plants]:
        for situation in told.situations:
            folder = told.output.resolve() / str(told.seed) / f"{name}-{situation}"
            done = folder / "result.json"
            result = json.loads(done.read_text()) if done.exists() else examine(name, situation, told.seed, folder)
            for verb in ("identify", "swap"):
                if verb == "identify" or verb in result["results"]:
                    row, good = judge(result, verb)
                    outcomes.append(good)
                    print("| " + " | ".join(row) + " |", flush=True)
    print(f"\n{sum(outcomes)} of {len(outcomes)} within what is asked")
    return 0 if all(outcomes) else 1


if __name__ == "__main__":
    sys.exit(main())
