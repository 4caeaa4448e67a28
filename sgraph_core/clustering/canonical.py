"""One numbering of the rows, whatever their order, so that ties are always broken the same way."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sgraph_concepts.types import FloatArray, IntArray, Scene, ScoredEdges

__all__ = ["Relation", "canonical_relation"]


@dataclass(frozen=True, eq=False)
class Relation:
    """A scored relation between canonical numbers.

    Attributes:
        rows: the scene's row of each canonical number, [N].
        pairs: canonical numbers, first below second, in lexicographic order, [E, 2].
        logits: log-odds, [E].
    """

    rows: IntArray
    pairs: IntArray
    logits: FloatArray


def canonical_relation(edges: ScoredEdges, scene: Scene) -> Relation:
    """Number the rows by surface id, fragments of one surface by their position."""
    if scene.nodes:
        rows = np.argsort([node.id for node in scene.nodes], kind="stable")
    else:
        middle = scene.surfaces.midpoints
        rows = np.lexsort((middle[:, 1], middle[:, 0], scene.surfaces.ids))
    number = np.empty(len(rows), np.int64)
    number[rows] = np.arange(len(rows))
    pairs = np.sort(number[edges.pairs], axis=1)
    order = np.lexsort((pairs[:, 1], pairs[:, 0]))
    return Relation(rows, pairs[order], edges.logits[order])
