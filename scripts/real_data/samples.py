"""A model against least squares without a mask, both on every held-out sample of a log."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.signal import butter, sosfiltfilt

from gimbal_pin.dynamics.regressor import compute_regressor
from gimbal_pin.errors import GimbalPinError
from gimbal_pin.identification.model_file import read_model
from gimbal_pin.log.io import read_log
from gimbal_pin.log.log import Array
from gimbal_pin.rig.rig import Rig
from real_data.cases import Case

SMOOTHING = 8.0
"""Low-pass of the channels before they are differentiated, in cutoffs: what identify's filter has (`Filtering`)."""


def lowpass(x: Array, cutoff: float, rate: float) -> Array:
    """Third-order Butterworth, forwards and backwards along the first axis; nothing at half the rate or above."""
    return (
        x
        if cutoff >= rate / 2
        else np.asarray(sosfiltfilt(butter(3, cutoff, output="sos", fs=rate), x, axis=0))
    )


@dataclass(frozen=True)
class Held:
    """Least squares on the first two thirds of a log, and its last third.

    Attributes:
        motion: Time, angles, rates and accelerations of the whole log.
        test: The held-out samples.
        measured: Their filtered torque, N m, (N, n).
        predicted: That of least squares.
        rate: Samples per second.
    """

    motion: tuple[Array, Array, Array, Array]
    test: slice
    measured: Array
    predicted: Array
    rate: float


def least_squares(case: Case, cutoff: float) -> Held:
    """Fit rigid body, viscous and Coulomb friction to a log's first two thirds, without a mask.

    The same low-pass at `cutoff`, Hz, on every column and on the torque; a filter's length is left out at each end.
    """
    rig = Rig.load(case.rig)
    log = read_log(case.logs[0], rig, case.maps)
    assert log.tau is not None, "read_log refuses a log without torque"
    rate = (len(log.t) - 1) / (log.t[-1] - log.t[0])
    t = np.arange(log.t[0], log.t[-1], 1 / rate)

    def even(x: Array) -> Array:
        return np.column_stack([np.interp(t, log.t, column) for column in x.T])

    q = lowpass(even(log.q), SMOOTHING * cutoff, rate)
    tau = even(log.tau)
    v = (
        np.gradient(q, t, axis=0)
        if log.v is None
        else lowpass(even(log.v), SMOOTHING * cutoff, rate)
    )
    a = np.gradient(v, t, axis=0)
    rigid = compute_regressor(rig, q, v, a)
    friction = np.concatenate(
        [np.einsum("ij,jk->ijk", x, np.eye(rig.n)) for x in (v, np.sign(v))], axis=2
    )
    columns = lowpass(np.concatenate([rigid, friction], axis=2), cutoff, rate)
    measured = lowpass(tau, cutoff, rate)
    edge = int(rate / cutoff)
    cut = int(len(t) * 2 / 3)
    train = slice(edge, cut - edge)
    test = slice(cut + edge, len(t) - edge)
    width = columns.shape[2]
    theta = np.linalg.lstsq(
        columns[train].reshape(-1, width), measured[train].reshape(-1), rcond=1e-8
    )[0]
    return Held((t, q, v, a), test, measured[test], columns[test] @ theta, rate)


def errors(case: Case, model: Path, cutoff: float) -> tuple[Array, Array]:
    """Return held-out torque errors rms, N m, (n,): of a model's file, and of least squares on all other samples."""
    held = least_squares(case, cutoff)
    t, q, v, a = held.motion
    mine = lowpass(
        read_model(model, Rig.load(case.rig)).inverse_dynamics(q, v, a, t=t), cutoff, held.rate
    )[held.test]
    one, other = (
        np.sqrt(np.mean((held.measured - x) ** 2, axis=0)) for x in (mine, held.predicted)
    )
    return one, other


def explained_share(case: Case, cutoff: float) -> float:
    """Return the share of the held-out torque's power that least squares explains, of its best joint; 0: no fit."""
    try:
        held = least_squares(case, cutoff)
    except GimbalPinError:
        return 0.0
    left = np.mean((held.measured - held.predicted) ** 2, axis=0)
    power = np.mean(held.measured**2, axis=0)
    return float(1 - np.min(left[power > 0] / power[power > 0]))
