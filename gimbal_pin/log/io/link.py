"""Telemetry of a running gimbal over a serial line or UDP, as lines of a growing CSV.

A frame is ``uint8 version, uint8 type, uint16 sequence``, a body and a CRC (CCITT-FALSE), stuffed by COBS (Cheshire and
Baker, IEEE/ACM Trans. Networking 7(2), 1999) with a zero byte at its end, little-endian throughout; `gimbal_link.h` of
an exported controller lists the bodies.
"""

from __future__ import annotations

import re
import socket
import struct
import time
from binascii import crc_hqx
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from math import inf, isfinite
from typing import NamedTuple

from gimbal_pin.errors import LogError, UsageError

_VERSION = 1
_HELLO = 1
"""Type of the frame with which a host asks for the log."""
LOG_FRAME = 2
"""Type of the frame that holds a sample."""
_ENCODERS = 1
"""Bit of the channels that a gimbal gave up (``enum gimbal_channel``): without encoders its angles are predictions."""
_ADDRESS = re.compile(
    r"udp://(?P<host>[\w.-]+|\[[\da-fA-F:]+\]):(?P<port>\d{1,5})|serial:(?P<device>[^@]+)@(?P<baud>\d{1,8})"
)
_ADDRESS_FORM = "write udp://HOST:PORT or serial:DEVICE@BAUD"
_LONGEST_FRAME = 65536
"""Bytes without a zero that are no frame: as many as a datagram holds."""
_RECEIVE_BUFFER = 1 << 20
"""Bytes that wait while samples are learned from: ten seconds of three joints at 1 kHz; a system may grant fewer."""
_READ_TIMEOUT = 0.05
"""Longest wait for bytes at a time, s: Ctrl-C is heard after that."""
_HELLO_INTERVAL = 1.0
"""Time between two HELLOs, s."""
_REORDERING = 1.0
"""Longest delay of a datagram behind later ones, s, and the gap that separates the trajectories of a gimbal whose clock
jumped by more. Twice as long a delay is beyond what networks do; twice the gap changes no result."""


class Frame(NamedTuple):
    """One frame.

    Attributes:
        type: `_HELLO` or `LOG_FRAME`.
        sequence: The sender's count.
        body: What it holds.
    """

    type: int
    sequence: int
    body: bytes


class LinkChannel(NamedTuple):
    """Bytes to and from a gimbal.

    Attributes:
        name: Its address.
        read: Waits up to `_READ_TIMEOUT` for bytes; empty where none came.
        write: Sends bytes.
    """

    name: str
    read: Callable[[], bytes]
    write: Callable[[bytes], object]


def is_link(path: str) -> bool:
    """Tell whether a log's name is the address of a gimbal."""
    return path.startswith(("udp:", "serial:"))


def encode_frame(frame: Frame) -> bytes:
    """Return a frame as bytes, its zero included."""
    plain = struct.pack("<BBH", _VERSION, frame.type, frame.sequence % 2**16) + frame.body
    return _stuff(plain + struct.pack("<H", crc_hqx(plain, 0xFFFF))) + b"\0"


def decode_frame(data: bytes) -> Frame | None:
    """Return the frame of the bytes between two zeros, or None: cut, corrupted, or of another version."""
    plain = _unstuff(data)
    if plain is None or len(plain) < 6 or plain[0] != _VERSION:
        return None
    if crc_hqx(plain[:-2], 0xFFFF) != int.from_bytes(plain[-2:], "little"):
        return None
    return Frame(plain[1], int.from_bytes(plain[2:4], "little"), plain[4:-2])


def _stuff(plain: bytes) -> bytes:
    """Return bytes without a zero: each run of up to 254 that are none behind its length plus one."""
    out = bytearray()
    for run in plain.split(b"\0"):
        while len(run) >= 254:
            out += b"\xff" + run[:254]
            run = run[254:]
        out += bytes([len(run) + 1]) + run
    return bytes(out)


def _unstuff(data: bytes) -> bytes | None:
    """Return what was stuffed; None where a length leads beyond the end."""
    out = bytearray()
    at = 0
    while at < len(data):
        run = data[at]
        if run == 0 or at + run > len(data):
            return None
        out += data[at + 1 : at + run]
        at += run
        if run < 255 and at < len(data):
            out += b"\0"
    return bytes(out)


@contextmanager
def open_link(address: str) -> Iterator[LinkChannel]:
    """Open a serial line, or a UDP socket that hears the one address alone.

    Raises:
        UsageError: The address is none, or pyserial is not installed.
        LogError: It cannot be opened, or breaks off.
    """
    found = _ADDRESS.fullmatch(address)
    if found is None or int(found["port"] or 1) not in range(1, 65536):
        raise UsageError(address, "is no address of a gimbal", _ADDRESS_FORM)
    try:
        if found["device"] is None:
            host = found["host"].strip("[]")
            port = int(found["port"])
            family, kind, _, _, at = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
            with socket.socket(family, kind) as udp:
                udp.connect(at)
                udp.settimeout(_READ_TIMEOUT)
                udp.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER)
                yield LinkChannel(address, lambda: _receive(udp), udp.send)
            return
        try:
            import serial
        except ImportError:
            mend = "install it with: pip install 'gimbal-pin[serial]'"
            raise UsageError(address, "needs pyserial, which is not installed", mend) from None
        with serial.Serial(
            found["device"],
            int(found["baud"]),
            timeout=_READ_TIMEOUT,
            write_timeout=_HELLO_INTERVAL,
        ) as line:
            yield LinkChannel(address, lambda: line.read(max(1, line.in_waiting)), line.write)
    except (
        OSError,
        OverflowError,
        ValueError,
    ) as error:  # pyserial's own are OSErrors, or of a baud rate that is none
        raise LogError(
            address, f"cannot be reached ({error})", "see that the gimbal runs there"
        ) from error


def _receive(udp: socket.socket) -> bytes:
    """Return a datagram; nothing where none came, or where nobody listens yet."""
    try:
        return (
            udp.recv(_LONGEST_FRAME) + b"\0"
        )  # no frame goes on in another datagram: what is none ends here
    except TimeoutError:
        return b""
    except ConnectionRefusedError:
        time.sleep(_READ_TIMEOUT)
        return b""


def receive_frames(channel: LinkChannel, idle: float = inf) -> Iterator[Frame | None]:
    """Yield the frames that come, and None every `_READ_TIMEOUT`, until none came for `idle` seconds."""
    rest = b""
    count = 0
    heard = time.monotonic()
    greeted = -inf
    paused = -inf
    while True:
        now = time.monotonic()
        before = heard
        if now - greeted >= _HELLO_INTERVAL:
            with suppress(
                ConnectionRefusedError
            ):  # where nobody listens yet it is lost, as on a line
                channel.write(encode_frame(Frame(_HELLO, count, b"")))
            greeted = now
            count = count + 1
        *parts, rest = (rest + channel.read()).split(b"\0")
        rest = rest[-_LONGEST_FRAME:]
        for part in parts:
            if part and (frame := decode_frame(part)) is not None:
                heard = now
                yield frame
        if (
            heard == before and now - heard > idle
        ):  # what came while the last frame was worked on has been read
            break
        if now - paused >= _READ_TIMEOUT:
            paused = now
            yield None
    yield None


class Sample(NamedTuple):
    """One sample.

    Attributes:
        time_us: Stamp of the gimbal's clock, µs.
        came: Time of this machine at which it came, s.
        lost: Channels that the gimbal has given up, a bit each.
        values: Angles, rad, rates, rad/s, and torques, N m, of all joints.
    """

    time_us: int
    came: float
    lost: int
    values: tuple[float, ...]


class SampleQueue:
    """Samples in the order of their stamps.

    A sample waits for those that it overtook until the second `release` after it came. A stamp that lies over
    `_REORDERING` before the newest, or after it and the time that has passed since, is believed once the next one
    continues it: then the gimbal restarted or its clock was set. A stamp that nothing continues is left out.
    """

    def __init__(self, address: str) -> None:
        """Start without samples; `address` is what errors and comments name."""
        self.is_empty = True
        self._address = address
        self._newest: Sample | None = None
        self._jumped: Sample | None = None
        self._shift = 0
        self._released = -1
        self._waiting: dict[int, str] = {}
        self._arrived: dict[int, str] = {}
        self._comments: list[str] = []
        self._has_encoders = True

    def push(self, sample: Sample) -> None:
        """Take a sample.

        Raises:
            LogError: The gimbal has given up its encoders from the start.
        """
        gap = round(1e6 * _REORDERING)
        newest = self._newest
        sample = sample._replace(time_us=sample.time_us + self._shift)
        if newest is not None:
            passed = 1e6 * (sample.came - newest.came)
            if -gap <= sample.time_us - newest.time_us <= gap + passed:
                self._jumped = None
                self._keep(sample)
                return
        before = self._jumped
        self._jumped = sample
        if before is None or not 0 < abs(sample.time_us - before.time_us) <= gap:
            return
        self._jumped, shift = None, 0
        if newest is not None:
            begin = newest.time_us + gap
            shift = begin - min(before.time_us, sample.time_us)
            what = "restarted, or its clock was set: a trajectory of its own"
            self._comments.append(f"# {1e-6 * begin:.1f} s: {self._address} {what}")
        self._shift += shift
        for one in (before, sample):
            self._keep(one._replace(time_us=one.time_us + shift))

    def _keep(self, sample: Sample) -> None:
        """Keep a sample's line, unless its angles are not measured or later ones have been released."""
        has_encoders = not sample.lost & _ENCODERS and all(map(isfinite, sample.values))
        if self.is_empty and not has_encoders:
            what = "has given up its encoders, and sends no measured angle"
            raise LogError(self._address, what, "look for the fault on the gimbal, and begin again")
        if self._has_encoders and not has_encoders:
            what = "gave up its encoders: samples are left out until it trusts them again"
            self._comments.append(f"# {1e-6 * sample.time_us:.1f} s: {self._address} {what}")
        self._has_encoders, self.is_empty = has_encoders, False
        if self._newest is None or sample.time_us > self._newest.time_us:
            self._newest = sample
        if has_encoders and sample.time_us > self._released:
            numbers = ",".join(f"{x:.9g}" for x in sample.values)
            self._arrived[sample.time_us] = f"{1e-6 * sample.time_us:.6f},{numbers}"

    def release(self, is_last: bool = False) -> list[str]:
        """Return lines up to the newest sample that came before the last call, or all; comments stand before them."""
        ready = {**self._waiting, **self._arrived}
        end = max((*self._waiting, *(self._arrived if is_last else ())), default=-1)
        rows = [ready[t] for t in sorted(ready) if t <= end]
        self._waiting = {t: line for t, line in ready.items() if t > end}
        self._arrived = {}
        if not rows:
            return []
        self._released = end
        rows = [*self._comments, *rows]
        self._comments = []
        return rows


def follow_link(address: str, joints: Sequence[str], idle: float = inf) -> Iterator[bytes]:
    """Yield the log of a running gimbal as CSV text, several lines at a time.

    Samples stand in the order of their stamps (`SampleQueue`). Those of a gimbal that restarts follow the ones before
    after a gap, under a comment; those without encoders are left out, under a comment.

    Args:
        address: ``udp://host:port`` or ``serial:/dev/…@baud``.
        joints: The rig's joints, in whose order the gimbal sends.
        idle: Time without a frame after which the log ends, s.

    Raises:
        UsageError: As `open_link`.
        LogError: As `open_link`; or a sample is one of another number of joints, or none came.
    """
    n = len(joints)
    queue = SampleQueue(address)
    head = [
        ",".join(["t", *(f"{kind}_{joint}" for kind in ("q", "dq", "tau") for joint in joints)])
    ]
    with open_link(address) as channel:
        for frame in receive_frames(channel, idle):
            if frame is None:
                if rows := queue.release():
                    yield "\n".join([*head, *rows, ""]).encode()
                    head = []
            elif frame.type == LOG_FRAME:
                if len(frame.body) != 12 + 12 * n:
                    what = f"sends samples of {(len(frame.body) - 12) / 12:g} joints"
                    raise LogError(address, what, f"name the rig that runs there: this one has {n}")
                time_us, lost, *values = struct.unpack(f"<QI{3 * n}f", frame.body)
                queue.push(Sample(time_us, time.monotonic(), lost, tuple(values)))
    if queue.is_empty:
        raise LogError(
            address, f"sent no two samples within {idle:g} s", "see that the gimbal runs there"
        )
    if rows := queue.release(is_last=True):
        yield "\n".join([*head, *rows, ""]).encode()
