"""Rooms from the scored relation *same room*."""

from __future__ import annotations

import numpy as np

from sgraph_concepts.types import Cluster, IntArray, Scene, ScoredEdges, SurfaceArrays
from sgraph_core.clustering.canonical import Relation, canonical_relation
from sgraph_core.clustering.confidence import clusters_of
from sgraph_core.clustering.multicut import multicut

__all__ = ["cluster"]

FEWEST_MEMBERS = 3
"""Two surfaces enclose nothing."""
ABSORB_LOGIT = -2.0
"""A smaller cluster joins the room of its most likely relation, if that is not less likely."""


def cluster(edges: ScoredEdges, scene: Scene) -> list[Cluster]:
    """Partition the surfaces by multicut, let stray ones join, and drop what faces outwards."""
    relation = canonical_relation(edges, scene)
    groups = multicut(len(relation.rows), relation.pairs, relation.logits)
    rooms = _absorb(groups, relation)
    return clusters_of(
        relation, [room for room in rooms if _encloses(scene.surfaces, relation.rows[room])]
    )


def _absorb(groups: list[list[int]], relation: Relation) -> list[list[int]]:
    """Let groups too small for a room join the room they most likely belong to."""
    owner = np.full(len(relation.rows), -1)
    rooms = [group for group in groups if len(group) >= FEWEST_MEMBERS]
    for number, room in enumerate(rooms):
        owner[room] = number
    joined: list[list[int]] = [list(room) for room in rooms]
    best: dict[int, tuple[float, int]] = {}
    group_of = {member: k for k, group in enumerate(groups) for member in group}
    for (one, two), logit in zip(relation.pairs.tolist(), relation.logits.tolist(), strict=True):
        for stray, other in ((one, two), (two, one)):
            if owner[stray] < 0 <= owner[other]:
                offer = (logit, -int(owner[other]))
                best[group_of[stray]] = max(best.get(group_of[stray], offer), offer)
    for group, (logit, room_number) in best.items():
        if logit > ABSORB_LOGIT:
            joined[-room_number] += groups[group]
    return joined


def _encloses(surfaces: SurfaceArrays, rows: IntArray) -> bool:
    """Return whether surfaces face the space between them: a facade's face away from it.

    By the divergence theorem, the sum of length * (midpoint - centre) . normal over a closed
    outline is minus twice its area where the normals point inwards, and twice it otherwise.
    """
    lengths, midpoints = surfaces.lengths[rows], surfaces.midpoints[rows]
    centre = (lengths[:, None] * midpoints).sum(axis=0) / lengths.sum()
    return bool((lengths * ((midpoints - centre) * surfaces.normals[rows]).sum(axis=1)).sum() < 0)
