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
    openings,
)
from sgraph_core.synth.double_walls import DoubleWall
from sgraph_core.synth.pieces import IN_CAVITY, NO_ROOM, Pieces
from sgraph_core.synth.plan import Plan
from sgraph_core.synth.polygons import all_edges, grow, polygons_in
from sgraph_core.synth.walls import wall_gaps

__all__ = ["Floor", "draw_surfaces"]

LEAF_AT_DOOR_M = 0.05
"""Cavities end this far from the openings of doors."""


@dataclass(frozen=True, eq=False)
class Floor:
    """A floor as it was built.

    Attributes:
        rooms: each room's free space; columns and partitions are holes.
        pieces: its surfaces that may be mapped, as far as cutouts leave them.
        passages: pairs of rooms that doors and open borders join, [D, 2].
        doorways: the middles of the passages, [D, 2].
        outlines: of the building.
        shell: the sides of its walls, facades included, as far as doors and windows leave them.
        leaves: faces of open door leaves.
        furniture: boxes that stand in the rooms.
        doors: the openings through wall bodies that one can pass, [O, 4, 2]; the first edge of each
            lies on one side of the wall, the third on the other.
        windows: likewise those of windows; the first edge lies on a room's side.
        panes: the windows' glass, as parts of the rooms' sides.
    """

    rooms: list[Polygon]
    pieces: Pieces
    passages: IntArray
    doorways: FloatArray
    outlines: list[Polygon]
    shell: Pieces
    leaves: Pieces
    furniture: list[Polygon]
    doors: FloatArray
    windows: FloatArray
    panes: Pieces


def draw_surfaces(plan: Plan, rng: Generator, config: FittingConfig) -> Floor:
    """Build a plan: cut doors and windows, and put clutter into it."""
    bodies = [wall.body for wall in plan.double_walls]
    outlines = _outlines([*plan.rooms, *bodies], rng.uniform(*config.facade_thickness_m))
    walls = Pieces.joined(_sides(plan.rooms), _facades(outlines))
    facade_mapped = rng.random() < config.facade_share
    gaps = wall_gaps(walls.segments, walls.normals)
    outer = walls.facades[gaps.one] != walls.facades[gaps.two]
    windows = draw_windows(gaps.take(outer), rng, config)
    if not facade_mapped:
        gaps = gaps.take(~outer)
    doors = draw_doors(gaps, walls, plan.cubicles, rng, config)
    passable = openings(doors, walls)
    borders = border_cutouts(walls, plan.open_borders)
    behind = junctions_behind(gaps, len(walls), rng, rng.choice(config.broken_behind_share))
    broken = cut(walls, [*doors, *windows, *borders, *behind])
    leaves = door_leaves(doors, rng, rng.choice(config.door_leaf_share))
    faces, boxes = furniture(plan.rooms, rng, rng.choice(config.furnished_share), config)
    mapped = broken if facade_mapped else broken.take(~broken.facades)
    # a stream of its own, as in the plan
    if plan.double_walls and rng.spawn(1)[0].random() < config.cavity_share:
        mapped = Pieces.joined(mapped, _cavities(plan.double_walls, passable))
    passages, doorways = _passages([*doors, *borders], walls)
    return Floor(
        rooms=plan.rooms,
        pieces=Pieces.joined(mapped, leaves, faces),
        passages=passages,
        doorways=doorways,
        outlines=outlines,
        shell=cut(walls, [*doors, *windows, *borders]),
        leaves=leaves,
        furniture=boxes,
        doors=passable,
        windows=openings(windows, walls),
        panes=walls.parts(
            [window.rows[0] for window in windows], [[w.start, w.end] for w in windows]
        ),
    )


def _sides(rooms: list[Polygon]) -> Pieces:
    segments, normals, owners = all_edges(rooms)
    return Pieces(segments, normals, owners, np.ones(len(owners), bool))


def _outlines(inside: list[Polygon], thickness_m: float) -> list[Polygon]:
    """Return the outlines of the building: what is inside of it grown by the outer walls."""
    grown = shapely.union_all([grow(part, thickness_m) for part in inside])
    return [_simple(body) for body in polygons_in(grow(grow(grown, 0.2), -0.2))]


def _facades(outlines: list[Polygon]) -> Pieces:
    """Return the outer faces of the building."""
    segments, inwards, _ = all_edges(outlines)
    count = len(segments)
    return Pieces(segments, -inwards, np.full(count, NO_ROOM), np.ones(count, bool))


def _cavities(walls: list[DoubleWall], doors: FloatArray) -> Pieces:
    """Return the faces of the cavities of double walls, which end before doors."""
    frames = shapely.union_all([grow(Polygon(corners), LEAF_AT_DOOR_M) for corners in doors])
    hollows = [part for wall in walls for part in polygons_in(wall.cavity.difference(frames))]
    segments, normals, _ = all_edges(hollows)
    count = len(segments)
    return Pieces(segments, normals, np.full(count, IN_CAVITY), np.ones(count, bool))


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
