"""Recordings as the tools' own readers find them: what was measured is what the model says and what it leaves."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from gimbal_pin.diagnosis import TorqueTrace, trace_torques
from gimbal_pin.dynamics import nominal
from gimbal_pin.effects import Cogging, Term
from gimbal_pin.export import write_mcap, write_rrd
from gimbal_pin.log import read_log, write_log
from tests.command_line import Run, refused
from tests.refitted import plant, record
from tests.rigs import bundled

KINDS = ("measured", "model", "residual")
TURRET = bundled("turret")
LOG = record(plant(Term(Cogging("pan", (7.0,)), (0.05, 0.0))), 3, dt=4e-3)


@pytest.fixture(scope="module")
def trace() -> TorqueTrace:
    """What the model without teeth leaves of the log of one with."""
    return trace_torques(nominal(TURRET), LOG)


def test_mcaps_own_reader_finds_the_numbers(trace: TorqueTrace, tmp_path: Path) -> None:
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    write_mcap(TURRET, [trace], tmp_path / "one.mcap")
    with (tmp_path / "one.mcap").open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        found = [(one[1].topic, one[2].log_time, one[3]) for one in reader.iter_decoded_messages()]
    assert {topic for topic, _, _ in found} == {"/robot_description", *(f"/{x}" for x in KINDS)}
    for kind in KINDS:
        rows = [(time, said) for topic, time, said in found if topic == f"/{kind}"]
        np.testing.assert_allclose([1e-9 * time for time, _ in rows], trace.t, atol=1e-9)
        assert rows[0][1].name == list(trace.joints)
        np.testing.assert_array_equal([one.position for _, one in rows], trace.q)
        np.testing.assert_array_equal([one.velocity for _, one in rows], trace.v)
        np.testing.assert_array_equal([one.effort for _, one in rows], getattr(trace, kind))


def test_reruns_own_reader_finds_the_numbers_and_the_poses(
    trace: TorqueTrace, tmp_path: Path
) -> None:
    """Each joint's transform is Pinocchio's placement of it."""
    pytest.importorskip("rerun")
    from rerun.chunk import RrdReader

    write_rrd(TURRET, [trace], tmp_path / "one.rrd")
    chunks = RrdReader(tmp_path / "one.rrd").stream().to_chunks()
    found = {chunk.entity_path: chunk.to_record_batch() for chunk in chunks}
    data = TURRET.model.createData()
    pin.forwardKinematics(TURRET.model, data, trace.q[700])
    for j, joint in enumerate(TURRET.joints):
        for kind in KINDS:
            batch = found[f"/torque/{joint}/{kind}"]
            scalars = np.concatenate(batch["Scalars:scalars"].to_numpy(False))
            np.testing.assert_array_equal(scalars, trace.torques[kind][:, j])
            stamps = 1e-9 * np.array(batch["time"].cast("int64"))
            np.testing.assert_allclose(stamps, trace.t, atol=2e-9)
        moved = found[f"/joint/{joint}"]
        turn = pin.Quaternion(np.array(moved["Transform3D:quaternion"][700].as_py()[0]))
        place = moved["Transform3D:translation"][700].as_py()[0]
        pose = data.liMi[j + 1]
        np.testing.assert_allclose(turn.toRotationMatrix(), pose.rotation, atol=1e-6)
        np.testing.assert_allclose(place, pose.translation, atol=1e-6)


def test_a_verb_records_the_log_with_what_is_left(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Our own reader of bags finds it again. Without the package nothing is begun."""
    out = tmp_path / "out.mcap"
    write_log(LOG, tmp_path / "log.csv")
    words = ("identify", "turret", tmp_path / "log.csv", "--mcap", out)
    assert run(*words, "--alignment", "0")[0] == 0
    columns = ("q_pan", "q_tilt", "tau_pan", "tau_tilt")
    measured, model, left = (
        read_log(out, TURRET, [f"{column}=/{kind}.{column}" for column in columns]).tau
        for kind in KINDS
    )
    np.testing.assert_allclose(measured - model, left, atol=1e-12)
    monkeypatch.setattr("gimbal_pin.export.recordings.find_spec", lambda name: None)
    refused(run(*words), 2, "--mcap", "pip install 'gimbal-pin[mcap]'")
