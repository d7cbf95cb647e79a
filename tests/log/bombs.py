"""Small files that unfold to more memory than a call may take."""

from __future__ import annotations

import io
import struct
import zlib

BLOCK = 2**24
"""Size of the zeros that are packed once, bytes; larger contents repeat them."""
BLOCKS = 512
"""Number of blocks, 8 GiB: eight times what a log may hold."""
FULL = 0xFFFFFFF0
"""Size that an archive states without its 64-bit fields."""


def deflated(blocks: int, head: bytes = b"") -> bytes:
    """A raw deflate stream of `head` and so many blocks of zeros."""
    pack = zlib.compressobj(9, zlib.DEFLATED, -15)
    begin = pack.compress(head) + pack.flush(zlib.Z_FULL_FLUSH)
    block = pack.compress(bytes(BLOCK)) + pack.flush(zlib.Z_FULL_FLUSH)
    return begin + block * blocks + pack.flush()


def gz() -> bytes:
    """A gzip file without a checksum."""
    return b"\x1f\x8b\x08\0\0\0\0\0\0\xff" + deflated(BLOCKS) + bytes(8)


def npz(stated: int) -> bytes:
    """An archive of one array that states a size, true or not."""
    content = deflated(BLOCKS)
    name = b"t.npy"
    sizes = struct.pack("<HHHHHIIIHH", 20, 0, 8, 0, 0, 0, len(content), stated, len(name), 0)
    local = b"PK\x03\x04" + sizes + name + content
    central = (
        b"PK\x01\x02" + struct.pack("<H", 20) + sizes + struct.pack("<HHHII", 0, 0, 0, 0, 0) + name
    )
    return (
        local
        + central
        + struct.pack("<4sHHHHIIH", b"PK\x05\x06", 0, 0, 1, 1, len(central), len(local), 0)
    )


def mat() -> bytes:
    """MATLAB's version 5: one packed array of 2 GiB, half of what its sizes can state."""
    count = 128 * BLOCK // 8
    parts = (
        struct.pack("<IIII", 6, 8, 6, 0)
        + struct.pack("<IIii", 5, 8, count, 1)
        + struct.pack("<HH4s", 1, 1, b"t")
    )
    parts += struct.pack("<II", 9, 8 * count)
    inner = struct.pack("<II", 14, len(parts) + 8 * count) + parts
    content = b"\x78\x9c" + deflated(128, inner) + bytes(4)
    return (
        b"MATLAB 5.0 MAT-file".ljust(124)
        + b"\0\1IM"
        + struct.pack("<II", 15, len(content))
        + content
    )


def hdf5() -> bytes:
    """HDF5 of one array of 8 TiB that is nothing but its shape."""
    import h5py

    sink = io.BytesIO()
    with h5py.File(sink, "w") as file:
        file.create_dataset("t", (2**40,), "f8", chunks=(BLOCK,), compression="gzip")
    return sink.getvalue()


def parquet(groups: int) -> bytes:
    """Parquet of one column without a value, 128 MiB of doubles a group."""
    import pyarrow
    import pyarrow.parquet

    sink = io.BytesIO()
    table = pyarrow.table({"t": pyarrow.nulls(BLOCK, pyarrow.float64())})
    with pyarrow.parquet.ParquetWriter(sink, table.schema, write_statistics=False) as file:
        for _ in range(groups):
            file.write_table(table)
    return sink.getvalue()
