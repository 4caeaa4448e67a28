"""Nodes keep their ids and names when a map is inferred again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import chain

import numpy as np

from sgraph_concepts.types import ConceptNode
from sgraph_core.tables import LARGEST_ID

__all__ = ["keep_identity", "persisting"]

SHARED = 0.5
"""An old node persists in a new one if they share this part of the smaller one's members."""


def keep_identity(
    new: Sequence[ConceptNode], old: Sequence[ConceptNode], names: Mapping[int, str]
) -> list[ConceptNode]:
    """Give new nodes the ids and names of the old ones that persist in them.

    Old and new nodes are matched one to one so that as many named ones as possible persist, and
    then so that they share the most members. Nodes without a match get ids above all old ones, in
    the order of their members; an id is not used again. Beyond the largest id, they get the lowest
    that are free.

    Args:
        new: nodes whose ids are not yet decided.
        old: the concept's nodes before.
        names: names decided by a person, by node id; they win over old ones.

    Returns:
        The new nodes by id.
    """
    ordered = sorted(new, key=lambda node: node.members)
    inherited = persisting(ordered, old, names)
    # a pinned name may belong to a node that is gone: its id is taken too, once there are nodes
    taken = {*(node.id for node in old), *(names if old else ())}
    above = max(taken, default=-1) + 1
    free = (i for i in chain(range(above, LARGEST_ID + 1), range(above)) if i not in taken)
    result = []
    for k, node in enumerate(ordered):
        before = inherited.get(k)
        node_id = next(free) if before is None else before.id
        name = names.get(node_id, node.name if before is None else before.name)
        result.append(replace(node, id=node_id, name=name))
    return sorted(result, key=lambda node: node.id)


def persisting(
    new: Sequence[ConceptNode], old: Sequence[ConceptNode], names: Mapping[int, str]
) -> dict[int, ConceptNode]:
    """Return the old node that persists in each new one, by the new one's place in the list."""
    if not new or not old:
        return {}
    from scipy.optimize import linear_sum_assignment

    before = [set(node.members) for node in old]
    shared = np.array([[len(b.intersection(node.members)) for b in before] for node in new])
    sizes = [len(node.members) for node in new], [len(b) for b in before]
    persists = (shared > 0) & (shared >= SHARED * np.minimum.outer(*sizes))
    named = np.array([node.id in names or node.name is not None for node in old])
    worth = np.where(persists, shared + named * (1 + shared.sum()), 0)
    rows, columns = linear_sum_assignment(-worth)
    return {
        int(row): old[column]
        for row, column in zip(rows, columns, strict=True)
        if worth[row, column]
    }
