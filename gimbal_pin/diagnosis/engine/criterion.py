"""By how much one model is better than another: a criterion, and what each block of time tells.

``C = Σ_j N_j log φ_j + k log N``: twice the negative log likelihood of rows of unit noise, up to a constant, with the
penalty of Schwarz (Ann. Statist. 6, 1978); N_j are joint j's rows, k what the causes have free, φ_j is the dispersion
``⟨|R(f)|²/ρ(f)⟩`` of its residual. A drive's signal changes the measured torque, or what the model makes of the
measured motion, and the noise in it: ρ is the share of a noise's power that it passes on at each frequency. Without
that any low-pass would explain half of any noise, and any spring the noise of an acceleration.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import fft

from gimbal_pin.diagnosis.evidence import Part
from gimbal_pin.diagnosis.shapes import free
from gimbal_pin.diagnosis.state import State
from gimbal_pin.effects import Signal
from gimbal_pin.effects.signal import Borne
from gimbal_pin.log.log import Array

INSIDE, WIDTH = 0.75, 8
"""Share of the band that does not fade, and frequencies that are averaged where two spectra are compared."""


def rows(state: State) -> Array:
    """Return how many rows of each joint tell, (n,)."""
    evidence = state.problem.evidence
    return np.asarray(evidence.rows * np.maximum(evidence.used(), 1e-3))


def criterion(state: State) -> float:
    """Return ``Σ_j N_j log φ_j + k log N``."""
    count = rows(state)
    freedom = sum(free(cause) for cause in state.causes)
    return float(count @ np.log(dispersion(state)) + np.log(count.max()) * freedom)


def dispersion(state: State) -> Array:
    """Return each joint's ``φ = ⟨|R(f)|²/ρ(f)⟩``, (n,): residual power over the noise's, as the drives pass it on."""
    found = state.fit.dispersion.copy()
    for joint in {cause.joint for cause in state.causes if isinstance(cause, Signal)}:
        evidence, first = state.problem.evidence, 0
        j = evidence.rig.joint_index(joint)
        own, power, fair = state.fit.residual[state.fit.rows(j)], 0.0, 0.0
        for part, share in zip(evidence.parts, passed_on(state, j)):
            spectrum = np.abs(fft.rfft(own[first : first + part.rows])) ** 2
            first += part.rows
            power, fair = power + spectrum.sum(), fair + float(np.sum(spectrum / share))
        found[j] *= fair / max(power, 1e-300)
    return found


def passed_on(state: State, joint: int) -> list[Array]:
    """Return ρ at a joint, the share of a noise's power that its drive's signals pass on, (f,) for each part."""
    evidence = state.problem.evidence
    shares: list[Array] = [np.ones(part.whitener.shape[1]) for part in evidence.parts]
    for signal in state.causes:
        if isinstance(signal, Signal) and evidence.rig.joint_index(signal.joint) == joint:
            shares = [before * own for before, own in zip(shares, passes(state, signal))]
    return shares


def passes(state: State, signal: Signal) -> list[Array]:
    """Return the share of a noise's power that a drive's signal passes on, (f,) for each part.

    A small noise of the estimated spectrum is put beside the measured torque: for a filter the share is its gain. A
    limit below nearly all that was measured leaves a constant, in which no noise is left: that explains nothing. What
    of the noise comes through the acceleration passes what is `felt` of the joint's own inertia.
    """
    evidence, joint = state.problem.evidence, state.problem.evidence.rig.joint_index(signal.joint)
    bearing: Sequence[Borne | None] = state.bearing_for(signal, state.acting) or [None] * len(evidence.parts)
    shares: list[Array] = []
    for part, left, borne in zip(evidence.parts, state.unexplained, bearing):
        torque, noise = part.channels.tau[:, joint], flattened(part, left[:, joint], joint)
        change = part.acted(signal, torque, joint, borne) - part.acted(signal, torque - noise, joint, borne)
        share = ratio(part.whiten(change, joint), part.whiten(noise, joint))
        if signal.springy:
            felt = signal.felt(np.zeros((len(noise), 1)), noise[:, None], part.dt)[:, 0]
            shaken = np.minimum(part.shaken[joint] * part.whitener[joint] ** 2, 1.0)[: len(share)]
            share += shaken * (ratio(part.whiten(felt, joint), part.whiten(noise, joint)) - share)
        shares.append(np.pad(share, (0, part.whitener.shape[1] - len(share)), mode="edge"))
    return shares


def ratio(after: Array, before: Array) -> Array:
    """Return the share of one signal's power, rows of a part, that another has at each frequency inside the band."""
    powers = [np.abs(fft.rfft(x)) ** 2 for x in (after, before)]
    inside = int(INSIDE * len(powers[0])) // WIDTH * WIDTH
    a, b = (np.mean(x[:inside].reshape(-1, WIDTH), axis=1) for x in powers)
    # What is passed on by several signals is a product: of 1e-300 twice nothing is left to divide by.
    return np.repeat(np.clip(a / np.maximum(b, 1e-300), 1e-30, 1.0), WIDTH)


def flattened(part: Part, signal: Array, joint: int) -> Array:
    """Return a torque with the phases of a signal, (m,), and of the spectrum that whitening makes flat."""
    spectrum, gain = fft.rfft(signal), part.whitener[joint]
    size = np.zeros(len(spectrum))
    size[: len(gain)] = np.divide(1.0, gain, out=np.zeros_like(gain), where=gain > 1e-3 * gain.max())
    return np.asarray(fft.irfft(spectrum / np.maximum(np.abs(spectrum), 1e-300) * size, len(signal)))


def by_block(state: State, other: State) -> Array:
    """Return by how much a model's log likelihood is above another's in each block, (blocks,).

    ``Σ_j (r'_j² - r_j²)/2 φ_j``, both residuals over the noise as their drives pass it on.
    """
    known = dispersion(state)
    size, than = (np.sqrt(dispersion(one) / known) for one in (state, other))
    count = len(state.fit.residual) // len(known)
    difference = (np.tile(than, count) * other.fit.residual) ** 2 - (np.tile(size, count) * state.fit.residual) ** 2
    return state.fit.by_block(difference[:, None])[:, 0] / 2


def vuong(blocks: Array) -> float:
    """``Σ_b d_b/(√B std d_b)``, in deviations, of what each block tells of two models, (blocks,)."""
    return float(blocks.sum() / max(np.sqrt(len(blocks)) * blocks.std(ddof=1), 1e-12))
