"""The measured logs: rig, files, column mapping, and the verbs that are run on each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from gimbal_pin.log.io.readers import files_of
from gimbal_pin.rig.rig import Rig

Words = tuple[str, ...]

COMPARED: Mapping[str, Words] = {
    "diagnose": ("diagnose", "{rig}", "{logs}", "{maps}", "--json", "{json}"),
    "identify": (
        "identify",
        "{rig}",
        "{logs}",
        "{maps}",
        "-o",
        "{out}/model.yaml",
        "--json",
        "{json}",
    ),
}
"""Run on every log: name of the run → words of the command line."""
ONE_TURN = {"diagnose-last-third": (*COMPARED["diagnose"], "--holdout", "last-third")}
NOISY = {
    f"identify-{name}": (*COMPARED["identify"], "--estimator", name)
    for name in ("instrumental", "output-error")
}
EVERY: Mapping[str, Words] = {
    **COMPARED,
    "tune": ("tune", "{rig}", "{logs}", "{maps}", "-o", "{out}/controller.yaml"),
    "animate": ("animate", "{rig}", "{logs}", "{maps}", "-o", "{out}/animation.html"),
    "auto": ("auto", "{rig}", "{logs}", "{maps}", "-o", "{out}/auto"),
}
"""The verbs that take a log of a rig."""
CARRIED: Mapping[str, Words] = {
    **EVERY,
    "simulate": ("simulate", "{rig}", "--platform-log", "{logs}", "{maps}", "--seconds", "10", "-o", "{out}/log.csv"),
    "track": ("track", "{rig}", "--platform-log", "{logs}", "{maps}", "--seconds", "3", "--seeds", "1",
              "--json", "{json}"),
}  # fmt: skip
"""The verbs that take a platform's motion, and those that take a log, given one that holds no joint."""

TORQUE_CONSTANT = {"odrive_cogging": 0.0276, "laas_anti_cogging": 0.025}
"""Assumed N m per A; neither is known, and no figure in A depends on it."""
SERVO_CONSTANT = 0.1302
"""N m per V of the XL330: torque constant over resistance, by the data's README."""
EMPS_CONSTANT = 35.15065188
"""N per V, by the log's authors."""
STIFFNESS = 67.32
"""N m per rad of the STS3250's own proportional law, by the log's authors."""
PLATFORM = ("t=time", *(f"gyro_base_{x.lower()}=Gyr_{x}*pi/180" for x in "XYZ"),
            *(f"accel_base_{x.lower()}=Acc_{x}" for x in "XYZ"))  # fmt: skip
UR10E = {"12": "ur-20_02_12-50sec_12harm.csv", "14": "ur-20_02_19_14harm50sec.csv"}
UR10E_CONSTANTS = (10.0, 10.6956, 8.4566, 9.0029, 9.48, 10.1232)
"""N m per A, by the log's authors."""
TIAGO_CONSTANTS = (1.0, 13.6, 13.6, -8.7, -8.7, *3 * (336 * -0.0613,))
"""N m per unit of effort at torso and arm 1 to 7: reduction times torque constant, by the log's authors.

The data's README gives the ratios as 1, 100 four times and 336 three times.
"""

CAMERA = """<robot name="camera_gimbal"><link name="base"/>
<link name="camera"><inertial><mass value="0.2"/>
<inertia ixx="0.0002" iyy="0.0002" izz="0.0002" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="tilt" type="revolute"><parent link="base"/><child link="camera"/><axis xyz="0 1 0"/>
<limit lower="-1.5" upper="1.5" effort="0.3" velocity="20"/></joint></robot>
"""
"""One axis and a camera of some 200 g: the source names the motor (GB2208) and no inertia."""


@dataclass(frozen=True)
class Case:
    """One log, or several of one rig that are given together.

    Attributes:
        name: What results are kept under; ``--only`` takes it, or how it begins.
        rig: Bundled name, or path of a URDF.
        logs: Paths of the logs.
        maps: What ``--map`` is given.
        runs: Name of a run → words of the command line; ``{logs}`` and ``{maps}`` stand for several words.
        flawed: Whether its URDF has an inertia that no body has, so that it is mended first (``check --mend``).
    """

    name: str
    rig: Path | str
    logs: tuple[Path, ...]
    maps: Words
    runs: Mapping[str, Words] = field(default_factory=lambda: COMPARED)
    flawed: bool = False

    @property
    def there(self) -> bool:
        """Whether its files are."""
        return all(path.is_file() for log in self.logs for path in files_of(log))

    def arguments(self, run: str, out: Path) -> list[str]:
        """Return the words of a run's command line; files are written in `out`, the JSON to ``out/told/run.json``."""
        several = {
            "{logs}": [str(log) for log in self.logs],
            "{maps}": [w for m in self.maps for w in ("--map", m)],
        }
        one = {"rig": str(self.rig), "out": str(out), "json": str(out / "told" / "run.json")}
        words = (
            several[part] if part in several else [part.format(**one)] for part in self.runs[run]
        )
        return [word for group in words for word in group]


def joints(pairs: Mapping[str, str], names: Sequence[str], first: int = 1) -> Words:
    """Return maps ``target_joint=source`` for numbered sources: ``{"q": "pos{}"}`` and joints → ``q_elbow=pos2``."""
    each = enumerate(names, start=first)
    return tuple(
        f"{target}_{joint}={source.format(k)}"
        for k, joint in each
        for target, source in pairs.items()
    )


def measured(data: Path, made: Path) -> list[Case]:
    """Return the cases of a folder of measured data, whether its files are there or not; `made` gets URDFs."""
    return [*motors(data), *pendulums(data), *others(data, made)]


def motors(data: Path) -> list[Case]:
    """Bare motors at low and constant speeds."""
    slow = data / "odrive_cogging"
    fast = data / "laas_anti_cogging"
    counts = (
        "t=time_s",
        "q_motor=2*pi*pos_counts/8192",
        f"tau_motor=iq_a*{TORQUE_CONSTANT[slow.name]}",
    )
    turns = (
        "t=Time",
        "q_motor=Position",
        "dq_motor=Velocity",
        f"tau_motor=Iq*{TORQUE_CONSTANT[fast.name]}",
    )
    return [
        *(
            Case(
                f"odrive_{log}",
                slow / "rotor.urdf",
                (slow / f"{log}.csv",),
                counts,
                {**COMPARED, **ONE_TURN},
            )
            for log in ("one_log_slower", "one_log_goodgains")
        ),
        Case(
            "odrive_slow_abcd",
            slow / "rotor.urdf",
            tuple(slow / f"slow_{k}.csv" for k in "abcd"),
            counts,
        ),
        *(
            Case(f"laas_{log}", fast / "rotor.urdf", (fast / f"{log}.csv",), turns)
            for log in ("speed_test1_on", "speed_test1_off", "acc_current")
        ),
    ]


def pendulums(data: Path) -> list[Case]:
    """Arms of one and two axes under gravity."""
    one = data / "dfki_simple_pendulum"
    two = data / "dfki_double_pendulum"
    single = ("t=time", "q_shoulder=position", "dq_shoulder=velocity", "tau_shoulder=torque")
    names = ("shoulder", "elbow")
    first = ("055640", "060143", "061157")
    second = two / "double_pendulum.urdf"
    plain = ("t=time", *joints({"q": "pos{}", "dq": "vel{}", "tau": "tau{}"}, names))
    numbered = {"q": "pos_meas{}", "dq": "vel_meas{}", "tau": "tau_meas{}"}
    lot = [two / f"20220812-{run}-PM_measured.csv" for run in first]
    urdf = one / "pendulum.urdf"
    axes = ("t=time", *joints(numbered, ("Joint1", "Joint2")))
    return [
        Case("simple_system_identification", urdf, (one / "system_identification.csv",), single, {**EVERY, **NOISY}),
        Case("simple_direct_collocation", urdf, (one / "direct_collocation.csv",), single, EVERY),
        *(Case(f"double_{run}", second, (log,), plain) for run, log in zip(first, lot)),
        Case("double_three_logs", second, tuple(lot), plain),
        Case("double_A_0815_02", second, (two / "A_0815_02.csv",), ("t=time", *joints(numbered, names))),
        Case("double_A_5s", second, (two / "A_friction_compensated_5s.csv",), plain),
        Case("double_C1_6s", two / "vendor_C1.urdf", (two / "C1_154220_6s.csv",), axes),
    ]  # fmt: skip


def others(data: Path, made: Path) -> list[Case]:
    """A gimbal without torque, and a platform's motion without a gimbal."""
    (made / "camera.urdf").write_text(CAMERA, encoding="utf-8")
    steps = ("t=column1*1e-6", "q_tilt=column2*pi/180", "dq_tilt=column3*pi/180")
    flight = (data / "phantom4_motion" / "path_1.csv",)
    return [
        Case(
            "rub_gimbal",
            made / "camera.urdf",
            (data / "rub_gimbal" / "open_loop_steps.txt",),
            steps,
            EVERY,
        ),
        Case("phantom4_motion", "turret", flight, PLATFORM, CARRIED),
    ]


def benchmarks(data: Path) -> list[Case]:
    """Return an axis, servos, arms and a pendulum that others have published as benchmarks."""
    emps, servo, arm, pendulum = (
        data / name for name in ("emps", "bam_xl330", "staubli_tx40", "dfki_simple_pendulum")
    )
    stiff, ur10, fer = (
        data / name for name in ("feetech_sts3250", "ur10_unisa", "franka_fer_unisa")
    )
    asked = (
        "t=timestamp",
        "q_servo=position",
        "q_ref_servo=goal_position",
        f"tau_servo=error*{STIFFNESS}",
    )
    volts = ("t=timestamp", "q_servo=position", f"tau_servo=motor_volts*{SERVO_CONSTANT}")
    force = ("t=t", "q_axis=qm", f"tau_axis=vir*{EMPS_CONSTANT}")
    single = ("t=time", "q_shoulder=position", "dq_shoulder=velocity", "tau_shoulder=torque")
    return [
        Case("emps", emps / "emps.urdf", (emps / "emps_train.csv.gz",), force),
        *(
            Case(
                f"servo_{gain}",
                servo / "xl330.urdf",
                (servo / f"xl330_sin_sin_kp{gain}.csv.gz",),
                volts,
            )
            for gain in (100, 200, 400, 800)
        ),
        *(
            Case(f"feetech_{time}", stiff / "sts3250.urdf", (stiff / f"{time}.csv.gz",), asked)
            for time in ("12h23m27", "12h24m55", "12h27m27")
        ),
        Case("ur10_unisa", ur10 / "ur10.urdf", (ur10 / "ur10_exciting.db3",), ()),
        Case("fer_unisa", fer / "fer.urdf", (fer / "panda_unisa.db3",), ()),
        Case("staubli", arm / "tx40.urdf", (arm / "tx40_4s.csv.gz",), (), flawed=True),
        Case(
            "simple_gravity_compensation",
            pendulum / "pendulum.urdf",
            (pendulum / "gravity_compensation.csv.gz",),
            single,
        ),
    ]


def public(folder: Path) -> list[Case]:
    """Return the cases of the public repositories that have a clone in a folder, see the README of the data."""
    return [
        *universal(folder / "dynamic_calibration"),
        *tiago(folder / "figaroh-examples" / "examples" / "tiago"),
    ]


def universal(clone: Path) -> list[Case]:
    """UR10e: files without a header of time, six q, six dq, and six currents from the 14th column on."""
    urdf = clone / "URe" / "urdf" / "ur10e.urdf"
    logs = clone / "dataset_ur10e" / "identification_data"
    if not urdf.is_file():
        return []
    found = []
    for harmonics, log in UR10E.items():
        maps = ["t=column1"]
        for k, joint in enumerate(Rig.load(urdf).joints):
            maps += [f"q_{joint}=column{k + 2}", f"dq_{joint}=column{k + 8}"]
            maps += [f"tau_{joint}=column{k + 14}*{UR10E_CONSTANTS[k]}"]
        found.append(Case(f"ur10e_{harmonics}", urdf, (logs / log,), tuple(maps)))
    return found


def tiago(clone: Path) -> list[Case]:
    """TIAGo's torso and arm: three files of one clock; the rig's other joints have no columns."""
    urdf = clone / "urdf" / "tiago_schunk.urdf"
    logs = clone / "data" / "identification" / "dynamic"
    if not urdf.is_file():
        return []
    names = ("torso_lift_joint", *(f"arm_{k}_joint" for k in range(1, 8)))
    kinds = {"q": "position", "dq": "velocity", "tau": "effort"}
    maps = [
        f'{target}_{joint}="- {joint}_{kind}"' for target, kind in kinds.items() for joint in names
    ]
    maps[-len(names) :] = [
        f"{one}*{constant}" for one, constant in zip(maps[-len(names) :], TIAGO_CONSTANTS)
    ]
    log = "+".join(str(logs / f"tiago_{kind}.csv") for kind in kinds.values())
    return [Case("tiago", urdf, (Path(log),), ("t=t", *maps))]
