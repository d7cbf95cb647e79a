"""Parquet files of other types, other shapes, and damaged ones."""

from __future__ import annotations

import decimal
from collections.abc import Callable
from io import BytesIO
from typing import Any

import numpy as np

from fuzzing.damaged_bytes import damaged as torn
from fuzzing.damaged_csv import damaged as wrong
from fuzzing.junk import one, text


def written(columns: dict[str, Any], **options: Any) -> bytes:
    """Return columns as a Parquet file."""
    import pyarrow
    import pyarrow.parquet

    sink = BytesIO()
    table = pyarrow.Table.from_arrays(list(columns.values()), names=list(columns))
    pyarrow.parquet.write_table(table, sink, **options)
    return sink.getvalue()


def typed(rng: np.random.Generator, x: np.ndarray) -> Any:
    """Return a column in another type."""
    import pyarrow as pa

    def nested() -> Any:
        return pa.array([{"a": float(value)} for value in x])

    def sparse() -> Any:
        return pa.array([None if rng.random() < 0.1 else float(value) for value in x], pa.float64())

    ways: tuple[Callable[[], Any], ...] = (
        lambda: pa.array(x.astype(np.float32)),
        lambda: pa.array(x.astype(np.float16)),
        lambda: pa.array(np.round(1000 * x).astype(np.int64)),
        lambda: pa.array(np.abs(np.round(x)).astype(np.uint8)),
        lambda: pa.array([str(value) for value in x]),
        lambda: pa.array([str(value) for value in np.round(x)]).dictionary_encode(),
        lambda: pa.array(np.round(x, 1)).dictionary_encode(),
        lambda: pa.array(x > 0),
        lambda: pa.array(np.round(1e6 * x).astype(np.int64), pa.timestamp("us")),
        lambda: pa.array([decimal.Decimal(repr(round(float(value), 6))) for value in x]),
        lambda: pa.array([[float(value)] for value in x]),
        lambda: pa.array([b"\x1b[31m" for _ in x]),
        lambda: pa.nulls(len(x)),
        lambda: pa.array(np.full(len(x), 2**62)),
        lambda: pa.array(np.full(len(x), one(rng, (np.nan, np.inf, 1e300, 1e160, 1e-320, 0.0)))),
        nested,
        sparse,
    )
    return one(rng, ways)()


def damaged(rng: np.random.Generator, columns: dict[str, np.ndarray], table: bytes, whole: bytes) -> bytes:
    """Return a damaged file; `columns` and `table` (CSV) hold what the `whole` file holds."""
    import pyarrow as pa

    kind = rng.random()
    if kind < 0.35:
        return torn(rng, whole)
    if kind < 0.5:
        return one(rng, (b"", b"PAR1", b"PAR1PAR1", whole[:4] + whole[-8:], wrong(rng, table), whole[:-4] + b"PARE"))
    count = one(rng, (0, 1, 2, 10, *[len(columns["t"])] * 8))
    data = {name: pa.array(x[:count]) for name, x in columns.items()}
    for _ in range(int(rng.integers(1, 3))):
        name = one(rng, list(columns))
        if rng.random() < 0.7:
            data[name] = typed(rng, columns[name][:count])
        elif rng.random() < 0.5:
            data[text(rng)] = data.pop(name, pa.nulls(count))
        else:
            data.pop(name, None)
    if rng.random() < 0.05:
        data |= {f"column{k}": pa.nulls(count) for k in range(3000)}
    compressed = one(rng, ("snappy", "gzip", "zstd", "none", "brotli"))
    try:
        return written(data, compression=compressed, row_group_size=one(rng, (None, 7)))
    except (pa.ArrowException, ValueError, TypeError):
        return whole[: len(whole) // 2]
