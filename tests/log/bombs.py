"""Small files that unfold to more memory than a call may take."""

from __future__ import annotations

import io
import struct
import zlib

BLOCK = 2**24
"""Size of the zeros that are packed once, bytes; larger contents repeat them."""
BLOCKS = 80
"""Number of blocks: a quarter more than a log may hold."""
FULL = 0xFFFFFFF0
"""Size that an archive states without its 64-bit fields."""


def deflate() -> bytes:
    """Return a raw deflate stream of so many blocks of zeros."""
    pack = zlib.compressobj(9, zlib.DEFLATED, -15)
    block = pack.compress(bytes(BLOCK)) + pack.flush(zlib.Z_FULL_FLUSH)
    return block * BLOCKS + pack.flush()


def npz(stated: int) -> bytes:
    """Return an archive of one array that states a size, true or not."""
    content = deflate()
    sizes = struct.pack("<HHHHHIIIHH", 20, 0, 8, 0, 0, 0, len(content), stated, 5, 0)
    local = b"PK\x03\x04" + sizes + b"t.npy" + content
    place = struct.pack("<HHHII", 0, 0, 0, 0, 0)
    central = b"PK\x01\x02" + struct.pack("<H", 20) + sizes + place + b"t.npy"
    end = struct.pack("<4sHHHHIIH", b"PK\x05\x06", 0, 0, 1, 1, len(central), len(local), 0)
    return local + central + end


def hdf5() -> bytes:
    """Return HDF5 of one array of 8 TiB that is nothing but its shape."""
    import h5py

    sink = io.BytesIO()
    with h5py.File(sink, "w") as file:
        file.create_dataset("t", (2**40,), "f8", chunks=(BLOCK,), compression="gzip")
    return sink.getvalue()
