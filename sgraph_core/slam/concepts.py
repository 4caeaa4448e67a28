"""The nodes of all concepts of a map that changes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sgraph_concepts.registry import RegisteredConcept
from sgraph_concepts.spec import WALL_SURFACE
from sgraph_concepts.types import FloatArray, SurfaceArrays
from sgraph_core.detector import Detector
from sgraph_core.graph import Pins, SGraph
from sgraph_core.pins import PINNED_CONCEPT, between_mapped
from sgraph_core.slam.clusters import Members
from sgraph_core.slam.inference import LiveInference, Work
from sgraph_core.slam.nodes import LiveNodes, NodeChanges
from sgraph_core.slam.observed import surfaces_of
from sgraph_core.slam.pins import PairPins

__all__ = ["LiveConcepts", "Step"]

Mapped = tuple[FloatArray, FloatArray]
"""Segment and normal of a surface."""


@dataclass(frozen=True, eq=False)
class Step:
    """What became of the nodes since the last step.

    Attributes:
        changes: by concept.
        work: what was computed.
        surfaces: that were looked at.
        live: the inference that knows the map as it is now.
    """

    changes: Mapping[str, NodeChanges]
    work: Work
    surfaces: SurfaceArrays
    live: LiveInference


class LiveConcepts:
    """Infers the nodes again where the map changes.

    Attributes:
        concepts: that are inferred, each after what it groups.
        nodes: of each.

    Args:
        graph: the map; whoever changes its surfaces says so.
        detector: infers the concepts.
        concepts: that are inferred, each after what it groups.
        tolerance_m: a surface of which no end has moved farther since it was last looked at counts
            as unmoved.
    """

    def __init__(
        self,
        graph: SGraph,
        detector: Detector,
        concepts: Sequence[RegisteredConcept],
        tolerance_m: float,
    ) -> None:
        self._graph, self._detector, self._tolerance = graph, detector, tolerance_m
        self.concepts = concepts
        self.nodes = {
            c.spec.name: LiveNodes(c.spec.name, graph.concepts.get(c.spec.name, ()))
            for c in concepts
        }
        self._live: LiveInference | None = None
        self._mapped: dict[int, Mapped] = {}
        self._origin: FloatArray | None = None
        self._pending: set[int] = set(graph.wall_surfaces.ids.tolist())

    @property
    def of_surfaces(self) -> list[RegisteredConcept]:
        """The concepts that group wall surfaces."""
        return [concept for concept in self.concepts if concept.spec.groups == WALL_SURFACE]

    def add(self, surface: int) -> None:
        """Look at a new surface, by id, in the next step."""
        self._pending.add(surface)

    def move(self, now: SurfaceArrays) -> None:
        """Look in the next step at those surfaces that have moved by more than the tolerance."""
        for surface, segment in zip(now.ids.tolist(), now.segments, strict=True):
            if surface in self._mapped:
                moved = np.abs(segment - self._mapped[surface][0]).max()
                if moved > self._tolerance:
                    self._pending.add(surface)

    def step(self) -> Step:
        """Return what the changes since the last step can reach.

        Nothing is remembered before :meth:`commit`. Without it the next step computes the whole
        map again.
        """
        anew = self._live is None
        surfaces = surfaces_of(self._graph, sorted(self._pending))
        if anew:
            surfaces = self._with_mapped(surfaces)
        live = self._live or self._begin(surfaces)
        self._live = None
        pins = between_mapped(self._pins, self._graph.wall_surfaces.ids.tolist())
        concerned, work = live.update(surfaces, PairPins(pins))
        return Step(self._changes(live, concerned, anew), work, surfaces, live)

    def commit(self, step: Step) -> None:
        """Remember a step."""
        self._live = step.live if self._mapped or len(step.surfaces) else None
        for name, change in step.changes.items():
            self.nodes[name].apply(change)
        looked_at = zip(step.surfaces.segments, step.surfaces.normals, strict=True)
        self._mapped |= zip(step.surfaces.ids.tolist(), looked_at, strict=True)
        self._pending = set()

    @property
    def _pins(self) -> Pins:
        return self._graph.pins or Pins()

    def _begin(self, surfaces: SurfaceArrays) -> LiveInference:
        if self._origin is None and len(surfaces):
            self._origin = np.round(surfaces.midpoints.mean(axis=0))
        origin = np.zeros(2) if self._origin is None else self._origin
        return LiveInference(self._detector, self.of_surfaces, origin)

    def _changes(
        self, live: LiveInference, concerned: Mapping[str, set[Members]], anew: bool
    ) -> dict[str, NodeChanges]:
        changes: dict[str, NodeChanges] = {}
        for concept in self.concepts:
            name, groups = concept.spec.name, concept.spec.groups
            nodes, change = self.nodes[name], NodeChanges()
            if groups == WALL_SURFACE:
                members = concerned[name] | (nodes.members if anew else set())
                names = self._pins.room_names if name == PINNED_CONCEPT else {}
                change, there = nodes.compare({m: live.confidence(name, m) for m in members}, names)
                gone = [node.id for node in change.removed]
                change = nodes.shaped(change, live.shapes(name, gone, there))
                change = nodes.named(change, names)
            elif anew or changes[groups]:
                grouped = self.nodes[groups].after(changes[groups])
                now = live.nodes_of_nodes(concept, grouped, nodes.identified)
                change = nodes.replaced_by(now)
            changes[name] = change
        return changes

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
