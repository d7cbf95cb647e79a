"""How many threads the products of small matrices use."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def one_thread() -> Iterator[None]:
    """Let linear algebra use one thread: matrices here are small and many, and threads would wait for each other.

    On four processors OpenBLAS takes four; an identification then costs twice the processor's time, a diagnosis four
    times.
    """
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1, user_api="blas"):
        yield
