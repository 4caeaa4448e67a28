"""A synthetic building: its map, and its truth for every labeller."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.random import Generator
from numpy.typing import NDArray
from shapely import Polygon

from sgraph_concepts.errors import InputError
from sgraph_concepts.types import BuildingTruth, FloatArray, IntArray, SurfaceArrays
from sgraph_core.geometry import Geometries, lines_of, points_of, turn_left
from sgraph_core.graph import SGraph, TrueRoom, Truth
from sgraph_core.synth.config import BuildingConfig, ViewConfig
from sgraph_core.synth.drift import Drift
from sgraph_core.synth.pieces import IN_CAVITY, NO_ROOM, SHORTEST_PIECE_M, Pieces
from sgraph_core.synth.placement import Placement
from sgraph_core.synth.plan import draw_plan
from sgraph_core.synth.surfaces import draw_surfaces
from sgraph_core.synth.view import add_noise, draw_view, join_through
from sgraph_core.synth.walls import WallGaps, wall_gaps

__all__ = ["Building", "draw_building"]

FEWEST_SURFACES = 3
MOST_ATTEMPTS = 50


@dataclass(frozen=True, eq=False)
class Building:
    """A mapped floor with its truth.

    Attributes:
        segments, normals: the N mapped surfaces, [N, 2, 2] and [N, 2].
        pieces: the pieces that the surfaces consist of: one, or several rooms' pieces that were
            mapped as one surface.
        owners: the surface of each piece, [P].
        polygons: outline of each room's free space, [K_r, 2] each.
        walls: pairs of surfaces that are the two sides of one wall, first below second, [W, 2].
    """

    segments: FloatArray
    normals: FloatArray
    pieces: Pieces
    owners: IntArray
    polygons: list[FloatArray]
    walls: IntArray

    def graph(self, name: str) -> SGraph:
        """Return the map as an S-Graph that carries its truth."""
        graph = SGraph(name)
        ids = np.arange(len(self.segments))
        unknown = np.full((len(ids), 2), np.nan)
        graph.extend_wall_surfaces(ids, self.segments, self.normals, unknown)
        rooms = []
        for number, polygon in enumerate(self.polygons):
            members = np.unique(self.owners[self.pieces.rooms == number])
            if len(members):
                outline = tuple((float(x), float(y)) for x, y in polygon)
                rooms.append(TrueRoom(number, None, tuple(members.tolist()), outline))
        graph.truth = Truth(tuple(rooms), tuple((int(a), int(b)) for a, b in self.walls))
        return graph

    def truth(self, fragments: SurfaceArrays) -> BuildingTruth:
        """Return the truth of the building's surfaces after preprocessing.

        A fragment belongs to the room of the piece of its parent that is closest to its midpoint.
        """
        piece_lines = lines_of(self.pieces.segments)
        middles = points_of(fragments.midpoints)
        rooms = np.full(len(fragments), NO_ROOM)
        for row, parent in enumerate(fragments.ids):
            own = np.flatnonzero(self.owners == parent)
            nearest = own[np.argmin(shapely.distance(piece_lines[own], middles[row]))]
            rooms[row] = max(self.pieces.rooms[nearest], NO_ROOM)
        rows_of: dict[int, list[int]] = {}
        for row, parent in enumerate(fragments.ids.tolist()):
            rows_of.setdefault(parent, []).append(row)
        walls = [
            sorted((a, b))
            for one, two in self.walls.tolist()
            for a in rows_of.get(one, [])
            for b in rows_of.get(two, [])
        ]
        pairs = np.array(walls, np.int64).reshape(-1, 2)
        return BuildingTruth(fragments, rooms, self.polygons, pairs)


def draw_building(rng: Generator, config: BuildingConfig) -> Building:
    """Draw a building of at least three mapped surfaces.

    Raises:
        InputError: the configuration practically never yields one.
    """
    for _ in range(MOST_ATTEMPTS):
        plan = draw_plan(rng, config.plan)
        if plan is None:
            continue
        pieces = draw_view(draw_surfaces(plan, rng, config.fittings), rng, config.view)
        if len(pieces) >= FEWEST_SURFACES:
            building = _map(pieces, plan.rooms, rng, config.view)
            if len(building.segments) >= FEWEST_SURFACES:
                return building
    raise InputError(f"no building came out of {MOST_ATTEMPTS} attempts: check the configuration")


def _map(pieces: Pieces, rooms: list[Polygon], rng: Generator, config: ViewConfig) -> Building:
    """Turn pieces into mapped surfaces, drifted and noisy, in a random place and order."""
    placement = Placement.draw(rng)
    polygons = [shapely.get_coordinates(room.exterior)[:-1] for room in rooms]
    gaps = wall_gaps(pieces.segments, pieces.normals)
    solid = pieces.structural[gaps.one] & pieces.structural[gaps.two] & ~_hollow(gaps, pieces)
    sides = np.stack([gaps.one, gaps.two], axis=1)[solid]
    if rng.random() < config.drifted_share:
        drift = Drift.draw(rooms, rng, config)
        pieces = drift.drifted(pieces, rooms)
        polygons = [drift.drifted_outline(p, room) for room, p in enumerate(polygons)]
    owners = join_through(pieces, rng, rng.choice(config.through_share))
    segments, normals = _whole_surfaces(pieces, owners)
    noisy, kept = add_noise(segments, rng, rng.choice(config.noise_m))

    number = np.full(len(kept), -1)
    number[kept] = rng.permutation(int(kept.sum()))
    order = np.argsort(number[kept])
    piece_kept = kept[owners]
    walls = number[owners[sides]]
    walls = np.unique(np.sort(walls[(walls >= 0).all(axis=1)], axis=1), axis=0)
    placed = placement.points(noisy[kept][order])
    swap = rng.random(len(placed)) < 0.5
    placed[swap] = placed[swap][:, ::-1]
    local = pieces.take(piece_kept)
    return Building(
        segments=placed,
        normals=_exact_normals(placed, placement.directions(normals[kept][order])),
        pieces=Pieces(
            placement.points(local.segments),
            placement.directions(local.normals),
            local.rooms,
            local.structural,
        ),
        owners=number[owners[piece_kept]],
        polygons=[placement.points(polygon) for polygon in polygons],
        walls=walls[walls[:, 0] < walls[:, 1]],
    )


def _hollow(gaps: WallGaps, pieces: Pieces) -> NDArray[np.bool_]:
    """Return between which surfaces the side of a cavity is mapped: they are two walls, [G]."""
    in_cavity = pieces.rooms == IN_CAVITY
    far = gaps.thicknesses[:, None] * gaps.inwards
    corners = np.stack([gaps.starts, gaps.ends, gaps.ends + far, gaps.starts + far], axis=1)
    bodies: Geometries = np.asarray(shapely.polygons(corners))
    cavities = lines_of(pieces.segments[in_cavity])
    body, side = shapely.STRtree(cavities).query(bodies, predicate="intersects")
    inside = shapely.length(shapely.intersection(bodies[body], cavities[side])) > SHORTEST_PIECE_M
    hollow = np.zeros(len(gaps), bool)
    hollow[body[inside]] = True
    return np.asarray(hollow & ~in_cavity[gaps.one] & ~in_cavity[gaps.two])


def _whole_surfaces(pieces: Pieces, owners: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return the surfaces that pieces make up: from the first end to the last along the normal."""
    count = int(owners.max()) + 1
    segments, normals = np.empty((count, 2, 2)), np.empty((count, 2))
    for surface in range(count):
        own = np.flatnonzero(owners == surface)
        normal = pieces.normals[own[0]]
        points = pieces.segments[own].reshape(-1, 2)
        reach = points @ turn_left(normal)
        segments[surface] = points[[np.argmin(reach), np.argmax(reach)]]
        normals[surface] = normal
    return segments, normals


def _exact_normals(segments: FloatArray, rough: FloatArray) -> FloatArray:
    along = segments[:, 1] - segments[:, 0]
    normals = turn_left(along / np.linalg.norm(along, axis=1)[:, None])
    return np.where((normals * rough).sum(axis=1)[:, None] < 0, -normals, normals)
