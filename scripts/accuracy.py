"""How near identification comes to the truth: every bundled rig and payload, 1 % torque noise, 16-bit encoders.

Prints, per rig and payload over the seeds, the held-out torque error against that of the same fit with the true,
noise-free q, v and a (must be at most 1.5 times), the largest error in its own standard deviations (at most 4), and
the largest relative error of the parameters whose deviation is under 1.2 % (at most 5 %).
"""

from __future__ import annotations

import os
import sys
from collections import defaultdict
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, replace
from unittest.mock import patch

import numpy as np
import tyro
from tqdm import tqdm

from gimbal_pin.control import repeated, tune
from gimbal_pin.dynamics import Model, Plant, Sensors, State, nominal, simulate
from gimbal_pin.excitation import excite
from gimbal_pin.identification import IdentificationResult, identify
from gimbal_pin.log import Array, Log, Motion
from gimbal_pin.regression import Filtering, Samples, Segment
from gimbal_pin.rig.files import bundled_payloads, bundled_rigs
from gimbal_pin.rig.rig import Rig
from tests.bench_logs import true_theta


@dataclass(frozen=True)
class Score:
    """Largest ratio to the fit from the truth, errors in deviations, largest error of sharp parameters."""

    ratio: float
    z: tuple[float, ...]
    sharp: float


def replay_motion(plant: Model, log: Log, tau: Array) -> Motion:
    """Return the plant's states in the middle of each held torque, replayed from the torques that acted."""
    system = Plant(plant)
    half = log.dt / 2
    state = State(np.array(log.q_ref[0]), np.zeros(plant.rig.n))  # type: ignore[index]
    q, v, a = (np.empty((len(log), plant.rig.n)) for _ in range(3))
    for k, t in enumerate(log.t.tolist()):
        state = system.step(t, state, tau[k], half)
        q[k], v[k] = state.q, state.v
        a[k] = system.acceleration(t, state, tau[k])
        state = system.step(t, state, tau[k], half)
    return Motion(log.t, q, v, a)


def identify_from_truth(rig: Rig, log: Log, tau: Array) -> IdentificationResult:
    """Return the fit with the noise-free q, v and a, and with the true standstill of each joint."""
    true = replay_motion(nominal(rig), log, tau)
    measured = np.asarray(log.tau)

    def channels(
        stretch: Segment, _: Filtering, first: int, last: int, carrier: str | None
    ) -> Samples:
        assert carrier is None
        begin = round((stretch.start - log.t[0]) / log.dt) + first
        part = slice(begin, begin + last - first)
        t, q, v, a, tau = (x[part] for x in (true.t, true.q, true.v, true.a, measured))
        return Samples(t, q, v, a, tau, v, np.zeros(rig.n))

    with (
        patch("gimbal_pin.regression.design.smooth_samples", channels),
        patch(
            "gimbal_pin.regression.design.find_standstill",
            lambda channels, _: np.abs(channels.v) < 1e-12,
        ),
    ):
        return identify(rig, [log])


def simulate_excitation(
    rig: Rig, seed: int, seconds: float, torque_noise: float = 0.01, bits: float = 16
) -> tuple[Log, Array]:
    """Simulate an excitation under computed torque; return its log, and the torque without sensor noise."""
    rng = np.random.default_rng(seed)
    plant = nominal(rig)
    reference = repeated(excite(rig, starts=1, rng=rng).motion, seconds, 1e-3)
    sensors = replace(Sensors.of(rig, 1e-3), encoder_step=np.full(rig.n, 2 * np.pi / 2**bits))
    log = simulate(plant, tune(plant).controller, reference, rng=rng, sensors=sensors)
    tau = np.array(log.tau)
    noise = torque_noise * np.sqrt(np.mean(tau**2, axis=0)) * rng.standard_normal(tau.shape)
    return replace(log, tau=tau + noise), tau


def score(name: str, payload: str, seed: int, seconds: float) -> tuple[str, str, Score]:
    """Simulate and identify one log."""
    rig = Rig.load(name, payload)
    log, tau = simulate_excitation(rig, seed, seconds)
    found = identify(rig, [log])
    best = identify_from_truth(rig, log, tau)
    truth = true_theta(rig)
    error = np.abs(found.estimate.theta - truth)
    std = found.estimate.std
    ratio = max(
        left / best.held_out.torque_rmse[joint]
        for joint, left in found.held_out.torque_rmse.items()
    )
    sharp = (error / np.abs(truth))[std < 0.012 * np.abs(truth)]
    return name, payload, Score(ratio, tuple((error / std).tolist()), float(sharp.max(initial=0.0)))


def main(
    seeds: int = 20, seconds: float = 60.0, first: int = 1000, workers: int = os.cpu_count() or 1
) -> None:
    """Run the table.

    Args:
        seeds: Logs per rig and payload.
        seconds: Length of each log, s.
        first: First seed.
        workers: Processes.
    """
    jobs = [
        (rig, load, first + k, seconds)
        for rig in bundled_rigs()
        for load in bundled_payloads()
        for k in range(seeds)
    ]
    scores: dict[tuple[str, str], list[Score]] = defaultdict(list)
    with ProcessPoolExecutor(workers) as pool:
        futures = [pool.submit(score, *job) for job in jobs]
        for future in tqdm(as_completed(futures), total=len(jobs), unit="log", disable=None):
            name, payload, found = future.result()
            scores[name, payload].append(found)
    print(
        f"{'rig':10}{'payload':12}{'ratio median':>14}{'worst':>8}{'z rms':>8}{'worst':>8}{'sharp worst %':>15}"
    )
    for (name, payload), rows in sorted(scores.items()):
        ratios = [row.ratio for row in rows]
        z = np.concatenate([row.z for row in rows])
        figures = f"{np.median(ratios):14.2f}{max(ratios):8.2f}{np.sqrt(np.mean(z**2)):8.2f}{z.max():8.2f}"
        print(f"{name:10}{payload:12}{figures}{100 * max(row.sharp for row in rows):15.2f}")
    everything = [row for rows in scores.values() for row in rows]
    z = np.concatenate([row.z for row in everything])
    worst = (
        max(row.ratio for row in everything),
        float(z.max()),
        100 * max(row.sharp for row in everything),
    )
    passed = worst[0] <= 1.5 and worst[1] <= 4.0 and worst[2] <= 5.0
    print(
        f"{len(everything)} logs, {len(z)} parameters: ratio {worst[0]:.2f} (1.5), z {worst[1]:.2f} (4), "
        f"sharp {worst[2]:.2f} % (5): {'PASS' if passed else 'FAIL'}"
    )
    sys.exit(not passed)


if __name__ == "__main__":
    tyro.cli(main)
