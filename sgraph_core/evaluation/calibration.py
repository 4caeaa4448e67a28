"""Whether probabilities mean what they say: reliability and expected calibration error.

Guo et al., "On Calibration of Modern Neural Networks", ICML 2017: sort probabilities into bins of
equal width and compare, in each, their mean with the share that came true.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sgraph_concepts.types import FloatArray, IntArray, ScoredEdges
from sgraph_core.evaluation.scores import Judged
from sgraph_core.graph import Truth

__all__ = [
    "BINS",
    "TRUE_RELATIONS",
    "UNDECIDED",
    "Calibration",
    "Reliability",
    "edges_calibration",
    "nodes_calibration",
    "same_room",
    "same_wall",
]

BINS = 10
UNDECIDED = (0.05, 0.95)
"""Edges between these probabilities are reported apart: most others are obvious."""


@dataclass(frozen=True, eq=False)
class Reliability:
    """Probabilities in ``BINS`` bins of equal width; those of several floors add up.

    Attributes:
        count: how many probabilities each bin holds, [BINS].
        expected: their sum, [BINS].
        came_true: how many of them came true, [BINS].
    """

    count: IntArray = field(default_factory=lambda: np.zeros(BINS, np.int64))
    expected: FloatArray = field(default_factory=lambda: np.zeros(BINS))
    came_true: IntArray = field(default_factory=lambda: np.zeros(BINS, np.int64))

    @classmethod
    def of(cls, probabilities: ArrayLike, came_true: ArrayLike) -> Reliability:
        """Sort K probabilities, and whether what they foretold came true, into bins."""
        chances, outcomes = np.asarray(probabilities, np.float64), np.asarray(came_true, bool)
        place = np.minimum((chances * BINS).astype(np.int64), BINS - 1)
        return cls(
            np.bincount(place, minlength=BINS),
            np.bincount(place, chances, BINS).astype(np.float64),
            np.bincount(place[outcomes], minlength=BINS),
        )

    def __add__(self, other: Reliability) -> Reliability:
        return Reliability(
            self.count + other.count,
            self.expected + other.expected,
            self.came_true + other.came_true,
        )

    @property
    def error(self) -> float:
        """Expected calibration error: mean over the probabilities of their bin's gap, or NaN."""
        total = int(self.count.sum())
        return float(np.abs(self.expected - self.came_true).sum() / total) if total else np.nan


@dataclass(frozen=True, eq=False)
class Calibration:
    """Reliabilities by concept; those of several floors add up.

    Attributes:
        nodes: confidence of the nodes that are scored.
        edges: probability of the relation of the pairs whose truth is known.
        undecided: likewise, of those between 0.05 and 0.95 only.
    """

    nodes: Mapping[str, Reliability] = field(default_factory=dict)
    edges: Mapping[str, Reliability] = field(default_factory=dict)
    undecided: Mapping[str, Reliability] = field(default_factory=dict)

    def __add__(self, other: Calibration) -> Calibration:
        return Calibration(
            _added(self.nodes, other.nodes),
            _added(self.edges, other.edges),
            _added(self.undecided, other.undecided),
        )


def _added(
    one: Mapping[str, Reliability], two: Mapping[str, Reliability]
) -> dict[str, Reliability]:
    nothing = Reliability()
    return {name: one.get(name, nothing) + two.get(name, nothing) for name in {**one, **two}}


def nodes_calibration(judged: Mapping[str, Iterable[Judged]]) -> Calibration:
    """Return how reliable the confidences of scored nodes are; nodes without one do not count."""
    nodes = {}
    for concept, every in judged.items():
        sure = [
            (one.node.confidence, one.right) for one in every if one.node.confidence is not None
        ]
        nodes[concept] = Reliability.of([chance for chance, _ in sure], [ok for _, ok in sure])
    return Calibration(nodes)


def edges_calibration(
    relations: Mapping[str, ScoredEdges], parents: IntArray, truth: Truth
) -> Calibration:
    """Return how reliable the probabilities of the relations *same room* and *same wall* are.

    Args:
        relations: scored pairs of rows, by concept; others than room and wall have no truth.
        parents: id of the surface that each row is a fragment of, [N].
        truth: of the map.
    """
    edges, undecided = {}, {}
    for concept, look_up in TRUE_RELATIONS.items():
        if concept not in relations:
            continue
        relation = relations[concept]
        known, related = look_up(parents[relation.pairs], truth)
        chances, came_true = relation.probabilities[known], related[known]
        between = (chances >= UNDECIDED[0]) & (chances <= UNDECIDED[1])
        edges[concept] = Reliability.of(chances, came_true)
        undecided[concept] = Reliability.of(chances[between], came_true[between])
    return Calibration({}, edges, undecided)


Bools = NDArray[np.bool_]


def same_room(surfaces: IntArray, truth: Truth) -> tuple[Bools, Bools]:
    """Return of which pairs of surfaces it is known whether they share a room, and which do.

    Nothing is known of a surface in no true room, nor of one in several: which of its fragments
    lies in which is not recorded.

    Args:
        surfaces: ids of the two surfaces of each pair, [E, 2].
        truth: of the map.

    Returns:
        Known [E] and related [E].
    """
    room_of: dict[int, int] = {}
    several = set()
    for number, room in enumerate(truth.rooms):
        several.update(room_of.keys() & set(room.members))
        room_of.update(dict.fromkeys(room.members, number))
    rooms = [
        [-1 if one in several else room_of.get(one, -1) for one in pair]
        for pair in surfaces.tolist()
    ]
    one, two = np.array(rooms, np.int64).reshape(-1, 2).T
    return (one >= 0) & (two >= 0), one == two


def same_wall(surfaces: IntArray, truth: Truth) -> tuple[Bools, Bools]:
    """Return of which pairs of surfaces it is known whether they are a wall, and which are.

    Nothing is known of a surface that is part of no true room and no true wall.

    Args:
        surfaces: ids of the two surfaces of each pair, [E, 2].
        truth: of the map.

    Returns:
        Known [E] and related [E].
    """
    walls = {frozenset(wall) for wall in truth.walls}
    labelled = {i for room in truth.rooms for i in room.members}.union(*walls)
    pairs = [frozenset(pair) for pair in surfaces.tolist()]
    known = np.array([pair <= labelled for pair in pairs], bool)
    return known, np.array([pair in walls for pair in pairs], bool)


TRUE_RELATIONS: Mapping[str, Callable[[IntArray, Truth], tuple[Bools, Bools]]] = MappingProxyType(
    {"room": same_room, "wall": same_wall}
)
"""By concept, how to look up in a map's truth what its relation is; no other concept has one."""
