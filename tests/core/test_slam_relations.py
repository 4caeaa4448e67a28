"""Scores of a map that changes are those of the whole map, though scorers see a part of it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
import torch

from sgraph_concepts.registry import RegisteredConcept
from sgraph_concepts.spec import ConceptSpec
from sgraph_concepts.types import FloatArray, IntArray, Scene, SurfaceArrays
from sgraph_core.concepts import installed, new_registry
from sgraph_core.detector import Detector, Inference
from sgraph_core.evaluation.incremental import drive_through
from sgraph_core.graph import SGraph
from sgraph_core.network.export import export_encoder, export_head
from sgraph_core.network.model import Encoder, Head, initialise
from sgraph_core.preprocess import Fragments
from sgraph_core.slam.fragments import LiveFragments
from sgraph_core.slam.observed import surfaces_of
from sgraph_core.slam.pairs import LivePairs
from sgraph_core.slam.pins import NO_PINS
from sgraph_core.slam.relations import SAME_LOGIT, LiveRelations
from sgraph_core.slam.support import LiveSupport


class Scores:
    """The scores of a map to which surfaces come, or on which they move."""

    def __init__(self, detector: Detector, concepts: Sequence[RegisteredConcept]) -> None:
        self._detector, self._concepts = detector, concepts
        self._fragments = LiveFragments()
        self._pairs = LivePairs(self._fragments.fragments, np.zeros(2), len(concepts))
        self._support = LiveSupport(self._fragments.fragments, self._pairs)
        self._relations = LiveRelations(detector, concepts, self._pairs)

    def update(self, surfaces: SurfaceArrays) -> float:
        """Score what changes; return the share of the map that scorers are given."""
        changed = self._fragments.update(surfaces, NO_PINS)
        ends = np.union1d(self._pairs.update(changed).ends, changed.added)
        _, rows = self._relations.update(np.union1d(ends, self._support.update(changed)))
        self._fragments.fragments.settle()
        return rows / len(self._fragments.fragments.alive)

    @property
    def kept_and_whole(self) -> tuple[FloatArray, FloatArray]:
        """The logits of all pairs as they are kept, and those of the whole map at once."""
        rows = self._fragments.fragments.alive
        scene, pairs = self._pairs.scene(rows)
        run = Inference(self._detector, Fragments(scene.surfaces), scene)
        whole = [run.score(concept, scene).logits for concept in self._concepts]
        return self._pairs.pairs["logits"][pairs], np.stack(whole, axis=1)


def deep(layers: int, folder: Path) -> Detector:
    torch.manual_seed(layers)
    encoder = Encoder(hidden=16, layers=layers)
    initialise(encoder)
    export_encoder(encoder, folder / "encoder.onnx")
    for name in ("room", "wall"):
        head = Head(width=16, hidden=8)
        initialise(head)
        export_head(head, encoder, folder / f"{name}.onnx")
    return Detector(weights=folder)


def related_to_both(scene: Scene) -> FloatArray:
    """Score pairs by what is related to both of their surfaces, and by pairs between these."""
    linked = np.zeros((len(scene.surfaces),) * 2)
    linked[tuple(scene.pairs.T)] = scene.distances
    linked += linked.T
    one, two = scene.pairs.T
    return np.asarray((linked[one] @ linked * linked[two]).sum(axis=1) / 100)


def ruled() -> Detector:
    """Return a detector of two concepts with heads and one with a rule."""
    registry = new_registry()
    for concept in installed():
        registry.add(concept.spec, package=concept.package)
    rule = f"{__name__}:related_to_both"
    registry.add(
        ConceptSpec(name="zone", relation="same_zone", baseline=rule, clusterer="multicut")
    )
    return Detector(registry)


def moved(graph: SGraph, ids: IntArray, by: FloatArray) -> SurfaceArrays:
    some = surfaces_of(graph, ids.tolist())
    return SurfaceArrays(some.ids, some.segments + by, some.normals)


@pytest.mark.parametrize("scorer", ["shipped", "1 layer", "3 layers", "a rule beside heads"])
def test_scores_in_a_long_drive_are_those_of_the_whole_map(
    scorer: str, detector: Detector, tmp_path: Path
) -> None:
    if scorer == "a rule beside heads":
        detector = ruled()
    elif scorer != "shipped":
        detector = deep(int(scorer[0]), tmp_path)
    concepts = list(detector.registry)
    scores, graph, rng = Scores(detector, concepts), SGraph(), np.random.default_rng(0)
    visits = drive_through(40, 40, seed=1)
    shares = []
    for k, visit in enumerate(visits):
        visit.enter(graph, visits[k - 1] if k else None)
        new = np.array([surface for surface, _, _ in visit.surfaces])
        share = scores.update(moved(graph, new, np.zeros(2)))
        if k < len(visits) - 5:
            continue
        shares.append(share)
        some = rng.choice(graph.wall_surfaces.ids, 1)
        shares.append(scores.update(moved(graph, some, rng.normal(0, 0.3, 2))))
        kept, whole = scores.kept_and_whole
        assert kept == pytest.approx(whole, abs=1.01 * SAME_LOGIT)
    assert np.mean(shares) < 0.5, "scorers are given a part"
