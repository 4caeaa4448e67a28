"""Which factors and variables of the concepts' nodes are in somebody's factor graph."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import gtsam

from sgraph_concepts.errors import ConceptError, InputError
from sgraph_concepts.types import FactorResult

__all__ = ["Handout", "Ledger", "Owner"]

Owner = tuple[str, int] | tuple[str, int, int]
"""Concept and id of a node, or ``same`` and the ids of two surfaces that are tied."""


@dataclass(frozen=True, eq=False)
class Handout:
    """What to do to a factor graph: see :class:`sgraph_core.slam.Update`."""

    factors: gtsam.NonlinearFactorGraph
    values: gtsam.Values
    remove: list[int]
    unused: list[int]
    gone: list[Owner]
    made: list[tuple[Owner, FactorResult]]


@dataclass(frozen=True)
class _Held:
    """What a node has in the graph: keys of its variables, indices of its factors."""

    keys: frozenset[int] = frozenset()
    indices: tuple[int, ...] = ()


class Ledger:
    """Remembers where the factors of each node are."""

    def __init__(self) -> None:
        self._held: dict[Owner, _Held] = {}
        self._owner: dict[int, Owner] = {}
        self._waiting: list[tuple[Owner, int]] = []

    @property
    def used(self) -> bool:
        """Whether there are factors of any node."""
        return bool(self._held)

    @property
    def waiting(self) -> int:
        """How many factors of the last handout have no indices yet."""
        return sum(count for _, count in self._waiting)

    def require_placed(self) -> None:
        """Raise an InputError if factors of the last handout have no indices yet."""
        if self.waiting:
            raise InputError(
                f"the last update has {self.waiting} factors: "
                "say with placed() at which indices they are"
            )

    def prepare(self, gone: Iterable[Owner], made: Sequence[tuple[Owner, FactorResult]]) -> Handout:
        """Return what replaces the factors of some nodes; nothing is remembered yet.

        A variable that a node keeps stays in the graph with its value there: ISAM2 takes no second
        value for a key, and drops a variable only together with the last factor on it.

        Args:
            gone: nodes whose factors go.
            made: nodes with their factors; those that they have had so far go.

        Raises:
            ConceptError: two nodes have a variable of one key.
        """
        factors, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        gone, replaced = list(gone), [node for node, _ in made]
        concerned = [self._held[node] for node in (*gone, *replaced) if node in self._held]
        present = {key for held in concerned for key in held.keys}
        kept = set()
        for node, result in made:
            for factor in result.factors:
                factors.add(factor)
            for key, value in result.values:
                owner = self._owner.get(key, node)
                if values.exists(key) or key in kept or owner != node:
                    raise ConceptError(f"{node[0]} {node[1]}: its variable {key} exists already")
                if key in present:
                    kept.add(key)
                else:
                    values.insert(key, value)
        remove = sorted(index for held in concerned for index in held.indices)
        return Handout(factors, values, remove, sorted(present - kept), gone, list(made))

    def commit(self, handout: Handout) -> None:
        """Remember what a handout replaces; its factors wait for their indices."""
        for node in (*handout.gone, *(node for node, _ in handout.made)):
            for key in self._held.pop(node, _Held()).keys:
                del self._owner[key]
        self._waiting = []
        for node, result in handout.made:
            if result.factors:
                keys = frozenset(key for key, _ in result.values)
                self._held[node] = _Held(keys)
                self._owner |= dict.fromkeys(keys, node)
                self._waiting.append((node, len(result.factors)))

    def placed(self, indices: Sequence[int]) -> None:
        """Say at which indices the factors of the last handout are, in their order.

        Raises:
            InputError: there are more or fewer of them.
        """
        if len(indices) != self.waiting:
            raise InputError(
                f"{len(indices)} indices are given for {self.waiting} factors of the last update"
            )
        start = 0
        for node, count in self._waiting:
            own = tuple(int(index) for index in indices[start : start + count])
            self._held[node] = _Held(self._held[node].keys, own)
            start += count
        self._waiting = []
