"""What the concepts put into the factor graph."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial

import gtsam

from sgraph_concepts.errors import ConceptError
from sgraph_concepts.registry import Registry
from sgraph_concepts.spec import WALL_SURFACE
from sgraph_concepts.types import ConceptNode, FactorContext, FactorResult
from sgraph_core.backend.keys import Keys
from sgraph_core.backend.low_layers import world_planes
from sgraph_core.concepts import installed
from sgraph_core.graph import SGraph

__all__ = ["NO_FACTOR", "ConceptFactors", "concept_factors", "made_by"]

NO_FACTOR = "none"
"""Named instead of a factor type, it leaves a concept's factors out."""


@dataclass(frozen=True, eq=False)
class ConceptFactors:
    """The factors of the concepts' nodes, plain gtsam objects that stay valid in any graph.

    Attributes:
        graph: all factors.
        values: initial values of the nodes' own variables.
        of_node: indices into ``graph`` of each node's factors, by concept and node id.
    """

    graph: gtsam.NonlinearFactorGraph
    values: gtsam.Values
    of_node: Mapping[tuple[str, int], list[int]]


def concept_factors(
    graph: SGraph,
    keys: Keys | None = None,
    factor_types: Mapping[str, str] | None = None,
    registry: Registry | None = None,
) -> ConceptFactors:
    """Return the factors of all nodes of an S-Graph.

    Members that no keyframe observed have no plane variable; a node with too few others adds
    nothing.

    Args:
        graph: the S-Graph with its nodes.
        keys: the keys of keyframes, surfaces and nodes.
        factor_types: by concept, another factor type than the declared one: ``none``, a built-in
            such as ``published``, or ``package.module:function``.
        registry: the concepts; the installed ones by default.

    Raises:
        ConceptError: a factor type is unknown, or a plugin's factor function fails.
    """
    keys, registry = keys or Keys(), registry if registry is not None else installed()
    chosen = dict(factor_types or {})
    for name in chosen:
        registry[name]  # raises if there is none
    factors, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    of_node: dict[tuple[str, int], list[int]] = {}
    for node, name, result in _results(graph, keys, chosen, registry):
        first = factors.size()
        for factor in result.factors:
            factors.add(factor)
        for key, value in result.values:
            values.insert(key, value)
        if result.factors:
            of_node[name, node.id] = list(range(first, factors.size()))
    return ConceptFactors(factors, values, of_node)


def _results(
    graph: SGraph, keys: Keys, chosen: Mapping[str, str], registry: Registry
) -> Iterator[tuple[ConceptNode, str, FactorResult]]:
    planes, segments = world_planes(graph), graph.wall_surfaces.segments
    observed = {i: graph.surface_row(i) for i in graph.observations.surface_ids.tolist()}
    plane_keys = {i: keys.surface(i) for i in observed}
    for concept in registry:
        name, spec = concept.spec.name, concept.spec
        nodes = graph.concepts.get(name, [])
        reference = chosen.get(name, spec.factor)
        if reference in (None, NO_FACTOR) or spec.groups != WALL_SURFACE or not nodes:
            continue
        make = registry.part(name, "factor", reference)
        for node in nodes:
            members = [member for member in node.members if member in observed]
            context = FactorContext(
                {i: plane_keys[i] for i in members},
                {i: planes[observed[i]] for i in members},
                {i: segments[observed[i]] for i in members},
                nodes,
                partial(keys.node, name, node.id),
            )
            yield node, name, made_by(make, name, node, context)


def made_by(
    make: Callable[[ConceptNode, FactorContext], FactorResult],
    concept: str,
    node: ConceptNode,
    context: FactorContext,
) -> FactorResult:
    """Return what a concept's factor function makes of a node.

    Raises:
        ConceptError: it fails, or returns something else.
    """
    try:
        result = make(node, context)
    except Exception as error:  # a third party's code may raise anything
        raise ConceptError(f"factor of {concept} {node.id} fails: {error}") from error
    if not isinstance(result, FactorResult):
        raise ConceptError(f"factor of concept {concept!r} must return a FactorResult")
    return result
