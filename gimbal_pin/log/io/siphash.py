"""SipHash-2-4 (Aumasson and Bernstein, INDOCRYPT 2012): a tag that only who has the key can make."""

from __future__ import annotations

import struct

WORD = 2**64 - 1
"""The largest word: sums are taken modulo its successor."""


def siphash(key: bytes, data: bytes) -> bytes:
    """Return the tag of bytes under a key of 16 bytes: 8 bytes, little-endian."""
    low, high = struct.unpack("<QQ", key)
    start = struct.unpack(">4Q", b"somepseudorandomlygeneratedbytes")
    a, b, c, d = (word ^ half for word, half in zip(start, (low, high, low, high)))
    padded = data + bytes(7 - len(data) % 8) + bytes([len(data) % 256])
    for (word,) in struct.iter_unpack("<Q", padded):
        a, b, c, d = mix_state((a, b, c, d ^ word), 2)
        a ^= word
    a, b, c, d = mix_state((a, b, c ^ 0xFF, d), 4)
    return struct.pack("<Q", a ^ b ^ c ^ d)


def mix_state(state: tuple[int, int, int, int], rounds: int) -> tuple[int, int, int, int]:
    """Return the state after so many rounds of sums, rotations and exclusive ors."""
    a, b, c, d = state
    for _ in range(rounds):
        a, c = (a + b) & WORD, (c + d) & WORD
        b, d = rotate_left(b, 13) ^ a, rotate_left(d, 16) ^ c
        a, c = (rotate_left(a, 32) + d) & WORD, (c + b) & WORD
        b, d = rotate_left(b, 17) ^ c, rotate_left(d, 21) ^ a
        c = rotate_left(c, 32)
    return a, b, c, d


def rotate_left(word: int, bits: int) -> int:
    """Return a word of 64 bits turned left."""
    return (word << bits | word >> 64 - bits) & WORD
