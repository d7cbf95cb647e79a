"""The live view: one page for this machine alone, which ends with the process that shows it, however that ends."""

from __future__ import annotations

import http.client
import os
import re
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, suppress
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import numpy as np
import pinocchio as pin
import pytest

from gimbal_pin.errors import UsageError
from gimbal_pin.log import Log
from gimbal_pin.report import view
from gimbal_pin.report.view import figure
from gimbal_pin.report.view.live import open_window
from gimbal_pin.report.view.motion import poses
from gimbal_pin.rig import Rig
from tests.browsing import meanwhile, needs_browser, pause, visit
from tests.command_line import heard

GHOST = "/meshcat/ghost"
RIG = "/meshcat/rig"

SIGNALS = (signal.SIGTERM, signal.SIGKILL)
UPGRADE = {
    "Connection": "Upgrade",
    "Upgrade": "websocket",
    "Sec-WebSocket-Version": "13",
    "Sec-WebSocket-Key": "eA==",
}

Viewers = Mapping[signal.Signals, tuple[subprocess.Popen[str], str]]
"""The signal that is to end it → a process that shows a rig live, and its address."""

on_linux = pytest.mark.skipif(
    not Path("/proc/net/tcp").exists(), reason="/proc says which sockets a process has"
)


def sweep(rig: Rig, seconds: float = 2.0) -> Log:
    """Return a smooth motion of all joints and a reference that it lags behind."""
    t = np.arange(0, seconds + 0.005, 0.01)
    angle = 2 * np.pi * 0.4 * t[:, None] + np.arange(rig.n)
    return Log("sweep", rig.joints, t, 0.5 * np.sin(angle - 0.3), q_ref=0.5 * np.sin(angle))


def answer(url: str, path: str | None = None, **headers: str) -> tuple[int, str]:
    """Return status and start of what the server says to a request."""
    at = urlsplit(url)
    with closing(http.client.HTTPConnection(at.hostname or "", at.port, timeout=5)) as connection:
        wanted = {name.replace("_", "-"): value for name, value in headers.items()}
        connection.request("GET", at.path if path is None else path, headers=wanted)
        said = connection.getresponse()
        return said.status, said.read(200).decode()


def with_children(pid: int) -> set[int]:
    """Return a process and all that it started."""
    found = [pid]
    for one in found:
        with suppress(OSError):  # one that ends meanwhile
            for task in Path(f"/proc/{one}/task").glob("*/children"):
                found += map(int, task.read_text().split())
    return set(found)


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


def command_line(pid: int) -> bytes:
    """Return how a process was started, nothing of one that is gone."""
    with suppress(OSError):
        return Path(f"/proc/{pid}/cmdline").read_bytes()
    return b""


def ended(pid: int) -> bool:
    """Tell whether a process is gone, or but waits to be buried."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
    except OSError:
        return True


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log of the thesis rig."""
    rig = Rig.load("thesis")
    path = tmp_path_factory.mktemp("live") / "log.csv"
    moved = sweep(rig)
    names = ",".join(("t", *(f"q_{joint}" for joint in rig.joints)))
    np.savetxt(path, np.column_stack([moved.t, moved.q]), delimiter=",", header=names, comments="")
    return path


@pytest.fixture(scope="module")
def viewers(log: Path) -> Iterator[Viewers]:
    """One ``animate --live`` for each signal that is to end it, and its address."""
    command = (
        sys.executable,
        "-u",
        "-m",
        "gimbal_pin.cli",
        "animate",
        "thesis",
        str(log),
        "--live",
    )
    without = {
        key: value
        for key, value in os.environ.items()
        if key not in ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER")
    }
    out: Any = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
    started = {
        one: subprocess.Popen(command, env=without, preexec_fn=heard, **out) for one in SIGNALS
    }
    try:
        found = {}
        for one, process in started.items():
            assert process.stdout is not None
            said = process.stdout.readline()
            found[one] = (
                process,
                (re.findall(r"http://\S+?/(?=;|\s)", said) or pytest.fail(said))[0],
            )
        yield found
    finally:
        for process in started.values():
            process.kill()
            process.communicate()


@on_linux
def test_every_socket_listens_on_this_machine_alone(viewers: Viewers) -> None:
    process, url = viewers[signal.SIGTERM]
    assert {one: listening(one) for one in with_children(process.pid)} == {
        process.pid: {"0100007F"}
    }  # 127.0.0.1
    port = urlsplit(url).port
    for other in ("127.0.0.2", socket.gethostbyname(socket.gethostname())):
        if other != "127.0.0.1":
            with pytest.raises(ConnectionRefusedError):
                socket.create_connection((other, port or 0), timeout=5)


def test_only_who_has_the_address_and_is_no_other_page_gets_the_scene(viewers: Viewers) -> None:
    _, url = viewers[signal.SIGTERM]
    at = urlsplit(url)
    home = f"127.0.0.1:{at.port}"
    status, page = answer(url)
    assert status == 200 and page.startswith("<!DOCTYPE html>")
    assert answer(url, Host=f"localhost:{at.port}")[0] == 200
    assert answer(url, Origin=f"http://{home}")[0] == 200
    assert len(at.path) > 40 and len({address for _, address in viewers.values()}) == len(SIGNALS)
    for path in (
        "/",
        "/news",
        "/static/",
        at.path[:-1],
        at.path[:-2] + "/",
        f"{at.path}..",
        f"{at.path}x",
        f"{url}",
    ):
        assert answer(url, path)[0] in (403, 404), path
    rebound = (
        "evil.example",
        f"evil.example:{at.port}",
        f"127.0.0.1.evil.example:{at.port}",
        f"[::1]:{at.port}",
        "",
    )
    foreign = ("http://evil.example", "null", "http://127.0.0.1:1", f"https://{home}", "")
    for more in ({}, UPGRADE):
        for path in (at.path, f"{at.path}news"):
            assert [answer(url, path, Host=host, **more)[0] for host in rebound] == [403] * len(
                rebound
            )
            assert [answer(url, path, Origin=origin, **more)[0] for origin in foreign] == [
                403
            ] * len(foreign)


def test_what_is_no_request_harms_nothing(viewers: Viewers) -> None:
    process, url = viewers[signal.SIGTERM]
    port = urlsplit(url).port or 0
    rng = np.random.default_rng(1)
    good = f"GET {urlsplit(url).path} HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n".encode()
    broken = [
        good.replace(b"HTTP/1.1", b""),
        good[:30],
        b"GET \xff\xfe /\r\n\r\n",
        b"A" * 70_000,
        good * 50,
        b"\r\n" * 99,
    ]
    broken += [
        bytes(np.where(rng.random(len(good)) < 0.1, rng.integers(0, 256, len(good)), [*good]))
        for _ in range(60)
    ]
    for request in broken:
        # The server need not hear it all.
        with (
            suppress(ConnectionError),
            socket.create_connection(("127.0.0.1", port), timeout=5) as connection,
        ):
            connection.sendall(request)
            connection.shutdown(socket.SHUT_WR)
            connection.recv(1)
    assert answer(url)[0] == 200 and process.poll() is None


@on_linux
@pytest.mark.parametrize("number", SIGNALS)
def test_nothing_is_left_when_the_process_ends(number: signal.Signals, viewers: Viewers) -> None:
    process, url = viewers[number]
    family = with_children(process.pid)
    process.send_signal(number)
    said = process.communicate(timeout=10)[0]
    assert said == "" and all(ended(one) for one in family)
    with pytest.raises(ConnectionRefusedError):
        answer(url)


@on_linux
@needs_browser
def test_a_film_that_is_broken_off_leaves_no_browser_and_no_profile(
    log: Path, tmp_path: Path
) -> None:
    pytest.importorskip(
        "imageio_ffmpeg", reason="imageio-ffmpeg is not installed (gimbal-pin[video])"
    )
    command = (
        sys.executable,
        "-m",
        "gimbal_pin.cli",
        "animate",
        "thesis",
        str(log),
        "-o",
        str(tmp_path / "film.gif"),
    )
    scratch = Path(
        tempfile.mkdtemp()
    )  # a short path: that of a browser's socket has a hundred letters at most
    env = {**os.environ, "TMPDIR": str(scratch)}
    with subprocess.Popen(command, env=env, stderr=subprocess.PIPE, preexec_fn=heard) as process:
        family: set[int] = set()
        while process.poll() is None and not any(
            b"--type=renderer" in command_line(one) for one in family
        ):
            time.sleep(0.05)
            family = with_children(process.pid)
        assert process.poll() is None and list(scratch.iterdir()), process.stderr.read()  # type: ignore[union-attr]
        process.send_signal(signal.SIGINT)
        process.wait(120)
    assert all(ended(one) for one in family) and not list(tmp_path.iterdir())
    scratch.rmdir()  # refused if anything is in it


def test_live_answers_without_a_browser_and_gives_up_waiting(
    capfd: pytest.CaptureFixture[str],
) -> None:
    rig = Rig.load("turret")
    start = time.monotonic()
    with view.show(rig, sweep(rig), browser=False) as live:
        live.pose(np.full(rig.n, 0.2))
        assert live.play(sweep(rig), speed=0.5) == pytest.approx(4.0)
        assert answer(live.url)[0] == 200
        with pytest.raises(UsageError, match="no browser opened"):
            live.wait(0.3)
        with pytest.raises(ConnectionRefusedError):
            answer(live.url)
    assert time.monotonic() - start < 20
    assert capfd.readouterr() == ("", "")


def test_a_text_browser_is_not_let_into_the_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    import webbrowser

    class Told(webbrowser.BackgroundBrowser):
        def open(self, url: str, new: int = 0, autoraise: bool = True) -> bool:
            opened.append(url)
            return True

    opened: list[str] = []
    monkeypatch.setattr(webbrowser, "get", lambda: webbrowser.GenericBrowser("w3m"))
    assert not open_window("http://127.0.0.1:1/")
    monkeypatch.setattr(webbrowser, "get", lambda: Told("firefox"))
    assert open_window("http://127.0.0.1:1/") and opened == ["http://127.0.0.1:1/"]


@needs_browser
def test_a_browser_shows_live_poses_and_plays_a_log() -> None:
    rig = Rig.load("turret")
    q = np.linspace(0.3, -0.4, rig.n)
    log = sweep(rig)
    with view.Live(rig, ghost=True) as live:
        live.pose(q, -q)
        pose = "viewer.scene_tree.find({}).object.quaternion.toArray()"
        nodes = [
            figure.list_scene_paths(rig, root)[2].strip("/").split("/") for root in (RIG, GHOST)
        ]
        ends = "[animator.duration, animator.playing, viewer.renderer.info.render.triangles]"
        with ThreadPoolExecutor(1) as pool:
            waiting = pool.submit(live.wait, 60)

            def play() -> None:
                waiting.result()
                live.play(log)

            still = [pose.format(node) for node in nodes]
            seen = visit(live.url, pause(1.0), *still, meanwhile(play), pause(1.5), ends)
        for have, sign in zip(seen.values[:2], (1, -1), strict=True):
            want = pin.Quaternion(poses(rig.model, sign * q[None]).local[0, 2, :3, :3]).coeffs()
            assert abs(np.dot(have, want)) == pytest.approx(1, abs=1e-9)
        duration, playing, triangles = seen.values[2]
        assert duration == pytest.approx(2.0, abs=1e-6) and playing and triangles > 1000
        assert (seen.complaints, set(seen.requests)) == ([], {live.url, f"{live.url}news"})
