"""Processes that the tests of fleets share: each takes seconds to start."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor

import pytest

from gimbal_pin.fleet import open_executor


@pytest.fixture(scope="session")
def processes() -> Iterator[Executor]:
    with open_executor(2) as pool:
        yield pool
