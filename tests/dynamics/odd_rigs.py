"""Rigs that are no gimbals: joints of every kind, branches, axes askew, links welded together."""

from __future__ import annotations

from gimbal_pin.rig import Rig, bundled_rigs
from tests.rigs import BODY, bundled, spelled

JOINT = (
    '<joint name="to_{2}" type="{0}"><parent link="{1}"/><child link="{2}"/>'
    '<origin xyz="{3}" rpy="{4}"/><axis xyz="{5}"/>'
    '<limit lower="-9" upper="9" effort="9" velocity="9"/></joint>'
)
ODD = {
    "slide": (("prismatic", "base", "a", "0 0 0", "0 0 0", "0 0 1"),),
    "wheel": (("continuous", "base", "a", "0 0 0", "0 0 0", "0 0 1"),),
    "pendulum": (("revolute", "base", "a", "0 0 0", "0 0 0", "0 1 0"),),
    "double-pendulum": (
        ("revolute", "base", "a", "0 0 0", "0 0 0", "0 1 0"),
        ("revolute", "a", "b", "0 0 -0.3", "0 0 0", "0 1 0"),
    ),
    "crane": (
        ("revolute", "base", "a", "0 0 0", "0 0 0", "0 0 1"),
        ("fixed", "a", "b", "0.1 0.2 -0.3", "0.4 0.5 -0.6", "0 0 1"),
        ("prismatic", "b", "c", "0 0 0.4", "0 0 0", "1 0 0"),
        ("continuous", "c", "d", "0.2 0 0", "0 0 0", "0 1 1"),
    ),
    "tree": (
        ("revolute", "base", "a", "0 0 0", "0 0 0", "0 0 1"),
        ("revolute", "a", "b", "0.3 0 0", "0.4 0.5 -0.6", "1 1 0"),
        ("revolute", "a", "c", "-0.3 0 0", "0 0 0", "0 1 0"),
        ("prismatic", "c", "d", "0 0.1 0", "0 0 0", "0.3 0.4 0.5"),
    ),
}


def odd(name: str) -> Rig:
    """Return the rig whose joints `ODD` lists, bodies of 1, 2, ... kg behind them."""
    base = BODY.format("base", 3)
    links = "".join(BODY.format(joint[2], mass) for mass, joint in enumerate(ODD[name], start=1))
    joints = "".join(JOINT.format(*joint) for joint in ODD[name])
    return spelled(f'<robot name="{name}">{base}{links}{joints}</robot>')


ALL = (*bundled_rigs(), *ODD)


def known(name: str) -> Rig:
    """Return a bundled rig, or an odd one."""
    return odd(name) if name in ODD else bundled(name)
