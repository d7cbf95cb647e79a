"""Recordings as the tools' own readers find them: what was measured is what the model says and what it leaves."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from gimbal_pin.diagnosis import TorqueTrace, diagnose, trace_torques
from gimbal_pin.dynamics import Model, nominal, plant_with
from gimbal_pin.effects import Cogging, parse_effect
from gimbal_pin.export import write_mcap, write_rrd
from gimbal_pin.log import Log, read_log, write_log
from gimbal_pin.rig import Rig
from tests.bench_logs import prescribed
from tests.command_line import Run, refused
from tests.rigs import bundled

KINDS = ("measured", "model", "residual")


@pytest.fixture(scope="module")
def turret() -> Rig:
    return bundled("turret")


@pytest.fixture(scope="module")
def toothed(turret: Rig) -> tuple[Model, Log]:
    """A gimbal with teeth, and its log without noise."""
    model = plant_with(
        nominal(turret), [parse_effect("cogging:pan:amplitude=0.05,harmonic=7", turret)]
    ).plant
    return model, prescribed(model, 3, 8.0, dt=4e-3)


@pytest.fixture(scope="module")
def traces(toothed: tuple[Model, Log]) -> tuple[TorqueTrace, TorqueTrace]:
    """What the model with teeth leaves of the log, and what the one without does."""
    model, log = toothed
    found = trace_torques(model, log), trace_torques(nominal(model.rig), log)
    return found


def test_the_residual_is_what_the_model_lacks(traces: tuple[TorqueTrace, TorqueTrace]) -> None:
    """Away from where a joint turns round, where dry friction is a guess."""
    right, wrong = traces
    moving = np.abs(right.v[:, 0]) > 0.3
    teeth = 0.05 * np.cos(7 * right.q[:, 0])
    size = [float(np.sqrt(np.mean(trace.residual[moving, 0] ** 2))) for trace in traces]
    assert size[0] < 0.1 * size[1] and size[1] == pytest.approx(0.05 / np.sqrt(2), rel=0.2)
    assert abs(np.corrcoef(wrong.residual[moving, 0], teeth[moving])[0, 1]) > 0.9
    np.testing.assert_allclose(right.model + right.residual, right.measured, atol=1e-12)


def read_mcap(path: Path) -> dict[str, list[object]]:
    """Topic → decoded messages, as mcap's own reader gives them."""
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    out: dict[str, list[object]] = {}
    with path.open("rb") as file:
        for _, channel, message, said in make_reader(
            file, decoder_factories=[DecoderFactory()]
        ).iter_decoded_messages():
            out.setdefault(channel.topic, []).append((message.log_time, said))
    return out


def test_mcaps_own_reader_finds_the_numbers(
    turret: Rig, traces: tuple[TorqueTrace, ...], tmp_path: Path
) -> None:
    write_mcap(turret, traces[:1], tmp_path / "one.mcap")
    (trace, _) = traces
    found = read_mcap(tmp_path / "one.mcap")
    assert set(found) == {"/robot_description", *(f"/{kind}" for kind in KINDS)}
    assert [said.data for _, said in found["/robot_description"]] == [turret.urdf]
    for kind in KINDS:
        assert all(said.name == list(trace.joints) for _, said in found[f"/{kind}"])
        stamps = [
            said.header.stamp.sec * 10**9 + said.header.stamp.nanosec
            for _, said in found[f"/{kind}"]
        ]
        assert stamps == [at for at, _ in found[f"/{kind}"]]
        np.testing.assert_allclose(1e-9 * np.array(stamps), trace.t, atol=1e-9)
        for field, values in (
            ("position", trace.q),
            ("velocity", trace.v),
            ("effort", getattr(trace, kind)),
        ):
            np.testing.assert_array_equal(
                [getattr(said, field) for _, said in found[f"/{kind}"]], values
            )
        assert np.array_equal(trace.torques[kind], getattr(trace, kind))
    write_mcap(turret, traces, tmp_path / "two.mcap")
    assert {f"/log_{k}/{kind}" for k in (1, 2) for kind in KINDS} <= set(
        read_mcap(tmp_path / "two.mcap")
    )


def read_rrd(path: Path) -> dict[str, Any]:
    """Entity → its rows, as Rerun's own reader gives them; of what does not change one each."""
    from rerun.chunk import RrdReader

    reader = RrdReader(path)
    assert len(reader.recordings()) == len(reader.blueprints()) == 1
    return {chunk.entity_path: chunk.to_record_batch() for chunk in reader.stream().to_chunks()}


def test_reruns_own_reader_finds_the_numbers_and_the_poses(
    turret: Rig, traces: tuple[TorqueTrace, ...], tmp_path: Path
) -> None:
    """Each joint's transform is Pinocchio's placement of it."""
    pytest.importorskip("rerun")
    from rerun.chunk import RrdReader

    write_rrd(turret, traces[:1], tmp_path / "one.rrd")
    trace = traces[0]
    found = read_rrd(tmp_path / "one.rrd")
    model = turret.model
    data = turret.model.createData()
    for j, joint in enumerate(turret.joints):
        values = {kind: found[f"/torque/{joint}/{kind}"] for kind in KINDS}
        for kind, batch in values.items():
            np.testing.assert_array_equal(
                np.concatenate(batch["Scalars:scalars"].to_numpy(False)), trace.torques[kind][:, j]
            )
            stamps = 1e-9 * np.array(batch["time"].cast("int64"))
            np.testing.assert_allclose(stamps, trace.t, atol=2e-9)
        np.testing.assert_array_equal(
            np.concatenate(found[f"/angle/{joint}"]["Scalars:scalars"].to_numpy(False)),
            trace.q[:, j],
        )
        moved = found[f"/joint/{joint}"]
        assert moved["Transform3D:child_frame"].to_pylist()[0] == [turret.links[j]]
        for k in (0, 700):
            pin.forwardKinematics(model, data, trace.q[k])
            turn = pin.Quaternion(
                np.array(moved["Transform3D:quaternion"][k].as_py()[0])
            ).toRotationMatrix()
            np.testing.assert_allclose(
                turn, data.liMi[j + 1].rotation, atol=1e-6
            )  # single precision
            place = moved["Transform3D:translation"][k].as_py()[0]
            np.testing.assert_allclose(place, data.liMi[j + 1].translation, atol=1e-6)
    assert any(entity.endswith("base_flange") for entity in found)
    assert not any("collision" in entity for entity in found)
    write_rrd(turret, traces, tmp_path / "two.rrd")
    chunks = RrdReader(tmp_path / "two.rrd").stream().to_chunks()
    assert {name for chunk in chunks for name in chunk.timeline_names} == {"log_1", "log_2"}


@pytest.mark.parametrize("verb", ["identify", "diagnose"])
def test_a_verb_records_the_log_with_what_is_left(
    verb: str, run: Run, toothed: tuple[Model, Log], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of the logged torque; our own reader of bags finds it again. Without the package nothing is begun."""
    log = tmp_path / "log.csv"
    out = tmp_path / "out.mcap"
    write_log(toothed[1], log)
    monkeypatch.setattr(
        "gimbal_pin.diagnosis.diagnose", partial(diagnose, causes={"cogging": Cogging})
    )
    assert run(verb, "turret", log, "--mcap", out, "--alignment", "0")[0] == 0
    mapped = [f"{column}=/{{}}.{column}" for column in ("q_pan", "q_tilt", "tau_pan", "tau_tilt")]
    again = {
        kind: read_log(out, toothed[0].rig, [entry.format(kind) for entry in mapped])
        for kind in KINDS
    }
    left = again["residual"].tau
    np.testing.assert_allclose(again["measured"].tau - again["model"].tau, left, atol=1e-12)
    assert np.sqrt(np.mean(left**2)) < 0.3 * np.sqrt(np.mean(again["measured"].tau ** 2))
    monkeypatch.setattr("gimbal_pin.export.recordings.find_spec", lambda name: None)
    refused(run(verb, "turret", log, "--mcap", out), 2, "--mcap", "pip install 'gimbal-pin[mcap]'")
