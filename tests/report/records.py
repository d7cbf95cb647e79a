"""Every kind of record that shows itself, of a rig whose joints turn and of one that slides and has hostile names."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np

import gimbal_pin as gp
from gimbal_pin.control import Tuning, judge_controllers, pair_rivals
from gimbal_pin.diagnosis import Diagnosis
from gimbal_pin.dynamics import compute_base
from gimbal_pin.excitation import predict_estimate
from gimbal_pin.identification import IdentificationResult, identify_several
from gimbal_pin.log import inspect, to_json
from gimbal_pin.pointing import verify
from gimbal_pin.report import Auto, summary
from gimbal_pin.rig import Record
from tests.bench_logs import fourier, prescribed
from tests.rigs import bundled, spelled

EVIL = "<script>alert(1)</script> & \"$x$ _{a}$ 'b'"
"""A name that breaks pages, attributes, scripts and formulas that do not escape it."""

SLIDER = """<robot name="slider"><link name="base"/>
  <link name={sledge}><inertial><origin xyz="0.02 0 0.01"/><mass value="0.8"/>
    <inertia ixx="0.001" iyy="0.001" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name={slide} type="prismatic"><parent link="base"/><child link={sledge}/>
    <axis xyz="0 0 1"/><limit lower="-0.2" upper="0.2" effort="30" velocity="1"/>
    <dynamics friction="0.4" damping="1.5"/></joint></robot>"""
NAMES = {word: quoteattr(f"{word} {EVIL}") for word in ("sledge", "slide")}
RIGS = {"turret": bundled("turret"), "slider": spelled(SLIDER.format(**NAMES))}
SPRING = {"turret": 0.3, "slider": 20.0}
"""What pulls at the last joint, N m/rad or N/m, which the URDF does not know."""


@cache
def clean_log(name: str, seed: int = 0) -> gp.Log:
    """Return the log of a rig that is as its URDF says."""
    model = gp.nominal(RIGS[name])
    log = prescribed(model, seed, seconds=12.0, torque_noise=0.01, dt=2e-3)
    return replace(log, name=f"/home/someone/{EVIL}.csv")


@cache
def log_of(name: str) -> gp.Log:
    """Return the log of a rig whose last joint is pulled by a spring."""
    log = clean_log(name)
    tau = np.array(log.tau)
    tau[:, -1] += SPRING[name] * np.asarray(log.q)[:, -1] + 0.05
    return replace(log, tau=tau)


@cache
def identified(name: str) -> IdentificationResult:
    """Return the model of the log."""
    return gp.identify(RIGS[name], [log_of(name)])


@cache
def diagnosed(name: str) -> Diagnosis:
    """Return the diagnosis of the log."""
    return gp.diagnose(RIGS[name], [log_of(name)])


@cache
def tuned(name: str) -> Tuning:
    """Return the controller that was made for what was found."""
    return gp.tune(diagnosed(name).after, disk_margin=1.0, dt=0.002, delay=0.002)


@cache
def whole(name: str) -> Auto:
    """Return all of it."""
    wrong = diagnosed(name)
    found = (identified(name), wrong, wrong.after, tuned(name))
    steps: Any = record_of(name, "Tracking")
    judged: Any = record_of(name, "Judgement")
    log = log_of(name)
    head = summary(RIGS[name], found[0], found[3], steps, [log], "the model", wrong, judged=judged)
    return Auto(*found, steps, judged, log.part(slice(0, 500)), {}, "the model", head, wrong.given)


def read_folder(name: str, read: Callable[[Path], Record]) -> Record:
    """Return what is read of a folder that holds the log three times, and a manifest."""
    with TemporaryDirectory() as folder:
        for k in range(3):
            gp.write_log(log_of(name), Path(folder) / f"{k}.csv")
        manifest = f"rig: {name}\nlogs: [{{log: 0.csv}}, {{log: 1.csv}}, {{log: 2.csv}}]"
        (Path(folder) / "manifest.yaml").write_text(manifest, encoding="utf-8")
        return read(Path(folder))


def spoil(name: str) -> gp.Log:
    """Return the log with torques that come late."""
    return replace(log_of(name), tau=np.roll(np.asarray(log_of(name).tau), 100, axis=0))


def pool() -> ThreadPoolExecutor:
    """Return an executor of this process."""
    return ThreadPoolExecutor(1)


OF_ANY_RIG: dict[str, Callable[[str], Record]] = {
    "IdentificationResult": identified,
    "Diagnosis": diagnosed,
    "Tuning": tuned,
    "Judgement": lambda name: judge_controllers(
        tuned(name).model, pair_rivals(tuned(name).stored), rng=0, plants=2
    ),
    "Tracking": lambda name: gp.track(
        tuned(name).model, pair_rivals(tuned(name).stored), rng=0, seconds=0.7, one_by_one=False
    ),
    "Excitation": lambda name: gp.excite(RIGS[name], seconds=2, starts=1, rng=0),
    "ExpectedEstimate": lambda name: predict_estimate(
        gp.nominal(RIGS[name]), fourier(RIGS[name], 0, 8.0), rng=0
    ),
    "Rehearsal": lambda name: gp.rehearse(RIGS[name], fourier(RIGS[name], 0, 8.0), rng=0),
    "Base": lambda name: compute_base(RIGS[name]),
    "Checked": lambda name: gp.check(RIGS[name]),
    "Several": lambda name: identify_several({"one": RIGS[name]}, {"one": [log_of(name)]}),
    "Model": lambda name: identified(name).model,
    "Rig": RIGS.__getitem__,
    "Log": lambda name: log_of(name).part(slice(0, 500)),
}
OF_TURRET: dict[str, Callable[[str], Record]] = {
    "Diagnosis of spoilt logs": lambda name: gp.diagnose(RIGS[name], [spoil(name)]),
    "IdentificationResult without its logs": lambda name: replace(identified(name), data=()),
    "Verified": lambda name: verify(
        RIGS[name], log=clean_log(name), known=tuned(name).model, seeds=1, seconds=1.0
    ),
    "MonteCarlo": lambda name: gp.monte_carlo(RIGS[name], count=3, seconds=0.65, executor=pool()),
    "Fleet": lambda name: read_folder(
        name, lambda folder: gp.compare_fleet(folder, quick=True, executor=pool())
    ),
    "Inspected": lambda name: read_folder(
        name, lambda folder: inspect(folder / "0.csv", RIGS[name])
    ),
}
RECORDS: dict[tuple[str, str], Callable[[str], Record]] = {
    **{(name, kind): make for kind, make in OF_ANY_RIG.items() for name in RIGS},
    **{("turret", kind): make for kind, make in OF_TURRET.items()},
    ("slider", "Auto"): whole,
}
"""Rig and what is shown → how it is found."""
SLIDING = [kind for name, kind in RECORDS if name == "slider"]
"""What is shown of the rig that slides."""


@cache
def record_of(name: str, kind: str) -> Record:
    """Return a record, which is found once."""
    return RECORDS[name, kind](name)


@cache
def data_of(name: str, kind: str) -> str:
    """Return what a record's dictionary holds before anything is shown."""
    return to_json(record_of(name, kind).to_dict())


@cache
def page_of(name: str, kind: str) -> str:
    """Return the page of a record."""
    data_of(name, kind)
    with TemporaryDirectory() as folder:
        record_of(name, kind).report(Path(folder) / "page.html")
        return (Path(folder) / "page.html").read_text(encoding="utf-8")


@cache
def notebook_of(name: str, kind: str) -> str:
    """Return what a notebook shows of a record."""
    return record_of(name, kind)._repr_html_()
