"""Fragments in whole components, and what is next to them; each is asked for its pairs once.

Fragments that are joined by pairs more likely related than not, directly or over others, form a
*component*, and so do all fragments of surfaces that are pinned together. What is related to one,
or pinned apart from it, is next to it.
"""

from __future__ import annotations

from copy import copy

import numpy as np

from sgraph_concepts.types import IntArray
from sgraph_core.slam.fragments import LiveFragments
from sgraph_core.slam.pairs import LivePairs
from sgraph_core.slam.pins import PairPins

__all__ = ["Components"]


class Components:
    """A growing set of whole components of one concept, empty at first.

    Args:
        column: the concept's, of the pairs' ``logits``.
        fragments, pairs: what the components consist of.
        pins: pins that count.
    """

    def __init__(
        self, column: int, fragments: LiveFragments, pairs: LivePairs, pins: PairPins
    ) -> None:
        self._column, self._fragments, self._pairs, self._pins = column, fragments, pairs, pins
        self._inside = np.zeros(len(fragments.fragments), bool)
        self._beside = np.zeros(len(fragments.fragments), bool)

    @property
    def rows(self) -> IntArray:
        """The fragments in the set."""
        return np.flatnonzero(self._inside)

    @property
    def next_to(self) -> IntArray:
        """The fragments next to the set."""
        return np.flatnonzero(self._beside & ~self._inside)

    def add(self, rows: IntArray) -> IntArray:
        """Add fragments with their components; return all that were added."""
        before = self._inside.copy()
        latest = rows[~self._inside[rows]]
        while len(latest):
            self._inside[latest] = True
            joined = self._follow(latest)
            latest = np.unique(joined[~self._inside[joined]])
        return np.flatnonzero(self._inside & ~before)

    def with_next(self) -> Components:
        """Return a copy that has the components next to it, too."""
        wider = copy(self)
        wider._inside, wider._beside = self._inside.copy(), self._beside.copy()
        wider.add(self.next_to)
        return wider

    def _follow(self, rows: IntArray) -> IntArray:
        """Note what is next to fragments, and return what is in components with them."""
        pairs = self._pairs.related(rows)
        ends = self._pairs.pairs["ends"][pairs]
        self._beside[ends] = True
        joined: IntArray = ends[self._pairs.pairs["logits"][pairs, self._column] > 0].ravel()
        if not self._pins:
            return joined
        parents = set(self._fragments.fragments["parent"][rows].tolist())
        self._beside[self._fragments.of_parents(self._pins.apart(parents))] = True
        return np.concatenate([joined, self._fragments.of_parents(self._pins.together(parents))])
