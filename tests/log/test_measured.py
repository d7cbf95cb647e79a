"""Logs measured elsewhere are read through mappings as their files hold them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from real_data.cases import measured
from real_data.proposed import differing, is_unknown, singles

from gimbal_pin.log import parse_expression, read_log
from gimbal_pin.rig import Rig
from tests.log.planted import held

DATA = Path(__file__).parents[3] / "shared" / "data"
needs_data = pytest.mark.skipif(not DATA.is_dir(), reason="needs the measured logs")
DOUBLE = {"t": "time", "q_shoulder": "pos1", "q_elbow": "pos2", "dq_shoulder": "vel1"}
DOUBLE |= {"dq_elbow": "vel2", "tau_shoulder": "tau1", "tau_elbow": "tau2"}
SIMPLE = {"t": "time", "q_shoulder": "position", "dq_shoulder": "velocity"}
COUNTS = {"t": "time_s", "q_motor": "2*pi*pos_counts/8192", "tau_motor": "iq_a*0.0276"}


@needs_data
@pytest.mark.parametrize(
    ("file", "urdf", "mapping"),
    [
        (
            "dfki_double_pendulum/20220812-061157-PM_measured.csv",
            "double_pendulum.urdf",
            DOUBLE,
        ),
        (
            "dfki_simple_pendulum/system_identification.csv",
            "pendulum.urdf",
            {**SIMPLE, "tau_shoulder": "torque"},
        ),
        ("odrive_cogging/slow_a.csv", "rotor.urdf", COUNTS),
    ],
)
def test_a_measured_log_is_the_columns_of_its_file(
    file: str, urdf: str, mapping: Mapping[str, str]
) -> None:
    path = DATA / file
    rig = Rig.load(path.parent / urdf)
    log = read_log(path, rig, mapping)
    raw = np.genfromtxt(path, delimiter=",", names=True)
    np.testing.assert_array_equal(log.t, raw[mapping["t"]])
    assert (log.v is not None) == any(name.startswith("dq_") for name in mapping)
    for prefix, values in (("q", log.q), ("dq", log.v), ("tau", log.tau)):
        for j, joint in enumerate(rig.joints):
            if text := mapping.get(f"{prefix}_{joint}"):
                source = parse_expression(text, "")
                expected = source.factor * raw[source.column]
                np.testing.assert_allclose(held(values)[:, j], expected, rtol=1e-14)


@needs_data
def test_every_mapping_written_by_hand_is_proposed(tmp_path: Path) -> None:
    """Columns and factors, but for the torque constants of motors, which no log holds."""
    logs = singles(measured(DATA, tmp_path))
    assert len(logs) == 19
    wrong = [
        (case.name, target)
        for case in logs
        for target, remark in differing(case)
        if not is_unknown(remark)
    ]
    assert wrong == []
