"""How many threads the products of small matrices use."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def limit_to_one_thread() -> Iterator[None]:
    """Let linear algebra use one thread: matrices here are small and many, and threads would wait for each other.

    Left alone, OpenBLAS takes every processor that there is.
    """
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1, user_api="blas"):
        yield
