"""The detector: from wall surfaces to the nodes of every concept."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from sgraph_concepts.errors import ConceptError, one_line
from sgraph_concepts.registry import RegisteredConcept, Registry
from sgraph_concepts.spec import WALL_SURFACE
from sgraph_concepts.types import (
    Cluster,
    ConceptNode,
    IntArray,
    NodeShape,
    OccupancyGrid,
    Scene,
    ScoredEdges,
    SurfaceArrays,
)
from sgraph_core.clustering.confidence import probability_right
from sgraph_core.clustering.pinned import pin
from sgraph_core.concepts import installed
from sgraph_core.graph import Pins, SGraph
from sgraph_core.network.runtime import Network
from sgraph_core.nodes import check_nodes, keep_identity
from sgraph_core.pins import PINNED_CONCEPT, RoomPins, check_pins
from sgraph_core.preprocess import Fragments, preprocess
from sgraph_core.proximity import build_scene

__all__ = ["Detector", "Inference", "Scorer", "Trace"]

Scorer = Literal["network", "baseline"]
"""Who scores the relations: the trained network, or each concept's rule without learning."""


@dataclass(frozen=True, eq=False)
class Trace:
    """An inferred S-Graph, and what its nodes follow from.

    Attributes:
        graph: the S-Graph with its concepts.
        fragments: the surfaces as preprocessing left them.
        scene: the same surfaces, and the pairs of them that are related.
        relations: over the scene's pairs, as scored, by concept that groups wall surfaces.
        clusters: what the concept's clusterer found, by concept that groups wall surfaces and by
            the members of the node that it gives.
        pins: what was pinned, of the surfaces that preprocessing kept.
    """

    graph: SGraph
    fragments: Fragments
    scene: Scene
    relations: Mapping[str, ScoredEdges]
    clusters: Mapping[str, Mapping[frozenset[int], Cluster]]
    pins: RoomPins


class Detector:
    """Infers concepts; keeps the loaded network, so that SLAM code can call it at every keyframe.

    Args:
        registry: the concepts; the installed ones by default.
        scorer: ``network`` or ``baseline``. A concept without a head uses its baseline in any case.
        clusterers: other clusterers than the declared ones, by concept: a built-in name or
            ``package.module:function``.
        weights: folder with other weights than the shipped ones, as ``sgraph train`` writes them.
        calibrated: say of relations how likely they hold, and of nodes as their confidence how
            likely they are right, where the concept declares how. With another scorer, clusterer
            or weights than the declared ones, the scores and the clusterer are taken at their word.
    """

    def __init__(
        self,
        registry: Registry | None = None,
        scorer: Scorer = "network",
        clusterers: Mapping[str, str] | None = None,
        weights: Path | None = None,
        calibrated: bool = True,
    ) -> None:
        self.registry = installed() if registry is None else registry
        self.scorer = scorer
        self.calibrated = calibrated
        self.clusterers = dict(clusterers or {})
        self.weights = weights
        for name in self.clusterers:
            self.registry[name]  # raises if there is none

    @cached_property
    def network(self) -> Network:
        """The shared encoder and the heads, loaded on first use."""
        return Network(self.weights)

    def has_learned(self, concept: RegisteredConcept) -> bool:
        """Return whether the network scores a concept's relation between wall surfaces."""
        return self.scorer == "network" and concept.spec.head is not None

    def scene(self, surfaces: SurfaceArrays, grid: OccupancyGrid | None = None) -> Scene:
        """Return the pairs of preprocessed surfaces that the scorer is given.

        Args:
            surfaces: in world coordinates.
            grid: what they were extracted from, if anything.
        """
        if self.scorer == "baseline":
            return build_scene(surfaces, grid=grid)
        return build_scene(surfaces, self.network.neighbours, grid)

    def infer(self, graph: SGraph, concepts: Sequence[str] | None = None) -> SGraph:
        """Return a copy of an S-Graph with its concepts inferred anew.

        The steps are the paper's: preprocess, relate neighbours, encode once, and for each concept
        score, cluster and describe. The graph's pins hold in its rooms. Nodes that the graph
        already holds give their ids and names to those they persist in. Concepts that are not
        asked for stay as they are.

        Args:
            graph: the S-Graph; it is not changed, and its truth is not read.
            concepts: names of the concepts to infer, together with what they group; all by default.

        Raises:
            InputError: the pins contradict one another or name no pairs of wall surfaces, or a node
                that the graph holds breaks the map file's rules.
            ConceptError: a concept is unknown, or one of its parts returned nonsense.
            WeightsError: the network's weights cannot be used.
        """
        return self.trace(graph, concepts).graph

    def trace(self, graph: SGraph, concepts: Sequence[str] | None = None) -> Trace:
        """Infer as :meth:`infer` does, and keep what the nodes follow from."""
        pins = graph.pins or Pins()
        surfaces = set(graph.wall_surfaces.ids.tolist())
        check_pins(pins, surfaces)
        check_nodes(graph.concepts, surfaces)
        result, room_pins = graph.copy(), RoomPins(pins)
        fragments = preprocess(graph.wall_surfaces.ordered(), room_pins.let_stand)
        run = Inference(self, fragments, self.scene(fragments.surfaces, graph.grid), room_pins)
        for concept in self.registry.select(None if concepts is None else list(concepts)):
            name, groups = concept.spec.name, concept.spec.groups
            names = pins.room_names if name == PINNED_CONCEPT else {}
            grouped, before = result.concepts.get(groups, []), graph.concepts.get(name, [])
            identified = partial(keep_identity, old=before, names=names)
            result.concepts[name] = run.nodes(concept, grouped, identified)
            if groups != WALL_SURFACE:
                result.groups[name] = groups
        return Trace(result, fragments, run.scene, run.relations, run.clusters, room_pins)

    def score(self, concept: RegisteredConcept, scene: Scene) -> ScoredEdges:
        """Return a concept's relation over the pairs of a scene of wall surfaces."""
        run = Inference(self, Fragments(scene.surfaces), scene)
        return run.calibrated(concept, run.score(concept, scene))


class Inference:
    """One inference: the scene, and what is computed from it once for all concepts.

    Args:
        detector: whose parts are used.
        fragments: the surfaces as preprocessing left them.
        scene: the same surfaces, and the pairs of them that are related.
        pins: what a person pinned; nothing by default.
    """

    def __init__(
        self, detector: Detector, fragments: Fragments, scene: Scene, pins: RoomPins | None = None
    ) -> None:
        self._detector = detector
        self._fragments = fragments
        self.scene = scene
        self.relations: dict[str, ScoredEdges] = {}
        self.clusters: dict[str, dict[frozenset[int], Cluster]] = {}
        self._pins = RoomPins(Pins()) if pins is None else pins

    @cached_property
    def embeddings(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """What the encoder makes of the scene's surfaces and pairs."""
        network = self._detector.network
        return network.encode(network.inputs(self.scene))

    def nodes(
        self,
        concept: RegisteredConcept,
        grouped: Sequence[ConceptNode],
        identified: Callable[[Sequence[ConceptNode]], Sequence[ConceptNode]],
    ) -> list[ConceptNode]:
        """Return the concept's nodes.

        Args:
            concept: the concept.
            grouped: the nodes that it groups, if it groups another concept's.
            identified: gives nodes their ids and names.
        """
        groups_surfaces = concept.spec.groups == WALL_SURFACE
        if not groups_surfaces and not grouped:
            return []
        scene = self.scene if groups_surfaces else _scene_of_nodes(grouped, self.scene)
        edges = self.score(concept, scene)
        clusters = self._by_members(concept, edges, scene)
        if groups_surfaces:
            self.relations[concept.spec.name] = self.calibrated(concept, edges)
            self.clusters[concept.spec.name] = clusters
        sure = self.confidences(concept, list(clusters.values()), list(map(len, clusters)))
        found = [
            ConceptNode(0, tuple(sorted(members)), confidence=confidence)
            for members, confidence in zip(clusters, sure, strict=True)
        ]
        nodes = identified(found)
        rows = {
            node.id: np.array(clusters[frozenset(node.members)].members, np.int64) for node in nodes
        }
        shapes = self.shapes(concept, rows, scene)
        return [replace(node, shape=shapes[node.id]) for node in nodes]

    def _by_members(
        self, concept: RegisteredConcept, edges: ScoredEdges, scene: Scene
    ) -> dict[frozenset[int], Cluster]:
        """Return the clusters by the members of the nodes that they give."""
        found: dict[frozenset[int], Cluster] = {}
        clusters = self.cluster(concept, edges, scene)
        for cluster in sorted(clusters, key=lambda c: (c.confidence, c.members)):
            if concept.spec.groups == WALL_SURFACE:
                candidates = self.members_of(concept, np.array(cluster.members, np.int64))
            else:
                candidates = [frozenset(scene.nodes[row].id for row in cluster.members)]
            for members in candidates:  # fragments of the same surfaces: the surest cluster wins
                found[members] = cluster
        return found

    @property
    def _may_calibrate(self) -> bool:
        """Whether scores are those that the declared constants were fitted to."""
        detector = self._detector
        return detector.calibrated and detector.scorer == "network" and detector.weights is None

    def calibrated(self, concept: RegisteredConcept, edges: ScoredEdges) -> ScoredEdges:
        """Return a relation with probabilities that mean what they say."""
        head = concept.spec.head
        if head is None or not self._may_calibrate:
            return edges
        return replace(edges, intercept=head.intercept, slope=head.slope)

    def confidences(
        self, concept: RegisteredConcept, clusters: Sequence[Cluster], members: Sequence[int]
    ) -> list[float]:
        """Return how sure nodes are with so many members, given the cluster each comes from."""
        sure = np.array([cluster.confidence for cluster in clusters])
        spec, other_clusterers = concept.spec.confidence, self._detector.clusterers
        if spec is not None and self._may_calibrate and concept.spec.name not in other_clusterers:
            sure = probability_right(spec, sure, np.array(members, np.int64))
        result: list[float] = sure.tolist()
        return result

    def members_of(self, concept: RegisteredConcept, rows: IntArray) -> list[frozenset[int]]:
        """Return the members of the nodes that a cluster of these rows gives.

        A surface that was mapped twice joins a room together with its copy. It cannot do so where
        surfaces belong to several nodes, such as walls: there the copy gives nodes of its own.
        """
        parents = self._fragments.parents(rows)
        if concept.spec.exclusive:
            return [self._fragments.with_duplicates(parents)]
        return self._fragments.alternatives(parents)

    def score(self, concept: RegisteredConcept, scene: Scene) -> ScoredEdges:
        """Return a concept's relation over the pairs of a scene, as scored."""
        name = concept.spec.name
        if not len(scene.pairs):
            return ScoredEdges(scene.pairs, np.empty(0))
        if self._detector.has_learned(concept) and not scene.nodes:
            return self._detector.network.score(concept, scene, self.embeddings)
        logits = np.asarray(self._call(name, "baseline", None, scene), np.float64)
        if logits.shape != (len(scene.pairs),) or not np.isfinite(logits).all():
            raise ConceptError(
                f"baseline of concept {name!r} must return {len(scene.pairs)} finite log-odds"
            )
        return ScoredEdges(scene.pairs, logits)

    def cluster(
        self, concept: RegisteredConcept, edges: ScoredEdges, scene: Scene
    ) -> list[Cluster]:
        """Cluster by a concept's relation; rooms keep to the pins."""
        if concept.spec.name != PINNED_CONCEPT or not (self._pins.groups or self._pins.apart):
            return self._cluster(concept, edges, scene)
        pinned = pin(edges, scene, self._pins.groups, self._pins.apart)
        return pinned.enforce(self._cluster(concept, pinned.edges, scene))

    def _cluster(
        self, concept: RegisteredConcept, edges: ScoredEdges, scene: Scene
    ) -> list[Cluster]:
        name = concept.spec.name
        chosen = self._detector.clusterers.get(name)
        clusters: list[Cluster] = self._call(name, "clusterer", chosen, edges, scene)
        problem = _problem(clusters, len(scene.nodes) or len(scene.surfaces))
        if problem:
            raise ConceptError(f"clusterer of concept {name!r} {problem}")
        rows = [row for cluster in clusters for row in cluster.members]
        if concept.spec.exclusive and len(set(rows)) != len(rows):
            raise ConceptError(
                f"clusterer of concept {name!r} put a row into two clusters, "
                "but the concept is declared exclusive"
            )
        return clusters

    def shapes(
        self, concept: RegisteredConcept, rows: Mapping[int, IntArray], scene: Scene
    ) -> dict[int, NodeShape]:
        """Return the shapes of nodes in the world, from the rows of each one's members."""
        if concept.spec.shape is None:
            shapes = {node: _middle(members, scene) for node, members in rows.items()}
        else:
            shapes = self._call(concept.spec.name, "shape", None, rows, scene)
            problem = _problem_of_shapes(shapes, rows)
            if problem:
                raise ConceptError(f"shape of concept {concept.spec.name!r} {problem}")
        return {node: shapes[node].shifted(scene.origin) for node in rows}

    def _call(self, name: str, kind: str, chosen: str | None, *arguments: object) -> Any:
        """Return what a concept's declared or chosen part makes of its arguments."""
        part = self._detector.registry.part(name, kind, chosen)
        try:
            return part(*arguments)
        except Exception as error:  # a third party's code may raise anything
            raise ConceptError(f"{kind} of concept {name!r} fails: {one_line(error)}") from error


def _problem(clusters: object, total: int) -> str:
    """Return what is wrong with a clusterer's answer about a number of rows; empty if nothing."""
    if not isinstance(clusters, Sequence) or not all(isinstance(c, Cluster) for c in clusters):
        return "must return a list of Cluster"
    if not all(cluster.members for cluster in clusters):
        return "returned a cluster without members"
    rows = [row for cluster in clusters for row in cluster.members]
    if not all(isinstance(row, int | np.integer) and 0 <= row < total for row in rows):
        return "returned a row that does not exist"
    if not all(0 <= cluster.confidence <= 1 for cluster in clusters):
        return "returned a confidence that is not from 0 to 1"
    return ""


def _problem_of_shapes(shapes: object, nodes: Iterable[int]) -> str:
    """Return what is wrong with the shapes of nodes; empty if nothing."""
    if not isinstance(shapes, Mapping):
        return "must return a mapping from the nodes' ids to their NodeShapes"
    for node in nodes:
        if not isinstance(shapes.get(node), NodeShape):
            return f"must return a NodeShape for every node, but returned none for {node}"
    return ""


def _scene_of_nodes(nodes: Sequence[ConceptNode], scene: Scene) -> Scene:
    """Return the scene in which a concept relates another concept's nodes: all pairs of them."""
    one, two = np.triu_indices(len(nodes), k=1)
    centres = np.array([node.shape.centre or (np.nan, np.nan) for node in nodes]).reshape(-1, 2)
    distances = np.linalg.norm(centres[one] - centres[two], axis=1)
    pairs = np.stack([one, two], axis=1).astype(np.int64)
    local = [replace(node, shape=node.shape.shifted(-scene.origin)) for node in nodes]
    visibility = np.empty((len(pairs), 0))
    return Scene(
        scene.surfaces, scene.origin, pairs, distances, visibility, nodes=local, grid=scene.grid
    )


def _middle(rows: IntArray, scene: Scene) -> NodeShape:
    if scene.nodes:
        points = [scene.nodes[row].shape.centre for row in rows]
        known = np.array([point for point in points if point is not None]).reshape(-1, 2)
    else:
        known = scene.surfaces.midpoints[rows]
    if not len(known):
        return NodeShape()
    x, y = known.mean(axis=0).tolist()
    return NodeShape(centre=(x, y))
