"""``gimbal-pin simulate``."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from tyro.conf import UseAppendAction, arg

from gimbal_pin.cli.inputs import carried, load_rig, mounted, plant_of, play, read_controller, shown_somewhere
from gimbal_pin.cli.options import Bandwidth, Map, MaybeOutput, ModelFile, Payload, RigName, Seed

if TYPE_CHECKING:
    from gimbal_pin.model import Model
    from gimbal_pin.tuning import Law


def simulate(
    rig: RigName,
    output: MaybeOutput = None,
    *,
    payload: Payload = None,
    model: ModelFile = None,
    controller: Annotated[str, arg(help="computed-torque, pid, or a controller's YAML")] = "computed-torque",
    reference: Annotated[
        Path | None, arg(help="trajectory file; None: a quickly designed excitation, repeated")
    ] = None,
    seconds: Annotated[float, arg(help="length, s, where no trajectory is given")] = 60.0,
    bandwidth_hz: Bandwidth = 8.0,
    delay_samples: Annotated[int, arg(help="samples between measurement and torque")] = 1,
    effect: Annotated[
        UseAppendAction[tuple[str, ...]],
        arg(metavar="CAUSE:JOINT:NAME=VALUE,…", help="plant a cause, e.g. cogging:yaw:amplitude=0.03,harmonic=42"),
    ] = (),
    torque_noise: Annotated[float, arg(help="noise on the reported torque, share of its rms")] = 0.01,
    encoder_bits: Annotated[float | None, arg(help="resolution of the encoders; None: the rig's own")] = None,
    platform: Annotated[
        Literal["none", "S"], arg(help="what carries the rig: nothing that moves, or profile S, seeded")
    ] = "none",
    platform_log: Annotated[
        Path | None,
        arg(
            metavar="FILE",
            help="motion of the platform: gyro_ and accel_ of the base link, low-passed at 20 Hz",
            help_behavior_hint="",
        ),
    ] = None,
    platform_size: Annotated[float, arg(help="profile S times this")] = 1.0,
    map: Map = (),
    rates: Annotated[bool, arg(help="record joint rates (dq_); without them they are differentiated angles")] = True,
    imus: Annotated[bool, arg(help="record every IMU of the rig's YAML, not the platform's alone")] = False,
    live: Annotated[bool, arg(help="show it in a browser")] = False,
    seed: Seed = 0,
) -> None:
    """Simulate the closed loop and write what its sensors say as a log."""
    import numpy as np

    from gimbal_pin.effects.parse import parse_effect
    from gimbal_pin.experiment import bench_run
    from gimbal_pin.io import read_motion, write_log
    from gimbal_pin.simulation import plant_with

    shown_somewhere(output, live)
    loaded = load_rig(rig, payload or (mounted(str(model)) if model else None))
    known = plant_of(model, loaded)
    law = law_of(controller, known, bandwidth_hz)
    plant, drive = plant_with(known, [parse_effect(text, loaded) for text in effect])
    motion = None if reference is None else read_motion(reference, loaded)
    asked = seconds if motion is None else float(motion.t[-1] - motion.t[0])
    carrier = carried(loaded, platform, platform_log, map, platform_size, asked, law.dt, seed)
    if carrier is not None and carrier.t[-1] < asked - law.dt / 2:
        seconds, motion = float(carrier.t[-1]), None if motion is None else motion.until(float(carrier.t[-1]))
        print(
            f"gimbal-pin: note: {platform_log} ends after {seconds:.3g} s, and so does the simulation", file=sys.stderr
        )
    log = bench_run(
        plant,
        law,
        rng=np.random.default_rng(seed),
        seconds=seconds,
        torque_noise=torque_noise,
        encoder_bits=encoder_bits,
        delay=delay_samples,
        reference=motion,
        drive=drive,
        platform=carrier,
        imus=loaded.config.imus if imus else (),
    )
    if not rates:
        log = replace(log, v=None)
    if output is not None:
        write_log(log, output)
        print(f"{len(log)} samples, {log.t[-1]:.1f} s → {output}")
    if live:
        play(loaded, log)


def law_of(name: str, plant: Model, bandwidth_hz: float) -> Law:
    """Return the controller of a name, tuned for the plant, or of a YAML."""
    from gimbal_pin.tuning import tune as run

    if name in ("computed-torque", "pid"):
        return run(plant, kind=name, bandwidth_hz=bandwidth_hz).controller
    return read_controller(name, plant.rig)
