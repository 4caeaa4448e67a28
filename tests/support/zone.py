"""Parts of a made-up concept, good ones and bad ones."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import gtsam
import numpy as np

from sgraph_concepts.types import (
    BuildingTruth,
    Cluster,
    ConceptNode,
    FactorContext,
    FactorResult,
    FloatArray,
    IntArray,
    NodeShape,
    Scene,
    ScoredEdges,
)
from sgraph_core.backend.ties import TieNoise, tie_planes
from sgraph_plugins.room.cluster import cluster as find_rooms
from sgraph_plugins.wall.cluster import cluster as find_walls
from sgraph_plugins.wall.factor import factors as wall_factors


def everything(scene: Scene) -> FloatArray:
    return np.ones(len(scene.pairs))


def nothing(scene: Scene) -> FloatArray:
    return -np.ones(len(scene.pairs))


def two_nodes(_edges: ScoredEdges, scene: Scene) -> list[Cluster]:
    """Return the surfaces with ids below 4, and the others."""
    low = scene.surfaces.ids < 4
    groups = [tuple(np.flatnonzero(rows).tolist()) for rows in (low, ~low)]
    return [Cluster(group, 0.5) for group in groups if group]


def first_node(edges: ScoredEdges, scene: Scene) -> list[Cluster]:
    return two_nodes(edges, scene)[:1]


def one_node(_edges: ScoredEdges, scene: Scene) -> list[Cluster]:
    return [Cluster(tuple(range(len(scene.nodes) or len(scene.surfaces))), 0.5)]


def one_each(_edges: ScoredEdges, scene: Scene) -> list[Cluster]:
    return [Cluster((row,), 0.5) for row in range(len(scene.nodes))]


def too_few(_scene: Scene) -> FloatArray:
    return np.zeros(1)


def nowhere(_edges: ScoredEdges, _scene: Scene) -> list[Cluster]:
    return [Cluster((0, 999), 0.5)]


def overlapping(_edges: ScoredEdges, _scene: Scene) -> list[Cluster]:
    return [Cluster((0, 1), 0.5), Cluster((1, 2), 0.5)]


def nobody(_edges: ScoredEdges, _scene: Scene) -> list[Cluster]:
    return [Cluster((), 0.5)]


def too_sure(_edges: ScoredEdges, _scene: Scene) -> list[Cluster]:
    return [Cluster((0, 1), 1.5)]


def bare_rows(_edges: ScoredEdges, _scene: Scene) -> list[tuple[int, ...]]:
    return [(0, 1)]


def no_shape(_members: Mapping[int, IntArray], _scene: Scene) -> str:
    return "round"


def shapeless(_members: Mapping[int, IntArray], _scene: Scene) -> dict[int, NodeShape]:
    return {}


def boxed(members: Mapping[int, IntArray], scene: Scene) -> dict[int, NodeShape]:
    """Say of every node which nodes there are besides it."""
    return {
        node: NodeShape((0.0, float(len(rows))), attributes={"others": sorted({*members} - {node})})
        for node, rows in members.items()
    }


def failing_factor(_node: ConceptNode, _context: FactorContext) -> float:
    return 1 / 0


class Moody:
    """What its factor function does: fail, or add variables that nothing holds."""

    fails = False
    floats = False


def moody_factor(node: ConceptNode, context: FactorContext) -> FactorResult:
    if Moody.fails:
        raise ArithmeticError("not today")
    if not Moody.floats:
        return FactorResult()
    import gtsam

    keys, noise = [context.new_key(k) for k in (0, 1)], gtsam.noiseModel.Unit.Create(2)
    factor = gtsam.BetweenFactorPoint2(*keys, gtsam.Point2(0, 0), noise)
    return FactorResult([factor], [(key, gtsam.Point2(0, 0)) for key in keys])


def no_factor(_node: ConceptNode, _context: FactorContext) -> str:
    return "glue"


def label_unknown_surface(_truth: BuildingTruth) -> IntArray:
    return np.array([[0, 9999]])


def label_itself(truth: BuildingTruth) -> IntArray:
    """Relate a surface to itself."""
    return np.array([[0, 1], [1, 1]])


def label_flat(_truth: BuildingTruth) -> IntArray:
    return np.array([0, 1])


def no_nodes(_edges: ScoredEdges, _scene: Scene) -> list[Cluster]:
    return []


def pairs_of_rows(_edges: ScoredEdges, scene: Scene) -> list[Cluster]:
    rows = range(len(scene.surfaces))
    return [Cluster(tuple(rows[k : k + 2]), 0.5) for k in rows[::2]]


def said_twice(edges: ScoredEdges, _scene: Scene) -> list[Cluster]:
    """Return a cluster for each pair, and the same again, less sure."""
    pairs = [(one, two) for one, two in edges.pairs.tolist()]
    return [Cluster(pair, sure) for sure in (0.9, 0.3) for pair in pairs]


def surest_pair(edges: ScoredEdges, _scene: Scene) -> list[Cluster]:
    return [Cluster(tuple(edges.pairs[edges.logits.argmax()].tolist()), 0.5)]


def _custom(
    node: ConceptNode, context: FactorContext, width: int, value: float, noise: Any
) -> FactorResult:
    """Return a factor on one plane and a point of its own, with Jacobians of a given width."""
    key = context.new_key(0)

    def residual(_factor: Any, _values: Any, jacobians: list[FloatArray] | None) -> FloatArray:
        if jacobians is not None:
            jacobians[0] = np.ones((2, width), order="F")
            jacobians[1] = np.eye(2, order="F")
        return np.full(2, value)

    keys = [context.plane_keys[node.members[0]], key]
    factor = gtsam.CustomFactor(noise, keys, residual)
    return FactorResult([factor], [(key, gtsam.Point2(0, 0))])


UNIT = gtsam.noiseModel.Isotropic.Sigma(2, 1.0)


def wide_factor(node: ConceptNode, context: FactorContext) -> FactorResult:
    return _custom(node, context, 5, 0.0, UNIT)


def endless_factor(node: ConceptNode, context: FactorContext) -> FactorResult:
    return _custom(node, context, 3, np.nan, UNIT)


def _of_two_planes(
    node: ConceptNode, context: FactorContext, *shapes: tuple[int, int] | None, rows: int = 2
) -> FactorResult:
    """Return a factor on two planes with Jacobians of given shapes, None for one that is unset."""

    def residual(_factor: Any, _values: Any, jacobians: list[FloatArray] | None) -> FloatArray:
        for k, shape in enumerate(shapes if jacobians is not None else ()):
            if jacobians is not None and shape is not None:
                jacobians[k] = np.ones(shape, order="F")
        return np.zeros(rows)

    keys = [context.plane_keys[member] for member in node.members]
    return FactorResult([gtsam.CustomFactor(UNIT, keys, residual)])


def shifted_factor(node: ConceptNode, context: FactorContext) -> FactorResult:
    """Return Jacobians that are as wide as their variables together, but not each."""
    return _of_two_planes(node, context, (2, 2), (2, 4))


def tall_factor(node: ConceptNode, context: FactorContext) -> FactorResult:
    return _of_two_planes(node, context, (3, 3), (2, 3))


def unset_factor(node: ConceptNode, context: FactorContext) -> FactorResult:
    return _of_two_planes(node, context, (2, 3), None)


def long_factor(node: ConceptNode, context: FactorContext) -> FactorResult:
    return _of_two_planes(node, context, (3, 3), (3, 3), rows=3)


def forgetful_factor(node: ConceptNode, context: FactorContext) -> FactorResult:
    """Drop a Jacobian."""

    def residual(_factor: Any, _values: Any, jacobians: Any) -> FloatArray:
        if jacobians is not None:
            jacobians.pop()
        return np.zeros(2)

    keys = [context.plane_keys[member] for member in node.members]
    return FactorResult([gtsam.CustomFactor(UNIT, keys, residual)])


def noiseless_factor(node: ConceptNode, context: FactorContext) -> FactorResult:
    return _custom(node, context, 3, 0.0, None)


def mistyped_prior(node: ConceptNode, context: FactorContext) -> FactorResult:
    """Take a plane for a point."""
    plane = context.plane_keys[node.members[0]]
    return FactorResult([gtsam.PriorFactorPoint2(plane, np.zeros(2), UNIT)])


class Proposed:
    """What its factor function takes for one."""

    same: Any = ()


def proposing_factor(_node: ConceptNode, _context: FactorContext) -> FactorResult:
    return FactorResult(same=Proposed.same)


class Returned:
    """What its factor function returns."""

    fields: ClassVar[dict[str, Any]] = {}


def returning_factor(_node: ConceptNode, _context: FactorContext) -> FactorResult:
    return FactorResult(**Returned.fields)


def twice_the_same_key(_node: ConceptNode, context: FactorContext) -> FactorResult:
    """Relate a variable to itself."""
    key = context.new_key(0)
    zero = gtsam.Point2(0, 0)
    prior = gtsam.PriorFactorPoint2(key, np.ones(2), UNIT)
    return FactorResult([prior, gtsam.BetweenFactorPoint2(key, key, zero, UNIT)], [(key, zero)])


INDEFINITE = gtsam.noiseModel.Gaussian.Covariance(np.array([[1.0, 2.0], [2.0, 1.0]]))


def indefinite_factor(
    _node: ConceptNode, context: FactorContext, noise: Any = INDEFINITE
) -> FactorResult:
    key = context.new_key(0)
    prior = gtsam.PriorFactorPoint2(key, np.zeros(2), noise)
    return FactorResult([prior], [(key, gtsam.Point2(0, 0))])


def robust_indefinite_factor(node: ConceptNode, context: FactorContext) -> FactorResult:
    huber = gtsam.noiseModel.mEstimator.Huber.Create(1.0)
    return indefinite_factor(node, context, gtsam.noiseModel.Robust.Create(huber, INDEFINITE))


def taken_key(node: ConceptNode, context: FactorContext) -> FactorResult:
    plane = context.plane_keys[node.members[0]]
    return FactorResult([], [(plane, gtsam.OrientedPlane3(1, 0, 0, 0))])


def own_variable(_node: ConceptNode, context: FactorContext) -> FactorResult:
    """A variable that no factor links to another."""
    key = context.new_key(0)
    prior = gtsam.PriorFactorPoint2(key, np.ones(2), UNIT)
    return FactorResult([prior], [(key, gtsam.Point2(0, 0))])


def lost_key(_node: ConceptNode, _context: FactorContext) -> FactorResult:
    return FactorResult([gtsam.PriorFactorPoint2(7, np.zeros(2), UNIT)])


def tie_at_a_fifth(node: ConceptNode, context: FactorContext) -> FactorResult:
    """Hold two sides 0.2 m apart, and nothing else will do."""
    one, two = node.members
    return tie_planes(
        (context.plane_keys[one], context.plane_keys[two]),
        context.new_key(0),
        np.array(node.shape.centre),
        context.planes[one][:2],
        0.2,
        TieNoise(0.01, 0.01),
    )


def merged_rooms(edges: ScoredEdges, scene: Scene) -> list[Cluster]:
    """Give every fifth room, by its lowest id, the surfaces of the nearest other one."""
    rooms = find_rooms(edges, scene)
    ids, middles = scene.surfaces.ids, scene.surfaces.midpoints
    for room in [room for room in rooms if ids[list(room.members)].min() // 4 % 5 == 1]:
        others = [other for other in rooms if other is not room]
        if room not in rooms or not others:
            continue
        centre = middles[list(room.members)].mean(axis=0)
        gaps = [
            np.linalg.norm(middles[list(other.members)].mean(axis=0) - centre) for other in others
        ]
        nearest = others[int(np.argmin(gaps))]
        rooms = [other for other in others if other is not nearest]
        rooms.append(Cluster(tuple(sorted((*room.members, *nearest.members))), room.confidence))
    return rooms


def mispaired_walls(edges: ScoredEdges, scene: Scene) -> list[Cluster]:
    """Give every fifth wall, by its ids, the nearest opposed surface beyond half a metre."""
    surfaces = scene.surfaces
    walls = []
    for wall in find_walls(edges, scene):
        one, two = sorted(wall.members, key=lambda row: int(surfaces.ids[row]))
        if surfaces.ids[[one, two]].sum() % 5 == 0:
            ways = surfaces.midpoints - surfaces.midpoints[one]
            gaps = np.linalg.norm(ways, axis=1)
            gaps[surfaces.normals @ surfaces.normals[one] > -0.9] = np.inf
            gaps[np.abs(ways @ surfaces.normals[one]) < 0.5] = np.inf
            if np.isfinite(gaps.min()):
                two = int(gaps.argmin())
        walls.append(Cluster((min(one, two), max(one, two)), wall.confidence))
    return walls


def told(_context: FactorContext) -> None:
    """Take note of what a factor function is told; for tests to replace."""


def telling_factor(_node: ConceptNode, context: FactorContext) -> FactorResult:
    """Return no factors, but tell a test."""
    told(context)
    return FactorResult()


def gullible_factor(node: ConceptNode, context: FactorContext) -> FactorResult:
    """Hold what cannot be a wall half a metre closer than it is, and walls as they should be."""
    result = wall_factors(node, context)
    if result.factors or len(context.plane_keys) < 2:
        return result
    one, two = node.members
    middle = np.append(np.mean([*context.segments.values()], axis=(0, 1)), [0, 1])
    apart = -float(context.planes[one] @ middle + context.planes[two] @ middle)
    return tie_planes(
        (context.plane_keys[one], context.plane_keys[two]),
        context.new_key(0),
        middle[:2],
        context.planes[one][:2],
        apart + 0.5,
        TieNoise(0.01, 0.02),
    )


def sides_in_order(_edges: ScoredEdges, scene: Scene) -> list[Cluster]:
    """Pair the surfaces 0 and 1, 2 and 3, and so on."""
    row = {int(i): k for k, i in enumerate(scene.surfaces.ids)}
    pairs = [(k, row[i + 1]) for i, k in row.items() if i % 2 == 0 and i + 1 in row]
    return [Cluster((min(pair), max(pair)), 0.9) for pair in pairs]


class Fickle:
    """How often its factors may be evaluated before they fail, all together."""

    left = 0


def fickle_factor(node: ConceptNode, context: FactorContext) -> FactorResult:
    """Return a factor that is fit for a graph, but fails in the end."""
    key = context.new_key(0)

    def residual(_factor: Any, _values: Any, jacobians: list[FloatArray] | None) -> FloatArray:
        Fickle.left -= 1
        if Fickle.left < 0:
            raise ArithmeticError("not\nany more")
        if jacobians is not None:
            jacobians[0] = np.zeros((2, 3), order="F")
            jacobians[1] = np.eye(2, order="F")
        return np.zeros(2)

    keys = [context.plane_keys[node.members[0]], key]
    factor = gtsam.CustomFactor(UNIT, keys, residual)
    return FactorResult([factor], [(key, gtsam.Point2(0, 0))])
