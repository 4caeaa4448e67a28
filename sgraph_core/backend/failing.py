"""What fails while a factor graph is solved becomes one line."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from sgraph_concepts.errors import OptimizationError, one_line

__all__ = ["failing_as"]


@contextmanager
def failing_as(what: str) -> Iterator[None]:
    """Raise OptimizationError, beginning with ``what``, for whatever fails inside."""
    try:
        yield
    except Exception as error:  # a third party's factors may raise anything
        raise OptimizationError(f"{what}: {one_line(error)}") from error
