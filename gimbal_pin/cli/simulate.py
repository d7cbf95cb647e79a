"""``gimbal-pin simulate``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from tyro.conf import OmitArgPrefixes, arg

from gimbal_pin.cli.inputs import carried, load_rig, mounted, plant_of, play, read_controller, shown_somewhere
from gimbal_pin.cli.options import (
    DELAY_SAMPLES,
    HERTZ,
    Effects,
    Map,
    MaybeOutput,
    ModelFile,
    Payload,
    PlatformSize,
    RigName,
    Seed,
    Yes,
    between,
    optional,
)
from gimbal_pin.cli.paths import Reads, logs
from gimbal_pin.cli.present import noted, say
from gimbal_pin.cli.work import affordable

if TYPE_CHECKING:
    from gimbal_pin.dynamics.model import Model
    from gimbal_pin.dynamics.simulation import Controller
    from gimbal_pin.log.log import Log, Motion
    from gimbal_pin.log.platform import Platform
    from gimbal_pin.rig.rig import Rig


@dataclass(frozen=True)
class Carrying:
    """Options of what carries the rig."""

    platform: Annotated[
        Literal["none", "S"], arg(help="what carries the rig: nothing that moves, or profile S, seeded")
    ] = "none"
    platform_log: Annotated[
        Path | None,
        Reads(logs),
        optional("FILE", "motion of the platform: gyro_ and accel_ of the base link, low-passed at 20 Hz"),
    ] = None
    platform_size: PlatformSize = 1.0
    map: Map = ()

    def carrier(self, rig: Rig, seconds: float, dt: float, seed: int) -> Platform | None:
        """Return the platform's motion, which may be shorter than what is asked for: then that is told."""
        found = carried(rig, self.platform, self.platform_log, self.map, self.platform_size, seconds, dt, seed)
        if found is not None and found.t[-1] < seconds - dt / 2:
            told = f"{self.platform_log} ends after {found.t[-1]:.3g} s, and so does the simulation"
            noted([told])
        return found


@dataclass(frozen=True)
class Recording:
    """Options of what the log holds."""

    torque_noise: Annotated[
        float, between("--torque-noise", 0, 10), arg(help="noise on the reported torque, share of its rms")
    ] = 0.01
    encoder_bits: Annotated[
        float | None, between("--encoder-bits", 1, 64), optional(None, "resolution of the encoders", "the rig's own")
    ] = None
    rates: Annotated[bool, arg(help="record joint rates (dq_); without them they are differentiated angles")] = True
    imus: Annotated[bool, arg(help="record every IMU of the rig's YAML, not the platform's alone")] = False


STANDING, USUAL = Carrying(), Recording()


def simulate(
    rig: RigName,
    output: MaybeOutput = None,
    *,
    payload: Payload = None,
    model: ModelFile = None,
    controller: Annotated[
        str, Reads(), arg(help="computed-torque, pid, a controller's YAML, or its compiled library (.so), see export")
    ] = "computed-torque",
    reference: Annotated[
        Path | None, Reads(logs), arg(help="trajectory file; None: a quickly designed excitation, repeated")
    ] = None,
    seconds: Annotated[
        float, between("--seconds", 0.1, 86400, "s"), arg(help="length where no trajectory is given")
    ] = 60.0,
    bandwidth_hz: Annotated[float, HERTZ, arg(help="bandwidth of the tracking error")] = 8.0,
    delay_samples: Annotated[int, DELAY_SAMPLES, arg(help="samples between measurement and torque")] = 1,
    effect: Effects = (),
    carrying: Annotated[Carrying, OmitArgPrefixes] = STANDING,
    recording: Annotated[Recording, OmitArgPrefixes] = USUAL,
    live: Annotated[bool, arg(help="show it in a browser")] = False,
    seed: Seed = 0,
    yes: Yes = False,
) -> None:
    """Simulate the closed loop and write what its sensors say as a log."""
    from gimbal_pin.effects.parse import format_causes
    from gimbal_pin.log.io import read_motion, write_log

    if "help" in effect:
        say(format_causes())
        return
    shown_somewhere(output, live)
    loaded = load_rig(rig, payload or mounted(model))
    known = plant_of(model, loaded)
    motion = None if reference is None else read_motion(reference, loaded)
    asked = seconds if motion is None else float(motion.t[-1] - motion.t[0])
    affordable(yes, simulated_second_of_a_joint=asked * loaded.n)
    law = law_of(controller, known, bandwidth_hz)
    carrier = carrying.carrier(loaded, asked, law.dt, seed)
    log = run_of(known, law, effect, motion, asked, delay_samples, carrier, recording, seed)
    noted(log.events)
    if output is not None:
        write_log(log, output)
        say(f"{len(log)} samples, {log.t[-1]:.1f} s → {output}")
    if live:
        play(loaded, log)


def run_of(
    known: Model,
    law: Controller,
    causes: Sequence[str],
    motion: Motion | None,
    seconds: float,
    delay: int,
    carrier: Platform | None,
    recording: Recording,
    seed: int,
) -> Log:
    """Return the log of a run, which is no longer than the platform's motion."""
    import numpy as np

    from gimbal_pin.control.experiment import bench_run
    from gimbal_pin.dynamics.simulation import plant_with
    from gimbal_pin.effects.parse import parse_effect

    rig = known.rig
    plant, drive = plant_with(known, [parse_effect(text, rig) for text in causes])
    if carrier is not None and carrier.t[-1] < seconds - law.dt / 2:
        seconds = float(carrier.t[-1])
        motion = None if motion is None else motion.until(seconds)
    log = bench_run(
        plant,
        law,
        rng=np.random.default_rng(seed),
        seconds=seconds,
        torque_noise=recording.torque_noise,
        encoder_bits=recording.encoder_bits,
        delay=delay,
        reference=motion,
        drive=drive,
        platform=carrier,
        imus=rig.config.imus if recording.imus else (),
    )
    return log if recording.rates else replace(log, v=None)


def law_of(name: str, plant: Model, bandwidth_hz: float) -> Controller:
    """Return the controller of a name, tuned for the plant, of a YAML, or of a compiled library."""
    from gimbal_pin.control.laws.design import Wish
    from gimbal_pin.control.tuning import tune as run

    if name in ("computed-torque", "pid"):
        return run(plant, kind=name, bandwidth_hz=bandwidth_hz, dt=Wish.dt).controller
    if name.endswith(".so"):
        from gimbal_pin.export import Library

        return Library.load(name, plant.rig).law
    return read_controller(name, plant.rig).law
