"""Recordings as the tools' own readers find them: what was measured is what the model says and what it leaves."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
import pytest

from gimbal_pin.diagnosis import TorqueTrace, diagnose, trace_torques
from gimbal_pin.dynamics import Model, nominal, plant_with
from gimbal_pin.effects import Cogging, parse_effect
from gimbal_pin.export import write_mcap
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
    model = plant_with(nominal(turret), [parse_effect("cogging:pan:amplitude=0.05,harmonic=7", turret)]).plant
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


def test_mcaps_own_reader_finds_the_numbers(turret: Rig, traces: tuple[TorqueTrace, ...], tmp_path: Path) -> None:
    write_mcap(turret, traces[:1], tmp_path / "one.mcap")
    (trace, _), found = traces, read_mcap(tmp_path / "one.mcap")
    assert set(found) == {"/robot_description", *(f"/{kind}" for kind in KINDS)}
    assert [said.data for _, said in found["/robot_description"]] == [turret.urdf]
    for kind in KINDS:
        assert all(said.name == list(trace.joints) for _, said in found[f"/{kind}"])
        stamps = [said.header.stamp.sec * 10**9 + said.header.stamp.nanosec for _, said in found[f"/{kind}"]]
        assert stamps == [at for at, _ in found[f"/{kind}"]]
        np.testing.assert_allclose(1e-9 * np.array(stamps), trace.t, atol=1e-9)
        for field, values in (("position", trace.q), ("velocity", trace.v), ("effort", getattr(trace, kind))):
            np.testing.assert_array_equal([getattr(said, field) for _, said in found[f"/{kind}"]], values)
    write_mcap(turret, traces, tmp_path / "two.mcap")
    assert {f"/log_{k}/{kind}" for k in (1, 2) for kind in KINDS} <= set(read_mcap(tmp_path / "two.mcap"))


def test_diagnose_records_the_log_with_what_is_left(
    run: Run, toothed: tuple[Model, Log], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of the logged torque; our own reader of bags finds it again. Without the package nothing is begun."""
    log, out = tmp_path / "log.csv", tmp_path / "out.mcap"
    write_log(toothed[1], log)
    monkeypatch.setattr("gimbal_pin.diagnosis.diagnose", partial(diagnose, causes={"cogging": Cogging}))
    assert run("diagnose", "turret", log, "--mcap", out, "--alignment", "0")[0] == 0
    mapped = [f"{column}=/{{}}.{column}" for column in ("q_pan", "q_tilt", "tau_pan", "tau_tilt")]
    again = {kind: read_log(out, toothed[0].rig, [entry.format(kind) for entry in mapped]) for kind in KINDS}
    left = again["residual"].tau
    np.testing.assert_allclose(again["measured"].tau - again["model"].tau, left, atol=1e-12)
    assert np.sqrt(np.mean(left**2)) < 0.3 * np.sqrt(np.mean(again["measured"].tau ** 2))
    monkeypatch.setattr("gimbal_pin.export.recordings.find_spec", lambda name: None)
    refused(run("diagnose", "turret", log, "--mcap", out), 2, "--mcap", "pip install 'gimbal-pin[mcap]'")
