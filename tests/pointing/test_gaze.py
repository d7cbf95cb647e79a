"""What cameras see: the runs' own motion, where it lies in the picture, and that a browser draws it there."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pinocchio as pin

from gimbal_pin.control import EqualMarginLoop
from gimbal_pin.log import Array
from gimbal_pin.pointing import WANTED, Pointing, Row, Verified
from gimbal_pin.report import Document, outlook, show_camera
from gimbal_pin.report.view import gaze
from tests.browsing import needs_browser, visit, wide
from tests.rigs import bundled

SIZES = {"pid": 4e-4, "computed-torque": 4e-5}


@cache
def verified() -> Verified:
    """Runs of 4 s that were made up: every controller's error is the same motion at a size of its own."""
    rig = bundled("thesis")
    t = 1e-3 * np.arange(4001)
    swing = 0.2 * np.sin(np.outer(t, [2.0, 3.0, 2.5]) + np.arange(3.0))
    base = np.array([pin.Quaternion(pin.exp3(turn)).coeffs()[[3, 0, 1, 2]] for turn in swing])
    shape = np.sin(2 * np.pi * np.outer(t, [3.0, 5.0, 7.0]))
    shape += 0.2 * np.random.default_rng(0).standard_normal((len(t), 3))
    q = np.tile([0.3, 0.0, 0.4], (len(t), 1))
    tau = np.sin(np.outer(t, [1.0, 2.0, 3.0]))
    rows = tuple(
        Row(name, (Pointing(name, "S", 0, rig.joints, t, x * shape, q, tau, base, rig.tau_max),))
        for name, x in SIZES.items()
    )
    return Verified(rig, rows, dict.fromkeys(SIZES, (EqualMarginLoop().margins,) * 3))


def place(points: Array, turned: Array) -> Array:
    """Return where directions in the wanted camera's frame lie in the picture of a camera turned by e, (K, 2)."""
    x, y, z = (points @ pin.exp3(turned)).T
    return np.column_stack([-y / x, z / x])


def test_the_outlook_is_the_runs_own() -> None:
    seen = outlook(verified(), WANTED, seconds=1.0)
    run = verified().rows[1].runs[0]
    rows = np.searchsorted(run.t, seen.t - 1e-9)
    np.testing.assert_array_equal(seen.held[1].turned, run.error[rows])
    np.testing.assert_allclose(seen.held[0].turned, 10 * seen.held[1].turned)
    for turned, quat in zip(seen.bolted.turned[::20], run.base[rows][::20]):
        turn = pin.Quaternion(*quat.tolist()).matrix()
        np.testing.assert_allclose(WANTED @ pin.exp3(turned), turn @ WANTED, atol=1e-12)


PLACES = """(() => { const page = document.querySelector('iframe').contentWindow, out = [];
  for (const k of [0, 1, 2, 3]) for (const i of [0, 40, 90])
    out.push(page.eval(`eye.place(seen.pictures[${k}], seen.t[${i}], [1, 0.1, -0.05])`));
  return out; })()"""


@needs_browser
def test_a_browser_draws_what_the_cameras_see_where_it_lies(tmp_path: Path) -> None:
    """The script's projection is Python's."""
    path = tmp_path / "report.html"
    path.write_text(Document("thesis", "", [show_camera(verified())]).to_html(), encoding="utf-8")
    (places,) = visit(path.as_uri(), wide(1380), PLACES).values
    point = np.array([[1.0, 0.1, -0.05]])
    expected = [
        place(point, one.turned[i])[0] / one.half
        for one in gaze.build_pictures(outlook(verified(), WANTED))
        for i in (0, 40, 90)
    ]
    np.testing.assert_allclose(places, expected, atol=2e-3)
