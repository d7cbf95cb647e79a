"""What is required of the results, one line each, and how it is judged."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from gimbal_pin.log.io import read_log
from gimbal_pin.rig.rig import Rig
from real_data.cases import TORQUE_CONSTANT, Case
from real_data.running import Outcome
from real_data.samples import errors

Json = dict[str, Any]
Judged = tuple[bool, str]

NAMED = ("named", "unconfirmed")
"""Statuses of a finding that has a name: `unconfirmed` is a mark on one."""
PARTS = {12 * k for k in range(1, 17)} | {14 * k for k in range(1, 15)}
"""Harmonics per turn that 12 slots and 14 poles show (the data's README)."""
LAGS = ("delay", "actuator-lag")
LATE = 0.005
"""A current's lag behind the angle, s, up to which it is the channels' alignment and no finding."""
FIRST_LOT = ("double_055640", "double_060143", "double_061157")
WRISTS = ("wrist_1", "wrist_2", "wrist_3")


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


def named(told: Json, *causes: str) -> list[Json]:
    """Return the findings that have a name, of these causes or of all but the data's."""
    return [f for f in told["findings"] if f["status"] in NAMED and (not causes or f["cause"] in causes)]


def values(finding: Json, name: str) -> list[float]:
    """Return the values of the parameters that are called so, with or without a number behind."""
    found = finding["parameters"].items()
    return [p["value"] for key, p in found if re.fullmatch(rf"{name}[_ ]?\d*", key) and p["value"] is not None]


def harmonics(told: Json) -> set[int]:
    """Return the harmonics per turn at which cogging is named."""
    return {round(k) for finding in named(told, "cogging") for k in values(finding, "harmonic")}


def rmse(told: Json) -> tuple[float, float]:
    """Return the only joint's held-out torque error before and after all findings, N m."""
    before, after = (next(iter(told[part]["torque_rmse"].values())) for part in ("baseline", "extended"))
    return before, after


def lags(finding: Json) -> list[float]:
    """Return the time of a delay or of a lag, s."""
    return values(finding, "time") + values(finding, "time_constant")


def cogging_figure(told: Json, constant: float) -> str:
    """Return verdict, harmonics and held-out errors in A."""
    before, after = (value / constant for value in rmse(told))
    at = ", ".join(str(k) for k in sorted(harmonics(told))) or "nothing"
    return f"{told['verdict']}; cogging at {at}; {before:.3f} → {after:.3f} A ({100 * (after / before - 1):+.0f} %)"


# ---- bare motors ----

ODRIVE, LAAS = TORQUE_CONSTANT["odrive_cogging"], TORQUE_CONSTANT["laas_anti_cogging"]


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


def cogging_at(harmonic: int) -> Callable[[Outcome], Judged]:
    """Cogging is named at a harmonic."""

    def judge(diagnosed: Outcome) -> Judged:
        told = answer(diagnosed)
        return harmonic in harmonics(told), cogging_figure(told, LAAS)

    return judge


def no_lag(diagnosed: Outcome) -> Judged:
    """Neither a finding nor the alignment is later than `LATE`."""
    told = answer(diagnosed)
    found = [lag for finding in named(told, *LAGS) for lag in lags(finding)]
    times = [*found, told.get("alignment_s") or 0.0]
    return max(map(abs, times)) <= LATE, ", ".join(f"{1e3 * t:.1f} ms" for t in times) + " (the last: alignment)"


def inertia_is_positive(identified: Outcome, diagnosed: Outcome) -> Judged:
    """No inertia below zero is stated without a word that it is undetermined."""
    if identified.exit not in (0, 3):
        raise NoAnswerError(identified.said)
    text = f"{json_text(identified)}\n{json_text(diagnosed)}"
    less = {float(x) for x in re.findall(r"inertia[^.;]* is ([\d.]+) ± [\d.]+ % less", text)}
    rows = [p for p in (identified.result or {}).get("base_parameters", []) if p["unit"] == "kg m^2"]
    negative = any(p["value"] <= 0 for p in rows) or any(share >= 100 for share in less)
    undetermined = re.search(r"inertia[^.;]*(undetermined|does not show|cannot show)", text) is not None
    each = [f"{p['name']} {p['value']:.3g} ± {p['std']:.2g}" for p in rows] or [f"none stated, {identified.said}"]
    each += [f"diagnose: {share:g} % less than the URDF's" for share in less]
    return undetermined or not negative, "; ".join(each)


def json_text(outcome: Outcome) -> str:
    """Return everything that a verb said: both streams, and the sentences of its JSON."""
    told = outcome.result or {}
    sentences = [str(f.get("sentence")) for f in told.get("findings", [])]
    return "\n".join([outcome.text, outcome.error, *map(str, told.get("notes", [])), *sentences])


def formula(diagnosed: Outcome) -> Judged:
    """`controller-formula` is among the findings of the data."""
    told = answer(diagnosed)
    causes = [f["cause"] for f in told["findings"]]
    return "controller-formula" in causes, f"{told['verdict']}: {', '.join(causes) or 'no finding'}"


def formula_in_identify(identified: Outcome) -> Judged:
    """`identify` says so, too."""
    said = next((line for line in json_text(identified).splitlines() if re.search("controller.formula", line)), "")
    said = said or next((line for line in json_text(identified).splitlines() if "the controller's" in line), "")
    return bool(said), said or f"not said ({identified.said})"


def runs(outcome: Outcome) -> Judged:
    """It answers."""
    return outcome.exit == 0, f"{outcome.said}, {verdict(outcome)}"


# ---- pendulums ----


def acceleration_noise(diagnosed: Outcome) -> Judged:
    """The noise in the motion is said."""
    told = answer(diagnosed)
    causes = [f["cause"] for f in told["findings"]]
    return "acceleration-noise" in causes, f"{told['verdict']}: {', '.join(causes) or 'no finding'}"


def physical_arm(diagnosed: Outcome, *identified: Outcome) -> Judged:
    """J in 0.116–0.173 kg m² and m·l in 0.230–0.345 kg m, of one estimate, by diagnose's own or by `identify`."""
    found, figures = False, []
    told = (diagnosed.result or {}).get("findings", [])
    answers = {"diagnose": {k: v["value"] for f in told for k, v in (f.get("answer") or {}).items()}}
    for name, outcome in zip(("instrumental", "output-error"), identified):
        rows = (outcome.result or {}).get("base_parameters", [])
        answers[name] = {row["name"]: row["value"] for row in rows}
    for name, known in answers.items():
        if "arm.Iyy" not in known:
            figures.append(f"{name}: none")
            continue
        inertia, moment = known["arm.Iyy"], float(np.hypot(known.get("arm.mx", 0.0), known["arm.mz"]))
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


def answers_or_refuses(*outcomes: Outcome) -> Judged:
    """It answers, or says that the data cannot (exit code 3)."""
    return all(one.exit in (0, 3) for one in outcomes), "; ".join(one.said for one in outcomes)


def agreeing(*diagnosed: Outcome) -> Judged:
    """No parameter of a cause that two logs name differs by more than three of their deviations."""
    apart = []
    for (i, one), (j, other) in combinations(enumerate(map(answer, diagnosed)), 2):
        for a in named(one):
            for b in named(other, a["cause"]):
                apart += [f"logs {i + 1} and {j + 1}: {x}" for x in differing(a, b) if a["joint"] == b["joint"]]
    return not apart, "; ".join(apart) or ", ".join(str(answer(one)["verdict"]) for one in diagnosed)


def differing(a: Json, b: Json) -> list[str]:
    """Return the sizes in which two findings differ by more than three deviations."""
    found = []
    for name in a["parameters"].keys() & b["parameters"].keys():
        p, q = a["parameters"][name], b["parameters"][name]
        if p["std"] and q["std"] and abs(p["value"] - q["value"]) > 3 * np.hypot(p["std"], q["std"]):
            found.append(f"{a['cause']} {name} {p['value']:.3g} ± {p['std']:.2g}, {q['value']:.3g} ± {q['std']:.2g}")
    return found


# ---- every log ----


def nothing_denied(case: Case) -> Callable[[Outcome], Judged]:
    """It answers or exits with 3, and nothing is named that its own parameters or the log deny."""

    def judge(diagnosed: Outcome) -> Judged:
        if diagnosed.result is None:
            return diagnosed.exit == 3, diagnosed.said
        denied = [why for finding in named(diagnosed.result) for why in denials(finding, case)]
        before, after = (diagnosed.result[part]["torque_rmse"] for part in ("baseline", "extended"))
        for finding in diagnosed.result["findings"]:
            joint = finding["joint"]
            if finding["status"] == "named" and joint in before and after[joint] > (1 + 1e-6) * before[joint]:
                grown = f"{before[joint]:.3g} → {after[joint]:.3g} N m"
                denied.append(f"{finding['cause']} at {joint}: its held-out error grows, {grown}, and it is not marked")
        return not denied, "; ".join(denied) or verdict(diagnosed)

    return judge


def denials(finding: Json, case: Case) -> list[str]:
    """Return why a named finding cannot be: by bounds, by a size known to two deviations, by lags."""
    cause, known = finding["cause"], [p for p in finding["parameters"].values() if p["std"]]
    why = []
    if known and all(abs(p["value"]) < 2 * p["std"] for p in known):
        why.append("no parameter is known to two deviations")
    rig = Rig.load(case.rig)
    logs = [read_log(path, rig, case.maps) for path in case.logs]
    if cause == "saturation" and finding["joint"] in rig.joints:
        j = rig.joint_index(finding["joint"])
        largest = max(float(np.abs(log.tau[:, j]).max()) for log in logs if log.tau is not None)
        limits = [x for x in values(finding, "limit") if x > largest]
        why += [f"a limit of {x:.3g} N m, {largest:.3g} was the largest" for x in limits]
    if cause == "friction-drift":
        span = max(float(log.t[-1] - log.t[0]) for log in logs)
        why += [f"a drift over {x:.3g} s of {span:.3g}" for x in values(finding, "span") if x < span / 10]
    if cause in ("armature", "joint-flexibility"):
        sizes = [(p["value"], p["std"] or 0.0) for key, p in finding["parameters"].items() if key == "inertia"]
        why += [f"an inertia of {x:.3g} kg m²" for x, _ in sizes if x <= 0]
        if cause == "armature":
            why += [f"a rotor of {x:.3g} kg m², {case.rotor:.3g} at most" for x, s in sizes if x - 2 * s > case.rotor]
    # 43 ms is the least of the lags that were named for cogging; a drive's current follows within a few milliseconds.
    if cause in LAGS:
        why += [f"a lag of {1e3 * x:.0f} ms" for x in lags(finding) if x >= 0.043]
    return [f"{cause} at {finding['joint'] or 'rig'}: {text}" for text in why]


def no_error_of_ours(*outcomes: Outcome) -> Judged:
    """Exit code 0, or 2 or 3 with one line."""
    wrong = [one.said for one in outcomes if not one.sound]
    codes = ", ".join("limit" if one.exit is None else str(one.exit) for one in outcomes)
    return not wrong, "; ".join(wrong) or f"exit codes {codes}"


# ---- public logs ----


def wrists(*diagnosed: Outcome) -> Judged:
    """Armature at three wrists of both logs, the same within a fifth."""
    sizes = []
    for told in map(answer, diagnosed):
        found = {str(f["joint"]): f for f in named(told, "armature")}
        sizes.append({w: x for w in WRISTS for name, f in found.items() if w in name for x in values(f, "inertia")})
    same = all(abs(one[w] - two[w]) <= 0.2 * max(one[w], two[w]) for one, two in [sizes] for w in one.keys() & two)
    figure = "; ".join(", ".join(f"{w} {x:.3f}" for w, x in size.items()) or "none" for size in sizes)
    return same and all(len(size) == len(WRISTS) for size in sizes), f"{figure} kg m²"


def filtered_rate(diagnosed: Outcome) -> Judged:
    """`filtered-velocity` is said."""
    told = answer(diagnosed)
    causes = [f["cause"] for f in told["findings"]]
    return "filtered-velocity" in causes, f"{told['verdict']}: {', '.join(causes) or 'no finding'}"


def verdict(outcome: Outcome) -> str:
    """Return a diagnosis's verdict and named findings in a few words; of other verbs, how they ended."""
    told = outcome.result or {}
    if "verdict" not in told:
        return outcome.said
    return f"{told['verdict']}: {', '.join(dict.fromkeys(map(size, told['findings']))) or 'no finding'}"


def size(finding: Json) -> str:
    """Return a finding's cause, joint, mark and sizes; phases are left out, harmonics stand as a list."""
    where = f" at {finding['joint']}" if finding["joint"] else ""
    mark = "" if finding["status"] == "named" else f" [{finding['status']}]"
    told = finding["parameters"].items()
    if finding["status"] == "data":
        return f"{finding['cause']}{where}{mark}"
    parts = [quantity(k, p) for k, p in told if not k.startswith(("phase", "harmonic"))]
    if at := sorted(values(finding, "harmonic")):
        parts = ["k " + "/".join(f"{k:g}" for k in at), *parts[:1]]
    return f"{finding['cause']}{where}{mark} ({', '.join(parts[:3])})"


def quantity(name: str, parameter: Json) -> str:
    """Return a name, a value, its deviation and unit."""
    std = "" if parameter["std"] is None else f" ± {parameter['std']:.2g}"
    unit = "" if parameter["unit"] in ("", "1") else f" {parameter['unit']}"
    value = "?" if parameter["value"] is None else f"{parameter['value']:.3g}"
    return f"{name} {value}{std}{unit}"


def required(cases: Iterable[Case], folder: Path) -> list[Check]:
    """Return the lines that the cases are judged by; results lie in `folder`."""
    at = {case.name: case for case in cases}
    lines = [
        *(Check(f"odrive {log}: cogging, 70 % of the error gone{of}", ((f"odrive_{log}", run),), cogging_alone)
          for log in ("one_log_slower", "one_log_goodgains")
          for run, of in (("diagnose", ""), ("diagnose-last-third", " of the last third"))),
        Check("odrive three logs: 5 expected harmonics, ≤ 0.22 A on slow_d", (("odrive_slow_abcd", "diagnose"),),
              cogging_together),
        *(check for log in ("on", "off") for check in laas(f"laas_speed_test1_{log}")),
        Check("laas acc_current runs", (("laas_acc_current", "diagnose"),), runs),
        Check("simple pendulum: acceleration-noise", (("simple_system_identification", "diagnose"),),
              acceleration_noise),
        Check("simple pendulum: J in 0.116–0.173, m·l in 0.230–0.345",
              tuple(("simple_system_identification", run)
                    for run in ("diagnose", "identify-instrumental", "identify-output-error")), physical_arm),
        Check("double pendulum: what its three logs name does not differ", tuple((n, "diagnose") for n in FIRST_LOT),
              agreeing),
    ]  # fmt: skip
    for name in (*FIRST_LOT, "double_A_0815_02"):
        if name in at:
            title = f"{name}: within a tenth of unmasked least squares"
            lines.append(Check(title, ((name, "identify"),), no_worse(at[name], folder)))
    for name in ("double_A_5s", "double_C1_6s"):
        title = f"{name}: diagnose and identify answer or exit with 3"
        lines.append(Check(title, ((name, "diagnose"), (name, "identify")), answers_or_refuses))
    for name, case in at.items():
        title = f"{name}: nothing named that is denied"
        # Logs without torque have no verdict.
        if name not in ("rub_gimbal", "phantom4_motion"):
            lines.append(Check(title, ((name, "diagnose"),), nothing_denied(case)))
        lines.append(
            Check(f"{name}: no error of ours in {', '.join(case.runs)}",
                  tuple((name, run) for run in case.runs), no_error_of_ours)
        )  # fmt: skip
    ur10e = ("ur10e_12", "diagnose"), ("ur10e_14", "diagnose")
    lines.append(Check("UR10e: armature at three wrists, both logs within a fifth", ur10e, wrists))
    lines.append(Check("TIAGo: the filtered rate is said", (("tiago", "diagnose"),), filtered_rate))
    return lines


def laas(name: str) -> list[Check]:
    """The lines of a motor at constant speeds under a speed loop."""
    diagnosed, identified = (name, "diagnose"), (name, "identify")
    return [
        *(Check(f"{name}: cogging at {k}", (diagnosed,), cogging_at(k)) for k in (72, 18)),
        Check(f"{name}: no lag over 5 ms", (diagnosed,), no_lag),
        Check(f"{name}: inertia positive or undetermined", (identified, diagnosed), inertia_is_positive),
        Check(f"{name}: diagnose tells the controller's formula", (diagnosed,), formula),
        Check(f"{name}: identify tells the controller's formula", (identified,), formula_in_identify),
    ]
