"""``gimbal-pin simulate``."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Literal

from gimbal_pin.cli import options as opt
from gimbal_pin.cli.inputs import load_rig, read_payload, read_plant, read_platform, read_tuned
from gimbal_pin.cli.present import check_shown, play, say, tell

if TYPE_CHECKING:
    from gimbal_pin.dynamics.model import Model
    from gimbal_pin.dynamics.simulation import Controller
    from gimbal_pin.log.log import Log
    from gimbal_pin.rig.rig import Rig


def simulate(
    rig: opt.RigName,
    output: opt.MaybeOutput = None,
    *,
    payload: opt.Payload = None,
    model: opt.ModelFile = None,
    controller: str = "computed-torque",
    reference: opt.File = None,
    seconds: Annotated[float, opt.between("--seconds", 0.1, 86400, "s")] = 60.0,
    bandwidth_hz: Annotated[float, opt.HERTZ] = 8.0,
    delay_samples: Annotated[opt.Maybe[int], opt.DELAY_SAMPLES] = None,
    effect: opt.Effects = (),
    platform: Literal["none", "S"] = "none",
    platform_log: opt.File = None,
    platform_size: opt.PlatformSize = 1.0,
    map: opt.Map = (),
    torque_noise: opt.TorqueNoise = 0.01,
    encoder_bits: Annotated[opt.Maybe[float], opt.between("--encoder-bits", 1, 64)] = None,
    rates: bool = True,
    imus: bool = False,
    live: opt.LiveView = False,
    seed: opt.Seed = 0,
) -> None:
    """Simulate the closed loop and write what its sensors say as a log.

    Args:
        controller: computed-torque, pid, a controller's YAML, or its compiled library (.so), see export
        reference: trajectory file (default: a quickly designed excitation, repeated)
        seconds: length where no trajectory is given
        bandwidth_hz: bandwidth of the tracking error
        delay_samples: samples between measurement and torque (default: what the controller was tuned for, else 1)
        platform: what carries the rig: nothing that moves, or profile S, seeded
        platform_log: motion of the platform: gyro_ and accel_ of the base link, low-passed at 20 Hz
        encoder_bits: resolution of the encoders (default: the rig's own)
        rates: record joint rates (dq_); without them they are differentiated angles
        imus: record every IMU of the rig's YAML, not the platform's alone
    """
    import numpy as np

    from gimbal_pin.control.experiment import bench_run
    from gimbal_pin.dynamics.simulation import plant_with
    from gimbal_pin.effects.parse import format_causes, parse_effect
    from gimbal_pin.log import profile_s, read_motion, write_log

    if "help" in effect:
        return say(format_causes())
    check_shown(output, live)
    loaded = load_rig(rig, payload or read_payload(model))
    known = read_plant(model, loaded)
    motion = None if reference is None else read_motion(reference, loaded)
    length = seconds if motion is None else float(motion.t[-1] - motion.t[0])
    law, tuned = choose_law(controller, known, bandwidth_hz)
    late = tuned if delay_samples is None else delay_samples
    carrier = read_platform(loaded, platform, platform_log, map)
    if platform == "S":
        times = law.dt / 2 * np.arange(2 * round(length / law.dt) + 1)
        carrier = profile_s(times, np.random.default_rng(seed), platform_size)
    if carrier is not None and carrier.t[-1] < length - law.dt / 2:
        length = float(carrier.t[-1])
        tell([f"{platform_log} ends after {length:.3g} s, and so does the simulation"])
        motion = None if motion is None else motion.until(length)
    plant, drive = plant_with(known, [parse_effect(cause, loaded) for cause in effect])
    log = bench_run(
        plant, law, rng=np.random.default_rng(seed), seconds=length, torque_noise=torque_noise,
        encoder_bits=encoder_bits, delay=late, reference=motion, drive=drive, platform=carrier,
        imus=loaded.config.imus if imus else (),
    )  # fmt: skip
    log = log if rates else replace(log, v=None)
    tell(log.events)
    if output is not None:
        write_log(log, output)
        say(f"{len(log)} samples, {log.t[-1]:.1f} s → {output}\n{describe_errors(loaded, log)}")
    if live:
        play(loaded, log)


def choose_law(name: str, plant: Model, bandwidth_hz: float) -> tuple[Controller, int]:
    """Return the controller of a name, tuned for the plant, of a YAML, or of a compiled library, and its delay."""
    from gimbal_pin.control.laws.design import Wish
    from gimbal_pin.control.tuning import tune
    from gimbal_pin.export import Library

    if name in ("computed-torque", "pid"):
        return tune(plant, kind=name, bandwidth_hz=bandwidth_hz, dt=Wish.dt).controller, 1
    if name.endswith(".so"):
        return Library.load(name, plant.rig).law, 1
    stored = read_tuned(name, plant.rig)
    return stored.law, stored.wish.samples


def describe_errors(rig: Rig, log: Log) -> str:
    """Say how far the measured angles are off the reference, rms."""
    import numpy as np

    from gimbal_pin.report.format import list_shown_joints

    assert log.q_ref is not None
    off = np.sqrt(np.mean((log.q_ref - log.q) ** 2, axis=0)).tolist()
    return f"error, rms: {', '.join(f'{joint.name} {joint.text(x)}' for joint, x in zip(list_shown_joints(rig), off))}"
