"""Excitation design: criteria, Fourier series, limits, and the search that joins them."""

from gimbal_pin.excitation.columns import Columns, condition_number
from gimbal_pin.excitation.criteria import Condition, Criterion, Determinant, Sequential
from gimbal_pin.excitation.design import Excitation, excite
from gimbal_pin.excitation.fourier import Series, repeats
from gimbal_pin.excitation.known import known, sequential
from gimbal_pin.excitation.limits import Envelope

__all__ = [
    "Columns",
    "Condition",
    "Criterion",
    "Determinant",
    "Envelope",
    "Excitation",
    "Sequential",
    "Series",
    "condition_number",
    "excite",
    "known",
    "repeats",
    "sequential",
]
