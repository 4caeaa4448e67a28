"""Concepts keyframe by keyframe, and their factors for an incremental or a batch optimiser."""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from copy import deepcopy
from dataclasses import replace
from threading import RLock

import gtsam
import numpy as np
from numpy.typing import ArrayLike

from sgraph_concepts.errors import ConceptError, InputError
from sgraph_concepts.spec import WALL_SURFACE
from sgraph_concepts.types import ConceptNode, FactorResult, FloatArray, Memory, SurfaceArrays
from sgraph_core.backend.association import Proposal, Same
from sgraph_core.backend.keys import Keys
from sgraph_core.backend.observed import observed_in
from sgraph_core.backend.robust import Refusal
from sgraph_core.detector import Detector
from sgraph_core.graph import Pins, SGraph
from sgraph_core.nodes import check_nodes
from sgraph_core.pins import PINNED_CONCEPT, between_mapped, check_pins
from sgraph_core.slam.clusters import Members
from sgraph_core.slam.estimate import moves
from sgraph_core.slam.factors import FactorMakers
from sgraph_core.slam.handout import Ledger, Owner
from sgraph_core.slam.inference import LiveInference, Work
from sgraph_core.slam.misfits import Misfits
from sgraph_core.slam.nodes import LiveNodes, NodeChanges
from sgraph_core.slam.observed import ObservedSurfaces
from sgraph_core.slam.pins import PairPins
from sgraph_core.slam.smoother import Smoother
from sgraph_core.slam.ties import tied_anew
from sgraph_core.slam.update import Update, update_of

__all__ = ["ConceptTracker"]

MOST_STEPS = 30
"""Of ISAM2 in one call, while there are misfits."""
Subject = Owner | tuple[str, Members]
"""A tie, or a concept and the members of a node."""
Mapped = tuple[FloatArray, FloatArray]
"""Segment and normal of a surface."""


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
        self._detector = Detector() if detector is None else detector
        self._keys = keys or Keys()
        self._tolerance = tolerance_m
        self._concepts = list(
            self._detector.registry.select(None if concepts is None else list(concepts))
        )
        self._grouping_surfaces = [c for c in self._concepts if c.spec.groups == WALL_SURFACE]
        self._makers = FactorMakers(
            self._detector.registry, self._grouping_surfaces, factor_types or {}, self._keys
        )
        self._nodes = {
            c.spec.name: LiveNodes(c.spec.name, self._graph.concepts.get(c.spec.name, ()))
            for c in self._concepts
        }
        self._ledger, self._misfits = Ledger(), Misfits(self._keys)
        self._off: dict[Subject, Refusal] = {}
        self._live: LiveInference | None = None
        self._mapped: dict[int, Mapped] = {}
        self._origin: FloatArray | None = None
        self._pending: set[int] = set(self._graph.wall_surfaces.ids.tolist())
        self._observed = ObservedSurfaces()
        mapped = observed_in(self._graph)
        self._observed.add(mapped.surfaces, mapped.first_seen)
        self._seen_otherwise: set[int] = set()
        """Surfaces that are observed for the first time, or by an earlier keyframe than known."""
        self._unmade = True
        self._ties: dict[Owner, Same] = {}
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
            if concept not in self._nodes:
                raise ConceptError(f"concept {concept!r} is not inferred by this tracker")
            return [node for _, node in sorted(self._nodes[concept].by_id.items())]

    def snapshot(self) -> SGraph:
        """Return a copy of the map with its concepts; the time this takes grows with the map.

        Of the pins it holds the names and those between surfaces that are mapped.
        """
        with self._lock:
            graph = self._graph.copy()
            if graph.pins is not None:
                graph.pins = between_mapped(graph.pins, graph.wall_surfaces.ids.tolist())
            for concept in self._concepts:
                name, groups = concept.spec.name, concept.spec.groups
                graph.concepts[name] = self.nodes(name)
                if groups != WALL_SURFACE:
                    graph.groups[name] = groups
            return graph

    @property
    def pins(self) -> Pins:
        """A copy of what is pinned; pairs that wait for a surface to be mapped are included."""
        with self._lock:
            return deepcopy(self._pins)

    @property
    def _pins(self) -> Pins:
        return self._graph.pins or Pins()

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
            ties = [self._off[owner] for owner in self._ties if owner in self._off]
            nodes = [
                replace(self._off[name, frozenset(node.members)], node=node.id)
                for name in self._makers.concepts
                for node in self.nodes(name)
                if (name, frozenset(node.members)) in self._off
            ]
            return nodes + ties

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
            self._pending.add(surface_id)

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
            keyframe = self._graph.keyframe_row(keyframe_id)
            if surface_id not in self._observed:
                self._observed.add(self._ordered([surface_id]), np.array([keyframe]))
                self._seen_otherwise.add(surface_id)
            elif self._observed.see(surface_id, keyframe):
                self._seen_otherwise.add(surface_id)

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
            now = self._ordered(list(surfaces or {}))
            self._observed.move(now)
            for surface, segment in zip(now.ids.tolist(), now.segments, strict=True):
                if surface in self._mapped:
                    moved = np.abs(segment - self._mapped[surface][0]).max()
                    if moved > self._tolerance:
                        self._pending.add(surface)

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
            verdict = self._misfits.verdict
            if not self._ledger.waiting:
                verdict = self._misfits.judge(self._graph, values, *planes)
            self.move(keyframes, surfaces)
            self._misfits.verdict = verdict

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
            self._ledger.placed(indices)

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
            self._ledger.require_placed()
            # what the last solution left unsolved is built anew
            rebuilt = self.optimize() if self._owns and self._smoother is None else None
            if self._smoother is not None:
                self._smoother.check(self._graph)
            tied, made = tied_anew(
                self._graph, self._keys, self._proposals(), self._ties, self._off
            )
            handout = self._ledger.prepare(self._ties.keys() - tied.keys(), made)
            self._ledger.commit(handout)
            self._misfits.take(handout, tied)
            self._ties = tied
            self._off = {
                subject: refusal
                for subject, refusal in self._off.items()
                if len(subject) == 2 or subject in tied
            }
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
            if self._ledger.used and not self._owns:
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
        refusals, off = list[Refusal](), self._off
        try:
            self._ledger.placed(smoother.add(self._graph, update))
            for steps_left in reversed(range(MOST_STEPS)):
                values = smoother.values
                keyframes, surfaces, planes = moves(self._graph, self._keys, values)
                self._misfits.verdict = self._misfits.judge(self._graph, values, *planes)
                if not self._misfits.verdict.waiting or not steps_left:
                    break
                step = self._without_misfits()
                self._ledger.placed(smoother.add(self._graph, step, anew=True))
                refusals += step.refusals
            self.move(keyframes, surfaces)
        except BaseException:  # an interruption too
            self._smoother, self._ties, self._off, self._unmade = None, {}, off, True
            self._ledger, self._misfits = Ledger(), Misfits(self._keys)
            raise
        self._smoother = smoother
        return refusals

    def _without_misfits(self) -> Update:
        """Return an update that removes the factors of the misfits found, and nothing else."""
        found = self._misfits.verdict.found
        handout = self._ledger.prepare([], [(owner, FactorResult()) for owner in found])
        self._ledger.commit(handout)
        self._off = self._off | {self._subject(owner): why for owner, why in found.items()}
        self._misfits.take(handout, self._ties)
        return update_of(handout, {}, list(found.values()), Work())

    def _update(self) -> Update:
        self._ledger.require_placed()
        anew = self._live is None
        surfaces = self._ordered(sorted(self._pending))
        if anew:
            surfaces = self._with_mapped(surfaces)
        live = self._live or self._begin(surfaces)
        self._live = None  # kept only if all goes well
        pins = between_mapped(self._pins, self._graph.wall_surfaces.ids.tolist())
        concerned, work = live.update(surfaces, PairPins(pins))
        changes = self._changes(live, concerned, anew)
        found = self._misfits.verdict.found
        refused = {owner: self._subject(owner) for owner in found}
        off = self._off | {refused[owner]: refusal for owner, refusal in found.items()}
        gone, made = self._factors(changes, off)
        replaced = {*gone, *(owner for owner, _ in made)}
        left = [owner for owner in found if owner not in replaced]
        handout = self._ledger.prepare(gone, [*made, *((owner, FactorResult()) for owner in left)])

        self._live = live if self._mapped or len(surfaces) else None
        for name, change in changes.items():
            self._nodes[name].apply(change)
        self._ledger.commit(handout)
        looked_at = zip(surfaces.segments, surfaces.normals, strict=True)
        self._mapped |= zip(surfaces.ids.tolist(), looked_at, strict=True)
        self._pending, self._seen_otherwise, self._unmade = set(), set(), False
        self._off = off
        stay = [owner for owner in found if owner not in gone]
        refusals = [found[owner] for owner in stay if self._subject(owner) == refused[owner]]
        self._misfits.take(handout, self._ties)
        return update_of(handout, changes, refusals, work)

    def _subject(self, owner: Owner) -> Subject:
        """Return what is refused when factors of an owner are: a tie, or a node of its members."""
        if owner in self._ties:
            return owner
        return owner[0], frozenset(self._nodes[owner[0]].by_id[owner[1]].members)

    def _begin(self, surfaces: SurfaceArrays) -> LiveInference:
        if self._origin is None and len(surfaces):
            self._origin = np.round(surfaces.midpoints.mean(axis=0))
        origin = np.zeros(2) if self._origin is None else self._origin
        return LiveInference(self._detector, self._grouping_surfaces, origin)

    def _changes(
        self, live: LiveInference, concerned: Mapping[str, set[Members]], anew: bool
    ) -> dict[str, NodeChanges]:
        changes: dict[str, NodeChanges] = {}
        for concept in self._concepts:
            name, groups = concept.spec.name, concept.spec.groups
            nodes, change = self._nodes[name], NodeChanges()
            if groups == WALL_SURFACE:
                members = concerned[name] | (nodes.members if anew else set())
                names = self._pins.room_names if name == PINNED_CONCEPT else {}
                change, there = nodes.compare({m: live.confidence(name, m) for m in members}, names)
                gone = [node.id for node in change.removed]
                change = nodes.shaped(change, live.shapes(name, gone, there))
                change = nodes.named(change, names)
            elif anew or changes[groups]:
                grouped = self._nodes[groups].after(changes[groups])
                now = live.nodes_of_nodes(concept, grouped, nodes.identified)
                change = nodes.replaced_by(now)
            changes[name] = change
        return changes

    def _factors(
        self, changes: Mapping[str, NodeChanges], off: Container[Subject]
    ) -> tuple[list[Owner], list[tuple[Owner, FactorResult]]]:
        """Return the nodes whose factors go, and those with new ones: none where they are off."""
        gone: list[Owner] = [
            (name, node.id) for name, change in changes.items() for node in change.removed
        ]
        made: list[tuple[Owner, FactorResult]] = []
        observed = self._observed.all
        for name in self._makers.concepts:
            change, nodes = changes[name], self._nodes[name]
            after = nodes.after(change)
            concerned = [node for i in self._seen_otherwise for node in nodes.having(i)]
            wanted = {node.id: node for node in (*concerned, *change.changed, *change.added)}
            for node in change.removed:
                wanted.pop(node.id, None)
            memory = Memory()
            for node in after if self._unmade else sorted(wanted.values(), key=lambda n: n.id):
                is_off = (name, frozenset(node.members)) in off
                result = self._makers.make(name, node, after, observed, memory)
                made.append(((name, node.id), FactorResult() if is_off else result))
        return gone, made

    def _proposals(self) -> list[Proposal]:
        """Return the pairs that all nodes take for one, as the map is now."""
        return [
            proposal
            for name in self._makers.concepts
            for proposal in self._makers.proposals(
                name, list(self._nodes[name].by_id.values()), self._observed.all
            )
        ]

    def _ordered(self, ids: Sequence[int]) -> SurfaceArrays:
        """Return surfaces as they are now."""
        rows = np.array([self._graph.surface_row(i) for i in ids], np.int64)
        return self._graph.wall_surfaces.take(rows).ordered()

    def _with_mapped(self, now: SurfaceArrays) -> SurfaceArrays:
        """Return surfaces, and all others as they were last looked at."""
        rest = sorted(self._mapped.keys() - set(now.ids.tolist()))
        if not rest:
            return now
        return SurfaceArrays(
            np.concatenate([now.ids, rest]),
            np.concatenate([now.segments, [self._mapped[i][0] for i in rest]]),
            np.concatenate([now.normals, [self._mapped[i][1] for i in rest]]),
        )
