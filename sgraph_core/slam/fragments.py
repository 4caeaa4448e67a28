"""Preprocessing of a map that changes: only what touches a change is split anew."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from sgraph_concepts.types import FloatArray, IntArray, SurfaceArrays
from sgraph_core.preprocess import (
    DUPLICATE_ANGLE_RAD,
    DUPLICATE_OFFSET_M,
    TOUCH_M,
    Fragments,
    drop_duplicates,
    split,
)
from sgraph_core.slam.pins import NO_PINS, PairPins
from sgraph_core.slam.pool import Pool, boxes_around, rows_of
from sgraph_core.support import SUPPORT

__all__ = ["Changed", "LiveFragments"]


@dataclass(frozen=True, eq=False)
class Changed:
    """What became of the fragments.

    Attributes:
        removed: rows of fragments that are gone; their columns can still be read.
        added: rows of new ones.
        repeated: rows of those that stand for other surfaces than before.
        repinned: rows of those whose pins are others than before.
        preprocessed: how many surfaces were looked at.
    """

    removed: IntArray
    added: IntArray
    repeated: IntArray
    repinned: IntArray
    preprocessed: int


class LiveFragments:
    """The wall surfaces as :func:`sgraph_core.preprocess.preprocess` leaves them, kept up to date.

    Attributes:
        parents: the surfaces as they came, by row: ``id``, ``segment``, ``normal``, ``box``.
        fragments: theirs: ``parent`` id, ``segment``, ``normal``, ``box``, and for its users to
            fill in ``reach``, how far a fragment looks for its neighbours, ``in_line``, the lengths
            of others in line with it, ``turn``, four times its direction, and ``support``, what it
            was last scored by.
        pins: pins between fragments' parents; those of a surface that was dropped are its
            original's.
    """

    def __init__(self) -> None:
        self.parents = Pool(
            id=np.empty(0, np.int64),
            segment=np.empty((0, 2, 2)),
            normal=np.empty((0, 2)),
            box=np.empty((0, 4)),
        )
        self.fragments = Pool(
            parent=np.empty(0, np.int64),
            segment=np.empty((0, 2, 2)),
            normal=np.empty((0, 2)),
            box=np.empty((0, 4)),
            reach=np.empty(0),
            in_line=np.empty((0, 2)),
            turn=np.empty((0, 2)),
            support=np.empty((0, len(SUPPORT))),
        )
        self._row: dict[int, int] = {}
        self._rows_of: dict[int, list[int]] = {}
        self._original: dict[int, int] = {}
        self._copies: dict[int, set[int]] = {}
        self._pins = self.pins = NO_PINS

    def update(self, surfaces: SurfaceArrays, pins: PairPins) -> Changed:
        """Take new surfaces in, and those among them that are known as they are now.

        Args:
            surfaces: in world coordinates.
            pins: all pins between surfaces that are known by now.
        """
        known = [self._row[i] for i in surfaces.ids.tolist() if i in self._row]
        before = self.parents["box"][known].copy()
        rows = self._store(surfaces)
        repinned = pins.differing(self._pins)
        self._pins = pins
        rows = np.union1d(rows, rows_of(self._row[i] for i in repinned))
        related = self._possible_repeats(rows, before)
        touched = np.concatenate([before, self.parents["box"][related]])
        restated = self._decide_duplicates(related)
        near = self.parents.meeting("box", touched, TOUCH_M)
        targets = self._kept(np.union1d(near, related))
        knives = self._kept(self.parents.meeting("box", self.parents["box"][targets], TOUCH_M))
        context = np.union1d(targets, knives)
        ids = self.parents["id"]
        pieces = split(self._surfaces(context))
        pieces = pieces.take(np.isin(pieces.ids, ids[targets]))
        concerned = ids[np.union1d(targets, related)]
        removed, added = self._exchange(concerned, pieces)
        before_pins, self.pins = self.pins, pins.taken_over(self._original)
        return Changed(
            removed,
            added,
            self.of_parents(restated),
            self.of_parents(self.pins.differing(before_pins)),
            len(np.union1d(context, related)),
        )

    def of_parents(self, parents: Iterable[int]) -> IntArray:
        """Return the rows of all fragments of some surfaces."""
        return rows_of(row for i in parents for row in self._rows_of.get(i, ()))

    def duplicates(self, parents: IntArray) -> Mapping[int, int]:
        """Return who stands for each surface that repeats one of some surfaces, by id."""
        return {
            copy: original
            for original in np.unique(parents).tolist()
            for copy in sorted(self._copies.get(original, ()))
        }

    def in_order(self, rows: IntArray) -> IntArray:
        """Return fragments in an order that does not depend on when they came: by parent."""
        columns = self.fragments["segment"][rows].reshape(-1, 4).T
        return rows[np.lexsort((*columns, self.fragments["parent"][rows]))]

    def take(self, rows: IntArray) -> Fragments:
        """Return some fragments with the duplicates of their parents."""
        some = self.fragments
        surfaces = SurfaceArrays(some["parent"][rows], some["segment"][rows], some["normal"][rows])
        return Fragments(surfaces, self.duplicates(surfaces.ids))

    def _store(self, surfaces: SurfaceArrays) -> IntArray:
        fresh = [i for i in surfaces.ids.tolist() if i not in self._row]
        added = self.parents.add(len(fresh), id=np.array(fresh, np.int64))
        self._row.update(zip(fresh, added.tolist(), strict=True))
        rows = np.array([self._row[i] for i in surfaces.ids.tolist()], np.int64)
        self.parents["segment"][rows] = surfaces.segments
        self.parents["normal"][rows] = surfaces.normals
        self.parents["box"][rows] = boxes_around(surfaces.segments)
        return rows

    def _surfaces(self, rows: IntArray) -> SurfaceArrays:
        some = self.parents
        return SurfaceArrays(some["id"][rows], some["segment"][rows], some["normal"][rows])

    def _kept(self, rows: IntArray) -> IntArray:
        ids = self.parents["id"][rows].tolist()
        return rows[[i not in self._original for i in ids]]

    def _possible_repeats(self, rows: IntArray, before: FloatArray) -> IntArray:
        """Return the surfaces whose standing for one another may depend on the changed ones.

        Chains of surfaces that come close and face the same way: who repeats whom is decided
        within such a chain, or, where pins link them, within several.
        """
        boxes, normals = self.parents["box"], self.parents["normal"]
        chain = np.union1d(rows, self.parents.meeting("box", before, DUPLICATE_OFFSET_M))
        latest = chain
        while len(latest):
            near = np.setdiff1d(
                self.parents.meeting("box", boxes[latest], DUPLICATE_OFFSET_M), chain
            )
            same_way = normals[near] @ normals[latest].T > np.cos(DUPLICATE_ANGLE_RAD)
            pinned = self.parents["id"][latest].tolist() if self._pins else ()
            linked = self._pins.together(pinned) | self._pins.apart(pinned)
            latest = np.union1d(near[same_way.any(axis=1)], rows_of(self._row[i] for i in linked))
            latest = np.setdiff1d(latest, chain)
            chain = np.union1d(chain, latest)
        return chain

    def _decide_duplicates(self, rows: IntArray) -> set[int]:
        """Decide who stands for whom; return the ids of those that stand for others than before."""
        ids = self.parents["id"][rows].tolist()
        before = {(copy, self._original.pop(copy)) for copy in ids if copy in self._original}
        pins = self._pins.among(set(ids))
        _, stands_for = drop_duplicates(self._surfaces(rows), pins.let_stand)
        self._original |= stands_for
        after = set(stands_for.items())
        for copy, original in before - after:
            self._copies[original].discard(copy)
        for copy, original in after - before:
            self._copies.setdefault(original, set()).add(copy)
        return {original for _, original in before ^ after}

    def _exchange(self, parents: IntArray, pieces: SurfaceArrays) -> tuple[IntArray, IntArray]:
        """Replace the fragments of some surfaces; those that stay as they are keep their rows.

        Returns:
            Rows of the fragments that are gone, and of the new ones.
        """
        pool = self.fragments
        stale = {
            self._key(pool["parent"][row], pool["segment"][row], pool["normal"][row]): row
            for parent in parents.tolist()
            for row in self._rows_of.get(parent, ())
        }
        fresh = [
            k
            for k in range(len(pieces))
            if stale.pop(self._key(pieces.ids[k], pieces.segments[k], pieces.normals[k]), None)
            is None
        ]
        removed = rows_of(stale.values())
        for row in removed.tolist():
            self._rows_of[int(pool["parent"][row])].remove(row)
        new = pieces.take(np.array(fresh, np.int64))
        added = pool.add(
            len(new),
            parent=new.ids,
            segment=new.segments,
            normal=new.normals,
            box=boxes_around(new.segments),
        )
        pool.remove(removed)
        for parent, row in zip(new.ids.tolist(), added.tolist(), strict=True):
            self._rows_of.setdefault(parent, []).append(row)
        return removed, added

    @staticmethod
    def _key(parent: int, segment: FloatArray, normal: FloatArray) -> tuple[int, bytes, bytes]:
        return int(parent), segment.tobytes(), normal.tobytes()
