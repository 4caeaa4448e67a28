"""Concepts keyframe by keyframe, and their factors for an incremental or a batch optimiser."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from threading import RLock

import gtsam
import numpy as np
from numpy.typing import ArrayLike

from sgraph_concepts.errors import ConceptError, InputError, OptimizationError
from sgraph_concepts.spec import WALL_SURFACE
from sgraph_concepts.types import (
    ConceptNode,
    FactorContext,
    FactorResult,
    FloatArray,
    IntArray,
    Memory,
    SurfaceArrays,
)
from sgraph_core.backend.association import Association, Proposal, Same, associate
from sgraph_core.backend.checks import check_factors
from sgraph_core.backend.concept_factors import NO_FACTOR, made_by, ties
from sgraph_core.backend.keys import Keys
from sgraph_core.backend.low_layers import vertical_planes
from sgraph_core.detector import Detector
from sgraph_core.graph import SGraph
from sgraph_core.slam.clusters import Members
from sgraph_core.slam.estimate import moves
from sgraph_core.slam.handout import Handout, Ledger, Owner
from sgraph_core.slam.inference import LiveInference, Work
from sgraph_core.slam.nodes import LiveNodes, NodeChanges
from sgraph_core.slam.pool import Pool
from sgraph_core.slam.smoother import Smoother
from sgraph_core.tables import WallSurfaces

__all__ = ["ConceptTracker", "Update"]

FactorMaker = Callable[[ConceptNode, FactorContext], FactorResult]
Mapped = tuple[FloatArray, FloatArray]
"""Segment and normal of a surface."""


@dataclass(frozen=True, eq=False)
class Update:
    """What an update asks a factor graph to do, and what became of the nodes.

    Attributes:
        factors: factors to add.
        values: initial values of variables that are new.
        remove: indices of factors to remove, as :meth:`ConceptTracker.placed` was told them: those
            of nodes that are gone, or whose factors are among those to add.
        unused: keys of variables that no factor refers to any more; ISAM2 drops them by itself.
        nodes: what became of each concept's nodes.
        work: what was computed.
    """

    factors: gtsam.NonlinearFactorGraph
    values: gtsam.Values
    remove: list[int]
    unused: list[int]
    nodes: Mapping[str, NodeChanges]
    work: Work


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
        graph: a map to begin with; it is copied. Its nodes give their ids and names on.
        detector: infers the concepts.
        keys: the keys of keyframes, surfaces and nodes.
        factor_types: by concept, another factor type than the declared one; see
            :func:`sgraph_core.backend.concept_factors`.
        concepts: names of the concepts to infer, with what they group; all by default.
        tolerance_m: a surface of which no end has moved farther since it was last looked at counts
            as unmoved.

    Raises:
        InputError: the graph has pins, or the tolerance is negative.
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
        if self._graph.pins is not None:
            raise InputError("pins are for whole maps: a ConceptTracker takes a graph without them")
        if not tolerance_m >= 0:
            raise InputError(f"tolerance_m = {tolerance_m}: must not be negative")
        self._detector = Detector() if detector is None else detector
        self._keys = keys or Keys()
        self._tolerance = tolerance_m
        self._concepts = list(
            self._detector.registry.select(None if concepts is None else list(concepts))
        )
        self._grouping_surfaces = [c for c in self._concepts if c.spec.groups == WALL_SURFACE]
        self._makers = self._factor_makers(factor_types or {})
        self._nodes = {
            c.spec.name: LiveNodes(c.spec.name, self._graph.concepts.get(c.spec.name, ()))
            for c in self._concepts
        }
        self._ledger = Ledger()
        self._live: LiveInference | None = None
        self._mapped: dict[int, Mapped] = {}
        self._origin: FloatArray | None = None
        self._pending: set[int] = set(self._graph.wall_surfaces.ids.tolist())
        self._observed: dict[int, int] = {}
        self._seen = Pool(
            id=np.empty(0, np.int64), segment=np.empty((0, 2, 2)), normal=np.empty((0, 2))
        )
        self._begin_to_see(np.unique(self._graph.observations.surface_ids).tolist())
        self._newly_observed: set[int] = set()
        self._unmade = False
        self._proposals: dict[Owner, Sequence[tuple[int, int]]] = {}
        self._ties: dict[Owner, Same] = {}
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
        """Return a copy of the map with its concepts; the time this takes grows with the map."""
        with self._lock:
            graph = self._graph.copy()
            for concept in self._concepts:
                name, groups = concept.spec.name, concept.spec.groups
                graph.concepts[name] = self.nodes(name)
                if groups != WALL_SURFACE:
                    graph.groups[name] = groups
            return graph

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
        self, surface_id: int, keyframe_id: int, plane: ArrayLike, sigmas: ArrayLike
    ) -> None:
        """Add an observation, as :meth:`sgraph_core.SGraph.observe` does.

        From the first one on, the surface has a plane variable, which the concepts' factors use:
        it must be in the graph by the time that the next update's factors are added to it.
        """
        with self._lock:
            self._graph.observe(surface_id, keyframe_id, plane, sigmas)
            if surface_id not in self._observed:
                self._begin_to_see([surface_id])
                self._newly_observed.add(surface_id)

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
            self._see_moved(now)
            for surface, segment in zip(now.ids.tolist(), now.segments, strict=True):
                if surface in self._mapped:
                    moved = np.abs(segment - self._mapped[surface][0]).max()
                    if moved > self._tolerance:
                        self._pending.add(surface)

    def follow(self, values: gtsam.Values) -> None:
        """Move keyframes and surfaces to where an optimiser has them.

        A surface is carried along by the keyframes that observed it, and put onto its plane. The
        time this takes grows with the map.

        Args:
            values: of variables on the tracker's keys; what it does not hold stays where it is.

        Raises:
            InputError: a value breaks the map file's rules.
        """
        with self._lock:
            self.move(*moves(self._graph, self._keys, values))

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
            if self._smoother is not None:
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
            OptimizationError: as :meth:`optimize` raises it, on a graph of the tracker's own.
        """
        with self._lock:
            self._require_placed()
            proposals = [
                Proposal(owner[0], owner[1], pairs) for owner, pairs in self._proposals.items()
            ]
            proposed = {frozenset(pair) for proposal in proposals for pair in proposal.pairs}
            same = [pair for pair in self._ties.values() if frozenset(pair.pair) in proposed]
            new = associate(self._graph, proposals, Association(same)).same
            tied: dict[Owner, Same] = {("same", *pair.pair): pair for pair in (*same, *new)}
            fresh = {owner: pair for owner, pair in tied.items() if owner not in self._ties}
            factors = ties(list(fresh.values()), self._graph, self._keys)
            handout = self._ledger.prepare(
                self._ties.keys() - tied.keys(), list(zip(fresh, factors, strict=True))
            )
            self._ledger.commit(handout)
            self._ties = tied
            update = _update_of(handout, {}, Work())
            if self._smoother is not None:
                self._take(self._smoother, update)
            return update

    def optimize(self) -> Update:
        """Update, optimise the map with its concepts by ISAM2, and :meth:`follow` the solution.

        Raises:
            InputError: the factors of an update went to a graph of the caller's.
            OptimizationError: odometry does not connect the keyframes, or the problem is
                under-determined; then the next call builds the graph anew.
            SGraphError: as :meth:`update` raises them.
        """
        with self._lock:
            if self._smoother is None and self._ledger.used:
                raise InputError("factors went to a graph of the caller's: optimise that")
            smoother = self._smoother or Smoother(self._keys)
            smoother.check(self._graph)
            update = self._update()
            self._take(smoother, update)
            return update

    def _take(self, smoother: Smoother, update: Update) -> None:
        """Take an update's factors into the tracker's own graph, and follow the solution."""
        try:
            self._ledger.placed(smoother.add(self._graph, update))
        except OptimizationError:
            self._smoother, self._ledger, self._ties = None, Ledger(), {}
            self._unmade = True
            raise
        self._smoother = smoother
        self.follow(smoother.values)

    def _require_placed(self) -> None:
        if self._ledger.waiting:
            raise InputError(
                f"the last update has {self._ledger.waiting} factors: "
                "say with placed() at which indices they are"
            )

    def _update(self) -> Update:
        self._require_placed()
        anew = self._live is None
        surfaces = self._ordered(sorted(self._pending), self._mapped if anew else {})
        live = self._live or self._begin(surfaces)
        self._live = None  # kept only if all goes well
        concerned, work = live.update(surfaces)
        changes = self._changes(live, concerned, anew)
        handout = self._ledger.prepare(*self._factors(changes))

        self._live = live if self._mapped or len(surfaces) else None
        for name, change in changes.items():
            self._nodes[name].apply(change)
        self._ledger.commit(handout)
        self._mapped |= {
            int(i): (segment, normal)
            for i, segment, normal in zip(
                surfaces.ids, surfaces.segments, surfaces.normals, strict=True
            )
        }
        self._pending, self._newly_observed, self._unmade = set(), set(), False
        for owner in handout.gone:
            self._proposals.pop(owner, None)
        self._proposals |= {owner: result.same for owner, result in handout.made}
        return _update_of(handout, changes, work)

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
                change, there = nodes.compare({m: live.confidence(name, m) for m in members})
                gone = [node.id for node in change.removed]
                change = nodes.shaped(change, live.shapes(name, gone, there))
            elif anew or changes[groups]:
                grouped = self._nodes[groups].after(changes[groups])
                before = list(nodes.by_id.values())
                change = nodes.replaced_by(live.nodes_of_nodes(concept, grouped, before))
            changes[name] = change
        return changes

    def _factors(
        self, changes: Mapping[str, NodeChanges]
    ) -> tuple[list[Owner], list[tuple[Owner, FactorResult]]]:
        """Return the nodes whose factors go, and those with new factors."""
        gone: list[Owner] = [
            (name, node.id) for name, change in changes.items() for node in change.removed
        ]
        made: list[tuple[Owner, FactorResult]] = []
        seen = self._seen
        surfaces = SurfaceArrays(seen["id"], seen["segment"], seen["normal"])
        for name, make in self._makers.items():
            change, nodes = changes[name], self._nodes[name]
            after = nodes.after(change)
            concerned = [node for i in self._newly_observed for node in nodes.having(i)]
            wanted = {node.id: node for node in (*concerned, *change.changed, *change.added)}
            for node in change.removed:
                wanted.pop(node.id, None)
            memory = Memory()
            for node in after if self._unmade else sorted(wanted.values(), key=lambda n: n.id):
                context = self._context(name, node, after, surfaces, memory)
                result = made_by(make, name, node, context)
                check_factors(
                    f"factor of {name} {node.id}", result, _planes(context), gtsam.Values()
                )
                made.append(((name, node.id), result))
        return gone, made

    def _context(
        self,
        concept: str,
        node: ConceptNode,
        nodes: Sequence[ConceptNode],
        surfaces: SurfaceArrays,
        memory: Memory,
    ) -> FactorContext:
        members = [member for member in node.members if member in self._observed]
        rows = np.array([self._observed[member] for member in members], np.int64)
        segments = surfaces.segments[rows]
        planes = vertical_planes(segments, surfaces.normals[rows])
        return FactorContext(
            {member: self._keys.surface(member) for member in members},
            dict(zip(members, planes, strict=True)),
            dict(zip(members, segments, strict=True)),
            nodes,
            partial(self._keys.node, concept, node.id),
            surfaces,
            memory,
        )

    def _begin_to_see(self, ids: Sequence[int]) -> None:
        """Take in surfaces that are observed for the first time."""
        new = self._ordered(ids)
        rows = self._seen.add(len(ids), id=new.ids, segment=new.segments, normal=new.normals)
        self._observed.update(zip(ids, rows.tolist(), strict=True))

    def _see_moved(self, surfaces: SurfaceArrays) -> None:
        """Put those of the surfaces that are observed where they are now."""
        which = [k for k, i in enumerate(surfaces.ids.tolist()) if i in self._observed]
        moved = surfaces.take(np.array(which, np.int64))
        rows = [self._observed[i] for i in moved.ids.tolist()]
        self._seen["segment"][rows] = moved.segments
        self._seen["normal"][rows] = moved.normals

    def _factor_makers(self, factor_types: Mapping[str, str]) -> dict[str, FactorMaker]:
        registry = self._detector.registry
        for name in factor_types:
            registry[name]  # raises if there is none
        makers = {}
        for concept in self._grouping_surfaces:
            name = concept.spec.name
            reference = factor_types.get(name, concept.spec.factor)
            if reference not in (None, NO_FACTOR):
                makers[name] = registry.part(name, "factor", reference)
        return makers

    def _ordered(
        self, ids: Sequence[int], known: Mapping[int, Mapped] | None = None
    ) -> SurfaceArrays:
        """Return surfaces as they are now, and others as they were last looked at."""
        rows = np.array([self._graph.surface_row(i) for i in ids], np.int64)
        now = _taken(self._graph.wall_surfaces, rows)
        rest = sorted((known or {}).keys() - set(ids))
        if known is None or not rest:
            return now
        return SurfaceArrays(
            np.concatenate([now.ids, rest]),
            np.concatenate([now.segments, [known[i][0] for i in rest]]),
            np.concatenate([now.normals, [known[i][1] for i in rest]]),
        )


def _taken(table: WallSurfaces, rows: IntArray) -> SurfaceArrays:
    return WallSurfaces(
        table.ids[rows], table.segments[rows], table.normals[rows], table.heights[rows]
    ).ordered()


def _update_of(handout: Handout, nodes: Mapping[str, NodeChanges], work: Work) -> Update:
    return Update(handout.factors, handout.values, handout.remove, handout.unused, nodes, work)


def _planes(context: FactorContext) -> dict[int, FloatArray]:
    return {key: context.planes[member] for member, key in context.plane_keys.items()}
