"""A compiled controller as a control law of the simulation: processor in the loop, on this processor."""

from __future__ import annotations

import ctypes
import json
import struct
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from gimbal_pin.dynamics.simulation import Reference
from gimbal_pin.errors import ModelError
from gimbal_pin.log.log import Array
from gimbal_pin.rig.reading import read_bytes
from gimbal_pin.rig.rig import Rig
from gimbal_pin.rig.structure import check_origin

MEND = "build it from what 'gimbal-pin export' wrote: cmake -S DIR -B DIR/build && cmake --build DIR/build"


NEEDED = {"gimbal_about", "gimbal_default_parameters"} | {
    f"gimbal_{kind}_{what}"
    for kind in ("tracking", "holding")
    for what in ("size", "start", "step")
}
"""Symbols of a controller."""


def defined(content: bytes) -> set[str]:
    """Return the names that a shared library of 64 bits, little-endian, defines (ELF: gABI, section SHT_DYNSYM).

    Raises:
        struct.error, IndexError: It is damaged, or none.
    """
    if content[:6] != b"\x7fELF\2\1":
        raise struct.error("no ELF of 64 bits")
    (start,) = struct.unpack_from("<Q", content, 40)
    (size, count) = struct.unpack_from("<HH", content, 58)
    sections = [struct.unpack_from("<4xI16xQQI", content, start + k * size) for k in range(count)]
    found = set()
    for kind, at_, length, link in sections:
        for entry in range(at_, at_ + length, 24) if kind == 11 else ():  # SHT_DYNSYM
            name, section = struct.unpack_from("<I2xH", content, entry)
            first = sections[link][1] + name
            found |= (
                {content[first : content.index(b"\0", first)].decode(errors="replace")}
                if section
                else set()
            )
    return found


@dataclass(frozen=True, eq=False)
class Library:
    """A controller's shared library.

    Attributes:
        path: The file, absolute.
        about: What it says of itself: rig, payload, joints, links, controller, dt, delay.
        limit: Largest torques of the rig's motors, N m, (n,).
    """

    path: str
    about: dict[str, Any]
    limit: Array

    @staticmethod
    def load(path: str | Path, rig: Rig) -> Library:
        """Load a library; its code runs in this process, so it has to be one's own.

        Raises:
            ModelError: It is no library, no exported controller, or one of other joints.
        """
        place = str(path)
        try:  # its symbols first: to load it would run its constructors
            if not defined(read_bytes(path, ModelError)) >= NEEDED:
                raise ModelError(place, "holds no controller of gimbal-pin", MEND)
            code = ctypes.CDLL(str(Path(path).resolve()))
        except (OSError, ValueError, struct.error, IndexError):
            raise ModelError(place, "cannot be loaded as a library of this machine", MEND) from None
        code.gimbal_about.restype = ctypes.c_char_p
        about = json.loads(code.gimbal_about())
        if about["joints"] != list(rig.joints):
            what = f"is for the joints {', '.join(about['joints'])}"
            raise ModelError(
                place, what, f"the rig {rig.name} has {', '.join(rig.joints)}: export for it"
            )
        check_origin(about, rig, place)
        return Library(str(Path(path).resolve()), about, rig.tau_max)

    @cached_property
    def code(self) -> ctypes.CDLL:
        """The loaded library."""
        code = ctypes.CDLL(self.path)
        code.gimbal_tracking_size.restype = code.gimbal_holding_size.restype = ctypes.c_size_t
        return code

    def torque(self, tau: np.ndarray) -> Array:
        """Return single-precision torques in double: those at a limit are at it to the last digit."""
        return np.where(
            np.abs(tau) >= self.limit.astype(np.float32), np.copysign(self.limit, tau), tau
        )

    @property
    def law(self) -> CompiledLaw:
        """The controller as what follows a reference."""
        return CompiledLaw(self)

    @cached_property
    def parameters(self) -> ctypes.c_void_p:
        """Address of the default parameters."""
        return ctypes.c_void_p(
            ctypes.addressof(ctypes.c_char.in_dll(self.code, "gimbal_default_parameters"))
        )

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.about["joints"])

    def __reduce__(self) -> tuple[type[Library], tuple[str, dict[str, Any], Array]]:
        """Make it pass between processes: each loads the file anew."""
        return Library, (self.path, self.about, self.limit)


@dataclass(frozen=True, eq=False)
class CompiledLaw:
    """A compiled controller that follows a reference: a `simulation.Controller`.

    Attributes:
        library: The controller.
    """

    library: Library

    @property
    def dt(self) -> float:
        """Sampling interval, s."""
        return float(self.library.about["dt"])

    def start(self) -> bytes:
        """Memory before the first sample: the C structure, byte by byte."""
        code = self.library.code
        memory = ctypes.create_string_buffer(code.gimbal_tracking_size())
        code.gimbal_tracking_start(memory)
        return memory.raw

    def torque(
        self, t: float, q: Array, v: Array, reference: Reference, memory: bytes
    ) -> tuple[Array, bytes]:
        """Return the torque, N m, (n,), within the limits, and the next memory."""
        held = ctypes.create_string_buffer(memory, len(memory))
        tau = np.empty(self.library.n, np.float32)
        aim = single(reference.q, reference.v, reference.a)
        here = single(q)
        rates = single(v)
        self.library.code.gimbal_tracking_step(
            self.library.parameters, held, ctypes.c_float(t), at(here), at(rates), at(aim), at(tau)
        )
        return self.library.torque(tau), held.raw


def at(array: np.ndarray) -> ctypes.c_void_p:
    """Address of an array's entries, which the caller keeps alive."""
    return ctypes.c_void_p(array.ctypes.data)


def single(*parts: Array) -> np.ndarray:
    """Return arrays one after the other in single precision."""
    return np.concatenate([np.ravel(part) for part in parts]).astype(np.float32)
