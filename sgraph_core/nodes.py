"""The rules that nodes keep, and how they keep ids and names when a map is inferred again."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from itertools import chain
from typing import Any

import numpy as np

from sgraph_concepts.spec import WALL_SURFACE
from sgraph_concepts.types import ConceptNode, NodeShape
from sgraph_core.map_schema import FORMAT, UNITS, VERSION
from sgraph_core.structure import (
    Steps,
    StructureError,
    place_of,
    refuse_lone_surrogates,
    structured,
)
from sgraph_core.tables import ID_RULE, LARGEST_ID, RuleError

__all__ = [
    "check_links",
    "check_nodes",
    "checked_records",
    "keep_identity",
    "node_record",
    "persisting",
]

PAIR_CONCEPTS = {"wall"}
"""Concepts whose nodes have exactly two members by the map file's definition."""
SURFACE_CONCEPTS = {"room", "wall"}
"""Concepts whose members are wall surfaces by the map file's definition."""

EMPTY_MAP = {"format": FORMAT, "version": VERSION, "units": UNITS, "wall_surfaces": []}
RULES = {
    "id": ID_RULE,
    "centre": "must be finite, x and y within 1e8 m",
    "thickness": "must be finite and not negative",
    "confidence": "must be from 0 to 1",
}
"""What is asked of some fields of a node: errors name them as a whole."""
SHARED = 0.5
"""An old node persists in a new one if they share this part of the smaller one's members."""


def check_nodes(concepts: Mapping[str, Sequence[ConceptNode]], surfaces: Collection[int]) -> None:
    """Check the nodes of an S-Graph by the map file's rules.

    Args:
        concepts: the nodes by concept.
        surfaces: ids of the wall surfaces.

    Raises:
        RuleError: a node breaks a rule, so that a map file could not be read with it.
    """
    checked_records(concepts, surfaces)


def checked_records(
    concepts: Mapping[str, Sequence[ConceptNode]], surfaces: Collection[int]
) -> dict[str, list[dict[str, Any]]]:
    """Return the nodes as the map file's JSON holds them; see :func:`check_nodes`."""
    records = {
        concept: [_record(("concepts", concept, k), node) for k, node in enumerate(nodes)]
        for concept, nodes in concepts.items()
    }
    try:
        structured(EMPTY_MAP | {"concepts": records})
        refuse_lone_surrogates({"concepts": records})
    except StructureError as error:
        raise _of_field(error, records) from error
    check_links(concepts, surfaces)
    return records


def check_links(concepts: Mapping[str, Sequence[ConceptNode]], surfaces: Collection[int]) -> None:
    """Check ids and members of nodes, each of which alone keeps the rules; likewise."""
    for concept, nodes in concepts.items():
        for value, count in Counter(node.id for node in nodes).items():
            if count > 1:
                raise RuleError(f"concepts.{concept}: id", value, "must be unique")
    ids = {node.id for nodes in concepts.values() for node in nodes}
    for concept, nodes in concepts.items():
        others, kinds = ((), "") if concept in SURFACE_CONCEPTS else (ids, " or node")
        for k, node in enumerate(nodes):
            place = f"concepts.{concept}[{k}].members"
            for side, member in enumerate(node.members):
                if member not in surfaces and member not in others:
                    rule = f"must be the id of a {WALL_SURFACE}{kinds}"
                    raise RuleError(f"{place}[{side}]", member, rule)
            if len(set(node.members)) != len(node.members):
                raise RuleError(place, list(node.members), "must be unique")
            if concept in PAIR_CONCEPTS and len(node.members) != 2:
                raise RuleError(place, list(node.members), f"a {concept} has exactly two members")


def node_record(node: ConceptNode) -> dict[str, Any]:
    """Return a node as the map file's JSON holds it."""
    shape = node.shape
    record = {
        "id": _plain(node.id),
        "name": node.name,
        "members": _plain(node.members),
        "centre": _plain(shape.centre),
        "polygon": _plain(shape.polygon),
        "holes": _plain(shape.holes) or None,
        "thickness": _plain(shape.thickness),
        "confidence": _plain(node.confidence),
        "attributes": _plain(shape.attributes) or None,
    }
    optional = record.keys() - {"id", "members"}
    return {key: value for key, value in record.items() if not (key in optional and value is None)}


def _record(steps: Steps, node: object) -> dict[str, Any]:
    if not isinstance(node, ConceptNode):
        raise StructureError(steps, node, "must be a ConceptNode")
    if not isinstance(node.shape, NodeShape):
        raise StructureError((*steps, "shape"), node.shape, "must be a NodeShape")
    try:
        return node_record(node)
    except RecursionError:
        raise RuleError(f"{place_of(steps)}.attributes", "...", "is nested too deeply") from None


def _of_field(error: StructureError, records: Mapping[str, list[dict[str, Any]]]) -> RuleError:
    """Return an error that names a field as a whole, if there is a rule for it."""
    match error.steps:
        case ("concepts", str(concept), int(k), str(field), *_) if field in RULES:
            return RuleError(place_of(error.steps[:4]), records[concept][k][field], RULES[field])
    return error


def _plain(value: Any) -> Any:
    """Return a value as a JSON reader would: numpy's numbers and collections as Python's."""
    if type(value) in (int, float, str):  # most are, and to ask what else something is takes long
        return value
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Mapping):
        return {key: _plain(part) for key, part in value.items()}
    if isinstance(value, Collection) and not isinstance(value, str | bytes):
        return [_plain(part) for part in value]
    return value


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
