"""A model against least squares without a mask, both on every held-out sample of a log."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.signal import butter, sosfiltfilt

from gimbal_pin.dynamics.regressor import compute_regressor
from gimbal_pin.identification.model_file import read_model
from gimbal_pin.log.io import read_log
from gimbal_pin.log.log import Array
from gimbal_pin.rig.rig import Rig
from real_data.cases import Case

SMOOTHING = 8.0
"""Low-pass of the channels before they are differentiated, in cutoffs: what identify's filter has (`Filtering`)."""


def lowpass(x: Array, cutoff: float, rate: float) -> Array:
    """Third-order Butterworth, forwards and backwards along the first axis; nothing at half the rate or above."""
    return x if cutoff >= rate / 2 else np.asarray(sosfiltfilt(butter(3, cutoff, output="sos", fs=rate), x, axis=0))


def errors(case: Case, model: Path, cutoff: float) -> tuple[Array, Array]:
    """Return held-out torque errors rms, N m, (n,): of a model's file, and of least squares on all other samples.

    The last third of the time is held out. Rigid body, viscous and Coulomb friction; the same low-pass at `cutoff`, Hz,
    on every column, on the model's torque and on the measured one; a filter's length is left out at each end.
    """
    rig = Rig.load(case.rig)
    log = read_log(case.logs[0], rig, case.maps)
    assert log.tau is not None, "read_log refuses a log without torque"
    rate = (len(log.t) - 1) / (log.t[-1] - log.t[0])
    t = np.arange(log.t[0], log.t[-1], 1 / rate)

    def even(x: Array) -> Array:
        return np.column_stack([np.interp(t, log.t, column) for column in x.T])

    q, tau = lowpass(even(log.q), SMOOTHING * cutoff, rate), even(log.tau)
    v = np.gradient(q, t, axis=0) if log.v is None else lowpass(even(log.v), SMOOTHING * cutoff, rate)
    a = np.gradient(v, t, axis=0)
    rigid = compute_regressor(rig, q, v, a)
    friction = np.concatenate([np.einsum("ij,jk->ijk", x, np.eye(rig.n)) for x in (v, np.sign(v))], axis=2)
    columns = lowpass(np.concatenate([rigid, friction], axis=2), cutoff, rate)
    measured = lowpass(tau, cutoff, rate)
    predicted = lowpass(read_model(model, rig).inverse(q, v, a, t=t), cutoff, rate)
    edge, cut = int(rate / cutoff), int(len(t) * 2 / 3)
    train, test = slice(edge, cut - edge), slice(cut + edge, len(t) - edge)
    width = columns.shape[2]
    theta = np.linalg.lstsq(columns[train].reshape(-1, width), measured[train].reshape(-1), rcond=1e-8)[0]
    left = measured[test] - predicted[test], measured[test] - columns[test] @ theta
    mine, plain = (np.sqrt(np.mean(x**2, axis=0)) for x in left)
    return mine, plain
