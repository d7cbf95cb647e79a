"""Settings that decide what a diagnosis says."""

from __future__ import annotations

from dataclasses import dataclass
from math import exp


@dataclass(frozen=True)
class Settings:
    """Numbers that can change a verdict.

    Each paragraph gives meaning, unit, source, and what half and twice of the number would do. Numbers "chosen on the
    development logs" have no derivation: `scripts/blind compare` prints what a change of one wins and loses there.
    Shapes that are tried, their priors and numerical tolerances stand beside their use.

    Attributes:
        band_hz: Highest frequency that is looked at, Hz, where no lines above it call for more. Drives and teeth show
            above 5 Hz, and inertial torque is weak above 12 Hz on rigs of some kilograms. Half leaves half as many rows
            and hides what is faster than 6 Hz; twice adds as many rows, which mostly hold noise of the acceleration.
        smoothing: Cutoff of the smoother before differentiation, in bands. Derived: it passes .97 of the amplitude at
            the band's end. Half takes torque and acceleration away at the band's end; twice lets more noise into the
            acceleration.
        line_power: Power over the median around it from which a frequency is a line. Derived: white noise exceeds it
            with probability 2^-20. Half makes one frequency of noise in 1 000 a line, which may double the band; twice
            leaves the band as it is beside lines of up to 40 times the noise.
        block_seconds: Shortest block that is left out at a time, s. Derived: several correlation times of a noise of 1
            Hz. Half makes neighbouring blocks more alike, so that the standard errors are too small; twice leaves half
            as many folds of logs of up to 20 s.
        folds: Number of blocks of a long log that are left out in turn. Convention: a standard error from K folds is
            itself known to 1/√(2 K - 2), here to 16 %. Half makes that 24 % in half the time, twice 11 % in twice the
            time.
        min_folds: Fewest blocks of a short log. Convention: a deviation of fewer is hardly known, as Student's quantile
            says. Half asks of a gain in a short log 1.4 times the standard errors; twice makes its blocks as short as
            the noise's correlation.
        outer_every: Number of blocks of a long log of which one serves for the shown figures alone. Convention: a fifth
            of the data for the test. Half gives half of the log away; twice fits 90 % of it and shows figures that are
            1.4 times as uncertain.
        sign_deviations: Deviations of its noise that a rate must have for its sign to count. Derived: one sign in 30
            000 is wrong. At half one in 44 is wrong, which looks like other friction; twice leaves out rates twice as
            high.
        mask_share: Share of the samples that the mask of `sign_deviations` may take; where it takes more,
            `clear_deviations` decide. Chosen on the development logs. Half lets these decide in logs that are slow for
            30 % of the time; twice never does, and slow logs lose nearly all rows.
        clear_deviations: Standard errors from which a number is told from chance: of gains (as the same quantile of
            Student's distribution, over the number of joints), of times, of negative friction, of a joint's inertia,
            and of the sign of slow rates. Convention: one in 44. Half lets one in six be chance, twice one in 30 000.
        gain_nats: Gain that a cause must have with its log prior, nats. Convention: odds of 400 to 1. Half takes odds
            of 20 to 1, and 0.7 of a cause's size is enough, as the gain goes with its square; twice takes 160 000 to 1,
            and 1.4 of its size.
        kept_nats: Gain that a cause must have beside all others at the end, a further coefficient of its shape must
            have, and a rival must lack, nats; `rival_probability` follows. Convention: odds of 20 to 1. Half keeps
            causes and rules rivals out at odds of 4 to 1; twice at 400 to 1, and more findings are ambiguous.
        material_share: Share of a joint's torque, rms, that matters: a cause must explain it, and every model's error
            of form is taken to be as large. Also the share of power by which one other force must explain more than a
            finding. Convention: 1 %. Half states causes of half the torque, some of them errors of form; twice misses
            causes up to 2 %, and names those that leave 2 % of the power of a force.
        harmonic_share: Least torque of a further harmonic of an accepted cause, in `material_share`. Chosen on the
            development logs. Half adds harmonics of half the torque to a finding; twice leaves them in the rest, which
            then may be unknown.
        cause_form_error: Error of form of an accepted cause, as a share of the torque that it explains, rms. Further
            causes at the joint must exceed it where no free curve stands for that error: offsets, rotors, and what
            comes beside flexible joints and changes of bodies. Chosen on the development logs. Half states weaker
            ones, twice fewer.
        unwhitened_share: Share of its least torque by which a cause must lower the error before whitening. Chosen on
            the development logs. Half keeps causes whose gain lies at frequencies of little torque; twice asks for all
            of the least torque in the error itself.
        name_share: Share of the predictable error's power that a finding must explain to be named. Chosen on the
            development logs: .80 to .90 gave equal counts. Half names findings that leave more than half of the
            predictable error; twice names nothing.
        main_share: Share that makes a part the main one. What is left at a joint is unknown where a flexible model
            predicts this share of it, or where it is this share of the joint's torque, rms. A drive must have this
            share of the gain of the causes whose place it takes, and leave this share of the torque as it was, unless
            the joint's inertia is known to this share of itself. Convention: half. Half of it calls more unknown and
            takes drives that explain less; twice calls nothing unknown but bursts, and takes drives that explain all
            that causes do.
        burst_seconds: Length of the windows in which bursts are looked for, s. Derived: three periods of the band. Half
            finds shorter bursts, by power that is less sure; twice thins out bursts that are shorter than it.
        burst_power: Power of a window over what the motion lets expect, from which it is a burst. Chosen on the
            development logs. Half takes noise whose power varies threefold for bursts; twice only bursts of 12 times
            the power.
        burst_share: Share of the rest's rms that bursts must hold to be unknown. Chosen on the development logs. Half
            calls rests unknown of which bursts hold a tenth of the power; twice none.
        min_windows: Number of windows that must be exceeded to look for bursts. Derived: some four for each of the nine
            coefficients of the power that the motion lets expect, 10 s. Half judges logs of 5 s, by two windows for
            each coefficient; twice only logs of 20 s.
        shift_seconds: Time between a joint's torque and its motion that is a finding, s. Convention: channels of one
            logger may be a few milliseconds apart. Half states the loggers' own delays; twice misses delays up to 9 ms.
        shift_apart_seconds: The least such time where three or more joints are compared: that after their median, s.
            Chosen on the development logs. Half states smaller differences between the channels of one logger; twice
            misses delays of one joint up to 3 ms.
        shift_prior_seconds: Prior deviation of the time between torque and motion, s. Convention: one sample of a
            logger of 100 Hz. Half draws weakly shown times to zero with four times the precision, twice with a fourth.
        prior_width: Prior deviation of a base parameter from the URDF's, in its own size. Convention: a URDF may be
            wrong by its own numbers. Half lets bodies take up less of a short log, which causes then explain; twice
            lets them take up causes that look like bodies.
        trusted_width: Prior deviation in place of `prior_width` with ``inertia: trusted``. Convention: 2 % of what was
            weighed. Half states changes of bodies of half the size, twice only those of twice the size.
        min_size_share: Least size of a base parameter in the prior, as a share of the largest typical size of its kind.
            Chosen on the development logs: a URDF states many parameters as zero that are none. Half holds these closer
            to zero, twice lets them move as far again.
        min_left_share: Share of a column's power beside a model from which it is told from it, and from which the
            noise's regression may use it. Chosen on the development logs. Half tries columns that differ less, by gains
            that rest on rounding and noise; twice calls more causes untestable.
        max_causes: Number of causes up to which a search goes on, beside one bias and one rotor for each joint.
            Convention: it bounds the time of a search. Half stops at five, harmonics included; twice costs time where
            ten are reached.
        max_failures: Shapes of a cause at a place that may be clear and yet rejected before all of them are left out.
            Chosen on the development logs. Half gives a cause one shape less; twice two more, in as many more steps.
        max_drives: Number of drives at a joint behind which the whole search is repeated. Chosen on the development
            logs. Half takes the likeliest alone; twice compares four in twice the time.
        max_change_share: Change of a sample's torque, as a share of it, up to which a drive leaves it as it was. Chosen
            on the development logs. Half takes fewer drives on motions too slow to show the inertia; twice more, which
            may scale the torque instead.
        tilt_share: Share of the squared error that another direction of gravity must remove before any search, so that
            a search with it is made. Chosen on the development logs. Half makes more such searches; twice keeps the
            URDF's direction where another removes less than 80 %.
        small_turn_radians: Turn of gravity up to which the search finds it as a column, rad. Derived: a sine is .96 of
            its angle there. Half compares a second search for smaller turns; twice leaves turns of up to 1 rad to a
            column that is .84 of them.
        min_f_ratio: F ratio by which the rigid model and friction must explain a joint's torque. Convention: noise
            gives one, any rig hundreds. Half takes noise for a torque more often; twice refuses weak torques as noise.
        max_log_excess: Torque by which a log's own parameters move, over what its own fit leaves, up to which logs are
            of one rig; its inverse where causes have to explain a difference that was there before. Chosen on the
            development logs: less may be a misfit that the motions bring out differently. Half refuses more logs that a
            misfit sets apart, and fewer whose difference causes explain in part; twice the opposite.
        log_apart_share: Share of a log's torque, rms, that its own parameters move, from which the inverse of
            `max_log_excess` is the limit. Chosen on the development logs: by a quarter of the torque one rig does not
            differ. Half refuses logs that differ by an eighth; twice only those by half.
        min_log_rows: Rows per coefficient from which a log has a fit of its own. Convention: as many rows left as are
            fitted. Half compares logs that their own fits explain without error; twice leaves shorter logs uncompared.
        noise_candidates: Columns of candidates in the regression whose rest is the noise. Chosen on the development
            logs. Half takes more of a cause for noise, which hides weak causes; twice fits noise of short logs.
    """

    band_hz: float = 12.0
    smoothing: float = 2.5
    line_power: float = 20.0
    block_seconds: float = 1.0
    folds: int = 20
    min_folds: int = 4
    outer_every: int = 5
    sign_deviations: float = 4.0
    mask_share: float = 0.6
    clear_deviations: float = 2.0
    gain_nats: float = 6.0
    kept_nats: float = 3.0
    material_share: float = 0.01
    harmonic_share: float = 0.2
    cause_form_error: float = 0.17
    unwhitened_share: float = 0.5
    name_share: float = 0.85
    main_share: float = 0.5
    burst_seconds: float = 0.25
    burst_power: float = 6.0
    burst_share: float = 0.6
    min_windows: int = 40
    shift_seconds: float = 4.5e-3
    shift_apart_seconds: float = 1.5e-3
    shift_prior_seconds: float = 0.01
    prior_width: float = 2.0
    trusted_width: float = 0.02
    min_size_share: float = 0.03
    min_left_share: float = 3e-3
    max_causes: int = 10
    max_failures: int = 2
    max_drives: int = 2
    max_change_share: float = 0.1
    tilt_share: float = 0.4
    small_turn_radians: float = 0.5
    min_f_ratio: float = 5.0
    max_log_excess: float = 2.0
    log_apart_share: float = 0.25
    min_log_rows: float = 2.0
    noise_candidates: int = 60

    @property
    def rival_probability(self) -> float:
        """Probability above which a rival is not told from a finding: that of odds of `kept_nats` against it."""
        return exp(-self.kept_nats)

    @property
    def blocks(self) -> int:
        """Number of blocks of a log from which outer ones are kept."""
        return self.folds * self.outer_every // (self.outer_every - 1)


SETTINGS = Settings()
"""Settings of every diagnosis."""
