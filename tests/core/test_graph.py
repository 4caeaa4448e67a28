"""The S-Graph: tables that grow, rules that hold, links as networkx."""

from __future__ import annotations

import numpy as np
import pytest

from sgraph_concepts.errors import InputError
from sgraph_concepts.types import ConceptNode
from sgraph_core.backend import optimize
from sgraph_core.graph import SGraph
from sgraph_core.tables import turned

LEVEL = [0, 0, 0, 0, 0, 0, 1]


@pytest.fixture
def graph() -> SGraph:
    result = SGraph("small")
    result.add_keyframe(0, LEVEL, stamp=1.0)
    result.add_keyframe(1, [1, 0, 0, 0, 0, 0, 1])
    result.add_odometry(0, 1, [1, 0, 0, 0, 0, 0, 1], [0.01] * 6)
    result.add_wall_surface(10, [[0, -1], [4, -1]], [0, 1], [0, 2.5])
    result.add_wall_surface(20, [[4, -1], [4, 3]], [-1, 0])
    result.observe(10, 0, [0, 1, 0, 1], [0.01, 0.02])
    return result


def test_rows_are_viewed_as_objects(graph: SGraph) -> None:
    assert graph.keyframe(0).stamp == 1.0
    assert graph.keyframe(1).stamp is None
    surface = graph.wall_surface(10)
    assert surface.segment.tolist() == [[0, -1], [4, -1]]
    assert surface.height is not None
    assert graph.wall_surface(20).height is None


def test_tables_keep_their_rows_while_they_grow() -> None:
    graph = SGraph()
    for number in range(100):
        graph.add_wall_surface(number, [[number, 0], [number, 1]], [1, 0])
    assert graph.wall_surfaces.ids.tolist() == list(range(100))
    assert graph.wall_surfaces.segments[:, 0, 0].tolist() == list(range(100))


def test_tables_grow_in_amortised_constant_time() -> None:
    """The arrays behind a table are replaced a logarithmic number of times."""
    graph = SGraph()
    arrays = set()
    for number in range(1000):
        graph.add_wall_surface(number, [[number, 0], [number, 1]], [1, 0])
        base = graph.wall_surfaces.segments.base
        arrays.add(len(base) if base is not None else 0)
    assert len(arrays) <= 11


def test_a_refused_row_changes_nothing(graph: SGraph) -> None:
    with pytest.raises(InputError, match=r"normal = \[1\.0, 0\.0\]: must be perpendicular"):
        graph.add_wall_surface(30, [[0, 0], [1, 0]], [1, 0])
    with pytest.raises(InputError, match="there is no wall surface 30"):
        graph.wall_surface(30)
    assert len(graph.wall_surfaces.ids) == 2


def test_values_of_the_wrong_shape_or_kind_are_named(graph: SGraph) -> None:
    with pytest.raises(InputError, match=r"pose = .*must have shape \[7\]"):
        graph.add_keyframe(5, [0, 0, 0])
    with pytest.raises(
        InputError, match=r"^segment = \[\[0. 0.\] \[1. 1.\] \[2. 2.\]\]: must have"
    ):
        graph.add_wall_surface(5, np.repeat(np.arange(3.0), 2).reshape(3, 2), [0, 1])
    with pytest.raises(InputError, match="must be an integer"):
        graph.add_keyframe(5.5, LEVEL)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="must be the id of a wall surface"):
        graph.observe(99, 0, [0, 1, 0, 1], [0.01, 0.02])
    with pytest.raises(InputError, match=r"at = .*must be finite"):
        graph.observe(10, 0, [0, 1, 0, 1], [0.01, 0.02], [np.nan, 0, 0])


@pytest.mark.parametrize("sigma", [0.0, -1.0, 1e-160, 9e-9, 1.1e6, np.inf, np.nan])
def test_sigmas_that_no_sensor_has_are_refused(graph: SGraph, sigma: float) -> None:
    rule = r"must be from 1e-08 to 1e\+06$"
    with pytest.raises(InputError, match=rf"^odometry\[0\].sigmas = \[0.1, .*{rule}"):
        graph.add_odometry(0, 1, [1, 0, 0, 0, 0, 0, 1], [0.1] * 5 + [sigma])
    with pytest.raises(InputError, match=rf"^observations\[0\].sigmas = \[.*, 0.1\]: {rule}"):
        graph.observe(10, 0, [0, 1, 0, 1], [sigma, 0.1])


def displaced(odometry_sigma: float, plane_sigma: float) -> SGraph:
    """Return a map whose keyframe 1 belongs 1 m ahead of keyframe 0, and does not stand there."""
    graph = SGraph()
    graph.add_keyframe(0, LEVEL)
    graph.add_keyframe(1, [1.2, 0.1, 0, 0, 0, np.sin(0.05), np.cos(0.05)])
    graph.add_odometry(0, 1, [1, 0, 0, 0, 0, 0, 1], [odometry_sigma] * 6)
    graph.add_wall_surface(10, [[0, -1], [4, -1]], [0, 1])
    graph.add_wall_surface(20, [[4, -1], [4, 3]], [-1, 0])
    for keyframe, ahead in ((0, 4), (1, 3)):
        graph.observe(10, keyframe, [0, 1, 0, 1], [plane_sigma] * 2)
        graph.observe(20, keyframe, [-1, 0, 0, ahead], [plane_sigma] * 2)
    return graph


@pytest.mark.parametrize(
    "sigmas", [(1e-8, 0.1), (0.1, 1e-8), (1e-8, 1e-8), (1e6, 0.1), (0.1, 1e6)], ids=str
)
def test_a_map_with_extreme_sigmas_is_solved(sigmas: tuple[float, float]) -> None:
    solved = optimize(displaced(*sigmas)).graph.keyframe(1).pose
    assert solved == pytest.approx([1, 0, 0, 0, 0, 0, 1], abs=1e-9)


def test_a_map_of_which_nothing_is_known_stays_as_it_is() -> None:
    """All its error is below what counts as nothing; it does not fail."""
    graph = displaced(1e6, 1e6)
    assert optimize(graph).graph.keyframe(1).pose == pytest.approx(graph.keyframe(1).pose, abs=1e-6)


def test_ordered_endpoints_do_not_depend_on_the_input_order() -> None:
    one, two = SGraph(), SGraph()
    one.add_wall_surface(0, [[0, 0], [4, 0]], [0, 1])
    two.add_wall_surface(0, [[4, 0], [0, 0]], [0, 1])
    assert (one.wall_surfaces.ordered().segments == two.wall_surfaces.ordered().segments).all()
    arrays = one.wall_surfaces.ordered()
    along = arrays.segments[0, 1] - arrays.segments[0, 0]
    assert (along / 4 == arrays.tangents[0]).all()


def test_links_show_all_layers_as_networkx(graph: SGraph) -> None:
    graph.concepts["room"] = [ConceptNode(0, (10, 20))]
    graph.concepts["floor"] = [ConceptNode(0, (0,))]
    graph.groups["floor"] = "room"
    links = graph.networkx()
    assert links[("room", 0)][("wall_surface", 20)]["link"] == "member"
    assert links[("floor", 0)][("room", 0)]["link"] == "member"
    assert links[("keyframe", 0)][("wall_surface", 10)]["link"] == "observation"
    assert links[("keyframe", 0)][("keyframe", 1)]["link"] == "odometry"
    assert links.number_of_nodes() == 6


def test_a_copy_is_independent(graph: SGraph) -> None:
    other = graph.copy()
    other.add_keyframe(2, LEVEL)
    other.concepts["room"] = []
    assert len(graph.keyframes.ids) == 2
    assert graph.concepts == {}


def test_quaternions_turn_vectors() -> None:
    half = np.sqrt(0.5)
    result = turned(np.array([[1.0, 0, 0]]), np.array([[0, 0, half, half]]))
    assert result == pytest.approx(np.array([[0.0, 1.0, 0.0]]))


def test_the_tables_cannot_be_changed_past_the_rules() -> None:
    graph = SGraph()
    graph.add_keyframe(0, [0, 0, 0, 0, 0, 0, 1])
    view = graph.keyframes.poses
    with pytest.raises(ValueError, match="read-only"):
        view[0, 0] = np.nan
    graph.move({0: [1, 0, 0, 0, 0, 0, 1]})
    assert graph.keyframe(0).pose[0] == 1
