"""Inference that keeps what it computed, and computes again only what a change can reach."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sgraph_concepts.errors import InputError
from sgraph_concepts.registry import RegisteredConcept
from sgraph_concepts.types import ConceptNode, FloatArray, NodeShape, SurfaceArrays
from sgraph_core.detector import Detector, Inference
from sgraph_core.slam.clusters import LiveClusters, Members
from sgraph_core.slam.fragments import LiveFragments
from sgraph_core.slam.pairs import LivePairs
from sgraph_core.slam.pins import NO_PINS, PairPins
from sgraph_core.slam.relations import LiveRelations
from sgraph_core.slam.shapes import LiveShapes
from sgraph_core.slam.support import LiveSupport

__all__ = ["LiveInference", "Work"]


@dataclass(frozen=True)
class Work:
    """What one update computed.

    Attributes:
        surfaces: wall surfaces preprocessed.
        pairs: pairs whose lines of sight were followed.
        rows: fragments that the scorers were given.
        clustered: fragments that the clusterers were given, of the concept with the most.
    """

    surfaces: int = 0
    pairs: int = 0
    rows: int = 0
    clustered: int = 0


class LiveInference:
    """The nodes of a map that changes, as :meth:`sgraph_core.Detector.infer` would find them.

    After an update that raises, its state is not to be relied on: make a new one.

    Args:
        detector: whose parts are used.
        concepts: what to infer; all of them group wall surfaces.
        origin: a point of the map, [2]: computing near it costs no precision.

    Raises:
        InputError: the detector's network relates other pairs than those that see each other.
    """

    def __init__(
        self, detector: Detector, concepts: Sequence[RegisteredConcept], origin: FloatArray
    ) -> None:
        if detector.scorer == "network" and detector.network.neighbours != "visible":
            raise InputError(
                f"the network relates each surface to the {detector.network.neighbours} ones: "
                "on a changing map they must be the visible ones"
            )
        self._detector, self._concepts = detector, concepts
        self._fragments, self._pins = LiveFragments(), NO_PINS
        self._pairs = LivePairs(self._fragments.fragments, origin, len(concepts))
        self._support = LiveSupport(self._fragments.fragments, self._pairs)
        self._relations = LiveRelations(detector, concepts, self._pairs)
        self._clusters = {
            concept.spec.name: LiveClusters(concept, column, detector, self._fragments, self._pairs)
            for column, concept in enumerate(concepts)
        }
        self._shapes = {
            concept.spec.name: LiveShapes(concept, detector, self._fragments, self._pairs)
            for concept in concepts
        }

    def update(
        self, surfaces: SurfaceArrays, pins: PairPins
    ) -> tuple[dict[str, set[Members]], Work]:
        """Take new surfaces in, and those among them that are known as they are now.

        Args:
            surfaces: in world coordinates.
            pins: all pins between surfaces that are known by now.

        Returns:
            By concept, the members of all nodes that may have come, gone or changed; and what was
            computed for it.
        """
        if not (len(surfaces) or pins.differing(self._pins)):
            return {concept.spec.name: set() for concept in self._concepts}, Work()
        self._pins = pins
        changed = self._fragments.update(surfaces, pins)
        pairs = self._pairs.update(changed)
        ends = np.union1d(pairs.ends, changed.added)
        supported = self._support.update(changed)
        rescored, rows = self._relations.update(np.union1d(ends, supported))
        concerned, most = {}, 0
        for (name, clusters), scored in zip(self._clusters.items(), rescored, strict=True):
            concerned[name], count = clusters.update(np.union1d(ends, scored), changed)
            most = max(most, count)
        self._fragments.fragments.settle()
        return concerned, Work(changed.preprocessed, pairs.looked, rows, most)

    def confidence(self, concept: str, members: Members) -> float | None:
        """Return how sure a concept's node of these members is, None if there is none."""
        return self._clusters[concept].confidence(members)

    def shapes(
        self, concept: str, gone: Iterable[int], there: Mapping[int, Members]
    ) -> dict[int, NodeShape]:
        """Return the shapes, by id, of the nodes next to those that came, went or changed.

        Args:
            concept: whose nodes.
            gone: ids of nodes that are no more.
            there: members of nodes that may be new or changed, by id.
        """
        rows = {node: self._clusters[concept].rows(members) for node, members in there.items()}
        return self._shapes[concept].update(gone, rows)

    def nodes_of_nodes(
        self,
        concept: RegisteredConcept,
        grouped: Sequence[ConceptNode],
        identified: Callable[[Sequence[ConceptNode]], Sequence[ConceptNode]],
    ) -> list[ConceptNode]:
        """Return the nodes of a concept that groups nodes, from all of these.

        Args:
            concept: the concept.
            grouped: all nodes that it groups.
            identified: gives nodes their ids and names.
        """
        rows = self._fragments.fragments.alive
        scene, _ = self._pairs.scene(rows, np.empty(0, np.int64))
        inference = Inference(self._detector, self._fragments.take(rows), scene)
        return inference.nodes(concept, grouped, identified)
