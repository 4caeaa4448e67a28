"""Solve the factor graph of an S-Graph, and bring poses, surfaces and nodes up to date."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import gtsam
import numpy as np

from sgraph_concepts.registry import Registry
from sgraph_concepts.types import FloatArray
from sgraph_core.backend.association import Association, associate
from sgraph_core.backend.back_projection import moved, shifted
from sgraph_core.backend.concept_factors import (
    ConceptFactors,
    factors_of_nodes,
    propose,
    with_ties,
)
from sgraph_core.backend.keys import Keys
from sgraph_core.backend.low_layers import LowLayers, low_layers
from sgraph_core.backend.robust import (
    Refusal,
    RobustSolution,
    error_of,
    solve,
    solve_robustly,
)
from sgraph_core.geometry import origin_near
from sgraph_core.graph import SGraph
from sgraph_core.nodes import check_nodes

__all__ = ["Optimization", "optimize"]

MOST_ROUNDS = 4
ANEW_M = 0.3
"""Factors are made of how nodes were mapped: a map that has moved by more needs them anew."""
AGREE_RAD, AGREE_M = 0.1, 0.2
"""A visit that sees a plane closer to the surface's than this saw the surface."""


@dataclass(frozen=True, eq=False)
class Optimization:
    """A solved S-Graph.

    Attributes:
        graph: the S-Graph with keyframes, surfaces and shapes of nodes moved.
        origin: world position of the (0, 0, 0) that the graph was solved about, [3].
        values: gtsam's solution, in coordinates about ``origin``.
        initial_error, final_error: half the sum of squared whitened residuals: of the low layers
            before, of the whole graph afterwards.
        factors: number of factors in the last round.
        iterations: of Levenberg-Marquardt, of all rounds.
        converged: whether the last of them gained next to nothing. If not, something that is no
            concept's contradicts the rest grossly, such as one wrong motion or observation.
        association: which surfaces were found to be one, and which not; ties that were switched off
            later included.
        refusals: which nodes and ties were switched off, and why.
    """

    graph: SGraph
    origin: FloatArray
    values: gtsam.Values
    initial_error: float
    final_error: float
    factors: int
    iterations: int
    converged: bool
    association: Association
    refusals: Sequence[Refusal]

    @property
    def switched_off(self) -> list[tuple[str, int]]:
        """Concept and id of the nodes of which factors were switched off."""
        return sorted({(refusal.concept, refusal.node) for refusal in self.refusals})


def optimize(
    graph: SGraph,
    factor_types: Mapping[str, str] | None = None,
    registry: Registry | None = None,
) -> Optimization:
    """Solve the factor graph of an S-Graph and its concepts by Levenberg-Marquardt.

    The low layers are solved alone first: what concepts are made of is judged on a map that its
    own observations have straightened. Then, round by round, surfaces that are one are tied, the
    graph is solved, and factors that fit badly (chi-squared test at 0.1 %) are switched off: a
    wrong detection must not bend the map. A tie makes the map surer of itself, so that the next
    round may see others; the rounds end when there are none, or after four. Where ties have
    moved the map far, the next round makes nodes' factors anew, and those that were switched off
    get another chance.

    The graph is solved about an origin amid the keyframes: a plane turns about the origin of the
    coordinates, and the farther off that is, the worse the problem is conditioned.

    Args:
        graph: the S-Graph; it is not changed.
        factor_types: by concept, another factor type than the declared one; see
            :func:`sgraph_core.backend.concept_factors`.
        registry: the concepts; the installed ones by default.

    Raises:
        OptimizationError: there is nothing to optimise, odometry does not connect all keyframes,
            a factor fails, or sigmas differ by too much to tell how far the drive has drifted.
        InputError: a node breaks the map file's rules.
        ConceptError: a factor type is unknown, or a plugin's factors are not fit for a graph.
    """
    check_nodes(graph.concepts, set(graph.wall_surfaces.ids.tolist()))
    origin = origin_near(graph.keyframes.poses[:, :3])
    solved = _optimize(shifted(graph, -origin), origin, factor_types, registry)
    return replace(solved, graph=shifted(solved.graph, origin))


def _optimize(
    graph: SGraph,
    origin: FloatArray,
    factor_types: Mapping[str, str] | None,
    registry: Registry | None,
) -> Optimization:
    keys = Keys()
    make = partial(
        factors_of_nodes,
        keys=keys,
        factor_types=factor_types,
        registry=registry,
        origin=origin[:2],
    )
    low = low_layers(graph, keys)
    initial = low.graph.error(low.values)
    solution = solve(low.graph, low.values)
    values, iterations = solution.values, solution.iterations
    current = moved(graph, low, values, keys)
    concepts = make(current)
    proposals, made_of = concepts.proposals, current
    found, refusals = Association(), list[Refusal]()
    anew = concepts if concepts.groups else None
    for _ in range(MOST_ROUNDS):
        new = associate(current, proposals, found)
        if not (new.same or anew):
            break
        found = found.with_(new)
        if anew:
            concepts = with_ties(anew, found.same, current, keys)
            refusals = [refusal for refusal in refusals if refusal.surfaces]
        else:
            concepts = with_ties(concepts, new.same, current, keys)
        low, solution = _solve(graph, found, low, concepts, values, keys, refusals)
        values = solution.values
        refusals = list(solution.refusals)
        iterations += solution.iterations
        current = moved(graph, low, values, keys)
        if not new.same:
            break
        if _is_far(made_of, current):
            made = make(current)
            had_some = any(not group.surfaces for group in concepts.groups)
            anew = made if made.groups or had_some else None
            proposals, made_of = made.proposals, current
        else:
            anew, proposals = None, propose(current, factor_types, registry, origin[:2])
    return Optimization(
        current,
        origin,
        values,
        initial,
        error_of(solution.factors, values),
        solution.factors.size(),
        iterations,
        solution.converged,
        found,
        refusals,
    )


def _is_far(one: SGraph, two: SGraph) -> bool:
    """Return whether a keyframe moved so far that nodes' factors must be made anew."""
    moves = one.keyframes.poses[:, :2] - two.keyframes.poses[:, :2]
    return bool((np.linalg.norm(moves, axis=1) > ANEW_M).any())


def _solve(
    graph: SGraph,
    found: Association,
    low: LowLayers,
    concepts: ConceptFactors,
    values: gtsam.Values,
    keys: Keys,
    refusals: Sequence[Refusal],
) -> tuple[LowLayers, RobustSolution]:
    """Solve with planes of their own for doubted visits, and again without those that agree."""
    doubted = _visit_ids(graph, found.doubted)
    if not doubted:
        return low, solve_robustly(low, concepts, values, keys, refusals)
    low = low_layers(graph, keys, doubted)
    first = solve_robustly(low, concepts, values, keys, refusals)
    low = low_layers(graph, keys, _still_doubted(graph, doubted, first.values, keys))
    second = solve_robustly(low, concepts, first.values, keys, first.refusals)
    return low, replace(second, iterations=first.iterations + second.iterations)


def _visit_ids(graph: SGraph, doubted: Sequence[tuple[int, int]]) -> dict[tuple[int, int], int]:
    """Return surface ids for doubted visits, above all others and in the given order."""
    above = int(graph.wall_surfaces.ids.max()) + 1
    return {visit: above + number for number, visit in enumerate(doubted)}


def _still_doubted(
    graph: SGraph, doubted: Mapping[tuple[int, int], int], values: gtsam.Values, keys: Keys
) -> dict[tuple[int, int], int]:
    """Return the visits that, left to themselves, see another plane than the surface's."""
    still = {}
    for (surface, row), visit in doubted.items():
        middle = graph.wall_surface(surface).segment.mean(axis=0)
        one, two = (
            values.atOrientedPlane3(keys.surface(i)).planeCoefficients() for i in (surface, visit)
        )
        angle = np.arccos(np.clip(one[:3] @ two[:3], -1, 1))
        gap = (one[:2] - two[:2]) @ middle + one[3] - two[3]
        if angle > AGREE_RAD or abs(gap) > AGREE_M:
            still[surface, row] = visit
    return still
