"""Constants that decide what a diagnosis says."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Settings:
    """Every number that can change a verdict.

    The numbers without another source were chosen on development logs, `scripts/blind compare` prints what a change
    of one wins and loses there.

    Attributes:
        band_hz: Highest frequency that is looked at, Hz. Drives and teeth show above 5 Hz; inertial torque is weak
            above 12 Hz on rigs of some kilograms. Doubled while lines above it hold more power than all below it.
        smoothing: Cutoff of the smoother before differentiation, in bands: it passes .97 of the band's amplitude.
        block_seconds: Shortest block that is left out at a time, s: several correlation times of a noise of 1 Hz.
        folds: Number of blocks of a long log that are left out in turn. Twice as many halve the error of the standard
            error and double the time.
        outer_share: Every so manieth block of a long log serves for nothing but the figures that are shown.
        long_seconds: Length of a log, s, from which outer blocks are kept.
        sign_deviations: Deviations of its noise that a rate must have for its sign to count: at 4 one in 30 000 is
            wrong.
        mask_share: Share of the samples that the mask near standstill may take before it gives way to one of
            `slow_sign_deviations`.
        slow_sign_deviations: The same of that mask: one sign in 44 is wrong.
        gain_deviations: Standard errors that a gain must have, as the quantile of a normal distribution; Student's
            quantile of the same probability is used.
        gain_nats: Gain that a cause must have beyond its prior, nats: odds of 400 to 1.
        kept_nats: The same of a cause beside all others, at the end: it has passed `gain_nats` once.
        material_share: Least torque that a cause must explain, as a share of its joint's rms torque.
        harmonic_share: The same of a further harmonic, in `material_share`.
        form_error: Error of form of every model, as a share of the predicted torque; part of the noise.
        cause_form_error: Error of form of an accepted cause, as a share of what it explains: a further cause at the
            joint must exceed it, and no other function of the cause's own variable may.
        unwhitened_share: Share of its least torque by which a cause must lower the unwhitened held-out error.
        name_share: Share of the predictable error that a cause must explain to be named. .80 to .90 gave equal counts.
        rival_probability: Probability from which a rival is part of a finding's class.
        unknown_share: Share of what is left, rms, that must be predictable to be called unknown.
        open_share: Share of a joint's torque, rms, from which what is left is called unknown whatever predicts it.
        burst_seconds: Length of the windows in which bursts are looked for, s: some periods of the band.
        burst_power: Power of such a window over what the motion lets expect, from which it is a burst.
        burst_share: Share of the rest's rms that bursts must hold to be called unknown.
        shift_seconds: Time between a joint's torque and its motion that is a finding, s: channels of one logger may
            be a few milliseconds apart.
        shift_apart_seconds: The same against the median of three or more joints, s.
        prior_width: Prior deviation of a base parameter from the URDF's, in its own size.
        trusted_width: The same with ``inertia: trusted``.
        shift_prior_seconds: Prior deviation of the time between torque and motion, s.
        most_causes: Most causes beside bias and armature.
        noise_candidates: Number of candidates that the noise estimate may use.
        tilt_share: Share of the held-out squared error that another direction of gravity must remove
            before the search with it is compared with the search without.
        stale_torque: Change of a joint's predicted torque, as a share, from which columns that read it are rebuilt.
    """

    band_hz: float = 12.0
    smoothing: float = 2.5
    block_seconds: float = 1.0
    folds: int = 20
    outer_share: int = 5
    long_seconds: float = 25.0
    sign_deviations: float = 4.0
    mask_share: float = 0.6
    slow_sign_deviations: float = 2.0
    gain_deviations: float = 2.0
    gain_nats: float = 6.0
    kept_nats: float = 3.0
    material_share: float = 0.01
    harmonic_share: float = 0.2
    form_error: float = 0.01
    cause_form_error: float = 0.17
    unwhitened_share: float = 0.5
    name_share: float = 0.85
    rival_probability: float = 0.05
    unknown_share: float = 0.5
    open_share: float = 0.5
    burst_seconds: float = 0.25
    burst_power: float = 6.0
    burst_share: float = 0.6
    shift_seconds: float = 4.5e-3
    shift_apart_seconds: float = 1.5e-3
    prior_width: float = 2.0
    trusted_width: float = 0.02
    shift_prior_seconds: float = 0.01
    most_causes: int = 10
    noise_candidates: int = 60
    tilt_share: float = 0.4
    stale_torque: float = 1e-3


SETTINGS = Settings()
"""Settings of every diagnosis."""
