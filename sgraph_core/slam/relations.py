"""The scored relations between fragments, kept up to date: the network sees what changed, only.

The encoder has two message-passing layers, so a changed pair alters the embeddings of fragments up
to two links away and the scores of their pairs. To compute these exactly the network is given all
fragments up to four links away; of the outermost, what it knows from before is used.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sgraph_concepts.registry import RegisteredConcept
from sgraph_concepts.types import IntArray, Scene
from sgraph_core.detector import Detector, Inference
from sgraph_core.preprocess import Fragments
from sgraph_core.slam.pairs import LivePairs
from sgraph_core.slam.pool import rows_where

__all__ = ["LiveRelations"]

LAYERS = 2
"""Message-passing layers of the encoder."""
SAME_LOGIT = 1e-3
"""A score that differs by less from the one that was clustered by is the same."""

Vectors = NDArray[np.float32]
Mask = NDArray[np.bool_]


class LiveRelations:
    """Scores of the related pairs, in the pairs' column ``logits``.

    Args:
        detector: its network or baselines score.
        concepts: what relates wall surfaces; the order is that of the column.
        pairs: what is scored.
    """

    def __init__(
        self, detector: Detector, concepts: Sequence[RegisteredConcept], pairs: LivePairs
    ) -> None:
        self._detector, self._concepts, self._pairs = detector, concepts, pairs
        self._features, self._embeddings = _Known(), _Known()

    def update(self, changed: IntArray) -> tuple[list[IntArray], int]:
        """Score again what depends on changed pairs.

        Args:
            changed: rows of the fragments in changed pairs, all new fragments among them.

        Returns:
            For each concept the rows of fragments in pairs that are scored otherwise, and how many
            rows the network was given.
        """
        links, new = [changed], changed
        for _ in range(2 * LAYERS):
            links.append(rows_where(links[-1], self._pairs.neighbours(new)))
            new = np.setdiff1d(links[-1], links[-2], assume_unique=True)
        inner, known, rows = links[LAYERS], links[LAYERS + 1], links[-1]
        scene, pairs = self._pairs.scene(rows, known)
        scored = np.asarray(np.isin(rows[scene.pairs], inner).any(axis=1))
        inference = Inference(self._detector, Fragments(scene.surfaces), taken(scene, scored))
        if len(pairs) and any(map(self._learned, self._concepts)):
            inference.embeddings = self._encode(scene, rows, inner, known, scored)
        touched = []
        for column, concept in enumerate(self._concepts):
            before = self._pairs.pairs["logits"][pairs[scored], column]
            now = inference.score(concept, inference.scene).logits
            other = ~(np.abs(now - before) <= SAME_LOGIT)  # a new pair's before is NaN
            self._pairs.pairs["logits"][pairs[scored][other], column] = now[other]
            touched.append(np.unique(rows[inference.scene.pairs[other]]))
        return touched, len(rows)

    def _learned(self, concept: RegisteredConcept) -> bool:
        return self._detector.scorer == "network" and concept.spec.head is not None

    def _encode(
        self, scene: Scene, rows: IntArray, inner: IntArray, known: IntArray, scored: Mask
    ) -> tuple[Vectors, Vectors]:
        """Return embeddings of fragments and of the scored pairs, exact wherever these look."""
        network = self._detector.network
        inputs = network.inputs(scene)
        self._features.exchange(rows, inputs["x"], known)
        nodes, edges = network.encode(inputs)
        nodes = nodes.copy()  # what ONNX Runtime returns may not be written to
        self._embeddings.exchange(rows, nodes, inner)
        return nodes, edges[np.tile(scored, 2)]


def taken(scene: Scene, some: Mask) -> Scene:
    """Return a scene with only some of its pairs."""
    return replace(
        scene,
        pairs=scene.pairs[some],
        distances=scene.distances[some],
        visibility=scene.visibility[some],
    )


class _Known:
    """The vectors of fragments, by row. Those of a new fragment are exact when it comes."""

    def __init__(self) -> None:
        self._vectors: Vectors = np.empty((0, 0), np.float32)

    def exchange(self, rows: IntArray, vectors: Vectors, exact: IntArray) -> None:
        """Remember the vectors that are exact, and put in what is remembered of the others.

        Args:
            rows: of the fragments, ascending, [N].
            vectors: theirs, [N, F].
            exact: rows whose vectors are.
        """
        if rows[-1] >= len(self._vectors):
            more = np.full((int(rows[-1]) + 1, vectors.shape[1]), np.nan, np.float32)
            self._vectors = np.concatenate([self._vectors.reshape(-1, vectors.shape[1]), more])
        are = np.isin(rows, exact)
        self._vectors[rows[are]] = vectors[are]
        vectors[~are] = self._vectors[rows[~are]]
