"""The scenes of the paper's Table I, rebuilt from their descriptions as data.

The paper gives how many square, L-shaped and elongated rooms and corridors each scene has, and
nothing more. Assumed here: sides of rooms of 4 to 7 m, corridors 2 m wide, walls of 10 to 30 cm that
differ within a scene, doors 0.9 m wide and open, a ceiling at 2.6 m, lintels at 2.1 m. Rooms are
arranged so that a tour passes rooms and corridors more than once, by different doors.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from sgraph_concepts.errors import InputError
from sgraph_core.frontend.building import Door, Floor, Point

__all__ = ["SCENES", "scene"]


def scene(name: str) -> Floor:
    """Return the floor of one of the paper's scenes.

    Raises:
        InputError: there is no scene of that name.
    """
    if name not in SCENES:
        raise InputError(f"there is no scene {name!r}: known are {', '.join(SCENES)}")
    return SCENES[name]


def _box(west: float, south: float, east: float, north: float) -> tuple[Point, ...]:
    return ((west, south), (east, south), (east, north), (west, north))


_C1F1 = Floor(
    name="C1F1s",
    rooms={
        "corridor 1": _box(0, 0, 16, 2),
        "corridor 2": _box(14, 2.2, 16, 12),
        "square 1": _box(0, 2.15, 6, 8.15),
        "L 1": ((6.12, 2.15), (13.8, 2.15), (13.8, 12), (0, 12), (0, 8.3), (6.12, 8.3)),
    },
    doors=(
        Door("corridor 1", "corridor 2", (15, 2.1), 1.4),
        Door("corridor 1", "square 1", (3, 2.1)),
        Door("corridor 1", "L 1", (10, 2.1)),
        Door("L 1", "corridor 2", (13.9, 9)),
        Door("L 1", "square 1", (3, 8.2)),
    ),
    tour=(
        "corridor 1", "square 1", "L 1", "corridor 2", "corridor 1", "L 1", "square 1",
        "corridor 1", "corridor 2", "L 1", "corridor 1",
    ),
)  # fmt: skip

SCENES: Mapping[str, Floor] = MappingProxyType({floor.name: floor for floor in (_C1F1,)})
