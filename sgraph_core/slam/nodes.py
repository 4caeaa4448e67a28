"""The nodes of one concept while the map changes: ids stay, and only what changed is looked at."""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice

from sgraph_concepts.errors import InputError
from sgraph_concepts.types import ConceptNode, NodeShape
from sgraph_core.nodes import keep_identity, node_record, persisting
from sgraph_core.slam.clusters import Members
from sgraph_core.tables import LARGEST_ID

__all__ = ["LiveNodes", "NodeChanges"]

SAME_CONFIDENCE = 0.02
"""A node whose confidence alone changes by no more than this is the same."""


@dataclass(frozen=True)
class NodeChanges:
    """What became of the nodes of a concept.

    Attributes:
        added: new ones, by id.
        changed: those with other members, another shape, confidence or name, as they are now.
        removed: those that are gone, as they were.
    """

    added: list[ConceptNode] = field(default_factory=list)
    changed: list[ConceptNode] = field(default_factory=list)
    removed: list[ConceptNode] = field(default_factory=list)

    def __bool__(self) -> bool:
        return bool(self.added or self.changed or self.removed)


class LiveNodes:
    """The nodes of a concept.

    Attributes:
        by_id: all nodes.

    Args:
        concept: its name.
        nodes: those to begin with; of several with the same members one counts, a named one first.
    """

    def __init__(self, concept: str, nodes: Sequence[ConceptNode] = ()) -> None:
        self._concept = concept
        self._of_members: dict[Members, int] = {}
        for node in sorted(nodes, key=lambda node: (node.name is None, node.id)):
            self._of_members.setdefault(frozenset(node.members), node.id)
        kept = set(self._of_members.values())
        self.by_id = {node.id: node for node in nodes if node.id in kept}
        self._of_member: dict[int, set[int]] = {}
        for node in self.by_id.values():
            self._enter(node)
        self._next = max((node.id for node in nodes), default=-1) + 1

    @property
    def members(self) -> set[Members]:
        """The members of each node."""
        return set(self._of_members)

    @property
    def in_order(self) -> list[ConceptNode]:
        """All nodes, by id."""
        return _by_id(list(self.by_id.values()))

    def after(self, changes: NodeChanges) -> list[ConceptNode]:
        """Return all nodes as they will be after some changes."""
        now = self.by_id | {node.id: node for node in (*changes.changed, *changes.added)}
        for node in changes.removed:
            del now[node.id]
        return list(now.values())

    def having(self, member: int) -> list[ConceptNode]:
        """Return the nodes that have a member."""
        return [self.by_id[i] for i in sorted(self._of_member.get(member, ()))]

    def compare(
        self, now: Mapping[Members, float | None], names: Mapping[int, str]
    ) -> tuple[NodeChanges, dict[int, Members]]:
        """Return what changes when there are nodes of these members, this sure, or none.

        A node persists in one of the same members, else in one that shares half of the smaller
        one's members or more, matched one to one; an id is not used again. Once there are nodes,
        new ones get no id that has a name.

        Args:
            now: how sure the nodes are, None for those that are not, by their members.
            names: names decided by a person, by node id.

        Returns:
            The changes, shapes not yet looked at; the members of all nodes that there are of
            these, by id.

        Raises:
            InputError: there is no id left.
        """
        came, gone, changed, there = [], [], [], {}
        for members, confidence in now.items():
            before = self.by_id.get(self._of_members.get(members, -1))
            if confidence is None:
                gone += [before] if before else []
            elif before is None:
                came.append(ConceptNode(0, tuple(sorted(members)), confidence=confidence))
            else:
                there[before.id] = members
                if not _as_sure(before.confidence, confidence):
                    changed.append(replace(before, confidence=confidence))
        came.sort(key=lambda node: node.members)
        gone = _by_id(gone)
        inherited = persisting(came, gone, names)
        changed += [
            replace(before, members=came[k].members, confidence=came[k].confidence)
            for k, before in inherited.items()
        ]
        new = [node for k, node in enumerate(came) if k not in inherited]
        added = self._numbered(new, names if self.by_id else ())
        there |= {node.id: frozenset(node.members) for node in (*added, *changed)}
        kept = {before.id for before in inherited.values()}
        return NodeChanges(added, changed, [node for node in gone if node.id not in kept]), there

    def shaped(self, changes: NodeChanges, shapes: Mapping[int, NodeShape]) -> NodeChanges:
        """Return changes with these shapes, and with the nodes whose shape alone has changed."""
        told = {node.id for node in (*changes.added, *changes.changed)}
        now = [replace(self.by_id[i], shape=shape) for i, shape in shapes.items() if i not in told]
        others = [node for node in now if not _alike(node, self.by_id[node.id])]
        added, changed = (
            [replace(node, shape=shapes.get(node.id, node.shape)) for node in nodes]
            for nodes in (changes.added, changes.changed)
        )
        return NodeChanges(added, _by_id([*changed, *others]), _by_id(changes.removed))

    def named(self, changes: NodeChanges, names: Mapping[int, str]) -> NodeChanges:
        """Return changes after which the nodes have these names, and others keep theirs."""
        told = {node.id for node in (*changes.changed, *changes.removed)}
        others = [
            self.by_id[i]
            for i, name in names.items()
            if i in self.by_id and i not in told and self.by_id[i].name != name
        ]
        added, changed = (
            [replace(node, name=names.get(node.id, node.name)) for node in nodes]
            for nodes in (changes.added, [*changes.changed, *others])
        )
        return NodeChanges(added, _by_id(changed), changes.removed)

    def identified(self, nodes: Sequence[ConceptNode]) -> list[ConceptNode]:
        """Return nodes with the ids and names of those that persist in them, others with new ids.

        Raises:
            InputError: there is no id left.
        """
        known = keep_identity(nodes, list(self.by_id.values()), {})
        new = self._numbered([node for node in known if node.id not in self.by_id])
        return [*(node for node in known if node.id in self.by_id), *new]

    def replaced_by(self, nodes: Sequence[ConceptNode]) -> NodeChanges:
        """Return what changes when there are these nodes and no others."""
        now = {node.id: node for node in nodes}
        return NodeChanges(
            [node for node in nodes if node.id not in self.by_id],
            [node for node in nodes if not _alike(node, self.by_id.get(node.id, node))],
            [node for node in self.by_id.values() if node.id not in now],
        )

    def apply(self, changes: NodeChanges) -> None:
        """Make changes."""
        for node in (*changes.removed, *(self.by_id[node.id] for node in changes.changed)):
            del self.by_id[node.id], self._of_members[frozenset(node.members)]
            for member in node.members:
                self._of_member[member].discard(node.id)
        for node in (*changes.changed, *changes.added):
            self.by_id[node.id] = node
            self._of_members[frozenset(node.members)] = node.id
            self._enter(node)
        self._next = max([self._next, *(node.id + 1 for node in changes.added)])

    def _numbered(
        self, nodes: Sequence[ConceptNode], taken: Container[int] = ()
    ) -> list[ConceptNode]:
        """Return new nodes with ids that were not used before, and are not taken otherwise."""
        free = (i for i in range(self._next, LARGEST_ID + 1) if i not in taken)
        ids = list(islice(free, len(nodes)))
        if len(ids) < len(nodes):
            raise InputError(f"there is no id left for a {self._concept}")
        return [replace(node, id=i) for node, i in zip(nodes, ids, strict=True)]

    def _enter(self, node: ConceptNode) -> None:
        for member in node.members:
            self._of_member.setdefault(member, set()).add(node.id)


def _alike(one: ConceptNode, two: ConceptNode) -> bool:
    """Return whether nodes are saved alike: their attributes may hold arrays, which lack an ==."""
    return one is two or node_record(one) == node_record(two)


def _as_sure(before: float | None, now: float) -> bool:
    return before is not None and abs(before - now) <= SAME_CONFIDENCE


def _by_id(nodes: Sequence[ConceptNode]) -> list[ConceptNode]:
    return sorted(nodes, key=lambda node: node.id)
