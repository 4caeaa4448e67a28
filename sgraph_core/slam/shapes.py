"""The shapes of one concept's nodes, kept up to date: those next to a change are made again.

A node's shape may depend on the nodes next to it: outlines of rooms do not overlap, and a doorway
belongs to two rooms. Nodes are next to each other when the boxes around their fragments come within
``NEXT_M``. What is next to a changed node is made again, in a scene that holds the nodes up to two
steps further; where a shape comes out otherwise, what is next to that one follows.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np

from sgraph_concepts.registry import RegisteredConcept
from sgraph_concepts.types import FloatArray, IntArray, Memory, NodeShape
from sgraph_core.detector import Detector, Inference
from sgraph_core.slam.fragments import LiveFragments
from sgraph_core.slam.pairs import LivePairs
from sgraph_core.slam.pool import Pool

__all__ = ["LiveShapes"]

NEXT_M = 1.0
"""The thickest walls are thinner."""
CONTEXT = 2
"""Steps from node to node that a shape may depend on."""


class LiveShapes:
    """The shapes of the nodes of a concept that groups wall surfaces.

    Args:
        concept: whose nodes.
        detector: whose parts are used.
        fragments, pairs: what the nodes consist of.
    """

    def __init__(
        self,
        concept: RegisteredConcept,
        detector: Detector,
        fragments: LiveFragments,
        pairs: LivePairs,
    ) -> None:
        self._concept, self._detector = concept, detector
        self._fragments, self._pairs = fragments, pairs
        self._nodes = Pool(id=np.empty(0, np.int64), box=np.empty((0, 4)))
        self._place: dict[int, int] = {}
        self._rows: dict[int, IntArray] = {}
        self._shapes: dict[int, NodeShape] = {}
        self._memory = Memory()

    def update(self, gone: Iterable[int], rows: Mapping[int, IntArray]) -> dict[int, NodeShape]:
        """Take in what became of nodes; return the shapes that were made again.

        Args:
            gone: ids of nodes that are no more.
            rows: fragments of nodes that may be new or changed, by id.
        """
        changed = {
            i: some for i, some in rows.items() if not np.array_equal(some, self._rows.get(i, ()))
        }
        left = [self._place.pop(i) for i in (*gone, *changed) if i in self._place]
        boxes = [self._nodes["box"][left]]
        self._nodes.remove(np.array(left, np.int64))
        for node in gone:
            self._rows.pop(node, None)
            self._shapes.pop(node, None)
        for node, some in changed.items():
            box = _box_around(self._fragments.fragments["box"][some])
            (place,) = self._nodes.add(1, id=np.array([node]), box=box)
            self._place[node], self._rows[node] = int(place), some
            boxes.append(box)
        self._nodes.settle()
        return self._make_again(np.concatenate(boxes))

    def _make_again(self, boxes: FloatArray) -> dict[int, NodeShape]:
        made: dict[int, NodeShape] = {}
        waiting = set(self._next_to(boxes))
        while waiting:
            shapes = self._make(waiting)
            other = [i for i in waiting if shapes[i] != self._shapes.get(i)]
            self._shapes |= {i: shapes[i] for i in waiting}
            made |= {i: shapes[i] for i in waiting}
            waiting = set(self._next_to(self._boxes(other))) - made.keys()
        return made

    def _make(self, nodes: set[int]) -> dict[int, NodeShape]:
        context = list(nodes)
        for _ in range(CONTEXT):
            context = self._next_to(self._boxes(context))
        rows = self._fragments.in_order(np.unique(np.concatenate([self._rows[i] for i in context])))
        scene, _ = self._pairs.scene(rows)
        scene = replace(scene, memory=self._memory)
        inference = Inference(self._detector, self._fragments.take(rows), scene)
        place = np.full(len(self._fragments.fragments), -1)
        place[rows] = np.arange(len(rows))
        local = {i: place[self._rows[i]] for i in sorted(context)}
        return inference.shapes(self._concept, local, scene)

    def _boxes(self, nodes: Iterable[int]) -> FloatArray:
        return np.asarray(self._nodes["box"][[self._place[i] for i in nodes]])

    def _next_to(self, boxes: FloatArray) -> list[int]:
        near: list[int] = self._nodes["id"][self._nodes.meeting("box", boxes, NEXT_M)].tolist()
        return near


def _box_around(boxes: FloatArray) -> FloatArray:
    return np.array([[*boxes[:, :2].min(axis=0), *boxes[:, 2:].max(axis=0)]])
