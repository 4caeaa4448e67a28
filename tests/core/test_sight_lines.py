"""What keyframes saw through: lines of sight that a correction blocks, counted by hand."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from drive import row

from sgraph_concepts.types import FloatArray
from sgraph_core.backend.association import _Drive
from sgraph_core.backend.sight_lines import SightLines
from sgraph_core.backend.visits import AWAY
from sgraph_core.graph import SGraph

LATER = 2 * AWAY
"""Row of the first keyframe of the window."""
DRIFT = np.array([10.0, 0.0])
"""Where the window is mapped, relative to where it was."""
END = LATER + 2

Wall = tuple[tuple[float, float], tuple[float, float]]
"""Its ends, as the robot saw it from the origin, along x."""


def drive(
    older: Sequence[Wall],
    newer: Sequence[Wall],
    shared: Sequence[Wall] = (),
    pose: tuple[float, float, float] = (0, 0, 0),
    look_m: float | None = None,
    later: int = LATER,
) -> tuple[SightLines, FloatArray]:
    """Return the lines of sight of two visits to one place, and the window's centre.

    At the first keyframe the older walls are seen from the origin, in the window the newer ones
    from there again, but mapped with drift; what is shared, only from the window though it was
    known. Each is seen once, at its middle.

    Args:
        older: the walls of the first visit.
        newer: those of the second, relative to the robot.
        shared: those that the front end recognises, as mapped.
        pose: x, y, yaw of the map's frame in the world.
        look_m: where observations' points ``at`` lie, along x; by default at the robot.
        later: row of the window's first keyframe.
    """
    x, y, yaw = pose
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])

    def placed(points: FloatArray) -> FloatArray:
        return np.asarray(points @ turn.T + [x, y])

    graph = SGraph()
    for number in range(later + 2):
        at = DRIFT if number >= later else np.array([500.0 if number else 0.0, 0.0])
        graph.add_keyframe(number, row(np.array([*placed(at), yaw])))

    def see(surface: int, keyframe: int, distance: float) -> None:
        aside = (0, 0, 0) if look_m is None else (look_m, distance, 0)
        graph.observe(surface, keyframe, [0, -1, 0, distance], [0.01, 0.02], aside)

    def add(wall: Wall, shift: FloatArray) -> int:
        surface = len(graph.wall_surfaces.ids)
        graph.add_wall_surface(surface, placed(np.array(wall) + shift), turn @ [0.0, -1.0])
        return surface

    for wall in older:
        see(add(wall, np.zeros(2)), 0, wall[0][1])
    for wall in shared:
        known = add(wall, np.zeros(2))
        for keyframe in (0, later):
            see(known, keyframe, wall[0][1])
    for wall in newer:
        see(add(wall, DRIFT), later, wall[0][1])
    return SightLines(graph), placed(DRIFT)


def blocked(
    lines: tuple[SightLines, FloatArray], x: float, y: float = 0.0, turn: float = 0.0
) -> float:
    """Return which share a correction blocks of the lines of a drive that is not turned."""
    sights, centre = lines
    return sights.blocked(LATER, END, np.array([turn, x, y]), centre)


NEAR: Wall = ((-1, 3), (1, 3))
FAR: Wall = ((-1, 6), (1, 6))


def test_an_older_wall_in_front_of_what_the_window_saw_blocks_its_line() -> None:
    lines = drive([NEAR], [FAR])
    assert blocked(lines, -10) == 1.0  # of one: the older line ends before the newer wall
    assert blocked(lines, 0) == 0.0
    assert blocked(lines, -10 + 0.9) == 0.0  # past the end, which may be inexact
    assert blocked(lines, -10 + 0.7) == 1.0


def test_a_wall_of_the_window_in_front_of_what_was_seen_before_blocks_that_line() -> None:
    lines = drive([FAR], [NEAR])
    assert blocked(lines, -10) == 0.5  # the window's own line ends before the older wall
    assert blocked(lines, 0) == 0.0


def test_the_right_correction_blocks_nothing() -> None:
    room: list[Wall] = [NEAR, ((-6, 4), (-3, 4)), ((3, 4), (6, 4))]
    lines = drive(room, room)
    assert blocked(lines, -10) == 0.0
    assert blocked(lines, -10, 0.29) == blocked(lines, -10, -0.29) == 0.0  # nearly right
    assert blocked(lines, -10, -2.0) > 0.2


def test_a_correction_turns_about_the_centre() -> None:
    lines = drive([((4, 5), (6, 5))], [FAR])
    assert blocked(lines, -10, turn=-0.7) == 0.0
    assert blocked(lines, -10, turn=-1.0) == 1.0  # (0, 5.7) goes to (5.7, 5.7)


def test_what_the_window_recognised_neither_moves_nor_blocks() -> None:
    assert blocked(drive([], [FAR], shared=[NEAR]), -10) == 0.0
    # the window saw the shared wall from its drifted place: only the older line is there to block
    assert blocked(drive([], [((-1, 2), (1, 2))], shared=[NEAR]), -10) == pytest.approx(1 / 3)


def test_a_line_leads_to_the_point_that_was_seen() -> None:
    long: Wall = ((-20, 6), (20, 6))
    assert blocked(drive([NEAR], [long], look_m=0.0), -10) == 1.0
    assert blocked(drive([NEAR], [long], look_m=8.0), -10) == 0.0
    assert blocked(drive([NEAR], [FAR], look_m=50.0), -10) == 1.0  # the nearest point of it


@pytest.mark.parametrize("yaw", [0.4, np.pi / 2, -2.0])
def test_where_the_map_lies_does_not_matter(yaw: float) -> None:
    lines, centre = drive([FAR], [NEAR], pose=(4e5, -5e6, yaw))
    move = -10 * np.array([np.cos(yaw), np.sin(yaw)])
    assert lines.blocked(LATER, END, np.array([0.0, *move]), centre) == 0.5


def test_without_walls_nothing_is_blocked() -> None:
    assert blocked(drive([], []), 0) == 0.0


@pytest.mark.parametrize(("later", "known"), [(AWAY, False), (AWAY + 1, True)])
def test_only_what_was_mapped_long_before_may_be_in_the_way(later: int, known: bool) -> None:
    for older, newer in (([NEAR], [FAR]), ([FAR], [NEAR])):
        sights, centre = drive(older, newer, later=later)
        move = np.array([0.0, -10, 0])
        assert (sights.blocked(later, later + 2, move, centre) > 0) is known


def free_within(only: tuple[float, float, float], shift_m: float, turn: float) -> bool:
    """Return whether a correction of so small a shift and angle is free, where only one is.

    The window saw two walls, straight ahead and at 45 degrees. Half-way there is a row of older
    walls, which can be looked through only where two of them meet: they lose 0.2 m at each end.

    Args:
        only: angle, x and y of the correction by which both lines go through there.
        shift_m: the longest shift.
        turn: the largest angle.
    """
    angle, x, y = only
    ahead = DRIFT[0] + x - angle * (3 - y)
    aside = DRIFT[0] + x + (1 - angle) / (1 + angle) * (3 - y)
    ends = [2.0, ahead, aside, 30.0]
    row: list[Wall] = [((start, 3), (end, 3)) for start, end in pairwise(ends)]
    sights, centre = drive(row, [FAR, ((6, 6), (8, 6))])
    assert sights.blocked(LATER, END, np.array(only), centre) == 0
    nothing: Any = None  # all that counts are the lines of sight
    return _Drive(nothing, nothing, nothing, sights).is_free_within(LATER, shift_m, turn, centre)


@pytest.mark.parametrize("x", np.linspace(-1.5, 1.5, 7))
@pytest.mark.parametrize("y", np.linspace(-1.5, 1.5, 7))
def test_shifts_are_tried_in_steps_of_a_third_each_way(x: float, y: float) -> None:
    assert free_within((0, x, y), 1.5, 0) is bool(np.hypot(x, y) <= 1.5)
    assert not free_within((0, x + 0.25, y), 1.5, 0), "between two steps, or beyond the last"


def test_angles_are_tried_in_steps_of_a_half() -> None:
    tried = {angle: free_within((angle, 0, 0), 0, 0.4) for angle in np.linspace(-0.6, 0.6, 13)}
    assert [round(angle, 1) for angle, free in tried.items() if free] == [-0.4, -0.2, 0, 0.2, 0.4]


@pytest.mark.parametrize("angle", [-0.4, -0.2, 0.2, 0.4])
def test_every_angle_is_tried_with_every_shift(angle: float) -> None:
    for only in ((angle, 1.0, -1.0), (angle, -1.0, 0.5), (angle, -0.5, -0.5)):
        assert free_within(only, 1.5, 0.4)
        assert not free_within(only, 0, 0.4)
        assert not free_within(only, 1.5, 0)
