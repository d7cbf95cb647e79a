"""What an exported controller has to keep, on every bundled rig with every payload.

Torques within 1e-5 of the limit at 10 000 drawn states, following a reference and holding the camera; jitter on
profile S within 2 % of Python's over five seeds; no warning of any compiler that is here; 100 000 random and hostile
states under the address and undefined-behaviour sanitizers; nothing from cppcheck; a step under 20 µs; flash and stack
on a Cortex-M4. The first rig has all causes that a controller makes up for, and Lyapunov redesign.
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

from gimbal_pin.pointing import Pointing, draw_profile, simulate_holding
from gimbal_pin.pointing.bench import WANTED
from gimbal_pin.pointing.pointer import Holder
from gimbal_pin.pointing.result import Row
from gimbal_pin.pointing.sight import unable
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
MOST_GAP, MOST_JITTER, MOST_TIME, HOSTILE = 1e-5, 0.02, 20.0, 100_000
"""Asked of an exported controller: differences of torque (in limits) and jitter, µs of a step; hostile states."""
CYCLES = 10
"""Of a Cortex-M4 for an operation: one for a sum or product, two for each of two loads and a store where all stand in
memory, which makes seven; three more for divisions (14 cycles), sines and branches. Registers spare much of that.
"""
SEEDS, SECONDS = 5, 2.6
"""Platforms on which both hold the camera, and for how long, s."""


def torques(twin: Twin, states: int) -> float:
    """Largest difference of torques, in torque limits."""
    rng = np.random.default_rng(0)
    gaps = [gap(twin, rng)[0] for gap in (tracking_gap, holding_gap) for _ in range(states)]
    return max(gaps)


def jitters(twin: Twin) -> tuple[float, float]:
    """Jitter on profile S of Python's controller and of the compiled one, the sensors' noise fed back, degrees rms."""
    model = twin.stored.model

    def held(holder: Holder, seed: int) -> Pointing:
        ground = draw_profile(model.rig, SECONDS, seed)
        return simulate_holding(
            model, holder, ground, rng=np.random.default_rng([seed, 1]), seconds=SECONDS
        )

    python, compiled = (
        Row("", tuple(held(holder, seed) for seed in range(SEEDS))).jitter_rms
        for holder in (twin.pointer, twin.compiled)
    )
    return python, compiled


def run(folder: Path, program: str, *options: str, words: tuple[str, ...] = ()) -> str:
    """Compile a program with the controller, and return what it prints; what it complains of is the failure."""
    own = [name for name in sources(folder) if name != "gimbal_about.c"]
    compile_(
        folder,
        COMPILERS["gcc"],
        "-I.",
        *options,
        "-o",
        program,
        str(HERE / f"{program}.c"),
        *own,
        "-lm",
    )
    done = subprocess.run([folder / program, *words], capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"{folder.name}: {program}: {done.stdout}{done.stderr}")
    return done.stdout.strip()


def counted(folder: Path) -> str:
    """Floating-point operations of a step; a float that counts what is done to it takes the place of C's."""
    compiler = ("g++", "-std=c++20", "-O1", "-w", "-fpermissive", "-I.", f"-I{HERE}")
    subprocess.run([*compiler, "-o", "counted", str(HERE / "counted.cpp")], cwd=folder, check=True)
    done = subprocess.run([folder / "counted"], capture_output=True, text=True, check=True)
    return f"{done.stdout.strip()} operations, {int(done.stdout) * CYCLES / 168:.0f} µs on paper at 168 MHz"


def firmware(folder: Path) -> str:
    """Flash and deepest stack of a call on a Cortex-M4, beside libm."""
    own = [name for name in sources(folder) if name != "gimbal_about.c"]
    compile_(folder, COMPILERS["arm"], "-O2", "-fcallgraph-info=su", "-c", *own)
    objects = [name.replace(".c", ".o") for name in own]
    said = subprocess.run(
        ["arm-none-eabi-size", *objects], cwd=folder, capture_output=True, text=True, check=True
    )
    flash = sum(
        int(line.split()[0]) + int(line.split()[1]) for line in said.stdout.splitlines()[1:]
    )
    return f"flash {flash} bytes and deepest stack {stack(folder)} bytes, without libm"


def stack(folder: Path) -> int:
    """Return the bytes of the deepest chain of calls, by the compiler's call graph; nothing of it calls itself."""
    graph = "\n".join(path.read_text() for path in folder.glob("*.ci"))
    frames = {
        name: int(size)
        for name, size in re.findall(r'node: \{ title: "([^"]+)"[^}]*?(\d+) bytes', graph)
    }
    calls = re.findall(r'edge: \{ sourcename: "([^"]+)" targetname: "([^"]+)"', graph)

    def depth(name: str) -> int:
        return frames.get(name, 0) + max((depth(to) for by, to in calls if by == name), default=0)

    return max(map(depth, frames))


def checked(rig: str, payload: str, full: bool, states: int, folder: Path) -> str:
    """Check one rig with one payload, and say what came out."""
    twin = built(modelled(bundled(rig, payload), EVERYTHING if full else ()), folder, robust=full)
    gap = torques(twin, states)
    here = [name for name in COMPILERS if has(name)]
    for name in here:
        compile_(
            folder, COMPILERS[name], *STRICTER, "-O2", "-fsyntax-only", *sources(folder), "main.c"
        )
    sanitized = (
        "-O1",
        "-g",
        "-fsanitize=address,undefined,float-cast-overflow",
        "-fno-sanitize-recover=all",
    )
    run(folder, "hostile", *sanitized, words=(str(HOSTILE),))
    time = float(run(folder, "timed", "-O2"))
    said = [
        f"{rig} with {payload}: torque {gap:.1e}",
        f"{time:.2f} µs",
        f"compiled by {', '.join(here)}",
    ]
    said.append(f"sanitizers: {HOSTILE} hostile states, nothing")
    off = 0.0
    if not unable(twin.stored.model.rig, WANTED):
        python, c = jitters(twin)
        off = c / python - 1
        said.insert(1, f"jitter {python:.5f}° Python, {c:.5f}° C ({100 * off:+.2f} %)")
    if shutil.which("cppcheck"):
        kinds = "--enable=warning,style,performance,portability"
        found = subprocess.run(
            ["cppcheck", kinds, "--std=c99", "-q", "."], cwd=folder, capture_output=True, text=True
        )
        said.append("cppcheck: " + (found.stderr.splitlines() or ["nothing"])[0])
    if shutil.which("g++"):
        said.append(counted(folder))
    if "arm" in here:
        said.append(firmware(folder))
    missed = (
        gap > MOST_GAP
        or abs(off) > MOST_JITTER
        or time > MOST_TIME
        or any("error" in part or "warning" in part for part in said)
    )
    return ("MISSED " if missed else "") + "; ".join(said)


def main() -> None:
    """Print a line per rig and payload; end with 1 where one misses what is asked."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--states", type=int, default=10_000)
    parser.add_argument("--only", help="a rig's name, or RIG:PAYLOAD")
    asked = parser.parse_args()
    lines = []
    for k, (rig, payload) in enumerate(COMBINATIONS):
        if asked.only in (None, rig, f"{rig}:{payload}"):
            with TemporaryDirectory() as folder:
                lines.append(checked(rig, payload, k == 0, asked.states, Path(folder)))
                print(lines[-1], flush=True)
    missed = sum(line.startswith("MISSED") for line in lines)
    print(f"{len(lines) - missed} passed, {missed} missed")
    sys.exit(missed > 0)


if __name__ == "__main__":
    main()
