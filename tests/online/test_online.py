"""Identification on the running gimbal: the batch's answer in constant memory, and a payload that changes."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from enum import Enum
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import chdtri

from gimbal_pin.control import bench_run, tune
from gimbal_pin.dynamics import nominal
from gimbal_pin.effects import Coulomb, Presliding
from gimbal_pin.errors import DataError, LogError, UsageError
from gimbal_pin.identification import given_beta, identify, read_model
from gimbal_pin.log import Array, Log, Motion, follow, lowpass, write_log
from gimbal_pin.log.io.follow import join_whole_lines
from gimbal_pin.online import Memory, Online, progress, steps
from gimbal_pin.online.causal import Blockwise, Row
from gimbal_pin.online.change import Watch, scores_without_transient
from gimbal_pin.online.learning import values, with_rows_of
from gimbal_pin.regression import (
    Block,
    Estimate,
    Filtering,
    Known,
    Method,
    fit_weighted,
)
from gimbal_pin.rig import Rig
from tests.bench_logs import fourier, prescribed
from tests.command_line import Run, heard, refused

LOOK = 23

ROOT = Path(__file__).parents[2]


def joined(first: Log, second: Log) -> Log:
    """One log after the other on one clock, as if the payload had been swapped between two samples."""
    t = np.concatenate([first.t, second.t - second.t[0] + first.t[-1] + first.dt])
    q, v, tau = (np.concatenate([getattr(log, name) for log in (first, second)]) for name in ("q", "v", "tau"))
    return Log("swapped", first.joints, t, q, v, tau)


SWAP, END = 15.0, 25.0
"""When the payload is swapped, and the end, s."""


@cache
def quiet(rig: str, payload: str, late: bool = False, dt: float = 2e-3) -> Log:
    """A simulated closed loop with the rig's own sensors: the part of one motion before the swap, or that after it."""
    body = Rig.load(rig, payload)
    motion = fourier(body, 0, END, dt)
    rows = motion.t >= SWAP if late else motion.t < SWAP
    part = Motion(motion.t[rows] - motion.t[rows][0], motion.q[rows], motion.v[rows], motion.a[rows])
    law = tune(nominal(body), bandwidth_hz=4.0, dt=dt).controller
    return bench_run(nominal(body), law, rng=np.random.default_rng(0), reference=part)


def renoised(log: Log, seed: int) -> Log:
    """The same motion with fresh noise of rates and torques on top of that which is there."""
    rng, tau = np.random.default_rng(seed), np.asarray(log.tau)
    noise = 0.01 * np.sqrt(np.mean(tau**2, axis=0)) * rng.standard_normal(tau.shape)
    return replace(log, v=log.v + 2e-3 * rng.standard_normal(tau.shape), tau=tau + noise)


@cache
def noisy(seconds: float = 20.0) -> Log:
    log = prescribed(nominal(Rig.load("turret")), seconds=seconds, torque_noise=0.02)
    rng = np.random.default_rng(3)
    noise = rng.standard_normal((2, *log.q.shape))
    return replace(log, q=log.q + 1e-5 * noise[0], v=log.v + 1e-3 * noise[1])


def recorded(online: Online, log: Log) -> tuple[Memory, list[Row]]:
    """Advance sample block by sample block of one row's length, keeping every row that came."""
    memory, rows, count = online.start(), [], 125
    for begin in range(0, len(log), count):
        memory = online.advance(memory, log.part(slice(begin, begin + count)))
        if memory.row is not None and (not rows or rows[-1] is not memory.row):
            rows.append(memory.row)
    return memory, rows


def as_block(rows: list[Row]) -> Block:
    x = values(tuple(rows))
    t = np.array([row.t for row in rows])
    v = np.stack([row.v for row in rows])
    return Block(t, x[:, :, :-2], x[:, :, -2], v, v, x[:, :, -1])


def test_recursive_is_the_batch_on_the_same_rows() -> None:
    online = Online.of(Rig.load("turret"))
    memory, rows = recorded(online, noisy())
    ours, batch = online.estimate(memory).estimate, fit_weighted([as_block(rows)])
    assert ours.rows == len(rows) > 100
    np.testing.assert_allclose(ours.theta, batch.theta, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(ours.residual_std, batch.residual_std, rtol=1e-9)
    # The batch fits each residual's colour, for which constant memory has no room: their deviations nearly agree.
    np.testing.assert_allclose(ours.std, batch.std, rtol=0.5)
    assert np.median(ours.std / batch.std) == pytest.approx(1, abs=0.25)
    found = online.identified(memory)
    assert found.train.torque_rmse == pytest.approx(identified_rmse(batch.theta, rows), rel=1e-9)


def identified_rmse(theta: Array, rows: list[Row]) -> dict[str, float]:
    block = as_block(rows)
    error, share = block.b - block.A @ theta, block.share
    rmse = np.sqrt(np.sum(error**2, axis=0) / np.sum(share**2, axis=0))
    return dict(zip(("pan", "tilt"), rmse.tolist()))


@settings(max_examples=4)
@given(st.lists(st.integers(1, 7999), max_size=12), st.booleans())
def test_any_cut_into_blocks_gives_the_same(cuts: list[int], gap: bool) -> None:
    """Bit for bit: the frames do not depend on the blocks. Also across a gap, and with a clock that jitters."""
    log = noisy().part(slice(0, 8000))
    t = log.t + 2e-4 * np.sin(np.arange(len(log))) + (log.t > 5.0) * (3.0 if gap else 0.0)
    log = replace(log, t=t)
    online = Online.of(Rig.load("turret"))
    whole, cut = online.advance(online.start(), log), online.start()
    for begin, end in pairwise(sorted({0, *cuts, len(log)})):
        cut = online.advance(cut, log.part(slice(begin, end)))
    assert len(whole.known.window) > 10
    np.testing.assert_array_equal(gathered_factors(whole), gathered_factors(cut))


def gathered_factors(memory: Memory) -> Array:
    assert memory.task is not None
    return with_rows_of(memory.task, memory.known.settled, memory.known.window).factors


def test_one_sample_at_a_time_gives_the_same() -> None:
    log = noisy().part(slice(0, 4000))
    online = Online.of(Rig.load("turret"))
    memory = online.start()
    for k in range(len(log)):
        memory = online.advance(memory, log.part(slice(k, k + 1)))
    assert memory.samples == len(log) and memory.t == log.t[-1]
    np.testing.assert_array_equal(gathered_factors(memory), gathered_factors(online.advance(online.start(), log)))


def size(thing: object) -> int:
    """Bytes of all arrays below, and how much their owners hold."""
    if isinstance(thing, np.ndarray):
        return (thing if thing.base is None else thing.base).nbytes
    if isinstance(thing, (tuple, list)):
        return sum(size(part) for part in thing)
    if isinstance(thing, Enum):
        return 0
    return sum(size(part) for part in vars(thing).values()) if hasattr(thing, "__dict__") else 0


def test_memory_is_constant() -> None:
    online, log = Online.of(Rig.load("turret")), noisy()
    early = online.advance(online.start(), log.part(slice(0, 10_000)))
    late = online.advance(early, log.part(slice(10_000, 20_000)))
    assert size(late) <= 1.05 * size(early) < 2e6


@pytest.mark.parametrize("rig", ["turret", "thesis"])
def test_causal_rows_are_as_good_as_the_batch(rig: str) -> None:
    """Against the truth of a simulated closed loop: no bias from the filters, and deviations like the batch's."""
    body = Rig.load(rig)
    log = quiet(rig, str(body.payload))
    online = Online.of(body)
    found = online.identified(online.advance(online.start(), log))
    batch = identify(body, [log], holdout="none")
    z = (found.estimate.theta - truth(body, online)) / found.estimate.std
    assert np.sqrt(np.mean(z**2)) < 2.0 and found.names == batch.names
    ratio = found.estimate.std / batch.estimate.std
    assert 0.6 < np.median(ratio) < 1.6
    assert found.held_out is not None and min(found.held_out.fit_percent.values()) > 99


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
        online = Online.of(rig, filtering=Filtering(alignment=0.0), fading=fading)
        model = online.model(online.advance(online.start(), drifting))
        ends[fading] = next(t.values[0] for t in model.terms if t.effect == Coulomb("pan")) / rig.friction[0, 0]
    assert ends[np.inf] < 1.75 and abs(ends[2.5] - 1.9) < 0.1


SWAPS = [
    ("turret", "infrared", "zoom-lens", 1),
    ("thesis", "cinema", "mirrorless", 2),
]


@pytest.mark.parametrize(("rig", "first", "second", "seed"), SWAPS)
def test_a_swap_is_announced_and_learned(rig: str, first: str, second: str, seed: int) -> None:
    """Announced within 3 s; 10 s after it, all of the new payload is known to two per cent of what changed."""
    before, after = Rig.load(rig, first), Rig.load(rig, second)
    log = joined(renoised(quiet(rig, first), seed), renoised(quiet(rig, second, late=True), seed + 9))
    online, between = Online.of(before), round((SWAP + 1.0) / log.dt)
    memory = online.advance(online.start(), log.part(slice(0, between)))
    meanwhile = online.estimate(memory).estimate.theta
    memory = online.advance(memory, log.part(slice(between, None)))
    changes = [event for event in memory.events if event.what == "changed"]
    assert len(changes) == 1 and SWAP < changes[0].t < SWAP + 3.0 and abs(changes[0].since - SWAP) < 1.0
    old, new = (truth(one, online) for one in (before, after))
    estimate, change = online.estimate(memory).estimate, np.linalg.norm(old - new)
    assert np.linalg.norm(meanwhile - old) < 0.05 * change and np.linalg.norm(estimate.theta - new) < 0.02 * change
    assert np.sqrt(np.mean(((estimate.theta - new) / estimate.std) ** 2)) < 2.0
    still = np.isfinite(online.identified(memory).stated)  # what the first camera's URDF may still be compared with
    assert still[-before.friction.size :].all() and not still.all() and np.allclose(old[still], new[still])


def truth(rig: Rig, online: Online) -> Array:
    """What the parameters of a simulated rig are."""
    return np.concatenate([given_beta(rig, online.rows.reduction), rig.friction.ravel()])


def test_a_swap_of_a_light_camera_on_a_large_rig() -> None:
    """What changes least of all bundled pairs: also announced within 3 s, and learned within 10 s."""
    before, after = Rig.load("thesis", "mirrorless"), Rig.load("thesis", "infrared")
    logs = [renoised(prescribed(nominal(one), seconds=30.0), 4) for one in (before, after)]
    tau = np.where(logs[0].t[:, None] < 20.0, logs[0].tau, logs[1].tau)
    filtering = Filtering(alignment=0.0)
    online = Online.of(before, filtering=filtering)
    memory = online.advance(online.start(), replace(logs[0], tau=tau))
    assert [event.what for event in memory.events] == ["known", "changed", "known"]
    assert 20.0 < memory.events[1].t < 23.0 and memory.events[2].t < 30.0
    estimate, new = online.estimate(memory).estimate, truth(after, online)
    assert np.sqrt(np.mean(((estimate.theta - new) / estimate.std) ** 2)) < 2.0


@pytest.mark.parametrize(
    ("other", "swap", "pause"),
    [(None, 8.0, 0.0), ("mirrorless", 10.0, 0.0), ("mirrorless", 8.0, 0.0), ("mirrorless", 9.0, 4.0)],
)
def test_an_early_swap_is_announced_as_soon_as_a_late_one(other: str | None, swap: float, pause: float) -> None:
    """Also behind a pause in the log, where the filters settle anew; on the same noise without a swap none is told."""
    rigs = [Rig.load("thesis", payload) for payload in ("cinema", other or "cinema")]
    logs = [renoised(prescribed(nominal(one), seconds=16.0, dt=2e-3), 4) for one in rigs]
    late = logs[0].t >= swap
    tau = np.where(late[:, None], logs[1].tau, logs[0].tau)
    online = Online.of(rigs[0], filtering=Filtering(alignment=0.0))
    events = online.advance(online.start(), replace(logs[0], t=logs[0].t + pause * late, tau=tau)).events
    changes = [event.t - pause for event in events if event.what == "changed"]
    assert len(changes) == (other is not None) and all(swap < t < swap + 3.0 for t in changes)


@pytest.mark.parametrize("rows", [5, 6])
def test_what_lasts_under_seven_rows_leaves_no_trace_in_a_score(rows: int) -> None:
    """However large and wherever it is; what lasts is told by the rows that stay."""
    rng = np.random.default_rng(rows)
    A = rng.standard_normal((LOOK, 2, 3))
    known = Known(Estimate(np.zeros(3), 1e-6 * np.eye(3), np.ones(2), 1.0, 99, Method.KNOWN), np.eye(9, 1) * np.ones(2))
    watch = Watch.of(known, np.eye(3), np.zeros(3))
    noise = rng.standard_normal((LOOK, 2))
    quiet = scores_without_transient(np.dstack([A, noise, np.ones_like(noise)]), watch)
    for begin in range(0, LOOK - rows, 4):
        pushed = noise.copy()
        pushed[begin : begin + rows] += 1e3
        after = scores_without_transient(np.dstack([A, pushed, np.ones_like(noise)]), watch)
        assert all(one.value < chdtri(one.freedom, 1e-3) for one in after)
    lasting = scores_without_transient(np.dstack([A, noise + A @ [9.0, 9.0, 9.0], np.ones_like(noise)]), watch)
    assert lasting[-1].alarms(1.0) and not any(one.alarms(1.0) for one in quiet)


def test_what_is_no_payload_raises_no_alarm() -> None:
    """A push, friction that grows by a tenth, dry friction that falls with the rate: none is announced as a payload."""
    rig = Rig.load("turret")
    log = renoised(prescribed(nominal(rig), seconds=30.0), 5)
    v, tau = np.asarray(log.v), np.array(log.tau)
    tau += rig.friction[:, 0] * (0.1 * log.t[:, None] / log.t[-1] + 0.3 * np.exp(-np.abs(v) / 0.1)) * np.sign(v)
    tau[(log.t > 20.0) & (log.t < 20.2)] += 0.5 * np.abs(tau).max()
    online = Online.of(rig, filtering=Filtering(alignment=0.0))
    memory = online.advance(online.start(), replace(log, tau=tau))
    assert [event.what for event in memory.events] == ["known"] and memory.known.settled.rows > 150


def test_everything_anew_after_a_swap() -> None:
    rig = Rig.load("turret", "infrared")
    log = joined(quiet("turret", "infrared"), quiet("turret", "zoom-lens", late=True))
    online = Online.of(rig, everything=True)
    memory = online.advance(online.start(), log)
    assert [event.what for event in memory.events] == ["known", "changed", "known"] and memory.known.prior is None
    new = given_beta(Rig.load("turret", "zoom-lens"), online.rows.reduction)
    assert np.linalg.norm(online.estimate(memory).estimate.theta[: len(new)] - new) < 0.02 * np.linalg.norm(new)


def test_a_clean_log_raises_no_alarm() -> None:
    """A minute with the noise that the swaps are found in."""
    online = Online.of(Rig.load("turret", "infrared"))
    log = quiet("turret", "infrared")
    whole = log
    for seed in range(3):
        whole = joined(whole, renoised(log, seed))
    memory = online.advance(online.start(), whole)
    assert [event.what for event in memory.events] == ["known"] and memory.known.dispersion < 2.0


def test_a_new_camera_on_a_known_gimbal() -> None:
    """With the gimbal known, ten seconds show the camera; friction keeps what is known of it."""
    before, log = quiet("turret", "infrared", dt=1e-3), quiet("turret", "zoom-lens", late=True, dt=1e-3)
    known = identify(Rig.load("turret", "infrared"), [before], holdout="none").model
    rig = Rig.load("turret", "zoom-lens")
    online = Online.of(rig, known=known)
    memory = online.advance(online.start(), log)
    estimate, free = online.estimate(memory).estimate, Online.of(rig)
    alone = free.estimate(free.advance(free.start(), log)).estimate
    assert np.all(np.abs(estimate.theta - truth(rig, online)) < 4 * estimate.std + 1e-6)
    assert np.all(estimate.std < 1.3 * alone.std) and np.median(estimate.std / alone.std) < 0.9


def test_blockwise_is_the_recursion() -> None:
    from scipy.signal import sosfilt, sosfilt_zi

    rng, sections = np.random.default_rng(0), lowpass(4.0, 1000.0)
    x = rng.standard_normal((60, 3))
    filter_, last = Blockwise.of(sections, 20), Blockwise.of(sections, 20, last=True)
    memory = ends = filter_.at_rest(x[0])
    expected, _ = sosfilt(sections, x, axis=0, zi=sosfilt_zi(sections)[:, :, None] * x[0])
    for begin in range(0, 60, 20):
        out, memory = filter_(x[begin : begin + 20], memory)
        end, ends = last(x[begin : begin + 20], ends)
        np.testing.assert_allclose(out, expected[begin : begin + 20], rtol=0, atol=1e-12)
        np.testing.assert_allclose(end[0], out[-1], rtol=0, atol=1e-12)


def test_what_cannot_be_followed_is_refused() -> None:
    rig, log = Rig.load("turret"), noisy()
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


@given(st.binary(max_size=60), st.lists(st.integers(0, 60), max_size=6))
def test_whole_lines_lose_nothing_but_an_open_end(data: bytes, cuts: list[int]) -> None:
    parts: Iterator[bytes] = (data[a:b] for a, b in pairwise(sorted({0, *cuts, len(data)})))
    lines = list(join_whole_lines(parts))
    assert b"".join(lines) == data[: data.rfind(b"\n") + 1] and all(part.endswith(b"\n") for part in lines)


def test_a_growing_file_is_followed(tmp_path: Path) -> None:
    """The header comes first, a line in two halves; flaws are named by their line in the file."""
    rig, path = Rig.load("turret"), tmp_path / "log.csv"
    write_log(noisy().part(slice(0, 300)), path)
    lines = path.read_text().splitlines(keepends=True)
    path.write_text("".join(lines[:100]) + lines[100][:9])
    logs = follow(str(path), rig, idle=0.2)
    first = next(logs)
    with path.open("a") as file:
        file.write(lines[100][9:] + "".join(lines[101:200]) + "1.0,x" + lines[200])
    assert len(first) == 99
    np.testing.assert_array_equal(next(logs).q, noisy().q[99:199])
    with pytest.raises(LogError, match=r"log\.csv:201"):
        next(logs)
    path.write_text("".join(lines))
    np.testing.assert_array_equal(np.concatenate([log.q for log in follow(str(path), rig, idle=0.0)]), noisy().q[:300])
    path.write_text("")
    with pytest.raises(LogError, match="empty"):
        list(follow(str(path), rig, idle=0.0))


@pytest.mark.parametrize("row", [1, 500, 799])
def test_all_samples_before_a_flaw_are_used(row: int, tmp_path: Path) -> None:
    rig, path, log = Rig.load("turret"), tmp_path / "log.csv", noisy().part(slice(0, 800))
    write_log(log, path)
    lines = path.read_text().splitlines(keepends=True)
    for flaw, words in (
        ("-1.0" + lines[1 + row][lines[1 + row].index(",") :], "goes back"),
        ("x" + lines[1 + row], ""),
    ):
        path.write_text("".join([*lines[: 1 + row], flaw, *lines[2 + row :]]))
        logs = follow(str(path), rig, idle=0.0)
        np.testing.assert_array_equal(next(logs).q, log.q[:row])
        with pytest.raises(LogError, match=rf"log\.csv:{2 + row} column 't'.*{words}"):
            next(logs)


def test_a_clock_that_goes_back_ends_the_log_and_loses_nothing_of_it(run: Run, tmp_path: Path) -> None:
    log, path = noisy().part(slice(0, 12_001)), tmp_path / "log.csv"
    write_log(log, path)
    lines = path.read_text().splitlines(keepends=True)
    path.write_text("".join([*lines[:11_001], *lines[8_000:]]))
    code, out, err = run("identify", "turret", path, "--follow", "--idle", "0", "--alignment", "0", "--json", "-")
    result = json.loads(out.splitlines()[-1])
    assert code == 0, err
    assert any("learned up to 11.0 s" in note and "goes back" in note for note in result["notes"])
    online = Online.of(Rig.load("turret"), filtering=Filtering(alignment=0.0))
    before = online.identified(online.advance(online.start(), log.part(slice(0, 11_000))))
    told = {row["name"]: row["value"] for row in result["base_parameters"]}
    assert told == pytest.approx(dict(zip(before.names, before.estimate.theta.tolist())), rel=1e-9)


def test_steps_come_once_a_second() -> None:
    online, log = Online.of(Rig.load("turret")), noisy()
    times = [memory.t for memory in steps(online, [log.part(slice(0, 9000)), log.part(slice(9000, None))], "x")]
    assert np.diff(times[1:]).max() < 1.01 and times[-1] == log.t[-1]
    found = progress(online, list(steps(online, [log], "x"))[-1])
    assert not found.hidden and found.to_dict()["ready"] and set(found.torque_error) == {"pan", "tilt"}


def test_a_pipe_through_the_command_line(tmp_path: Path) -> None:
    """A line of JSON each second; Ctrl-C, the pipe being open still, ends with CONTRACT's result and the files."""
    log, path, model = noisy().part(slice(0, 12_001)), tmp_path / "log.csv", tmp_path / "m.yaml"
    write_log(log, path)
    command = [sys.executable, "-m", "gimbal_pin.cli", "identify", "turret", "-", "--follow", "--json", "-"]
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
    assert {line["kind"] for line in lines} == {"progress"} and len(lines) >= 12 and lines[-1]["ready"]
    assert result["kind"] == "result" and result["estimator"] == "recursive" and result["schema"] == 1
    told = [{key: row[key] for key in ("name", "value", "std", "unit")} for row in result["base_parameters"]]
    assert lines[-1]["base_parameters"] == told
    assert min(result["held_out"]["fit_percent"].values()) > 99
    online = Online.of(Rig.load("turret"), filtering=Filtering(alignment=0.0))
    expected = online.model(online.advance(online.start(), log))
    np.testing.assert_allclose(read_model(model, expected.rig).rig.phi, expected.rig.phi, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--follow", "--holdout", "none"], "--holdout"),
        (["--follow", "--estimator", "ols"], "--estimator"),
        (["--forget", "5"], "add --follow"),
        (["--anew", "everything"], "add --follow"),
        (["other.csv", "--follow"], "one at a time"),
    ],
)
def test_options_that_do_not_go_together(run: Run, options: list[str], words: str) -> None:
    refused(run("identify", "turret", "log.csv", *options), 2, words)
