"""Precision, recall and F1 of rooms and walls against a map's truth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from sgraph_concepts.types import ConceptNode
from sgraph_core.graph import SGraph, Truth

__all__ = ["Counts", "FloorScore", "Judged", "matched_rows", "score_floor"]

JACCARD = 0.5
"""A predicted room is a true room if their members' Jaccard index reaches this."""
FEWEST_MEMBERS = 3
"""True rooms with fewer members are left out: too little of them is mapped."""


@dataclass(frozen=True)
class Counts:
    """Matches between predictions and truth; counts of several floors add up.

    Attributes:
        matched: predictions that match a true one.
        predicted, true: how many there are.
        left_out: predictions that are not scored, because what they lie on is not labelled.
    """

    matched: int = 0
    predicted: int = 0
    true: int = 0
    left_out: int = 0

    def __add__(self, other: Counts) -> Counts:
        return Counts(
            self.matched + other.matched,
            self.predicted + other.predicted,
            self.true + other.true,
            self.left_out + other.left_out,
        )

    @property
    def precision(self) -> float:
        """Share of the predictions that match, 0 without predictions."""
        return self.matched / self.predicted if self.predicted else 0.0

    @property
    def recall(self) -> float:
        """Share of the truth that is matched, 0 without truth."""
        return self.matched / self.true if self.true else 0.0

    @property
    def f1(self) -> float:
        """Harmonic mean of precision and recall, 0 without predictions."""
        total = self.predicted + self.true
        return 2 * self.matched / total if self.predicted else 0.0


@dataclass(frozen=True)
class Judged:
    """A predicted node that is scored.

    Attributes:
        node: the node.
        right: whether it matches a true one: a room at Jaccard index 0.5 or more.
    """

    node: ConceptNode
    right: bool


@dataclass(frozen=True)
class FloorScore:
    """Scores of one map.

    Attributes:
        rooms: rooms matched at Jaccard index 0.5 or more.
        exact_rooms: rooms with exactly the true members.
        walls: pairs of surfaces.
        judged: the predicted nodes behind ``rooms`` and ``walls``, by concept.
    """

    rooms: Counts
    exact_rooms: Counts
    walls: Counts
    judged: Mapping[str, tuple[Judged, ...]] = field(default_factory=dict)


def score_floor(graph: SGraph, truth: Truth) -> FloorScore:
    """Score an S-Graph's rooms and walls.

    Rooms match one to one (Hungarian, most matches first). A predicted room is left out when more
    than half of its members lie in a true room of fewer than three members or in none; a
    predicted wall when neither of its surfaces belongs to any labelled room or wall.
    """
    nodes = graph.concepts
    rooms, exact_rooms, judged_rooms = _score_rooms(nodes.get("room", []), truth)
    walls, judged_walls = _score_walls(nodes.get("wall", []), truth)
    return FloorScore(rooms, exact_rooms, walls, {"room": judged_rooms, "wall": judged_walls})


def _score_rooms(
    nodes: Sequence[ConceptNode], truth: Truth
) -> tuple[Counts, Counts, tuple[Judged, ...]]:
    rooms = [set(room.members) for room in truth.rooms]
    scored = [room for room in rooms if len(room) >= FEWEST_MEMBERS]
    labelled = set().union(*scored)
    kept = [node for node in nodes if 2 * len(set(node.members) - labelled) <= len(node.members)]
    left_out = len(nodes) - len(kept)
    overlap = _jaccard([set(node.members) for node in kept], scored)
    right, exact = matched_rows(overlap >= JACCARD), matched_rows(overlap == 1.0)
    return (
        Counts(int(right.sum()), len(kept), len(scored), left_out),
        Counts(int(exact.sum()), len(kept), len(scored), left_out),
        tuple(Judged(node, ok) for node, ok in zip(kept, right.tolist(), strict=True)),
    )


def _score_walls(nodes: Sequence[ConceptNode], truth: Truth) -> tuple[Counts, tuple[Judged, ...]]:
    true = {frozenset(wall) for wall in truth.walls}
    labelled = {i for room in truth.rooms for i in room.members}.union(*true)
    predicted = {frozenset(node.members): node for node in nodes}
    judged = tuple(
        Judged(node, wall in true) for wall, node in predicted.items() if wall & labelled
    )
    matched = sum(wall.right for wall in judged)
    return Counts(matched, len(judged), len(true), len(predicted) - len(judged)), judged


def _jaccard(one: Sequence[set[int]], two: Sequence[set[int]]) -> np.ndarray:
    table = [[len(a & b) / len(a | b) for b in two] for a in one]
    return np.array(table).reshape(len(one), len(two))


def matched_rows(allowed: np.ndarray) -> np.ndarray:
    """Return which rows a one-to-one assignment with the most matches gives a match."""
    from scipy.optimize import linear_sum_assignment

    rows, columns = linear_sum_assignment(-allowed.astype(np.int64))
    matched = np.zeros(len(allowed), bool)
    matched[rows] = allowed[rows, columns]
    return matched
