"""Solving with concepts that may be wrong: what contradicts the map is switched off."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf, isnan

import gtsam
from scipy.special import chdtri

from sgraph_concepts.errors import ConceptError, one_line
from sgraph_core.backend.concept_factors import ConceptFactors, FactorGroup
from sgraph_core.backend.failing import failing_as
from sgraph_core.backend.keys import Keys
from sgraph_core.backend.low_layers import LowLayers

__all__ = [
    "STRETCH",
    "Refusal",
    "RobustSolution",
    "error_of",
    "keys_of",
    "misfit",
    "solve",
    "solve_robustly",
    "worst_of",
]

REJECTION = 1e-3
"""Probability with which correct factors are switched off."""
STRETCH = 20
"""Keyframes that are near one another: what they saw may be bent by one wrong factor."""
NEARLY = 0.5
"""Share of the excess of the worst misfit near them from which others go together with it."""
ROUGH, FINE = 1e-3, 1e-5
"""Share of the error by which the last iteration lowers it: when misfits are first looked for, and
when there are none left. To bend a map into a wrong loop takes many iterations for nothing."""
NOTHING = 1e-8
"""An error that falls by no more was none: of a consistent map a share of it is never reached."""
MOST_ITERATIONS = 100
MOST_DAMPING = 1e20
"""Of Levenberg-Marquardt: with gtsam's 1e5 a gross outlier may leave no step that it would try."""


@dataclass(frozen=True)
class Refusal:
    """Why factors were switched off.

    Attributes:
        concept, node: whose factors.
        surfaces: ids of the two surfaces of a tie; empty for the node's own factors.
        squares: their sum of squared whitened residuals.
        threshold: the quantile of chi-squared that it exceeds.
        freedom: degrees of freedom of the quantile.
    """

    concept: str
    node: int
    surfaces: tuple[int, ...]
    squares: float
    threshold: float
    freedom: int

    @property
    def excess(self) -> float:
        """How many times its threshold the squared error is; infinite where that is."""
        return inf if self.squares == inf else self.squares / self.threshold

    def __str__(self) -> str:
        what = f"{self.concept} {self.node}"
        if self.surfaces:
            what += f", surfaces {self.surfaces[0]} = {self.surfaces[1]}"
        return (
            f"{what}: squared error {self.squares:.3g} exceeds {self.threshold:.3g} "
            f"(chi-squared, {self.freedom} degrees of freedom, {1 - REJECTION:.1%}) "
            "against the rest of the graph"
        )


@dataclass(frozen=True, eq=False)
class RobustSolution:
    """A solution, the factors it satisfies, and what was left out.

    Attributes:
        factors: that are satisfied.
        values: the solution.
        refusals: what was left out, and why.
        iterations: of Levenberg-Marquardt.
        converged: whether the last of them gained next to nothing.
    """

    factors: gtsam.NonlinearFactorGraph
    values: gtsam.Values
    refusals: Sequence[Refusal]
    iterations: int
    converged: bool


def solve(factors: gtsam.NonlinearFactorGraph, start: gtsam.Values) -> RobustSolution:
    """Return the solution by Levenberg-Marquardt, with all factors.

    Raises:
        OptimizationError: a factor fails.
    """
    solver = _Solver(factors, start)
    solver.iterate(FINE)
    return RobustSolution(factors, solver.values, (), solver.iterations, solver.converged)


class _Solver:
    """Levenberg-Marquardt, with looks in between.

    Args:
        factors: of the graph.
        start: values of all its variables.

    Raises:
        OptimizationError: a factor fails.
    """

    def __init__(self, factors: gtsam.NonlinearFactorGraph, start: gtsam.Values) -> None:
        parameters = gtsam.LevenbergMarquardtParams()
        parameters.setlambdaUpperBound(MOST_DAMPING)
        with failing_as("the factor graph cannot be solved"):
            self._optimizer = gtsam.LevenbergMarquardtOptimizer(factors, start, parameters)
        self.converged = False

    @property
    def values(self) -> gtsam.Values:
        """The solution so far."""
        return self._optimizer.values()

    @property
    def iterations(self) -> int:
        """How many there were."""
        return int(self._optimizer.iterations())

    def iterate(self, tolerance: float) -> None:
        """Iterate until the error falls by no more than a share of itself, or by nothing at all.

        After :data:`MOST_ITERATIONS` in all it has not ``converged``.

        Raises:
            OptimizationError: a factor fails.
        """
        with failing_as("the factor graph cannot be solved"):
            self.converged = False
            while self.iterations < MOST_ITERATIONS and not self.converged:
                before = self._optimizer.error()
                self._optimizer.iterate()
                gain = before - self._optimizer.error()
                self.converged = not gain > max(tolerance * before, NOTHING)


def error_of(factors: gtsam.NonlinearFactorGraph, values: gtsam.Values) -> float:
    """Return half the sum of squared whitened residuals. Raises OptimizationError as solve does."""
    with failing_as("a factor fails in the solution"):
        return float(factors.error(values))


def solve_robustly(
    low: LowLayers,
    concepts: ConceptFactors,
    start: gtsam.Values,
    keys: Keys,
    refusals: Sequence[Refusal] = (),
) -> RobustSolution:
    """Solve, switch off the worst misfits, and solve again until all that remains fits.

    Of the misfits of one stretch of the drive only the worst go: they may be what bends the others.

    Args:
        low: the low layers.
        concepts: the concepts' factors.
        start: where to begin; variables that it lacks begin at their initial values.
        keys: the keys of the planes.
        refusals: what was switched off before and stays so.
    """
    off, iterations, near = list(refusals), 0, _stretches(low, keys)
    values = start
    while True:
        kept = _kept(concepts, off)
        factors, values = _assemble(low, concepts, kept, values)
        solver = _Solver(factors, values)
        for tolerance in (ROUGH, FINE):
            solver.iterate(tolerance)
            values = solver.values
            worst = _worst(concepts, kept, values, near)
            if worst:
                break
        iterations += solver.iterations
        off += worst
        if not worst:
            return RobustSolution(factors, values, off, iterations, solver.converged)


def _kept(concepts: ConceptFactors, off: Sequence[Refusal]) -> list[FactorGroup]:
    gone = {(refusal.concept, refusal.node, refusal.surfaces) for refusal in off}
    return [g for g in concepts.groups if (g.concept, g.node, g.surfaces) not in gone]


def _assemble(
    low: LowLayers, concepts: ConceptFactors, groups: Sequence[FactorGroup], start: gtsam.Values
) -> tuple[gtsam.NonlinearFactorGraph, gtsam.Values]:
    factors = gtsam.NonlinearFactorGraph(low.graph)
    for group in groups:
        for index in group.indices:
            factors.add(concepts.graph.at(index))
    values = gtsam.Values(start)
    for initial in (concepts.values, low.values):
        values.insert(initial.extract([key for key in initial.keys() if not values.exists(key)]))  # noqa: SIM118
    return factors, values.extract(factors.keyVector())


def _stretches(low: LowLayers, keys: Keys) -> dict[int, set[int]]:
    """Return the stretches of the drive that saw each plane, by the plane's key."""
    return {
        keys.surface(surface): {row // STRETCH for row in rows}
        for surface, rows in low.observers.items()
    }


def _worst(
    concepts: ConceptFactors,
    groups: Sequence[FactorGroup],
    values: gtsam.Values,
    near: Mapping[int, set[int]],
) -> list[Refusal]:
    """Return the misfits to switch off next."""
    own = concepts.values.dims()
    found = []
    for group in groups:
        factors = [concepts.graph.at(index) for index in group.indices]
        refusal = misfit(group.concept, group.node, group.surfaces, factors, own, values)
        if refusal is not None:
            keys = keys_of(factors)
            found.append((refusal, set[int]().union(*(near.get(key, ()) for key in keys))))
    return worst_of(found)


def misfit(
    concept: str,
    node: int,
    surfaces: tuple[int, ...],
    factors: Sequence[gtsam.NonlinearFactor],
    own: Mapping[int, int],
    values: gtsam.Values,
) -> Refusal | None:
    """Return why factors that stand or fall together contradict a solution, None if they fit.

    Args:
        concept: whose they are.
        node: id of the concept's node.
        surfaces: ids of the surfaces of a tie.
        factors: all of them.
        own: degrees of freedom of variables that nothing else refers to, by key.
        values: the solution.

    Raises:
        ConceptError: a factor fails.
    """
    freedom = sum(factor.dim() for factor in factors)
    freedom -= sum(own.get(key, 0) for key in keys_of(factors))
    try:
        squares = 2 * sum(factor.error(values) for factor in factors)
    except Exception as error:  # a third party's factors may raise anything
        raise ConceptError(f"factor of {concept} {node} fails: {one_line(error)}") from error
    squares = inf if isnan(squares) else squares  # which no threshold admits
    threshold = float(chdtri(freedom, REJECTION)) if freedom > 0 else inf
    if squares <= threshold and squares < inf:
        return None
    return Refusal(concept, node, surfaces, squares, threshold, freedom)


def keys_of(factors: Sequence[gtsam.NonlinearFactor]) -> set[int]:
    """Return the keys of all variables that factors refer to."""
    return {key for factor in factors for key in factor.keys()}  # noqa: SIM118


def worst_of(misfits: Sequence[tuple[Refusal, set[int]]]) -> list[Refusal]:
    """Return the misfits that no worse one was seen near, and those nearly as bad as these.

    Args:
        misfits: each with the stretches of the drive that saw its surfaces.
    """
    chosen, least = [], dict[int, float]()
    for refusal, stretches in sorted(misfits, key=lambda m: -m[0].excess):
        if all(refusal.excess >= least.get(some, 0.0) for some in stretches):
            chosen.append(refusal)
            least = dict.fromkeys(stretches, NEARLY * refusal.excess) | least
        else:  # it stays, and may be what bends the others
            least |= dict.fromkeys(stretches, inf)
    return chosen
