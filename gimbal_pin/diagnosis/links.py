"""A link that swings behind a spring, unseen by its encoder: where it is, and what every joint feels of that.

A spring on the rigid model at the encoder's angle leaves out that the link is somewhere else: there its weight pulls
another way, its inertia is another, and its acceleration pushes the other joints (Spong, J. Dyn. Sys. Meas. Control
109, 1987). Here the rigid model is taken at the link's own motion, for fit and held-out part alike.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy import fft, linalg, signal

from gimbal_pin.diagnosis.evidence import Part
from gimbal_pin.effects.signal import Memory
from gimbal_pin.effects.sprung import Sprung
from gimbal_pin.log import Array
from gimbal_pin.regressor import inertia, rnea
from gimbal_pin.rig import PHI, Rig

PASSES = 8
"""Most rounds in which a link's motion settles: its weight and its inertia depend on where it is."""
SETTLED = 3e-3
"""Change of its angle, as a share, under which it has."""
ROUNDS = 2
"""Rounds in which how it swings since a log began is found."""
WEIGHTLESS = 1e-12
"""Mass of a body that has but an inertia, kg: one of no mass has no centre."""
FARTHEST = 1.0
"""Angle by which no link stands off its motor, rad: a motion farther than that is no solution."""


class Swing(NamedTuple):
    """How far a link is from its encoder's angle, rad, its rate and acceleration, (m,) each."""

    q: Array
    v: Array
    a: Array


def swing(rig: Rig, part: Part, spring: Sprung, even: Sprung, own: float, free: Swing, about: Swing) -> Swing | None:
    """``I x'' + d x' + k x (1 + h (k x)²) = -(τ_link(q + x) - I x'')``, by turns: x moves the link, and what it asks.

    What a spring that hardens holds beyond an even one stands beside what the link asks for, by Newton's rule.

    Args:
        rig: The rig with its inertias, the rotor's within the link's.
        part: The log.
        spring: The spring, ``k = r (1 - r) M ω²`` and ``d = 2 ζ r (1 - r) M ω`` for a mean inertia M.
        even: A linear spring that is near it.
        own: M, kg m².
        free: How the link swings by itself since the log began; but for that it was at rest before.
        about: A motion that is near.

    Returns:
        The motion; None where it has none within `FARTHEST`.
    """
    c, j, k, stiff = part.channels, rig.joint_index(spring.joint), spring.stiffness(own), even.stiffness(own)
    rotor, link = spring.rotor_share * own, (1 - spring.rotor_share) * own
    x, rest = about, float(spring.soft(rotor * c.a[:1, j] - moved(rig, part, j)[:1, j])[0]) / k

    def given(push: Array) -> Swing:
        y = driven(part, even, own, push - stiff * rest)
        return Swing(y.q + rest + free.q, y.v + free.v, y.a + free.a)

    for _ in range(PASSES):
        push = link * x.a - moved(rig, part, j, x)[:, j] + rotor * (c.a[:, j] + x.a)
        if spring.hardening:
            push += stiff * x.q - k * x.q * (1 + spring.grown(k * x.q))
            less = stiff - spring.slope(k * x.q) * k
            way = followed(part, even, less / stiff, given(push).q - x.q)
            if not np.max(np.abs(way)) < FARTHEST:
                return None
            push += less * way
        before, x = x, given(push)
        if not np.max(np.abs(x.q)) < FARTHEST:
            return None
        if np.linalg.norm(x.q - before.q) <= SETTLED * np.linalg.norm(x.q):
            break
    return x


def driven(part: Part, spring: Sprung, own: float, push: Array) -> Swing:
    """``I x'' + d x' + k x = push``, N m, (m,), of a link on a linear spring, its motor held; at rest before."""
    r, w = spring.rotor_share, 2 * np.pi * spring.frequency
    count = fft.next_fast_len(2 * len(push), real=True)
    s = 2j * np.pi * fft.rfftfreq(count, part.dt)
    spectrum = fft.rfft(push, count) / ((1 - r) * own * (s * s + 2 * spring.damping * r * w * s + r * w * w))
    return Swing(*(fft.irfft(spectrum * s**n, count)[: len(push)] for n in range(3)))


def bent(part: Part, spring: Sprung, even: Sprung, own: float, x: Swing, way: Swing) -> Swing:
    """A small motion on an even spring as it is on one that hardens, beside a motion x."""
    if not spring.hardening:
        return way
    k, stiff = spring.stiffness(own), even.stiffness(own)
    less = stiff - spring.slope(k * x.q) * k
    more = driven(part, even, own, less * followed(part, even, less / stiff, way.q))
    return Swing(*(y + z for y, z in zip(way, more)))


def stepped(part: Part, spring: Sprung, push: Array, k: float, free: Swing) -> Swing:
    """A link's motion by what pushes it where its encoder is, N m, (m,), from how it swings at first."""
    held, memory = spring.held, (float(spring.soft(push[:1])[0] + k * free.q[0]), float(k * free.v[0]))
    memories: list[Memory] = [memory]
    for x in push[:-1].tolist():
        memories.append(held.step(memories[-1], x, part.dt)[0])
    z, rate = np.array(memories).T / k
    return Swing(z, rate, np.gradient(rate, part.dt))


def followed(part: Part, even: Sprung, softer: Array, step: Array) -> Array:
    """``δ = step + N (softer δ)``, (m,): the step of an angle that a spring's stiffness, which is not even, leads to.

    N, the link on its even spring, per unit of its stiffness, is taken sample by sample: by its poles, the mean of
    three samples and what it gives at rest.
    """
    pole = poles(even)
    one, two = -2 * np.exp(pole.real * part.dt) * np.cos(pole.imag * part.dt), np.exp(2 * pole.real * part.dt)
    mean = (1 + one + two) / 4 * np.array([1.0, 2.0, 1.0])
    bands = np.array([1.0, one, two])[:, None] - mean[:, None] * softer
    right = signal.lfilter([1.0, one, two], [1.0], step)
    return np.asarray(linalg.lapack.dtbtrs(bands, right, uplo="L")[0])


def moved(rig: Rig, part: Part, joint: int, x: Swing | None = None) -> Array:
    """Torque that the rigid rig asks for with one joint's link moved on, N m, (m, n); None: it is not."""
    c = part.channels
    return rnea(rig, *(carried(part, joint, x) if x else (c.q, c.v, c.a)), part.platform)


def carried(part: Part, joint: int, x: Swing) -> tuple[Array, Array, Array]:
    """Angles, rates and accelerations with one joint's link moved on, (m, n) each."""
    c = part.channels
    out = c.q.copy(), c.v.copy(), c.a.copy()
    for values, more in zip(out, x):
        values[:, joint] += more
    return out


def ringing(part: Part, spring: Sprung) -> list[Swing]:
    """The two ways in which the link swings by itself, its motor held: ``Re e^(pt)`` and ``Im e^(pt)``."""
    pole = poles(spring)
    free = [pole**k * np.exp(pole * part.dt * np.arange(len(part.gate))) for k in range(3)]
    return [Swing(*(x.real for x in free)), Swing(*(x.imag for x in free))]


def poles(spring: Sprung) -> complex:
    """One of the two ``p`` of ``p² + 2 ζ r ω p + r ω² = 0``: the link on a linear spring, its motor held."""
    r, w = spring.rotor_share, 2 * np.pi * spring.frequency
    return complex(np.roots([1.0, 2 * spring.damping * r * w, r * w * w])[0])


class Link(NamedTuple):
    """A link that swings where it is.

    Attributes:
        motion: How far it is from its encoder's angle.
        asked: What that asks of every joint beyond the rigid rig at the encoder's angle, N m, (m, n).
        ways: The same of each way in which it may swing by itself, per unit, (m, n, 2).
        soft: What its spring's soft part holds, N m, (m,).
    """

    motion: Swing
    asked: Array
    ways: Array
    soft: Array


def swung(rig: Rig, part: Part, spring: Sprung, begun: Array, about: Swing | None = None) -> Link | None:
    """Work out a link's motion and what it asks of all joints; None where it has none within `FARTHEST`.

    Args:
        rig: The rig with its inertias.
        part: The log.
        spring: The spring.
        begun: How much it swings in each of its own ways since the log began, (2,).
        about: A motion that is near: from there it settles sooner.
    """
    j = rig.joint_index(spring.joint)
    mass = inertia(rig, part.channels.q, j)
    own = float(np.mean(mass[:, j]))
    if not own > 0:
        return None
    rotor, k, still = spring.rotor_share * own, spring.stiffness(own), moved(rig, part, j)
    push = rotor * part.channels.a[:, j] - still[:, j]
    even = spring.even(k * about.q if about else spring.soft(push))
    ways = ringing(part, even)
    free = Swing(*(x * begun[0] + y * begun[1] for x, y in zip(*ways)))
    x = None if about is None and spring.hardening else swing(rig, part, spring, even, own, free, about or free)
    if x is None and spring.hardening:
        x = swing(rig, part, spring, even, own, free, stepped(part, spring, push, k, free))
    if x is None:
        return None
    ways = [bent(part, spring, even, own, x, way) for way in ways]
    stays = rotor * axes(rig, part.channels.q, j)
    mass -= stays
    asked = moved(rig, part, j, x) - still - stays * x.a[:, None]
    return Link(x, asked, np.stack([mass * way.a[:, None] for way in ways], axis=2), k * x.q)


def axes(rig: Rig, q: Array, joint: int) -> Array:
    """``z_i · z_j``, (m, n), of a joint and those that carry it: what a round rotor there, not geared, asks of all."""
    phi = np.zeros_like(rig.phi)
    phi[:: len(PHI)] = WEIGHTLESS
    phi[[10 * joint + PHI.index(symbol) for symbol in ("Ixx", "Iyy", "Izz")]] = 1.0
    return inertia(rig.with_phi(phi), q, joint)


def begun(rig: Rig, part: Part, spring: Sprung, left: Array) -> Link | None:
    """Work out a link's motion from what is left of its joint's torque, N m, (m,), beside the rigid rig and all else.

    How the link swings when the log begins is what explains most of that.
    """
    j, sizes = rig.joint_index(spring.joint), np.zeros(2)
    sure = ~part.still[:, j] & (part.gate[:, j] > 0)
    for _ in range(ROUNDS):
        link = swung(rig, part, spring, sizes)
        if link is None or not np.any(sure):
            return link
        sizes = sizes + np.linalg.lstsq(link.ways[sure, j], (left - link.asked[:, j])[sure], rcond=1e-10)[0]
    return swung(rig, part, spring, sizes)
