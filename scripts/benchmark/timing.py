"""Wall-clock times of several ways to do the same work, taken in turns so that a busy machine disturbs all alike."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from statistics import median
from time import perf_counter, process_time

from tqdm import tqdm


@dataclass(frozen=True)
class Times:
    """Times of each way, s, one per round."""

    taken: Mapping[str, Sequence[float]]

    def median(self, way: str) -> float:
        """Median time of a way, s."""
        return median(self.taken[way])

    def ratio(self, way: str, other: str) -> float | None:
        """Median over the rounds of the time of `way` over that of `other`; None if `other` was not run."""
        return (
            median(a / b for a, b in zip(self.taken[way], self.taken[other]))
            if other in self.taken
            else None
        )


def alternating(ways: Mapping[str, Callable[[], object]], rounds: int, what: str) -> Times:
    """Time every way once a round."""
    taken: dict[str, list[float]] = {name: [] for name in ways}
    turns = [name for _ in range(rounds) for name in ways]
    for name in tqdm(turns, what, disable=None, leave=False):
        begin = perf_counter()
        ways[name]()
        taken[name].append(perf_counter() - begin)
    return Times(taken)


def wall_and_cpu(work: Callable[[], object], rounds: int, what: str) -> tuple[float, float]:
    """Median time and median processor time of some rounds of one piece of work, s: apart where a machine is busy."""
    taken = []
    for _ in tqdm(range(rounds), what, disable=None, leave=False):
        wall = perf_counter()
        cpu = process_time()
        work()
        taken.append((perf_counter() - wall, process_time() - cpu))
    return median(wall for wall, _ in taken), median(cpu for _, cpu in taken)
