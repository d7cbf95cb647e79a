"""What an exported controller has to keep, on every bundled rig with every payload.

Torques within 1e-5 of the limit at 10 000 drawn states, following a reference and holding the camera; no warning of any
compiler that is here; 100 000 random and hostile states under the address and undefined-behaviour sanitizers; nothing
from cppcheck; a step under 20 µs; flash and stack on a Cortex-M4. The first rig has all causes that a controller makes
up for, and Lyapunov redesign.
"""

from __future__ import annotations

import argparse
import re
import shutil
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from tests.exported import (
    COMPILERS,
    EVERYTHING,
    STRICTER,
    Twin,
    built,
    compile_,
    has,
    holding_gap,
    modelled,
    sources,
    tracking_gap,
)
from tests.rigs import COMBINATIONS, bundled

HERE = Path(__file__).parent / "exporting"
MOST_GAP, MOST_TIME, HOSTILE = 1e-5, 20.0, 100_000
"""Asked of an exported controller: torque's difference in limits, µs of a step; how many hostile states it meets."""


def torques(twin: Twin, states: int) -> float:
    """Largest difference of torques, in torque limits."""
    rng = np.random.default_rng(0)
    gaps = [gap(twin, rng)[0] for gap in (tracking_gap, holding_gap) for _ in range(states)]
    return max(gaps)


def run(folder: Path, program: str, *options: str, words: tuple[str, ...] = ()) -> str:
    """Compile a program with the controller, and return what it prints; what it complains of is the failure."""
    own = [name for name in sources(folder) if name != "gimbal_about.c"]
    compile_(folder, COMPILERS["gcc"], "-I.", *options, "-o", program, str(HERE / f"{program}.c"), *own, "-lm")
    done = subprocess.run([folder / program, *words], capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"{folder.name}: {program}: {done.stdout}{done.stderr}")
    return done.stdout.strip()


def counted(folder: Path) -> str:
    """Floating-point operations of a step; a float that counts what is done to it takes the place of C's."""
    compiler = ("g++", "-std=c++20", "-O1", "-w", "-fpermissive", "-I.", f"-I{HERE}")
    subprocess.run([*compiler, "-o", "counted", str(HERE / "counted.cpp")], cwd=folder, check=True)
    done = subprocess.run([folder / "counted"], capture_output=True, text=True, check=True)
    return f"{done.stdout.strip()} operations"


def firmware(folder: Path) -> str:
    """Flash and deepest frame of a function on a Cortex-M4."""
    own = [name for name in sources(folder) if name != "gimbal_about.c"]
    compile_(folder, COMPILERS["arm"], "-O2", "-fstack-usage", "-c", *own)
    objects = [name.replace(".c", ".o") for name in own]
    said = subprocess.run(["arm-none-eabi-size", *objects], cwd=folder, capture_output=True, text=True, check=True)
    flash = sum(int(line.split()[0]) + int(line.split()[1]) for line in said.stdout.splitlines()[1:])
    frames = [int(re.split(r"\t", line)[1]) for path in folder.glob("*.su") for line in path.read_text().splitlines()]
    return f"flash {flash} bytes without libm, largest frame {max(frames)} bytes"


def checked(rig: str, payload: str, full: bool, states: int, folder: Path) -> str:
    """Check one rig with one payload, and say what came out."""
    twin = built(modelled(bundled(rig, payload), EVERYTHING if full else ()), folder, robust=full)
    gap = torques(twin, states)
    here = [name for name in COMPILERS if has(name)]
    for name in here:
        compile_(folder, COMPILERS[name], *STRICTER, "-O2", "-fsyntax-only", *sources(folder), "main.c")
    sanitized = ("-O1", "-g", "-fsanitize=address,undefined,float-cast-overflow", "-fno-sanitize-recover=all")
    run(folder, "hostile", *sanitized, words=(str(HOSTILE),))
    time = float(run(folder, "timed", "-O2"))
    said = [f"{rig} with {payload}: torque {gap:.1e}", f"{time:.2f} µs", f"compiled by {', '.join(here)}"]
    if shutil.which("cppcheck"):
        kinds = "--enable=warning,style,performance,portability"
        found = subprocess.run(["cppcheck", kinds, "--std=c99", "-q", "."], cwd=folder, capture_output=True, text=True)
        said.append("cppcheck: " + (found.stderr.splitlines() or ["nothing"])[0])
    if shutil.which("g++"):
        said.append(counted(folder))
    if "arm" in here:
        said.append(firmware(folder))
    missed = gap > MOST_GAP or time > MOST_TIME or any("error" in part or "warning" in part for part in said)
    return ("MISSED " if missed else "") + "; ".join(said)


def main() -> None:
    """Print a line per rig and payload; end with 1 where one misses what is asked."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--states", type=int, default=10_000)
    parser.add_argument("--only", help="a rig's name")
    asked = parser.parse_args()
    lines = []
    for k, (rig, payload) in enumerate(COMBINATIONS):
        if asked.only in (None, rig):
            with TemporaryDirectory() as folder:
                lines.append(checked(rig, payload, k == 0, asked.states, Path(folder)))
                print(lines[-1], flush=True)
    sys.exit(any(line.startswith("MISSED") for line in lines))


if __name__ == "__main__":
    main()
