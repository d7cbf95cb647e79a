"""What cameras see: where it lies in the picture, that a browser puts it there, and what a report says of it."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from math import degrees, inf
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import strategies as st

from gimbal_pin.control import EqualMarginLoop
from gimbal_pin.errors import UsageError
from gimbal_pin.log import Array
from gimbal_pin.pointing import (
    WANTED,
    Pointing,
    Row,
    Sight,
    Station,
    Verified,
    attitude,
    learn_recipe,
    unable,
    verify,
)
from gimbal_pin.report import Document, figures, outlook, show_camera
from gimbal_pin.report.sections.camera import headline, numbers
from gimbal_pin.report.view import gaze, stage
from gimbal_pin.report.view.figure import rays
from gimbal_pin.report.view.gaze import liveliest
from gimbal_pin.report.view.motion import poses
from gimbal_pin.report.view.scene import onboard
from gimbal_pin.rig import Rig
from tests.browsing import OPEN, audit, media, needs_browser, pause, visit, wide
from tests.report.test_elements import parsed
from tests.rigs import bundled

PUSHED = "there a joint goes where it is pushed: jitter and ratios say little of the controllers"

AHEAD = np.array([[1.0, 0.0, 0.0]])
SIZES = {"pid": 4e-4, "computed-torque": 4e-5}


@cache
def verified() -> Verified:
    """Runs of 4 s that were made up: every controller's error is the same motion at a size of its own."""
    rng = np.random.default_rng(0)
    t = 1e-3 * np.arange(4001)
    swing = 0.2 * np.sin(np.outer(t, [2.0, 3.0, 2.5]) + np.arange(3.0))
    base = np.array([pin.Quaternion(pin.exp3(turn)).coeffs()[[3, 0, 1, 2]] for turn in swing])
    shape = np.sin(np.outer(t, 2 * np.pi * np.array([3.0, 5.0, 7.0]))) + 0.2 * rng.standard_normal(
        (len(t), 3)
    )
    q = np.tile([0.3, 0.0, 0.4], (len(t), 1))
    tau = np.sin(np.outer(t, [1.0, 2.0, 3.0]))
    runs = [
        Pointing(
            name,
            "S",
            0,
            bundled("thesis").joints,
            t,
            size * shape,
            q,
            tau,
            base,
            bundled("thesis").tau_max,
        )
        for name, size in SIZES.items()
    ]
    rows = tuple(Row(run.controller, (run,)) for run in runs)
    return Verified(bundled("thesis"), rows, dict.fromkeys(SIZES, (EqualMarginLoop().margins,) * 3))


@cache
def page() -> str:
    return Document("thesis", "", [show_camera(replace(verified(), note="A note."))]).to_html()


def test_a_held_camera_is_a_table_a_figure_and_a_scene(tmp_path: Path) -> None:
    found = verified()
    assert found.to_frame()["controller"].tolist() == list(SIZES) and len(found.plot().axes) == 3
    assert found.animate(tmp_path / "held.html").page == (tmp_path / "held.html").read_text(
        encoding="utf-8"
    )
    assert 'class="scene"' in found._repr_html_()


def placed(points: Array, turned: Array) -> Array:
    """Where directions in the wanted camera's frame, (K, 3), lie in the picture of a camera turned by e, (K, 2)."""
    x, y, z = (points @ pin.exp3(turned)).T
    return np.column_stack([-y / x, z / x])


vectors = st.lists(st.floats(-0.5, 0.5), min_size=3, max_size=3).map(np.array)


def test_a_camera_that_turns_left_sees_the_target_move_right_and_one_that_nods_sees_it_rise() -> (
    None
):
    np.testing.assert_allclose(
        placed(AHEAD, np.array([0.0, 0.0, 0.1]))[0], [np.tan(0.1), 0.0], atol=1e-12
    )
    np.testing.assert_allclose(
        placed(AHEAD, np.array([0.0, 0.1, 0.0]))[0], [0.0, np.tan(0.1)], atol=1e-12
    )
    np.testing.assert_allclose(placed(AHEAD, np.array([0.3, 0.0, 0.0]))[0], 0.0, atol=1e-12)


@pytest.mark.parametrize(
    "wanted", [WANTED, attitude(-2.0, -0.1) @ pin.exp3(np.array([0.4, 0.0, 0.0]))]
)
def test_the_ground_is_level_in_the_world_and_the_hills_stand_on_it(wanted: Array) -> None:
    up, lines, hills = gaze.scenery(wanted)
    np.testing.assert_allclose(up, wanted[2], atol=1e-12)
    np.testing.assert_allclose(lines @ up, -1.0, atol=1e-12)
    assert (hills @ up >= -1e-12).all() and np.ptp(hills @ up) > 0.02
    left_to_right = placed(hills[30:-30], np.zeros(3))[:, 0]
    assert wanted is not WANTED or np.all(np.diff(left_to_right) > 0)


def test_the_outlook_is_the_runs_own_and_shows_the_largest_swing() -> None:
    seen = outlook(verified(), WANTED, seconds=1.0)
    run = verified().rows[1].runs[0]
    rows = np.searchsorted(run.t, seen.t - 1e-9)
    assert [one.controller for one in seen.held] == ["pid", "computed-torque"] and 55 <= len(
        seen.t
    ) <= 60
    np.testing.assert_array_equal(seen.held[1].turned, run.error[rows])
    assert seen.held[1].jitter == pytest.approx(run.jitter[0], rel=1e-12)
    np.testing.assert_allclose(
        seen.held[0].turned, SIZES["pid"] / SIZES["computed-torque"] * seen.held[1].turned
    )
    for turned, quat in zip(seen.bolted.turned[::20], run.base[rows][::20]):
        turn = pin.Quaternion(*quat.tolist()).matrix()
        np.testing.assert_allclose(WANTED @ pin.exp3(turned), turn @ WANTED, atol=1e-12)
    swing = np.concatenate([np.zeros((50, 3)), np.ones((20, 3)), np.zeros((50, 3))])
    assert liveliest(swing, 20) == (50, 70) and liveliest(swing, 500) == (0, 120)


def test_the_platform_turns_about_the_pivot_and_the_target_stands_where_the_camera_should_look() -> (
    None
):
    run = verified().rows[1].runs[0]
    pivot = Sight(bundled("thesis")).centre
    base = run.base[::200][:, [1, 2, 3, 0]]
    shown = poses(bundled("thesis").model, run.q[::200], base, pivot)
    assert np.ptp(shown.world[:, 0, :3, 3], axis=0).max() > 0.01
    for pose in shown.world[:, 0]:
        np.testing.assert_allclose(pose[:3, :3] @ pivot + pose[:3, 3], pivot, atol=1e-12)
    _, corners = stage.marks(bundled("thesis"), (), shown, WANTED, 0.5)
    away = corners[:8].mean(axis=0) - rays(bundled("thesis"), shown)[0].mean(axis=0)
    np.testing.assert_allclose(away, stage.DISTANCE * 0.5 * WANTED[:, 0], atol=1e-9)
    scene = onboard(bundled("thesis"), run, outlook(verified(), WANTED), WANTED)
    for word in (
        "Bolted to the platform",
        "Held by computed torque",
        "joints locked",
        "horizon",
        "target",
    ):
        assert word in scene


def test_the_page_says_what_was_run() -> None:
    tree = parsed(page())
    text = tree.text_content()
    ours, theirs = (
        f"{figures(degrees(verified().jitter[name]), 2)}°" for name in ("computed-torque", "pid")
    )
    for row in verified().rows:
        own = f"{figures(degrees(row.jitter_rms), 2)}° rms of jitter with torque"
        torques = [f"{joint} {figures(size, 2)}" for joint, size in row.torque_rms.items()]
        assert all(word in text for word in (own, *torques))
    assert ours in text and theirs in text and "10 times as much" in text
    assert "A note." in text
    rows = [[cell.text_content().strip() for cell in row] for row in tree.xpath("//tbody")[0]]
    assert [row[0] for row in rows] == ["PID", "computed torque"]
    assert (len(tree.xpath("//script")), len(tree.xpath("//iframe"))) == (
        2,
        1,
    )  # the frame's own, and the charts'


def test_who_is_long_at_the_torque_limit_of_which_joints_is_told() -> None:
    """Of every controller by itself, from a share on that is worth a word; text and page say the same."""
    pid, *rest = verified().rows
    limit = bundled("thesis").tau_max
    shares = np.array([0.6, 0.2, 0.02])
    run = pid.runs[0]
    counted = np.linspace(0.0, 1.0, len(run.t) - run.counted.start)
    tau = run.tau.copy()
    tau[run.counted] = np.where(counted[:, None] < shares, limit, 0.1 * limit)
    pushed = replace(verified(), rows=(replace(pid, runs=(replace(run, tau=tau),)), *rest))
    said = show_camera(pushed).to_text()
    (line,) = [line for line in said.splitlines() if line.startswith("PID ")]
    assert line.endswith("yaw 60 %, roll 20 %") and said.count("yaw 60 %") == 1
    assert PUSHED not in show_camera(verified()).to_text()
    page = parsed(Document("", "", [show_camera(pushed)]).to_html()).text_content()
    assert PUSHED in said and PUSHED in page and "yaw 60 %, roll 20 %" in page


@pytest.mark.parametrize(("share", "tone"), [(0.0, ""), (0.01, "fair"), (0.2, "poor")])
def test_the_torque_card_says_for_how_long_the_limit_is_reached(share: float, tone: str) -> None:
    ours = next(row for row in verified().rows if row.controller == "computed-torque")
    run = ours.runs[0]
    limit = bundled("thesis").tau_max
    counted = np.linspace(0.0, 1.0, len(run.t) - run.counted.start, endpoint=False)
    tau = np.tile(0.5 * limit, (len(run.t), 1))
    tau[run.counted, 0] = np.where(counted < share, limit[0], 0.6 * limit[0])
    row = replace(ours, runs=(replace(run, tau=tau),))
    card = numbers(replace(verified(), rows=(verified().rows[0], row)))[2]
    assert (card.value, card.tone) == ("100 %" if share else "60 %", tone)
    assert card.note.endswith(
        f", and at it {figures(100 * share, 2)} % of the time" if share else "at most: yaw"
    ), card.note


def test_the_headline_says_when_margins_differ() -> None:
    """Gains that were asked for have other margins than the PID's."""
    assert headline(verified()).endswith("10 times as much.")
    slow = (replace(EqualMarginLoop().margins, disk_margin=0.8),) * 3
    other = replace(verified(), loops={**verified().loops, "computed-torque": slow})
    assert headline(other).endswith("10 times as much, each with margins of its own.")


def test_what_cannot_hold_a_camera_says_why() -> None:
    assert [unable(Rig.load(name), WANTED) for name in ("thesis", "handheld", "turret")] == [
        None
    ] * 3
    limits = tuple(replace(limit, upper=0.1, lower=-0.1) for limit in bundled("thesis").limits)
    assert "reaches its limit" in str(unable(replace(bundled("thesis"), limits=limits), WANTED))
    strong = replace(
        bundled("thesis"),
        motors=tuple(replace(motor, tau_max=inf) for motor in bundled("thesis").motors),
    )
    endless = replace(
        strong, limits=tuple(replace(limit, effort=inf) for limit in bundled("thesis").limits)
    )
    with pytest.raises(UsageError, match="torque limits are not stated"):
        verify(endless)


def test_where_no_imu_says_how_the_platform_moves_profile_s_does() -> None:
    from gimbal_pin.dynamics import nominal
    from tests.bench_logs import prescribed

    turret = Rig.load("turret")
    taught = learn_recipe(
        turret, prescribed(nominal(turret), seconds=3.0), Station.of(turret), nominal(turret)
    )
    power = taught.spectrum
    line, beside = (power.rate[np.abs(power.f - hz) < 2].max() for hz in (75.0, 100.0))
    assert (
        line > 10 * beside
        and power.rate[2:10].sum() > power.rate[20:200].sum()
        and taught.trusted == (True, True)
    )


PLACES = """(() => { const page = document.querySelector('iframe').contentWindow, out = [];
  for (const k of [0, 1, 2, 3]) for (const i of [0, 40, 90])
    out.push(page.eval(`eye.place(seen.pictures[${k}], seen.t[${i}], [1, 0.1, -0.05])`));
  return out; })()"""
PIXELS = """(() => { const page = document.querySelector('iframe').contentWindow;
  const shot = time => { page.eval(`seek(${time})`);
    return [...page.document.querySelectorAll('canvas')].map(
      c => c.getContext('2d').getImageData(0, 0, c.width, c.height).data); };
  const first = shot(1.2), second = shot(2.4);
  return first.map((data, k) => data.filter((x, i) => Math.abs(x - second[k][i]) > 8).length / data.length); })()"""
FRAME = """(() => { const frame = document.querySelector('iframe');
  return [frame.clientHeight - frame.contentDocument.body.scrollHeight, frame.clientWidth
    - frame.contentDocument.documentElement.scrollWidth, frame.contentDocument.getElementById('clock').value]; })()"""


@needs_browser
def test_a_browser_draws_what_the_cameras_see_where_it_lies(tmp_path: Path) -> None:
    """The script's projection is Python's; the bolted camera's picture changes, that of the held one does not."""
    path = tmp_path / "report.html"
    path.write_text(page(), encoding="utf-8")
    looks = (PIXELS, PLACES, FRAME)
    said = visit(path.as_uri(), wide(1380), *looks, wide(420), *looks)
    seen = outlook(verified(), WANTED)
    several = gaze.build_pictures(seen)
    expected = [
        placed(np.array([[1.0, 0.1, -0.05]]), one.turned[i])[0] / one.half
        for one in several
        for i in (0, 40, 90)
    ]
    for changed, places, (below, beside, clock) in (said.values[:3], said.values[3:]):
        assert (below, beside) == (0, 0) and clock.startswith("2.40 / ")
        np.testing.assert_allclose(places, expected, atol=2e-3)
        bolted, held, pid, ours = changed
        assert bolted > 0.2 and held < 1e-3 and pid > 2 * ours


@needs_browser
def test_axe_has_nothing_against_what_the_cameras_see_light_or_dark(tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    found = list[object]()
    path.write_text(page(), encoding="utf-8")
    audits = [
        step
        for scheme in ("light", "dark")
        for step in (media("screen", scheme), pause(0.5), audit(found))
    ]
    visit(path.as_uri(), OPEN, wide(1280), *audits)
    assert found == []
