"""Meshes that a URDF names: those of the usual formats are read; what is none harms nothing and tells nothing."""

from __future__ import annotations

import os
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


def exported(kind: str) -> bytes:
    """Return the box in a format."""
    data = BOX.export(file_type=kind)
    return data if isinstance(data, bytes) else data.encode()


def test_every_usual_format_and_name_is_read_and_written_again(tmp_path: Path) -> None:
    (tmp_path / "meshes").mkdir()
    (tmp_path / "robot" / "urdf").mkdir(parents=True)
    names = []
    for kind in KINDS:
        file = tmp_path / "meshes" / f"{kind}.{kind.partition('_')[0]}"
        file.write_bytes(exported(kind))
        names += [f"../../meshes/{file.name}", f"package://meshes/{file.name}", f"file://{file}"]
    found = find_meshes(names, tmp_path / "robot" / "urdf")
    for name, mesh in found.items():
        assert isinstance(mesh, Mesh), f"{name} {mesh}"
        stream = trimesh.util.wrap_as_stream(encode_stl(mesh))
        for again in (mesh, trimesh.load_mesh(stream, file_type="stl")):
            solid = trimesh.Trimesh(again.vertices, again.faces)
            assert np.allclose(np.sort(solid.bounds, axis=0), BOX.bounds, atol=1e-7)
            assert solid.volume == pytest.approx(BOX.volume, rel=1e-6)


def test_what_is_no_mesh_harms_nothing_and_tells_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(meshes, "READER_SECONDS", 2)  # of which loading trimesh takes one
    (tmp_path / "secret").write_text(SECRET)
    outside = f"<!DOCTYPE C [<!ENTITY e SYSTEM 'file://{tmp_path}/secret'>]>"
    unread = {f"secret.{suffix}": SECRET for suffix in ("stl", "obj", "ply", "dae", "glb", "zip")}
    unread |= {
        "outside.dae": outside + COLLADA.format("&e;"),
        "many.ply": "ply\nformat ascii 1.0\nelement vertex 99999999999\nproperty float x\nend_header\n0\n",
        "nan.off": "OFF\n3 1 0\nnan 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
        "beyond.obj": "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n",
        "far.off": "OFF\n3 1 0\n1e99 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
        "empty.stl": "",
    }
    others = f"mtllib {tmp_path}/pipe.stl\nmtllib /dev/zero\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
    for name, content in {**unread, "others.obj": others}.items():
        (tmp_path / name).write_text(content)
    with (tmp_path / "large.stl").open("wb") as large:
        large.truncate(5 * 2**30)
    os.mkfifo(tmp_path / "pipe.stl")
    (tmp_path / "device.stl").symlink_to("/dev/zero")
    (tmp_path / "circle.stl").symlink_to("circle.stl")
    absent = ("pipe.stl", "device.stl", "circle.stl", "n" * 5000, "http://127.0.0.1/a.stl", "", "/")
    found = dict(find_meshes([*unread, *absent, "large.stl", "others.obj"], tmp_path))
    assert isinstance(found.pop("others.obj"), Mesh)
    assert {name for name, mesh in found.items() if mesh == "is not there"} == set(absent)
    assert {found[name] for name in (*unread, "large.stl")} == {"cannot be read"}
    assert capfd.readouterr() == ("", "")
