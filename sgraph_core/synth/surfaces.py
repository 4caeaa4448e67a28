"""From a plan to its surfaces: rooms' sides and facades with their cutouts, and clutter."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.random import Generator
from shapely import Polygon

from sgraph_concepts.types import FloatArray, IntArray
from sgraph_core.synth.clutter import door_leaves, furniture
from sgraph_core.synth.config import FittingConfig
from sgraph_core.synth.cutouts import (
    Cutout,
    border_cutouts,
    cut,
    draw_doors,
    draw_windows,
    junctions_behind,
)
from sgraph_core.synth.pieces import NO_ROOM, Pieces
from sgraph_core.synth.plan import Plan
from sgraph_core.synth.polygons import all_edges, edges, grow, polygons_in
from sgraph_core.synth.walls import wall_gaps

__all__ = ["Floor", "draw_surfaces"]


@dataclass(frozen=True, eq=False)
class Floor:
    """A floor as it was built.

    Attributes:
        rooms: each room's free space; columns and partitions are holes.
        pieces: its surfaces, as far as cutouts leave them.
        passages: pairs of rooms that doors and open borders join, [D, 2].
        doorways: the middles of the passages, [D, 2].
    """

    rooms: list[Polygon]
    pieces: Pieces
    passages: IntArray
    doorways: FloatArray


def draw_surfaces(plan: Plan, rng: Generator, config: FittingConfig) -> Floor:
    """Build a plan: cut doors and windows, and put clutter into it."""
    walls = Pieces.joined(
        _sides(plan.rooms), _facades(plan.rooms, rng.uniform(*config.facade_thickness_m))
    )
    facade_mapped = rng.random() < config.facade_share
    gaps = wall_gaps(walls.segments, walls.normals)
    outer = walls.facades[gaps.one] != walls.facades[gaps.two]
    windows = draw_windows(gaps.take(outer), rng, config)
    if not facade_mapped:
        gaps = gaps.take(~outer)
    doors = draw_doors(gaps, walls, rng, config)
    borders = border_cutouts(walls, plan.open_borders)
    behind = junctions_behind(gaps, len(walls), rng, rng.choice(config.broken_behind_share))
    shell = cut(walls, [*doors, *windows, *borders, *behind])
    pieces = Pieces.joined(
        shell if facade_mapped else shell.take(~shell.facades),
        door_leaves(doors, rng, rng.choice(config.door_leaf_share)),
        furniture(plan.rooms, rng, rng.choice(config.furnished_share), config),
    )
    return Floor(plan.rooms, pieces, *_passages([*doors, *borders], walls))


def _sides(rooms: list[Polygon]) -> Pieces:
    segments, normals, owners = all_edges(rooms)
    return Pieces(segments, normals, owners, np.ones(len(owners), bool))


def _facades(rooms: list[Polygon], thickness_m: float) -> Pieces:
    """Return the outer faces of the building: its rooms grown by the outer walls."""
    grown = shapely.union_all([grow(room, thickness_m) for room in rooms])
    closed = grow(grow(grown, 0.2), -0.2)
    faces = [edges(_simple(body)) for body in polygons_in(closed)]
    segments = np.concatenate([segments for segments, _ in faces])
    normals = np.concatenate([normals for _, normals in faces])
    count = len(segments)
    return Pieces(segments, -normals, np.full(count, NO_ROOM), np.ones(count, bool))


def _simple(body: Polygon) -> Polygon:
    """Return the outer outline of a body without its smallest bends."""
    outline = body.exterior.simplify(0.02)
    return Polygon(outline.coords)


def _passages(cutouts: list[Cutout], walls: Pieces) -> tuple[IntArray, FloatArray]:
    """Return which rooms cutouts join, and the cutouts' middles; those to outside join none."""
    inside = [c for c in cutouts if (walls.rooms[list(c.rows)] != NO_ROOM).all()]
    rooms = [walls.rooms[list(cutout.rows)] for cutout in inside]
    middles = [(cutout.start + cutout.end) / 2 for cutout in inside]
    return np.array(rooms, np.int64).reshape(-1, 2), np.array(middles).reshape(-1, 2)
