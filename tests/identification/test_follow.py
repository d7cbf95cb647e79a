"""Identification on the running gimbal: the batch's answer in constant memory."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from dataclasses import replace
from enum import Enum
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from gimbal_pin.control import bench_run, tune
from gimbal_pin.dynamics import nominal
from gimbal_pin.effects import Coulomb, Presliding
from gimbal_pin.errors import DataError, LogError, UsageError
from gimbal_pin.identification import (
    Online,
    given_beta,
    identify,
    iterate_progress,
    read_model,
    report_progress,
)
from gimbal_pin.log import Array, Log, Motion, write_log
from gimbal_pin.regression import Estimate, Filtering
from gimbal_pin.rig import Rig
from tests.bench_logs import EXACT, fourier, prescribed
from tests.command_line import Run, heard, refused

ROOT = Path(__file__).parents[2]
MIDDLE, END = 15.0, 25.0
"""Where the motion is split into a part for each camera, and its end, s."""


@cache
def quiet(rig: str, payload: str, late: bool = False, dt: float = 2e-3) -> Log:
    """A simulated closed loop with the rig's own sensors: one part of a motion."""
    body = Rig.load(rig, payload)
    motion = fourier(body, 0, END, dt)
    rows = motion.t >= MIDDLE if late else motion.t < MIDDLE
    part = Motion(
        motion.t[rows] - motion.t[rows][0], motion.q[rows], motion.v[rows], motion.a[rows]
    )
    law = tune(nominal(body), bandwidth_hz=4.0, dt=dt).controller
    return bench_run(nominal(body), law, rng=np.random.default_rng(0), reference=part)


@cache
def noisy(seconds: float = 12.0, dt: float = 2e-3) -> Log:
    log = prescribed(nominal(Rig.load("turret")), seconds=seconds, torque_noise=0.02, dt=dt)
    noise = np.random.default_rng(3).standard_normal((2, *log.q.shape))
    return replace(log, q=log.q + 1e-5 * noise[0], v=log.v + 1e-3 * noise[1])


def learn(online: Online, log: Log) -> Estimate:
    return online.estimate(online.advance(online.start(), log))


def true_parameters(rig: Rig, online: Online) -> Array:
    return np.concatenate([given_beta(rig, online.design.reduction), rig.friction.ravel()])


@pytest.mark.parametrize("rig", ["turret", "thesis"])
def test_the_stream_is_the_batch(rig: str) -> None:
    """The same rows and solve, at a stated alignment: a stream fits no lags.

    The windows differ: each has its own estimate of the noise, by which rows are masked. That moves parameters by less
    than a tenth of their deviation, and these by a few hundredths.
    """
    body = Rig.load(rig)
    log = quiet(rig, str(body.payload))
    stated = Filtering(alignment=log.dt / 2)
    online = Online.of(body, filtering=stated)
    memory = online.advance(online.start(), log)
    found = online.identified(memory)
    batch = identify(body, [log], holdout="none", filtering=stated)
    assert found.names == batch.names and found.estimate.rows == batch.estimate.rows
    assert np.all(np.abs(found.estimate.theta - batch.estimate.theta) < 0.1 * batch.estimate.std)
    np.testing.assert_allclose(found.estimate.std, batch.estimate.std, rtol=0.05)
    assert found.train.torque_rmse == pytest.approx(batch.train.torque_rmse, rel=0.02)
    assert found.held_out is not None and min(found.held_out.fit_percent.values()) > 99
    z = (found.estimate.theta - true_parameters(body, online)) / found.estimate.std
    assert np.sqrt(np.mean(z**2)) < 2.0


@settings(max_examples=4, deadline=None)
@given(st.lists(st.integers(1, 1999), max_size=12), st.booleans())
@example(list(range(1, 2000)), False)
def test_any_cut_into_blocks_gives_the_same(cuts: list[int], gap: bool) -> None:
    """One sample at a time, too; across a gap, with a clock that jitters, and with two samples lost."""
    log = noisy(8.0, 4e-3).part(slice(0, 2000))
    t = log.t + 8e-4 * np.sin(np.arange(len(log))) + (log.t > 4.0) * (3.0 if gap else 0.0)
    log = replace(log, t=t).part(np.delete(np.arange(2000), [700, 701, 702, 703, 704]))
    online = Online.of(Rig.load("turret"))
    cut = online.start()
    for begin, end in pairwise(sorted({0, *(cut for cut in cuts if cut < len(log)), len(log)})):
        cut = online.advance(cut, log.part(slice(begin, end)))
    assert cut.samples == len(log) and cut.t == log.t[-1]
    one = learn(online, log)
    other = online.estimate(cut)
    np.testing.assert_allclose(one.theta, other.theta, rtol=1e-9)
    np.testing.assert_allclose(one.std, other.std, rtol=1e-9)


def size(thing: object) -> int:
    """Bytes of all arrays below, and how much their owners hold."""
    if isinstance(thing, np.ndarray):
        return (thing if thing.base is None else thing.base).nbytes
    if isinstance(thing, Enum):
        return 0
    if isinstance(thing, (tuple, list)):
        return sum(size(part) for part in thing)
    if isinstance(thing, Enum):
        return 0
    return sum(size(part) for part in vars(thing).values()) if hasattr(thing, "__dict__") else 0


def test_memory_is_constant_and_what_is_not_held_still_counts() -> None:
    whole = Online.of(Rig.load("turret"))
    little = replace(whole, most_rows=96)
    log = noisy(40.0, 4e-3)
    early = little.advance(little.start(), log.part(slice(0, 5_000)))
    late = little.advance(early, log.part(slice(5_000, None)))
    assert late.learned.past.rows > early.learned.past.rows > 0
    assert size(late) <= 1.5 * size(early) < 4e5
    few = little.answer(late)[0]
    all_ = whole.answer(whole.advance(whole.start(), log))[0]
    assert few.rows == all_.rows
    np.testing.assert_allclose(few.theta, all_.theta, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(few.residual_std, all_.residual_std, rtol=1e-9)
    np.testing.assert_allclose(few.std, all_.std, rtol=0.5)


@pytest.mark.parametrize("block", [1, 37, 2000])
def test_angles_that_start_over_within_a_block_or_between_two_are_unwrapped(block: int) -> None:
    rig = Rig.load("turret")
    log = noisy(8.0, 4e-3)
    wrapped = replace(log, q=np.mod(log.q, 2 * np.pi))
    assert np.abs(np.diff(wrapped.q, axis=0)).max() > 6
    online = Online.of(rig, filtering=EXACT)
    memory = online.start()
    for begin in range(0, len(log), block):
        memory = online.advance(memory, wrapped.part(slice(begin, begin + block)))
    np.testing.assert_allclose(
        online.estimate(memory).theta, learn(online, log).theta, rtol=1e-6, atol=1e-9
    )


def test_forgetting_follows_a_drift() -> None:
    """Friction doubles slowly: what forgets ends at its present size, what does not at its mean."""
    rig = Rig.load("turret")
    log = prescribed(nominal(rig), seconds=24.0, torque_noise=0.005)
    grown = rig.friction[0, 0] * (1 + log.t / log.t[-1])
    tau = np.array(log.tau)
    tau[:, 0] += (grown - rig.friction[0, 0]) * np.sign(log.v[:, 0])  # type: ignore[index]
    drifting = replace(log, tau=tau)
    ends = {}
    for fading in (np.inf, 2.5):
        online = Online.of(rig, filtering=EXACT, fading=fading)
        model = online.model(online.advance(online.start(), drifting))
        ends[fading] = (
            next(t.values[0] for t in model.terms if t.effect == Coulomb("pan"))
            / rig.friction[0, 0]
        )
    assert ends[np.inf] < 1.75 and abs(ends[2.5] - 1.9) < 0.1


def test_a_new_camera_on_a_known_gimbal() -> None:
    """With the gimbal known, ten seconds show the camera; friction keeps what is known of it."""
    before = quiet("turret", "infrared", dt=1e-3)
    log = quiet("turret", "zoom-lens", late=True, dt=1e-3)
    stated = Filtering(alignment=before.dt / 2)
    known = identify(
        Rig.load("turret", "infrared"), [before], holdout="none", filtering=stated
    ).model
    rig = Rig.load("turret", "zoom-lens")
    online = Online.of(rig, known=known)
    memory = online.advance(online.start(), log)
    estimate = online.estimate(memory)
    free = Online.of(rig)
    alone = free.estimate(free.advance(free.start(), log))
    assert np.all(np.abs(estimate.theta - true_parameters(rig, online)) < 4 * estimate.std + 1e-6)
    assert np.all(estimate.std < 1.3 * alone.std) and np.all(
        estimate.std[-4:] < 0.6 * alone.std[-4:]
    )


def test_what_cannot_be_followed_is_refused() -> None:
    rig = Rig.load("turret")
    log = noisy()
    online = Online.of(rig)
    memory = online.advance(online.start("a.csv"), log.part(slice(0, 300)))
    with pytest.raises(LogError, match=r"a\.csv: time goes from"):
        online.advance(memory, log.part(slice(299, 400)))
    with pytest.raises(UsageError, match="rates in some samples"):
        online.advance(memory, replace(log.part(slice(300, 400)), v=None))
    with pytest.raises(DataError, match="too few samples"):
        online.model(online.start())
    with pytest.raises(DataError, match="so far"):
        online.model(memory)
    with pytest.raises(UsageError, match="memory"):
        Online.of(rig, [Presliding("pan", 0.01)])
    with pytest.raises(UsageError, match="positive"):
        Online.of(rig, fading=0.0)
    with pytest.raises(UsageError, match="no uncertainty"):
        Online.of(rig, known=nominal(rig))
    with pytest.raises(LogError, match="too short for a drive; if t has another unit"):
        online.advance(online.start("a.csv"), replace(log, t=1e-3 * log.t))
    still = replace(log, q=np.zeros_like(log.q), v=np.zeros_like(log.q))
    with pytest.raises(DataError, match="move"):
        online.model(online.advance(online.start(), still))


def test_a_clock_that_goes_back_ends_the_log_and_loses_nothing_of_it(
    run: Run, tmp_path: Path
) -> None:
    log = noisy()
    path = tmp_path / "log.csv"
    write_log(log, path)
    lines = path.read_text().splitlines(keepends=True)
    path.write_text("".join([*lines[:5_501], *lines[4_000:]]))
    code, out, err = run(
        "identify", "turret", path, "--follow", "--idle", "0", "--alignment", "0", "--json", "-"
    )
    result = json.loads(out.splitlines()[-1])
    assert code == 0, err
    assert any("learned up to 11.0 s" in note and "goes back" in note for note in result["notes"])
    online = Online.of(Rig.load("turret"), filtering=EXACT)
    before = online.identified(online.advance(online.start(), log.part(slice(0, 5_500))))
    told = {row["name"]: row["value"] for row in result["base_parameters"]}
    assert told == pytest.approx(dict(zip(before.names, before.estimate.theta.tolist())), rel=1e-9)


def test_steps_come_once_a_second() -> None:
    online = Online.of(Rig.load("turret"))
    log = noisy()
    parts = [log.part(slice(0, 4500)), log.part(slice(4500, None))]
    times = [memory.t for memory in iterate_progress(online, parts, "x")]
    assert np.diff(times[1:]).max() < 1.01 and times[-1] == log.t[-1]
    found = report_progress(online, list(iterate_progress(online, [log], "x"))[-1])
    assert (
        not found.hidden and found.to_dict()["ready"] and set(found.torque_error) == {"pan", "tilt"}
    )


def test_a_pipe_through_the_command_line(tmp_path: Path) -> None:
    """A line of JSON each second; Ctrl-C, the pipe being open still, ends with the result and the files."""
    log = noisy()
    path = tmp_path / "log.csv"
    model = tmp_path / "m.yaml"
    write_log(log, path)
    command = [
        sys.executable,
        "-m",
        "gimbal_pin.cli",
        "identify",
        "turret",
        "-",
        "--follow",
        "--json",
        "-",
    ]
    command += ["-o", str(model), "--alignment", "0"]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    lines: list[dict[str, Any]] = []
    with subprocess.Popen(command, cwd=ROOT, preexec_fn=heard, **pipes) as running:
        assert running.stdin is not None and running.stdout is not None
        running.stdin.write(path.read_bytes())
        running.stdin.flush()
        while not lines or lines[-1]["t"] < log.t[-1] - 1e-6:
            lines.append(json.loads(running.stdout.readline()))
        running.send_signal(signal.SIGINT)
        out, err = running.communicate(timeout=60)
    assert running.returncode == 0, err
    result = json.loads(out)
    assert (
        {line["kind"] for line in lines} == {"progress"} and len(lines) >= 12 and lines[-1]["ready"]
    )
    assert (
        result["kind"] == "result" and result["estimator"] == "recursive" and result["schema"] == 1
    )
    told, last = (
        {row["name"]: row for row in line["base_parameters"]} for line in (result, lines[-1])
    )
    # The result's deviations also hold what the model misses at each joint.
    assert all(
        told[name]["value"] == row["value"] and told[name]["std"] >= row["std"]
        for name, row in last.items()
    )
    assert min(result["held_out"]["fit_percent"].values()) > 99
    online = Online.of(Rig.load("turret"), filtering=EXACT)
    expected = online.model(online.advance(online.start(), log))
    np.testing.assert_allclose(
        read_model(model, expected.rig).rig.phi, expected.rig.phi, rtol=1e-9, atol=1e-12
    )


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--follow", "--holdout", "none"], "--holdout"),
        (["--follow", "--estimator", "ols"], "--estimator"),
        (["--forget", "5"], "add --follow"),
        (["other.csv", "--follow"], "one at a time"),
    ],
)
def test_options_that_do_not_go_together(run: Run, options: list[str], words: str) -> None:
    refused(run("identify", "turret", "log.csv", *options), 2, words)
