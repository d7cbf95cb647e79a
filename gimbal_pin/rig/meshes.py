"""The mesh files that a URDF names: found, and read as triangles, however damaged they are."""

from __future__ import annotations

import io
import os
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np

from gimbal_pin.rig.bounded import ProcessStopped, run_bounded

_MESH_FORMATS = (".stl", ".obj", ".ply", ".off", ".dae", ".glb")
"""Formats that trimesh reads whole from one stream: no archive, no need of files beside it."""

_LARGEST_FILE = 32 * 2**20
"""Largest file, bytes: 670 000 triangles in a binary STL, more than a browser turns smoothly."""

READER_MEMORY = 2 * 2**30
READER_SECONDS = 5
"""Address space, bytes, and processor time, s, of the reading of one file. One of `_LARGEST_FILE` bytes takes 1.1 GiB
and 5 s in the slowest format, OFF; 1 GiB and 1.5 to 2 s as STL, OBJ or COLLADA."""


class Mesh(NamedTuple):
    """Triangles.

    Attributes:
        vertices: Points, m, (N, 3), finite.
        faces: Three rows of `vertices` each, (M, 3), M > 0.
    """

    vertices: np.ndarray[Any, np.dtype[np.float64]]
    faces: np.ndarray[Any, Any]


def find_mesh_file(name: str, folder: Path) -> Path | None:
    """Return the regular file that a URDF's mesh name means, seen from the URDF's folder; None if there is none.

    ``package://pkg/rest`` is sought as ``pkg/rest`` and ``rest`` in the folder and in those above it.
    """
    inside = name.removeprefix("package://")
    candidates = [folder / name.removeprefix("file://")]
    if inside != name:
        tails = (inside, inside.partition("/")[2])
        candidates = [above / tail for above in (folder, *folder.parents) for tail in tails]
    return next((file.resolve() for file in candidates if os.path.isfile(file)), None)


def list_sources(rig: Path, arguments: Mapping[str, str]) -> list[Path]:
    """Return the file of a rig or payload, what it includes, and the meshes that it names; `arguments`: xacro's."""
    from gimbal_pin.rig.formats import convert_to_urdf
    from gimbal_pin.rig.urdf import parse_robot

    text, _, included = convert_to_urdf(rig, arguments)
    named = [mesh.get("filename", "") for mesh in parse_robot(text, str(rig)).iter("mesh")]
    meshes = (find_mesh_file(name, rig.parent) for name in named)
    return [rig, *map(Path, included), *(file for file in meshes if file is not None)]


def find_meshes(names: Iterable[str], folder: Path) -> Mapping[str, Mesh | str]:
    """Return the mesh that each name means, seen from the URDF's folder, or why there is none."""
    files = {name: find_mesh_file(name, folder) for name in names}
    read = _read_meshes(file for file in files.values() if file is not None)
    return {
        name: "is not there" if file is None else read.get(file, "cannot be read")
        for name, file in files.items()
    }


def _read_meshes(files: Iterable[Path]) -> Mapping[Path, Mesh]:
    """Return the meshes of those files that can be read; nothing in the others is shown, nor files beside them opened.

    trimesh is not made for untrusted files, so each is read in a process of its own with bounds (`bounded`).
    """
    wanted = [file for file in dict.fromkeys(files) if file.suffix.lower() in _MESH_FORMATS]
    if not wanted:
        return {}
    with TemporaryDirectory() as folder:
        Path(folder, "names").write_bytes(b"\0".join(map(os.fsencode, wanted)))
        with suppress(ProcessStopped):
            run_bounded(__name__, folder, memory=READER_MEMORY, seconds=READER_SECONDS)
        made = {file: Path(folder, f"{k}.npz") for k, file in enumerate(wanted)}
        return {file: _load_mesh(out) for file, out in made.items() if out.exists()}


def _load_mesh(file: Path) -> Mesh:
    """Return a mesh that `main` wrote."""
    with np.load(file, allow_pickle=False) as data:
        return Mesh(data["vertices"], data["faces"])


def main(folder: str) -> None:
    """Write the mesh of the k-th file that ``names`` in a folder holds, NUL between them, as ``<k>.npz`` there.

    Each is read by a process of its own, so that an error or a bound ends that one alone.
    """
    import trimesh

    for k, name in enumerate(Path(folder, "names").read_bytes().split(b"\0")):
        if child := os.fork():
            os.waitpid(child, 0)
            continue
        try:
            file = Path(os.fsdecode(name))
            with file.open("rb") as stream:
                content = stream.read(_LARGEST_FILE + 1)
            if len(content) <= _LARGEST_FILE:
                mesh = trimesh.load_mesh(io.BytesIO(content), file_type=file.suffix[1:])
                _write_mesh(
                    Mesh(np.asarray(mesh.vertices, float), np.asarray(mesh.faces)),
                    Path(folder, f"{k}.npz"),
                )
        finally:
            os._exit(0)  # at once: the interpreter takes a quarter of a second to end


def _write_mesh(mesh: Mesh, file: Path) -> None:
    """Write a mesh, whole, if its arrays are of triangles."""
    vertices, faces = mesh
    if vertices.shape[1:] != (3,) or faces.shape[1:] != (3,) or not len(faces):
        return
    # What is drawn and measured is single precision.
    if np.isfinite(vertices.astype(np.float32)).all() and 0 <= faces.min() <= faces.max() < len(
        vertices
    ):
        half = file.with_suffix(".half.npz")
        np.savez(half, vertices=vertices, faces=faces)
        half.replace(file)


def encode_stl(mesh: Mesh) -> bytes:
    """Return a mesh as a binary STL."""
    records = np.zeros(
        len(mesh.faces), [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("colour", "<u2")]
    )
    records["corners"] = mesh.vertices[mesh.faces]
    return bytes(80) + len(records).to_bytes(4, "little") + records.tobytes()
