"""How many threads the products of a diagnosis' matrices use."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def one_thread() -> Iterator[None]:
    """Let linear algebra use one thread: its matrices are small and many, and threads would wait for each other.

    On four processors OpenBLAS takes four, and a diagnosis four times the processor's time.
    """
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1, user_api="blas"):
        yield
