"""The clusters of one concept, kept up to date: only what changed scores can reach is cut anew.

What a clusterer decides about a component (see :mod:`sgraph_core.slam.components`) depends on its
scores and, where left-over fragments join a neighbour, on the components next to it. So the
components with changed scores or pins and those next to them are decided anew, in a scene that also
holds all that is next to these. If the concept is declared local, those with changed scores alone
are.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sgraph_concepts.registry import RegisteredConcept
from sgraph_concepts.types import Cluster, IntArray, ScoredEdges
from sgraph_core.detector import Detector, Inference
from sgraph_core.pins import PINNED_CONCEPT
from sgraph_core.slam.components import Components
from sgraph_core.slam.fragments import Changed, LiveFragments
from sgraph_core.slam.pairs import LivePairs
from sgraph_core.slam.pins import NO_PINS, PairPins
from sgraph_core.slam.pool import rows_of

__all__ = ["LiveClusters", "Members"]

SAME_SURE = 1e-6
"""Confidences that differ by less are the same."""

Members = frozenset[int]


@dataclass(frozen=True, eq=False)
class _Found:
    """A cluster of fragments, and the nodes it gives.

    Attributes:
        rows: of the fragments.
        sure: the clusterer's confidence.
        nodes: how sure each node is, by its members.
    """

    rows: frozenset[int]
    sure: float
    nodes: Mapping[Members, float]


class LiveClusters:
    """The clusters of a concept that groups wall surfaces, and the nodes that they give.

    Args:
        concept: whose clusters.
        column: of the pairs' ``logits``.
        detector: whose parts are used.
        fragments, pairs: what is clustered.
    """

    def __init__(
        self,
        concept: RegisteredConcept,
        column: int,
        detector: Detector,
        fragments: LiveFragments,
        pairs: LivePairs,
    ) -> None:
        self._concept, self._column, self._detector = concept, column, detector
        self._fragments, self._pairs = fragments, pairs
        self._is_pinned = concept.spec.name == PINNED_CONCEPT
        self._is_local = concept.spec.local and concept.spec.name not in detector.clusterers
        self._of_row: dict[int, set[_Found]] = {}
        self._giving: dict[Members, set[_Found]] = {}
        self._repeated: set[int] = set()

    def update(self, touched: IntArray, changed: Changed) -> tuple[set[Members], int]:
        """Cluster anew what changed scores can reach.

        Args:
            touched: rows of fragments with changed scores.
            changed: what became of the fragments.

        Returns:
            The members of all nodes that may have come, gone or changed, and how many fragments
            were clustered.
        """
        removed = changed.removed
        self._repeated = set(changed.repeated.tolist())
        touched = np.union1d(touched, changed.repeated)
        if self._is_pinned:
            touched = np.union1d(touched, changed.repinned)
        orphans = np.setdiff1d(self._mates(removed), removed)
        core = Components(self._column, self._fragments, self._pairs, self._pins)
        core.add(np.union1d(touched, orphans))
        decided = self._reaching(core)
        self._add_mates(decided, decided.rows)
        while True:
            inner, context = decided.rows, self._reaching(decided).rows
            old = self._holding(np.union1d(inner, removed))
            new = self._cluster(context, inner, old)
            added = decided.add(_rows_in(new))
            if not len(added):
                return self._replace(old.difference(new), set(new) - old), len(context)
            self._add_mates(decided, added)

    def confidence(self, members: Members) -> float | None:
        """Return how sure the node of these members is, None if there is none."""
        found = self._surest(members)
        return None if found is None else found.nodes[members]

    def rows(self, members: Members) -> IntArray:
        """Return the fragments of the node of these members, in one order whenever they came."""
        found = self._surest(members)
        return (
            np.empty(0, np.int64)
            if found is None
            else self._fragments.in_order(rows_of(found.rows))
        )

    def _surest(self, members: Members) -> _Found | None:
        giving = self._giving.get(members, ())
        return max(
            giving, key=lambda found: (found.nodes[members], sorted(found.rows)), default=None
        )

    def _holding(self, rows: IntArray) -> set[_Found]:
        return {found for row in rows.tolist() for found in self._of_row.get(row, ())}

    def _mates(self, rows: IntArray) -> IntArray:
        """Return the fragments in clusters that hold any of some fragments."""
        return _rows_in(self._holding(rows))

    def _reaching(self, components: Components) -> Components:
        """Return components with those that decisions about them depend on."""
        return components if self._is_local else components.with_next()

    def _add_mates(self, components: Components, added: IntArray) -> None:
        """Add the clusters that added fragments are in, and the components of these."""
        while len(added):
            mates = self._mates(added)
            added = components.add(mates[self._fragments.fragments["alive"][mates]])

    @property
    def _pins(self) -> PairPins:
        return self._fragments.pins if self._is_pinned else NO_PINS

    def _cluster(self, rows: IntArray, inner: IntArray, before: set[_Found]) -> list[_Found]:
        """Cluster fragments; return what holds some of the inner ones, as before if it can be."""
        rows = self._fragments.in_order(rows)
        scene, pairs = self._pairs.scene(rows)
        edges = ScoredEdges(scene.pairs, self._pairs.pairs["logits"][pairs, self._column])
        parents = self._fragments.fragments["parent"][rows] if self._pins else rows[:0]
        pins = self._pins.among(set(parents.tolist()))
        inference = Inference(self._detector, self._fragments.take(rows), scene, pins)
        known = {found.rows: found for found in before}
        counts = set(inner.tolist())
        result: list[_Found] = []
        others: list[tuple[frozenset[int], Cluster]] = []
        for cluster in inference.cluster(self._concept, edges, scene):
            whole = frozenset(rows[list(cluster.members)].tolist())
            if counts.isdisjoint(whole):
                continue
            found = known.get(whole)
            if found is None or self._differs(found, cluster):
                others.append((whole, cluster))
            else:
                result.append(found)
        return result + self._found(inference, others)

    def _differs(self, found: _Found, cluster: Cluster) -> bool:
        stand_for_others = not self._repeated.isdisjoint(found.rows)
        return stand_for_others or abs(found.sure - cluster.confidence) > SAME_SURE

    def _found(
        self, inference: Inference, clusters: Sequence[tuple[frozenset[int], Cluster]]
    ) -> list[_Found]:
        """Return clusters with the nodes that they give, from the fragments of each."""
        given = [
            (k, members)
            for k, (_, cluster) in enumerate(clusters)
            for members in inference.members_of(self._concept, np.array(cluster.members, np.int64))
        ]
        sure = inference.confidences(
            self._concept, [clusters[k][1] for k, _ in given], [len(some) for _, some in given]
        )
        nodes: list[dict[Members, float]] = [{} for _ in clusters]
        for (k, members), confidence in zip(given, sure, strict=True):
            nodes[k][members] = confidence
        return [
            _Found(rows, cluster.confidence, giving)
            for (rows, cluster), giving in zip(clusters, nodes, strict=True)
        ]

    def _replace(self, old: set[_Found], new: set[_Found]) -> set[Members]:
        concerned: set[Members] = set()
        for found in old:
            concerned |= found.nodes.keys()
            for row in found.rows:
                self._of_row[row].discard(found)
            for members in found.nodes:
                self._giving[members].discard(found)
        for found in new:
            concerned |= found.nodes.keys()
            for row in found.rows:
                self._of_row.setdefault(row, set()).add(found)
            for members in found.nodes:
                self._giving.setdefault(members, set()).add(found)
        for members in concerned:
            if not self._giving[members]:
                del self._giving[members]
        return concerned


def _rows_in(clusters: Iterable[_Found]) -> IntArray:
    return rows_of({row for found in clusters for row in found.rows})
