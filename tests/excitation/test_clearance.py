"""Clearance: no parts hit each other, and no short cut misses the nearest ones."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from gimbal_pin.dynamics import nominal
from gimbal_pin.errors import RigError, UsageError
from gimbal_pin.excitation import (
    Clearance,
    Envelope,
    Excitation,
    enforce_clearance,
    excite,
)
from gimbal_pin.rig import Rig
from tests.excitation.designs import assert_within, designed, moved, problem
from tests.rigs import bundled

POST = """<robot name="post"><link name="base"><collision><origin xyz="0 0 -0.05"/>
<geometry><cylinder radius="0.05" length="0.1"/></geometry></collision></link>
<link name="post"><collision><origin xyz="{at} 0.1"/><geometry><cylinder radius="0.02" length="0.4"/></geometry>
</collision></link><joint name="bolt" type="fixed"><parent link="base"/><child link="post"/></joint>
<link name="arm"><inertial><origin xyz="0.05 0 0.02"/><mass value="0.8"/>
<inertia ixx="0.004" iyy="0.006" izz="0.007" ixy="0" ixz="0.0005" iyz="0"/></inertial>
<collision><origin xyz="0.05 0 0.05"/><geometry><box size="0.1 0.05 0.02"/></geometry></collision></link>
<link name="head"><inertial><origin xyz="0.06 0.01 0.02"/><mass value="1.1"/>
<inertia ixx="0.002" iyy="0.005" izz="0.005" ixy="0.0002" ixz="0" iyz="0"/></inertial>
<collision><origin xyz="0.08 0 0"/><geometry><box size="0.24 0.06 0.06"/></geometry></collision>{more}</link>
<joint name="pan" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>
<limit lower="-2.5" upper="2.5" effort="4" velocity="2"/><dynamics damping="0.01" friction="0.03"/></joint>
<joint name="tilt" type="revolute"><parent link="arm"/><child link="head"/><origin xyz="0.05 0 0.08"/>
<axis xyz="0 1 0"/>
<limit lower="-1" upper="1" effort="4" velocity="2"/><dynamics damping="0.01" friction="0.02"/></joint></robot>"""
"""A head that swings round and meets a post which stands beside its base."""


def beside(folder: Path, at: str = "0.12 0.18", more: str = "") -> Rig:
    path = folder / "post.urdf"
    path.write_text(POST.format(at=at, more=more))
    return Rig.load(path)


def apart(rig: Rig, found: Excitation) -> float:
    """The smallest distance of all pairs on a grid twice as dense, without any short cut."""
    all_pairs = Clearance.of(rig, 0.0, Envelope.of(rig))
    q = found.series.motion(found.coefficients, np.linspace(0.0, found.seconds, 2401)).q
    return float(
        all_pairs.compute_distances(q, range(len(all_pairs.geometry.collisionPairs))).min()
    )


def test_the_arm_does_not_hit_the_frame(tmp_path: Path) -> None:
    free = excite(beside(tmp_path, "3 3"), starts=1, seconds=5.0, rng=np.random.default_rng(0))
    passed = np.median(free.motion.q[:, 0])
    rig = beside(tmp_path, f"{0.21 * np.cos(passed)} {0.21 * np.sin(passed)}")
    assert (
        apart(rig, free) < 0
    )  # what is best where there is no post runs into one that stands in its way
    found = excite(rig, starts=1, seconds=5.0, rng=np.random.default_rng(0), clearance=0.01)
    gap = found.clearance
    assert gap is not None
    assert gap.distance == pytest.approx(apart(rig, found), abs=2e-6)
    assert gap.distance >= 0.01 - 1e-6
    assert "head" in gap.between
    assert_within(rig, nominal(rig), found)


def test_what_is_not_watched_is_checked_and_mended(tmp_path: Path) -> None:
    rig = beside(tmp_path)
    clearance = replace(Clearance.of(rig, 0.01, Envelope.of(rig)), watched=())
    at = replace(problem(rig), clearance=clearance)
    starts = [at.draw_start(np.random.default_rng(seed)) for seed in range(10)]
    gaps = [clearance.find_smallest_gap(at.motion(x, at.dense).q).distance for x in starts]
    near = starts[int(np.argmin(gaps))]
    mended, now = enforce_clearance(at, near)
    assert min(gaps) < 0.01 - 1e-6 <= now.distance
    assert np.abs(mended).sum() < np.abs(near).sum()


def test_derivative_of_the_distance_is_exact(tmp_path: Path) -> None:
    rig = beside(tmp_path)
    at = replace(Clearance.of(rig, 0.01, Envelope.of(rig)), watched=(0, 1, 2))
    q = Envelope.of(rig).spread().q[:30]
    exact = at.differentiate_room(q)
    ends = [at.compute_room(q + e) - at.compute_room(q - e) for e in 1e-3 * np.eye(2)]
    rough = np.stack(ends, axis=-1) / 2e-3
    # Of the others another edge becomes the nearest.
    assert np.quantile(np.abs(exact - rough), 0.9) < 1e-3 * np.abs(rough).max()


@pytest.mark.parametrize(("distance", "near"), [(0.01, True), (0.2, False)])
def test_links_that_a_joint_connects_are_left_out_and_what_is_built_close(
    tmp_path: Path, distance: float, near: bool
) -> None:
    rig = beside(tmp_path)
    at = Clearance.of(rig, distance, Envelope.of(rig))
    pairs = {frozenset(at.get_links(k)) for k in range(len(at.geometry.collisionPairs))}
    assert frozenset(("arm", "head")) not in pairs
    assert (frozenset(("post", "arm")) in pairs) == near


def test_short_cut_to_the_smallest_distance_misses_nothing() -> None:
    rig = bundled("handheld")
    q = designed("handheld", 0).motion.q[::33]
    at = Clearance.of(rig, 0.005, Envelope.of(rig))
    gap = at.find_smallest_gap(q)
    every = at.compute_distances(q, range(len(at.geometry.collisionPairs)))
    assert gap is not None
    assert gap.distance == pytest.approx(every.min(), abs=2e-6)
    assert gap.between == at.get_links(int(np.argmin(every.min(axis=0))))


def test_mesh_that_is_not_there_is_named_and_one_that_is_counts(tmp_path: Path) -> None:
    mesh = '<collision><geometry><mesh filename="package://rig/{}.stl"/></geometry></collision>'
    rig = beside(tmp_path, more=mesh.format("lens") + mesh.format("gone"))
    trimesh.creation.box((0.02, 0.02, 1.0)).export(tmp_path / "lens.stl")
    at = Clearance.of(rig, 0.0, Envelope.of(rig))
    assert at.unchecked == ("head",)
    plain = Clearance.of(beside(tmp_path), 0.0, Envelope.of(rig))
    with_lens, without = (one.find_smallest_gap(np.zeros((1, 2))) for one in (at, plain))
    assert with_lens is not None and without is not None
    assert with_lens.distance < 0 < without.distance
    (tmp_path / "gone.stl").write_text("no mesh")
    with pytest.raises(RigError, match="collision mesh that cannot be read"):
        Clearance.of(rig, 0.0, Envelope.of(rig))


def test_rig_that_can_only_hit_is_named(tmp_path: Path) -> None:
    rig = moved(beside(tmp_path, "0.2 0"), lower=-1.0, upper=1.0)
    with pytest.raises(
        UsageError, match=r"keep 0.1 m from each other: at mid-range \w+ and \w+ are"
    ):
        excite(rig, starts=1, rng=np.random.default_rng(0), clearance=0.1)
