"""``gimbal-pin VERB``: every verb is one library call, printed for a person or written as JSON."""

from __future__ import annotations

import contextlib
import functools
import inspect
import io
import re
import sys
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro
from tyro.conf import Positional, UseAppendAction, arg

from gimbal_pin import text
from gimbal_pin.errors import GimbalPinError, UsageError

if TYPE_CHECKING:
    from gimbal_pin.effects import Effect
    from gimbal_pin.estimators import Estimator
    from gimbal_pin.log import Array, Log
    from gimbal_pin.model import Model
    from gimbal_pin.payloads import Several
    from gimbal_pin.platform import Platform
    from gimbal_pin.rig import Rig
    from gimbal_pin.rows import Filtering
    from gimbal_pin.tuning import Law

RigName = Annotated[Positional[str], arg(metavar="RIG", help="bundled rig, URDF, or YAML that names a URDF")]
Logs = Annotated[
    Positional[tuple[str, ...]],
    arg(metavar="LOG …", help="CSV or Parquet; LOG@PAYLOAD names its payload", help_behavior_hint="(at least one)"),
]
Payload = Annotated[
    str | None, arg(metavar="NAME", help="bundled payload or URDF", help_behavior_hint="(default: the rig's own)")
]
Json = Annotated[
    Path | None, arg(metavar="FILE", help="write the result as JSON; - for standard output", help_behavior_hint="")
]
Map = Annotated[
    UseAppendAction[tuple[str, ...]],
    arg(metavar="COLUMN=SOURCE", help="q_yaw=pos1, tau_yaw=iq*0.0276, t=time, or a YAML file of these; repeatable"),
]
Output = Annotated[Path, arg(aliases=["-o"], metavar="FILE", help="where to write")]
MaybeOutput = Annotated[Path | None, arg(aliases=["-o"], metavar="FILE", help="where to write", help_behavior_hint="")]
Folder = Annotated[Path, arg(aliases=["-o"], metavar="DIR", help="folder for the files, made if it is not there")]
MaybeFolder = Annotated[
    Path | None,
    arg(aliases=["-o"], metavar="DIR", help="folder for the files, made if it is not there", help_behavior_hint=""),
]
ModelFile = Annotated[
    Path | None,
    arg(
        metavar="MODEL",
        help="the plant: a model's YAML, from identify or diagnose",
        help_behavior_hint="(default: the rig as its URDF states it)",
    ),
]
Seed = Annotated[int, arg(help="seed of everything random")]
Cutoff = Annotated[
    float | None,
    arg(metavar="HZ", help="low-pass on every column and on the torque", help_behavior_hint="(default: 4)"),
]
Alignment = Annotated[
    float | None,
    arg(
        metavar="SECONDS",
        help="the torque acts that much later than its stamp",
        help_behavior_hint="(default: half a sample)",
    ),
]
Holdout = Annotated[
    str | None,
    arg(
        metavar="WHAT",
        help="last-third, log:N or none",
        help_behavior_hint="(default: the last third of one log, the last of several)",
    ),
]
EstimatorName = Literal["weighted", "ols", "robust", "instrumental", "output-error", "ridge", "physical"]
Trust = Annotated[
    float | None,
    arg(
        metavar="SHARE",
        help="how far the URDF's bodies may be off: for the ridge estimator, and for what the log does not show",
        help_behavior_hint="(default: 0.3)",
    ),
]
Bootstrap = Annotated[
    int, arg(metavar="COUNT", help="deviations by so many repetitions with blocks of residuals, not by their colour")
]
Bandwidth = Annotated[float, arg(help="bandwidth of the tracking error, Hz")]
Asked = Annotated[
    float | None, arg(metavar="HZ", help="bandwidth, 8 Hz by default; with --disk-margin the highest that keeps it")
]
DiskMargin = Annotated[
    float | None, arg(metavar="MARGIN", help="disk margin (0 to 2) that every joint keeps over the model's uncertainty")
]
Damping = Annotated[float, arg(help="damping of the tracking error")]
Delay = Annotated[float, arg(help="time from measurement to torque, s, without the hold")]
Kind = Literal["computed-torque", "pid"]


def rigs(*, json: Json = None) -> None:
    """List the bundled rigs and payloads."""
    from gimbal_pin.checking import listing

    listed = listing()
    present(text.rigs(listed), listed, json)


def check(rig: RigName, *, payload: Payload = None, json: Json = None) -> None:
    """Validate a rig: tree, axes, limits, inertias, camera frame; say what a log must hold."""
    from gimbal_pin.checking import check as run

    found = run(load_rig(rig, payload))
    present(text.check(found), found.to_dict(), json)


def base(
    rig: RigName,
    *,
    payload: Payload = None,
    diagonal: Annotated[bool, arg(help="diagonal inertias and no masses, as in the thesis")] = False,
    json: Json = None,
) -> None:
    """Base parameters: what the joint torques can show, the regrouping, what they cannot."""
    from gimbal_pin.base import base as run

    found = run(load_rig(rig, payload), diagonal)
    present(text.base(found), found.to_dict(), json)


def excite(
    rig: RigName,
    output: Output,
    *,
    payload: Payload = None,
    seconds: Annotated[float, arg(help="length of the motion, which repeats, s")] = 10.0,
    harmonics: Annotated[int, arg(help="harmonics of the Fourier series")] = 5,
    starts: Annotated[int, arg(help="random starts of the optimisation")] = 5,
    criterion: Literal["condition", "determinant"] = "condition",
    after: Annotated[
        tuple[str, ...],
        arg(
            metavar="LOG …",
            help="earlier logs: design what teaches most beyond them, by log det of the information",
            help_behavior_hint="",
        ),
    ] = (),
    map: Map = (),
    effect: Annotated[
        UseAppendAction[tuple[str, ...]],
        arg(metavar="CAUSE:JOINT:NAME=VALUE,…", help="a cause to be shown as well, as simulate plants it; of any size"),
    ] = (),
    model: ModelFile = None,
    margin: Annotated[float, arg(help="share of every limit that is left free")] = 0.05,
    clearance: Annotated[float, arg(help="distance that parts keep which can hit each other, m")] = 0.005,
    speed: Annotated[float, arg(help="rms rate that shows friction, share of the rate limit")] = 0.3,
    rate: Annotated[float, arg(help="samples per second of the file, Hz")] = 1000.0,
    seed: Seed = 0,
    json: Json = None,
) -> None:
    """Design an excitation trajectory under the rig's limits."""
    import numpy as np

    from gimbal_pin.excitation import excite as run
    from gimbal_pin.excitation import sequential
    from gimbal_pin.io import write_motion

    positive("--rate", rate)
    camera = payload or (mounted(str(model)) if model else None)
    loaded, read = load_logs(rig, camera, after, map) if after else (load_rig(rig, camera), [])
    plant = plant_of(model, loaded)
    shown = to_show(plant, effect)
    options: Any = {"seconds": seconds, "harmonics": harmonics, "starts": starts, "dt": 1 / rate, "effects": shown}
    options |= {"margin": margin, "clearance": clearance, "speed": speed, "torque_model": plant}
    options |= {"criterion": sequential(plant.rig, read, seconds, shown) if read else criterion}
    found = run(plant.rig, **options, rng=np.random.default_rng(seed))
    write_motion(found.motion, found.joints, output)
    present(text.excitation(found), found.to_dict(), json)


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
    if output is not None:
        write_log(log, output)
        print(f"{len(log)} samples, {log.t[-1]:.1f} s → {output}")
    if live:
        play(loaded, log)


def identify(
    rig: RigName,
    logs: Logs,
    output: MaybeOutput = None,
    *,
    urdf: Annotated[
        Path | None, arg(metavar="FILE", help="write the rig's URDF with the parameters in it", help_behavior_hint="")
    ] = None,
    payload: Payload = None,
    map: Map = (),
    cutoff: Cutoff = None,
    alignment: Alignment = None,
    estimator: EstimatorName = "weighted",
    holdout: Holdout = None,
    known: Annotated[
        str | None,
        arg(
            metavar="MODEL",
            help="a model's YAML of this gimbal: only the new camera is estimated, 10 s of motion do",
            help_behavior_hint="",
        ),
    ] = None,
    bias: Annotated[bool, arg(help="test whether least squares is biased even where there is little noise")] = False,
    trust: Trust = None,
    bootstrap: Bootstrap = 0,
    seed: Seed = 0,
    follow: Annotated[
        bool, arg(help="learn from one growing CSV file, or from - (standard input), as it is written; Ctrl-C ends it")
    ] = False,
    forget: Annotated[
        float | None,
        arg(metavar="SECONDS", help="with --follow: what is older counts less", help_behavior_hint="(default: never)"),
    ] = None,
    anew: Annotated[
        Literal["payload", "everything"],
        arg(help="with --follow: what is estimated anew when the payload has changed"),
    ] = "payload",
    idle: Annotated[
        float | None,
        arg(
            metavar="SECONDS",
            help="with --follow: end when the file has not grown for so long",
            help_behavior_hint="(default: never)",
        ),
    ] = None,
    plot: Annotated[
        Path | None,
        arg(
            metavar="FILE",
            help="with --follow: write the estimates over time: .png, .svg or .pdf",
            help_behavior_hint="",
        ),
    ] = None,
    json: Json = None,
) -> None:
    """Model with uncertainty from logs, and its fit on held-out data; LOG@PAYLOAD … of several cameras at once."""
    from gimbal_pin.balance import reported
    from gimbal_pin.bodies import TRUST
    from gimbal_pin.identification import identify as run
    from gimbal_pin.io.files import atomic_write
    from gimbal_pin.io.model import write_model

    trusted = TRUST if trust is None else trust
    method = estimator_of(estimator, trusted, bootstrap, seed)
    options: Any = {"estimator": method, "holdout": holdout, "filtering": filtering(cutoff, alignment)}
    if follow:
        batch_only = {
            "--estimator": estimator != "weighted",
            "--holdout": holdout is not None,
            "--bias": bias,
            "--trust": trust is not None,
            "--bootstrap": bootstrap > 0,
        }
        alone("--follow", batch_only, "it learns by weighted least squares and is tested on what comes next")
        wish = {"fading": inf if forget is None else forget, "everything": anew == "everything"}
        followed(
            rig, payload, logs, map, known, {**wish, "filtering": options["filtering"]}, idle, output, urdf, plot, json
        )
        return
    given = {"--forget": forget, "--idle": idle, "--plot": plot, "--anew": anew if anew != "payload" else None}
    alone("a log that is whole", {name: value is not None for name, value in given.items()}, "add --follow")
    if known is not None or len(tags_of(logs)) > 1:
        several = cameras(rig, payload, logs, map, known, options)
        if urdf is not None:
            raise UsageError("--urdf", "takes one payload", "write it from that payload's logs alone")
        if output is not None:
            write_model(several.first, output, several.identified)
        present(text.several(several), several.to_dict(), json)
        return
    loaded, read = load_logs(rig, payload, logs, map)
    found = replace(run(loaded, read, **options, examined="always" if bias else "noisy"), trust=trusted)
    if output is not None:
        write_model(found, output)
    if urdf is not None:
        atomic_write(urdf, found.to_urdf())
    present(text.identified(found), reported(found), json)


def estimator_of(name: EstimatorName, trust: float, bootstrap: int, seed: int) -> Estimator:
    """Return the estimator of a name, its deviations by repetition if so many are asked for."""
    from gimbal_pin.estimators import ESTIMATORS, Bootstrap, Ridge

    ridge = Ridge(trust)  # it checks the trust, which matters to all
    chosen = ridge if name == "ridge" else ESTIMATORS[name]
    if bootstrap == 0:
        return chosen
    import numpy as np

    return Bootstrap(chosen, np.random.default_rng(seed), bootstrap)


def tune(
    rig: RigName,
    source: Annotated[Positional[tuple[str, ...]], arg(metavar="LOG|MODEL", help="logs, or a model's YAML")],
    output: MaybeOutput = None,
    *,
    payload: Payload = None,
    map: Map = (),
    cutoff: Cutoff = None,
    kind: Kind = "computed-torque",
    bandwidth_hz: Asked = None,
    disk_margin: DiskMargin = None,
    damping: Damping = 1.0,
    delay: Delay = 0.001,
    robust: Annotated[bool, arg(help="add Lyapunov redesign")] = False,
    plot: Annotated[Path | None, arg(metavar="FILE", help="write the loops' plots: .png, .svg or .pdf")] = None,
    json: Json = None,
) -> None:
    """Gains, margins and robust term from logs or from a model."""
    from gimbal_pin.io.files import replacing, write_yaml
    from gimbal_pin.tuning import tune as run

    model = model_of(rig, payload, source, map, cutoff)
    found = run(
        model,
        kind=kind,
        bandwidth_hz=bandwidth_hz,
        damping=damping,
        delay=delay,
        disk_margin=disk_margin,
        robust=robust,
    )
    if output is not None:
        write_yaml(found.to_dict(), output)
    if plot is not None:
        with replacing(plot) as temporary:
            found.plot().savefig(temporary)
    present(text.tuning(found), found.to_dict(), json)


def track(
    rig: RigName,
    controller: Annotated[
        Positional[str | None],
        arg(metavar="CONTROLLER", help="a controller's YAML, from tune; on a platform its model is what is known"),
    ] = None,
    *,
    payload: Payload = None,
    model: ModelFile = None,
    delay_samples: Annotated[int, arg(help="samples between measurement and torque")] = 1,
    platform: Annotated[
        Literal["none", "S"], arg(help="hold the camera still on a platform that moves along profile S")
    ] = "none",
    platform_log: Annotated[
        Path | None,
        arg(
            metavar="FILE",
            help="or along a recorded motion: gyro_ and accel_ of the base link, low-passed at 20 Hz",
            help_behavior_hint="",
        ),
    ] = None,
    platform_size: Annotated[float, arg(help="profile S times this")] = 1.0,
    map: Map = (),
    controllers: Annotated[
        str | None,
        arg(metavar="NAME,…", help="which controllers meet the platform", help_behavior_hint="(default: all)"),
    ] = None,
    learn: Annotated[
        str | None,
        arg(
            metavar="LOG",
            help="a log of the rig on a shaken platform: model and the platform's spectrum come from it",
            help_behavior_hint="(default: one is simulated, 60 s)",
        ),
    ] = None,
    find: Annotated[bool, arg(help="let diagnose look for causes in that log, and compensate them")] = False,
    effect: Annotated[
        UseAppendAction[tuple[str, ...]],
        arg(metavar="CAUSE:JOINT:NAME=VALUE,…", help="plant a cause, e.g. cogging:yaw:amplitude=0.1,harmonic=42"),
    ] = (),
    seeds: Annotated[int, arg(help="runs on a platform, each with its own motion and noise")] = 5,
    seconds: Annotated[float, arg(help="length of each of these runs, s")] = 30.0,
    jobs: Annotated[int, arg(help="processes that share these runs")] = 1,
    plot: Annotated[
        Path | None,
        arg(metavar="FILE", help="draw line of sight, spectrum, torque and budget", help_behavior_hint=""),
    ] = None,
    seed: Seed = 0,
    json: Json = None,
) -> None:
    """Step tracking against a PID; on a platform that moves, every camera-holding controller at equal margins."""
    import numpy as np

    from gimbal_pin.tracking import track as run

    moving = platform != "none" or platform_log is not None
    if controller is None and not moving:
        mend = "name a controller's YAML, or a motion: --platform S, --platform-log FILE"
        raise UsageError("CONTROLLER", "is missing", mend)
    loaded = load_rig(rig, payload or (mounted(controller) if controller else None))
    told, result = [], {}
    if controller is not None:
        found = run(
            plant_of(model, loaded), rivals(controller, loaded), rng=np.random.default_rng(seed), delay=delay_samples
        )
        stood = "the rig as its URDF states it" if model is None else f"the model in {model}"
        told, result = [text.tracking(found, stood)], found.to_dict()
    if moving:
        from gimbal_pin.io.files import replacing
        from gimbal_pin.pointing.chart import chart
        from gimbal_pin.pointing.verify import Asked, verify

        for option, value in (("--seconds", seconds), ("--seeds", seeds), ("--jobs", jobs)):
            positive(option, value)
        carrier = carried(loaded, platform, platform_log, map, 1.0, 0.0, 1e-3, seed)
        asked = Asked(
            plant=None if model is None else plant_of(model, loaded),
            known=None if controller is None else known_by(controller, loaded),
            recorded=carrier if platform_log else None,
            size=platform_size,
            names=None if controllers is None else tuple(controllers.split(",")),
            log=None if learn is None else load_logs(rig, loaded.payload, [learn], map)[1][0],
            find=find,
            causes=tuple(effect),
            seeds=seeds,
            seconds=seconds,
            jobs=jobs,
            delay=delay_samples,
        )
        verified = verify(loaded, asked)
        if plot is not None:
            with replacing(plot) as temporary:
                chart(verified.contest).savefig(temporary)
        told, result = [*told, text.verified(verified)], {**result, **verified.to_dict()}
    present("\n\n".join(told), {"schema": 1, "experiments": [], **result}, json)


def animate(
    rig: RigName,
    log: Annotated[Positional[str], arg(metavar="LOG", help="a log or trajectory")],
    output: MaybeOutput = None,
    *,
    payload: Payload = None,
    map: Map = (),
    speed: Annotated[float, arg(help="seconds of the log per second of playing")] = 1.0,
    fps: Annotated[float | None, arg(help="frames per second; None: what suits the format")] = None,
    ghost: Annotated[bool, arg(help="show the reference as a ghost")] = True,
    at: Annotated[float | None, arg(help="time of a picture, s of the log")] = None,
    residual: Annotated[
        Path | None,
        arg(
            metavar="MODEL",
            help="turn each joint red by what this model's YAML leaves of its torque; all red from a tenth of it on",
            help_behavior_hint="",
        ),
    ] = None,
    live: Annotated[bool, arg(help="play it in a browser, through meshcat's server")] = False,
) -> None:
    """Recorded animation (.html .gif .webp .mp4 .png); HTML needs no display, browser or server."""
    from gimbal_pin import view
    from gimbal_pin.io import read_log, split_payload

    shown_somewhere(output, live)
    loaded = load_rig(rig, payload or split_payload(log)[1] or (mounted(str(residual)) if residual else None))
    read = read_log(log, loaded, map, need_tau=residual is not None)
    colour = None if residual is None else warmth(residual, loaded, read)
    if output is not None:
        for warning in view.save(loaded, read, output, speed=speed, fps=fps, ghost=ghost, colour=colour, at=at):
            print(warning, file=sys.stderr)
        print(f"{read.t[-1] - read.t[0]:.1f} s → {output}")
    if live:
        play(loaded, read)


def diagnose(
    rig: RigName,
    logs: Logs,
    output: MaybeFolder = None,
    *,
    payload: Payload = None,
    map: Map = (),
    cutoff: Annotated[
        float | None, arg(metavar="HZ", help="highest frequency that is looked at", help_behavior_hint="(default: 12)")
    ] = None,
    alignment: Alignment = None,
    holdout: Holdout = None,
    seed: Seed = 0,
    json: Json = None,
) -> None:
    """What the simulation gets wrong, why, the extended model and its gain; with -o the next experiment, too."""
    import numpy as np

    from gimbal_pin.diagnosis import BAND, planned
    from gimbal_pin.diagnosis import diagnose as run
    from gimbal_pin.io.diagnosis import write_diagnosis
    from gimbal_pin.rows import Filtering

    loaded, read = load_logs(rig, payload, logs, map)
    band = Filtering(BAND.cutoff if cutoff is None else cutoff, BAND.smoothing, alignment)
    found = run(loaded, read, rng=np.random.default_rng(seed), holdout=holdout, filtering=band)
    if output is not None:
        found = planned(found, rng=np.random.default_rng(seed))
    files = {} if output is None else write_diagnosis(found, output)
    present(text.diagnosis(found, files), found.to_dict(), json)


def auto(
    rig: RigName,
    logs: Logs,
    output: Folder,
    *,
    payload: Payload = None,
    map: Map = (),
    cutoff: Cutoff = None,
    alignment: Alignment = None,
    estimator: EstimatorName = "weighted",
    holdout: Holdout = None,
    kind: Kind = "computed-torque",
    bandwidth_hz: Asked = None,
    disk_margin: DiskMargin = None,
    damping: Damping = 1.0,
    delay: Delay = 0.001,
    robust: Annotated[bool, arg(help="add Lyapunov redesign")] = False,
    live: Annotated[bool, arg(help="show the result in a browser")] = False,
    seed: Seed = 0,
    json: Json = None,
) -> None:
    """All of it: identify, diagnose, extend the model, tune, verify, report and animation."""
    import numpy as np

    from gimbal_pin.control.design import Wish
    from gimbal_pin.estimators import ESTIMATORS
    from gimbal_pin.walk import auto as run

    loaded, read = load_logs(rig, payload, logs, map)
    found = run(
        loaded,
        read,
        output,
        rng=np.random.default_rng(seed),
        estimator=ESTIMATORS[estimator],
        holdout=holdout,
        filtering=filtering(cutoff, alignment),
        wish=Wish(bandwidth_hz, damping, delay, kind=kind, disk_margin=disk_margin, robust=robust),
    )
    present(text.auto(found), found.to_dict(), json)
    if live:
        play(loaded, found.animated)


def demo(
    output: Folder = Path("gimbal-pin-demo"),
    *,
    rig: Annotated[str, arg(help="bundled rig")] = "thesis",
    payload: Payload = None,
    seconds: Annotated[float, arg(help="length of the simulated log, s")] = 22.0,
    seed: Seed = 0,
    json: Json = None,
) -> None:
    """Run auto on a simulated log of a rig whose true parameters differ from its URDF; needs nothing."""
    import numpy as np

    from gimbal_pin.walk import demo as run

    found = run(load_rig(rig, payload), output, rng=np.random.default_rng(seed), seconds=seconds)
    present(text.auto(found), found.to_dict(), json)


VERBS: Mapping[str, Callable[..., None]] = {
    verb.__name__: verb
    for verb in (rigs, check, base, excite, simulate, identify, diagnose, tune, track, animate, auto, demo)
}


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the verb that the arguments name, and leave with CONTRACT's exit code."""
    try:
        parse(sys.argv[1:] if arguments is None else arguments)()
    except GimbalPinError as error:
        print(f"gimbal-pin: {error}", file=sys.stderr)
        raise SystemExit(error.exit_code) from None
    except KeyboardInterrupt:
        raise SystemExit(130) from None
    except BrokenPipeError:
        raise SystemExit(0) from None


def parse(arguments: Sequence[str]) -> Callable[[], None]:
    """Return the call that the arguments spell; a usage error is one line on standard error and exit code 2."""
    if not arguments or arguments[0] in ("-h", "--help"):
        return functools.partial(print, overview())
    name, *rest = arguments
    if name not in VERBS:
        raise UsageError(name, "no such verb", f"the verbs are {', '.join(VERBS)}")
    said = io.StringIO()
    try:
        with contextlib.redirect_stderr(said):
            return tyro.cli(deferred(VERBS[name]), prog=f"gimbal-pin {name}", args=rest)
    except SystemExit as stop:
        if stop.code == 2:
            print(f"gimbal-pin: {one_line(said.getvalue())}", file=sys.stderr)
        raise


def overview() -> str:
    """Name every verb with the first sentence of its docstring: quick, since no verb's arguments are looked at."""
    lines = [f"  {name:<10}{(inspect.getdoc(verb) or '').splitlines()[0]}" for name, verb in VERBS.items()]
    return "\n".join([(__doc__ or "").replace("``", ""), "", "usage: gimbal-pin VERB [-h]", "", *lines])


def deferred(verb: Callable[..., None]) -> Callable[..., Callable[[], None]]:
    """Return the verb as a function that keeps its arguments for later: parsing ends before the work begins."""

    @functools.wraps(verb)
    def keep(*args: Any, **kwargs: Any) -> Callable[[], None]:
        return functools.partial(verb, *args, **kwargs)

    return keep


def one_line(message: str) -> str:
    """Fold the parser's framed message into one line."""
    lines = [re.sub(r"[─-]{4,}|[─│╭╮╰╯]", "", line).strip() for line in message.splitlines()]
    return "; ".join(line for line in lines if line)


def present(told: str, result: Mapping[str, Any], json: Path | None) -> None:
    """Print what a person reads, or write what a program reads; with ``--json -`` only the latter is printed."""
    from gimbal_pin.io.files import to_json, write_json

    if json is not None and str(json) == "-":
        print(to_json(result), end="")
        return
    print(told)
    if json is not None:
        write_json(result, json)


def load_rig(rig: str, payload: str | None) -> Rig:
    """Load a rig with the payload that was asked for."""
    from gimbal_pin.rig import Rig

    return Rig.load(rig, payload)


def load_logs(rig: str, payload: str | None, logs: Sequence[str], mapping: Sequence[str]) -> tuple[Rig, list[Log]]:
    """Load the rig with the logs' payload, and the logs.

    Raises:
        UsageError: No log, or logs of different payloads: one identification knows one.
    """
    from gimbal_pin.errors import UsageError
    from gimbal_pin.io import read_log, split_payload

    if not logs:
        raise UsageError("LOG", "none was given", "name at least one log after the rig")
    tags = sorted({tag for _, tag in (split_payload(log) for log in logs) if tag is not None})
    if len(tags) > 1 or (tags and payload is None and any(split_payload(log)[1] is None for log in logs)):
        what = f"are of several payloads ({', '.join(tags)}{' and one not named' if len(tags) == 1 else ''})"
        raise UsageError("logs", what, "identify each payload's logs apart, or tag all of them alike: LOG@PAYLOAD")
    loaded = load_rig(rig, payload or (tags[0] if tags else None))
    read = [read_log(log, loaded, mapping) for log in logs]
    for event in (event for log in read for event in log.events):
        print(f"gimbal-pin: note: {event}", file=sys.stderr)
    return loaded, read


def tags_of(logs: Sequence[str]) -> list[str | None]:
    """Return the payloads that the logs are tagged with, each once, None for those without a tag."""
    from gimbal_pin.io import split_payload

    return list(dict.fromkeys(split_payload(log)[1] for log in logs))


def cameras(
    rig: str, payload: str | None, logs: Sequence[str], mapping: Sequence[str], known: str | None, options: Any
) -> Several:
    """Identify one gimbal with the several payloads that the logs are tagged with, or a new one on a known gimbal."""
    from gimbal_pin.io.model import read_model
    from gimbal_pin.payloads import identify_new, identify_several

    if known is not None:
        loaded, read = load_logs(rig, payload, logs, mapping)
        return identify_new(loaded, read, read_model(known, load_rig(rig, mounted(known))), **options)
    tags = [tag for tag in tags_of(logs) if tag is not None]
    if payload is not None or None in tags_of(logs):
        raise UsageError("logs", "are only partly tagged with a payload", "tag each of them: LOG@PAYLOAD, no --payload")
    each = {tag: [log for log in logs if log.endswith(f"@{tag}")] for tag in tags}
    pairs = {tag: load_logs(rig, None, mine, mapping) for tag, mine in each.items()}
    rigs, read_by = ({tag: pair[k] for tag, pair in pairs.items()} for k in (0, 1))
    return identify_several(rigs, read_by, **options)  # type: ignore[arg-type]


def alone(what: str, given: Mapping[str, bool], mend: str) -> None:
    """Raise `UsageError` if an option is given that does not go with `what`."""
    for option, is_given in given.items():
        if is_given:
            raise UsageError(option, f"does not go with {what}", mend)


def followed(
    rig: str,
    payload: str | None,
    logs: Sequence[str],
    mapping: Sequence[str],
    known: str | None,
    wish: dict[str, Any],
    idle: float | None,
    output: Path | None,
    urdf: Path | None,
    plot: Path | None,
    json: Path | None,
) -> None:
    """Learn from a growing log until it ends or Ctrl-C is pressed, a line a second; then write what was learned."""
    from gimbal_pin.balance import reported
    from gimbal_pin.io.files import atomic_write, replacing, to_json, write_json
    from gimbal_pin.io.follow import follow
    from gimbal_pin.io.model import read_model, write_model
    from gimbal_pin.online import Online, progress, steps
    from gimbal_pin.online.chart import chart

    if len(logs) != 1:
        raise UsageError("LOG", f"names {len(logs)} logs", "follow one at a time")
    loaded = load_rig(rig, payload or tags_of(logs)[0])
    before = None if known is None else read_model(known, load_rig(rig, mounted(known)))
    online = Online.of(loaded, known=before, **wish)
    lines, history, told, spoken = json is not None and str(json) == "-", [], 0, 0
    memory = online.start(logs[0])
    with contextlib.suppress(KeyboardInterrupt):
        come = noted(follow(logs[0], loaded, mapping, idle=inf if idle is None else idle))
        for memory in steps(online, come, logs[0]):
            second = int(memory.t + 1e-6) if memory.samples else 0
            if second == spoken and len(memory.events) == told:
                continue
            now = progress(online, memory)
            history += [now] if plot is not None else []
            print(to_json(now.to_dict(), None)[:-1] if lines else text.following(now, told), flush=True)
            told, spoken = len(memory.events), second
    found = online.identified(memory)
    result = reported(found)
    if output is not None:
        write_model(found, output)
    if urdf is not None:
        atomic_write(urdf, found.to_urdf())
    if plot is not None:
        with replacing(plot) as temporary:
            chart(history).savefig(temporary)
    print(to_json({**result, "kind": "result"}, None)[:-1] if lines else text.identified(found))
    if json is not None and not lines:
        write_json(result, json)


def noted(logs: Iterator[Log]) -> Iterator[Log]:
    """Pass logs on; say each thing that was noticed about them once."""
    said: set[str] = set()
    for log in logs:
        for event in (event for event in log.events if event.split()[0] not in said):
            said.add(event.split()[0])
            print(f"gimbal-pin: note: {event}", file=sys.stderr)
        yield log


def positive(option: str, value: float) -> None:
    """Raise `UsageError` unless the option's value is above zero."""
    from gimbal_pin.errors import UsageError

    if not value > 0:
        raise UsageError(option, f"is {value:g}", "give a positive number")


def shown_somewhere(output: Path | None, live: bool) -> None:
    """Raise `UsageError` if a result would be neither written nor shown."""
    from gimbal_pin.errors import UsageError

    if output is None and not live:
        raise UsageError("-o", "names no file", "say where to write with -o FILE, or --live to see it in a browser")


def carried(
    rig: Rig, profile: str, log: Path | None, mapping: Sequence[str], size: float, seconds: float, dt: float, seed: int
) -> Platform | None:
    """Return the platform's motion from a profile or from a log, which may be shorter than what was asked for.

    Raises:
        UsageError: Both were given.
    """
    import numpy as np

    from gimbal_pin.io import read_imu
    from gimbal_pin.platform import Platform
    from gimbal_pin.profile import profile_s

    if log is None:
        times = dt / 2 * np.arange(2 * round(seconds / dt) + 1)
        return profile_s(times, np.random.default_rng(seed), size) if profile == "S" else None
    if profile == "S":
        raise UsageError("--platform", "is given beside --platform-log", "give one of the two")
    t, imu = read_imu(log, rig, rig.base, mapping)
    return Platform.measured(t - t[0], imu, str(log))


def filtering(cutoff: float | None, alignment: float | None) -> Filtering:
    """Return the filter that the options ask for, the defaults where they ask for nothing."""
    from gimbal_pin.rows import Filtering

    positive("--cutoff", 1.0 if cutoff is None else cutoff)
    return Filtering(alignment=alignment) if cutoff is None else Filtering(cutoff=cutoff, alignment=alignment)


def model_of(
    rig: str, payload: str | None, source: Sequence[str], mapping: Sequence[str], cutoff: float | None
) -> Model:
    """Read a model's YAML, or identify one from logs."""
    from gimbal_pin.identification import identify as run
    from gimbal_pin.io.model import is_model, read_model

    if len(source) == 1 and is_model(source[0]):
        return read_model(source[0], load_rig(rig, payload or mounted(source[0])))
    loaded, logs = load_logs(rig, payload, source, mapping)
    return run(loaded, logs, filtering=filtering(cutoff, None)).model


def warmth(name: Path, rig: Rig, log: Log) -> Array:
    """Return what the model of a YAML leaves of a log's torques, as `view.save` colours it."""
    from gimbal_pin.diagnosis.heat import heat
    from gimbal_pin.io.model import read_model

    return heat(read_model(name, rig), log)


def plant_of(name: Path | None, rig: Rig) -> Model:
    """Return the model of a YAML, or the rig as its URDF states it."""
    from gimbal_pin.io.model import read_model
    from gimbal_pin.model import nominal

    return nominal(rig) if name is None else read_model(name, rig)


def to_show(model: Model, texts: Sequence[str]) -> list[Effect]:
    """Return the effects of a model but its Coulomb and viscous friction, and those that the texts name.

    Raises:
        UsageError: A text names a cause that is no torque at a joint.
    """
    from gimbal_pin.effects import Term
    from gimbal_pin.effects.parse import parse_effect
    from gimbal_pin.model import friction_effects

    terms = [term.effect for term in model.terms]
    for named in texts:
        planted = parse_effect(named, model.rig)
        if not isinstance(planted, Term):
            raise UsageError(f"--effect {named}", "is no torque that a motion could show", "name one that is")
        terms.append(planted.effect)
    friction = friction_effects(model.rig.joints)
    return [effect for k, effect in enumerate(terms) if effect not in (*friction, *terms[:k])]


def mounted(name: str) -> str | None:
    """Return the payload that a model's or controller's YAML was made for, or None if it does not say."""
    from gimbal_pin.errors import ModelError
    from gimbal_pin.reading import read_yaml
    from gimbal_pin.rig import bundled_payloads

    data = read_yaml(name, ModelError)
    payload = data.get("payload") if isinstance(data, dict) else None
    return payload if payload in bundled_payloads() else None


def read_controller(name: str, rig: Rig) -> Law:
    """Read a controller's YAML."""
    from gimbal_pin.errors import ModelError
    from gimbal_pin.reading import read_yaml
    from gimbal_pin.tuning import controller_from

    return controller_from(read_yaml(name, ModelError), rig)


def known_by(name: str, rig: Rig) -> Model:
    """Return the model that the controller of a YAML was made for."""
    from gimbal_pin.model import model_from
    from gimbal_pin.reading import read_yaml

    read_controller(name, rig)
    return model_from(read_yaml(name)["model"], rig)


def rivals(name: str, rig: Rig) -> dict[str, Law]:
    """Return the controller of a YAML under its kind, and beside it a PID that was asked for the same."""
    from gimbal_pin.model import model_from
    from gimbal_pin.reading import read_yaml
    from gimbal_pin.tuning import tune as run

    law, data = read_controller(name, rig), read_yaml(name)
    wish = {**data["wish"], "kind": "pid", "robust": False}
    if wish.get("disk_margin") is not None:  # a PID may not have it at any bandwidth
        granted = {joint: row["bandwidth_hz"] for joint, row in data["joints"].items()}
        wish |= {"bandwidth_hz": granted, "disk_margin": None}
    known = model_from(data["model"], rig)
    laws: dict[str, Law] = {} if data["controller"] == "pid" else {"pid": run(known, **wish).controller}
    return {data["controller"]: law, **laws}


def law_of(name: str, plant: Model, bandwidth_hz: float) -> Law:
    """Return the controller of a name, tuned for the plant, or of a YAML."""
    from gimbal_pin.tuning import tune as run

    if name in ("computed-torque", "pid"):
        return run(plant, kind=name, bandwidth_hz=bandwidth_hz).controller
    return read_controller(name, plant.rig)


def play(rig: Rig, log: Log) -> None:
    """Show a log live until the user ends it."""
    from gimbal_pin import view

    with view.show(rig, log) as live:
        print(f"playing at {live.url}; Ctrl-C ends it")
        with contextlib.suppress(KeyboardInterrupt):
            threading.Event().wait()


if __name__ == "__main__":
    main()
