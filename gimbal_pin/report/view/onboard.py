"""A rig that holds its camera on a moving platform as a page: the scene, and beside it what the cameras see."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gimbal_pin.log.log import Array, Imu, Log
from gimbal_pin.pointing.result import Pointing
from gimbal_pin.pointing.sight import Sight
from gimbal_pin.report.view import gaze
from gimbal_pin.report.view.motion import motion
from gimbal_pin.report.view.outlook import Outlook
from gimbal_pin.report.view.page import render_scene
from gimbal_pin.report.view.scene import scene
from gimbal_pin.rig.rig import Rig

ONBOARD_FPS = 30.0


def onboard(rig: Rig, run: Pointing, seen: Outlook, wanted: Array) -> str:
    """Return a page that plays a run: the platform turns about the point where the axes meet, the camera stands.

    The ghost is the rig with its joints locked where a level platform's camera looks as wanted.

    The stretch of `seen` is played; `wanted`: R_d, (3, 3).
    """
    log = shown(rig, run, seen, wanted)
    moved = replace(motion(rig, log, ONBOARD_FPS, 1.0, True, None), pivot=Sight(rig).centre, wanted=wanted)
    several = gaze.build_pictures(seen)[:2]
    return render_scene(rig, log.name, moved, scene(rig, moved), (several, gaze.list_page_data(seen, wanted, several)))


def shown(rig: Rig, run: Pointing, seen: Outlook, wanted: Array) -> Log:
    """Return a stretch of a run as a log whose reference are the locked joints."""
    first, last = np.searchsorted(run.t, [seen.t[0], seen.t[-1]])
    rows = slice(int(first), int(last) + 1)
    sight = Sight(rig)
    locked = np.tile(sight.reached(np.eye(3), wanted, sight.home), (rows.stop - rows.start, 1))
    imus = {rig.base: Imu(quat=run.base[rows])}
    name = f"held by {gaze.called(seen.held[-1])} on platform {run.platform}"
    return Log(name, rig.joints, run.t[rows], run.q[rows], q_ref=locked, imus=imus, payload=rig.payload)
