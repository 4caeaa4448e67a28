"""Solve the factor graph of an S-Graph, and bring poses and surfaces up to date."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import gtsam
import numpy as np
from scipy.special import chdtri

from sgraph_concepts.errors import OptimizationError
from sgraph_concepts.registry import Registry
from sgraph_concepts.types import FloatArray
from sgraph_core.backend.concept_factors import ConceptFactors, concept_factors
from sgraph_core.backend.keys import Keys
from sgraph_core.backend.low_layers import LowLayers, low_layers, pose3
from sgraph_core.graph import SGraph

__all__ = ["Optimization", "optimize"]

REJECTION = 1e-3
"""Probability with which a correct node's factors are switched off."""
MOST_ROUNDS = 5


@dataclass(frozen=True, eq=False)
class Optimization:
    """A solved S-Graph.

    Attributes:
        graph: the S-Graph with keyframes and surfaces moved.
        values: gtsam's solution.
        initial_error, final_error: of the whole graph: half the sum of squared whitened residuals.
        factors: number of factors in the last round.
        switched_off: concept and id of the nodes whose factors contradict the rest of the graph.
    """

    graph: SGraph
    values: gtsam.Values
    initial_error: float
    final_error: float
    factors: int
    switched_off: list[tuple[str, int]]


def optimize(
    graph: SGraph,
    factor_types: Mapping[str, str] | None = None,
    registry: Registry | None = None,
) -> Optimization:
    """Solve the factor graph of an S-Graph and its concepts by Levenberg-Marquardt.

    A node whose factors fit badly (chi-squared test at 0.1 %) is switched off and the graph
    solved again, until all that remain fit: a wrong detection must not bend the map.

    Args:
        graph: the S-Graph; it is not changed.
        factor_types: by concept, another factor type than the declared one; see
            :func:`sgraph_core.backend.concept_factors`.
        registry: the concepts; the installed ones by default.

    Raises:
        OptimizationError: there is nothing to optimise, odometry does not connect all keyframes,
            or the problem is under-determined.
        ConceptError: a factor type is unknown, or a plugin's factor function fails.
    """
    keys = Keys()
    low = low_layers(graph, keys)
    concepts = concept_factors(graph, keys, factor_types, registry)
    switched_off: list[tuple[str, int]] = []
    initial: float | None = None
    for _ in range(MOST_ROUNDS):
        factors, start = _assemble(low, concepts, switched_off)
        initial = factors.error(start) if initial is None else initial
        values = _solve(factors, start)
        misfits = _misfits(concepts, values, switched_off)
        if not misfits:
            break
        switched_off += misfits
    return Optimization(
        _moved(graph, low, values, keys),
        values,
        initial or 0.0,
        factors.error(values),
        factors.size(),
        sorted(switched_off),
    )


def _assemble(
    low: LowLayers, concepts: ConceptFactors, switched_off: list[tuple[str, int]]
) -> tuple[gtsam.NonlinearFactorGraph, gtsam.Values]:
    factors = gtsam.NonlinearFactorGraph()
    factors.push_back(low.graph)
    for node, indices in concepts.of_node.items():
        if node not in switched_off:
            for index in indices:
                factors.add(concepts.graph.at(index))
    values = gtsam.Values(low.values)
    values.insert(concepts.values)
    present = set(factors.keyVector())
    for key in values.keys():  # noqa: SIM118  (gtsam's Values is no mapping)
        if key not in present:
            values.erase(key)  # a variable of a node that is switched off
    return factors, values


def _solve(factors: gtsam.NonlinearFactorGraph, start: gtsam.Values) -> gtsam.Values:
    try:
        return gtsam.LevenbergMarquardtOptimizer(factors, start).optimize()
    except RuntimeError as error:
        reason = " ".join(str(error).split())
        raise OptimizationError(f"the factor graph cannot be solved: {reason}") from error


def _misfits(
    concepts: ConceptFactors, values: gtsam.Values, switched_off: list[tuple[str, int]]
) -> list[tuple[str, int]]:
    """Return the nodes whose factors fail the chi-squared test."""
    misfits = []
    own = set(concepts.values.keys())
    for node, indices in concepts.of_node.items():
        if node in switched_off:
            continue
        factors = [concepts.graph.at(index) for index in indices]
        variables = {key for factor in factors for key in factor.keys()} & own  # noqa: SIM118
        freedom = sum(factor.dim() for factor in factors)
        freedom -= sum(concepts.values.zeroVectors().at(key).size for key in variables)
        squares = 2 * sum(factor.error(values) for factor in factors)
        if freedom > 0 and squares > chdtri(freedom, REJECTION):
            misfits.append(node)
    return misfits


def _moved(graph: SGraph, low: LowLayers, values: gtsam.Values, keys: Keys) -> SGraph:
    """Return the S-Graph with the solution's poses, and its surfaces on the solution's planes.

    A surface is carried along by the keyframes that observed it (mean of where each would take its
    endpoints), then put onto its plane, so that it also moves lengthwise.
    """
    table = graph.keyframes
    solved = {i: values.atPose3(keys.keyframe(i)) for i in table.ids.tolist()}
    before = {i: pose3(pose) for i, pose in zip(table.ids.tolist(), table.poses, strict=True)}
    moves = {i: solved[i].compose(before[i].inverse()) for i in solved}
    observers: dict[int, list[int]] = {}
    seen = graph.observations
    for surface, keyframe in zip(
        seen.surface_ids.tolist(), seen.keyframe_ids.tolist(), strict=True
    ):
        observers.setdefault(surface, []).append(keyframe)
    segments = graph.wall_surfaces.segments.copy()
    normals = graph.wall_surfaces.normals.copy()
    for surface in low.surfaces:
        row = graph.surface_row(surface)
        carried = np.mean(
            [_carry(moves[keyframe], segments[row]) for keyframe in observers[surface]], axis=0
        )
        plane = values.atOrientedPlane3(keys.surface(surface)).planeCoefficients()
        size = np.linalg.norm(plane[:2])
        normals[row], offset = plane[:2] / size, plane[3] / size
        segments[row] = carried - np.outer(carried @ normals[row] + offset, normals[row])
    poses = np.array([_pose_row(solved[i]) for i in table.ids.tolist()])
    return graph.moved(poses, segments, normals)


def _carry(move: gtsam.Pose3, segment: FloatArray) -> FloatArray:
    return np.array([move.transformFrom(np.array([x, y, 0.0]))[:2] for x, y in segment])


def _pose_row(pose: gtsam.Pose3) -> list[float]:
    quaternion: Any = pose.rotation().toQuaternion()  # gtsam's stubs know nothing of it
    return [
        *pose.translation().tolist(),
        quaternion.x(),
        quaternion.y(),
        quaternion.z(),
        quaternion.w(),
    ]
