"""Laws of a log that is still growing: the batch's answer in constant memory, however it is cut."""

from __future__ import annotations

import json
import pickle
import signal
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from gimbal_pin.dynamics import nominal
from gimbal_pin.effects import Presliding
from gimbal_pin.errors import GimbalPinError
from gimbal_pin.identification import Online, identify, read_model
from gimbal_pin.log import Log, write_log
from gimbal_pin.regression import Estimate
from tests.bench_logs import EXACT, prescribed, true_theta
from tests.command_line import heard
from tests.rigs import bundled

RIG = bundled("turret")
ONLINE = Online.of(RIG, filtering=EXACT)
NOISE = np.random.default_rng(3).standard_normal((2, 5001, 2))
CLEAN = prescribed(nominal(RIG), seconds=20.0, torque_noise=0.02, dt=4e-3)
LOG = replace(CLEAN, q=CLEAN.q + 1e-5 * NOISE[0], v=CLEAN.v + 1e-3 * NOISE[1])


def learn(online: Online, log: Log) -> Estimate:
    """Return the estimate of all of a log."""
    return online.estimate(online.advance(online.start(), log))


def test_stream_is_the_batch() -> None:
    """The windows differ, and with them the noise by which rows are masked."""
    found = ONLINE.identified(ONLINE.advance(ONLINE.start(), LOG))
    batch = identify(RIG, [LOG], holdout="none", filtering=EXACT)
    assert found.names == batch.names
    assert np.all(np.abs(found.estimate.theta - batch.estimate.theta) < 0.1 * batch.estimate.std)
    np.testing.assert_allclose(found.estimate.std, batch.estimate.std, rtol=0.05)
    assert found.train.torque_rmse == pytest.approx(batch.train.torque_rmse, rel=0.02)
    assert found.held_out is not None
    assert min(found.held_out.fit_percent.values()) > 97
    z = (found.estimate.theta - true_theta(RIG)) / found.estimate.std
    assert np.sqrt(np.mean(z**2)) < 2.0


@settings(max_examples=4)
@given(st.lists(st.integers(1, 1999), max_size=12), st.booleans())
@example(list(range(1, 2000)), False)
def test_any_cut_into_blocks_gives_the_same(cuts: list[int], gap: bool) -> None:
    """Across a gap, lost samples and angles that start over; one sample at a time, too."""
    log = LOG.part(slice(0, 2000))
    t = log.t + 8e-4 * np.sin(np.arange(len(log))) + (log.t > 4.0) * (3.0 if gap else 0.0)
    log = replace(log, t=t).part(np.delete(np.arange(2000), np.arange(700, 705)))
    wrapped = replace(log, q=np.mod(log.q, 2 * np.pi))
    assert np.abs(np.diff(wrapped.q, axis=0)).max() > 6
    memory = ONLINE.start()
    for begin, end in pairwise(sorted({0, *(cut for cut in cuts if cut < len(log)), len(log)})):
        memory = ONLINE.advance(memory, wrapped.part(slice(begin, end)))
    assert memory.samples == len(log)
    one = learn(ONLINE, log)
    other = ONLINE.estimate(memory)
    np.testing.assert_allclose(one.theta, other.theta, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(one.std, other.std, rtol=1e-6)


def test_memory_is_constant_and_rows_that_are_not_held_count() -> None:
    little = replace(ONLINE, most_rows=96)
    early = little.advance(little.start(), LOG.part(slice(0, 4000)))
    late = little.advance(early, LOG.part(slice(4000, None)))
    assert late.learned.past.rows > early.learned.past.rows > 0
    assert len(pickle.dumps(late)) <= 1.5 * len(pickle.dumps(early))
    few = little.answer(late)[0]
    whole = ONLINE.answer(ONLINE.advance(ONLINE.start(), LOG))[0]
    assert few.rows == whole.rows
    np.testing.assert_allclose(few.theta, whole.theta, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(few.residual_std, whole.residual_std, rtol=1e-9)
    np.testing.assert_allclose(few.std, whole.std, rtol=0.5)


@pytest.mark.parametrize(("fading", "share"), [(np.inf, 1.5), (2.5, 1.9)])
def test_forgetting_follows_a_drift(fading: float, share: float) -> None:
    """Friction doubles slowly: what forgets ends near its present size, what does not at its mean."""
    more = np.sign(np.asarray(CLEAN.v)) * (LOG.t / LOG.t[-1])[:, None] * RIG.friction[:, 0]
    online = Online.of(RIG, filtering=EXACT, fading=fading)
    found = learn(online, replace(LOG, tau=LOG.tau + more)).theta
    k = online.design.names.index("pan.Fs")
    assert found[k] / RIG.friction[0, 0] == pytest.approx(share, abs=0.2)


SHORT = LOG.part(slice(0, 75))
BEGUN = ONLINE.advance(ONLINE.start(), SHORT)
REFUSED: dict[str, Callable[[], object]] = {
    "time goes from": lambda: ONLINE.advance(BEGUN, SHORT),
    "rates in some samples": lambda: ONLINE.advance(
        BEGUN, replace(LOG.part(slice(75, 100)), v=None)
    ),
    "too few samples": lambda: ONLINE.model(ONLINE.start()),
    "so far": lambda: ONLINE.model(BEGUN),
    "move every joint": lambda: learn(ONLINE, replace(LOG, q=0 * LOG.q, v=0 * LOG.q)),
    "positive": lambda: Online.of(RIG, fading=0.0),
    "memory": lambda: Online.of(RIG, [Presliding("pan", 0.01)]),
    "no uncertainty": lambda: Online.of(RIG, known=nominal(RIG)),
    "too short for a drive; if t has another unit": lambda: ONLINE.advance(
        ONLINE.start(), replace(SHORT, t=1e-3 * SHORT.t)
    ),
    "tau_pan and tau_tilt have the wrong sign": lambda: ONLINE.identified(
        ONLINE.advance(ONLINE.start(), replace(LOG, tau=-np.asarray(LOG.tau)))
    ),
}


@pytest.mark.parametrize("words", REFUSED)
def test_what_cannot_be_followed_is_refused(words: str) -> None:
    with pytest.raises(GimbalPinError, match=words):
        REFUSED[words]()


def test_pipe_is_followed_until_it_is_interrupted(tmp_path: Path) -> None:
    """A line of JSON each second; Ctrl-C ends with the result and the files."""
    log = LOG.part(slice(0, 2001))
    path = tmp_path / "log.csv"
    model = tmp_path / "model.yaml"
    write_log(log, path)
    command = [sys.executable, "-m", "gimbal_pin.cli", "identify", "turret", "-", "--follow"]
    command += ["--json", "-", "-o", str(model), "--alignment", "0"]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    lines: list[dict[str, Any]] = []
    root = Path(__file__).parents[2]
    with subprocess.Popen(command, cwd=root, preexec_fn=heard, **pipes) as running:
        assert running.stdin is not None and running.stdout is not None
        running.stdin.write(path.read_bytes())
        running.stdin.flush()
        while not lines or lines[-1]["t"] < log.t[-1] - 1e-6:
            lines.append(json.loads(running.stdout.readline()))
        running.send_signal(signal.SIGINT)
        out, err = running.communicate(timeout=60)
    assert running.returncode == 0, err
    assert len(lines) >= 8
    last, end = (
        [row["value"] for row in line["base_parameters"]] for line in (lines[-1], json.loads(out))
    )
    assert last == end
    expected = ONLINE.model(ONLINE.advance(ONLINE.start(), log)).rig
    phi = read_model(model, expected).rig.phi
    np.testing.assert_allclose(phi, expected.phi, rtol=1e-9, atol=1e-12)
