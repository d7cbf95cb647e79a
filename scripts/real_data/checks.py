"""What is required beside the classes of the diagnoses, one line each, and how it is judged."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from real_data.cases import TORQUE_CONSTANT, Case
from real_data.judging import harmonics, named
from real_data.running import Outcome
from real_data.samples import errors
from tests.blind.judge import get_errors

Json = dict[str, Any]
Judged = tuple[bool, str]

PARTS = {12 * k for k in range(1, 17)} | {14 * k for k in range(1, 15)}
"""Harmonics per turn that 12 slots and 14 poles show (the data's README)."""
FIRST_LOT = ("double_055640", "double_060143", "double_061157")
PUBLIC = (
    "psm_one",
    "psm_two",
    "hsm150_neg_0.045_1",
    "hsm150_pos_0.065_1",
    "cart_swing1_p006",
    "cart_swing1_p007",
)
"""Logs of the devices of public.py, one each."""
STATED = {
    "hsm150_neg_0.045_1": {"rotor.Izz": (0.8e-4, 1.5e-4)},
    "hsm150_pos_0.065_1": {"rotor.Izz": (0.8e-4, 1.5e-4)},
    "cart_swing1_p006": {"cart.m + bob.m": (6.2, 7.2), "bob.mz": (0.068, 0.080)},
    "cart_swing1_p007": {"cart.m + bob.m": (6.2, 7.2), "bob.mz": (0.068, 0.080)},
}
"""Base parameters, by log: stated as 1.2e-4 kg m², 6.50 kg and 0.0708 kg m.

Plain least squares finds 1.0e-4 to 1.35e-4, 6.6 to 7.1 and 0.074 to 0.077.
"""


class NoAnswerError(Exception):
    """A verb that had to answer did not; the message says how it ended."""


@dataclass(frozen=True)
class Check:
    """A line: its title, the runs it needs, and what judges their outcomes."""

    title: str
    needs: tuple[tuple[str, str], ...]
    judge: Callable[..., Judged]


@dataclass(frozen=True)
class Line:
    """A judged line; `passed` None: skipped."""

    title: str
    passed: bool | None
    figure: str

    def __str__(self) -> str:
        """One line of the table."""
        word = {True: "pass", False: "FAIL", None: "skip"}[self.passed]
        return f"{word}  {self.title}: {self.figure}"


def judged(checks: Iterable[Check], outcomes: Mapping[tuple[str, str], Outcome]) -> list[Line]:
    """Judge every check of which all outcomes are there; the others are skipped."""
    lines = []
    for check in checks:
        missing = [" ".join(need) for need in check.needs if need not in outcomes]
        if missing:
            lines.append(Line(check.title, None, f"not run: {', '.join(missing)}"))
            continue
        try:
            lines.append(Line(check.title, *check.judge(*(outcomes[need] for need in check.needs))))
        except NoAnswerError as stopped:
            lines.append(Line(check.title, False, str(stopped)))
    return lines


def answer(outcome: Outcome) -> Json:
    """Return the JSON of a verb that must have answered."""
    if outcome.result is None:
        raise NoAnswerError(outcome.said)
    return outcome.result


def rmse(told: Json) -> tuple[float, float]:
    """Return the only joint's held-out torque error before and after all findings, N m."""
    (pair,) = get_errors(told).values()
    return pair


def cogging_figure(told: Json, constant: float) -> str:
    """Return verdict, harmonics and held-out errors in A."""
    before, after = (value / constant for value in rmse(told))
    at = ", ".join(str(k) for k in sorted(harmonics(told))) or "nothing"
    return f"{told['verdict']}; cogging at {at}; {before:.3f} → {after:.3f} A ({100 * (after / before - 1):+.0f} %)"


# ---- bare motors ----

ODRIVE = TORQUE_CONSTANT["odrive_cogging"]


def cogging_alone(diagnosed: Outcome) -> Judged:
    """Cogging is named and 70 % of the held-out error is gone."""
    told = answer(diagnosed)
    before, after = rmse(told)
    return bool(named(told, "cogging")) and after <= 0.3 * before, cogging_figure(told, ODRIVE)


def cogging_together(diagnosed: Outcome) -> Judged:
    """Five of the expected harmonics, and at most 0.22 A on the log that was held out."""
    told = answer(diagnosed)
    right = rmse(told)[1] <= 0.22 * ODRIVE and len(harmonics(told) & PARTS) >= 5
    return told["verdict"] == "named" and right, cogging_figure(told, ODRIVE)


def inertia_is_positive(identified: Outcome, diagnosed: Outcome) -> Judged:
    """No inertia below zero is stated without a word that it is undetermined."""
    if identified.exit not in (0, 3):
        raise NoAnswerError(identified.said)
    text = f"{json_text(identified)}\n{json_text(diagnosed)}"
    less = {float(x) for x in re.findall(r"inertia[^.;]* is ([\d.]+) ± [\d.]+ % less", text)}
    rows = [
        p for p in (identified.result or {}).get("base_parameters", []) if p["unit"] == "kg m^2"
    ]
    negative = any(p["value"] <= 0 for p in rows) or any(share >= 100 for share in less)
    undetermined = (
        re.search(r"inertia[^.;]*(undetermined|does not show|cannot show)", text) is not None
    )
    each = [f"{p['name']} {p['value']:.3g} ± {p['std']:.2g}" for p in rows] or [
        f"none stated, {identified.said}"
    ]
    each += [f"diagnose: {share:g} % less than the URDF's" for share in less]
    return undetermined or not negative, "; ".join(each)


def json_text(outcome: Outcome) -> str:
    """Return everything that a verb said: both streams, and the sentences of its JSON."""
    told = outcome.result or {}
    sentences = [str(f.get("sentence")) for f in told.get("findings", [])]
    return "\n".join([outcome.text, outcome.error, *map(str, told.get("notes", [])), *sentences])


def formula_in_identify(identified: Outcome) -> Judged:
    """`identify` says so, too."""
    said = next(
        (
            line
            for line in json_text(identified).splitlines()
            if re.search("controller.formula", line)
        ),
        "",
    )
    said = said or next(
        (line for line in json_text(identified).splitlines() if "the controller's" in line), ""
    )
    return bool(said), said or f"not said ({identified.said})"


# ---- pendulums ----


def physical_arm(diagnosed: Outcome, *identified: Outcome) -> Judged:
    """J in 0.116–0.173 kg m² and m·l in 0.230–0.345 kg m, of one estimate, by diagnose's own or by `identify`."""
    found = False
    figures = []
    told = (diagnosed.result or {}).get("findings", [])
    answers = {
        "diagnose": {k: v["value"] for f in told for k, v in (f.get("answer") or {}).items()}
    }
    for name, outcome in zip(("instrumental", "output-error"), identified):
        rows = (outcome.result or {}).get("base_parameters", [])
        answers[name] = {row["name"]: row["value"] for row in rows}
    for name, known in answers.items():
        if "arm.Iyy" not in known:
            figures.append(f"{name}: none")
            continue
        inertia = known["arm.Iyy"]
        moment = float(np.hypot(known.get("arm.mx", 0.0), known["arm.mz"]))
        found = found or (0.116 <= inertia <= 0.173 and 0.230 <= moment <= 0.345)
        figures.append(f"{name}: J {inertia:.4f}, m·l {moment:.4f}")
    return found, "; ".join(figures)


def no_worse(case: Case, folder: Path) -> Callable[[Outcome], Judged]:
    """On every held-out sample `identify`'s model is within a tenth of least squares without a mask."""

    def judge(identified: Outcome) -> Judged:
        told = answer(identified)
        mine, plain = errors(case, folder / case.name / "model.yaml", told["cutoff_hz"])
        pairs = "; ".join(f"{a:.3f} against {b:.3f} N m ({a / b:.2f})" for a, b in zip(mine, plain))
        return bool(np.all(mine <= 1.1 * plain)), pairs

    return judge


def stated(known: Mapping[str, tuple[float, float]]) -> Callable[[Outcome], Judged]:
    """`identify` finds every base parameter in its interval."""

    def judge(identified: Outcome) -> Judged:
        found = {row["name"]: float(row["value"]) for row in answer(identified)["base_parameters"]}
        inside = [low <= found.get(name, np.nan) <= high for name, (low, high) in known.items()]
        return all(inside), ", ".join(f"{name} {found.get(name, np.nan):.3g}" for name in known)

    return judge


def agreeing(*diagnosed: Outcome) -> Judged:
    """No parameter of a cause that two logs name differs by more than three of their deviations."""
    apart = []
    for (i, one), (j, other) in combinations(enumerate(map(answer, diagnosed)), 2):
        for a in named(one):
            for b in named(other, a["cause"]):
                apart += [
                    f"logs {i + 1} and {j + 1}: {x}"
                    for x in differing(a, b)
                    if a["joint"] == b["joint"]
                ]
    return not apart, "; ".join(apart) or ", ".join(
        str(answer(one)["verdict"]) for one in diagnosed
    )


def differing(a: Json, b: Json) -> list[str]:
    """Return the sizes in which two findings differ by more than three deviations."""
    found = []
    for name in a["parameters"].keys() & b["parameters"].keys():
        p = a["parameters"][name]
        q = b["parameters"][name]
        if (
            p["std"]
            and q["std"]
            and abs(p["value"] - q["value"]) > 3 * np.hypot(p["std"], q["std"])
        ):
            found.append(
                f"{a['cause']} {name} {p['value']:.3g} ± {p['std']:.2g}, {q['value']:.3g} ± {q['std']:.2g}"
            )
    return found


# ---- every log ----


def no_error_of_ours(*outcomes: Outcome) -> Judged:
    """Exit code 0, or 2 or 3 with one line."""
    wrong = [one.said for one in outcomes if not one.sound]
    codes = ", ".join("limit" if one.exit is None else str(one.exit) for one in outcomes)
    return not wrong, "; ".join(wrong) or f"exit codes {codes}"


def required(cases: Iterable[Case], folder: Path) -> list[Check]:
    """Return the lines beside the classes of the diagnoses; results lie in `folder`."""
    at = {case.name: case for case in cases}
    lines = [
        *(Check(f"odrive {log}: cogging, 70 % of the last third's error gone",
                ((f"odrive_{log}", "diagnose-last-third"),), cogging_alone)
          for log in ("one_log_slower", "one_log_goodgains")),
        Check("odrive three logs: 5 expected harmonics, ≤ 0.22 A on slow_d", (("odrive_slow_abcd", "diagnose"),),
              cogging_together),
        Check("simple pendulum: J in 0.116–0.173, m·l in 0.230–0.345",
              tuple(("simple_system_identification", run)
                    for run in ("diagnose", "identify-instrumental", "identify-output-error")), physical_arm),
        Check("double pendulum: what its three logs name does not differ", tuple((n, "diagnose") for n in FIRST_LOT),
              agreeing),
        Check("UR10e: what its two logs name does not differ", (("ur10e_12", "diagnose"), ("ur10e_14", "diagnose")),
              agreeing),
    ]  # fmt: skip
    for log in ("on", "off"):
        diagnosed, identified = (
            (f"laas_speed_test1_{log}", run) for run in ("diagnose", "identify")
        )
        lines.append(
            Check(
                f"laas {log}: inertia positive or undetermined",
                (identified, diagnosed),
                inertia_is_positive,
            )
        )
        lines.append(
            Check(
                f"laas {log}: identify tells the controller's formula",
                (identified,),
                formula_in_identify,
            )
        )
    for name in (*FIRST_LOT, "double_A_0815_02", *PUBLIC):
        if name in at:
            title = f"{name}: within a tenth of unmasked least squares"
            lines.append(Check(title, ((name, "identify"),), no_worse(at[name], folder)))
    for name, known in STATED.items():
        if name in at:
            title = f"{name}: {', '.join(known)} as stated by its author"
            lines.append(Check(title, ((name, "identify"),), stated(known)))
    for name, case in at.items():
        title = f"{name}: no error of ours in {', '.join(case.runs)}"
        lines.append(Check(title, tuple((name, run) for run in case.runs), no_error_of_ours))
    return lines
