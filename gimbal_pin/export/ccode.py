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
    "p": "struct gimbal_parameters *p",
    "loop": "struct gimbal_loop loop[GIMBAL_JOINTS]",
    "robust": "struct gimbal_robust *robust",
    "terms": "struct gimbal_terms *terms",
    "there": "struct gimbal_ahead *there",
    "error": "struct gimbal_error *error",
    "reference": "struct gimbal_reference *reference",
    "upright": "struct gimbal_upright *upright",
    "after": "struct gimbal_upright *after",
}
"""What C gives a function in place of an array of every name that begins so."""
SCALARS = {"t", "p_dt", "p_still", "p_gravity", "robust_alpha", "robust_disturbance", "robust_gain"}
SCALARS |= {"p_level_span", "upright_eased", "upright_samples", "after_samples"}
"""Names of one entry that are no arrays in C."""


def number(value: float) -> str:
    """Return a constant as C writes a float: the nine digits that tell one from its neighbours."""
    if isinf(value):
        return "INFINITY" if value > 0 else "-INFINITY"
    text = f"{np.float32(value):.9g}"
    return f"{text}f" if any(mark in text for mark in ".e") else f"{text}.0f"


def spell(name: str, i: int) -> str:
    """Return entry i of an input or output as C writes it: `there_q` is a field of a structure, `q` an array."""
    structure, _, field = name.partition("_")
    if structure == "loop":
        return f"loop[{i}].{field}"
    if name == "robust_direction":
        return f"robust->direction[{i // 3}][{i % 3}]"
    whole = f"{structure}->{field}" if structure in STRUCTURES else name
    return whole if name in SCALARS else f"{whole}[{i}]"


def declare(name: str, size: int) -> str:
    """Return the parameter of a C function that holds an input or output."""
    return STRUCTURES.get(name.partition("_")[0], "float t" if name == "t" else f"float {name}[{size}]")


def c_function(function: casadi.Function, told: str) -> tuple[str, str, int]:
    """Return a function's prototype, with a comment above it, its definition, and how many operations a call takes."""
    body, count = lines(function)
    inputs = [declare(function.name_in(i), function.numel_in(i)) for i in range(function.n_in())]
    outputs = [declare(function.name_out(i), function.numel_out(i)) for i in range(function.n_out())]
    parameters = dict.fromkeys([x if x == "float t" else f"const {x}" for x in inputs] + outputs)
    head = f"void gimbal_{function.name()}({', '.join(parameters)})"
    text = "\n".join(body)
    names = [re.findall(r"\w+", parameter.partition("[")[0])[-1] for parameter in parameters]
    unused = [f"    (void)({name});" for name in names if not re.search(rf"\b{name}\b", text)]
    return f"/* {told} */\n{head};", "\n".join([head, "{", *unused, *body, "}"]), count


def lines(function: casadi.Function) -> tuple[list[str], int]:
    """Return a function's statements and how many operations they hold.

    Raises:
        ModelError: It holds an operation that C is not told of.
    """
    import casadi as ca

    names = {getattr(ca, name): name for name in dir(ca) if name.startswith("OP_")}
    flat = ca.Function("flat", function.sx_in(), function.call(function.sx_in()), {"live_variables": False})
    inputs = [function.name_in(i) for i in range(function.n_in())]
    outputs = [function.name_out(i) for i in range(function.n_out())]
    known: dict[int, str] = {}
    out, last, count = list[str](), list[str](), 0  # outputs last: they may be an input's place
    for k in range(flat.n_instructions()):
        name, given, made = names[flat.instruction_id(k)], flat.instruction_input(k), flat.instruction_output(k)
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
            raise ModelError(f"export: {function.name()}", f"holds {name}, which C is not told of", "report the model")
    return [*out, *last], count
