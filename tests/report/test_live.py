"""The live view: one page for this machine alone, which ends with the process that shows it, however that ends."""

from __future__ import annotations

import http.client
import os
import re
import subprocess
import sys
from contextlib import closing
from pathlib import Path
from urllib.parse import urlsplit

import lxml.html
import numpy as np
import pinocchio as pin
import pytest

import gimbal_pin
from gimbal_pin.errors import UsageError
from gimbal_pin.report import view
from gimbal_pin.report.view import figure
from tests.browsing import meanwhile, needs_browser, until, visit
from tests.command_line import heard
from tests.report.records import RIGS, clean_log

on_linux = pytest.mark.skipif(
    not Path("/proc/net/tcp").exists(), reason="/proc says which sockets a process has"
)


def answer(url: str, path: str | None = None, **headers: str) -> tuple[int, str]:
    """Return status and text of what the server says to a request."""
    at = urlsplit(url)
    with closing(http.client.HTTPConnection(at.hostname or "", at.port, timeout=5)) as connection:
        connection.request("GET", at.path if path is None else path, headers=headers)
        said = connection.getresponse()
        return said.status, said.read().decode()


def listening(pid: int) -> set[str]:
    """Return the local addresses, as the kernel writes them, on which a process listens."""
    files = (os.readlink(file) for file in Path(f"/proc/{pid}/fd").iterdir() if file.is_symlink())
    own = {found[1] for file in files if (found := re.fullmatch(r"socket:\[(\d+)\]", file))}
    rows = [
        row.split()
        for name in ("tcp", "tcp6")
        for row in Path(f"/proc/{pid}/net/{name}").read_text().splitlines()
    ]
    return {row[1].partition(":")[0] for row in rows if row[3] == "0A" and row[9] in own}


@on_linux
def test_only_this_machine_is_served_and_nothing_is_left_behind(tmp_path: Path) -> None:
    gimbal_pin.write_log(clean_log("turret"), tmp_path / "log.csv")
    command = [sys.executable, "-u", "-m", "gimbal_pin.cli", "animate", "turret", "log.csv"]
    hidden = ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER")
    without = {key: value for key, value in os.environ.items() if key not in hidden}
    with subprocess.Popen(
        [*command, "--live"],
        cwd=tmp_path,
        env={**without, "PYTHONPATH": str(Path(gimbal_pin.__file__).parents[1])},
        preexec_fn=heard,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    ) as process:
        assert process.stdout is not None
        said = process.stdout.readline()
        (url,) = re.findall(r"http://\S+?/(?=;|\s)", said)
        assert listening(process.pid) == {"0100007F"}  # 127.0.0.1
        tasks = Path(f"/proc/{process.pid}/task").glob("*/children")
        assert not any(task.read_text() for task in tasks)
        assert answer(url)[0] == 200
        process.terminate()
        assert process.communicate(timeout=10)[0] == ""
    with pytest.raises(ConnectionRefusedError):
        answer(url)


def test_only_who_has_the_address_and_is_no_other_page_gets_the_scene() -> None:
    with view.Live(RIGS["slider"]) as live, view.Live(RIGS["turret"]) as other:
        at = urlsplit(live.url)
        home = f"127.0.0.1:{at.port}"
        status, page = answer(live.url)
        assert status == 200
        assert "alert(1)" not in {one.text for one in lxml.html.fromstring(page).iter("script")}
        assert answer(live.url, Host=f"localhost:{at.port}")[0] == 200
        assert answer(live.url, Origin=f"http://{home}")[0] == 200
        assert len(at.path) > 40
        assert at.path != urlsplit(other.url).path
        for path in ("/", "/news", at.path[:-1], f"{at.path}x"):
            assert answer(live.url, path)[0] == 404
        for path in (at.path, f"{at.path}news"):
            for host in ("evil.example", f"127.0.0.1.evil.example:{at.port}", ""):
                assert answer(live.url, path, Host=host)[0] == 403
            for origin in ("null", "http://127.0.0.1:1", f"https://{home}"):
                assert answer(live.url, path, Origin=origin)[0] == 403


def test_live_answers_without_a_browser_and_gives_up_waiting() -> None:
    log = clean_log("turret")
    with view.show(RIGS["turret"], log, browser=False) as live:
        assert live.play(log, speed=0.5) == pytest.approx(24.0)
        with pytest.raises(UsageError, match="no browser opened"):
            live.wait(0.1)
    with pytest.raises(ConnectionRefusedError):
        answer(live.url)


PLAYS = "typeof animator === 'object' && animator.playing"
"""Whether the page, which is another one for a log, plays it."""


@needs_browser
def test_a_browser_shows_live_poses_and_plays_a_log() -> None:
    rig = RIGS["turret"]
    q = np.array([0.3, -0.4])
    with view.Live(rig) as live:
        live.pose(q)
        tip = figure.list_scene_paths(rig, "/meshcat/rig")[2].strip("/").split("/")
        turn = f"viewer.scene_tree.find({tip}).object.quaternion.toArray()"
        play = meanwhile(lambda: live.play(clean_log("turret")))
        seen = visit(live.url, until(f"{turn}[3] < 0.99"), turn, play, until(PLAYS))
        assert (seen.complaints, {*seen.requests}) == ([], {live.url, f"{live.url}news"})
    data = rig.model.createData()
    pin.forwardKinematics(rig.model, data, q)
    want = pin.Quaternion(data.liMi[2].rotation).coeffs()
    assert abs(np.dot(seen.values[0], want)) == pytest.approx(1, abs=1e-9)
