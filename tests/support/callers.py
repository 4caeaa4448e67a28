"""A SLAM system with a factor graph of its own, into which a ConceptTracker's factors go."""

from __future__ import annotations

from collections.abc import Callable

import gtsam

from sgraph_core.backend import Keys
from sgraph_core.graph import SGraph
from sgraph_core.slam import ConceptTracker, Update
from sgraph_core.slam.smoother import Smoother

OWN = Keys(
    keyframe=lambda i: 1000 + i,
    surface=lambda i: 5000 + i,
    node=lambda concept, i, v: (9 if concept == "room" else 8) * 10**6 + 1000 * i + v,
    tie=lambda one, two: 10**7 + 1000 * one + two,
)


def relinearized_at_once() -> gtsam.ISAM2Params:
    params = gtsam.ISAM2Params()
    params.relinearizeSkip = 1
    params.setRelinearizeThreshold(1e-4)
    return params


class Caller:
    """A SLAM system with an ISAM2 of its own: its factors on its keys, and the tracker's.

    Args:
        tracker: on the same keys.
        keys: of its variables.
        graph: what it has mapped.
        params: of its ISAM2.
    """

    def __init__(
        self,
        tracker: ConceptTracker,
        keys: Keys = OWN,
        graph: SGraph | None = None,
        params: gtsam.ISAM2Params | None = None,
    ) -> None:
        self.tracker = tracker
        self.isam = gtsam.ISAM2(relinearized_at_once() if params is None else params)
        self.graph = SGraph() if graph is None else graph
        self._smoother = Smoother(keys)
        self._smoother._isam = self.isam

    def see(self, enter: Callable[[SGraph | ConceptTracker], None]) -> Update:
        enter(self.graph)
        enter(self.tracker)
        return self.step()

    def step(self) -> Update:
        update = self.tracker.update()
        self.take(update)
        return update

    def take(self, update: Update) -> None:
        self._smoother.check(self.graph)
        self.tracker.placed(self._smoother.add(self.graph, update))

    def settled(self) -> gtsam.Values:
        for _ in range(30):
            self.isam.update()
        return self.isam.calculateEstimate()


def factors_by_keys(
    graph: gtsam.NonlinearFactorGraph, at: gtsam.Values
) -> list[tuple[object, ...]]:
    """Return each factor as its type, its keys and its error at some values."""
    factors = [graph.at(k) for k in range(graph.size()) if graph.exists(k)]
    return sorted((type(f).__name__, tuple(f.keys()), round(f.error(at), 9)) for f in factors)
