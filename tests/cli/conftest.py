"""What tests of several verbs share: a log, and the model and the controller that are made of it."""

from __future__ import annotations

from pathlib import Path

import pytest

from gimbal_pin.control import tune
from gimbal_pin.dynamics import nominal
from gimbal_pin.identification import identify
from gimbal_pin.log import write_log
from tests.bench_logs import EXACT, prescribed
from tests.rigs import bundled


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with ``log.csv``, ``model.yaml`` and ``controller.yaml`` of the turret.

    It carries the cinema camera, which is not its own; the torque is that at the sample itself.
    """
    folder = tmp_path_factory.mktemp("made")
    rig = bundled("turret", "cinema")
    log = prescribed(nominal(rig), seconds=8.0, torque_noise=0.01, dt=4e-3)
    write_log(log, folder / "log.csv")
    identify(rig, [log], filtering=EXACT).save(folder / "model.yaml")
    tune(nominal(rig), delay=0.004, dt=0.001).save(folder / "controller.yaml")
    return folder
