"""What `gimbal-pin fleet` finds: a fleet is simulated with units that are off in one parameter, and compared.

    scripts/fleet --units 1000 --odd 5    units of a bundled rig, each with a simulated log: identified and compared
    scripts/fleet --rates 20              share found of 4, 5 and 7 deviations, in as many fleets of drawn estimates

Units differ by their friction and their bodies' inertials, which are drawn anew for each. An odd unit has one joint's
friction or the camera body's inertials off by as many of these spreads.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

import gimbal_pin as gp
from gimbal_pin.fleet import Run, compare_units, run_units
from gimbal_pin.fleet.variation import Variation, Vary

FRICTION, INERTIALS = 0.1, 0.03
"""Spreads of the fleet, shares of the rig's own values."""
SECONDS = 5.0
"""Length of a log."""
PARAMETERS, ERROR = 15, 0.3
"""Of the drawn fleets: parameters of a unit, and the deviation of their estimates in spreads."""


@dataclass(frozen=True)
class Simulated:
    """Simulates a unit's log on one motion, and writes it."""

    rig: gp.Rig
    motion: object
    folder: str
    odd: dict[int, tuple[str, float]]
    seed: int

    def __call__(self, number: int) -> dict[str, float | str]:
        """Write the log of the unit of that number; an odd one has a further share on one of its inputs."""
        rng = np.random.default_rng([self.seed, number])
        variation = Variation(gp.nominal(self.rig), Vary(0.0, ("normal", 0, INERTIALS), ("normal", 0, FRICTION)))
        values = variation.values(rng.random(len(variation.inputs)).tolist())
        name, by = self.odd.get(number, ("", 0.0))
        if name:
            values[name] += by
        log = gp.bench_run(
            variation.body(values), rng=rng, seconds=SECONDS, reference=self.motion, name=name_unit(number)
        )
        gp.write_log(log, f"{self.folder}/{name_unit(number)}.parquet")
        return {}


def compare_simulated(name: str, units: int, odd: int, deviations: float, seed: int, workers: int) -> None:
    """Simulate a fleet, compare it through the public call, and print who is found."""
    rng, rig = np.random.default_rng(seed), gp.Rig.load(name)
    motion = gp.excite(rig, seconds=SECONDS, starts=1, rng=rng).motion
    planted = choose_odd(rig, units, odd, deviations, rng)
    with TemporaryDirectory(prefix="fleet-") as place:
        logs = Path(place) / "logs"
        logs.mkdir()
        work = Simulated(rig, motion, str(logs), planted, seed)
        run_units(Run(work, range(units), f"{place}/simulated"), workers=workers)
        found = gp.compare_fleet(logs, rig=rig, folder=f"{place}/compared", quick=True, workers=workers, quiet=False)
    called = {unit.unit: unit.deviations[0] for unit in found.units if unit.deviations}
    for number, (what, by) in planted.items():
        own = called.get(name_unit(number))
        shown = "is not found" if own is None else f"{own.parameter} by {own.score:.1f} standard deviations"
        sys.stdout.write(f"{name_unit(number)}: {what} {100 * by:+.0f} %: {shown}\n")
    errors = {
        own.name: float(found.table[f"std.{own.name}"].median()) / (own.spread or np.nan) for own in found.population
    }
    sys.stdout.write("errors in spreads: " + ", ".join(f"{key} {x:.2g}" for key, x in errors.items()) + "\n")
    hits = len(called.keys() & {name_unit(number) for number in planted})
    false = len(called) - hits
    sys.stdout.write(f"{hits} of {odd} found, {false} of {units - odd} called by mistake, {found.failed} logs failed\n")


def name_unit(number: int) -> str:
    """Name of a unit, and of its log without suffix."""
    return f"unit-{number:05d}"


def choose_odd(
    rig: gp.Rig, units: int, count: int, deviations: float, rng: np.random.Generator
) -> dict[int, tuple[str, float]]:
    """Return which units are off, in what, and by how much."""
    inputs = [*(f"friction.{joint}" for joint in rig.joints), f"inertials.{rig.links[rig.n - 1]}"]
    places = rng.choice(units, count, replace=False).tolist()
    names = [inputs[k % len(inputs)] for k in range(count)]
    return {k: (name, deviations * (FRICTION if name[0] == "f" else INERTIALS)) for k, name in zip(places, names)}


def print_rates(fleets: int, rng: np.random.Generator) -> None:
    """Print how many of five units that are off are found among 1 000, by drawn estimates."""
    names, units = [f"p{k}" for k in range(PARAMETERS)], [f"{k:04d}" for k in range(1000)]
    for deviations in (4, 5, 7):
        hits, false = 0, 0
        for _ in range(fleets):
            values = rng.normal(size=(1000, PARAMETERS))
            odd = rng.choice(1000, 5, replace=False)
            values[odd, rng.integers(PARAMETERS, size=5)] += deviations * rng.choice([-1, 1], 5)
            values += ERROR * rng.normal(size=values.shape)
            found = compare_units(names, values, np.full(values.shape, ERROR), units, np.zeros(1000)).deviations
            called = {int(own.unit) for own in found}
            hits, false = hits + len(called & set(odd.tolist())), false + len(called - set(odd.tolist()))
        sys.stdout.write(
            f"{deviations} deviations: {hits} of {5 * fleets} found, {false} of {995 * fleets} called by mistake\n"
        )
        sys.stdout.flush()


def main() -> None:
    """Compare a simulated fleet, or print rates of detection."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rig", default="turret")
    parser.add_argument("--units", type=int, default=1000)
    parser.add_argument("--odd", type=int, default=5)
    parser.add_argument("--deviations", type=float, default=7.0)
    parser.add_argument("--rates", type=int, default=0, metavar="FLEETS")
    parser.add_argument("--workers", type=int, default=0)
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    if asked.rates:
        print_rates(asked.rates, np.random.default_rng(asked.seed))
    else:
        compare_simulated(asked.rig, asked.units, asked.odd, asked.deviations, asked.seed, asked.workers)


if __name__ == "__main__":
    main()
