"""Measured, modelled and residual torque as recordings for viewers of robots."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory

from lxml import etree

from gimbal_pin.diagnosis import TorqueTrace, trace_torques
from gimbal_pin.dynamics.model import Model
from gimbal_pin.errors import UsageError
from gimbal_pin.log.io.files import open_replacement, wrap_os_errors
from gimbal_pin.log.log import Log
from gimbal_pin.regression import Filtering
from gimbal_pin.rig.meshes import find_mesh_file
from gimbal_pin.rig.rig import Rig
from gimbal_pin.rig.urdf import parse_robot, to_text


def check_recordings(mcap: Path | None, rrd: Path | None) -> None:
    """Raise `UsageError` if a recording is asked for whose package is not there."""
    needed = (("--mcap", mcap, "mcap_ros2", "mcap"), ("--rrd", rrd, "rerun", "rerun"))
    for option, path, package, extra in needed:
        if path is not None and find_spec(package) is None:
            raise UsageError(
                option, f"needs the package {package}", f"pip install 'gimbal-pin[{extra}]'"
            )


def write_recordings(
    model: Model, logs: Sequence[Log], filtering: Filtering, mcap: Path | None, rrd: Path | None
) -> None:
    """Write the recordings that are asked for, of a model along the logs."""
    if mcap is None and rrd is None:
        return
    traces = [trace_torques(model, log, filtering) for log in logs]
    if mcap is not None:
        write_mcap(model.rig, traces, mcap)
    if rrd is not None:
        write_rrd(model.rig, traces, rrd)


def write_mcap(rig: Rig, traces: Sequence[TorqueTrace], path: Path) -> None:
    """Write ``measured``, ``model`` and ``residual`` as sensor_msgs/JointState, and the URDF as robot_description.

    Position and velocity are the log's, effort is the torque, N m. Of several logs the k-th has topics
    ``log_k/measured`` and so on. The file is written whole or not at all.
    """
    from mcap_ros2.writer import Writer

    stamp = "int32 sec\nuint32 nanosec"
    parts = {
        "std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id",
        "builtin_interfaces/Time": stamp,
    }
    fields = "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort"
    definition = "".join(
        [fields, *(f"\n{80 * '='}\nMSG: {name}\n{own}" for name, own in parts.items())]
    )
    origin = min(0.0, *(float(trace.t[0]) for trace in traces))  # stamps are not negative
    with open_replacement(path) as temporary, wrap_os_errors(path), temporary.open("wb") as file:
        writer = Writer(file)
        text = writer.register_msgdef("std_msgs/msg/String", "string data")
        state = writer.register_msgdef("sensor_msgs/msg/JointState", definition)
        first = min(float(trace.t[0]) for trace in traces) - origin
        writer.write_message("/robot_description", text, {"data": rig.urdf}, round(1e9 * first))
        named = [
            (k, trace, *pair)
            for k, trace in enumerate(traces, start=1)
            for pair in trace.torques.items()
        ]
        for k, trace, kind, torques in named:
            topic = f"/{kind}" if len(traces) == 1 else f"/log_{k}/{kind}"
            rows = zip(trace.t.tolist(), trace.q.tolist(), trace.v.tolist(), torques.tolist())
            for t, position, velocity, torque in rows:
                at = round(1e9 * (t - origin))
                header = {"stamp": {"sec": at // 10**9, "nanosec": at % 10**9}, "frame_id": ""}
                values = {"position": position, "velocity": velocity, "effort": torque}
                writer.write_message(
                    topic, state, {"header": header, "name": list(trace.joints), **values}, at
                )
        writer.finish()


def write_rrd(rig: Rig, traces: Sequence[TorqueTrace], path: Path) -> None:
    """Write the URDF's scene that moves as the log, angles, and ``torque/JOINT/measured``, ``model`` and ``residual``.

    The timeline is ``time``, s; of several logs each has its own, ``log_1`` and so on. Whole or not at all.
    """
    import rerun as rr
    from rerun import blueprint as rrb
    from rerun.urdf import UrdfTree

    robot = parse_robot(rig.urdf, str(rig.path))
    etree.strip_elements(robot, "collision")
    for mesh in robot.iter("mesh"):
        if (file := find_mesh_file(mesh.get("filename", ""), rig.path.parent)) is not None:
            mesh.set("filename", str(file))
    plots = [
        rrb.TimeSeriesView(origin=f"/torque/{joint}", name=f"{joint}: torque")
        for joint in rig.joints
    ]
    views = rrb.Horizontal(rrb.Spatial3DView(origin="/", name=rig.title), rrb.Vertical(*plots))
    with open_replacement(path) as temporary, wrap_os_errors(path), TemporaryDirectory() as folder:
        written = Path(folder, "rig.urdf")
        written.write_text(to_text(robot), encoding="utf-8")
        recording = rr.RecordingStream(f"gimbal_pin: {rig.title}")
        recording.save(temporary, default_blueprint=rrb.Blueprint(views))
        tree = UrdfTree.from_file_path(written)
        tree.log_urdf_to_recording(recording)
        hinges = {hinge.name: hinge for hinge in tree.joints()}
        for k, trace in enumerate(traces, start=1):
            clock = [rr.TimeColumn("time" if len(traces) == 1 else f"log_{k}", duration=trace.t)]
            for j, (joint, q) in enumerate(zip(trace.joints, trace.q.T)):
                moved = hinges[joint].compute_transform_columns(q.tolist(), clamp=False)
                recording.send_columns(f"/joint/{joint}", clock, moved)
                recording.send_columns(f"/angle/{joint}", clock, rr.Scalars.columns(scalars=q))
                for kind, torque in trace.torques.items():
                    values = rr.Scalars.columns(scalars=torque[:, j])
                    recording.send_columns(f"/torque/{joint}/{kind}", clock, values)
        recording.disconnect()
