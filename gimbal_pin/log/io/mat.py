"""MATLAB: .mat to version 7 by SciPy, version 7.3 and any other HDF5 by h5py."""

from __future__ import annotations

from functools import partial
from math import prod
from pathlib import Path
from typing import Any

from gimbal_pin.errors import LogError
from gimbal_pin.log.io.isolated import open_isolated
from gimbal_pin.log.io.tables import DEEPEST, Stream, Table, streams_of
from gimbal_pin.rig.reading import beginning, check_size

HDF5 = b"\x89HDF\r\n\x1a\n"


def open_mat(path: Path) -> Table:
    """Read the arrays of real numbers in a MATLAB or HDF5 file, those in structures as ``structure.field``."""
    kind = partial(open_isolated, path, "mat")
    return kind("an HDF5 or MATLAB 7.3 file", "h5py", "mat") if is_hdf5(path) else kind("a .mat", "scipy", "mat")


def is_hdf5(path: Path) -> bool:
    """Whether a file is HDF5, behind MATLAB's header of 512 bytes or without one."""
    head = beginning(path, 520)
    return HDF5 in (head[:8], head[512:])


def streams(path: Path) -> tuple[list[Stream], list[str]]:
    """Return the streams in a file; SciPy's and h5py's own errors where it is damaged, `LogError` if it is too much."""
    if not is_hdf5(path):
        from scipy.io import loadmat, whosmat

        check_size(path, sum(8 * prod(shape) for _, shape, kind in whosmat(path) if kind != "sparse"), LogError)
        return streams_of({k: v for k, v in loadmat(path, simplify_cells=True).items() if not k.startswith("__")})
    import h5py

    with h5py.File(path, "r") as file:
        return streams_of(arrays(file))


def arrays(group: Any, depth: int = 0) -> dict[str, Any]:
    """Return name → array or group of an HDF5 group: no links, which may lead anywhere, nothing of MATLAB's own."""
    import h5py

    found: dict[str, Any] = {}
    for name in group:
        if name.startswith("#") or not isinstance(group.get(name, getlink=True), h5py.HardLink):
            continue
        inner = group[name]
        if isinstance(inner, h5py.Group) and depth < DEEPEST:
            found[name] = arrays(inner, depth + 1)
        elif isinstance(inner, h5py.Dataset) and (inner.dtype.names or inner.dtype.kind in "biuf"):
            check_size(group.file.filename, inner.nbytes, LogError)
            found[name] = inner[()]
    return found
