"""`scripts/ablation`: what it switches off is there."""

from __future__ import annotations

from importlib import import_module

import pytest
from ablation import ABLATIONS, ROOM


@pytest.mark.parametrize("place", [one.place for one in ABLATIONS.values() if one.place])
def test_an_ablation_names_what_the_diagnosis_has(place: str) -> None:
    module, name = place.rsplit(".", 1)
    assert hasattr(import_module(f"{ROOM}.{module}"), name)
