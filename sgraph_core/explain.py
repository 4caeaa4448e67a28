"""Why surfaces are one node, or are not: the evidence behind what inference found.

Surfaces that were split count with their pieces: two of them are as likely related as their most
likely pair of pieces. Log-odds add up: the multicut that finds rooms joins two groups when the
log-odds of the pairs between them have a positive sum.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import shapely

from sgraph_concepts.errors import ConceptError, InputError
from sgraph_concepts.registry import RegisteredConcept
from sgraph_concepts.spec import WALL_SURFACE, ConceptSpec
from sgraph_concepts.types import ConceptNode, IntArray, NodeShape
from sgraph_core.detector import Detector, Trace
from sgraph_core.geometry import closest_distances
from sgraph_core.graph import SGraph
from sgraph_core.openings import Opening, openings, surfaces_along
from sgraph_core.pins import PINNED_CONCEPT, Pinned
from sgraph_core.sight import Sight, sight
from sgraph_core.visibility import visibility

__all__ = [
    "Balance",
    "BorderOpening",
    "Link",
    "Member",
    "NodeExplanation",
    "Outsider",
    "PairExplanation",
    "Relation",
    "explain_node",
    "explain_pair",
]


@dataclass(frozen=True)
class Link:
    """A scored relation between two wall surfaces.

    Attributes:
        one, two: ids of the surfaces.
        logit: log-odds of the relation as scored, which the clusterer weighs.
        probability: of the relation, calibrated where the concept declares how.
    """

    one: int
    two: int
    logit: float
    probability: float

    @property
    def scored_for(self) -> bool:
        """Whether the score speaks for the relation, which its probability alone does not tell."""
        return self.logit > 0


@dataclass(frozen=True)
class Balance:
    """All links between two groups of surfaces, the most likely first."""

    links: tuple[Link, ...]

    @cached_property
    def total(self) -> float:
        """Sum of the log-odds."""
        return sum((link.logit for link in self.links), 0.0)

    @property
    def mean_probability(self) -> float | None:
        """Mean probability of the links; None without any."""
        if not self.links:
            return None
        return sum(link.probability for link in self.links) / len(self.links)


@dataclass(frozen=True)
class Relation:
    """What one concept makes of two surfaces.

    Attributes:
        concept: its name.
        relation: the relation's name.
        link: the relation between the two; None if the scene does not relate them.
        nodes: ids of the nodes that hold the one, and of those that hold the other.
        balance: where the clusterer went against the link: if the two are apart, the links between
            their nodes; if they are together, the links of the one to the rest of the node.
        strays: where the two are scored for and apart, those of them that are in no node, with all
            their links.
        pinned: what the two are pinned to be, directly or over other surfaces; a pin is reason
            enough, so there is no balance, and no stray.

    Where nodes may share surfaces, a clusterer need not choose: there is no balance, and no stray.
    """

    concept: str
    relation: str
    link: Link | None
    nodes: tuple[tuple[int, ...], tuple[int, ...]]
    balance: Balance | None = None
    strays: tuple[tuple[int, Balance], ...] = ()
    pinned: Pinned | None = None

    @property
    def shared(self) -> tuple[int, ...]:
        """Ids of the nodes that hold both."""
        return tuple(node for node in self.nodes[0] if node in self.nodes[1])


@dataclass(frozen=True)
class PairExplanation:
    """Why two wall surfaces belong together, or do not.

    Attributes:
        one, two: their ids.
        copies: by id, the surface that preprocessing kept instead of one of them.
        distance_m: closest distance of the two.
        sight: lines of sight between them; None if both are the same surface, mapped twice.
        relations: by concept; none if both are the same surface.
    """

    one: int
    two: int
    copies: dict[int, int]
    distance_m: float
    sight: Sight | None
    relations: tuple[Relation, ...]


@dataclass(frozen=True)
class Member:
    """One member of a node.

    Attributes:
        id: its id.
        copy_of: id of the surface that preprocessing kept instead of it, if any.
        support: its links, or those of the surface kept instead, to the other members.
        pinned: ids of the other members that it is pinned together with.
    """

    id: int
    copy_of: int | None
    support: Balance
    pinned: tuple[int, ...] = ()


@dataclass(frozen=True)
class Outsider:
    """A surface outside a node.

    Attributes:
        id: its id.
        support: its links to the node's members.
        own: its links to the rest of its own group, where it can be in one node only.
        pinned: ids of the members that it is pinned apart from.
    """

    id: int
    support: Balance
    own: Balance | None
    pinned: tuple[int, ...] = ()


@dataclass(frozen=True, eq=False)
class BorderOpening:
    """An opening in a node's border, and what else lies there.

    Attributes:
        opening: the opening, in the world.
        facing: ids of surfaces outside the node that lie along it and face the inside.
        behind: ids of surfaces along it that face away, as the far side of a wall does.
    """

    opening: Opening
    facing: tuple[int, ...]
    behind: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class NodeExplanation:
    """Why a node is what it is.

    Attributes:
        concept: the concept's name.
        node: the node.
        members: by id.
        weakest: id of the member with the least support, among three or more; those that are pinned
            together with others are passed over.
        outsider: the surface outside with the most support; None if nothing is linked to the node.
        border: the openings in the border of the node's polygon.
    """

    concept: str
    node: ConceptNode
    members: tuple[Member, ...]
    weakest: int | None
    outsider: Outsider | None
    border: tuple[BorderOpening, ...]


def explain_node(graph: SGraph, detector: Detector, concept: str, node_id: int) -> NodeExplanation:
    """Return why a node of a concept that groups wall surfaces is what it is.

    Args:
        graph: an S-Graph as ``detector`` inferred it; it is not changed.
        detector: what inferred it.
        concept: the concept's name.
        node_id: id of the node.

    Raises:
        InputError: there is no such node, or the detector does not find it in this graph.
        ConceptError: the concept is unknown, or groups nodes of another one.
    """
    trace = detector.trace(graph, [concept])
    if concept not in trace.clusters:
        groups = detector.registry[concept].spec.groups
        raise ConceptError(f"concept {concept!r} groups {groups}s, not wall surfaces")
    node = graph.node(concept, node_id)
    cluster = trace.clusters[concept].get(frozenset(node.members))
    if cluster is None:
        raise InputError(f"{concept} {node_id} is not what inference finds in this map")
    rows = np.array(cluster.members, np.int64)
    members = tuple(_member(surface, node, concept, rows, trace) for surface in node.members)
    counted = [m for m in members if m.copy_of not in node.members]
    free = [m for m in counted if not m.pinned] if len(counted) > 2 else []
    weakest = min(free, key=lambda m: (m.support.total, m.id), default=None)
    return NodeExplanation(
        concept,
        node,
        members,
        None if weakest is None else weakest.id,
        _outsider(node, detector.registry[concept], rows, trace),
        _border(node.shape, rows, trace),
    )


def explain_pair(graph: SGraph, detector: Detector, one: int, two: int) -> PairExplanation:
    """Return why two wall surfaces belong together, or do not, for each inferred concept.

    Args:
        graph: an S-Graph as ``detector`` inferred it; it is not changed.
        detector: what inferred it.
        one: id of a wall surface.
        two: id of another one.

    Raises:
        InputError: a surface is unknown, or both are the same.
    """
    if graph.surface_row(one) == graph.surface_row(two):
        raise InputError(f"wall surface {one} is compared with itself")
    concepts = [
        concept.spec
        for concept in detector.registry
        if concept.spec.groups == WALL_SURFACE and concept.spec.name in graph.concepts
    ]
    trace = detector.trace(graph, [spec.name for spec in concepts])
    surfaces, duplicates = trace.scene.surfaces, trace.fragments.duplicates
    copies = {surface: duplicates[surface] for surface in (one, two) if surface in duplicates}
    if copies.get(one, one) == copies.get(two, two):
        return PairExplanation(one, two, copies, 0.0, None, ())
    rows = _rows(one, trace), _rows(two, trace)
    pieces = np.stack(np.meshgrid(*rows), axis=-1).reshape(-1, 2)
    distances = closest_distances(surfaces.segments, pieces[:, 0], pieces[:, 1])
    seen = visibility(surfaces, pieces)[:, 0]
    row, other = pieces[np.lexsort((distances, -seen))[0]].tolist()
    relations = tuple(_relation(spec, (one, two), rows, trace, graph) for spec in concepts)
    distance = float(distances.min())
    return PairExplanation(one, two, copies, distance, sight(surfaces, row, other), relations)


# -- links -----------------------------------------------------------------------------------------


def _rows(surface: int, trace: Trace) -> IntArray:
    """Return the rows of a surface's pieces, or of those of the surface it is a copy of."""
    kept = trace.fragments.duplicates.get(surface, surface)
    return np.flatnonzero(trace.scene.surfaces.ids == kept)


def _pinned(one: int, two: int, concept: str, trace: Trace) -> Pinned | None:
    """Return what two surfaces, or those that they are copies of, are pinned to be."""
    kept = (trace.fragments.duplicates.get(surface, surface) for surface in (one, two))
    return trace.pins.between(*kept) if concept == PINNED_CONCEPT else None


def _linking(ones: IntArray, twos: IntArray, trace: Trace) -> IntArray:
    """Return which of the scene's pairs link two groups of rows, [L]."""
    first, second = trace.scene.pairs.T
    forward = np.isin(first, ones) & np.isin(second, twos)
    return np.flatnonzero(forward | (np.isin(second, ones) & np.isin(first, twos)))


def _balance(ones: IntArray, twos: IntArray, concept: str, trace: Trace) -> Balance:
    """Return the links between two groups of rows."""
    linking = _linking(ones, twos, trace)
    relation, pairs = trace.relations[concept], trace.scene.pairs[linking]
    backward = np.isin(pairs[:, 1], ones)
    pairs[backward] = pairs[backward, ::-1]
    ids = trace.scene.surfaces.ids[pairs].tolist()
    scores = zip(relation.logits[linking], relation.probabilities[linking], strict=True)
    links = [
        Link(one, two, float(logit), float(probability))
        for (one, two), (logit, probability) in zip(ids, scores, strict=True)
    ]
    return Balance(tuple(sorted(links, key=lambda link: (-link.logit, link.one, link.two))))


def _group(row: int, concept: str, trace: Trace) -> IntArray:
    """Return the rows of the cluster that a row is in, none if it is in none."""
    for cluster in trace.clusters[concept].values():
        if row in cluster.members:
            return np.array(cluster.members, np.int64)
    return np.empty(0, np.int64)


def _without(rows: IntArray, others: IntArray) -> IntArray:
    return rows[~np.isin(rows, others)]


# -- a pair ----------------------------------------------------------------------------------------


def _relation(
    spec: ConceptSpec,
    surfaces: tuple[int, int],
    rows: tuple[IntArray, IntArray],
    trace: Trace,
    graph: SGraph,
) -> Relation:
    one, two = (_holders(surface, spec.name, graph) for surface in surfaces)
    linking = _linking(*rows, trace)
    edges, link = trace.relations[spec.name], None
    if len(linking):
        likeliest = linking[np.argmax(edges.logits[linking])]
        logit, probability = edges.logits[likeliest], edges.probabilities[likeliest]
        link = Link(*surfaces, float(logit), float(probability))
    scored_for = link is not None and link.scored_for
    found = Relation(spec.name, spec.relation, link, (one, two))
    pinned = _pinned(*surfaces, spec.name, trace)
    if pinned == ("together" if found.shared else "apart"):  # pieces of split surfaces may differ
        return replace(found, pinned=pinned)
    if not spec.exclusive or scored_for == bool(found.shared):
        return found
    if found.shared:
        return replace(found, balance=_held_together(rows, spec.name, trace))
    best = trace.scene.pairs[likeliest]
    best = best if best[0] in rows[0] else best[::-1]
    groups = [_group(row, spec.name, trace) for row in best.tolist()]
    if all(map(len, groups)):
        return replace(found, balance=_balance(groups[0], groups[1], spec.name, trace))
    everything = np.arange(len(trace.scene.surfaces))
    strays = [
        (surface, _balance(best[[k]], _without(everything, best[[k]]), spec.name, trace))
        for k, surface in enumerate(surfaces)
        if not len(groups[k])
    ]
    return replace(found, strays=tuple(strays))


def _held_together(rows: tuple[IntArray, IntArray], concept: str, trace: Trace) -> Balance | None:
    """Return the links of the first of two surfaces to the rest of the group that holds both."""
    for row in rows[0].tolist():
        group = _group(row, concept, trace)
        if np.isin(rows[1], group).any():
            own = group[np.isin(group, rows[0])]
            return _balance(own, _without(group, own), concept, trace)
    return None


def _holders(surface: int, concept: str, graph: SGraph) -> tuple[int, ...]:
    return tuple(node.id for node in graph.concepts[concept] if surface in node.members)


# -- a node ----------------------------------------------------------------------------------------


def _member(surface: int, node: ConceptNode, concept: str, rows: IntArray, trace: Trace) -> Member:
    own = rows[np.isin(rows, _rows(surface, trace))]
    support = _balance(own, _without(rows, own), concept, trace)
    pinned = _pinned_members(surface, "together", node, concept, trace)
    return Member(surface, trace.fragments.duplicates.get(surface), support, pinned)


def _pinned_members(
    surface: int, pinned: Pinned, node: ConceptNode, concept: str, trace: Trace
) -> tuple[int, ...]:
    """Return the members of a node that a surface is pinned together with, or apart from."""
    return tuple(m for m in node.members if _pinned(surface, m, concept, trace) == pinned)


def _outsider(
    node: ConceptNode, concept: RegisteredConcept, rows: IntArray, trace: Trace
) -> Outsider | None:
    """Return the surface outside a cluster whose links to it have the greatest sum."""
    name, scene = concept.spec.name, trace.scene
    inside = np.isin(scene.pairs, rows)
    crossing = np.flatnonzero(inside[:, 0] != inside[:, 1])
    ends = scene.pairs[crossing][~inside[crossing]]
    outside = ends[~np.isin(scene.surfaces.ids[ends], scene.surfaces.ids[rows])]
    if not len(outside):
        return None
    total = np.bincount(ends, trace.relations[name].logits[crossing])
    row = max(outside.tolist(), key=lambda row: (total[row], -scene.surfaces.ids[row]))
    alone = np.array([row])
    own = None
    if concept.spec.exclusive:
        own = _balance(alone, _without(_group(row, name, trace), alone), name, trace)
    surface = int(scene.surfaces.ids[row])
    pinned = _pinned_members(surface, "apart", node, name, trace)
    return Outsider(surface, _balance(alone, rows, name, trace), own, pinned)


def _border(shape: NodeShape, rows: IntArray, trace: Trace) -> tuple[BorderOpening, ...]:
    if shape.polygon is None:
        return ()
    origin, surfaces = trace.scene.origin, trace.scene.surfaces
    rings = [np.array(ring) - origin for ring in (shape.polygon, *shape.holes)]
    others = surfaces.take(_without(np.arange(len(surfaces)), rows))
    border = []
    for opening in openings(shapely.Polygon(rings[0], rings[1:]), surfaces.take(rows)):
        facing, behind = (
            tuple(np.unique(others.ids[found]).tolist())
            for found in surfaces_along(opening, others)
        )
        placed = replace(opening, segments=opening.segments + origin)
        border.append(BorderOpening(placed, facing, behind))
    return tuple(border)
