"""casadi's list of instructions as C99: one constant a line, no macro, no array of work."""

from __future__ import annotations

import re
from collections.abc import Mapping
from math import isinf
from typing import TYPE_CHECKING

import numpy as np

from gimbal_pin.errors import ModelError

if TYPE_CHECKING:
    import casadi

FORMULAS: Mapping[str, str] = {
    "OP_ASSIGN": "{0}",
    "OP_ADD": "{0} + {1}",
    "OP_SUB": "{0} - {1}",
    "OP_MUL": "{0} * {1}",
    "OP_DIV": "{0} / {1}",
    "OP_NEG": "-{0}",
    "OP_SQ": "{0} * {0}",
    "OP_TWICE": "2.0f * {0}",
    "OP_INV": "1.0f / {0}",
    "OP_SQRT": "sqrtf({0})",
    "OP_SIN": "sinf({0})",
    "OP_COS": "cosf({0})",
    "OP_EXP": "expf({0})",
    "OP_LOG": "logf({0})",
    "OP_POW": "powf({0}, {1})",
    "OP_CONSTPOW": "powf({0}, {1})",
    "OP_FABS": "fabsf({0})",
    "OP_FLOOR": "floorf({0})",
    "OP_FMIN": "fminf({0}, {1})",
    "OP_FMAX": "fmaxf({0}, {1})",
    "OP_COPYSIGN": "copysignf({0}, {1})",
    "OP_ATAN2": "atan2f({0}, {1})",
    "OP_HYPOT": "hypotf({0}, {1})",
    "OP_IF_ELSE_ZERO": "{0} ? {1} : 0.0f",
    "OP_LT": "{0} < {1}",
    "OP_LE": "{0} <= {1}",
    "OP_EQ": "{0} == {1}",
    "OP_NE": "{0} != {1}",
    "OP_NOT": "!{0}",
    "OP_AND": "{0} && {1}",
    "OP_OR": "{0} || {1}",
}
"""casadi's operations that the formulas of this package use."""
STRUCTURES = {
    "p": "parameters",
    "there": "ahead",
    "none": "ahead",
    "seen": "sensors",
    "state": "holding",
}
"""Structures of C: what the names of their fields begin with → their own where that is another."""
STRUCTURES |= dict.fromkeys(
    ["loop", "robust", "terms", "error", "reference", "upright", "limits", "way"], ""
)
STRUCTURES |= dict.fromkeys(["gaze", "view", "judging", "aim"], "")
SCALARS = {
    "t",
    "since",
    "stride",
    "p_dt",
    "p_still",
    "p_gravity",
    "p_level_span",
    "p_fusion_gain",
    "p_fusion_share",
}
"""Names of one entry that are no arrays in C."""
SCALARS |= {
    "p_fusion_bound",
    "robust_alpha",
    "robust_disturbance",
    "robust_gain",
    "upright_eased",
    "upright_samples",
}
SCALARS |= {"limits_steep", "limits_damping", "view_steep", "way_rate", "way_ramp", "state_trust"}
SCALARS |= {"judging_slow", "judging_mean", "judging_rise", "judging_fall"}


def number(value: float) -> str:
    """Return a constant as C writes a float: the nine digits that tell one from its neighbours."""
    if isinf(value):
        return "INFINITY" if value > 0 else "-INFINITY"
    text = f"{np.float32(value):.9g}"
    return f"{text}f" if any(mark in text for mark in ".e") else f"{text}.0f"


def spell(name: str, i: int) -> str:
    """Return entry i of an input or output as C writes it: `there_q` is a field of a structure, `q` an array.

    What ends with `_next` takes the place of the input of that name.
    """
    name = name.removesuffix("_next")
    structure, _, field = name.partition("_")
    if structure == "loop":
        return f"loop[{i}].{field}"
    whole = f"{structure}->{field}" if structure in STRUCTURES else name
    return whole if name in SCALARS else f"{whole}[{i}]"


def declare(name: str, size: int) -> tuple[str, str]:
    """Return name and declaration of the parameter of a C function that holds an input or output."""
    name = name.removesuffix("_next")
    structure = name.partition("_")[0]
    if structure not in STRUCTURES:
        return name, f"float {name}" if name in SCALARS else f"float {name}[{size}]"
    kind = f"struct gimbal_{STRUCTURES[structure] or structure}"
    return (
        structure,
        f"{kind} loop[GIMBAL_JOINTS]" if structure == "loop" else f"{kind} *{structure}",
    )


def c_function(function: casadi.Function, told: str) -> tuple[str, str, int]:
    """Return a function's prototype, with a comment above it, its definition, and how many operations a call takes."""
    body, count = lines(function)
    inputs = dict(
        declare(function.name_in(i), function.numel_in(i)) for i in range(function.n_in())
    )
    outputs = dict(
        declare(function.name_out(i), function.numel_out(i)) for i in range(function.n_out())
    )
    read = {name: own if name in SCALARS else f"const {own}" for name, own in inputs.items()}
    parameters = {**read, **outputs}
    head = f"void gimbal_{function.name()}({', '.join(parameters.values())})"
    text = "\n".join(body)
    unused = [f"    (void)({name});" for name in parameters if not re.search(rf"\b{name}\b", text)]
    said = told.replace("\n\n", " ").replace("\n", "\n   ")
    return f"/* {said} */\n{head};", "\n".join([head, "{", *unused, *body, "}"]), count


def lines(function: casadi.Function) -> tuple[list[str], int]:
    """Return a function's statements and how many operations they hold.

    Raises:
        ModelError: It holds an operation that C is not told of.
    """
    import casadi as ca

    names = {getattr(ca, name): name for name in dir(ca) if name.startswith("OP_")}
    flat = ca.Function(
        "flat", function.sx_in(), function.call(function.sx_in()), {"live_variables": False}
    )
    inputs = [function.name_in(i) for i in range(function.n_in())]
    outputs = [function.name_out(i) for i in range(function.n_out())]
    known: dict[int, str] = {}
    out, last, count = list[str](), list[str](), 0  # outputs last: they may be an input's place
    for k in range(flat.n_instructions()):
        name = names[flat.instruction_id(k)]
        given = flat.instruction_input(k)
        made = flat.instruction_output(k)
        if name == "OP_CONST":
            value = flat.instruction_constant(k)
            known[made[0]] = number(value) if value >= 0 else f"({number(value)})"
        elif name == "OP_INPUT":
            known[made[0]] = spell(inputs[given[0]], given[1])
        elif name == "OP_OUTPUT":
            last.append(f"    {spell(outputs[made[0]], made[1])} = {known[given[0]]};")
        elif name in FORMULAS:
            kind = "bool" if re.search("[<=!&|]", FORMULAS[name]) else "float"
            formula = FORMULAS[name].format(*(known[slot] for slot in given))
            known[made[0]] = f"x{len(out)}"
            out.append(f"    const {kind} x{len(out)} = {formula};")
            count += name != "OP_ASSIGN"
        else:
            raise ModelError(
                f"export: {function.name()}",
                f"holds {name}, which C is not told of",
                "report the model",
            )
    return [*out, *last], count
