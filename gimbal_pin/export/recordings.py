"""Measured, modelled and residual torque as recordings for viewers of robots."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from importlib.util import find_spec
from pathlib import Path

from gimbal_pin.diagnosis import TorqueTrace, trace_torques
from gimbal_pin.dynamics.model import Model
from gimbal_pin.errors import UsageError
from gimbal_pin.log.io.files import open_replacement, wrap_os_errors
from gimbal_pin.log.log import Array, Log
from gimbal_pin.regression import Filtering
from gimbal_pin.rig.rig import Rig


def check_recordings(mcap: Path | None) -> None:
    """Raise `UsageError` if a recording is asked for whose package is not there."""
    if mcap is not None and find_spec("mcap_ros2") is None:
        raise UsageError("--mcap", "needs the package mcap-ros2-support", "pip install 'gimbal-pin[mcap]'")


def write_recordings(model: Model, logs: Sequence[Log], filtering: Filtering, mcap: Path | None) -> None:
    """Write the recordings that are asked for, of a model along the logs."""
    if mcap is not None:
        write_mcap(model.rig, [trace_torques(model, log, filtering) for log in logs], mcap)


def list_torques(traces: Sequence[TorqueTrace]) -> Iterator[tuple[str, TorqueTrace, Array]]:
    """Yield name, trace and torque, N m, (m, n), of each trace: measured, the model's, and what is left."""
    for k, trace in enumerate(traces, start=1):
        before = "" if len(traces) == 1 else f"log_{k}/"
        yield from ((f"{before}{kind}", trace, getattr(trace, kind)) for kind in ("measured", "model", "residual"))


def write_mcap(rig: Rig, traces: Sequence[TorqueTrace], path: Path) -> None:
    """Write ``measured``, ``model`` and ``residual`` as sensor_msgs/JointState, and the URDF as robot_description.

    Position and velocity are the log's, effort is the torque, N m. Of several logs the k-th has topics
    ``log_k/measured`` and so on. The file is written whole or not at all.
    """
    from mcap_ros2.writer import Writer

    stamp = "int32 sec\nuint32 nanosec"
    parts = {"std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id", "builtin_interfaces/Time": stamp}
    fields = "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort"
    definition = "".join([fields, *(f"\n{80 * '='}\nMSG: {name}\n{own}" for name, own in parts.items())])
    origin = min(0.0, *(float(trace.t[0]) for trace in traces))  # stamps are not negative
    with open_replacement(path) as temporary, wrap_os_errors(path), temporary.open("wb") as file:
        writer = Writer(file)
        text = writer.register_msgdef("std_msgs/msg/String", "string data")
        state = writer.register_msgdef("sensor_msgs/msg/JointState", definition)
        first = min(float(trace.t[0]) for trace in traces) - origin
        writer.write_message("/robot_description", text, {"data": rig.urdf}, round(1e9 * first))
        for topic, trace, effort in list_torques(traces):
            rows = zip(trace.t.tolist(), trace.q.tolist(), trace.v.tolist(), effort.tolist())
            for t, position, velocity, torque in rows:
                at = round(1e9 * (t - origin))
                header = {"stamp": {"sec": at // 10**9, "nanosec": at % 10**9}, "frame_id": ""}
                values = {"position": position, "velocity": velocity, "effort": torque}
                writer.write_message(f"/{topic}", state, {"header": header, "name": list(trace.joints), **values}, at)
        writer.finish()
