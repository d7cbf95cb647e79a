"""What tests of many modules share: the command line as a call, and how much hypothesis draws.

Property tests draw the same examples on every run of the suite; a longer search is `--hypothesis-profile=search`.
"""

from __future__ import annotations

import pytest
from hypothesis import settings

from gimbal_pin.cli import main
from tests.command_line import Run

settings.register_profile("suite", max_examples=40, derandomize=True, deadline=None, database=None)
settings.register_profile("search", max_examples=2000, deadline=None)
settings.load_profile("suite")


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
