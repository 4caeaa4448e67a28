"""The one-line calls: infer, and what comes with it."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

from sgraph_core.detector import Detector, Scorer
from sgraph_core.graph import SGraph

__all__ = ["infer"]


@cache
def _detector(scorer: Scorer) -> Detector:
    return Detector(scorer=scorer)


def infer(
    graph: SGraph,
    concepts: Sequence[str] | None = None,
    *,
    scorer: Scorer = "network",
    optimize: bool = False,
) -> SGraph:
    """Return a copy of an S-Graph with its concepts inferred, by all installed plugins.

    Args:
        graph: the S-Graph; it is not changed.
        concepts: names of the concepts to infer; all by default. Others are kept as they are.
        scorer: ``network``, or ``baseline`` for the rules without learning.
        optimize: also solve the factor graph with the concepts' factors, and move keyframes and
            surfaces accordingly (see :mod:`sgraph_core.backend`).

    Raises:
        SGraphError: the graph or a plugin breaks a rule; see :class:`sgraph_core.Detector` and
            :func:`sgraph_core.backend.optimize`.
    """
    result = _detector(scorer).infer(graph, concepts)
    if optimize:
        from sgraph_core.backend import optimize as solve

        result = solve(result).graph
    return result
