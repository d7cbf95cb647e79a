"""Work on untrusted files in a process of its own, which has bounds and may fail.

Their libraries are not made for that: a few kilobytes can end one in C code, keep it busy for minutes, fill the memory,
or raise one of dozens of kinds of error.
"""

from __future__ import annotations

import json
import os
import re
import resource
import signal
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

_LONGEST_WAIT = 900.0
"""Time on the clock, s, after which a process that uses no processor time is ended: it waits for something that never
comes. A busy machine gives a process a small share of its time, so the clock measures nothing else; doubling it only
lengthens the wait for a process that hangs."""


class ProcessStopped(Exception):
    """The process failed, or took more than it may; its text says why."""


def run_bounded(module: str, *arguments: str, memory: int = 2 * 2**30, seconds: float = 6) -> Any:
    """Return ``main(*arguments)`` of a module, run in a process of its own; it is what JSON holds.

    Args:
        module: Full name of the module.
        arguments: What its ``main`` takes.
        memory: Address space, bytes, of it and of each process that it forks.
        seconds: Processor time, s, of each; time for which other processes keep the machine busy does not count. A rig
            of 30 meshes of 1 MB takes 0.4 GB and 2 s in MuJoCo.

    Raises:
        ProcessStopped: It raised an error, ended, or took more than it may.
    """
    limit = max(1, int(seconds))
    bounds = (str(memory), str(limit))
    # The path of this process and no other: else a module in the working directory would be run.
    code = f"import sys; sys.path[:] = {sys.path!r}; from gimbal_pin.rig.bounded import main; main(*sys.argv[1:])"
    alone = {
        **os.environ,
        "OPENBLAS_NUM_THREADS": "1",
        "OMP_NUM_THREADS": "1",
    }  # each thread's stack is memory, too
    with TemporaryDirectory() as folder:
        out = Path(folder, "out.json")
        command = [sys.executable, "-c", code, str(out), *bounds, module, *arguments]
        try:
            done = subprocess.run(
                command,
                env=alone,
                stdin=subprocess.DEVNULL,
                capture_output=True,
                timeout=_LONGEST_WAIT,
                check=False,
            )
        except subprocess.TimeoutExpired as error:
            raise ProcessStopped(f"it has not ended after {_LONGEST_WAIT:.0f} s") from error
        if done.returncode == -signal.SIGXCPU:
            raise ProcessStopped(f"it takes over {limit} s of processor time")
        if done.returncode:
            lines = done.stderr.decode(errors="replace").strip().splitlines() or [
                "its reader was stopped"
            ]
            without_kinds_of_errors = re.sub(r"^(\w+\.)*\w+: |<class '[^']*'>: ", "", lines[-1])
            raise ProcessStopped(without_kinds_of_errors[:160])
        return json.loads(out.read_text("utf-8"))


def main(out: str, memory: str, seconds: str, module: str, *arguments: str) -> None:
    """Write what a module's ``main`` returns as JSON."""
    resource.setrlimit(resource.RLIMIT_AS, (int(memory), int(memory)))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    # At the soft limit the process gets SIGXCPU, which tells the caller why it ended; at the hard one it is killed.
    resource.setrlimit(resource.RLIMIT_CPU, (int(seconds), int(seconds) + 1))
    Path(out).write_text(json.dumps(import_module(module).main(*arguments)), "utf-8")
