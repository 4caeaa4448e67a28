"""Nodes that no detector inferred: the true ones, and wrong ones made on purpose."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
from numpy.random import Generator

from sgraph_concepts.registry import Registry
from sgraph_concepts.types import ConceptNode, Scene
from sgraph_core.graph import SGraph

__all__ = ["corrupted", "described"]

CORRUPTED_SHARE = 0.2
ANTIPARALLEL = np.cos(np.radians(15.0))


def described(
    graph: SGraph, concept: str, members: Iterable[Sequence[int]], registry: Registry
) -> list[ConceptNode]:
    """Return nodes of the given members, with the shapes that the map gives them.

    Args:
        graph: the map.
        concept: an installed one that groups wall surfaces and declares a shape.
        members: ids of wall surfaces, node by node.
        registry: the concepts.
    """
    surfaces = graph.wall_surfaces.ordered()
    scene = Scene(surfaces, np.zeros(2), np.empty((0, 2), np.int64), np.empty(0), np.empty((0, 0)))
    groups = dict(enumerate(map(tuple, members)))
    rows = {number: np.array([graph.surface_row(i) for i in ids]) for number, ids in groups.items()}
    shapes = registry.part(concept, "shape")(rows, scene)
    return [
        ConceptNode(number, ids, shape=shapes[number], confidence=1.0)
        for number, ids in groups.items()
    ]


def corrupted(graph: SGraph, registry: Registry, rng: Generator) -> SGraph:
    """Return an S-Graph in which every fifth room and every fifth wall is wrong, at least one.

    The rooms get the surfaces of the nearest other room beside their own. The walls get, for their
    second side, the nearest surface that is antiparallel to their first and not its other side in
    truth either, if there is one. The nodes stay as confident as they were.

    Args:
        graph: with rooms and walls, and its truth if known.
        registry: the concepts.
        rng: chooses the nodes.
    """
    result = graph.copy()
    rooms, walls = result.concepts.get("room", []), result.concepts.get("wall", [])
    for number in _chosen(rooms, rng):
        members = sorted({*rooms[number].members, *_neighbour(rooms, number).members})
        rooms[number] = _regrouped(graph, "room", rooms[number], members, registry)
    for number in _chosen(walls, rng):
        members = _wrong_pair(graph, walls[number])
        if members:
            walls[number] = _regrouped(graph, "wall", walls[number], members, registry)
    return result


def _chosen(nodes: Sequence[ConceptNode], rng: Generator) -> list[int]:
    if len(nodes) < 2:
        return []
    count = max(1, round(CORRUPTED_SHARE * len(nodes)))
    return sorted(rng.choice(len(nodes), count, replace=False).tolist())


def _neighbour(rooms: Sequence[ConceptNode], number: int) -> ConceptNode:
    centres = np.array([room.shape.centre or (np.inf, np.inf) for room in rooms])
    distances = np.linalg.norm(centres - centres[number], axis=1)
    distances[number] = np.inf
    return rooms[int(distances.argmin())]


def _wrong_pair(graph: SGraph, wall: ConceptNode) -> list[int]:
    """Return a wall's first side and the nearest antiparallel surface that is no side of it."""
    surfaces = graph.wall_surfaces.ordered()
    true = () if graph.truth is None else graph.truth.walls
    sides = {i for pair in (wall.members, *true) if wall.members[0] in pair for i in pair}
    first = graph.surface_row(wall.members[0])
    distances = np.linalg.norm(surfaces.midpoints - surfaces.midpoints[first], axis=1)
    distances[surfaces.normals @ surfaces.normals[first] > -ANTIPARALLEL] = np.inf
    distances[[graph.surface_row(i) for i in sides]] = np.inf
    wrong = int(distances.argmin())
    return [wall.members[0], int(surfaces.ids[wrong])] if np.isfinite(distances[wrong]) else []


def _regrouped(
    graph: SGraph,
    concept: str,
    node: ConceptNode,
    members: Sequence[int],
    registry: Registry,
) -> ConceptNode:
    (other,) = described(graph, concept, [members], registry)
    return replace(node, members=other.members, shape=other.shape)
