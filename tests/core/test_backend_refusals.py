"""What the back end refuses, in one line that names it, and with the S-Graph unchanged."""

from __future__ import annotations

import re

import pytest
import zone
from drive import drive, with_walls
from plans import block
from zone import Fickle

from sgraph_concepts.errors import ConceptError, OptimizationError
from sgraph_core.backend import Keys, optimize
from sgraph_core.graph import SGraph

LEVEL = [0, 0, 0, 0, 0, 0, 1]
KEYS = Keys()


def test_a_map_without_keyframes_cannot_be_optimised() -> None:
    with pytest.raises(OptimizationError, match="0 keyframes and 0 observations"):
        optimize(block(0.1))


def test_keyframes_without_odometry_are_named() -> None:
    graph = drive(0).graph
    graph.add_keyframe(77, LEVEL)
    graph.add_keyframe(78, LEVEL)
    with pytest.raises(
        OptimizationError, match=r"connect keyframe 77 to keyframe 0 \(nor 1 others"
    ):
        optimize(graph)


def test_unknown_factor_types_are_named() -> None:
    graph = with_walls(drive(0))
    with pytest.raises(ConceptError, match="factor of concept 'wall': 'fancy' is neither"):
        optimize(graph, {"wall": "fancy"})
    with pytest.raises(ConceptError, match="no concept 'roof'"):
        optimize(graph, {"roof": "none"})


def test_a_factor_function_that_fails_is_named_and_the_graph_unchanged() -> None:
    graph = with_walls(drive(0))
    poses = graph.keyframes.poses.copy()
    with pytest.raises(ConceptError, match="factor of wall 0 fails: division by zero"):
        optimize(graph, {"wall": "zone:failing_factor"})
    with pytest.raises(ConceptError, match="must return a FactorResult"):
        optimize(graph, {"wall": "zone:no_factor"})
    assert (graph.keyframes.poses == poses).all()


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("wide_factor", "its Jacobians are 7 wide together, its variables 5"),
        ("shifted_factor", r".*; that of s1 is 2 x 2, must be 2 x 3$"),
        ("tall_factor", r".*; that of s1 is 3 x 3, must be 2 x 3$"),
        ("unset_factor", r".*; that of s7 is 0 x 0, must be 2 x 3$"),
        ("long_factor", "its error has 3 rows, its noise model 2"),
        ("forgetful_factor", "it has 1 Jacobians for 2 variables"),
        ("endless_factor", "its error or Jacobians are not finite"),
        ("indefinite_factor", "its covariance is not positive definite"),
        ("robust_indefinite_factor", "its covariance is not positive definite"),
        ("noiseless_factor", "it has no noise model"),
        ("taken_key", "the key s1 is taken"),
        ("lost_key", "7 is neither a member's plane nor the node's own"),
    ],
)
def test_factors_that_are_not_fit_for_a_graph_are_named(name: str, message: str) -> None:
    graph = with_walls(drive(0))
    poses = graph.keyframes.poses.copy()
    with pytest.raises(ConceptError, match=f"factor of wall 0: {message}"):
        optimize(graph, {"wall": f"zone:{name}"})
    assert (graph.keyframes.poses == poses).all()


def test_a_native_factor_on_a_variable_of_another_type_is_named() -> None:
    message = "^factor of wall 0 cannot be linearised: .*OrientedPlane3.* requested type was"
    with pytest.raises(ConceptError, match=message):
        optimize(with_walls(drive(0)), {"wall": "zone:mistyped_prior"})


@pytest.mark.parametrize("pair", [(1, 4, 7), (1,), (1, 1), (1, "4"), (1, 4.0), (1, -4), "14", 1])
def test_pairs_that_are_none_are_named(monkeypatch: pytest.MonkeyPatch, pair: object) -> None:
    monkeypatch.setattr(zone.Proposed, "same", [(1, 4), pair])
    message = f"factor of wall 0: same[1] = {pair!r}: must be the ids of two surfaces"
    with pytest.raises(ConceptError, match=rf"^{re.escape(message)}$"):
        optimize(with_walls(drive(0)), {"wall": "zone:proposing_factor"})


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"same": None}, "same = None: must be a sequence"),
        ({"factors": 5}, "factors = 5: must be a sequence"),
        ({"values": {}.items()}, r"values = dict_items\(\[\]\): must be a sequence"),
        ({"values": [3]}, r"values\[0\] = 3: must be a key and its value"),
        ({"values": [("x", 1.0)]}, r"values\[0\] = \('x', 1.0\): must be a key and its value"),
    ],
)
def test_what_is_no_list_of_factors_values_or_pairs_is_named(
    monkeypatch: pytest.MonkeyPatch, fields: dict[str, object], message: str
) -> None:
    monkeypatch.setattr(zone.Returned, "fields", fields)
    with pytest.raises(ConceptError, match=f"^factor of wall 0: {message}$"):
        optimize(with_walls(drive(0)), {"wall": "zone:returning_factor"})


def test_a_factor_that_names_a_variable_twice_is_refused() -> None:
    """gtsam does not add up the Jacobians: the solution would come out otherwise."""
    with pytest.raises(ConceptError, match=r"^factor of wall 0: it names a variable twice$"):
        optimize(with_walls(drive(0)), {"wall": "zone:twice_the_same_key"})


def test_a_variable_that_nothing_links_to_others_is_solved_too() -> None:
    """Nested dissection, as METIS does it, ends the process."""
    graph = with_walls(drive(0))
    result = optimize(graph, {"room": "none", "wall": "zone:own_variable"})
    for wall in graph.concepts["wall"]:
        assert result.values.atPoint2(KEYS.node("wall", wall.id, 0)) == pytest.approx([1, 1])


def test_one_keyframe_is_enough() -> None:
    graph = SGraph()
    graph.add_keyframe(0, LEVEL)
    graph.add_wall_surface(0, [[5, -1], [5, 1]], [-1, 0])
    graph.observe(0, 0, [-1, 0, 0, 4.8], [0.1, 0.1])
    solved = optimize(graph).graph
    assert solved.wall_surface(0).segment[:, 0] == pytest.approx([4.8, 4.8], abs=1e-6)
    assert solved.keyframe(0).pose == pytest.approx(LEVEL, abs=1e-6)


def test_a_graph_without_odometry_is_named() -> None:
    graph = SGraph()
    for keyframe in range(2):
        graph.add_keyframe(keyframe, LEVEL)
    graph.add_wall_surface(0, [[5, -1], [5, 1]], [-1, 0])
    graph.observe(0, 0, [-1, 0, 0, 4.8], [0.1, 0.1])
    with pytest.raises(OptimizationError, match="odometry does not connect keyframe 1 to"):
        optimize(graph)


@pytest.mark.parametrize("part", [0.3, 0.6, 0.8, 0.95, 1.0])
def test_a_factor_that_fails_at_any_moment_is_named_and_the_graph_unchanged(part: float) -> None:
    graph = with_walls(drive(0))
    poses = graph.keyframes.poses.copy()
    Fickle.left = enough = 10_000
    optimize(graph, {"wall": "zone:fickle_factor"})
    Fickle.left = round(part * (enough - Fickle.left)) - 1
    with pytest.raises((ConceptError, OptimizationError), match=r"not any more$"):
        optimize(graph, {"wall": "zone:fickle_factor"})
    assert (graph.keyframes.poses == poses).all()
