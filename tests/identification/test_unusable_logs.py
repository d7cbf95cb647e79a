"""Logs that cannot answer, through the command line: a clear verdict or exit code 3, never a name."""

from __future__ import annotations

import json
import pickle
import re
import shlex
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from itertools import cycle, pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gimbal_pin.diagnosis import diagnose
from gimbal_pin.dynamics import nominal
from gimbal_pin.effects import Cogging
from gimbal_pin.errors import DataError, LogError
from gimbal_pin.identification import Online, identify
from gimbal_pin.log import (
    PLAUSIBLE_RANGES,
    Array,
    Imu,
    Log,
    log_columns,
    read_log,
    read_mapping,
    write_log,
)
from gimbal_pin.log.io.csv import write_csv
from gimbal_pin.regression import Filtering
from gimbal_pin.rig import Rig
from tests.bench_logs import fourier
from tests.command_line import Run, refused

DT = 4e-3
PAYLOADS = {"turret": ("infrared", "none"), "thesis": ("cinema", "zoom-lens")}


def recorded(rig: Rig, seed: int, seconds: float = 14.0) -> Log:
    """A held torque, taken half a sample after the angles, with the noise of a bench."""
    motion = fourier(rig, seed, seconds, DT / 2)
    rng = np.random.default_rng(seed)
    tau = nominal(rig).inverse(motion.q, motion.v, motion.a)[1::2]
    q, v, t = (x[::2][: len(tau)] for x in (motion.q, motion.v, motion.t))
    tau = tau + 0.01 * np.sqrt(np.mean(tau**2, axis=0)) * rng.standard_normal(tau.shape)
    step = 2 * np.pi / 2**16
    return Log(
        f"{seed}",
        rig.joints,
        t,
        step * np.round(q / step),
        v + 1e-3 * rng.standard_normal(v.shape),
        tau,
    )


def noise(like: Array, size: float) -> Array:
    return size * np.random.default_rng(7).standard_normal(like.shape)


def held(log: Log, joints: slice) -> Log:
    """Some joints stand still, their sensors' noise goes on."""
    q = np.array(log.q)
    v = np.zeros(log.q.shape) + np.asarray(log.v)
    q[:, joints], v[:, joints] = q[0, joints], 0.0
    return replace(log, q=q + noise(q, 1e-5), v=v + noise(v, 1e-4))


KINDS: dict[str, Callable[[Rig], list[Log]]] = {
    "one second": lambda rig: [recorded(rig, 1, 1.0)],
    "only the first joint moves": lambda rig: [held(recorded(rig, 1), slice(1, None))],
    "only the last joint moves": lambda rig: [held(recorded(rig, 1), slice(0, -1))],
    "noise everywhere": lambda rig: [
        replace(log, q=noise(log.q, 0.5), v=noise(log.q, 1.0), tau=noise(log.q, 1.0))
        for log in [recorded(rig, 1)]
    ],
    "a rig that never moved": lambda rig: [held(recorded(rig, 1), slice(None))],
    "a second log that never moved": lambda rig: [
        recorded(rig, 1),
        held(recorded(rig, 2), slice(None)),
    ],
    "a second log of one second": lambda rig: [recorded(rig, 1), recorded(rig, 2, 1.0)],
    "two payloads": lambda rig: [
        recorded(Rig.load(rig.name, payload), k) for k, payload in enumerate(PAYLOADS[rig.name])
    ],
}
SPOILT = {"two payloads": "logs-disagree"}
"""Kinds that the verdict `data` must tell, and by which name."""


@pytest.mark.parametrize(("name", "kind"), list(zip(cycle(PAYLOADS), KINDS)))
def test_what_cannot_be_answered_is_never_named(
    run: Run, name: str, kind: str, tmp_path: Path
) -> None:
    """Refused with one line that names a log or the logs, or the verdict is data; no finding of physics."""
    files = [tmp_path / f"{k}.csv" for k in range(2)]
    logs = KINDS[kind](Rig.load(name))
    for log, file in zip(logs, files):
        write_log(log, file)
    out = tmp_path / "said.json"
    code, _, err = run("diagnose", name, *files[: len(logs)], "--json", out)
    if code:
        told = err.strip().splitlines()
        assert code == 3 and not out.exists() and kind not in SPOILT
        assert len(told) == 1 and (".csv" in told[0] or "the logs" in told[0])
        return
    said = json.loads(out.read_text())
    assert said["verdict"] == "data" and said["findings"]
    assert all(finding["status"] == "data" for finding in said["findings"])
    assert SPOILT.get(kind, said["findings"][0]["cause"]) == said["findings"][0]["cause"]
    assert said["residual"] == {} and all(finding["sentence"] for finding in said["findings"])


MIXED: dict[str, tuple[str, Callable[[Array], Array], str]] = {
    "a sign": (
        "thesis",
        lambda tau: tau * [1, -1, 1],
        r"tau_roll has the wrong sign.*--map tau_roll=-tau_roll",
    ),
    "all signs": ("turret", lambda tau: -tau, "tau_pan and tau_tilt have the wrong sign"),
    "two columns": (
        "turret",
        lambda tau: tau[:, ::-1],
        "tau_pan and tau_tilt hold each other's torque.*--map tau_pan=tau_tilt --map tau_tilt=tau_pan",
    ),
}


@pytest.mark.parametrize("kind", MIXED)
def test_torques_that_were_mixed_up_are_told(kind: str) -> None:
    """Least squares explains most of them as well, with negative masses."""
    name, mix, words = MIXED[kind]
    rig = Rig.load(name)
    log = recorded(rig, 1)
    identify(rig, [log], holdout="none")
    with pytest.raises(LogError, match=words):
        identify(rig, [replace(log, tau=mix(np.asarray(log.tau)))], holdout="none")


@pytest.mark.parametrize("kind", ["a sign", "all signs"])
def test_a_wrong_sign_is_told_of_a_log_that_was_followed_too(kind: str) -> None:
    """Its rows are gone, and the moments that are left of them tell."""
    name, mix, words = MIXED[kind]
    log = recorded(Rig.load(name), 1)
    online = Online.of(Rig.load(name))
    mixed = replace(log, tau=mix(np.asarray(log.tau)))
    right, wrong = (online.advance(online.start("it"), one) for one in (log, mixed))
    assert online.identified(right).names == online.design.names
    with pytest.raises(LogError, match=f"it: {words}"):
        online.identified(wrong)


MEASURED = ("q", "v", "tau")
ROW = 1000


def spoilt(log: Log, channel: str, value: float, rows: slice) -> str:
    """A log's CSV with another value in some rows of the second joint's channel: such a log cannot be made."""
    columns = ["t", *(f"{prefix}_{joint}" for prefix in ("q", "dq", "tau") for joint in log.joints)]
    table = np.column_stack([log.t, *(getattr(log, name) for name in MEASURED)])
    table[rows, 2 + 2 * MEASURED.index(channel)] = value
    return "\n".join([",".join(columns), *(",".join(map(repr, row)) for row in table.tolist()), ""])


@settings(max_examples=4)
@given(
    channel=st.sampled_from(MEASURED),
    exponent=st.floats(-323, 308),
    sign=st.sampled_from([-1, 1]),
    rows=st.sampled_from([slice(ROW, ROW + 1), slice(0, 1), slice(0, None)]),
)
def test_a_value_of_any_size_is_answered_or_refused_in_one_line(
    run: Run, tmp_path: Path, channel: str, exponent: float, sign: int, rows: slice
) -> None:
    """Beyond what any machine has it is named by its line and column; what is not must be borne by the numbers."""
    file = tmp_path / "x.csv"
    value = sign * 10.0**exponent
    file.write_text(spoilt(recorded(Rig.load("turret"), 1, 8.0), channel, value, rows))
    code, _, err = run("identify", "turret", file)
    told = [line for line in err.splitlines() if "note:" not in line]
    assert code in (0, 2, 3) and len(told) == (code != 0) and all(len(line) <= 300 for line in told)
    if not PLAUSIBLE_RANGES[channel].lower <= value <= PLAUSIBLE_RANGES[channel].upper:
        prefix = {"q": "q", "v": "dq", "tau": "tau"}[channel]
        assert (
            code == 2 and f"x.csv:{rows.start + 2} column '{prefix}_tilt': is {value!r}" in told[0]
        )


WIDTHS = {
    "gyro": 3,
    "accel": 3,
    "quat": 4,
    **dict.fromkeys(("q", "v", "tau", "q_ref", "temperature"), 2),
}


@pytest.mark.parametrize("channel", WIDTHS)
@given(
    times=st.floats(1.0, 1e100, exclude_min=True), row=st.integers(0, 4), column=st.integers(0, 1)
)
def test_a_log_that_is_made_holds_nothing_that_no_machine_has(
    channel: str, times: float, row: int, column: int
) -> None:
    """The greatest value of all is held; one beyond it, and nan, are refused, whatever they were read from."""
    reach = PLAUSIBLE_RANGES[channel]

    def made(value: float) -> Log | Imu:
        values = np.zeros((5, WIDTHS[channel]))
        values[row, column] = value
        if channel in ("gyro", "accel", "quat"):
            return Imu(**{channel: values})
        return Log(
            "made", ("pan", "tilt"), np.arange(5.0), **{"q": np.zeros((5, 2)), channel: values}
        )

    assert made(reach.upper) and made(reach.lower)
    for value in (times * reach.upper, times * reach.lower, np.inf, np.nan):
        with pytest.raises(LogError, match=f"sample {row}, column {column}: .*on any machine"):
            made(value)


@pytest.mark.parametrize("verb", ["identify", "diagnose", "tune"])
@pytest.mark.parametrize(
    ("seconds", "share", "words"),
    [(8.0, 0.0, "torques are zero"), (8.0, 1e-300, "torques are zero"), (DT, 1.0, "record")],
)
def test_no_torque_and_one_row_are_told_once(
    run: Run, verb: str, seconds: float, share: float, words: str, tmp_path: Path
) -> None:
    log = recorded(Rig.load("turret"), 1, seconds)
    write_log(replace(log, tau=share * np.asarray(log.tau)), tmp_path / "x.csv")
    refused(run(verb, "turret", tmp_path / "x.csv"), 3, "x.csv", words)


def test_a_torque_that_is_missing_is_no_measurement_of_zero(run: Run, tmp_path: Path) -> None:
    """Parameters of zero would explain it perfectly; a joint that is held may have none."""
    rig = Rig.load("turret")
    log = recorded(rig, 1)
    assert log.tau is not None
    tau = np.array(log.tau)
    tau[:, 1] = 0.0
    write_log(replace(log, tau=tau), tmp_path / "log.csv")
    for more in ((), ("--follow", "--idle", "0")):
        code, _, err = run("identify", "turret", str(tmp_path / "log.csv"), *more)
        refused(
            (code, "", err),
            3,
            f"tau_{rig.joints[1]} is zero all along, while {rig.joints[1]} moves",
        )


def test_a_rate_of_one_value_is_the_angles_derivative(run: Run, tmp_path: Path) -> None:
    """A column that nobody filled is no measurement without noise."""
    rig = Rig.load("turret")
    log = recorded(rig, 1)
    assert log.v is not None
    none = replace(log, v=np.zeros_like(log.v))
    for filtering in (Filtering(), Filtering(cutoff=10.0)):
        without, empty = (
            identify(rig, [one], filtering=filtering) for one in (replace(log, v=None), none)
        )
        assert np.allclose(
            empty.estimate.theta,
            without.estimate.theta,
            atol=1e-6 * np.abs(without.estimate.theta).max(),
        )
    online = Online.of(rig)
    found = [
        online.estimate(online.advance(online.start(), one)).theta
        for one in (replace(log, v=None), none)
    ]
    assert np.allclose(*found, atol=1e-2 * np.abs(found[0]).max())


def test_what_was_learned_before_a_value_that_no_machine_has_is_kept(
    run: Run, tmp_path: Path
) -> None:
    log = recorded(Rig.load("turret"), 1)
    (tmp_path / "x.csv").write_text(spoilt(log, "tau", 1e300, slice(len(log) - ROW, None)))
    model = tmp_path / "model.yaml"
    code, _, err = run(
        "identify", "turret", tmp_path / "x.csv", "--follow", "--idle", "0", "-o", model
    )
    assert code == 0 and not err and model.is_file()
    refused(
        run("identify", "turret", tmp_path / "x.csv"),
        2,
        f"x.csv:{len(log) - ROW + 2} column 'tau_tilt'",
    )


def test_diagnosis_names_a_column_before_any_cause(run: Run, tmp_path: Path) -> None:
    log = recorded(Rig.load("turret"), 3)
    write_log(replace(log, tau=np.asarray(log.tau)[:, ::-1]), tmp_path / "x.csv")
    refused(
        run("diagnose", "turret", tmp_path / "x.csv"),
        2,
        "tau_pan and tau_tilt hold each other's torque",
    )


def delayed(log: Log, by: float) -> Log:
    """The torque's column comes so much later than the others, s."""
    tau = np.asarray(log.tau)
    return replace(log, tau=np.stack([np.interp(log.t - by, log.t, x) for x in tau.T], axis=1))


@pytest.mark.parametrize(("name", "by"), [("turret", -0.1), ("thesis", 0.2)])
def test_a_torque_that_is_far_too_late_is_refused_and_its_time_is_told(
    run: Run, name: str, by: float, tmp_path: Path
) -> None:
    """No friction, spring or limit is made of it; with the alignment that is said it is a log like others."""
    rig = Rig.load(name)
    write_log(delayed(recorded(rig, 1), by), tmp_path / "x.csv")
    code, _, err = run("identify", name, tmp_path / "x.csv")
    columns = ", ".join(f"tau_{joint}" for joint in rig.joints)
    size, when = re.search(rf"{columns} are (\S+) ms (late|early): ", err).groups()  # type: ignore[union-attr]
    assert code == 2 and err.count("\n") == 1
    assert abs(float(size) - 1e3 * abs(by)) < 3 and when == ("late" if by > 0 else "early")
    alignment = re.search(r"--alignment (\S+)", err)[1]  # type: ignore[index]
    assert run("identify", name, tmp_path / "x.csv", f"--alignment={alignment}")[0] == 0
    assert run("diagnose", name, tmp_path / "x.csv", "--json", tmp_path / "x.json")[0] == 0
    said = json.loads((tmp_path / "x.json").read_text())
    assert said["verdict"] == "data" and [one["cause"] for one in said["findings"]] == ["clock"]
    assert (
        abs(said["findings"][0]["parameters"]["late"]["value"] - by) < 3e-3
        and said["residual"] == {}
    )


@pytest.mark.parametrize("name", ["turret", "ptu"])
def test_a_torque_a_little_late_is_said_and_one_in_time_is_not(name: str) -> None:
    rig = Rig.load(name)
    log = recorded(rig, 2)
    notes = {
        by: identify(rig, [delayed(log, by)], holdout="none").notes
        for by in (-0.02, 0.0, 0.004, 0.014)
    }
    assert (
        not notes[-0.02] and not notes[0.0] and not notes[0.004]
    )  # a drive's delay is no fault of the log
    seen = any("ms late" in note for note in notes[0.014])
    assert seen == (name != "ptu")  # whose friction hides what its inertia takes


@pytest.mark.parametrize("kind", ["slow", "one tone"])
def test_where_a_motion_does_not_say_when_its_torque_acts_nothing_is_refused(kind: str) -> None:
    """At constant speed every torque fits, and a sine's delay is friction."""
    rig = Rig.load("turret")
    t = DT * np.arange(5000)
    size, rate = (0.3, 2.0) if kind == "one tone" else (0.8, 0.05)
    q = size * np.sin(np.outer(t, rate * np.array([1.0, 1.4])) + 0.3)
    v = np.gradient(q, DT, axis=0)
    a = np.gradient(np.gradient(q, DT, axis=0), DT, axis=0)
    tau = nominal(rig).inverse(q, v, a)
    tau += 0.03 * np.std(tau, axis=0) * np.random.default_rng(0).standard_normal(tau.shape)
    log = delayed(Log(kind, rig.joints, t, q + noise(q, 1e-5), v + noise(v, 1e-3), tau), 0.06)
    with suppress(DataError):  # which says that such a motion shows too little
        identify(rig, [log], holdout="none")


@pytest.mark.parametrize("known", [False, True])
def test_a_late_torque_of_one_of_several_cameras_is_refused(
    run: Run, known: bool, tmp_path: Path
) -> None:
    """Or of a new camera on a gimbal that is known."""
    logs = [tmp_path / f"{camera}.csv" for camera in PAYLOADS["turret"]]
    for log, camera, by in zip(logs, PAYLOADS["turret"], (0.0, 0.1)):
        write_log(delayed(recorded(Rig.load("turret", camera), 1), by), log)
    first, second = (f"{log}@{camera}" for log, camera in zip(logs, PAYLOADS["turret"]))
    model = tmp_path / "model.yaml"
    if known:
        assert run("identify", "turret", first, "-o", model)[0] == 0
        refused(run("identify", "turret", second, "--known", model), 2, "ms late", "--alignment")
    else:
        refused(
            run("identify", "turret", first, second),
            2,
            f"{PAYLOADS['turret'][1]}.csv",
            "ms late",
            "--alignment",
        )


MISREAD: dict[str, tuple[str, Callable[[dict[str, Array]], dict[str, Array]]]] = {
    "another unit": (
        "drone",
        lambda x: {key: 1e3 * x[key] if "tau" in key else x[key] for key in x},
    ),
    "two torques": ("turret", lambda x: {**x, "tau_pan": x["tau_tilt"], "tau_tilt": x["tau_pan"]}),
    "two joints": ("thesis", lambda x: turned_round(x, ["yaw", "roll"])),
}


def turned_round(columns: dict[str, Array], joints: list[str]) -> dict[str, Array]:
    """Each joint has the columns of the next."""
    kinds = ("q", "dq", "tau")
    pairs = list(zip(joints, joints[1:] + joints[:1]))
    return {
        **columns,
        **{f"{kind}_{to}": columns[f"{kind}_{of}"] for kind in kinds for to, of in pairs},
    }


def printed(err: str) -> list[str]:
    """The words of the ``--map`` that an error prints, as a shell parts them."""
    words = shlex.split(err[err.index("--map") :])
    return [word for pair in pairwise(words) if pair[0] == "--map" for word in pair]


@pytest.mark.parametrize("kind", MISREAD)
def test_the_map_that_is_printed_mends_a_log_of_foreign_headers(
    run: Run, kind: str, tmp_path: Path
) -> None:
    """Every column has a name, unit and sign of its own, which a mapping states; the printed one comes after it."""
    name, misread = MISREAD[kind]
    columns = misread(log_columns(recorded(Rig.load(name), 3)))
    factors = {key: 0.5 * (-1.0) ** k if k else 1.0 for k, key in enumerate(columns)}
    heads = {key: f"axis {k} {key.split('_')[0]}*" for k, key in enumerate(columns)}
    write_csv(
        {heads[key]: values / factors[key] for key, values in columns.items()}, tmp_path / "x.csv"
    )
    maps = [f'--map={key}="{heads[key]}"*{factors[key]}' for key in columns]
    code, _, err = run("identify", name, tmp_path / "x.csv", *maps)
    assert code == 2 and all("note: " in line for line in err.splitlines()[:-1])
    assert run("identify", name, tmp_path / "x.csv", *maps, *printed(err.splitlines()[-1]))[0] == 0


def test_a_log_keeps_what_its_columns_were_read_from(tmp_path: Path) -> None:
    rig = Rig.load("turret")
    log = recorded(rig, 1, 2.0)
    write_log(log, tmp_path / "x.csv")
    maps = {"tau_pan": "tau_tilt*-2", "tau_tilt": "tau_pan*pi/180"}
    read = read_log(tmp_path / "x.csv", rig, maps)
    for one in (
        read,
        read.part(slice(0, 9)),
        replace(read, v=None),
        pickle.loads(pickle.dumps(read)),
    ):
        assert one.remapped({"tau_pan": ("tau_pan", -1.0), "q_pan": ("q_tilt", "pi/180")}) == (
            "--map 'tau_pan=tau_tilt*2' --map 'q_pan=q_tilt*pi/180'"
        )
        assert read_mapping([f"tau_tilt={one.sources['tau_tilt'].times(1.0)}"])[
            "tau_tilt"
        ].factor == pytest.approx(np.pi / 180)
    assert not log.sources


def permuted(log: Log, order: list[int]) -> Log:
    """Each joint has the angle, rate and torque of another."""
    return replace(
        log, **{name: np.asarray(getattr(log, name))[:, order] for name in ("q", "v", "tau")}
    )


@pytest.mark.parametrize(("name", "order"), [("thesis", [1, 0, 2])])
def test_joints_that_have_changed_places_are_told_with_the_map_that_puts_them_right(
    run: Run, name: str, order: list[int], tmp_path: Path
) -> None:
    """A model of the rig as it is not would be a leaning base, or bodies that nobody has weighed."""
    rig = Rig.load(name)
    write_log(permuted(recorded(rig, 3), order), tmp_path / "x.csv")
    code, _, err = run("identify", name, tmp_path / "x.csv")
    error = err.splitlines()[-1]  # notes on angles beyond the exchanged limits may come before
    assert code == 2 and f"{rig.joints[0]}, {rig.joints[1]} have changed places" in error
    assert run("identify", name, tmp_path / "x.csv", *printed(error))[0] == 0
    assert run("diagnose", name, tmp_path / "x.csv", "--json", tmp_path / "x.json")[0] == 0
    said = json.loads((tmp_path / "x.json").read_text())
    assert said["verdict"] == "data" and [one["cause"] for one in said["findings"]] == [
        "logs-disagree"
    ]
    assert "have changed places" in said["findings"][0]["sentence"] and said["residual"] == {}


def test_joints_that_could_change_places_are_not_said_to_have(tmp_path: Path) -> None:
    """Two equal sliders one beside the other: their logs fit the rig either way, and badly where their axis rubs."""
    slider = """<link name="{0}"><inertial><mass value="1"/><inertia ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" ixz="0"
      iyz="0"/></inertial></link><joint name="{0}_axis" type="prismatic"><parent link="base"/><child link="{0}"/>
      <axis xyz="1 0 0"/><limit lower="-2" upper="2" effort="50" velocity="5"/></joint>"""
    text = f'<robot name="twins"><link name="base"/>{slider.format("left")}{slider.format("right")}</robot>'
    (tmp_path / "twins.urdf").write_text(text)
    rig = Rig.load(tmp_path / "twins.urdf")
    log = recorded(rig, 5)
    rough = np.asarray(log.tau) + 2 * np.std(log.tau, axis=0) * np.sin(40 * log.q)
    identify(rig, [replace(log, tau=rough)], holdout="none")


@pytest.mark.parametrize("verb", ["identify", "diagnose"])
def test_a_joint_that_its_reference_holds_still_is_no_error(
    run: Run, verb: str, tmp_path: Path
) -> None:
    """The others are answered for; a joint that was asked to move, and did not, shows nothing of itself."""
    rig = Rig.load("turret")
    log = held(recorded(rig, 1), slice(1, None))
    inside = nominal(rig)
    out = tmp_path / "said.json"
    q = log.q * [1, 0] + log.q[0] * [0, 1]
    v = np.asarray(log.v) * [1, 0]
    tau = inside.inverse(q, v, np.gradient(v, log.t, axis=0))
    still = replace(log, tau=tau + noise(tau, 1e-3), q_ref=q)
    write_log(still, tmp_path / "held.csv")
    code, _, err = run(verb, "turret", tmp_path / "held.csv", "--alignment=0", "--json", out)
    said = json.loads(out.read_text())
    assert (
        code == 0 and "at rest, as their references ask, and not excited" in err and "tilt" in err
    )
    joints = said["train"]["fit_percent"] if verb == "identify" else said["residual"]
    assert list(joints) == ["pan"]
    write_log(replace(still, q_ref=recorded(rig, 1).q), tmp_path / "stuck.csv")
    assert run(verb, "turret", tmp_path / "stuck.csv", "--alignment=0")[0] == 3


def test_a_joint_that_wobbles_where_it_should_rest_is_not_excited() -> None:
    """Its torque has nothing to do with its motion, which is no fault of the torque's column."""
    rig = Rig.load("turret")
    log = recorded(rig, 1)
    q, v, tau = (np.array(x) for x in (log.q, log.v, log.tau))
    q[:, 1], v[:, 1] = q[0, 1] + 0.02 * np.sin(log.t), 0.02 * np.cos(log.t)
    tau[:, 1] = noise(tau[:, 1], 0.5)
    wobbling = replace(log, q=q, v=v, tau=tau)
    few = {"cogging": Cogging}
    with pytest.raises(DataError, match="nothing to do with the motion of: tilt"):
        diagnose(rig, [wobbling], few, rng=np.random.default_rng(0))
    said = diagnose(
        rig,
        [replace(wobbling, q_ref=q[:1].repeat(len(q), axis=0))],
        few,
        rng=np.random.default_rng(0),
    )
    assert any("tilt: not excited" in note for note in said.notes)


@pytest.mark.parametrize("more", [[], ["--cutoff", "0.2"], ["--follow", "--idle", "0"]])
def test_milliseconds_are_refused_whatever_the_cutoff(
    run: Run, tmp_path: Path, more: list[str]
) -> None:
    log = recorded(Rig.load("turret"), 3, 3.0)
    write_log(replace(log, t=1e3 * log.t, v=None), tmp_path / "x.csv")
    code, _, err = run("identify", "turret", tmp_path / "x.csv", *more)
    assert code == 2 and "t is in ms, map it: --map t=COLUMN*1e-3" in err and err.count("\n") == 1
