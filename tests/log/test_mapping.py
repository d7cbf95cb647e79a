"""Mappings: ``target = factor * column + offset``, and the correction of an error reads the log."""

from __future__ import annotations

import math
import shlex
from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gimbal_pin.errors import GimbalPinError, LogError, UsageError
from gimbal_pin.log import (
    Source,
    format_expression,
    log_columns,
    parse_expression,
    read_log,
    write_yaml,
)
from tests.log.planted import TURRET, T, agree, held, planted, write_csv

PI = math.pi
EXPRESSIONS: Mapping[str, tuple[str, float, float]] = {
    " pos [rad] ": ("pos [rad]", 1.0, 0.0),
    "0.0276*iq_a": ("iq_a", 0.0276, 0.0),
    "deg / 180 * pi": ("deg", PI / 180, 0.0),
    "-2*-pos*+.5": ("pos", 1.0, 0.0),
    "2x*3": ("2x", 3.0, 0.0),
    "/joint_states/velocity/0.5": ("/joint_states/velocity", 2.0, 0.0),
    '"a*b"*2': ("a*b", 2.0, 0.0),
    "'-1'": ("-1", 1.0, 0.0),
    "Gyr (x)*pi/180": ("Gyr (x)", PI / 180, 0.0),
    "pos-1": ("pos-1", 1.0, 0.0),
    "pos - 2048": ("pos", 1.0, -2048.0),
    "(pos-2048)*2*pi/4096": ("pos", 2 * PI / 4096, -PI),
    "-2*(pos*0.5 + 1e-3)": ("pos", -1.0, -2e-3),
    '"a - b"-1+0.5': ("a - b", 1.0, -0.5),
}


@pytest.mark.parametrize("text", EXPRESSIONS)
def test_an_expression_is_a_column_a_factor_and_an_offset(text: str) -> None:
    column, factor, offset = EXPRESSIONS[text]
    source = parse_expression(text, "here")
    assert source.column == column
    assert (source.factor, source.offset) == pytest.approx((factor, offset), rel=1e-15)
    assert source.convert(np.array([3.0])) == pytest.approx([3 * factor + offset])
    again = parse_expression(source.times(-2.0), "here")
    assert (again.factor, again.offset) == pytest.approx((-2 * factor, -2 * offset), rel=1e-11)


@pytest.mark.parametrize(
    "text",
    [
        *("", " ", "3", "2*3", "pi", "a*b", "pos*(pi/180)", "pos**2", "*2", "pos*", "a*2+3*b"),
        *("pos*0", "pos/0", "pos*1e999", "pos/1e-320/1e-10", '"pos', '""', "f('x')*2*x"),
    ],
)
def test_expressions_that_are_none(text: str) -> None:
    with pytest.raises(UsageError, match=r"^here: "):
        parse_expression(text, "here")


@given(
    st.text(min_size=1, max_size=30).filter(lambda name: not ("'" in name and '"' in name)),
    st.sampled_from(["", "pi/180", "-", "-2*pi/8192", "1e-6"]),
)
def test_any_columns_name_reads_back_from_an_expression(name: str, factor: str) -> None:
    plain = parse_expression(f"x*{factor.lstrip('-') or '1'}", "").factor
    expected = Source(name, -plain if factor.startswith("-") else plain, "")
    assert parse_expression(format_expression(name, factor), "") == expected


def test_one_mapping_is_a_text_a_path_or_a_table(tmp_path: Path) -> None:
    """Of two entries the later one holds."""
    (tmp_path / "log.csv").write_text("time,a [°],b\n0,0,1\n0.1,2,3\n0.2,4,5\n")
    table = {"t": "time", "q_pan": '"a [°]"*pi/180', "q_tilt": "-b/2"}
    path = tmp_path / "map.yaml"
    write_yaml(table, path)
    several = [f"{target}={source}" for target, source in table.items()]
    forms: list[Any] = [str(path), path, table, several, ["t=row", path], [path, several[2]]]
    for mapping in forms:
        log = read_log(tmp_path / "log.csv", TURRET, mapping, need_tau=False)
        np.testing.assert_allclose(log.q, [[0, -0.5], [PI / 90, -1.5], [PI / 45, -2.5]])


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        ("q_pan=pos9", "no column 'pos9', which mapping 'q_pan=pos9' names"),
        ("q_nose=q_pan", "mapping 'q_nose=q_pan': 'q_nose' is no column.*joints pan, tilt"),
        ("gyro_nose_x=q_pan", "no column of this rig.*links"),
        ("q_pan", "not of the form"),
        ("=pos", "not of the form"),
        ("q_pan=", "is not one column"),
        ("nose,tilt=tilt,nose", "'q_nose' is no column"),
        ("q_pan=q_tilt*-1", "column 'q_tilt' is both q_pan and q_tilt"),
        ("q_pan=pos*" + "9" * 300_000, "has 300004 characters"),
        ("no.yaml", "no.yaml: does not exist"),
        ("t: x\nq: [}\n", "map.yaml:2: is not YAML"),
        ("t: x\nq_pan: a\nt: y\n", "map.yaml:3: .*'t' stands twice"),
        ("- t=x\n", "map.yaml: .*no table"),
        ("t: 5\n", "map.yaml: t: maps to 5"),
        ("t: x*0\n", "map.yaml: t: has the factor 0"),
    ],
)
def test_a_mapping_that_cannot_be_used_is_refused(entry: str, said: str, tmp_path: Path) -> None:
    path = write_csv(log_columns(planted()), tmp_path / "x.csv")
    mapping = tmp_path / "map.yaml"
    if entry.endswith("\n"):
        mapping.write_text(entry)
        entry = str(mapping)
    with pytest.raises(GimbalPinError, match=said) as caught:
        read_log(path, TURRET, [entry])
    assert caught.value.exit_code == 2
    assert "\n" not in str(caught.value)


# --- The correction that an error proposes ------------------------------------------------------

AMPERES = 0.0027 * np.array([motor.torque_constant for motor in TURRET.motors])


@pytest.mark.parametrize(
    ("names", "units", "unknown", "value"),
    [
        (("time", "pos_{}", "effort_{}"), (1, 1, 1), "", ""),
        (
            ("time_ms", "present_position_{}", "tau_{}"),
            (1e-3, 2 * PI / 4096, 1),
            "COUNTS_PER_TURN",
            "4096",
        ),
        (("t", "{} [cnt]", "tau_{}"), (1, 2 * PI / 65536, 1), "COUNTS_PER_TURN", "65536"),
        (("t", "{}.pos", "tau_{}"), (1, 0.02, 1), "RAD_PER_UNIT", "0.02"),
        (("t", "angle_{}", "tau_{}"), (1, 0.002, 1), "RAD_PER_UNIT", "0.002"),
        (("t", "q_{}", "current_{}"), (1, 1, AMPERES), "AMPERES_PER_UNIT", "0.0027"),
    ],
)
def test_the_correction_of_an_error_reads_the_log_once_completed(
    names: tuple[str, str, str],
    units: tuple[float, float, Any],
    unknown: str,
    value: str,
    tmp_path: Path,
) -> None:
    """Counts are whole numbers, as a drive's units of current are."""
    log = replace(planted(), v=None)
    q = np.round(log.q / units[1], 0 if unknown == "COUNTS_PER_TURN" else 9)
    tau = np.round(held(log.tau) / units[2], 0 if unknown == "AMPERES_PER_UNIT" else 9)
    columns = {names[0]: T / units[0]}
    for j, joint in enumerate(TURRET.joints):
        columns |= {names[1].format(joint): q[:, j], names[2].format(joint): tau[:, j]}
    path = write_csv(columns, tmp_path / "log.csv")
    with pytest.raises(LogError) as caught:
        read_log(path, TURRET)
    assert unknown in caught.value.mend
    words = shlex.split(caught.value.mend.replace(unknown or "--", value or "--"))
    entries = [after for word, after in pairwise(words) if word == "--map"]
    read = read_log(path, TURRET, entries)
    within = {"COUNTS_PER_TURN": units[1], "AMPERES_PER_UNIT": AMPERES.max()}.get(unknown, 1e-8)
    agree(replace(read, q=read.q - read.q[0] + log.q[0]), log, 1.01 * within)
