"""What tests of many modules share: the command line as a call, and how much hypothesis draws.

Property tests draw the same examples on every run of the suite. With ``HYPOTHESIS_PROFILE=long`` they draw many more,
other ones on every run.
"""

from __future__ import annotations

import os

import pytest
from hypothesis import HealthCheck, settings

from gimbal_pin.cli import main
from tests.command_line import Run

# A fixture that lasts a test, such as `tmp_path`, serves all examples of it: none of them reads what another left.
ANY = settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
settings.register_profile("suite", ANY, max_examples=12, derandomize=True, database=None)
settings.register_profile("long", ANY, max_examples=500)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "suite"))


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> Run:
    """`gimbal-pin` with these words, in this process: its exit code, what it printed and what it complained of."""

    def call(*arguments: object) -> tuple[int, str, str]:
        code = 0
        try:
            main([str(argument) for argument in arguments])
        except SystemExit as stop:
            code = int(stop.code or 0)
        said = capsys.readouterr()
        return code, said.out, said.err

    return call
