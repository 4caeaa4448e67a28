"""What a person pinned about rooms: the rules that pins obey, and what they ask for.

Surfaces that ``same_room`` links, directly or over others, form a group: one room holds all of it.
No room holds both surfaces of a ``not_same_room`` pair. A surface that was mapped twice is one
surface, whose pins are those of all its copies, unless that makes them contradict.

:mod:`sgraph_core.clustering.pinned` makes it so.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Literal

from sgraph_concepts.spec import WALL_SURFACE
from sgraph_core.graph import Pins
from sgraph_core.tables import ID_RULE, PlaceError, is_id

__all__ = ["PINNED_CONCEPT", "Pinned", "RoomPins", "between_mapped", "check_pins"]

PINNED_CONCEPT = "room"
"""The concept that the names of the pins speak of."""

Pair = tuple[int, int]
Pinned = Literal["together", "apart"]
"""What two surfaces are pinned to be."""


def check_pins(pins: Pins, surfaces: Collection[int] | None = None) -> None:
    """Check that pins name pairs of wall surfaces and do not contradict one another.

    Args:
        pins: the pins.
        surfaces: ids of the map's wall surfaces; None where some may be mapped later.

    Raises:
        PlaceError: they break a rule.
    """
    for name, pairs in (("same_room", pins.same_room), ("not_same_room", pins.not_same_room)):
        for k, pair in enumerate(pairs):
            if not isinstance(pair, tuple) or len(pair) != 2:
                raise PlaceError(f"pins.{name}[{k}]", pair, "must be a tuple of two surfaces")
            for side, surface in enumerate(pair):
                place = f"pins.{name}[{k}][{side}]"
                if not is_id(surface):
                    raise PlaceError(place, surface, ID_RULE)
                if surfaces is not None and surface not in surfaces:
                    raise PlaceError(place, surface, f"must be the id of a {WALL_SURFACE}")
            if pair[0] == pair[1]:
                raise PlaceError(f"pins.{name}[{k}]", list(pair), "must be two surfaces")
    for room, text in pins.room_names.items():
        if not is_id(room):
            raise PlaceError("pins.room_names", room, f"key {ID_RULE}")
        if not isinstance(text, str):
            raise PlaceError(f"pins.room_names[{room}]", text, "must be text")
    groups = _groups(pins.same_room)
    for k, pair in enumerate(pins.not_same_room):
        if _within(pair, groups):
            rule = f"contradicts same_room {_links(pair, pins.same_room)}"
            raise PlaceError(f"pins.not_same_room[{k}]", list(pair), rule)


def between_mapped(pins: Pins, surfaces: Iterable[int]) -> Pins:
    """Return pins without the pairs that wait for a surface to be mapped."""
    if not (pins.same_room or pins.not_same_room):
        return pins
    mapped = set(surfaces)
    same, apart = (
        tuple(pair for pair in pairs if mapped.issuperset(pair))
        for pairs in (pins.same_room, pins.not_same_room)
    )
    return replace(pins, same_room=same, not_same_room=apart)


class RoomPins:
    """What the pins of one map ask for while it is inferred.

    Args:
        pins: pins that :func:`check_pins` accepts.
    """

    def __init__(self, pins: Pins) -> None:
        self._same, self._apart = list(pins.same_room), list(pins.not_same_room)

    @property
    def groups(self) -> list[frozenset[int]]:
        """The surfaces that one room holds together."""
        return _groups(self._same)

    @property
    def apart(self) -> list[tuple[int, int]]:
        """The pairs of surfaces that no room holds both of."""
        return self._apart

    def group(self, surface: int) -> frozenset[int]:
        """Return the surfaces that one room holds together with a surface, and itself."""
        return next((group for group in self.groups if surface in group), frozenset({surface}))

    def between(self, one: int, two: int) -> Pinned | None:
        """Return what two surfaces are pinned to be, directly or over their groups."""
        if one == two:
            return None
        ones, twos = self.group(one), self.group(two)
        if two in ones:
            return "together"
        if any(ones.intersection(pair) and twos.intersection(pair) for pair in self._apart):
            return "apart"
        return None

    def let_stand(self, original: int, copy: int) -> bool:
        """Return whether one surface may stand for another, whose pins it then takes over."""
        if not any(copy in pair for pair in (*self._same, *self._apart)):
            return True
        same, apart = (
            [(original if a == copy else a, original if b == copy else b) for a, b in pairs]
            for pairs in (self._same, self._apart)
        )
        groups = _groups(same)
        if any(a == b or _within((a, b), groups) for a, b in apart):
            return False
        self._same, self._apart = same, apart
        return True


def _groups(pairs: Iterable[Pair]) -> list[frozenset[int]]:
    """Return the sets of what pairs link, by their smallest member."""
    groups: list[frozenset[int]] = []
    for pair in pairs:
        linked = frozenset(pair).union(*(g for g in groups if not g.isdisjoint(pair)))
        groups = [*(g for g in groups if g.isdisjoint(pair)), linked]
    return sorted(groups, key=min)


def _within(pair: Pair, groups: Iterable[frozenset[int]]) -> bool:
    return any(group.issuperset(pair) for group in groups)


def _links(ends: Pair, pairs: Sequence[Pair]) -> str:
    import networkx as nx  # here: only the text of an error needs it

    graph: nx.Graph[int] = nx.Graph()
    graph.add_edges_from(pairs)
    path = nx.shortest_path(graph, *ends)
    return ", ".join(str(list(link)) for link in pairwise(path))
