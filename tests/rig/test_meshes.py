"""Meshes that a URDF names: those of the usual formats are read; what is none harms nothing and tells nothing."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import trimesh

from gimbal_pin.rig import Mesh, encode_stl, find_meshes, meshes

SECRET = "root:x:0:0:nobody reads this"
KINDS = ("stl", "stl_ascii", "obj", "ply", "off", "dae", "glb")
BOX = trimesh.creation.box((0.2, 0.4, 0.6))
COLLADA = (
    "<COLLADA xmlns='http://www.collada.org/2005/11/COLLADASchema' version='1.4.1'>{}</COLLADA>"
)
SCENE = "<library_visual_scenes><visual_scene id='s'>{}</visual_scene></library_visual_scenes>"
SCENE += "<scene><instance_visual_scene url='#s'/></scene>"


def exported(kind: str) -> bytes:
    """Return the box in a format."""
    data = BOX.export(file_type=kind)
    return data if isinstance(data, bytes) else data.encode()


def busy() -> str:
    """Return a COLLADA document of a few kilobytes that draws 2⁴⁰ nodes."""
    twice = "<node id='n{0}'><instance_node url='#n{1}'/><instance_node url='#n{1}'/></node>"
    nodes = "".join(twice.format(k, k + 1) for k in range(40)) + "<node id='n40'/>"
    return COLLADA.format(
        f"<library_nodes>{nodes}</library_nodes>"
        + SCENE.format("<node><instance_node url='#n0'/></node>")
    )


def mutated(folder: Path) -> Iterator[str]:
    """Write files that were meshes, some of them cut off, with three other bytes: yield their names."""
    rng = np.random.default_rng(3)
    for kind in KINDS:
        for k in range(4):
            content = np.frombuffer(exported(kind), np.uint8).copy()
            content[rng.integers(0, len(content), 3)] = rng.integers(0, 256, 3)
            name = f"{kind}{k}.{kind.partition('_')[0]}"
            (folder / name).write_bytes(
                content[: rng.integers(1, len(content)) if k % 2 else None].tobytes()
            )
            yield name


def test_every_usual_format_and_name_is_read_and_written_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("trimesh", "numpy", "resource"):  # what stands in the working directory is not run
        (tmp_path / f"{name}.py").write_text("raise SystemExit")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "meshes").mkdir()
    (tmp_path / "robot" / "urdf").mkdir(parents=True)
    names = []
    for kind in KINDS:
        file = tmp_path / "meshes" / f"{kind}.{kind.partition('_')[0]}"
        file.write_bytes(exported(kind))
        names += [f"../../meshes/{file.name}", f"package://meshes/{file.name}", f"file://{file}"]
    (tmp_path / "meshes" / "LINK.STL").symlink_to(tmp_path / "meshes" / "stl.stl")
    found = find_meshes([*names, "../../meshes/LINK.STL"], tmp_path / "robot" / "urdf")
    for name, mesh in found.items():
        assert isinstance(mesh, Mesh), f"{name} {mesh}"
        for again in (
            mesh,
            trimesh.load_mesh(trimesh.util.wrap_as_stream(encode_stl(mesh)), file_type="stl"),
        ):
            solid = trimesh.Trimesh(again.vertices, again.faces)
            assert np.allclose(np.sort(solid.bounds, axis=0), BOX.bounds, atol=1e-7)
            assert solid.volume == pytest.approx(BOX.volume, rel=1e-6)


def test_what_is_no_mesh_harms_nothing_and_tells_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(meshes, "READER_SECONDS", 2)  # of which loading trimesh takes one
    (tmp_path / "secret").write_text(SECRET)
    outside = f"<!DOCTYPE C [<!ENTITY e SYSTEM 'file://{tmp_path}/secret'>]>" + COLLADA.format(
        "&e;"
    )
    laughs = "".join(f"<!ENTITY l{k + 1} '{f'&l{k};' * 10}'>" for k in range(12))
    plain = {
        "far.obj": f"mtllib {tmp_path}/pipe.stl\nmtllib /dev/zero\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl a\nf 1 2 3\n",
        "secret.stl": SECRET, "secret.obj": SECRET, "secret.ply": SECRET, "secret.off": SECRET, "secret.dae": SECRET,
        "secret.glb": SECRET, "secret.3mf": SECRET, "secret.zip": SECRET, "secret": SECRET, "secret.gltf": SECRET,
        "outside.dae": outside, "busy.dae": busy(),
        "laughs.dae": f"<!DOCTYPE C [<!ENTITY l0 'ha'>{laughs}]>" + COLLADA.format("&l12;"),
        "many.ply": "ply\nformat ascii 1.0\nelement vertex 99999999999\nproperty float x\nend_header\n0\n",
        "nan.off": "OFF\n3 1 0\nnan 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
        "beyond.obj": "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n",
        "flat.obj": "v 0 0\nv 1 0\nv 0 1\nf 1 2 3\n", "far.off": "OFF\n3 1 0\n1e99 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
        "empty.stl": "",
    }  # fmt: skip
    for name, content in plain.items():
        (tmp_path / name).write_text(content)
    (tmp_path / "good.stl").write_bytes(exported("stl"))
    with (tmp_path / "large.stl").open("wb") as large:
        large.truncate(5 * 2**30)
    (tmp_path / "folder.stl").mkdir()
    os.mkfifo(tmp_path / "pipe.stl")
    (tmp_path / "device.stl").symlink_to("/dev/zero")
    (tmp_path / "circle.stl").symlink_to("circle.stl")
    absent = (
        "folder.stl",
        "pipe.stl",
        "device.stl",
        "circle.stl",
        "n" * 5000 + ".stl",
        "http://127.0.0.1/a.stl",
        "",
        "/",
    )
    broken = list(mutated(tmp_path))
    found = dict(find_meshes([*plain, *absent, *broken, "large.stl", "good.stl"], tmp_path))
    for mesh in map(found.pop, broken):
        if isinstance(mesh, Mesh):
            assert np.isfinite(mesh.vertices).all() and mesh.vertices[mesh.faces].shape == (
                len(mesh.faces),
                3,
                3,
            )
    assert {name for name, mesh in found.items() if isinstance(mesh, Mesh)} == {
        "far.obj",
        "good.stl",
    }
    assert {name for name, mesh in found.items() if mesh == "is not there"} == set(absent)
    assert {mesh for mesh in found.values() if isinstance(mesh, str)} == {
        "is not there",
        "cannot be read",
    }
    assert capfd.readouterr() == ("", "")
