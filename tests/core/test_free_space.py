"""Free Space finds what it was described to find: rooms of four surfaces, corridors of two."""

from __future__ import annotations

import numpy as np
from plans import Point, block, plan, turned

from sgraph_concepts.types import ConceptNode, FloatArray
from sgraph_core.evaluation.slam.free_space import free_outlines, free_space_rooms
from sgraph_core.frontend.lidar import Lidar, Panels, cast
from sgraph_core.frontend.surfaces import horizontal_scan
from sgraph_core.graph import SGraph

SCANNER = Lidar(elevations_deg=(1.0,), sigma_m=0.0, range_m=30.0)


def scan_of(graph: SGraph, position: Point) -> FloatArray:
    segments = graph.wall_surfaces.ordered().segments
    panels = Panels(segments[:, ::-1], np.tile([0.0, 3.0], (len(segments), 1)), 3.0)
    return horizontal_scan(cast(SCANNER, panels, np.array([*position, 0.0])))


def seen_from(graph: SGraph, *positions: Point) -> list[ConceptNode]:
    """Return the rooms that Free Space finds when a robot stood at the positions."""
    for number, (x, y) in enumerate(positions):
        graph.add_keyframe(number, [x, y, 0, 0, 0, 0, 1])
    scans = [scan_of(graph, position) for position in positions]
    return free_space_rooms(graph, free_outlines(scans))


def members_of(rooms: list[ConceptNode]) -> set[tuple[int, ...]]:
    return {room.members for room in rooms}


def two_rooms_with_a_door(angle_rad: float = 0.0) -> SGraph:
    """Rooms of 5 x 4 m; between them a wall of 0.2 m with a door of 0.9 m."""
    graph = SGraph("two rooms")
    rows = [
        ([(0, 0), (5, 0)], (0, 1)),
        ([(5, 0), (5, 1.5)], (-1, 0)),
        ([(5, 2.4), (5, 4)], (-1, 0)),
        ([(5, 4), (0, 4)], (0, -1)),
        ([(0, 4), (0, 0)], (1, 0)),
        ([(5.2, 0), (10, 0)], (0, 1)),
        ([(10, 0), (10, 4)], (-1, 0)),
        ([(10, 4), (5.2, 4)], (0, -1)),
        ([(5.2, 2.4), (5.2, 4)], (1, 0)),
        ([(5.2, 0), (5.2, 1.5)], (1, 0)),
        ([(5, 1.5), (5.2, 1.5)], (0, 1)),
        ([(5, 2.4), (5.2, 2.4)], (0, -1)),
    ]
    for number, (segment, normal) in enumerate(rows):
        graph.add_wall_surface(number, turned(segment, angle_rad), turned([normal], angle_rad)[0])
    return graph


PLACES = [(2.0, 2.0), (5.1, 2.0), (8.0, 2.0)]


def test_a_door_cuts_the_free_space_into_two_rooms() -> None:
    rooms = members_of(seen_from(two_rooms_with_a_door(), *PLACES))
    assert len(rooms) == 2
    (left,) = [room for room in rooms if 4 in room]
    (right,) = [room for room in rooms if 6 in room]
    assert {0, 3, 4} < set(left) <= {0, 1, 2, 3, 4}
    assert {5, 6, 7} < set(right) <= {5, 6, 7, 8, 9}


def test_turning_the_map_changes_no_room() -> None:
    rooms = seen_from(two_rooms_with_a_door(), *PLACES)
    turned_rooms = seen_from(two_rooms_with_a_door(0.4), *turned(PLACES, 0.4))
    assert members_of(turned_rooms) == members_of(rooms)


def test_two_opposed_surfaces_make_a_corridor() -> None:
    graph = SGraph("corridor")
    graph.add_wall_surface(7, [(0, 0), (12, 0)], (0, 1))
    graph.add_wall_surface(3, [(0, 2), (12, 2)], (0, -1))
    (corridor,) = seen_from(graph, (3, 1), (9, 1))
    assert corridor.members == (3, 7)
    assert corridor.shape.centre is not None
    assert 3 < corridor.shape.centre[0] < 9
    np.testing.assert_allclose(corridor.shape.centre[1], 1, atol=0.05)


def test_a_room_that_the_robot_never_saw_is_not_found() -> None:
    assert members_of(seen_from(block(0.15), (2, 2))) == {(0, 1, 2, 3)}


def test_an_l_shaped_room_gets_four_of_its_six_surfaces() -> None:
    outline = [(0, 0), (8, 0), (8, 3), (4, 3), (4, 7), (0, 7)]
    (room,) = seen_from(plan(outline), (2, 2))
    assert len(room.members) == 4


def test_no_keyframes_no_surfaces_or_no_opposed_ones_give_no_rooms() -> None:
    assert free_space_rooms(SGraph(), []) == []
    assert seen_from(block(0.15)) == []
    graph = SGraph("corner")
    graph.add_wall_surface(0, [(0, 0), (4, 0)], (0, 1))
    graph.add_wall_surface(1, [(0, 0), (0, 4)], (1, 0))
    assert seen_from(graph, (2, 2)) == []


def test_a_scanner_of_half_a_turn_sees_what_is_in_front() -> None:
    graph = plan([(0, 0), (6, 0), (6, 4), (0, 4)])
    graph.add_keyframe(0, [3, 2, 0, 0, 0, 0, 1])
    scan = scan_of(graph, (3, 2))
    (room,) = free_space_rooms(graph, free_outlines([scan[scan[:, 0] > 0]]))
    assert room.shape.centre is not None
    assert room.shape.centre[0] > 3.5
