"""Work on untrusted files in a process of its own, which has bounds and may fail.

Their libraries are not made for that: a few kilobytes can end one in C code, keep it busy for minutes, fill the memory,
or raise one of dozens of kinds of error.
"""

from __future__ import annotations

import json
import os
import re
import resource
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any


class ProcessStopped(Exception):
    """The process failed, or took more than it may; its text says why."""


def run_bounded(
    module: str, *arguments: str, memory: int = 2 * 2**30, seconds: float = 6, patience: float | None = None
) -> Any:
    """Return ``main(*arguments)`` of a module, run in a process of its own; it is what JSON holds.

    Args:
        module: Full name of the module.
        arguments: What its ``main`` takes.
        memory: Address space, bytes, of it and of each process that it forks.
        seconds: Processor time, s, of each. A rig of 30 meshes of 1 MB takes 0.4 GB and 2 s in MuJoCo; no verb works
            for over 10 s on a small file.
        patience: Longest wait, s; None: twice `seconds`.

    Raises:
        Stopped: It raised an error, ended, or took more than it may.
    """
    patience = 2 * seconds if patience is None else patience
    bounds = (str(memory), str(max(1, int(seconds))))
    # The path of this process and no other: else a module in the working directory would be run.
    code = f"import sys; sys.path[:] = {sys.path!r}; from gimbal_pin.rig.bounded import main; main(*sys.argv[1:])"
    alone = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}  # each thread's stack is memory, too
    with TemporaryDirectory() as folder:
        out = Path(folder, "out.json")
        command = [sys.executable, "-c", code, str(out), *bounds, module, *arguments]
        try:
            done = subprocess.run(
                command, env=alone, stdin=subprocess.DEVNULL, capture_output=True, timeout=patience, check=False
            )
        except subprocess.TimeoutExpired as error:
            raise ProcessStopped(f"it takes over {patience:.0f} s") from error
        if done.returncode:
            lines = done.stderr.decode(errors="replace").strip().splitlines() or ["its reader was stopped"]
            without_kinds_of_errors = re.sub(r"^(\w+\.)*\w+: |<class '[^']*'>: ", "", lines[-1])
            raise ProcessStopped(without_kinds_of_errors[:160])
        return json.loads(out.read_text("utf-8"))


def main(out: str, memory: str, seconds: str, module: str, *arguments: str) -> None:
    """Write what a module's ``main`` returns as JSON."""
    bounds = ((resource.RLIMIT_AS, int(memory)), (resource.RLIMIT_CPU, int(seconds)), (resource.RLIMIT_CORE, 0))
    for what, bound in bounds:
        resource.setrlimit(what, (bound, bound))
    Path(out).write_text(json.dumps(import_module(module).main(*arguments)), "utf-8")
