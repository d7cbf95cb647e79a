"""Models as YAML: what `identify -o` writes and `tune` reads."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from gimbal_pin.dynamics.model import Doubt, Estimated, Model, read_model_data
from gimbal_pin.dynamics.reduction import reduce_parameters
from gimbal_pin.errors import ModelError
from gimbal_pin.identification.identified import IdentificationResult
from gimbal_pin.log.io.files import write_yaml
from gimbal_pin.regression import map_phi_to_base
from gimbal_pin.rig.reading import read_yaml
from gimbal_pin.rig.records import bounded_field, convert_value, read_record
from gimbal_pin.rig.rig import Rig
from gimbal_pin.rig.structure import SCHEMA, check_origin, describe_structure

KIND = "gimbal_pin model"


def write_model(
    identified: IdentificationResult,
    path: str | Path,
    payloads: Mapping[str, IdentificationResult] | None = None,
) -> None:
    """Write a model with its parameters' covariance, whole or not at all.

    `payloads`: the same gimbal with other payloads, by their names; `read_model` takes the one that is mounted.
    """
    content = {
        "kind": KIND,
        "schema": SCHEMA,
        "joints": list(identified.model.rig.joints),
        "structure": describe_structure(identified.model.rig),
        **_describe_payload_model(identified, path),
    }
    if payloads is not None:
        content["payloads"] = {
            name: _describe_payload_model(one, path) for name, one in payloads.items()
        }
    write_yaml(content, path)


def _describe_payload_model(identified: IdentificationResult, path: str | Path) -> dict[str, Any]:
    """Return the part of a file that speaks of one payload."""
    model = identified.model
    known = identified.model.estimated
    if known is None:
        raise ModelError(
            str(path), "would hold a model that was not identified", "identify one first"
        )
    report = identified.to_dict()
    report.pop("schema")
    return {
        **report,
        "phi": model.rig.phi.tolist(),
        "terms": [term.to_dict() for term in model.terms],
        **describe_uncertainty(known),
        "base_parameters": report["base_parameters"],
        **_describe_doubts(model),
    }


def write_extended(model: Model, path: str | Path) -> None:
    """Write a model with all that `diagnose` found, and its uncertainty where it is known."""
    rig = model.rig
    rows = {
        "joints": list(rig.joints),
        "rig": rig.name,
        "payload": rig.payload,
        "structure": describe_structure(rig),
    }
    write_yaml(
        {
            "kind": KIND,
            "schema": SCHEMA,
            **rows,
            **model.to_dict(),
            **describe_uncertainty(model.estimated),
            **_describe_doubts(model),
        },
        path,
    )


def _describe_doubts(model: Model) -> dict[str, Any]:
    """Return what does not hold as `_read_doubts` reads it."""
    return {"doubts": [asdict(doubt) for doubt in model.doubts]}


def describe_uncertainty(estimated: Estimated | None) -> dict[str, Any]:
    """Return values and covariance of the parameters, and the rest, as `read_known_parameters` reads them."""
    if estimated is None:
        return {}
    columns = estimated.names, estimated.theta.tolist(), estimated.std.tolist(), estimated.units
    rows = [dict(zip(("name", "value", "std", "unit"), row)) for row in zip(*columns)]
    rest = {name: list(getattr(estimated, name)) for name in ("missed", "noise", "pure_error")}
    rest |= {
        name: list(getattr(estimated, name))
        for name in ("lags", "lag_std", "angle_noise", "digests")
    }
    rest["misfit"] = [list(row) for row in estimated.misfit]
    return {
        "base_parameters": rows,
        "covariance": estimated.covariance.tolist(),
        "dt": estimated.dt,
        **rest,
    }


def read_model(path: str | Path, rig: Rig) -> Model:
    """Read a model that `write_model` or `write_extended` wrote for a rig with its joints; of several payloads its own.

    Raises:
        ModelError: The file is of another kind, schema, rig or payload, lacks something, or contradicts itself.
    """
    own = _read_own_part(path, rig)
    model = replace(read_model_data(own, rig, str(path)), doubts=_read_doubts(own, str(path)))
    if "covariance" not in own:
        return model
    known = read_known_parameters(own, str(path), rig.n)
    if not own.get("physical", True):  # no body has these base parameters: phi is only the nearest
        return replace(model, estimated=known)
    reduction = reduce_parameters(rig)
    sums = dict(zip(reduction.base_names, map_phi_to_base(rig, reduction) @ model.rig.phi))
    for name, value, std in zip(known.names, known.theta.tolist(), known.std.tolist()):
        # Both are written from one estimate: only rounding separates them. Changes of the rig alter the sums.
        if not (
            model.changes or np.isclose(sums.get(name, value), value, rtol=1e-6, atol=1e-3 * std)
        ):
            what = f"is {value:.6g}, and phi gives {sums[name]:.6g}"
            raise ModelError(f"{path}: base parameter {name}", what, "identify the model again")
    return replace(model, estimated=known)


def _read_doubts(data: Mapping[str, Any], path: str) -> tuple[Doubt, ...]:
    """Return what a file says that does not hold; nothing where it is older than that."""
    rows = convert_value(tuple[Any, ...], data.get("doubts", []), f"{path}: doubts", ModelError)
    return tuple(
        read_record(Doubt, row, f"{path}: doubts[{k}]", ModelError) for k, row in enumerate(rows)
    )


def read_known(path: str | Path, rig: Rig) -> Model:
    """Read what such a file knows of a gimbal, for `identify_new`: the bodies are the rig's.

    What was estimated from little motion or much noise need not be the inertia of any body: nothing is simulated here.

    Raises:
        ModelError: As `read_model` does, and where the file states no covariance.
    """
    own = _read_own_part(path, rig)
    return replace(
        read_model_data({**own, "phi": rig.phi.tolist()}, rig, str(path)),
        estimated=read_known_parameters(own, str(path), rig.n),
    )


def _read_own_part(path: str | Path, rig: Rig) -> Mapping[str, Any]:
    """Return what a model's file says of a rig with its payload."""
    data = read_yaml(path, ModelError)
    if not isinstance(data, dict) or data.get("kind") != KIND:
        mend = (
            "give a file that 'gimbal-pin identify -o' wrote, or the extended.yaml of 'diagnose -o'"
        )
        raise ModelError(str(path), "is not a model", mend)
    if data.get("joints") != list(rig.joints):
        mend = f"the rig {rig.name} has {', '.join(rig.joints)}: identify it"
        raise ModelError(str(path), f"is for the joints {data.get('joints')}", mend)
    check_origin(data, rig, str(path))
    payloads = convert_value(
        Mapping[str, Any], data.get("payloads", {}), f"{path}: payloads", ModelError
    )
    own: Mapping[str, Any] = payloads.get(rig.payload, data)
    if (carried := own.get("payload", rig.payload)) != rig.payload:
        what = f"is of the payload {carried}" if carried else "is of the rig without a payload"
        here = f"the rig {rig.name} carries {rig.payload or 'none'} here"
        raise ModelError(
            str(path), what, f"{here}: name the URDF of the model's as 'payload:' in the rig's YAML"
        )
    return own


@dataclass(frozen=True)
class StoredParameter:
    """A parameter of a model file."""

    name: str
    value: float
    unit: str


NUMBERS_PER_JOINT = ("missed", "misfit", "noise", "pure_error", "lags", "lag_std", "angle_noise")
"""Entries of `StoredUncertainty` that have a number, or a list of them, for every joint."""


@dataclass(frozen=True)
class StoredUncertainty:
    """The part of a model file that says how sure its parameters are."""

    base_parameters: tuple[Any, ...]
    covariance: tuple[tuple[float, ...], ...]
    dt: float | None = bounded_field(None, 1e-6, 1.0)  # between what `tune` can sample at
    missed: tuple[float, ...] = ()
    misfit: tuple[tuple[float, ...], ...] = ()
    noise: tuple[float, ...] = ()
    pure_error: tuple[float, ...] = ()
    lags: tuple[float, ...] = ()
    lag_std: tuple[float, ...] = ()
    angle_noise: tuple[float, ...] = ()
    digests: tuple[str, ...] = ()


def read_known_parameters(data: Any, place: str, joint_count: int) -> Estimated:
    """Return the parameters' uncertainty from a model file; `ModelError` if that is none.

    Its lists of numbers per joint have `joint_count` entries, or none where the file is older than they are.

    The correlations' matrix has no negative eigenvalue but for rounding: a millionth, as whoever writes digits may.
    """
    filed = read_record(StoredUncertainty, data, place, ModelError, others=True)
    for name in NUMBERS_PER_JOINT:
        length = len(getattr(filed, name))
        if length not in (0, joint_count) or (name == "lag_std" and length < len(filed.lags)):
            what = f"has {length} entries for {joint_count} joints"
            raise ModelError(f"{place}: {name}", what, "identify the model again")
    places = [f"{place}: base_parameters[{k}]" for k in range(len(filed.base_parameters))]
    rows = [
        read_record(StoredParameter, row, where, ModelError, others=True)
        for row, where in zip(filed.base_parameters, places)
    ]
    count = len(rows)
    if len(filed.covariance) != count or any(len(row) != count for row in filed.covariance):
        mend = f"give {count} by {count} numbers, one row for each of base_parameters"
        raise ModelError(f"{place}: covariance", "has another shape than its parameters", mend)
    covariance = np.array(filed.covariance).reshape(count, count)
    std = np.sqrt(np.abs(np.diag(covariance)))
    if not std.all():
        what = f"has no variance of {rows[int(np.argmin(std))].name}, and no estimate is exact"
        raise ModelError(f"{place}: covariance", what, "identify the model again")
    correlation = covariance / np.outer(
        *[np.maximum(std, 1e-150)] * 2
    )  # what has no variance has no covariance
    if (
        np.abs(correlation - correlation.T).max(initial=0.0) > 1e-6
        or (np.linalg.eigvalsh(correlation) < -1e-6).any()
    ):
        raise ModelError(
            f"{place}: covariance", "is not that of any estimate", "identify the model again"
        )
    names = tuple(row.name for row in rows)
    units = tuple(row.unit for row in rows)
    values = np.array([row.value for row in rows])
    rest = (filed.dt, filed.missed, filed.misfit, filed.noise, filed.pure_error)
    return Estimated(
        names,
        units,
        values,
        covariance,
        *rest,
        filed.lags,
        filed.lag_std,
        filed.angle_noise,
        filed.digests,
    )


def is_model(path: str | Path) -> bool:
    """Whether a path is named like a model file rather than a log."""
    return Path(path).suffix in (".yaml", ".yml")
