"""A floor plan: an outline, corridors, and the rest split into rooms with walls between them."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import shapely
from numpy.random import Generator
from shapely import Polygon, box

from sgraph_concepts.types import FloatArray
from sgraph_core.geometry import turn_left
from sgraph_core.synth.config import PlanConfig
from sgraph_core.synth.cubicles import Cubicles, stand_cubicles
from sgraph_core.synth.double_walls import DoubleWall, draw_double_walls
from sgraph_core.synth.interior import stand_columns, stand_partitions
from sgraph_core.synth.open_plan import open_neighbours
from sgraph_core.synth.polygons import (
    all_edges,
    chamfer,
    clean,
    crook,
    cut,
    edges,
    extent,
    grow,
    polygons_in,
    rectangle,
)
from sgraph_core.synth.walls import INTO_ROOM_M, wall_gaps

__all__ = ["Plan", "draw_plan"]

NARROWEST_ROOM_M = 0.7
SHORTEST_MERGE_M = 0.9


@dataclass(frozen=True, eq=False)
class Plan:
    """The rooms of a floor.

    Attributes:
        rooms: each room's free space, apart by the thickness of the walls; columns and partitions
            are holes.
        open_borders: where two rooms meet without a wall, [B, 2, 2].
        double_walls: the walls between rooms that consist of two leaves.
        cubicles: for each room that is one, the room that it stands in.
    """

    rooms: list[Polygon]
    open_borders: FloatArray
    double_walls: list[DoubleWall] = field(default_factory=list)
    cubicles: Cubicles = field(default_factory=dict)


def draw_plan(rng: Generator, config: PlanConfig) -> Plan | None:
    """Draw a floor's rooms; None if no part of the floor is large enough for a room."""
    outline = _outline(rng, config)
    thicknesses = rng.uniform(
        *config.wall_thickness_m, size=rng.integers(*config.thicknesses, endpoint=True)
    )
    corridors, areas = _corridors(outline, thicknesses, rng, config)
    typical = _log_uniform(rng, config.room_area_m2)
    oblique = rng.choice(config.oblique_share)
    parts = list(corridors)
    for area in areas:
        parts += _split(area, typical, oblique, thicknesses, rng, config)
    rooms = [room for room in map(clean, parts) if room is not None]
    rooms = _merge(rooms, rng.choice(config.merged_share), rng)
    rooms = _shape_rooms(rooms, rng, config)
    if not rooms:
        return None
    # streams of their own: where none are drawn, all else is as if there were no such thing
    for_doubles, for_cubicles = rng.spawn(2)
    rooms, doubles = draw_double_walls(rooms, for_doubles, config)
    rooms, cubicles = stand_cubicles(rooms, for_cubicles, config)
    rooms = stand_partitions(stand_columns(rooms, rng, config), rng, config)
    rooms, borders = open_neighbours(rooms, rng, config)
    whole = [wall for wall in doubles if not shapely.intersects(wall.cavity, rooms).any()]
    return Plan(rooms, borders, whole, cubicles)


def _log_uniform(rng: Generator, interval: tuple[float, float]) -> float:
    return float(np.exp(rng.uniform(*np.log(interval))))


def _outline(rng: Generator, config: PlanConfig) -> Polygon:
    area, aspect = _log_uniform(rng, config.floor_area_m2), rng.uniform(*config.aspect)
    length, width = np.sqrt(area * aspect), np.sqrt(area / aspect)
    outline = box(0, 0, length, width)
    if rng.random() < config.notched_share and area > 120:
        for _ in range(rng.integers(1, 4)):
            notch_length, notch_width = (
                length * rng.uniform(0.15, 0.45),
                width * rng.uniform(0.2, 0.6),
            )
            x = rng.choice([0, length - notch_length, rng.uniform(0, length - notch_length)])
            y = rng.choice([0, width - notch_width, rng.uniform(0, width - notch_width)])
            notched = outline.difference(box(x, y, x + notch_length, y + notch_width))
            if isinstance(notched, Polygon):
                outline = notched
    if rng.random() < config.chamfered_outline_share:
        outline = chamfer(outline, rng, 0.4)
    return outline


def _corridors(
    outline: Polygon, thicknesses: FloatArray, rng: Generator, config: PlanConfig
) -> tuple[list[Polygon], list[Polygon]]:
    """Return the corridors of a floor and the areas left for rooms."""
    width = rng.uniform(*config.corridor_width_m)
    kind = rng.random()
    if kind < config.corridor_share and outline.area > 90:
        return _straight_corridors(outline, width, thicknesses, rng)
    if kind < config.corridor_share + config.ring_corridor_share and outline.area > 200:
        return _ring_corridor(outline, width, rng.choice(thicknesses), rng)
    return [], [outline]


def _straight_corridors(
    outline: Polygon, width: float, thicknesses: FloatArray, rng: Generator
) -> tuple[list[Polygon], list[Polygon]]:
    corridors: list[Polygon] = []
    areas = [outline]
    for _ in range(1 if outline.area < 500 else rng.integers(1, 4)):
        area = areas.pop(int(np.argmax([a.area for a in areas])))
        _, across, axis = extent(area)
        if across < 2 * width:
            areas.append(area)
            continue
        along = axis if rng.random() < 0.75 else turn_left(axis)
        point = _point_across(area, turn_left(along), rng)
        own_width = width * rng.uniform(0.8, 1.2)
        corridors += polygons_in(area.intersection(rectangle(point, along, 1e3, own_width)))
        areas += cut(area, point, along, own_width + 2 * rng.choice(thicknesses))
    return corridors, areas


def _ring_corridor(
    outline: Polygon, width: float, thickness: float, rng: Generator
) -> tuple[list[Polygon], list[Polygon]]:
    """Return a corridor that runs around a core, at some distance from the outline."""
    _, across, _ = extent(outline)
    outer = grow(outline, -rng.uniform(0.2, 0.35) * across)
    core = grow(outer, -width)
    if not isinstance(outer, Polygon) or not isinstance(core, Polygon) or core.area < 4:
        return [], [outline]
    belt = polygons_in(outline.difference(grow(outer, thickness)))
    corners = shapely.get_coordinates(outer.exterior)
    for start, end in pairwise(corners):
        length = np.linalg.norm(end - start)
        if length > 1:
            belt = [q for p in belt for q in cut(p, start, (end - start) / length, thickness)]
    return polygons_in(outer.difference(core)), [*polygons_in(grow(core, -thickness)), *belt]


def _point_across(area: Polygon, direction: FloatArray, rng: Generator) -> FloatArray:
    """Return a point in the middle half of an area along a direction."""
    reach = shapely.get_coordinates(area) @ direction
    centre = np.asarray(area.centroid.coords[0])
    wanted = reach.min() + np.ptp(reach) * rng.uniform(0.25, 0.75)
    return np.asarray(centre + (wanted - centre @ direction) * direction)


def _split(
    area: Polygon,
    typical_m2: float,
    oblique: float,
    thicknesses: FloatArray,
    rng: Generator,
    config: PlanConfig,
) -> list[Polygon]:
    """Split an area by straight walls until its parts are about as large as rooms should be."""

    def wanted() -> float:
        return float(typical_m2 * np.exp(rng.normal(0, config.room_area_spread)))

    rooms, waiting = [], [(area, wanted())]
    while waiting:
        part, target = waiting.pop()
        length, width, axis = extent(part)
        small = part.area < 1.4 * target or (part.area < 2.2 * target and rng.random() < 0.3)
        if small or length < 3 * NARROWEST_ROOM_M:
            rooms.append(part)
            continue
        across = axis if rng.random() < 0.12 and width > 4 else turn_left(axis)
        point = _point_across(part, turn_left(across), rng)
        if rng.random() < oblique:
            angle = rng.normal(0, 0.35)
            across = np.cos(angle) * across + np.sin(angle) * turn_left(across)
        parts = cut(part, point, across, rng.choice(thicknesses))
        parts = [p for p in parts if extent(p)[1] > NARROWEST_ROOM_M]
        if len(parts) < 2:
            rooms.append(part)
        else:
            waiting += [(p, wanted()) for p in parts]
    return rooms


def _merge(rooms: list[Polygon], share: float, rng: Generator) -> list[Polygon]:
    """Take out walls between neighbours, in part or whole, which gives L, T and U shapes."""
    for _ in range(int(np.ceil(share * len(rooms)))):
        segments, normals, owners = all_edges(rooms)
        gaps = wall_gaps(segments, normals)
        one, two = owners[gaps.one], owners[gaps.two]
        possible = np.flatnonzero((one != two) & (gaps.lengths > SHORTEST_MERGE_M))
        if not len(possible):
            break
        chosen = int(rng.choice(possible))
        part = rng.uniform(0.5, 1) if rng.random() < 0.5 else 1.0
        stretch = gaps.stretch(chosen, part, rng.random())
        opening = gaps.body(chosen, stretch, -INTO_ROOM_M, gaps.thicknesses[chosen] + INTO_ROOM_M)
        pair = {int(one[chosen]), int(two[chosen])}
        union = shapely.union_all([opening, *(rooms[k] for k in pair)])
        joined = clean(union) if isinstance(union, Polygon) else None
        if joined is not None:
            rooms = [room for k, room in enumerate(rooms) if k not in pair] + [joined]
    return rooms


def _shape_rooms(rooms: list[Polygon], rng: Generator, config: PlanConfig) -> list[Polygon]:
    """Give rooms their details: cut corners, niches and pilasters, crooked walls."""
    chamfered, niches = rng.choice(config.chamfered_share), rng.choice(config.niche_share)
    crooked = rng.choice(config.crooked_m)
    shaped = []
    for plain in rooms:
        room = plain
        if rng.random() < chamfered:
            room = chamfer(room, rng, 0.6)
        if rng.random() < niches:
            room = _add_pilasters(room, rng)
        tidy = clean(room)
        if tidy is not None:
            shaped.append(crook(tidy, rng, crooked) if crooked else tidy)
    return shaped


def _add_pilasters(room: Polygon, rng: Generator) -> Polygon:
    """Let one to three blocks (pilasters, shafts, built-in cupboards) stand into a room."""
    segments, normals = edges(room)
    for _ in range(rng.integers(1, 4)):
        k = rng.integers(len(segments))
        start, along = segments[k, 0], segments[k, 1] - segments[k, 0]
        length = np.linalg.norm(along)
        if length < 1.2:
            continue
        along /= length
        width, depth = rng.uniform(0.25, min(1.5, 0.4 * float(length))), rng.uniform(0.15, 0.6)
        where = rng.choice([0, length - width, rng.uniform(0, length - width)])
        middle = start + along * (where + width / 2) + normals[k] * (depth / 2 - 0.01)
        smaller = room.difference(rectangle(middle, along, width, depth + 0.02))
        if isinstance(smaller, Polygon) and smaller.area > 0.6 * room.area:
            room = smaller
    return room
