"""What the concepts put into the factor graph."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import gtsam
import numpy as np

from sgraph_concepts.errors import ConceptError, one_line
from sgraph_concepts.registry import RegisteredConcept, Registry
from sgraph_concepts.spec import WALL_SURFACE
from sgraph_concepts.types import (
    ConceptNode,
    FactorContext,
    FactorResult,
    FloatArray,
    Memory,
)
from sgraph_core.backend.association import TIE_SIGMAS, Proposal, Same, associate
from sgraph_core.backend.checks import check_factors, check_result
from sgraph_core.backend.coincidence import coincidence
from sgraph_core.backend.keys import Keys
from sgraph_core.backend.low_layers import vertical_planes, world_planes
from sgraph_core.backend.observed import Observed, observed_in
from sgraph_core.backend.ties import TieNoise, tie_planes
from sgraph_core.concepts import installed
from sgraph_core.graph import SGraph
from sgraph_core.nodes import check_nodes

__all__ = [
    "ConceptFactors",
    "FactorGroup",
    "concept_factors",
    "factor_context",
    "factor_functions",
    "factors_of_nodes",
    "made_by",
    "propose",
    "ties",
    "with_ties",
]

NO_FACTOR = "none"
"""Named instead of a factor type, it leaves a concept's factors out."""
FactorFunction = Callable[[ConceptNode, FactorContext], FactorResult]


@dataclass(frozen=True)
class FactorGroup:
    """Factors that stand or fall together: a node's own, or a tie of two surfaces it shows.

    Attributes:
        concept, node: whose they are.
        surfaces: ids of the two surfaces of a tie; empty for the node's own factors.
        indices: into the graph of :class:`ConceptFactors`.
    """

    concept: str
    node: int
    surfaces: tuple[int, ...]
    indices: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class ConceptFactors:
    """The factors of the concepts' nodes, plain gtsam objects that stay valid in any graph.

    Attributes:
        graph: all factors.
        values: initial values of the nodes' own variables.
        groups: which factors stand or fall together.
        proposals: pairs of surfaces that the nodes take for one, tied or not.
    """

    graph: gtsam.NonlinearFactorGraph
    values: gtsam.Values
    groups: Sequence[FactorGroup]
    proposals: Sequence[Proposal] = ()

    @property
    def of_node(self) -> Mapping[tuple[str, int], list[int]]:
        """Indices into ``graph`` of each node's factors, by concept and node id."""
        indices: dict[tuple[str, int], list[int]] = {}
        for group in self.groups:
            indices.setdefault((group.concept, group.node), []).extend(group.indices)
        return indices


def concept_factors(
    graph: SGraph,
    keys: Keys | None = None,
    factor_types: Mapping[str, str] | None = None,
    registry: Registry | None = None,
    same: Sequence[Same] | None = None,
    origin: FloatArray | None = None,
) -> ConceptFactors:
    """Return the factors of all nodes of an S-Graph.

    Members that no keyframe observed have no plane variable; a node with too few others adds
    nothing.

    Args:
        graph: the S-Graph with its nodes.
        keys: the keys of keyframes, surfaces, nodes and ties.
        factor_types: by concept, another factor type than the declared one: ``none``, a built-in
            such as ``published``, or ``package.module:function``.
        registry: the concepts; the installed ones by default.
        same: the pairs of surfaces to tie, or None to find them: of those that the nodes propose,
            the ones that :func:`sgraph_core.backend.association.associate` accepts. For that the
            low layers of the S-Graph should be solved.
        origin: world position of the S-Graph's (0, 0), [2], for factors that refer to the world.

    Raises:
        InputError: a node breaks the map file's rules.
        ConceptError: a factor type is unknown, a plugin's factor function fails, or its factors
            are not fit for a graph: see :func:`sgraph_core.backend.checks.check_factors`.
        OptimizationError: pairs to tie cannot be found, as ``associate`` raises it.
    """
    check_nodes(graph.concepts, set(graph.wall_surfaces.ids.tolist()))
    keys = keys or Keys()
    made = factors_of_nodes(graph, keys, factor_types, registry, origin)
    if same is None:
        same = associate(graph, made.proposals).same
    return with_ties(made, same, graph, keys)


def factors_of_nodes(
    graph: SGraph,
    keys: Keys,
    factor_types: Mapping[str, str] | None,
    registry: Registry | None,
    origin: FloatArray | None,
) -> ConceptFactors:
    """Return the factors of all nodes of an S-Graph, which keep the map file's rules, without ties.

    See :func:`concept_factors`.
    """
    registry = registry if registry is not None else installed()
    collected = _Collected(gtsam.NonlinearFactorGraph(), gtsam.Values(), [], [])
    surfaces = np.unique(graph.observations.surface_ids).tolist()
    of_surface = world_planes(graph)
    planes = {keys.surface(i): of_surface[graph.surface_row(i)] for i in surfaces}
    for name, node, result in _results(graph, keys, factor_types or {}, registry, origin):
        check_factors(f"factor of {name} {node.id}", result, planes, collected.values)
        collected.add(name, node.id, (), result)
        collected.proposals.append(Proposal(name, node.id, result.same))
    return collected.done()


def with_ties(
    concepts: ConceptFactors, same: Sequence[Same], graph: SGraph, keys: Keys
) -> ConceptFactors:
    """Return factors with further pairs of surfaces tied."""
    collected = _Collected(
        gtsam.NonlinearFactorGraph(concepts.graph),
        gtsam.Values(concepts.values),
        list(concepts.groups),
        list(concepts.proposals),
    )
    collected.tie(same, graph, keys)
    return collected.done()


def propose(
    graph: SGraph,
    factor_types: Mapping[str, str] | None,
    registry: Registry | None,
    origin: FloatArray | None = None,
) -> list[Proposal]:
    """Return the pairs of surfaces that the nodes of an S-Graph take for one."""
    registry = registry if registry is not None else installed()
    return [
        Proposal(name, node.id, result.same)
        for name, node, result in _results(graph, Keys(), factor_types or {}, registry, origin)
    ]


@dataclass(eq=False)
class _Collected:
    graph: gtsam.NonlinearFactorGraph
    values: gtsam.Values
    groups: list[FactorGroup]
    proposals: list[Proposal]

    def add(self, concept: str, node: int, surfaces: tuple[int, ...], result: FactorResult) -> None:
        first = self.graph.size()
        for factor in result.factors:
            self.graph.add(factor)
        for key, value in result.values:
            self.values.insert(key, value)
        if result.factors:
            indices = tuple(range(first, self.graph.size()))
            self.groups.append(FactorGroup(concept, node, surfaces, indices))

    def tie(self, same: Sequence[Same], graph: SGraph, keys: Keys) -> None:
        for pair, result in zip(same, ties(same, graph, keys), strict=True):
            self.add(pair.concept, pair.node, pair.pair, result)

    def done(self) -> ConceptFactors:
        return ConceptFactors(self.graph, self.values, self.groups, self.proposals)


def ties(same: Sequence[Same], graph: SGraph, keys: Keys) -> list[FactorResult]:
    """Return what ties each two surfaces of an S-Graph that are one."""
    surfaces = graph.wall_surfaces.ordered()
    rows = [[graph.surface_row(i) for i in pair.pair] for pair in same]
    one, two = np.array(rows, np.int64).reshape(-1, 2).T
    lie, normals = coincidence(surfaces, one, two), surfaces.normals[one]
    centres = lie.points + lie.gaps[:, None] / 2 * normals
    return [
        tie_planes(
            (keys.surface(pair.pair[0]), keys.surface(pair.pair[1])),
            keys.tie(*pair.pair),
            centre,
            normal,
            None,
            TieNoise(*TIE_SIGMAS),
        )
        for pair, centre, normal in zip(same, centres, normals, strict=True)
    ]


def _results(
    graph: SGraph,
    keys: Keys,
    factor_types: Mapping[str, str],
    registry: Registry,
    origin: FloatArray | None,
) -> Iterator[tuple[str, ConceptNode, FactorResult]]:
    grouping = [concept for concept in registry if concept.spec.groups == WALL_SURFACE]
    there = [concept for concept in grouping if graph.concepts.get(concept.spec.name)]
    observed = observed_in(graph)
    for name, make in factor_functions(registry, there, factor_types).items():
        nodes, memory = graph.concepts[name], Memory()
        for node in nodes:
            context = factor_context(name, node, nodes, keys, observed, memory, origin)
            yield name, node, made_by(make, name, node, context)


def factor_context(
    concept: str,
    node: ConceptNode,
    nodes: Sequence[ConceptNode],
    keys: Keys,
    observed: Observed,
    memory: Memory,
    origin: FloatArray | None = None,
) -> FactorContext:
    """Return what a concept's factor function is told of a node.

    Args:
        concept: its concept.
        node: whose factors.
        nodes: all nodes of the concept.
        keys: of surfaces and nodes.
        observed: the surfaces that some keyframe observed.
        memory: of what the function computes once for all of these nodes.
        origin: world position of the coordinates' (0, 0), [2]; that itself by default.
    """
    members = [member for member in node.members if member in observed.rows]
    own = [observed.rows[member] for member in members]
    segments = observed.surfaces.segments[own]
    planes = vertical_planes(segments, observed.surfaces.normals[own])
    return FactorContext(
        {member: keys.surface(member) for member in members},
        dict(zip(members, planes, strict=True)),
        dict(zip(members, segments, strict=True)),
        nodes,
        partial(keys.node, concept, node.id),
        observed.near,
        dict(zip(members, observed.first_seen[own].tolist(), strict=True)),
        memory,
        np.zeros(2) if origin is None else origin,
    )


def factor_functions(
    registry: Registry, concepts: Iterable[RegisteredConcept], factor_types: Mapping[str, str]
) -> dict[str, FactorFunction]:
    """Return the factor functions of those of some concepts that have one, by name.

    Raises:
        ConceptError: a concept or a factor type is unknown.
    """
    for name in factor_types:
        registry[name]  # raises if there is none
    types = {c.spec.name: factor_types.get(c.spec.name, c.spec.factor) for c in concepts}
    return {
        name: registry.part(name, "factor", reference)
        for name, reference in types.items()
        if reference not in (None, NO_FACTOR)
    }


def made_by(
    make: FactorFunction,
    concept: str,
    node: ConceptNode,
    context: FactorContext,
) -> FactorResult:
    """Return what a concept's factor function makes of a node.

    Raises:
        ConceptError: it fails, or returns something else than factors and pairs of surfaces.
    """
    try:
        result = make(node, context)
    except Exception as error:  # a third party's code may raise anything
        raise ConceptError(f"factor of {concept} {node.id} fails: {one_line(error)}") from error
    if not isinstance(result, FactorResult):
        raise ConceptError(f"factor of concept {concept!r} must return a FactorResult")
    check_result(f"factor of {concept} {node.id}", result)
    return result
