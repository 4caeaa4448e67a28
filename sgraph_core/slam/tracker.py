"""Concepts keyframe by keyframe, and their factors for an incremental or a batch optimiser."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import replace
from threading import RLock

import gtsam
from numpy.typing import ArrayLike

from sgraph_concepts.errors import ConceptError, InputError
from sgraph_concepts.spec import WALL_SURFACE
from sgraph_concepts.types import ConceptNode
from sgraph_core.backend.keys import Keys
from sgraph_core.backend.robust import Refusal
from sgraph_core.detector import Detector
from sgraph_core.graph import Pins, SGraph
from sgraph_core.nodes import check_nodes
from sgraph_core.pins import between_mapped, check_pins
from sgraph_core.slam.concepts import LiveConcepts
from sgraph_core.slam.estimate import moves
from sgraph_core.slam.factors import LiveFactors
from sgraph_core.slam.inference import Work
from sgraph_core.slam.makers import FactorMakers
from sgraph_core.slam.observed import surfaces_of
from sgraph_core.slam.smoother import Smoother
from sgraph_core.slam.update import Update, update_of

__all__ = ["ConceptTracker"]

MOST_STEPS = 30
"""Of ISAM2 in one call, while there are misfits."""


class ConceptTracker:
    """Infers concepts while a map is built, and keeps their factors in a factor graph up to date.

    SLAM code says what its front end finds (``add_keyframe``, ``add_odometry``,
    ``add_wall_surface``, ``observe``) and how its estimate moves the map (``move``), and calls
    ``update`` when it likes, at every keyframe say. The factors are on the caller's keys and go
    into the caller's graph; ``placed`` tells where. Or ``optimize`` does all of it, on an ISAM2 of
    the tracker's own.

    An update computes what the changes since the last one can reach. Its nodes are those that
    :meth:`sgraph_core.Detector.infer` finds on the whole map, see docs/slam.md.

    A call that raises changes nothing. The methods may be called from several threads; they take
    turns.

    Args:
        graph: a map to begin with; it is copied. Its nodes give their ids and names on, its pins
            hold, as in :meth:`pin`. Its occupancy grid is not used: the map moves over it.
        detector: infers the concepts.
        keys: the keys of keyframes, surfaces and nodes.
        factor_types: by concept, another factor type than the declared one; see
            :func:`sgraph_core.backend.concept_factors`.
        concepts: names of the concepts to infer, with what they group; all by default.
        tolerance_m: a surface of which no end has moved farther since it was last looked at counts
            as unmoved.

    Raises:
        InputError: the graph's pins contradict one another, a node of it breaks the map file's
            rules, or the tolerance is negative.
        ConceptError: a concept or a factor type is unknown.
    """

    def __init__(
        self,
        graph: SGraph | None = None,
        detector: Detector | None = None,
        keys: Keys | None = None,
        factor_types: Mapping[str, str] | None = None,
        concepts: Sequence[str] | None = None,
        tolerance_m: float = 0.02,
    ) -> None:
        self._lock = RLock()
        self._graph = SGraph() if graph is None else graph.copy()
        check_pins(self._graph.pins or Pins())
        check_nodes(self._graph.concepts, set(self._graph.wall_surfaces.ids.tolist()))
        if not tolerance_m >= 0:
            raise InputError(f"tolerance_m = {tolerance_m}: must not be negative")
        self._keys = keys or Keys()
        detector = Detector() if detector is None else detector
        selected = detector.registry.select(None if concepts is None else list(concepts))
        self._concepts = LiveConcepts(self._graph, detector, list(selected), tolerance_m)
        makers = FactorMakers(
            detector.registry, self._concepts.of_surfaces, factor_types or {}, self._keys
        )
        self._factors = LiveFactors(self._graph, self._keys, makers, self._concepts.nodes)
        self._owns = False
        """Whether the tracker optimises a graph of its own; it has no smoother after a failure."""
        self._smoother: Smoother | None = None

    # -- what there is -------------------------------------------------------------------------

    def nodes(self, concept: str) -> list[ConceptNode]:
        """Return the nodes of a concept as of the last update, by id.

        Raises:
            ConceptError: it is not inferred here.
        """
        with self._lock:
            if concept not in self._concepts.nodes:
                raise ConceptError(f"concept {concept!r} is not inferred by this tracker")
            return self._concepts.nodes[concept].in_order

    def snapshot(self) -> SGraph:
        """Return a copy of the map with its concepts; the time this takes grows with the map.

        Of the pins it holds the names and those between surfaces that are mapped.
        """
        with self._lock:
            graph = self._graph.copy()
            if graph.pins is not None:
                graph.pins = between_mapped(graph.pins, graph.wall_surfaces.ids.tolist())
            for concept in self._concepts.concepts:
                name, groups = concept.spec.name, concept.spec.groups
                graph.concepts[name] = self.nodes(name)
                if groups != WALL_SURFACE:
                    graph.groups[name] = groups
            return graph

    @property
    def pins(self) -> Pins:
        """A copy of what is pinned; pairs that wait for a surface to be mapped are included."""
        with self._lock:
            return deepcopy(self._graph.pins or Pins())

    def pin(self, pins: Pins) -> None:
        """Let pins hold from the next update on, instead of those before.

        Rooms are then as :meth:`sgraph_core.Detector.infer` finds them with these pins. A pair
        waits until both surfaces are mapped, a name until there is a room of its id.

        Args:
            pins: all of them: to add some, ``dataclasses.replace(tracker.pins, ...)``.

        Raises:
            InputError: they contradict one another, those that wait included, or name no pairs of
                ids.
        """
        check_pins(pins)
        with self._lock:
            self._graph.pins = deepcopy(pins)

    @property
    def refusals(self) -> list[Refusal]:
        """Why factors of nodes and ties that there are are switched off."""
        with self._lock:
            return self._factors.refusals

    # -- what the front end finds ----------------------------------------------------------------

    def add_keyframe(self, keyframe_id: int, pose: ArrayLike, stamp: float | None = None) -> None:
        """Add a keyframe, as :meth:`sgraph_core.SGraph.add_keyframe` does."""
        with self._lock:
            self._graph.add_keyframe(keyframe_id, pose, stamp)

    def add_odometry(self, from_id: int, to_id: int, pose: ArrayLike, sigmas: ArrayLike) -> None:
        """Add a motion, as :meth:`sgraph_core.SGraph.add_odometry` does."""
        with self._lock:
            self._graph.add_odometry(from_id, to_id, pose, sigmas)

    def add_wall_surface(
        self,
        surface_id: int,
        segment: ArrayLike,
        normal: ArrayLike,
        height: ArrayLike | None = None,
    ) -> None:
        """Add a wall surface, as :meth:`sgraph_core.SGraph.add_wall_surface` does."""
        with self._lock:
            self._graph.add_wall_surface(surface_id, segment, normal, height)
            self._concepts.add(surface_id)

    def observe(
        self,
        surface_id: int,
        keyframe_id: int,
        plane: ArrayLike,
        sigmas: ArrayLike,
        at: ArrayLike = (0.0, 0.0, 0.0),
    ) -> None:
        """Add an observation, as :meth:`sgraph_core.SGraph.observe` does.

        From the first one on, the surface has a plane variable, which the concepts' factors use:
        it must be in the graph by the time that the next update's factors are added to it.
        """
        with self._lock:
            self._graph.observe(surface_id, keyframe_id, plane, sigmas, at)
            self._factors.observe(surface_id, keyframe_id)

    def move(
        self,
        keyframes: Mapping[int, ArrayLike] | None = None,
        surfaces: Mapping[int, tuple[ArrayLike, ArrayLike]] | None = None,
    ) -> None:
        """Put keyframes and wall surfaces where the estimate has them, or let surfaces grow.

        Args:
            keyframes: poses by id, as in :meth:`add_keyframe`.
            surfaces: segments and normals by id, as in :meth:`add_wall_surface`.

        Raises:
            InputError: an id is unknown or a number breaks the map file's rules.
        """
        with self._lock:
            self._graph.move(keyframes, surfaces)
            now = surfaces_of(self._graph, surfaces or ())
            self._factors.move(now)
            self._concepts.move(now)

    def follow(self, values: gtsam.Values) -> None:
        """Move keyframes and surfaces to where an optimiser has them, and test the factors.

        A surface is carried along by the keyframes that observed it, and put onto its plane. The
        time this takes grows with the map. Factors that contradict the solution (the chi-squared
        test of :mod:`sgraph_core.backend.robust`) leave with the next update.

        Args:
            values: of variables on the tracker's keys; what it does not hold stays where it is.

        Raises:
            InputError: a value breaks the map file's rules.
            ConceptError: a plugin's factor fails.
        """
        with self._lock:
            keyframes, surfaces, planes = moves(self._graph, self._keys, values)
            verdict = self._factors.verdict
            if not self._factors.ledger.waiting:
                verdict = self._factors.judge(values, planes)
            self.move(keyframes, surfaces)
            self._factors.verdict = verdict

    # -- what follows --------------------------------------------------------------------------

    def update(self) -> Update:
        """Infer what the changes since the last update can reach; return what follows from it.

        Raises:
            InputError: the factors of the last update have not been placed, or go to the tracker's
                own graph.
            SGraphError: a plugin fails, as in :meth:`sgraph_core.Detector.infer` and
                :func:`sgraph_core.backend.concept_factors`. Everything is as before; the next
                update computes the whole map again.
        """
        with self._lock:
            if self._owns:
                raise InputError("this tracker optimises a graph of its own: call optimize()")
            return self._update()

    def placed(self, indices: Sequence[int]) -> None:
        """Say at which indices of the caller's graph the factors of the last update are.

        Args:
            indices: one for each, in their order: for ISAM2 what ``getNewFactorsIndices()`` of the
                result returns, those of the caller's own factors left out.

        Raises:
            InputError: there are more or fewer than factors.
        """
        with self._lock:
            self._factors.ledger.placed(indices)

    def associate(self) -> Update:
        """Tie surfaces that are one surface mapped twice, where the drive as a whole shows it.

        Nodes propose pairs of surfaces; :func:`sgraph_core.backend.association.associate` accepts
        those that a rigid correction explains. A tie goes when no node proposes its pair any more.
        The time this takes grows with the map: call it when the robot has come back somewhere.

        Raises:
            InputError: the factors of the last update have not been placed.
            ConceptError: a factor function fails, or proposes something else than pairs of observed
                surfaces.
            OptimizationError: sigmas differ by too much to tell how far the drive has drifted.
            SGraphError: as :meth:`optimize` raises them, on a graph of the tracker's own.
        """
        with self._lock:
            self._factors.ledger.require_placed()
            # what the last solution left unsolved is built anew
            rebuilt = self.optimize() if self._owns and self._smoother is None else None
            if self._smoother is not None:
                self._smoother.check(self._graph)
            handout = self._factors.tie_anew()
            if rebuilt is None:
                update = update_of(handout, {}, [], Work())
            else:
                update = update_of(handout, rebuilt.nodes, rebuilt.refusals, rebuilt.work)
            if self._smoother is not None:
                refusals = self._take(self._smoother, update)
                update = replace(update, refusals=[*update.refusals, *refusals])
            return update

    def optimize(self) -> Update:
        """Update, optimise the map with its concepts by ISAM2, and :meth:`follow` the solution.

        What contradicts it is switched off at once, and the map optimised again.

        Raises:
            InputError: the factors of an update went to a graph of the caller's, or the solution
                breaks the map file's rules.
            OptimizationError: odometry does not connect the keyframes, or the problem is
                under-determined.
            SGraphError: as :meth:`update` raises them. After a solution that fails the next call
                builds the graph anew, without ties until :meth:`associate` finds them again.
        """
        with self._lock:
            if self._factors.ledger.used and not self._owns:
                raise InputError("factors went to a graph of the caller's: optimise that")
            smoother = self._smoother or Smoother(self._keys)
            smoother.check(self._graph)
            update = self._update()
            self._owns = True
            return replace(update, refusals=[*update.refusals, *self._take(smoother, update)])

    def _take(self, smoother: Smoother, update: Update) -> list[Refusal]:
        """Take an update's factors into the tracker's own graph, and follow the solution.

        Returns:
            Why factors were switched off in the new solution.
        """
        refusals, off = list[Refusal](), self._factors.off
        try:
            self._factors.ledger.placed(smoother.add(self._graph, update))
            for steps_left in reversed(range(MOST_STEPS)):
                values = smoother.values
                keyframes, surfaces, planes = moves(self._graph, self._keys, values)
                self._factors.verdict = self._factors.judge(values, planes)
                if not self._factors.verdict.waiting or not steps_left:
                    break
                handout, found = self._factors.drop_misfits()
                step = update_of(handout, {}, found, Work())
                self._factors.ledger.placed(smoother.add(self._graph, step, anew=True))
                refusals += found
            self.move(keyframes, surfaces)
        except BaseException:  # an interruption too
            self._smoother = None
            self._factors.lose(off)
            raise
        self._smoother = smoother
        return refusals

    def _update(self) -> Update:
        self._factors.ledger.require_placed()
        step = self._concepts.step()
        exchange = self._factors.exchange(step.changes)
        self._concepts.commit(step)
        refusals = self._factors.commit(exchange)
        return update_of(exchange.handout, step.changes, refusals, step.work)
