"""Scene objects and commands as meshcat's viewer reads them: three.js JSON in plain dictionaries.

Written here and not through meshcat's Python classes, which name every object by a random UUID: the same rig and log
give the same bytes, and one object may hold a whole link.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from gimbal_pin.log.log import Array

Json = dict[str, Any]
"""What `umsgpack` packs: dictionaries, lists, numbers, texts and typed arrays."""

IDENTITY = np.eye(4)


@dataclass(frozen=True, eq=False)
class Drawable:
    """One drawable: a geometry at a place in its link, with a material.

    Attributes:
        geometry: three.js geometry without its uuid.
        placement: Pose in the link's group, (4, 4).
        material: three.js material without its uuid.
        kind: three.js object type: Mesh, Line or LineSegments.
        casts: Whether it casts a shadow.
        receives: Whether shadows fall on it.
        order: Render order; later ones are drawn over earlier ones where they are translucent.
    """

    geometry: Json
    placement: Array
    material: Json
    kind: str = "Mesh"
    casts: bool = False
    receives: bool = False
    order: int = 0


def pose(origin: Array, turn: Array = IDENTITY[:3, :3]) -> Array:
    """Return the pose whose origin is `origin`, m, (3,), turned by `turn`, (3, 3): (4, 4)."""
    return np.asarray(pin.SE3(turn, np.asarray(origin, dtype=float)).homogeneous)


def floats(values: Any) -> Any:
    """Return the numbers as a packed Float32Array (msgpack extension 0x17 of the viewer)."""
    import umsgpack

    return umsgpack.Ext(0x17, np.ascontiguousarray(values, dtype="<f4").tobytes())


def indices(values: Any) -> Any:
    """Return the integers as a packed Uint32Array (msgpack extension 0x16 of the viewer)."""
    import umsgpack

    return umsgpack.Ext(0x16, np.ascontiguousarray(values, dtype="<u4").tobytes())


def matrix(pose: Array) -> list[float]:
    """Return a 4 × 4 pose as three.js stores it: sixteen numbers, column by column."""
    return [float(x) for x in np.asarray(pose).T.ravel()]


def buffer(positions: Array, faces: Array | None = None, colours: Array | None = None) -> Json:
    """Return a geometry of points (N, 3), with triangles (M, 3) and colours RGBA (N, 4) if given."""
    of_points = (
        {"position": positions} if colours is None else {"position": positions, "color": colours}
    )
    plain: Json = {"normalized": False}
    data: Json = {
        "attributes": {
            name: {
                "itemSize": np.shape(values)[1],
                "type": "Float32Array",
                "array": floats(values),
                **plain,
            }
            for name, values in of_points.items()
        }
    }
    if faces is not None:
        data["index"] = {"itemSize": 1, "type": "Uint32Array", "array": indices(faces), **plain}
    return {"type": "BufferGeometry", "data": data}


def hex_colour(rgb: Sequence[float]) -> int:
    """Return red, green, blue in 0..1 as 0xRRGGBB."""
    red, green, blue = (round(255 * min(max(float(x), 0.0), 1.0)) for x in rgb[:3])
    return red << 16 | green << 8 | blue


def glossy(rgba: Sequence[float], **more: Any) -> Json:
    """Return a lit material with a soft highlight; alpha under 1 makes it translucent."""
    alpha = float(rgba[3]) if len(rgba) > 3 else 1.0
    look = {
        "type": "MeshPhongMaterial",
        "color": hex_colour(rgba),
        "specular": 0x3C4046,
        "shininess": 30,
    }
    return {**look, "opacity": alpha, "transparent": alpha < 1, **more}


def flat(
    rgb: Sequence[float], opacity: float = 1.0, kind: str = "MeshBasicMaterial", **more: Any
) -> Json:
    """Return a plain material, unlit if not said otherwise; translucent ones do not hide what is behind them."""
    look = {"type": kind, "color": hex_colour(rgb), "opacity": opacity}
    return {**look, "transparent": opacity < 1, "depthWrite": opacity >= 1, **more}


def draw_group(path: str, parts: Sequence[Drawable], prefix: str) -> Json:
    """Return the command that puts parts at a path as one object; part k is named `<prefix>k`, equal materials are one.

    In three.js's names: `<prefix>g<k>` is the geometry of part k, `<prefix>m<k>` material k.
    """
    materials: list[Json] = []
    children = []
    for k, part in enumerate(parts):
        if part.material not in materials:
            materials.append(part.material)
        children.append(
            {
                "uuid": f"{prefix}{k}",
                "name": f"{prefix}{k}",
                "type": part.kind,
                "geometry": f"{prefix}g{k}",
                "material": f"{prefix}m{materials.index(part.material)}",
                "matrix": matrix(part.placement),
                "castShadow": part.casts,
                "receiveShadow": part.receives,
                "renderOrder": part.order,
            }
        )
    drawn = {"uuid": prefix, "type": "Group", "matrix": matrix(IDENTITY), "children": children}
    geometries = [{**part.geometry, "uuid": f"{prefix}g{k}"} for k, part in enumerate(parts)]
    named = [{**material, "uuid": f"{prefix}m{k}"} for k, material in enumerate(materials)]
    return draw_object(path, drawn, geometries=geometries, materials=named)


def draw_object(path: str, drawn: Json, **uses: Sequence[Json]) -> Json:
    """Return the command that puts an object at a path of the scene tree; `uses`: what its parts name."""
    scene_object = {"metadata": {"version": 4.5, "type": "Object"}, **uses, "object": drawn}
    return {"type": "set_object", "path": path, "object": scene_object}


def command_pose(path: str, pose: Array) -> Json:
    """Return the command that sets the pose of everything at and under a path."""
    return {"type": "set_transform", "path": path, "matrix": matrix(pose)}


def let(path: str, key: str, value: Any) -> Json:
    """Return the command that sets a property (meshcat's own sender lower-cases its name, which three.js is not)."""
    return {"type": "set_property", "path": path, "property": key, "value": value}


def animate_property(name: str, kind: str, times: Array, values: Array) -> Json:
    """Return one animated property: times (F,), s, values (F, width), or (F,) of the kind "bool"."""
    packed = [bool(x) for x in values] if kind == "bool" else floats(values)
    return {"name": name, "type": kind, "times": floats(times), "values": packed}


def play_tracks(clips: Mapping[str, Sequence[Json]], path: str) -> Json:
    """Return the command that plays the tracks of each scene path, for ever.

    `path`: where the server keeps the command: it replays its tree in order, so a path made last is sent last.
    """
    animations = [
        {"path": where, "clip": {"fps": 1, "name": "motion", "tracks": list(tracks)}}
        for where, tracks in clips.items()
    ]
    options = {"play": True, "repetitions": 1_000_000_000, "clampWhenFinished": True}
    return {"type": "set_animation", "path": path, "animations": animations, "options": options}
