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
    "OP_HYPOT": "hypotf({0}, {1})",
}
"""casadi's operations that the formulas of this package use."""


def number(value: float) -> str:
    """Return a constant as C writes a float: the nine digits that tell one from its neighbours."""
    if isinf(value):
        return "INFINITY" if value > 0 else "-INFINITY"
    text = f"{np.float32(value):.9g}"
    return f"{text}f" if any(mark in text for mark in ".e") else f"{text}.0f"


def c_function(function: casadi.Function, told: str) -> tuple[str, str, int]:
    """Return a function's prototype, with a comment above it, its definition, and how many operations a call takes."""
    body, count = lines(function)
    names = [function.name_in(i) for i in range(function.n_in())]
    inputs = [
        f"float {name}" if function.size1_in(i) == 1 and name == "t" else f"const float {name}[{function.numel_in(i)}]"
        for i, name in enumerate(names)
    ]
    outputs = [f"float {function.name_out(i)}[{function.numel_out(i)}]" for i in range(function.n_out())]
    head = f"void gimbal_{function.name()}({', '.join([*inputs, *outputs])})"
    text = "\n".join(body)
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
    out: list[str] = []
    count = 0
    for k in range(flat.n_instructions()):
        name, given, made = names[flat.instruction_id(k)], flat.instruction_input(k), flat.instruction_output(k)
        if name == "OP_CONST":
            value = flat.instruction_constant(k)
            known[made[0]] = number(value) if value >= 0 else f"({number(value)})"
        elif name == "OP_INPUT":
            known[made[0]] = "t" if inputs[given[0]] == "t" else f"{inputs[given[0]]}[{given[1]}]"
        elif name == "OP_OUTPUT":
            out.append(f"    {outputs[made[0]]}[{made[1]}] = {known[given[0]]};")
        elif name in FORMULAS:
            formula = FORMULAS[name].format(*(known[slot] for slot in given))
            known[made[0]] = f"x{len(out)}"
            out.append(f"    const float x{len(out)} = {formula};")
            count += name != "OP_ASSIGN"
        else:
            raise ModelError(f"export: {function.name()}", f"holds {name}, which C is not told of", "report the model")
    return out, count
