"""Openings in a border: doors, unseen corners, open sides."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from plans import L_SHAPE, Point, plan, rectangle, regular, turned

from sgraph_concepts.types import ConceptNode
from sgraph_core import map_file
from sgraph_core.detector import Detector
from sgraph_core.graph import SGraph
from sgraph_core.openings import Opening, openings, surfaces_along

ROOM = rectangle(0, 0, 5, 4)
Side = list[tuple[Point, Point]]
"""The pieces of one side of a room."""
SOUTH_WITH_A_DOOR: Side = [((0, 0), (1, 0)), ((1.9, 0), (5, 0))]


def room_with(south: Side, east: Side | None = None) -> SGraph:
    """Return a room of 5 x 4 m whose south and east sides are given."""
    graph = SGraph()
    sides = [*south, *(east or [((5, 0), (5, 4))]), ((5, 4), (0, 4)), ((0, 4), (0, 0))]
    for number, (start, end) in enumerate(sides):
        along = np.subtract(end, start) / np.linalg.norm(np.subtract(end, start))
        graph.add_wall_surface(number, [start, end], [-along[1], along[0]])
    return graph


def found(graph: SGraph, corners: list[Point] = ROOM) -> list[Opening]:
    return openings(shapely.Polygon(corners), graph.wall_surfaces.ordered())


def ends(opening: Opening) -> list[tuple[Point, Point]]:
    return [tuple(sorted(map(tuple, piece.tolist()))) for piece in opening.segments]


def test_a_closed_border_has_no_openings() -> None:
    assert found(plan(ROOM)) == []
    assert found(plan(L_SHAPE), L_SHAPE) == []


@pytest.mark.parametrize(
    ("south", "east", "kind", "pieces"),
    [
        (SOUTH_WITH_A_DOOR, None, "door", [((1, 0), (1.9, 0))]),
        ([((0, 0), (1, 0)), ((2.5, 0), (5, 0))], None, "open side", [((1, 0), (2.5, 0))]),
        ([((0, 0), (4, 0))], None, "corner", [((4, 0), (5, 0))]),
        ([((0, 0), (3, 0))], None, "open side", [((3, 0), (5, 0))]),
        ([], None, "open side", [((0, 0), (5, 0))]),
        (
            [((0, 0), (4.2, 0))],
            [((5, 0.8), (5, 4))],
            "corner",
            [((5, 0), (5, 0.8)), ((4.2, 0), (5, 0))],
        ),
    ],
    ids=["door", "wide opening", "corner", "half a side", "a side", "both sides of a corner"],
)
def test_an_opening_is_named_and_found_where_it_is(
    south: Side, east: Side | None, kind: str, pieces: list[tuple[Point, Point]]
) -> None:
    (opening,) = found(room_with(south, east))
    assert opening.kind == kind
    assert ends(opening) == [pytest.approx(np.array(piece)) for piece in pieces]


def test_surfaces_that_end_just_before_a_corner_leave_no_opening() -> None:
    assert found(room_with([((0.1, 0), (4.9, 0))])) == []


def test_a_surface_that_faces_away_covers_nothing() -> None:
    graph = room_with([])
    graph.add_wall_surface(9, [[0, 0], [5, 0]], [0, -1])
    (opening,) = found(graph)
    assert opening.lengths_m == pytest.approx([5])


def test_what_lies_along_an_opening_is_found() -> None:
    graph = room_with([])
    (opening,) = found(graph)
    graph.add_wall_surface(20, [[1, 0.1], [4, 0.1]], [0, 1])
    graph.add_wall_surface(21, [[1, -0.5], [4, -0.5]], [0, -1])
    graph.add_wall_surface(22, [[1, -1.5], [4, -1.5]], [0, -1])  # too far for a wall
    graph.add_wall_surface(23, [[2, -1], [2, 0]], [1, 0])  # across
    facing, behind = surfaces_along(opening, graph.wall_surfaces.ordered())
    ids = graph.wall_surfaces.ids
    assert ids[facing].tolist() == [20]
    assert ids[behind].tolist() == [21]


@given(
    st.integers(3, 9),
    st.sets(st.integers(0, 8)),
    st.integers(0, 8),
    st.floats(0, 2 * np.pi),
)
def test_openings_are_the_missing_edges_wherever_the_ring_begins(
    sides: int, missing: set[int], first: int, angle: float
) -> None:
    corners = turned(regular(sides, 4), angle)
    missing = {edge for edge in missing if edge < sides}
    arrays = plan(corners).wall_surfaces.ordered()
    border = shapely.Polygon(np.roll(np.array(corners), first, axis=0))
    kept = arrays.take(~np.isin(arrays.ids, list(missing)))
    result = openings(border, kept)
    assert {opening.kind for opening in result} <= {"open side"}
    lengths = [length for opening in result for length in opening.lengths_m]
    edge = 8 * np.sin(np.pi / sides)
    assert sorted(lengths) == pytest.approx([edge] * len(missing))


# -- on the room node ------------------------------------------------------------------------------


@pytest.mark.parametrize("angle", [0.0, 0.7])
@pytest.mark.parametrize("offset", [(0.0, 0.0), (5e5, 5.4e6)])
def test_a_missing_wall_is_an_open_side_of_the_room_in_the_world(
    angle: float, offset: Point, baseline: Detector, tmp_path: Path
) -> None:
    whole = plan(ROOM, angle_rad=angle, offset=offset)
    graph, table = SGraph(), whole.wall_surfaces
    for row in (0, 2, 3):  # the east side is missing
        graph.add_wall_surface(row, table.segments[row], table.normals[row])
    result = baseline.infer(graph)
    (room,) = result.concepts["room"]
    assert room.shape.attributes["open_m"] == 4.0
    (side,) = room.shape.attributes["open_sides"]
    assert sorted(side) == [pytest.approx(p, abs=1e-5) for p in sorted(table.segments[1].tolist())]

    map_file.save(result, tmp_path / "rooms.json")
    loaded = map_file.load(tmp_path / "rooms.json")
    assert loaded.concepts["room"] == [room]
    assert baseline.infer(loaded).concepts["room"] == [room]


def test_a_doorway_is_no_open_side_of_the_room(baseline: Detector) -> None:
    (room,) = baseline.infer(room_with(SOUTH_WITH_A_DOOR)).concepts["room"]
    assert room.shape.attributes == {
        "area_m2": 20.0,
        "doorways": [],
        "open_sides": [],
        "open_m": 0.0,
    }


def test_a_room_that_a_map_holds_is_described_anew(baseline: Detector) -> None:
    graph = plan(ROOM)
    stale = baseline.infer(room_with([])).concepts["room"][0].shape
    graph.concepts = {"room": [ConceptNode(3, (0, 1, 2, 3), shape=stale)]}
    (room,) = baseline.infer(graph).concepts["room"]
    assert room.id == 3
    assert room.shape.attributes["open_m"] == 0.0
