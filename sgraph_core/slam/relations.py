"""The scored relations between fragments, kept up to date: scorers see what changed, only.

A changed pair alters the embeddings of fragments as many links away as the encoder has layers, and
the scores of their pairs. To compute these exactly the network is given all fragments up to one
link further; of these outermost ones, what it knows from before is used. Rules without learning
are given all that they may look at.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sgraph_concepts.registry import RegisteredConcept
from sgraph_concepts.types import IntArray, Scene
from sgraph_core.detector import Detector, Inference
from sgraph_core.preprocess import Fragments
from sgraph_core.slam.pairs import LivePairs

__all__ = ["LiveRelations"]

RULE_LINKS = 1
"""A rule without learning may look at fragments so many links away from a pair's, and at the pairs
between these."""
SAME_LOGIT = 1e-3
"""A score that differs by less from the one that was clustered by is the same."""

Vectors = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class _Part:
    """A part of the map whose pairs are scored again.

    Attributes:
        run: scores them.
        rows: of the fragments.
        pairs: rows of the pairs.
        exact: which of the pairs have all around them that their scores depend on.
    """

    run: Inference
    rows: IntArray
    pairs: IntArray
    exact: NDArray[np.bool_]


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
            rows the scorers were given.
        """
        parts: dict[bool, _Part] = {}
        touched = []
        for column, concept in enumerate(self._concepts):
            learned = self._detector.has_learned(concept)
            if learned not in parts:
                parts[learned] = self._encoded(changed) if learned else self._around(changed)
            part = parts[learned]
            scene, pairs = part.run.scene, part.pairs
            before = self._pairs.pairs["logits"][pairs, column]
            now = part.run.score(concept, scene).logits
            # a new pair's before is NaN
            other = part.exact & ~(np.abs(now - before) <= SAME_LOGIT)
            self._pairs.pairs["logits"][pairs[other], column] = now[other]
            touched.append(np.unique(part.rows[scene.pairs[other]]))
        return touched, max((len(part.rows) for part in parts.values()), default=0)

    def _within(self, links: int, rows: IntArray) -> IntArray:
        for _ in range(links):
            rows = self._pairs.neighbours(rows)
        return rows

    def _around(self, changed: IntArray) -> _Part:
        """Return what rules look at of pairs that a change can reach."""
        inner = self._within(RULE_LINKS, changed)
        rows = self._within(1 + RULE_LINKS, inner)
        scene, pairs = self._pairs.scene(rows)
        exact = np.asarray(np.isin(rows[scene.pairs], inner).any(axis=1))
        return _Part(self._run(scene), rows, pairs, exact)

    def _encoded(self, changed: IntArray) -> _Part:
        """Return the pairs that a change can reach by way of the network, with embeddings."""
        inner = self._within(self._detector.network.layers, changed)
        rows = self._within(1, inner)
        scene, pairs = self._pairs.scene(rows, inner)
        run = self._run(scene)
        if len(pairs):
            run.embeddings = self._encode(scene, rows, inner)
        return _Part(run, rows, pairs, np.ones(len(pairs), bool))

    def _run(self, scene: Scene) -> Inference:
        return Inference(self._detector, Fragments(scene.surfaces), scene)

    def _encode(self, scene: Scene, rows: IntArray, inner: IntArray) -> tuple[Vectors, Vectors]:
        """Return embeddings of fragments and pairs; the scene has all pairs of the inner ones."""
        network = self._detector.network
        inputs = network.inputs(scene)
        exact = np.isin(rows, inner)
        features = self._features.recall(rows, inputs["x"].shape[1])
        inputs["x"] = np.where(exact[:, None], inputs["x"], features)
        before = self._embeddings.recall(rows, network.layers * network.hidden)
        nodes, edges = network.encode_part(inputs, ~exact, before)
        self._features.keep(inner, inputs["x"][exact])
        self._embeddings.keep(inner, nodes[exact])
        return network.final(nodes), edges


class _Known:
    """The vectors of fragments, by row."""

    def __init__(self) -> None:
        self._vectors: Vectors = np.empty((0, 0), np.float32)

    def recall(self, rows: IntArray, width: int) -> Vectors:
        """Return the vectors of rows, [N, width]; NaN for what is not known yet.

        Args:
            rows: ascending, [N].
            width: of the vectors, the same whenever it is asked for.
        """
        if rows[-1] >= len(self._vectors):
            more = np.full((int(rows[-1]) + 1, width), np.nan, np.float32)
            self._vectors = np.concatenate([self._vectors.reshape(-1, width), more])
        return np.asarray(self._vectors[rows])

    def keep(self, rows: IntArray, vectors: Vectors) -> None:
        """Remember the vectors of rows that were recalled before."""
        self._vectors[rows] = vectors
