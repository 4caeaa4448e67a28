"""The one-line calls: infer, and what comes with it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from typing import TYPE_CHECKING

from sgraph_core.detector import Detector, Scorer
from sgraph_core.graph import SGraph

if TYPE_CHECKING:
    from sgraph_core.backend import Optimization

__all__ = ["infer", "infer_and_optimize"]


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
    detector = _detector(scorer)
    if optimize:
        return infer_and_optimize(graph, detector, concepts)[0]
    return detector.infer(graph, concepts)


def infer_and_optimize(
    graph: SGraph,
    detector: Detector,
    concepts: Sequence[str] | None = None,
    factor_types: Mapping[str, str] | None = None,
) -> tuple[SGraph, Optimization]:
    """Infer concepts and solve the factor graph with them.

    The low layers are solved first, since concepts are better found on a map that its own
    observations have straightened; then with the concepts' factors; then the concepts are inferred
    once more, so that they describe the map as it is in the end.

    Args:
        graph: the S-Graph; it is not changed.
        detector: infers the concepts.
        concepts: names of the concepts to infer; all by default.
        factor_types: by concept, another factor type than the declared one.

    Returns:
        The S-Graph, and the solution with the concepts' factors.

    Raises:
        SGraphError: see :meth:`sgraph_core.Detector.infer` and
            :func:`sgraph_core.backend.optimize`.
    """
    from sgraph_core import backend

    straightened = backend.optimize(graph, dict.fromkeys(graph.concepts, "none"), detector.registry)
    found = detector.infer(straightened.graph, concepts)
    solved = backend.optimize(found, factor_types, detector.registry)
    return detector.infer(solved.graph, concepts), solved
