"""One rig, one motion, one controller, one set of sensors: the stage on which effects are hidden and tried out, and
made as strong as wanted."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import exp, log

import numpy as np

from .control import closed_loop, mass_matrix
from .effects.base import Context
from .excitation import Reference
from .ledger import settle
from .plant import PlantDivergedError, simulate
from .rigs import Array, Rig
from .rnea import inverse_dynamics
from .sensors import DriveSensors, Sensors
from .visibility import blocks, rms, smooth
from .world import World

FINE_STEP = 0.25e-3
TRIAL_STEP = 1e-3
STIFF_TRIAL_STEP = 0.5e-3
"""Longest steps, s."""
TRIALS = 6
CLOSE_ENOUGH = 0.15
LONGEST_LEAP = log(100.0)
LARGEST = log(1e6)


@dataclass(frozen=True)
class Scene:
    """Everything but the effect. `rate`: the controller's samples a second; `noise_seed`: the sensors' noise, the same
    in every run; `still`: joints that are held; `every`: so manieth sample is logged; `step`: longest step of the final
    run, s."""

    rig: Rig
    reference: Reference
    kp: Array
    kd: Array
    forward: Array
    sensors: Sensors | DriveSensors
    rate: float
    noise_seed: int
    still: tuple[int, ...] = ()
    every: int = 1
    step: float = FINE_STEP

    @property
    def seconds(self):
        """Length of the run, s."""
        return len(self.reference.t) / self.rate

    def run(self, effects, longest):
        """Simulate the closed loop with these effects, at no longer steps (s)."""
        substeps = int(np.ceil(1.0 / (self.rate * longest) - 1e-9))
        world = World(self.rig, effects, 1.0 / (self.rate * substeps), self.seconds)
        samples = len(self.reference.t)
        seen = self.sensors.reader(world, samples, np.random.default_rng(self.noise_seed))
        controller = closed_loop(world.rig, self.reference, self.kp, self.kd, self.forward, seen)
        begin = self.reference.q[0].tolist(), self.reference.dq[0].tolist()
        return world, simulate(world, controller, begin, samples, substeps)

    def first(self, seconds):
        """The same scene, not longer than this (s): effects are made as strong as wanted on it."""
        return replace(self, reference=self.reference.every(slice(round(seconds * self.rate))))

    def context(self, joint, share):
        """What an effect's first guess is made from, by the reference alone."""
        few = self.reference.every(slice(None, None, 5))
        rigid = inverse_dynamics(self.rig, few.q, few.dq, few.ddq)
        friction = self.rig.coulomb * np.tanh(few.dq / 0.01)
        tau = (rigid + friction + self.rig.viscous * few.dq)[:, joint]
        q = few.q[:, joint]
        return Context(
            rig=self.rig,
            joint=joint,
            share=share,
            torque=float(rms(tau)),
            inertia=float(mass_matrix(self.rig, few.q.mean(axis=0))[joint, joint]),
            speed=float(rms(few.dq[:, joint])),
            lean=1.0 if tau.mean() > 0.0 else -1.0,
            span=(float(q.min()), float(q.max())),
            seconds=self.seconds,
        )

    def gravity(self):
        """Gravity torque rms along the reference, N m, (n,)."""
        q = self.reference.q[::20]
        return rms(inverse_dynamics(self.rig, q, 0.0 * q, 0.0 * q))


def share_of(effect, ledger, rate):
    """Effect rms over torque rms on the effect's own joint, or the largest share where it has none."""
    size = rms(smooth(blocks(ledger.effect, rate), rate)) if effect.in_band else rms(ledger.effect)
    each = size / np.maximum(rms(ledger.command), 1e-9)
    return float(each.max() if effect.joint is None else each[effect.joint])


def trial(scene, effect):
    """A run at coarse steps with this effect alone."""
    world, trace = scene.run([effect], STIFF_TRIAL_STEP if effect.stiff else TRIAL_STEP)
    return world, settle(world, trace)


def _next(k, error, tried, top):
    """Where to try next: between the nearest weaker and stronger trial, or a leap as the last slope says."""
    weaker = max((x for x, e in tried if e > 0.0), default=None)
    stronger = min((x for x, e in tried if e <= 0.0), default=top if top < LARGEST else None)
    if weaker is not None and stronger is not None and weaker < stronger:
        known = dict(tried)
        low = known[weaker]
        high = known.get(stronger, -1.0)
        return weaker + (stronger - weaker) * min(max(low / (low - high), 0.15), 0.85)
    slope = 1.0
    if len(tried) > 1 and abs(k - tried[-2][0]) > 1e-3:
        slope = min(max((tried[-2][1] - error) / (k - tried[-2][0]), 0.15), 3.0)
    return k + min(max(error / slope, -LONGEST_LEAP), LONGEST_LEAP)


def calibrate(scene, effect, wanted):
    """The effect scaled until its raw rms is about `wanted` of the torque rms, by a secant in the logarithm of its
    strength; the nearest found if it cannot be.

    Raises: PlantDivergedError when the loop runs away at every strength tried."""
    k = 0.0
    top = log(effect.widest)
    tried = []
    for _ in range(TRIALS):
        scaled = effect.scaled(exp(k))
        try:
            share = share_of(scaled, trial(scene, scaled)[1], scene.rate)
        except PlantDivergedError:
            top = k
            k = 0.5 * (k + tried[-1][0]) if tried else k - log(4.0)
            continue
        error = log(wanted / max(share, 1e-9))
        tried.append((k, error))
        following = min(_next(k, error, tried, top), top)
        if abs(error) < CLOSE_ENOUGH or abs(following - k) < 1e-3:
            break
        k = following
    if not tried:
        raise PlantDivergedError(f"{effect.cause}: no strength that this loop can hold")
    return effect.scaled(exp(min(tried, key=lambda pair: abs(pair[1]))[0]))
