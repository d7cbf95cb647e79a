"""A running gimbal on the other end of a serial line or UDP: frames in and out, its log as lines of a growing CSV.

A frame is ``uint8 version, uint8 type, uint16 sequence``, a body and a CRC (CCITT-FALSE), stuffed by COBS (Cheshire and
Baker, IEEE/ACM Trans. Networking 7(2), 1999) with a zero byte at its end, little-endian throughout; `gimbal_link.h` of
an exported controller lists the bodies. New parameters bear a count and a tag of a secret that both ends share.
"""

from __future__ import annotations

import re
import socket
import struct
import time
from binascii import crc_hqx
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from math import inf
from pathlib import Path
from typing import NamedTuple

from gimbal_pin.errors import LogError, UsageError
from gimbal_pin.rig.reading import read_bytes

_VERSION = 1
_HELLO, LOG_FRAME, _TUNE, _ANSWER = 1, 2, 3, 4
"""Types of frames: a host asks for the log, a sample, new parameters, what became of them."""
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
"""Longest that a datagram is overtaken by later ones, s: a stamp from before that is of a gimbal that began anew, whose
samples follow after as long a gap."""


_REFUSALS = (
    ("runs a controller of other joints or terms", "flash the sources that --c writes"),
    (
        "refuses these gains or terms: out of the range that gimbal_link.h states",
        "tune for the delay of the gimbal that runs",
    ),
    ("has another secret, or none", "give gimbal_link_start and --secret the same"),
    ("was tuned by a host whose clock is ahead", "set this machine's clock"),
)
"""What a gimbal's status means, from 1 on, and the correction."""
_LARGEST_WORD = 2**64 - 1
"""The largest word of SipHash: sums are taken modulo its successor."""


class Frame(NamedTuple):
    """One frame.

    Attributes:
        type: `_HELLO` to `_ANSWER`.
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
    plain = _pack_header(frame) + frame.body
    return _stuff(plain + struct.pack("<H", crc_hqx(plain, 0xFFFF))) + b"\0"


def decode_frame(data: bytes) -> Frame | None:
    """Return the frame of the bytes between two zeros, or None: cut, corrupted, or of another version."""
    plain = _unstuff(data)
    if plain is None or len(plain) < 6 or plain[0] != _VERSION:
        return None
    if crc_hqx(plain[:-2], 0xFFFF) != int.from_bytes(plain[-2:], "little"):
        return None
    return Frame(plain[1], int.from_bytes(plain[2:4], "little"), plain[4:-2])


def seal_frame(frame: Frame, secret: bytes, count: int) -> Frame:
    """Return a frame whose body ends in a count and the tag of header, body and count under a secret of 16 bytes."""
    body = frame.body + struct.pack("<Q", count)
    return frame._replace(body=body + compute_siphash(secret, _pack_header(frame) + body))


def read_secret(path: str | Path) -> bytes:
    """Return a file's secret of 16 bytes; `UsageError` unless it holds 32 hexadecimal digits that are not all zero."""
    text = read_bytes(path, most=4096).strip()
    if re.fullmatch(rb"[\da-fA-F]{32}", text) is None or not int(text, 16):
        mend = f"make one: openssl rand -hex 16 > {Path(path).name}"
        raise UsageError(str(path), "is no secret of 32 hexadecimal digits", mend)
    return bytes.fromhex(text.decode())


def _pack_header(frame: Frame) -> bytes:
    """Return the bytes before a frame's body."""
    return struct.pack("<BBH", _VERSION, frame.type, frame.sequence % 2**16)


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
    out, at = bytearray(), 0
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
            host, port = found["host"].strip("[]"), int(found["port"])
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
            found["device"], int(found["baud"]), timeout=_READ_TIMEOUT, write_timeout=_HELLO_INTERVAL
        ) as line:
            yield LinkChannel(address, lambda: line.read(max(1, line.in_waiting)), line.write)
    except (OSError, OverflowError, ValueError) as error:  # pyserial's own are OSErrors, or of a baud rate that is none
        raise LogError(address, f"cannot be reached ({error})", "see that the gimbal runs there") from error


def _receive(udp: socket.socket) -> bytes:
    """Return a datagram; nothing where none came, or where nobody listens yet."""
    try:
        return udp.recv(_LONGEST_FRAME) + b"\0"  # no frame goes on in another datagram: what is none ends here
    except TimeoutError:
        return b""
    except ConnectionRefusedError:
        time.sleep(_READ_TIMEOUT)
        return b""


def receive_frames(channel: LinkChannel, idle: float = inf) -> Iterator[Frame | None]:
    """Yield the frames that come, and None every `_READ_TIMEOUT`, until none came for `idle` seconds."""
    rest, count, heard, greeted, paused = b"", 0, time.monotonic(), -inf, -inf
    while True:
        now, before = time.monotonic(), heard
        if now - greeted >= _HELLO_INTERVAL:
            _send(channel, encode_frame(Frame(_HELLO, count, b"")))
            greeted, count = now, count + 1
        *parts, rest = (rest + channel.read()).split(b"\0")
        rest = rest[-_LONGEST_FRAME:]
        for part in parts:
            if part and (frame := decode_frame(part)) is not None:
                heard = now
                yield frame
        if heard == before and now - heard > idle:  # what came while the last frame was worked on has been read
            break
        if now - paused >= _READ_TIMEOUT:
            paused = now
            yield None
    yield None


def _send(channel: LinkChannel, data: bytes) -> None:
    """Send bytes; where nobody listens yet they are lost, as on a line."""
    try:
        channel.write(data)
    except ConnectionRefusedError:
        return


def follow_link(address: str, joints: Sequence[str], idle: float = inf) -> Iterator[bytes]:
    """Yield the log of a running gimbal as CSV text, several lines at a time.

    Samples that come late are left out. A gimbal that begins anew counts from 0 again: its samples follow those before,
    after a gap, under a comment that says so.

    Args:
        address: ``udp://host:port`` or ``serial:/dev/…@baud``.
        joints: The rig's joints, in whose order the gimbal sends.
        idle: Time without a frame after which the log ends, s.

    Raises:
        UsageError, LogError: As `open_link`; or a sample is one of another number of joints, or none came.
    """
    n, newest, start, gap = len(joints), -1, 0, round(1e6 * _REORDERING)
    text = [",".join(["t", *(f"{kind}_{joint}" for kind in ("q", "dq", "tau") for joint in joints)])]
    with open_link(address) as channel:
        for frame in receive_frames(channel, idle):
            if frame is None:
                if text and newest >= 0:
                    yield ("\n".join(text) + "\n").encode()
                    text = []
            elif frame.type == LOG_FRAME:
                if len(frame.body) != 12 + 12 * n:
                    what = f"sends samples of {(len(frame.body) - 12) / 12:g} joints"
                    raise LogError(address, what, f"name the rig that runs there: this one has {n}")
                time_us, _, *values = struct.unpack(f"<QI{3 * n}f", frame.body)
                if (time_us := time_us + start) < newest - gap:
                    shift = newest + gap - time_us
                    start, time_us = start + shift, time_us + shift
                    text.append(f"# {1e-6 * time_us:.1f} s: {address} began anew, which is a trajectory of its own")
                if time_us > newest:
                    newest = time_us
                    text.append(",".join([f"{1e-6 * time_us:.6f}", *(f"{x:.9g}" for x in values)]))
    if newest < 0:
        raise LogError(address, f"sent no sample within {idle:g} s", "see that the gimbal runs there")


def send_parameters(address: str, body: bytes, secret: bytes, patience: float = 3.0) -> int:
    """Send new parameters to a running gimbal, and return the status that it answers.

    They are sent again each half second until it answers: to apply them twice is to apply them once. They are counted
    by this machine's clock, ns since 1970, so that what any host sent before is older.

    Raises:
        UsageError, LogError: As `open_link`; or no answer came within `patience` seconds.
    """
    end, sequence, due = time.monotonic() + patience, time.time_ns() >> 20 & 0xFFFF, -inf
    with open_link(address) as channel:
        for frame in receive_frames(channel, patience):
            now = time.monotonic()
            if frame is not None and frame.type == _ANSWER and len(frame.body) == 4:
                asked, status = struct.unpack("<HH", frame.body)
                if asked == sequence:
                    return int(status)
            if now > end:
                break
            if now >= due:
                _send(channel, encode_frame(seal_frame(Frame(_TUNE, sequence, body), secret, time.time_ns())))
                due = now + 0.5
    raise LogError(address, f"did not answer within {patience:g} s", "see that the gimbal runs there")


def check_answer(address: str, status: int) -> None:
    """Raise `UsageError` unless a gimbal's status says that new parameters are in force."""
    if status:
        raise UsageError(address, *_REFUSALS[min(status, len(_REFUSALS)) - 1])


def compute_siphash(key: bytes, data: bytes) -> bytes:
    """Return the tag of bytes under a key of 16 bytes, SipHash-2-4: 8 bytes, little-endian.

    Only who has the key can make it (Aumasson and Bernstein, INDOCRYPT 2012).
    """
    low, high = struct.unpack("<QQ", key)
    start = struct.unpack(">4Q", b"somepseudorandomlygeneratedbytes")
    a, b, c, d = (word ^ half for word, half in zip(start, (low, high, low, high)))
    padded = data + bytes(7 - len(data) % 8) + bytes([len(data) % 256])
    for (word,) in struct.iter_unpack("<Q", padded):
        a, b, c, d = _mix_state((a, b, c, d ^ word), 2)
        a ^= word
    a, b, c, d = _mix_state((a, b, c ^ 0xFF, d), 4)
    return struct.pack("<Q", a ^ b ^ c ^ d)


def _mix_state(state: tuple[int, int, int, int], rounds: int) -> tuple[int, int, int, int]:
    """Return the state after so many rounds of sums, rotations and exclusive ors."""
    a, b, c, d = state
    for _ in range(rounds):
        a, c = (a + b) & _LARGEST_WORD, (c + d) & _LARGEST_WORD
        b, d = _rotate_left(b, 13) ^ a, _rotate_left(d, 16) ^ c
        a, c = (_rotate_left(a, 32) + d) & _LARGEST_WORD, (c + b) & _LARGEST_WORD
        b, d = _rotate_left(b, 17) ^ c, _rotate_left(d, 21) ^ a
        c = _rotate_left(c, 32)
    return a, b, c, d


def _rotate_left(word: int, bits: int) -> int:
    """Return a word of 64 bits turned left."""
    return (word << bits | word >> 64 - bits) & _LARGEST_WORD
