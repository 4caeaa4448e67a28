"""Which surfaces are found to be one: copies of a room, and never the room next door."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from plans import Point, rectangle, regular
from visits import AWAY, KEYFRAMES, visit_rooms

from sgraph_concepts.errors import ConceptError
from sgraph_concepts.types import ConceptNode, NodeShape
from sgraph_core.backend import associate, optimize
from sgraph_core.backend.association import Association, Proposal, Same
from sgraph_core.backend.concept_factors import propose
from sgraph_core.backend.robust import Refusal
from sgraph_core.evaluation.block import block_of_rooms
from sgraph_core.graph import SGraph

ROOM = rectangle(0, 0, 5, 4)
SEVEN = regular(7, 3.0)
PITCH = 4.2
DRIFT = (0.5, -0.3, 0.03)


def office(number: int) -> list[Point]:
    """Return one of a row of equal offices."""
    return rectangle(number * PITCH, 0, 4, 5)


def found(graph: SGraph) -> set[tuple[int, int]]:
    return {same.pair for same in associate(graph, propose(graph, None, None)).same}


@pytest.mark.parametrize("outline", [ROOM, SEVEN], ids=["four sides", "seven sides"])
def test_every_surface_of_a_room_seen_again_is_found(outline: list[Point]) -> None:
    sides = len(outline)
    pairs = found(visit_rooms([(outline, (0, 0, 0)), (outline, DRIFT)]))
    assert {(side, sides + side) for side in range(sides)} <= pairs
    assert all(newer - older == sides for older, newer in pairs)


def test_order_of_ids_does_not_matter() -> None:
    """The surface that was seen first is the older one, whatever its members' order."""
    graph = visit_rooms([(ROOM, (0, 0, 0)), (ROOM, DRIFT)])
    graph.concepts["room"].reverse()
    assert found(graph) == {(side, 4 + side) for side in range(4)}


def test_what_one_keyframe_sees_is_never_one_surface() -> None:
    graph = visit_rooms([(ROOM, (0, 0, 0)), (ROOM, DRIFT)])
    for surface in range(4):
        keyframe = int(graph.observations.keyframe_ids[-1])
        seen = graph.wall_surface(surface)
        at = graph.keyframe(keyframe).pose[:2]
        distance = float(seen.normal @ (at - seen.segment[0]))
        turn = -DRIFT[2]
        body = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]) @ seen.normal
        graph.observe(surface, keyframe, [*body, 0, distance], [0.01, 0.02])
    assert found(graph) == set()


@pytest.mark.parametrize("other", [99, 50], ids=["unknown", "not observed"])
def test_pairs_of_what_was_never_observed_are_named(other: int) -> None:
    graph = visit_rooms([(ROOM, (0, 0, 0))])
    graph.add_wall_surface(50, [[0, 0], [0, 1]], [1, 0])
    for pair in ((0, other), (other, 0)):
        with pytest.raises(ConceptError, match=rf"factor of zone 3: {pair[0]} and {pair[1]} must"):
            associate(graph, [Proposal("zone", 3, [pair])])


def test_parallel_walls_alone_prove_nothing() -> None:
    graph = visit_rooms([(ROOM, (0, 0, 0)), (ROOM, DRIFT)])
    graph.concepts["room"] = []
    assert found(graph) == set()


def test_what_a_window_saw_first_does_not_fix_how_it_moves() -> None:
    """Three parallel walls, and two small ones of the window itself that lie as far apart."""
    ell = [(0, 0), (4.4, 0), (4.4, 2.6), (3, 2.6), (3, 4), (0, 4)]
    graph = visit_rooms([(ell, (0, 0, 0)), (ell, (0.5, 0.5, 0))])
    graph.concepts["room"] = []
    x, y = graph.keyframe(KEYFRAMES).pose[:2]
    for surface, (px, py) in enumerate([(x - 1.4, y), (x - 0.9, y + 0.5)], start=12):
        graph.add_wall_surface(surface, [[px, py + 0.2], [px, py - 0.2]], [1, 0])
        keyframe = KEYFRAMES + surface - 12
        seen = graph.keyframe(keyframe).pose[0] - px
        graph.observe(surface, keyframe, [1, 0, 0, seen], [0.01, 0.02])
    parallel = [(side, 6 + side) for side in (0, 2, 4)]
    both = [*parallel, (12, 13)]
    moves = Proposal("zone", 0, both), Proposal("zone", 0, [*both, (1, 7)])
    assert not associate(graph, moves[:1]).same
    assert {pair.pair for pair in associate(graph, moves[1:]).same} == {*parallel, (1, 7)}


@pytest.fixture(params=[None, 3.0], ids=["as shipped", "not as far as the next office"])
def proposing(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Rooms propose surfaces farther away than an office is wide, or only nearer ones."""
    if request.param is not None:
        monkeypatch.setattr("sgraph_plugins.room.factor.FARTHEST_M", request.param)


@pytest.mark.usefixtures("proposing")
def test_an_office_in_a_row_of_equal_ones_is_found_after_little_drift() -> None:
    row = [(office(number), (0, 0, 0)) for number in range(4)]
    pairs = found(visit_rooms([*row, (office(1), (0.5, 0.2, 0.01))]))
    assert pairs == {(4 + side, 16 + side) for side in range(4)}


@pytest.mark.usefixtures("proposing")
@pytest.mark.parametrize("shift", [1.8, PITCH / 2, 2.4])
def test_an_office_that_may_be_either_of_two_is_taken_for_neither(shift: float) -> None:
    row = [(office(number), (0, 0, 0)) for number in range(4)]
    assert found(visit_rooms([*row, (office(1), (shift, 0, 0))])) == set()


@given(
    known=st.integers(1, 2),
    pitch=st.floats(2.8, 5.5),
    depth=st.floats(3, 6),
    away=st.integers(AWAY, 60),
    drift=st.tuples(st.floats(-0.4, 0.4), st.floats(-0.5, 0.5), st.floats(-0.04, 0.04)),
)
@example(known=1, pitch=2.8, depth=5, away=40, drift=(0, 0, 0))
@example(known=1, pitch=PITCH, depth=5, away=40, drift=(-0.25, 0, 0))
@settings(max_examples=60, deadline=None)
def test_a_new_office_is_not_the_one_before_because_drift_might_explain_it(
    known: int, pitch: float, depth: float, away: int, drift: tuple[float, float, float]
) -> None:
    """Drift is up to 0.4 times its width; no third office has to show that they repeat."""
    row = [rectangle(number * pitch, 0, pitch - 0.2, depth) for number in range(known + 1)]
    x, y, yaw = drift
    drifts = [*[(0, 0, 0)] * known, (x * pitch, y, yaw)]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("visits.AWAY", away)
        graph = visit_rooms(list(zip(row, drifts, strict=True)))
    assert found(graph) == set()


def test_a_copy_that_lies_in_the_way_does_not_hide_another() -> None:
    """A window that stays where it is blocks no line of sight that was not blocked before."""
    row = [(office(number), (0, 0, 0)) for number in range(3)]
    graph = visit_rooms([*row, (office(0), (0.8, 0, 0)), (office(1), (0, 0, 0))])
    pairs = {same.pair for same in optimize(graph).association.same}
    assert {(4 + side, 16 + side) for side in range(4)} <= pairs


@pytest.mark.parametrize(
    ("drift", "parted", "told"),
    [
        (1.3, (), False),
        (1.3, (2,), True),
        (PITCH / 2, (2,), False),  # the first one is as far away as the right one
        (PITCH / 2, (0, 2, 3), True),
    ],
)
def test_an_office_is_told_from_others_by_what_was_seen_through(
    drift: float, parted: tuple[int, ...], told: bool
) -> None:
    """The walls of all fit what is seen, but a partition of the others would hide some of it."""
    row = [(office(number), (0, 0, 0)) for number in range(4)]
    graph = visit_rooms([*row, (office(1), (drift, 0, 0))])
    for number in parted:
        surface, keyframe, x = 20 + number, number * KEYFRAMES, number * PITCH + 1
        graph.add_wall_surface(surface, [[x, 1], [x, 4]], [1, 0])
        away = graph.keyframe(keyframe).pose[0] - x
        graph.observe(surface, keyframe, [1, 0, 0, away], [0.01, 0.02])
    assert found(graph) == ({(4 + side, 16 + side) for side in range(4)} if told else set())


@pytest.mark.parametrize(("lines", "free"), [(2, True), (3, False)])
def test_a_correction_may_block_three_in_a_hundred_lines_of_sight(
    lines: int, free: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of 73: four from each of nine keyframes of either visit, and that to the partition."""
    monkeypatch.setattr("visits.SEEING", 9)
    graph = visit_rooms([(ROOM, (0, 0, 0)), (ROOM, (0.5, -0.3, 0))])
    x, y = graph.keyframe(4).pose[:2]
    half = 0.15 * lines + 0.2  # the ends do not count
    graph.add_wall_surface(
        8, [[x + 0.15 * (lines % 2 - 1) + s * half, 3] for s in (1, -1)], [0, -1]
    )
    graph.observe(8, 4, [0, -1, 0, 3 - y], [0.01, 0.02])
    assert (found(graph) >= {(side, 4 + side) for side in range(4)}) is free


@pytest.mark.parametrize(("others", "enough"), [(5, True), (7, False)])
def test_a_correction_must_explain_much_of_what_might_be_known(others: int, enough: bool) -> None:
    """The 8 m of a room, of as much again and 2 m for each surface that may be another one."""
    graph = visit_rooms([(ROOM, (0, 0, 0)), (ROOM, (0.2, -0.1, 0))])
    pairs = []
    for surface in range(8, 8 + others):
        graph.add_wall_surface(surface, [[surface, 9], [surface + 2, 9]], [0, -1])
        graph.observe(surface, KEYFRAMES, [0, -1, 0, 7], [0.01, 0.02])
        pairs.append((0, surface))
    proposals = [*propose(graph, None, None), Proposal("zone", 0, pairs)]
    same = {(side, 4 + side) for side in range(4)}
    assert {pair.pair for pair in associate(graph, proposals).same} == (same if enough else set())


@pytest.mark.usefixtures("proposing")
@pytest.mark.parametrize("drift", [0.0, 0.5, 1.3])
def test_the_next_office_of_a_row_is_not_taken_for_the_one_before(drift: float) -> None:
    """It has never been seen; what looks like it is a whole office away."""
    row = [(office(number), (0, 0, 0)) for number in range(3)]
    assert found(visit_rooms([*row, (office(3), (-drift, 0, 0))])) == set()


def test_a_row_of_rooms_is_not_taken_for_the_one_before() -> None:
    """All rooms are alike, so a row fits onto every other one; more pairs than can all be tried."""
    graph = block_of_rooms(200, np.random.default_rng(0))
    graph = optimize(graph, {"room": "none", "wall": "none"}).graph
    at = {tuple(node.shape.centre or ()): node for node in graph.concepts["room"]}
    pairs = [
        pair
        for (x, y), node in at.items()
        for (other_x, other_y), other in at.items()
        if abs(x - other_x) < 1 and 1 < y - other_y < 6
        for pair in zip(node.members, other.members, strict=True)
    ]
    assert len(pairs) > 4 * 180
    assert associate(graph, [Proposal("room", 0, pairs)]).same == ()


def test_no_room_of_a_block_of_equal_ones_is_tied_to_another() -> None:
    """Where a row ends, a window holds the next one too: that it moves along proves nothing."""
    assert not optimize(block_of_rooms(300, np.random.default_rng(0))).association.same


def test_a_room_of_another_shape_is_not_taken_for_the_one_before() -> None:
    other = rectangle(0.4, 0.3, 3.9, 5.2)
    assert found(visit_rooms([(ROOM, (0, 0, 0)), (other, (0, 0, 0))])) == set()


def test_optimising_brings_the_copies_together() -> None:
    graph = visit_rooms([(ROOM, (0, 0, 0)), (ROOM, DRIFT)])
    solved = optimize(graph)
    assert not solved.refusals
    for side in range(4):
        one, two = (solved.graph.wall_surface(i) for i in (side, 4 + side))
        assert one.normal @ two.normal > np.cos(0.02)
        middle = two.segment.mean(axis=0) - one.segment.mean(axis=0)
        assert abs(float(middle @ one.normal)) < 0.05


def thick_wall(drift: tuple[float, float, float], thickness: float = 0.2) -> SGraph:
    """Return a room, its neighbour, the room again after drift, and the wall between both visits.

    How room and neighbour lie to one another is known; so thick a wall is mapped with what the
    drift leaves free.
    """
    neighbour = rectangle(5 + thickness, 0, 4, 4)
    graph = visit_rooms([(ROOM, (0, 0, 0)), (neighbour, (0, 0, 0)), (ROOM, drift)])
    way = graph.keyframe(KEYFRAMES).pose[:2] - graph.keyframe(0).pose[:2]
    graph.add_odometry(0, KEYFRAMES, [*way, 0, 0, 0, 0, 1], [1e-3] * 6)
    sides = [graph.wall_surface(surface).segment.mean(axis=0) for surface in (7, 9)]
    shape = NodeShape(tuple(np.mean(sides, axis=0)), thickness=float((sides[0] - sides[1])[0]))
    graph.concepts["wall"] = [ConceptNode(0, (7, 9), shape=shape)]
    return graph


@pytest.fixture
def mapped_in_one_go(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let sides count as mapped in one go, whenever they were: thicknesses are held as mapped."""
    monkeypatch.setattr("sgraph_plugins.wall.factor.AT_ONCE", 3 * KEYFRAMES)


@pytest.mark.usefixtures("mapped_in_one_go")
@pytest.mark.parametrize("drift", [(-0.6, 0, 0), (-0.5, -0.3, 0.03)])
def test_a_wall_that_drift_made_thick_is_made_anew_once_the_loop_is_closed(
    drift: tuple[float, float, float],
) -> None:
    graph = thick_wall(drift)
    solved = optimize(graph)
    assert not solved.refusals
    assert solved.factors > optimize(graph, {"wall": "none"}).factors
    assert solved.graph.node("wall", 0).shape.thickness == pytest.approx(0.2, abs=0.03)


def test_a_wall_that_turns_out_to_be_none_leaves_no_factors() -> None:
    """Drift brought its sides within 0.7 m; once the loop is closed they are 1.3 m apart."""
    graph = thick_wall((0.6, 0, 0), thickness=1.3)
    assert optimize(graph).factors == optimize(graph, {"wall": "none"}).factors


@pytest.mark.usefixtures("mapped_in_one_go")
def test_a_wall_is_reported_as_switched_off_where_no_round_is_left_to_make_it_anew(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sys.modules["sgraph_core.backend.optimize"], "MOST_ROUNDS", 1)
    graph = thick_wall((-0.6, 0, 0))
    solved = optimize(graph)
    assert solved.switched_off == [("wall", 0)]
    assert solved.factors == optimize(graph, {"wall": "none"}).factors


@pytest.mark.usefixtures("mapped_in_one_go")
@pytest.mark.parametrize("anew_m", [0.0, np.inf], ids=["made anew", "kept"])
def test_a_tie_that_was_switched_off_stays_off_in_later_rounds(
    anew_m: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Eastern walls of two rooms are taken for one; the ties of later rounds move the map."""
    module = sys.modules["sgraph_core.backend.optimize"]
    monkeypatch.setattr(module, "ANEW_M", anew_m)
    neighbour = rectangle(5.2, 0, 4, 4)
    graph = visit_rooms([(ROOM, (0, 0, 0)), (neighbour, (0, 0, 0)), (ROOM, DRIFT)])
    wall = ConceptNode(0, (1, 7), shape=NodeShape((5.1, 2.0), thickness=0.2))
    graph.concepts["wall"] = [wall]

    def refused_ties(rounds: int) -> list[Refusal]:
        pairs = iter([(1, 5), (0, 8), (1, 9), (2, 10)][:rounds])
        found = (Association([Same("room", 0, pair)]) for pair in pairs)
        monkeypatch.setattr(module, "associate", lambda *_: next(found, Association()))
        solved = optimize(graph)
        assert len(solved.association.same) == rounds
        return [refusal for refusal in solved.refusals if refusal.surfaces]

    (at_first,) = refused_ties(1)
    assert at_first.surfaces == (1, 5)
    (in_the_end,) = refused_ties(4)
    assert in_the_end.surfaces == (1, 5)
    assert in_the_end.squares == pytest.approx(at_first.squares, rel=1e-6), "it is not tried again"


def test_a_wall_between_two_visits_does_not_hold_the_drift_between_them() -> None:
    """Its sides were mapped by a room's first visit and by its neighbour's, after the drift."""
    drift = (0.5, 0, 0)
    graph = visit_rooms([(ROOM, (0, 0, 0)), (ROOM, drift), (rectangle(5.2, 0, 4, 4), drift)])
    graph.concepts["wall"] = [ConceptNode(0, (1, 11), shape=NodeShape((5.35, 2), thickness=0.7))]
    solved = optimize(graph)
    assert not solved.refusals
    assert solved.factors > optimize(graph, {"wall": "none"}).factors, "its sides are held parallel"
    assert solved.graph.node("wall", 0).shape.thickness == pytest.approx(0.2, abs=0.15)
