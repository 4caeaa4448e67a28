"""Clusters that keep to pins, whatever the scores say and whoever clusters.

Before clustering, pins become edges that outweigh all other log-odds together, so that neighbours
follow. Multicut (:mod:`sgraph_core.clustering.multicut`) keeps to them exactly: rows pinned
together are contracted first, a sum that holds a pair pinned apart is never positive, and no move
of a row gains what breaking a pin costs. After clustering, what still breaks a pin is put right,
so that pins hold with any clusterer.

Of a surface that was split, a group takes the fragment most related to the others; surfaces are
pinned apart in all their fragments.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, product

import numpy as np
from numpy.typing import NDArray

from sgraph_concepts.types import Cluster, FloatArray, IntArray, Scene, ScoredEdges
from sgraph_core.clustering.canonical import Relation
from sgraph_core.clustering.confidence import clusters_of
from sgraph_core.clustering.multicut import multicut
from sgraph_core.geometry import closest_distances

__all__ = ["PinnedRelation", "pin"]

FEWEST_MEMBERS = 3
"""What pins leave of a cluster is none below this: two surfaces enclose nothing."""
UNSCORED = 1e-6
"""How much two rows of one cluster attract each other if their relation was not scored."""

Rows = frozenset[int]


def pin(
    edges: ScoredEdges,
    scene: Scene,
    groups: Sequence[frozenset[int]],
    apart: Sequence[tuple[int, int]],
) -> PinnedRelation:
    """Put pins into a scored relation.

    Args:
        edges: the relation.
        scene: its scene, with a row or more of each surface.
        groups: disjoint sets of surfaces that one cluster shall hold, by id.
        apart: pairs of surfaces of different groups that no cluster shall hold both of, by id.
    """
    ids = scene.surfaces.ids
    # twice all other log-odds, with room for what _cut adds to them: less than one a pair; and
    # still more than they are when divided by the square root of the number of pairs
    others = 1.0 + 2.0 * float(np.abs(edges.logits).sum()) + len(ids) ** 2
    weight = len(ids) * others
    together = [_one_fragment_each(group, edges, scene, weight) for group in groups]
    pinned = {pair: weight for rows in together for pair in combinations(sorted(rows), 2)}
    for one, two in apart:
        fragments = (np.flatnonzero(ids == surface).tolist() for surface in (one, two))
        pinned |= {(min(pair), max(pair)): -weight for pair in product(*fragments)}
    return PinnedRelation(_replaced(edges, pinned, len(ids)), weight, ids, groups, together)


def _one_fragment_each(
    group: frozenset[int], edges: ScoredEdges, scene: Scene, weight: float
) -> Rows:
    """Return the row of each surface that is most related to the others', or else the closest."""
    rows = np.flatnonzero(np.isin(scene.surfaces.ids, list(group)))
    one, two = np.repeat(rows, len(rows)), np.tile(rows, len(rows))
    distances = closest_distances(scene.surfaces.segments, one, two).reshape(len(rows), len(rows))
    logits = _square(rows, edges.pairs, edges.logits, -weight - distances)
    owner = scene.surfaces.ids[rows]
    related = np.zeros(len(rows))
    for surface in sorted(group):
        best = logits[:, owner == surface].max(axis=1)
        related += np.where(owner == surface, 0.0, best)
    ranked = np.argsort(-related, kind="stable")
    _, first = np.unique(owner[ranked], return_index=True)
    return frozenset(rows[ranked[first]].tolist())


def _square(rows: IntArray, pairs: IntArray, values: FloatArray, rest: FloatArray) -> FloatArray:
    """Return values of pairs as a symmetric matrix over some rows, [R, R]; elsewhere ``rest``."""
    place = np.full(1 + max(rows.max(), pairs.max(initial=0)), -1)
    place[rows] = np.arange(len(rows))
    inside = (place[pairs] >= 0).all(axis=1)
    one, two = place[pairs[inside]].T
    square = rest.copy()
    square[one, two] = square[two, one] = values[inside]
    return square


def _replaced(
    edges: ScoredEdges, pinned: Mapping[tuple[int, int], float], count: int
) -> ScoredEdges:
    pairs = np.array(list(pinned), np.int64).reshape(-1, 2)
    number = np.array([count, 1])
    free = ~np.isin(edges.pairs @ number, pairs @ number)
    return ScoredEdges(
        np.concatenate([edges.pairs[free], pairs]),
        np.concatenate([edges.logits[free], list(pinned.values())]),
    )


@dataclass(frozen=True, eq=False)
class PinnedRelation:
    """A scored relation with pins in it.

    Attributes:
        edges: the relation; its pinned pairs outweigh all others together.
        weight: log-odds of pairs pinned together; minus this, of those pinned apart.
        ids: surface of each row, [N].
        groups: the surfaces that are pinned together.
        together: one row of each surface of each group.
    """

    edges: ScoredEdges
    weight: float
    ids: IntArray
    groups: Sequence[frozenset[int]]
    together: Sequence[Rows]

    def enforce(self, clusters: Sequence[Cluster]) -> list[Cluster]:
        """Return clusters in which the pins hold; those that break none stay as they are.

        Clusters that hold rows pinned apart are cut anew, and so are, together, those among which
        a group is divided.
        """
        given = {frozenset(cluster.members): cluster for cluster in clusters}
        sets = [part for rows in given for part in self._without_pairs_apart(rows)]
        while divided := self._first_divided(sets):
            concerned = [rows for rows in sets if not rows.isdisjoint(divided)]
            sets = [rows for rows in sets if rows.isdisjoint(divided)]
            sets += self._cut(concerned, divided.difference(*concerned))
        return [
            given.get(rows) or self._cluster(rows)
            for rows in sets
            if rows in given
            or len(rows) >= FEWEST_MEMBERS
            or any(self._holds(rows, group) for group in self.groups)
        ]

    @cached_property
    def _pinned(self) -> NDArray[np.bool_]:
        return np.abs(self.edges.logits) >= self.weight

    @cached_property
    def _apart(self) -> list[list[int]]:
        apart: list[list[int]] = self.edges.pairs[self._pinned & (self.edges.logits < 0)].tolist()
        return apart

    def _without_pairs_apart(self, rows: Rows) -> list[Rows]:
        return self._cut([rows]) if any(rows.issuperset(pair) for pair in self._apart) else [rows]

    def _first_divided(self, sets: Sequence[Rows]) -> Rows | None:
        """Return the rows to bring together of the first group that no set holds."""
        for group, rows in zip(self.groups, self.together, strict=True):
            if not any(self._holds(found, group) for found in sets):
                return rows
        return None

    def _holds(self, rows: Rows, group: frozenset[int]) -> bool:
        return group.issubset(self.ids[list(rows)].tolist())

    def _cut(self, sets: Sequence[Rows], strays: Rows = frozenset()) -> list[Rows]:
        """Partition the rows of disjoint sets, and stray ones, as the sets do but for the pins.

        Rows of one set attract, rows of two sets repel each other, as much as their log-odds speak
        for it. Strays obey the pins only.
        """
        owner = np.full(len(self.ids), -1)
        for number, rows in enumerate([strays, *sets]):
            owner[list(rows)] = number
        one, two = owner[self.edges.pairs].T
        same = np.where(one == two, 1, -1)
        bonds = same * np.logaddexp(0, same * self.edges.logits)
        bonds[(one == 0) | (two == 0)] = 0
        bonds[self._pinned] = self.edges.logits[self._pinned]

        concerned = np.flatnonzero(owner >= 0)
        # by surface, so that the order of rows does not matter
        concerned = concerned[np.argsort(self.ids[concerned], kind="stable")]
        owners = owner[concerned]
        unscored = np.where(owners[:, None] == owners, UNSCORED, 0.0)
        square = _square(concerned, self.edges.pairs, bonds, unscored)
        pairs = np.stack(np.nonzero(np.triu(square, k=1)), axis=1)
        parts = multicut(len(concerned), pairs, square[pairs[:, 0], pairs[:, 1]])
        return [frozenset(concerned[part].tolist()) for part in parts]

    def _cluster(self, rows: Rows) -> Cluster:
        relation = Relation(np.arange(len(self.ids)), self.edges.pairs, self.edges.logits)
        return clusters_of(relation, [sorted(rows)])[0]
