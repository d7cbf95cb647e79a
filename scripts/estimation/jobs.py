"""Jobs over processes, with a progress bar, and a file from which an interrupted run goes on."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

from tqdm import tqdm

CORES = min(2, os.cpu_count() or 1)


def results(
    work: Callable[[int], dict[str, Any]], seeds: Sequence[int], workers: int, resume: Path | None
) -> list[dict[str, Any]]:
    """Return what `work` gives for every seed; each is written to `resume` as one line of JSON as soon as it is done.

    Args:
        work: Seed → plain values.
        seeds: Seeds.
        workers: Processes.
        resume: Lines of an earlier run with the same options; its seeds are not run again.
    """
    known = {} if resume is None else dict(read(resume))
    missing = [seed for seed in seeds if seed not in known]
    with ProcessPoolExecutor(workers) as pool:
        futures = {pool.submit(work, seed): seed for seed in missing}
        for future in tqdm(as_completed(futures), total=len(missing), unit="log", disable=None):
            seed = futures[future]
            known[seed] = future.result()
            if resume is not None:
                with resume.open("a", encoding="utf-8") as file:
                    file.write(json.dumps({"seed": seed, **known[seed]}) + "\n")
    return [known[seed] for seed in seeds]


def read(path: Path) -> Iterator[tuple[int, dict[str, Any]]]:
    """Yield seed and values of every whole line."""
    if path.is_file():
        for line in path.read_text(encoding="utf-8").splitlines():
            if line.endswith("}"):
                values = json.loads(line)
                yield values.pop("seed"), values
