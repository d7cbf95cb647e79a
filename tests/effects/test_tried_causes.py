"""Laws of the causes that a search tries: within bounds whatever a log shows, and alike where it shows too little."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gimbal_pin.effects import (
    CAUSES,
    Cause,
    Cogging,
    JointFlexibility,
    OperatingRange,
    Stribeck,
    TorqueBias,
    TorqueRipple,
)

SEEN = OperatingRange(60.0, 0.005, 12.0, 2.0, 1.0, 1e-3, 1.0, 1.2)
TURN = SEEN._replace(travel=7.0)
SIZES = st.just(0.0) | st.floats(-9.0, 7.0).map(lambda x: float(10**x))
"""Of a watch or of a press, and none at all."""
ANY_LOG = st.builds(
    OperatingRange,
    st.floats(0.05, 1e6),
    st.floats(1e-5, 1.0),
    st.floats(0.1, 2e3),
    *[SIZES] * 5,
    st.booleans(),
    st.booleans(),
    st.floats(-1e7, 1e7),
    SIZES,
)


@pytest.mark.parametrize(
    "name", sorted(name for name, kind in CAUSES.items() if not kind.of_given_model)
)
@given(seen=ANY_LOG, factor=st.floats(1e-9, 1e9))
def test_no_cause_is_tried_or_moved_beyond_its_bounds(
    name: str, seen: OperatingRange, factor: float
) -> None:
    """A cause outside its bounds is refused."""
    tried = CAUSES[name].tried("pan", seen)
    for cause in (*tried[:: max(1, len(tried) // 8)], *tried[-1:]):
        for shape in cause.shapes:
            value = getattr(cause, shape.name)
            if isinstance(value, float):
                assert cause.moved(shape.name, factor * value).name == name


@pytest.mark.parametrize(
    ("cause", "seen", "rival", "alike"),
    [
        (Stribeck("tilt", 0.01), SEEN, "presliding", True),
        (Cogging("yaw", (1.0,)), TURN._replace(upright=True), "base-tilt", True),
        (Cogging("yaw", (1.0,)), TURN, "base-tilt", False),
        (Cogging("yaw", (1.0,)), SEEN, "cable-spring", True),
        (TorqueRipple("tilt", (1.0, 2.0)), SEEN, "encoder-offset", True),
        (JointFlexibility("tilt", 25.0), SEEN, "delay", True),
        (TorqueBias("tilt"), SEEN, "asymmetric-friction", True),
    ],
)
def test_a_short_range_makes_causes_alike(
    cause: Cause, seen: OperatingRange, rival: str, alike: bool
) -> None:
    assert (rival in cause.blurred(seen)) == alike
