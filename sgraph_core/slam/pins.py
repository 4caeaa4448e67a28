"""Pinned pairs of surfaces of a map that changes: whom they link, and what changes in them."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence

from sgraph_core.graph import Pins
from sgraph_core.pins import RoomPins, between_mapped

__all__ = ["NO_PINS", "PairPins"]

Pair = tuple[int, int]


class PairPins:
    """Pinned pairs of surfaces.

    Args:
        pins: whose pairs; names do not matter here.
    """

    def __init__(self, pins: Pins) -> None:
        self._pins = pins
        self._together = _partners(pins.same_room)
        self._apart = _partners(pins.not_same_room)

    def __bool__(self) -> bool:
        return bool(self._together or self._apart)

    def together(self, surfaces: Iterable[int]) -> set[int]:
        """Return what is pinned into one room with any of some surfaces."""
        return {other for i in surfaces for other in self._together.get(i, ())}

    def apart(self, surfaces: Iterable[int]) -> set[int]:
        """Return what is pinned out of the rooms of any of some surfaces."""
        return {other for i in surfaces for other in self._apart.get(i, ())}

    def differing(self, other: PairPins) -> set[int]:
        """Return the surfaces of the pairs that only one of two sets of pins has."""
        one, two = self._pins, other._pins
        same = set(one.same_room) ^ set(two.same_room)
        apart = set(one.not_same_room) ^ set(two.not_same_room)
        return {surface for pair in same | apart for surface in pair}

    def taken_over(self, originals: Mapping[int, int]) -> PairPins:
        """Return the pins with each surface replaced by the one that stands for it, if any."""
        if not self:
            return self
        same, apart = (
            tuple((originals.get(one, one), originals.get(two, two)) for one, two in pairs)
            for pairs in (self._pins.same_room, self._pins.not_same_room)
        )
        return PairPins(Pins(same, apart))

    def among(self, surfaces: Collection[int]) -> RoomPins:
        """Return the pins between two of some surfaces."""
        return RoomPins(between_mapped(self._pins, surfaces))


def _partners(pairs: Sequence[Pair]) -> dict[int, set[int]]:
    partners: dict[int, set[int]] = {}
    for one, two in pairs:
        partners.setdefault(one, set()).add(two)
        partners.setdefault(two, set()).add(one)
    return partners


NO_PINS = PairPins(Pins())
