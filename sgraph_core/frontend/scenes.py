"""The scenes of the paper's Table I, rebuilt from their descriptions as data.

The paper gives how many square, L-shaped and elongated rooms and corridors each scene has, and
nothing more. Assumed here: sides of rooms of 4 to 7 m, corridors 2 m wide, walls of 10 to 30 cm
that differ within a scene, doors 0.9 m wide and open, a ceiling at 2.6 m, lintels at 2.1 m, some
furniture in the layouts like real ones. Rooms are arranged so that a tour passes rooms and
corridors more than once, by different doors.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

from sgraph_concepts.errors import InputError
from sgraph_core.frontend.building import Door, Floor, Furniture, Point

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

_C1F2 = Floor(
    name="C1F2s",
    rooms={
        "corridor 1": _box(0, 0, 25, 2),
        "square 1": _box(0, 2.2, 5, 7.2),
        "square 2": _box(5.15, 2.2, 10.15, 7.2),
        "square 3": _box(10.35, 2.2, 15.35, 7.2),
        "elongated 1": _box(15.45, 2.2, 25, 5.7),
        "square 4": _box(0, -5.15, 5, -0.15),
        "square 5": _box(5.3, -5.15, 10.3, -0.15),
        "elongated 2": _box(10.42, -4.15, 21, -0.15),
    },
    doors=(
        Door("corridor 1", "square 1", (2, 2.1)),
        Door("corridor 1", "square 2", (9, 2.1)),
        Door("corridor 1", "square 3", (12, 2.1)),
        Door("corridor 1", "elongated 1", (23, 2.1)),
        Door("corridor 1", "square 4", (3, -0.1)),
        Door("corridor 1", "square 5", (6.5, -0.1)),
        Door("corridor 1", "elongated 2", (19, -0.1)),
        Door("square 1", "square 2", (5.1, 5.5)),
        Door("square 3", "elongated 1", (15.4, 3.5)),
        Door("square 5", "elongated 2", (10.36, -2)),
    ),
    tour=(
        "corridor 1", "square 4", "square 1", "square 2", "square 3", "elongated 1", "corridor 1",
        "elongated 2", "square 5", "square 4", "square 2", "square 1", "elongated 1", "square 3",
        "elongated 2", "square 5", "corridor 1",
    ),
)  # fmt: skip

_SE1 = Floor(
    name="SE1s",
    rooms={
        "corridor 1": _box(0, 0, 20, 2),
        "corridor 2": _box(20.2, 0, 22.2, 16),
        "corridor 3": _box(0, 14, 20, 16),
        "square 1": _box(0, 2.2, 6.5, 7.9),
        "square 2": _box(6.65, 2.2, 13.15, 7.9),
        "square 3": _box(13.35, 2.2, 19.9, 7.9),
        "square 4": _box(0, 8.1, 6.5, 13.8),
        "square 5": _box(6.6, 8.1, 13.1, 13.8),
        "square 6": _box(13.35, 8.1, 19.9, 13.8),
    },
    doors=(
        Door("corridor 1", "corridor 2", (20.1, 1), 1.4),
        Door("corridor 3", "corridor 2", (20.1, 15), 1.4),
        Door("corridor 1", "square 1", (5, 2.1)),
        Door("corridor 1", "square 2", (8, 2.1)),
        Door("corridor 1", "square 3", (18, 2.1)),
        Door("corridor 3", "square 4", (1.5, 13.9)),
        Door("corridor 3", "square 5", (12, 13.9)),
        Door("corridor 3", "square 6", (16, 13.9)),
        Door("square 1", "square 4", (2, 8)),
    ),
    tour=(
        "corridor 1", "square 1", "square 2", "square 3", "corridor 2", "corridor 3", "square 6",
        "square 5", "square 4", "square 1", "corridor 1", "corridor 2", "square 6", "corridor 3",
        "square 4", "square 1", "square 2", "corridor 1",
    ),
)  # fmt: skip

_SE2 = Floor(
    name="SE2s",
    rooms={
        "elongated 1": _box(0, 0, 11, 3.5),
        "square 1": _box(11.2, 0, 16.2, 5),
        "square 2": _box(0, 3.65, 5.4, 9.05),
        "square 3": _box(5.6, 3.65, 11, 9.05),
        "square 4": _box(11.2, 5.15, 16.4, 10.35),
        "elongated 2": _box(0, 9.25, 11, 12.75),
        "square 5": _box(11.2, 10.5, 16.2, 15.5),
    },
    doors=(
        Door("elongated 1", "square 1", (11.1, 2)),
        Door("elongated 1", "square 2", (2.5, 3.6)),
        Door("elongated 1", "square 3", (9, 3.6)),
        Door("square 2", "square 3", (5.5, 6.5)),
        Door("square 3", "square 4", (11.1, 7.5)),
        Door("square 1", "square 4", (13.5, 5.1)),
        Door("square 2", "elongated 2", (2, 9.15)),
        Door("square 4", "square 5", (13, 10.4)),
        Door("elongated 2", "square 5", (11.1, 11.7)),
    ),
    tour=(
        "elongated 1", "square 2", "elongated 2", "square 5", "square 4", "square 1",
        "elongated 1", "square 3", "square 4", "square 5", "elongated 2", "square 2", "square 3",
        "elongated 1", "square 1", "square 4", "square 3", "elongated 1",
    ),
)  # fmt: skip

# A ring of corridors: ten rooms inside it, six rooms south and six rooms north of it.
_SE3 = Floor(
    name="SE3s",
    rooms={
        "corridor 1": _box(0, 0, 31, 2),
        "corridor 2": _box(29, 2.2, 31, 13.2),
        "corridor 3": _box(0, 13.4, 31, 15.4),
        "corridor 4": _box(0, 2.2, 2, 13.2),
        "square 1": _box(2.2, 2.2, 7.2, 7.6),
        "square 2": _box(7.35, 2.2, 12.45, 7.6),
        "square 3": _box(12.6, 2.2, 18, 7.6),
        "square 4": _box(18.15, 2.2, 23.35, 7.6),
        "square 5": _box(23.5, 2.2, 28.8, 7.6),
        "square 6": _box(2.2, 7.8, 7.2, 13.2),
        "square 7": _box(7.35, 7.8, 12.45, 13.2),
        "square 8": _box(12.6, 7.8, 18, 13.2),
        "square 9": _box(18.15, 7.8, 23.35, 13.2),
        "square 10": _box(23.5, 7.8, 28.8, 13.2),
        "square 11": _box(0, -5.15, 5, -0.15),
        "square 12": _box(5.12, -5.15, 10.12, -0.15),
        "square 13": _box(10.3, -5.15, 15.3, -0.15),
        "square 14": _box(15.6, -5.15, 20.6, -0.15),
        "square 15": _box(20.72, -5.15, 25.72, -0.15),
        "square 16": _box(25.9, -5.15, 31, -0.15),
        "square 17": _box(0, 15.65, 5, 20.65),
        "square 18": _box(5.12, 15.65, 10.12, 20.65),
        "square 19": _box(10.3, 15.65, 15.3, 20.65),
        "square 20": _box(15.6, 15.65, 20.6, 20.65),
        "square 21": _box(20.72, 15.65, 25.72, 20.65),
        "square 22": _box(25.9, 15.65, 31, 20.65),
    },
    doors=(
        Door("corridor 1", "corridor 2", (30, 2.1), 1.4),
        Door("corridor 2", "corridor 3", (30, 13.3), 1.4),
        Door("corridor 3", "corridor 4", (1, 13.3), 1.4),
        Door("corridor 4", "corridor 1", (1, 2.1), 1.4),
        Door("corridor 1", "square 1", (4, 2.1)),
        Door("corridor 1", "square 2", (9, 2.1)),
        Door("corridor 1", "square 3", (16, 2.1)),
        Door("corridor 1", "square 4", (20, 2.1)),
        Door("corridor 1", "square 5", (26, 2.1)),
        Door("corridor 3", "square 6", (5, 13.3)),
        Door("corridor 3", "square 7", (11, 13.3)),
        Door("corridor 3", "square 8", (14, 13.3)),
        Door("corridor 3", "square 9", (22, 13.3)),
        Door("corridor 3", "square 10", (27, 13.3)),
        Door("corridor 1", "square 11", (2, -0.1)),
        Door("corridor 1", "square 12", (7, -0.1)),
        Door("corridor 1", "square 13", (13, -0.1)),
        Door("corridor 1", "square 14", (18, -0.1)),
        Door("corridor 1", "square 15", (24, -0.1)),
        Door("corridor 1", "square 16", (28, -0.1)),
        Door("corridor 3", "square 17", (3, 15.5)),
        Door("corridor 3", "square 18", (8, 15.5)),
        Door("corridor 3", "square 19", (12, 15.5)),
        Door("corridor 3", "square 20", (19, 15.5)),
        Door("corridor 3", "square 21", (22, 15.5)),
        Door("corridor 3", "square 22", (29, 15.5)),
        Door("square 3", "square 8", (13.5, 7.7)),
        Door("square 12", "square 13", (10.2, -3)),
        Door("square 19", "square 20", (15.4, 18)),
    ),
    tour=(
        "corridor 1", "square 11", "square 1", "square 12", "square 13", "square 2", "square 3",
        "square 14", "square 4", "square 15", "square 5", "square 16", "corridor 2", "square 22",
        "square 10", "square 21", "square 9", "square 20", "square 19", "square 8", "square 7",
        "square 18", "square 6", "square 17", "corridor 4", "corridor 1", "square 3", "square 8",
        "corridor 3", "corridor 2", "square 16", "square 4", "square 12", "square 1",
        "corridor 4", "square 17", "square 19", "square 21", "corridor 2", "corridor 1",
    ),
)  # fmt: skip

_C2F2 = Floor(
    name="C2F2r",
    rooms={
        "square 1": _box(0, 0, 5, 5),
        "square 2": _box(5.15, 0, 10.15, 5),
        "elongated 1": _box(10.3, 0, 20, 3.6),
        "L 1": ((10.3, 3.75), (20, 3.75), (20, 7.6), (14.2, 7.6), (14.2, 11), (10.3, 11)),
        "square 3": _box(14.4, 7.8, 20, 13),
        "elongated 2": _box(0, 5.2, 10.1, 8.2),
        "square 4": _box(0, 8.4, 5, 13.4),
        "square 5": _box(5.2, 8.4, 10.1, 13.4),
        "L 2": (
            (0, 13.6), (10.1, 13.6), (10.1, 17.4), (4.6, 17.4), (4.6, 22), (0, 22),
        ),
        "square 6": _box(4.8, 17.6, 10.1, 22),
        "square 7": _box(14.4, 13.15, 20, 18.4),
        "elongated 3": _box(10.3, 11.15, 14.2, 22),
    },
    doors=(
        Door("square 1", "square 2", (5.1, 2)),
        Door("square 2", "elongated 1", (10.2, 1.5)),
        Door("square 1", "elongated 2", (2.5, 5.1)),
        Door("square 2", "elongated 2", (8, 5.1)),
        Door("elongated 1", "L 1", (17, 3.7)),
        Door("elongated 2", "L 1", (10.2, 6.5)),
        Door("L 1", "square 3", (17.5, 7.7)),
        Door("elongated 2", "square 4", (2, 8.3)),
        Door("elongated 2", "square 5", (7, 8.3)),
        Door("square 4", "L 2", (3, 13.5)),
        Door("square 5", "L 2", (8, 13.5)),
        Door("L 2", "elongated 3", (10.2, 15.5)),
        Door("L 2", "square 6", (7, 17.5)),
        Door("square 6", "elongated 3", (10.2, 20)),
        Door("L 1", "elongated 3", (12, 11.1)),
        Door("elongated 3", "square 7", (14.3, 15)),
        Door("square 3", "square 7", (16, 13.1)),
    ),
    tour=(
        "square 1", "square 2", "elongated 1", "L 1", "square 3", "square 7", "elongated 3",
        "square 6", "L 2", "square 4", "elongated 2", "square 1", "square 2", "elongated 2",
        "square 5", "L 2", "elongated 3", "L 1", "elongated 1", "square 2", "elongated 2",
        "square 4", "square 5", "elongated 2", "L 1", "square 3", "square 7", "elongated 3",
        "L 1", "elongated 2", "square 1",
    ),
    furniture=(
        Furniture((0.1, 4.2), (1.3, 4.9), 0.75),
        Furniture((8.5, 0.05), (10, 0.45), 1.8),
        Furniture((18.2, 0.05), (19.9, 0.85), 0.75),
        Furniture((19.4, 9), (19.95, 10.8), 1.8),
        Furniture((0.05, 10), (0.85, 11.6), 0.75),
        Furniture((9.55, 9), (10.05, 11), 1.8),
        Furniture((0.1, 20.5), (1.7, 21.3), 0.75),
        Furniture((17, 15), (18.6, 15.8), 0.75),
    ),
)  # fmt: skip

_C3F2 = Floor(
    name="C3F2r",
    rooms={
        "corridor 1": _box(0, 0, 27, 2.2),
        "corridor 2": _box(12, 2.4, 14, 17),
        "square 1": _box(0, 2.35, 5.5, 7.5),
        "square 2": _box(5.7, 2.35, 11.85, 7.5),
        "square 3": _box(0, 7.65, 5.5, 12.8),
        "L 1": ((5.7, 7.7), (11.85, 7.7), (11.85, 17), (0, 17), (0, 13), (5.7, 13)),
        "square 4": _box(14.15, 2.4, 20, 7.6),
        "square 5": _box(20.15, 2.4, 26, 7.6),
        "L 2": ((14.15, 7.8), (26, 7.8), (26, 11.6), (19.6, 11.6), (19.6, 17), (14.15, 17)),
        "square 6": _box(19.8, 11.8, 25.2, 17),
        "square 7": _box(0, -5.2, 5.4, -0.2),
        "square 8": _box(5.55, -5.2, 10.7, -0.2),
        "square 9": _box(10.8, -5.2, 16, -0.2),
        "L 3": ((16.2, -9), (21, -9), (21, -4.6), (27, -4.6), (27, -0.2), (16.2, -0.2)),
    },
    doors=(
        Door("corridor 1", "corridor 2", (13, 2.3), 1.4),
        Door("corridor 1", "square 1", (4, 2.3)),
        Door("corridor 1", "square 2", (7, 2.3)),
        Door("corridor 1", "square 4", (19, 2.3)),
        Door("corridor 1", "square 5", (22, 2.3)),
        Door("corridor 1", "square 7", (2, -0.1)),
        Door("corridor 1", "square 8", (8, -0.1)),
        Door("corridor 1", "square 9", (12, -0.1)),
        Door("corridor 1", "L 3", (24, -0.1)),
        Door("corridor 2", "L 1", (11.9, 10)),
        Door("corridor 2", "L 2", (14.1, 14)),
        Door("L 1", "square 3", (3, 12.9)),
        Door("square 1", "square 3", (2, 7.6)),
        Door("L 2", "square 6", (19.7, 14)),
        Door("L 2", "square 5", (24, 7.7)),
        Door("square 9", "L 3", (16.1, -2.5)),
    ),
    tour=(
        "corridor 1", "square 7", "square 1", "square 3", "L 1", "corridor 2", "L 2", "square 6",
        "L 2", "square 5", "corridor 1", "L 3", "square 9", "square 8", "square 2", "square 4",
        "corridor 2", "L 1", "square 3", "square 1", "square 7", "square 9", "L 3", "square 5",
        "L 2", "corridor 2", "corridor 1",
    ),
    furniture=(
        Furniture((0.05, 3), (0.85, 4.6), 0.75),
        Furniture((9, 6.9), (11.5, 7.45), 1.8),
        Furniture((10.5, 15.8), (11.7, 16.9), 0.75),
        Furniture((18, 6.9), (19.6, 7.55), 0.75),
        Furniture((25.4, 9), (25.95, 11), 1.8),
        Furniture((0.1, -5.1), (1.7, -4.3), 0.75),
        Furniture((13.5, -5.15), (15.5, -4.65), 1.8),
        Furniture((25.5, -3.5), (26.9, -2.5), 0.75),
    ),
)  # fmt: skip


def _furnished(floor: Floor, name: str, furniture: tuple[Furniture, ...]) -> Floor:
    return replace(floor, name=name, furniture=furniture)


SCENES: Mapping[str, Floor] = MappingProxyType(
    {
        floor.name: floor
        for floor in (
            _C1F1,
            _C1F2,
            _SE1,
            _SE2,
            _SE3,
            _furnished(
                _C1F1,
                "C1F1r",
                (
                    Furniture((0.1, 7.3), (1.7, 8.1), 0.75),
                    Furniture((13.2, 3), (13.75, 5), 1.8),
                    Furniture((5, 11.2), (6.6, 11.95), 0.75),
                ),
            ),
            _furnished(
                _C1F2,
                "C1F2r",
                (
                    Furniture((0.1, 6.3), (1.7, 7.1), 0.75),
                    Furniture((9.6, 3), (10.1, 5), 1.8),
                    Furniture((13.5, 6.6), (15.1, 7.15), 0.75),
                    Furniture((0.05, -4), (0.55, -2), 1.8),
                    Furniture((15, -4.1), (16.6, -3.3), 0.75),
                ),
            ),
            _C2F2,
            _C3F2,
        )
    }
)
"""The paper's simulated scenes (name ends in s) and layouts like those of its real ones (in r)."""
