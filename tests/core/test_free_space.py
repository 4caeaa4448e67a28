"""Free Space finds what it was described to find: rooms of four surfaces, corridors of two."""

from __future__ import annotations

import numpy as np
from plans import Point, block, plan, rectangle, turned

from sgraph_core.evaluation.slam.free_space import free_space_rooms
from sgraph_core.graph import SGraph


def with_keyframes(graph: SGraph, *positions: Point, angle_rad: float = 0.0) -> SGraph:
    for number, (x, y) in enumerate(turned(positions, angle_rad)):
        graph.add_keyframe(number, [x, y, 0, 0, 0, 0, 1])
    return graph


def rooms_of(graph: SGraph) -> set[tuple[int, ...]]:
    return {node.members for node in free_space_rooms(graph)}


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
    ]
    for number, (segment, normal) in enumerate(rows):
        graph.add_wall_surface(number, turned(segment, angle_rad), turned([normal], angle_rad)[0])
    return with_keyframes(graph, (2, 2), (5.1, 2), (8, 2), angle_rad=angle_rad)


def test_a_door_cuts_the_free_space_into_two_rooms() -> None:
    rooms = rooms_of(two_rooms_with_a_door())
    assert len(rooms) == 2
    (left,) = [room for room in rooms if 4 in room]
    (right,) = [room for room in rooms if 6 in room]
    assert {0, 3, 4} < set(left) <= {0, 1, 2, 3, 4}
    assert {5, 6, 7} < set(right) <= {5, 6, 7, 8, 9}


def test_turning_the_map_changes_no_room() -> None:
    assert rooms_of(two_rooms_with_a_door(0.4)) == rooms_of(two_rooms_with_a_door())


def test_two_opposed_surfaces_make_a_corridor() -> None:
    graph = SGraph("corridor")
    graph.add_wall_surface(7, [(0, 0), (12, 0)], (0, 1))
    graph.add_wall_surface(3, [(0, 2), (12, 2)], (0, -1))
    (corridor,) = free_space_rooms(with_keyframes(graph, (3, 1), (9, 1)))
    assert corridor.members == (3, 7)
    assert corridor.shape.centre is not None
    np.testing.assert_allclose(corridor.shape.centre, (6, 1), atol=0.1)


def test_a_room_that_the_robot_never_saw_is_not_found() -> None:
    assert rooms_of(with_keyframes(block(0.15), (2, 2))) == {(0, 1, 2, 3)}


def test_an_l_shaped_room_gets_four_of_its_six_surfaces() -> None:
    outline = [(0, 0), (8, 0), (8, 3), (4, 3), (4, 7), (0, 7)]
    (room,) = rooms_of(with_keyframes(plan(outline), (2, 2)))
    assert len(room) == 4


def test_no_keyframes_no_surfaces_or_no_opposed_ones_give_no_rooms() -> None:
    assert free_space_rooms(SGraph()) == []
    assert free_space_rooms(plan(rectangle(0, 0, 4, 4))) == []
    graph = SGraph("corner")
    graph.add_wall_surface(0, [(0, 0), (4, 0)], (0, 1))
    graph.add_wall_surface(1, [(0, 0), (0, 4)], (1, 0))
    assert free_space_rooms(with_keyframes(graph, (2, 2))) == []
