"""The pairs of fragments worth relating, kept up to date while fragments come and go.

The pairs and their visibilities are those of :func:`sgraph_core.proximity.build_scene`. What a
fragment takes part in reaches as far as it looks for neighbours, and as far as its closures and the
lines of sight that it blocks go; nothing else is computed again.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import shapely

from sgraph_concepts.types import FloatArray, IntArray, Scene, SurfaceArrays
from sgraph_core.closures import Closures
from sgraph_core.geometry import TIE_M, close_together, closest_distances
from sgraph_core.proximity import CLOSE_M, FACING, worth_relating
from sgraph_core.slam.fragments import Changed
from sgraph_core.slam.pool import (
    OUTWARDS,
    Pool,
    boxes_around,
    meeting,
    rows_of,
    rows_where,
)
from sgraph_core.visibility import (
    CLOSURE_REACH_M,
    FARTHEST_RADIUS_M,
    NEAREST_RADIUS_M,
    VISIBILITIES,
    closures_among,
    face_each_other,
    facing_neighbours,
    visibility,
)

__all__ = ["LivePairs", "PairChange"]

MARGIN_M = 0.1
"""Lines of sight begin a little in front of their surfaces, outside the surfaces' boxes."""

RADII_M = (NEAREST_RADIUS_M, 2 * NEAREST_RADIUS_M, FARTHEST_RADIUS_M)
"""Within which a fragment searches for its neighbours, one after the other."""

Pair = tuple[int, int]
Asked = dict[int, float]
"""Whom a fragment asks for, and their distances."""


@dataclass(frozen=True)
class PairChange:
    """What became of the pairs.

    Attributes:
        ends: rows of the fragments that are in a pair that is new, gone or seen otherwise.
        looked: how many pairs' lines of sight were followed.
    """

    ends: IntArray
    looked: int


class LivePairs:
    """The related pairs of a changing set of fragments.

    Attributes:
        pairs: ``ends``, two rows of fragments, the lower first; ``distance``; ``visibility``;
            ``hull``, the box around both; ``logits``, one for each concept that relates surfaces.

    Args:
        fragments: their pool, changed by its owner before each update.
        origin: what the scenes' coordinates are relative to, [2].
        concepts: how many relations are scored.
    """

    def __init__(self, fragments: Pool, origin: FloatArray, concepts: int) -> None:
        self._fragments, self.origin = fragments, origin
        self.pairs = Pool(
            ends=np.empty((0, 2), np.int64),
            distance=np.empty(0),
            visibility=np.empty((0, len(VISIBILITIES))),
            hull=np.empty((0, 4)),
            logits=np.empty((0, concepts)),
        )
        self._row: dict[Pair, int] = {}
        self._of: dict[int, set[int]] = {}
        self._related_of: dict[int, set[int]] = {}
        self._arrays: dict[int, IntArray] = {}
        self._asked: dict[int, Asked] = {}
        self._losing: set[int] = set()
        self._gaps, self._continuations = (
            Pool(
                segment=np.empty((0, 2, 2)),
                width=np.empty(0),
                begin=np.empty((0, 4)),
                box=np.empty((0, 4)),
            )
            for _ in range(2)
        )

    # -- what there is -------------------------------------------------------------------------

    def related(self, rows: IntArray) -> IntArray:
        """Return the rows of the related pairs of some fragments."""
        known = self._arrays
        each = [known[row] if row in known else self._pairs_of(row) for row in rows.tolist()]
        return rows_where(*each)

    def neighbours(self, rows: IntArray) -> IntArray:
        """Return fragments and all that are related to one of them."""
        ends = self.pairs["ends"][self.related(rows)].ravel()
        return rows_where(rows, ends)

    def _pairs_of(self, row: int) -> IntArray:
        self._arrays[row] = np.array(list(self._related_of.get(row, ())), np.int64)
        return self._arrays[row]

    def surfaces(self, rows: IntArray) -> SurfaceArrays:
        """Return fragments in the scene's coordinates."""
        some = self._fragments
        return SurfaceArrays(
            some["parent"][rows], some["segment"][rows] - self.origin, some["normal"][rows]
        )

    def scene(self, rows: IntArray, of: IntArray | None = None) -> tuple[Scene, IntArray]:
        """Return some fragments with related pairs among them, and the rows of these pairs.

        Args:
            rows: of the fragments.
            of: at least one end of each pair; any of the fragments if not given.
        """
        pairs = self.related(rows if of is None else of)
        ends = self.pairs["ends"][pairs]
        place = np.full(len(self._fragments), -1)
        place[rows] = np.arange(len(rows))
        inside = (place[ends] >= 0).all(axis=1)
        pairs, ends = pairs[inside], ends[inside]
        some = self.pairs
        scene = Scene(
            self.surfaces(rows),
            self.origin,
            np.sort(place[ends], axis=1),
            some["distance"][pairs],
            some["visibility"][pairs],
            support=self._fragments["support"][rows],
        )
        return scene, pairs

    # -- keeping up ----------------------------------------------------------------------------

    def update(self, changed: Changed) -> PairChange:
        """Take in what became of the fragments."""
        ends = self._forget(changed.removed)
        boxes = self._fragments["box"][np.concatenate([changed.removed, changed.added])]
        obstacles = np.concatenate([boxes, self._renew_closures(boxes)])
        stale = self.pairs.meeting("hull", obstacles, MARGIN_M)
        wanted, unwanted = self._renew_asking(changed)
        wanted |= self._close_pairs(changed.added)
        for pair in unwanted:
            ends |= self._drop(self._row[pair])
        stale = stale[self.pairs["alive"][stale]]
        new = self._add(sorted(wanted.difference(self._row)))
        ends |= self._look(new, stale)
        self.pairs.settle()
        ends = ends.difference(changed.removed.tolist())
        return PairChange(rows_of(ends), len(new) + len(stale))

    def _forget(self, rows: IntArray) -> set[int]:
        """Drop all pairs of fragments that are gone; return the fragments they were related to."""
        ends: set[int] = set()
        self._losing = set()
        for row in rows.tolist():
            pairs = list(self._of.get(row, ()))
            others = set(self.pairs["ends"][pairs].ravel().tolist())
            self._losing |= {other for other in others if row in self._asked.get(other, ())}
            for pair in pairs:
                ends |= self._drop(pair)
            self._of.pop(row, None)
            self._related_of.pop(row, None)
            self._arrays.pop(row, None)
            self._asked.pop(row, None)
        self._losing.difference_update(rows.tolist())
        return ends

    def _drop(self, pair: int) -> set[int]:
        """Drop a pair; return its ends if it was related."""
        one, two = self.pairs["ends"][pair].tolist()
        related = pair in self._related_of.get(one, ())
        del self._row[one, two]
        for end in (one, two):
            self._of[end].discard(pair)
            self._related_of.get(end, set()).discard(pair)
            self._arrays.pop(end, None)
        self.pairs.remove(np.array([pair]))
        return {one, two} if related else set()

    def _renew_closures(self, boxes: FloatArray) -> FloatArray:
        """Renew the closures that fragments in these boxes may affect; return what changed."""
        near = self._fragments.meeting("box", boxes, 2 * CLOSURE_REACH_M)
        owners = self._fragments.meeting("box", boxes, CLOSURE_REACH_M)
        found = closures_among(self.surfaces(near), np.searchsorted(near, owners))
        changed = [np.empty((0, 2, 2))]
        for pool, closures in zip((self._gaps, self._continuations), found, strict=True):
            begins = boxes_around(closures.segments[:, :1] + self.origin)
            new = meeting(begins, boxes, CLOSURE_REACH_M)
            old = pool.meeting("begin", boxes, CLOSURE_REACH_M)
            stale = {pool["segment"][row].tobytes(): row for row in old.tolist()}
            fresh = [
                k for k in new.tolist() if stale.pop(closures.segments[k].tobytes(), None) is None
            ]
            gone, come = rows_of(stale.values()), closures.segments[fresh]
            changed += [pool["segment"][gone], come]
            pool.remove(gone)
            pool.add(
                len(fresh),
                segment=come,
                width=closures.widths[fresh],
                begin=begins[fresh],
                box=boxes_around(come + self.origin),
            )
            pool.settle()
        return boxes_around(np.concatenate(changed) + self.origin)

    def _renew_asking(self, changed: Changed) -> tuple[set[Pair], list[Pair]]:
        """Let the fragments ask anew that the change concerns.

        Returns:
            Pairs that are asked for, and existing ones that no longer are.
        """
        asked, searching = self._revise(changed)
        asked |= self._ask(np.union1d(changed.added, rows_of(searching)))
        wanted: set[Pair] = set()
        doubtful: set[Pair] = set()
        for row, others in asked.items():
            before = self._asked.get(row, {}).keys()
            wanted.update(_pair(row, other) for other in others.keys() - before)
            doubtful.update(_pair(row, other) for other in before - others.keys())
        self._asked |= asked
        unwanted = [
            pair
            for pair in sorted(doubtful & self._row.keys())
            if pair[1] not in self._asked[pair[0]]
            and pair[0] not in self._asked[pair[1]]
            and self.pairs["distance"][self._row[pair]] > CLOSE_M
        ]
        return wanted, unwanted

    def _revise(self, changed: Changed) -> tuple[dict[int, Asked], set[int]]:
        """Revise whom fragments ask for that lose or gain somebody near enough to matter.

        Returns:
            Whom each now asks for, and those that have to search for others.
        """
        gone = set(changed.removed.tolist())
        revised: dict[int, Asked] = {row: {} for row in self._losing}
        for asker, other, distance in self._gains(changed.added):
            revised.setdefault(asker, {})[other] = distance
        searching = set()
        for row, gained in revised.items():
            before, reach = self._asked[row], self._fragments["reach"][row]
            kept = {other: d for other, d in before.items() if other not in gone} | gained
            everyone = reach == FARTHEST_RADIUS_M and len(before) < FACING
            if len(kept) >= FACING and (reach < FARTHEST_RADIUS_M or everyone):
                limit = sorted(kept.values())[FACING - 1]
                revised[row] = {other: d for other, d in kept.items() if d <= limit + TIE_M}
                if limit <= FARTHEST_RADIUS_M:
                    self._fragments["reach"][row] = limit + TIE_M
            elif everyone:
                revised[row] = kept
            else:
                searching.add(row)
        return {row: asked for row, asked in revised.items() if row not in searching}, searching

    def _gains(self, added: IntArray) -> Iterator[tuple[int, int, float]]:
        """Yield who may ask for which new fragment, and its distance."""
        box, reach = self._fragments["box"], self._fragments["reach"]
        near = np.setdiff1d(self._fragments.meeting("box", box[added], "reach"), added)
        wide = box[near] + reach[near, None] * OUTWARDS
        tree = shapely.STRtree(np.asarray(shapely.box(*box[added].T)))
        asker, other = tree.query(np.asarray(shapely.box(*wide.T)))
        surfaces = self.surfaces(np.concatenate([near, added]))
        one, two = asker, len(near) + other
        meets = face_each_other(surfaces, one, two)
        distances = closest_distances(surfaces.segments, one[meets], two[meets])
        asker, other = near[asker[meets]], added[other[meets]]
        counts = (distances <= reach[asker]) | (reach[asker] == FARTHEST_RADIUS_M)
        yield from zip(
            asker[counts].tolist(), other[counts].tolist(), distances[counts].tolist(), strict=True
        )

    def _ask(self, askers: IntArray) -> dict[int, Asked]:
        """Search for whom fragments ask for, and remember how far they had to look."""
        asked: dict[int, Asked] = {}
        for radius in RADII_M:  # most find enough nearby
            rows = self._fragments.meeting("box", self._fragments["box"][askers], radius)
            local = np.searchsorted(rows, askers)
            found = facing_neighbours(self.surfaces(rows), local, FACING)
            who, whom, distances, looked = found
            settled = (looked < radius) | (radius == RADII_M[-1])
            asked |= {row: {} for row in askers[settled].tolist()}
            for row, other, distance in zip(
                rows[who].tolist(), rows[whom].tolist(), distances.tolist(), strict=True
            ):
                if row in asked:
                    asked[row][other] = distance
            self._fragments["reach"][askers] = np.minimum(looked + TIE_M, FARTHEST_RADIUS_M)
            askers = askers[~settled]
            if not len(askers):
                break
        return asked

    def _close_pairs(self, added: IntArray) -> set[Pair]:
        rows = self._fragments.meeting("box", self._fragments["box"][added], CLOSE_M)
        new, lines = (self.surfaces(some).segments for some in (added, rows))
        one, two = close_together(new, lines, CLOSE_M)
        ends = zip(added[one].tolist(), rows[two].tolist(), strict=True)
        return {_pair(a, b) for a, b in ends if a != b}

    def _add(self, pairs: list[Pair]) -> IntArray:
        ends = np.array(pairs, np.int64).reshape(-1, 2)
        box = self._fragments["box"][ends]
        hull = np.concatenate([box[..., :2].min(axis=1), box[..., 2:].max(axis=1)], axis=1)
        rows = self.pairs.add(len(pairs), ends=ends, hull=hull)
        self.pairs["logits"][rows] = np.nan
        for pair, row in zip(pairs, rows.tolist(), strict=True):
            self._row[pair] = row
            for end in pair:
                self._of.setdefault(end, set()).add(row)
        return rows

    def _look(self, new: IntArray, stale: IntArray) -> set[int]:
        """Follow the lines of sight of pairs; return the ends of those that changed by it."""
        pairs = np.concatenate([new, stale])
        if not len(pairs):
            return set()
        hulls = self.pairs["hull"][pairs]
        around = np.array([[*hulls[:, :2].min(axis=0), *hulls[:, 2:].max(axis=0)]])
        rows = self._fragments.meeting("box", around, MARGIN_M)
        surfaces = self.surfaces(rows)
        one, two = np.searchsorted(rows, self.pairs["ends"][pairs]).T
        gaps = self._closures_in(self._gaps, around)
        closed = gaps, self._closures_in(self._continuations, around)
        seen = visibility(surfaces, np.stack([one, two], axis=1), closed)
        self.pairs["distance"][new] = closest_distances(
            surfaces.segments, one[: len(new)], two[: len(new)]
        )
        before = self.pairs["visibility"][stale]
        self.pairs["visibility"][pairs] = seen
        otherwise = stale[(seen[len(new) :] != before).any(axis=1)]
        changed = np.concatenate([new, otherwise])
        return self._relate(changed)

    def _closures_in(self, pool: Pool, around: FloatArray) -> Closures:
        rows = pool.meeting("box", around, MARGIN_M)
        return Closures(pool["segment"][rows], pool["width"][rows])

    def _relate(self, pairs: IntArray) -> set[int]:
        """Relate the pairs that are worth it; return the ends of those that are or were."""
        worth = worth_relating(self.pairs["distance"][pairs], self.pairs["visibility"][pairs])
        ends: set[int] = set()
        every = zip(pairs.tolist(), self.pairs["ends"][pairs].tolist(), worth.tolist(), strict=True)
        for pair, both, related in every:
            for end in both:
                self._arrays.pop(end, None)
                of = self._related_of.setdefault(end, set())
                if related or pair in of:
                    ends.add(end)
                if related:
                    of.add(pair)
                else:
                    of.discard(pair)
        return ends


def _pair(one: int, two: int) -> Pair:
    return (one, two) if one < two else (two, one)
