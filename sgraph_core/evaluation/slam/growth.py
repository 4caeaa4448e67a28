"""How soon and how fast rooms are found while the map grows."""

from __future__ import annotations

import statistics
import time
from dataclasses import dataclass

from sgraph_core.evaluation.scores import score_floor
from sgraph_core.evaluation.slam.trial import Trial
from sgraph_core.evaluation.slam.variants import Detectors, Variant
from sgraph_core.graph import SGraph

__all__ = ["Growth", "watch"]


@dataclass(frozen=True)
class Growth:
    """What a detector did at every update.

    Attributes:
        first_room_s: from the start of the drive to the first update at which a room is right (at
            which there is any, without truth); None if there never is.
        update_ms: median time of detection at the updates that are spread evenly over the drive;
            None if the method detects nothing.
    """

    first_room_s: float | None
    update_ms: float | None


def watch(trial: Trial, variant: Variant, detectors: Detectors) -> Growth:
    """Detect at the updates of a growing map.

    The paper's variants are left out where nobody has weights of it: they detect as ours do.
    """
    if variant.detect is None or (variant.papers and detectors.paper is detectors.ours):
        return Growth(None, None)
    first, milliseconds = None, []
    for update in trial.updates:
        start = time.perf_counter()
        found = variant.detect(update.graph, trial, detectors)
        if update.regular:
            milliseconds.append(1e3 * (time.perf_counter() - start))
        if first is None and _found_a_room(found):
            first = update.seconds
    return Growth(first, statistics.median(milliseconds))


def _found_a_room(graph: SGraph) -> bool:
    if graph.truth is None:
        return bool(graph.concepts["room"])
    return score_floor(graph, graph.truth).rooms.matched > 0
