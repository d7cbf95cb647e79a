"""Dry friction with true stick, solved for all joints at once."""

from __future__ import annotations

from operator import mul

TOLERANCE = 1e-13
ROUNDS = 200


def dry_friction(
    free,
    inverse,
    dofs,
    limits,
    dt,
    friction,
):
    """f in [-minus, plus] with f = plus where v⁺ > 0, f = -minus where v⁺ < 0, and v⁺ = 0 wherever f lies between.

    v⁺ = free - dt M⁻¹ f. Projected Gauss–Seidel over the joints (Moreau, time-stepping). `free`, `inverse` (M⁻¹) and
    `friction` (the last step's, which is changed and returned; zero where there is none) run over all degrees of
    freedom; limits (plus, minus; N m) over the joints, which sit on `dofs`."""
    plus, minus = limits
    for _ in range(ROUNDS):
        change = 0.0
        for i, dof in enumerate(dofs):
            weights = inverse[dof]
            held = friction[dof]
            wanted = held + (free[dof] / dt - sum(map(mul, weights, friction))) / weights[dof]
            if wanted > plus[i]:
                wanted = plus[i]
            elif wanted < -minus[i]:
                wanted = -minus[i]
            friction[dof] = wanted
            change += abs(wanted - held)
        if change < TOLERANCE:
            break
    return friction
