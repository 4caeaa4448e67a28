"""What an update of a ConceptTracker asks of a factor graph."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import gtsam

from sgraph_core.backend.robust import Refusal
from sgraph_core.slam.handout import Handout
from sgraph_core.slam.inference import Work
from sgraph_core.slam.nodes import NodeChanges

__all__ = ["Update", "update_of"]


@dataclass(frozen=True, eq=False)
class Update:
    """What an update asks a factor graph to do, and what became of the nodes.

    Attributes:
        factors: factors to add.
        values: initial values of variables that are new.
        remove: indices of factors to remove, as :meth:`ConceptTracker.placed` was told them: those
            of nodes that are gone, or whose factors are among those to add.
        unused: keys of variables that no factor refers to any more; ISAM2 drops them by itself.
        nodes: what became of each concept's nodes.
        refusals: why factors of nodes and ties that stay as they are are among those to remove:
            they contradict the last solution that the tracker was told.
        work: what was computed.
    """

    factors: gtsam.NonlinearFactorGraph
    values: gtsam.Values
    remove: list[int]
    unused: list[int]
    nodes: Mapping[str, NodeChanges]
    refusals: Sequence[Refusal]
    work: Work


def update_of(
    handout: Handout, nodes: Mapping[str, NodeChanges], refusals: Sequence[Refusal], work: Work
) -> Update:
    """Return the update that asks for what a handout replaces."""
    return Update(
        handout.factors, handout.values, handout.remove, handout.unused, nodes, refusals, work
    )
