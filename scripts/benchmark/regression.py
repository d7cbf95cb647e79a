"""Regressor, factor and solution against Pinocchio's bare loop and FIGAROH's builder, on the same samples."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from importlib.machinery import PathFinder
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pinocchio as pin

from benchmark.data import DT, exciting, noisy_log, repeated
from benchmark.figure import Figure
from benchmark.timing import alternating
from gimbal_pin.dynamics.model import Model, build_friction_effects, nominal
from gimbal_pin.dynamics.reduction import reduce_parameters
from gimbal_pin.identification import identify
from gimbal_pin.log.log import Array, Motion
from gimbal_pin.regression import (
    CHUNK_SAMPLES,
    Block,
    Design,
    Filtering,
    Samples,
    factor_rows,
    solve_factors,
)
from gimbal_pin.rig.rig import Rig

ROUNDS = {60_000: (11, 1.3), 600_000: (3, 1.2)}
"""Number of samples → how often each way is timed, and how many times a bare loop with one QR `identify` may take."""
Builder = Callable[..., Array]


def measure() -> Iterator[Figure]:
    """Yield the figures for every number of samples."""
    model = nominal(Rig.load("thesis"))
    yield from equivalence(model)
    for count, (rounds, most) in ROUNDS.items():
        yield from compared(model, count, rounds, most)
    yield from filtering(model, 60_000, 3)


def compared(model: Model, count: int, rounds: int, most: float) -> Iterator[Figure]:
    """Yield rates and ratios on `count` samples."""
    motion, tau = samples(model, count)
    rows = unfiltered(model.rig)
    log = noisy_log(model, count, np.random.default_rng(1))
    ways: dict[str, Callable[[], object]] = {
        "bare": lambda: bare(model.rig, motion),
        "factored": lambda: factored(model.rig, motion, tau),
        "identify": lambda: identify(model.rig, [log]),
        "ours": lambda: solution(rows, motion, tau),
    }
    if (build := figaroh()) is not None:
        ways["figaroh"] = lambda: figaroh_regressor(build, model.rig, motion)
    times = alternating(ways, rounds, f"regressor, {count} samples")
    rate = {name: count / 1e3 / times.median(name) for name in ways}
    of = f"{count:,} samples: ".replace(",", " ")
    yield Figure(f"{of}bare Pinocchio loop, evaluated only", rate["bare"], "k/s")
    yield Figure(f"{of}FIGAROH's builder with friction", rate.get("figaroh"), "k/s")
    yield Figure(f"{of}ours, built, factored and solved", rate["ours"], "k/s")
    yield Figure(f"{of}time of ours, solved / bare loop", times.ratio("ours", "bare"), at_most=2.5)
    yield Figure(
        f"{of}time of ours, solved / FIGAROH, built", times.ratio("ours", "figaroh"), at_most=1.0
    )
    yield Figure(
        f"{of}time of identify / bare loop, one QR",
        times.ratio("identify", "factored"),
        at_most=most,
    )


def filtering(model: Model, count: int, rounds: int) -> Iterator[Figure]:
    """Yield the rate of the whole way from a noisy log: smoothed, built, masked, filtered, decimated, solved."""
    log = noisy_log(model, count, np.random.default_rng(1))
    rows = Design(
        model.rig,
        reduce_parameters(model.rig),
        build_friction_effects(model.rig.joints),
        (log,),
        Filtering(),
    )
    ways = {"filtered": lambda: solve_factors(factor_rows(rows), np.ones(model.rig.n))}
    time = alternating(ways, rounds, "filtering").median("filtered")
    yield Figure(
        f"{count:,} samples: ours with all filtering".replace(",", " "), count / 1e3 / time, "k/s"
    )


def equivalence(model: Model) -> Iterator[Figure]:
    """Yield how far the three ways' torques are from inverse dynamics: they compute the same thing."""
    motion, tau = samples(model, 2000)
    rows = unfiltered(model.rig)
    theta = solution(rows, motion, tau)
    ours = np.concatenate([block.A @ theta for block in blocks(rows, motion, tau)])
    yield Figure(
        "torque of ours, solved, less inverse dynamics",
        float(np.abs(ours - tau).max()),
        "N m",
        at_most=1e-9,
    )
    if (build := figaroh()) is not None:
        parameters = np.concatenate(
            [model.rig.phi, model.rig.friction[:, 1], model.rig.friction[:, 0]]
        )
        theirs = (
            (figaroh_regressor(build, model.rig, motion) @ parameters).reshape(model.rig.n, -1).T
        )
        error = float(np.abs(theirs - tau).max())
        yield Figure(
            "torque of FIGAROH's columns less inverse dynamics", error, "N m", at_most=1e-9
        )


def samples(model: Model, count: int) -> tuple[Motion, Array]:
    """Return `count` samples of an exciting motion, and its torque, N m, (count, n)."""
    period = exciting(model.rig, np.random.default_rng(0))
    tau = model.inverse_dynamics(period.q, period.v, period.a)
    motion = Motion(
        DT * np.arange(count), *(repeated(x, count) for x in (period.q, period.v, period.a))
    )
    return motion, repeated(tau, count)


def bare(rig: Rig, motion: Motion) -> None:
    """Evaluate Pinocchio's regressor at every sample, and keep nothing."""
    model = rig.model
    data = rig.model.createData()
    compute = pin.computeJointTorqueRegressor
    for q, v, a in zip(motion.q, motion.v, motion.a):
        compute(model, data, q, v, a)


def factored(rig: Rig, motion: Motion, tau: Array) -> Array:
    """Keep Pinocchio's regressor of every sample with friction's columns and the torque; return the R of one QR."""
    n = rig.n
    data = rig.model.createData()
    rows = np.zeros((len(motion), n, 12 * n + 1))
    for row, q, v, a in zip(rows, motion.q, motion.v, motion.a):
        row[:, : 10 * n] = pin.computeJointTorqueRegressor(rig.model, data, q, v, a)
    for j in range(n):
        rows[:, j, 10 * n + j], rows[:, j, 11 * n + j] = np.sign(motion.v[:, j]), motion.v[:, j]
    rows[:, :, -1] = tau
    return np.linalg.qr(rows.reshape(-1, rows.shape[2]), mode="r")


def unfiltered(rig: Rig) -> Design:
    """Return the builder of our columns: base parameters, Coulomb and viscous friction."""
    return Design(rig, reduce_parameters(rig), build_friction_effects(rig.joints), (), Filtering())


def blocks(rows: Design, motion: Motion, tau: Array) -> Iterator[Block]:
    """Yield our columns chunk by chunk, every sample a row."""
    for begin in range(0, len(motion), CHUNK_SAMPLES):
        at = slice(begin, begin + CHUNK_SAMPLES)
        channels = Samples(
            motion.t[at],
            motion.q[at],
            motion.v[at],
            motion.a[at],
            tau[at],
            motion.v[at],
            np.zeros(rows.rig.n),
        )
        columns = [rows.compute_rigid_columns(channels), rows.compute_effect_columns(channels)]
        A = np.concatenate(columns, axis=2)
        c = channels
        yield Block(
            c.t, A, c.tau, c.q, c.v, np.ones(c.q.shape), np.zeros(c.q.shape), np.zeros(c.q.shape)
        )


def solution(rows: Design, motion: Motion, tau: Array) -> Array:
    """Base parameters and friction coefficients by TSQR and least squares."""
    return solve_factors(factor_rows(blocks(rows, motion, tau)), np.ones(rows.rig.n)).theta


def figaroh() -> Builder | None:
    """FIGAROH's `build_regressor_basic`, or None; its one file is loaded alone, as its package needs far more."""
    package = PathFinder.find_spec("figaroh")
    if package is None or package.origin is None:
        return None
    spec = spec_from_file_location(
        "figaroh_regressor", Path(package.origin).parent / "tools" / "regressor.py"
    )
    assert spec is not None and spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    builder: Builder = module.build_regressor_basic
    return builder


def figaroh_regressor(build: Builder, rig: Rig, motion: Motion) -> Array:
    """FIGAROH's stacked regressor with friction columns, (n N, 12 n), joint after joint."""
    robot = SimpleNamespace(model=rig.model, data=rig.model.createData())
    config = {"is_joint_torques": True, "has_friction": True, "act_idxv": list(range(rig.n))}
    return build(robot, motion.q, motion.v, motion.a, config)
