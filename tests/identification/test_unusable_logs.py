"""Laws of logs that cannot answer: a refusal in one line, with its cure."""

from __future__ import annotations

import re
import shlex
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from gimbal_pin.errors import DataError, LogError
from gimbal_pin.identification import identify, identify_new, identify_several
from gimbal_pin.log import Log, log_columns, write_log
from gimbal_pin.log.io.csv import write_csv
from gimbal_pin.regression import Filtering
from gimbal_pin.rig import Rig
from tests.command_line import Run, refused, result
from tests.identification.logs import hold, record
from tests.rigs import bundled

PAYLOADS = ("infrared", "none")
TURRET = bundled("turret")
THESIS = bundled("thesis")
LOG = record(TURRET, 1)


def delay(log: Log, by: float) -> Log:
    """Return the log whose torque's columns come later than the others, s."""
    tau = [np.interp(log.t - by, log.t, x) for x in np.transpose(log.tau)]
    return replace(log, tau=np.stack(tau, axis=1))


SWAPPED = {"yaw": "roll", "roll": "yaw"}
MIXED: dict[str, tuple[Rig, dict[str, tuple[str, float]], str]] = {
    "a sign": (THESIS, {"tau_roll": ("tau_roll", -1)}, "tau_roll has the wrong sign"),
    "two torques": (
        TURRET,
        {"tau_pan": ("tau_tilt", 1), "tau_tilt": ("tau_pan", 1)},
        "hold each other's torque",
    ),
    "two joints": (
        THESIS,
        {
            f"{kind}_{joint}": (f"{kind}_{SWAPPED[joint]}", 1)
            for kind in ("q", "dq", "tau")
            for joint in SWAPPED
        },
        "yaw, roll have changed places",
    ),
}
"""Rig, what columns hold instead, and what is said."""


@pytest.mark.parametrize("kind", MIXED)
def test_printed_map_corrects_columns_that_were_mixed_up(
    run: Run, kind: str, tmp_path: Path
) -> None:
    """A mapping that was given before is taken into account."""
    rig, mixed, words = MIXED[kind]
    columns = log_columns(record(rig, 3))
    wrong = {key: factor * columns[source] for key, (source, factor) in mixed.items()}
    path = tmp_path / "x.csv"
    write_csv({f"my {key}": x / 2 for key, x in (columns | wrong).items()}, path)
    maps = [f'--map={key}="my {key}"*2' for key in columns]
    code, _, err = run("identify", rig.name, path, *maps)
    error = err.splitlines()[-1]
    assert code == 2
    assert words in error
    pairs = pairwise(shlex.split(error[error.index("--map") :]))
    cure = [word for pair in pairs if pair[0] == "--map" for word in pair]
    assert run("identify", rig.name, path, *maps, *cure)[0] == 0


@pytest.mark.parametrize(
    ("verb", "size", "words"),
    [("identify", 0.0, "torques are zero"), ("diagnose", 1e-300, "torques are zero")],
)
def test_torque_that_is_missing_is_no_measurement_of_zero(
    run: Run, verb: str, size: float, words: str, tmp_path: Path
) -> None:
    path = tmp_path / "x.csv"
    write_log(replace(LOG, tau=np.asarray(LOG.tau) * size), path)
    refused(run(verb, "turret", path), 3, "x.csv", words)
    with pytest.raises(DataError, match="tau_tilt is zero all along, while tilt moves"):
        identify(TURRET, [replace(LOG, tau=np.asarray(LOG.tau) * [1.0, size])])


def test_rate_of_one_value_is_no_measurement() -> None:
    """The derivative of the angle stands for it."""
    one, other = (
        identify(TURRET, [replace(LOG, v=v)], filtering=Filtering(cutoff=10.0)).estimate.theta
        for v in (None, np.zeros_like(LOG.q))
    )
    np.testing.assert_allclose(other, one, atol=1e-6 * np.abs(one).max())


@pytest.mark.parametrize(("rig", "by"), [(TURRET, -0.1), (THESIS, 0.2)])
def test_late_torque_is_refused_with_the_time_that_corrects_it(
    run: Run, rig: Rig, by: float, tmp_path: Path
) -> None:
    path = tmp_path / "x.csv"
    write_log(delay(record(rig, 1), by), path)
    code, _, err = run("identify", rig.name, path)
    assert (code, err.count("\n")) == (2, 1)
    ((size, when, alignment),) = re.findall(r"(\S+) ms (late|early): .*--alignment (\S+)", err)
    assert float(size) == pytest.approx(1e3 * abs(by), abs=3)
    assert when == ("late" if by > 0 else "early")
    assert run("identify", rig.name, path, f"--alignment={alignment}")[0] == 0
    found = result(run, "diagnose", rig.name, path)
    assert (found["verdict"], found["residual"]) == ("data", {})
    assert [finding["cause"] for finding in found["findings"]] == ["clock"]


@pytest.mark.parametrize(("by", "noted"), [(-0.02, False), (0.004, False), (0.014, True)])
def test_torque_a_little_late_is_noted(by: float, noted: bool) -> None:
    """The delay of a drive is no fault of the log."""
    found = identify(TURRET, [delay(record(TURRET, 2), by)], holdout="none")
    assert any("ms late" in note for note in found.notes) == noted


def test_late_torque_of_one_of_several_cameras_is_refused() -> None:
    rigs = {payload: bundled("turret", payload) for payload in PAYLOADS}
    first, second = rigs.values()
    right = record(first, 1)
    late = delay(record(second, 1), 0.1)
    known = identify(first, [right]).model
    with pytest.raises(LogError, match=r"ms late.*--alignment"):
        identify_new(second, [late], known)
    with pytest.raises(LogError, match=r"ms late.*--alignment"):
        identify_several(rigs, dict(zip(rigs, ([right], [late]))))


@pytest.mark.parametrize("more", [["--cutoff", "0.2"], ["--follow", "--idle", "0"]])
def test_milliseconds_are_refused_whatever_the_cutoff(
    run: Run, tmp_path: Path, more: list[str]
) -> None:
    log = LOG.part(slice(0, 750))
    write_log(replace(log, t=1e3 * log.t, v=None), tmp_path / "x.csv")
    code, _, err = run("identify", "turret", tmp_path / "x.csv", *more)
    assert (code, err.count("\n")) == (2, 1)
    assert "t is in ms, map it: --map t=COLUMN*1e-3" in err


def test_joint_that_its_reference_holds_still_is_not_excited(run: Run, tmp_path: Path) -> None:
    """The others are answered for; a joint that was asked to move and did not is refused."""
    still = hold(TURRET, LOG, 1, noisy=False)
    path = tmp_path / "x.csv"
    write_log(replace(still, q_ref=LOG.q * [1, 0]), path)
    found = result(run, "identify", "turret", path, "--alignment=0")
    assert list(found["train"]["fit_percent"]) == ["pan"]
    write_log(replace(still, q_ref=LOG.q), path)
    assert run("identify", "turret", path, "--alignment=0")[0] == 3
