"""The clusters of one concept, kept up to date: only what changed scores can reach is cut anew.

Fragments that are joined by pairs more likely related than not, directly or over others, form a
*component*, and so do all fragments of surfaces that are pinned together. What a clusterer decides
about a component depends on its scores and, where left-over fragments join a neighbour, on the
components next to it; surfaces that are pinned apart count as next to each other. So the components
with changed scores or pins and those next to them are decided anew, in a scene that also holds all
that is next to these.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sgraph_concepts.registry import RegisteredConcept
from sgraph_concepts.types import Cluster, IntArray, ScoredEdges
from sgraph_core.detector import Detector, Inference
from sgraph_core.pins import PINNED_CONCEPT
from sgraph_core.slam.fragments import Changed, LiveFragments
from sgraph_core.slam.pairs import LivePairs
from sgraph_core.slam.pins import NO_PINS, PairPins
from sgraph_core.slam.pool import rows_of, rows_where

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
        core = self._components(np.union1d(touched, orphans))
        inner = self._whole(self._next_to(core))
        while True:
            context = self._components(self._next_to(inner))
            new = self._cluster(context, inner)
            held = rows_where(*(rows_of(found.rows) for found in new), inner)
            if len(held) == len(inner):
                old = self._holding(np.union1d(inner, removed))
                return self._replace(old.difference(new), set(new) - old), len(context)
            inner = self._whole(held)

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
        return rows_of({row for found in self._holding(rows) for row in found.rows})

    def _whole(self, rows: IntArray) -> IntArray:
        """Return fragments with all of their components, and of the clusters that these are in."""
        while True:
            wider = self._components(rows)
            wider = np.union1d(wider, self._mates(wider))
            wider = wider[self._fragments.fragments["alive"][wider]]
            if len(wider) == len(rows):
                return np.asarray(wider)
            rows = wider

    @property
    def _pins(self) -> PairPins:
        return self._fragments.pins if self._is_pinned else NO_PINS

    def _next_to(self, rows: IntArray) -> IntArray:
        apart = self._fragments.of_parents(self._pins.apart(self._parents(rows)))
        return np.union1d(self._pairs.neighbours(rows), apart)

    def _parents(self, rows: IntArray) -> set[int]:
        """Return the surfaces of fragments, for what is pinned about them."""
        return set(self._fragments.fragments["parent"][rows].tolist()) if self._pins else set()

    def _components(self, rows: IntArray) -> IntArray:
        whole = latest = rows
        while len(latest):
            pairs = self._pairs.related(latest)
            likely = self._pairs.pairs["logits"][pairs, self._column] > 0
            ends = self._pairs.pairs["ends"][pairs[likely]]
            pinned = self._fragments.of_parents(self._pins.together(self._parents(latest)))
            wider = rows_where(whole, ends.ravel(), pinned)
            latest = np.setdiff1d(wider, whole, assume_unique=True)
            whole = wider
        return whole

    def _cluster(self, rows: IntArray, inner: IntArray) -> list[_Found]:
        """Cluster fragments, and return what holds some of the inner ones."""
        rows = self._fragments.in_order(rows)
        scene, pairs = self._pairs.scene(rows)
        edges = ScoredEdges(scene.pairs, self._pairs.pairs["logits"][pairs, self._column])
        pins = self._pins.among(self._parents(rows))
        inference = Inference(self._detector, self._fragments.take(rows), scene, pins)
        known = {found.rows: found for found in self._holding(inner)}
        counts = set(inner.tolist())
        result = []
        for cluster in inference.cluster(self._concept, edges, scene):
            whole = frozenset(rows[list(cluster.members)].tolist())
            if counts.isdisjoint(whole):
                continue
            before = known.get(whole)
            if before is None or self._differs(before, cluster):
                before = self._found(inference, cluster, whole)
            result.append(before)
        return result

    def _differs(self, found: _Found, cluster: Cluster) -> bool:
        stand_for_others = not self._repeated.isdisjoint(found.rows)
        return stand_for_others or abs(found.sure - cluster.confidence) > SAME_SURE

    def _found(self, inference: Inference, cluster: Cluster, rows: frozenset[int]) -> _Found:
        local = np.array(cluster.members, np.int64)
        nodes = {
            members: inference.confidence(self._concept, cluster, len(members))
            for members in inference.members_of(self._concept, local)
        }
        return _Found(rows, cluster.confidence, nodes)

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
