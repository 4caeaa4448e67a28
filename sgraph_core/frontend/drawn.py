"""Floors drawn at random, to drive through."""

from __future__ import annotations

import networkx as nx
import numpy as np
from shapely import Polygon

from sgraph_concepts.errors import InputError
from sgraph_core.frontend.building import Door, Floor, Point
from sgraph_core.frontend.route import reachable
from sgraph_core.synth.config import PlanConfig
from sgraph_core.synth.plan import draw_plan
from sgraph_core.synth.polygons import all_edges
from sgraph_core.synth.walls import wall_gaps

__all__ = ["draw_floor"]

PLAN = PlanConfig()
SHORTEST_WALL_M = 1.2
"""With a door in it."""
MOST_ATTEMPTS = 20


def draw_floor(seed: int, config: PlanConfig = PLAN) -> Floor:
    """Draw a floor of the synthetic plans' distribution, with doors, and a tour of its rooms.

    Neighbouring rooms are joined by a door in the middle of their longest common wall. Rooms
    that no door leads to are left out, and so is what stands free in rooms; floors with a room
    around others, or where the robot cannot reach all rooms, are not drawn. The tour passes the
    doors of a tree depth first, and so returns to where it began.

    Raises:
        InputError: the configuration practically never yields two neighbouring rooms.
    """
    rng = np.random.default_rng(seed)
    shares = ("column", "partition", "open_plan", "double_wall", "cubicle")
    bare = config.model_copy(update={f"{name}_share": (0.0,) for name in shares})
    for _ in range(MOST_ATTEMPTS):
        plan = draw_plan(rng, bare)
        if plan is None or any(room.interiors for room in plan.rooms):
            continue
        doors = _doors(plan.rooms)
        if doors:
            floor = _floor(f"drawn-{seed}", plan.rooms, doors)
            if reachable(floor.free, floor.stops()):
                return floor
    raise InputError(f"no floor came out of {MOST_ATTEMPTS} attempts: check the configuration")


def _doors(rooms: list[Polygon]) -> dict[tuple[int, int], Point]:
    """Return where rooms are joined: in the middle of the longest wall between two of them."""
    segments, normals, owners = all_edges(rooms)
    gaps = wall_gaps(segments, normals)
    doors = {}
    for row in np.argsort(gaps.lengths, kind="stable").tolist():
        pair = sorted((int(owners[gaps.one[row]]), int(owners[gaps.two[row]])))
        if pair[0] != pair[1] and gaps.lengths[row] >= SHORTEST_WALL_M:
            through = gaps.thicknesses[row] * gaps.inwards[row]
            middle = (gaps.starts[row] + gaps.ends[row] + through) / 2
            doors[pair[0], pair[1]] = (float(middle[0]), float(middle[1]))
    return doors


def _floor(name: str, rooms: list[Polygon], doors: dict[tuple[int, int], Point]) -> Floor:
    links: nx.Graph[int] = nx.Graph(list(doors))
    joined = max(nx.connected_components(links), key=lambda part: (len(part), -min(part)))
    way = [
        two if kind == "forward" else one
        for one, two, kind in nx.dfs_labeled_edges(links, min(joined))
        if kind != "nontree"
    ]
    return Floor(
        name=name,
        rooms={f"room {k}": _corners(rooms[k]) for k in sorted(joined)},
        doors=tuple(
            Door(f"room {one}", f"room {two}", at)
            for (one, two), at in doors.items()
            if one in joined
        ),
        tour=tuple(f"room {k}" for k in way[:-1]),
    )


def _corners(room: Polygon) -> tuple[Point, ...]:
    return tuple((float(x), float(y)) for x, y in room.exterior.coords[:-1])
