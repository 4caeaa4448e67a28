"""The rules that nodes keep, and how they keep ids and names when a map is inferred again."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from itertools import chain

import numpy as np

from sgraph_concepts.spec import WALL_SURFACE
from sgraph_concepts.types import ConceptNode
from sgraph_core.tables import ID_RULE, LARGEST_ID, PlaceError, is_id

__all__ = ["check_nodes", "keep_identity", "persisting"]

PAIR_CONCEPTS = {"wall"}
"""Concepts whose nodes have exactly two members by the map file's definition."""
SURFACE_CONCEPTS = {"room", "wall"}
"""Concepts whose members are wall surfaces by the map file's definition."""

SHARED = 0.5
"""An old node persists in a new one if they share this part of the smaller one's members."""


def check_nodes(concepts: Mapping[str, Sequence[ConceptNode]], surfaces: Collection[int]) -> None:
    """Check the nodes of an S-Graph by the map file's rules.

    Args:
        concepts: the nodes by concept.
        surfaces: ids of the wall surfaces.

    Raises:
        PlaceError: a node breaks a rule.
    """
    for concept, nodes in concepts.items():
        for k, node in enumerate(nodes):
            _check_node(f"concepts.{concept}[{k}]", node)
        for value, count in Counter(node.id for node in nodes).items():
            if count > 1:
                raise PlaceError(f"concepts.{concept}: id", value, "must be unique")
    ids = {node.id for nodes in concepts.values() for node in nodes}
    for concept, nodes in concepts.items():
        others = () if concept in SURFACE_CONCEPTS else ids
        for k, node in enumerate(nodes):
            place = f"concepts.{concept}[{k}].members"
            for side, member in enumerate(node.members):
                if member not in surfaces and member not in others:
                    rule = f"must be the id of a {WALL_SURFACE} or node"
                    raise PlaceError(f"{place}[{side}]", member, rule)
            if len(set(node.members)) != len(node.members):
                raise PlaceError(place, list(node.members), "must be unique")
            if concept in PAIR_CONCEPTS and len(node.members) != 2:
                raise PlaceError(place, list(node.members), f"a {concept} has exactly two members")


def _check_node(place: str, node: ConceptNode) -> None:
    """Check what reading a map file's JSON makes sure of, and code that builds nodes may not."""
    if not isinstance(node, ConceptNode):
        raise PlaceError(place, repr(node), "must be a ConceptNode")
    if not is_id(node.id):
        raise PlaceError(f"{place}.id", node.id, ID_RULE)
    if not node.members:
        raise PlaceError(f"{place}.members", list(node.members), "must have at least 1 item")
    if node.confidence is not None and not 0 <= node.confidence <= 1:
        raise PlaceError(f"{place}.confidence", node.confidence, "must be from 0 to 1")
    centre, thickness = node.shape.centre, node.shape.thickness
    if centre is not None and not np.isfinite(centre).all():
        raise PlaceError(f"{place}.centre", list(centre), "must be finite")
    if thickness is not None and not 0 <= thickness < np.inf:
        raise PlaceError(f"{place}.thickness", thickness, "must be finite and not negative")


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
