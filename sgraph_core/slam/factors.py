"""The factors of nodes and ties while the map changes: which there are, and which are off."""

from __future__ import annotations

from collections.abc import Container, Mapping
from dataclasses import dataclass, replace

import gtsam
import numpy as np

from sgraph_concepts.types import FactorResult, Memory, SurfaceArrays
from sgraph_core.backend.association import Proposal, Same
from sgraph_core.backend.keys import Keys
from sgraph_core.backend.observed import observed_in
from sgraph_core.backend.robust import Refusal
from sgraph_core.graph import SGraph
from sgraph_core.slam.clusters import Members
from sgraph_core.slam.estimate import Planes
from sgraph_core.slam.handout import Handout, Ledger, Owner
from sgraph_core.slam.makers import FactorMakers
from sgraph_core.slam.misfits import Misfits, Verdict
from sgraph_core.slam.nodes import LiveNodes, NodeChanges
from sgraph_core.slam.observed import ObservedSurfaces, surfaces_of
from sgraph_core.slam.ties import tied_anew

__all__ = ["Exchange", "LiveFactors"]

Subject = Owner | tuple[str, Members]
"""A tie, or a concept and the members of a node."""
Off = Mapping[Subject, Refusal]
"""Why factors are off."""


@dataclass(frozen=True, eq=False)
class Exchange:
    """Factors that go and come after a step of the concepts.

    Attributes:
        handout: what replaces them in the graph.
        off: why factors are off from now on.
        refused: what the last verdict refuses, by owner.
    """

    handout: Handout
    off: Off
    refused: Mapping[Owner, Subject]


class LiveFactors:
    """Keeps factors of nodes and ties in somebody's graph up to date.

    Attributes:
        ledger: where in the graph the factors are.
        off: why factors are off.

    Args:
        graph: the map; whoever changes it says so.
        keys: of its variables.
        makers: the factor functions.
        nodes: of each concept.
    """

    def __init__(
        self, graph: SGraph, keys: Keys, makers: FactorMakers, nodes: Mapping[str, LiveNodes]
    ) -> None:
        self._graph, self._keys, self._makers, self._nodes = graph, keys, makers, nodes
        self._observed = ObservedSurfaces()
        mapped = observed_in(graph)
        self._observed.add(mapped.surfaces, mapped.first_seen)
        self._seen_otherwise: set[int] = set()
        """Surfaces that are observed for the first time, or by an earlier keyframe than known."""
        self.lose({})

    def lose(self, off: Off) -> None:
        """Begin with an empty graph, in which some factors are off and nothing is tied."""
        self.ledger, self._misfits = Ledger(), Misfits(self._keys)
        self._ties: dict[Owner, Same] = {}
        self.off = off
        self._unmade = True

    @property
    def verdict(self) -> Verdict:
        """On the factors, as of the last solution."""
        return self._misfits.verdict

    @verdict.setter
    def verdict(self, verdict: Verdict) -> None:
        self._misfits.verdict = verdict

    @property
    def refusals(self) -> list[Refusal]:
        """Why factors of nodes and ties that there are are switched off."""
        ties = [self.off[owner] for owner in self._ties if owner in self.off]
        nodes = [
            replace(self.off[subject], node=node.id)
            for name in self._makers.concepts
            for node in self._nodes[name].in_order
            if (subject := (name, frozenset(node.members))) in self.off
        ]
        return nodes + ties

    # -- what the map says -----------------------------------------------------------------------

    def observe(self, surface: int, keyframe: int) -> None:
        """Take note that a keyframe observed a surface, both by id."""
        row = self._graph.keyframe_row(keyframe)
        if surface not in self._observed:
            self._observed.add(surfaces_of(self._graph, [surface]), np.array([row]))
            self._seen_otherwise.add(surface)
        elif self._observed.see(surface, row):
            self._seen_otherwise.add(surface)

    def move(self, now: SurfaceArrays) -> None:
        """Put surfaces where they are now."""
        self._observed.move(now)

    def judge(self, values: gtsam.Values, planes: Planes) -> Verdict:
        """Return the verdict on a solution, given its surfaces' planes; it is not remembered.

        Raises:
            ConceptError: a factor fails.
        """
        return self._misfits.judge(self._graph, values, *planes)

    # -- what follows from a step of the concepts --------------------------------------------------

    def exchange(self, changes: Mapping[str, NodeChanges]) -> Exchange:
        """Return the factors that go and come with changes of nodes; nothing is remembered yet.

        Raises:
            ConceptError: a factor function fails, or its factors are not fit for a graph.
        """
        found = self.verdict.found
        refused = {owner: self._subject(owner) for owner in found}
        off = {**self.off, **{refused[owner]: refusal for owner, refusal in found.items()}}
        gone, made = self._made(changes, off)
        replaced = {*gone, *(owner for owner, _ in made)}
        left = [(owner, FactorResult()) for owner in found if owner not in replaced]
        return Exchange(self.ledger.prepare(gone, [*made, *left]), off, refused)

    def commit(self, exchange: Exchange) -> list[Refusal]:
        """Remember an exchange, once its changes have been made.

        Returns:
            Why factors of nodes and ties that stay as they are have gone.
        """
        found, handout = self.verdict.found, exchange.handout
        self._take(handout, self._ties)
        self.off = exchange.off
        self._seen_otherwise, self._unmade = set(), False
        stay = [owner for owner in found if owner not in handout.gone]
        return [found[i] for i in stay if self._subject(i) == exchange.refused[i]]

    def drop_misfits(self) -> tuple[Handout, list[Refusal]]:
        """Return what removes the factors that the verdict refuses, and why they go."""
        found = self.verdict.found
        handout = self.ledger.prepare([], [(owner, FactorResult()) for owner in found])
        self._take(handout, self._ties)
        self.off = {**self.off, **{self._subject(owner): why for owner, why in found.items()}}
        return handout, list(found.values())

    def tie_anew(self) -> Handout:
        """Return what the ties ask for that the drive shows as it is now.

        Raises:
            ConceptError: a factor function fails, or proposes something else than pairs of
                observed surfaces.
            OptimizationError: sigmas differ by too much to tell how far the drive has drifted.
        """
        tied, made = tied_anew(self._graph, self._keys, self._proposals(), self._ties, self.off)
        handout = self.ledger.prepare(self._ties.keys() - tied.keys(), made)
        self._take(handout, tied)
        self._ties = tied
        self.off = {
            subject: refusal
            for subject, refusal in self.off.items()
            if len(subject) == 2 or subject in tied
        }
        return handout

    def _take(self, handout: Handout, ties: Mapping[Owner, Same]) -> None:
        self.ledger.commit(handout)
        self._misfits.take(handout, ties)

    def _subject(self, owner: Owner) -> Subject:
        """Return what is refused when factors of an owner are: a tie, or a node of its members."""
        if owner in self._ties:
            return owner
        return owner[0], frozenset(self._nodes[owner[0]].by_id[owner[1]].members)

    def _made(
        self, changes: Mapping[str, NodeChanges], off: Container[Subject]
    ) -> tuple[list[Owner], list[tuple[Owner, FactorResult]]]:
        """Return the nodes whose factors go, and those with new ones: none where they are off."""
        gone: list[Owner] = [
            (name, node.id) for name, change in changes.items() for node in change.removed
        ]
        made: list[tuple[Owner, FactorResult]] = []
        observed = self._observed.all
        for name in self._makers.concepts:
            change, nodes = changes[name], self._nodes[name]
            after = nodes.after(change)
            concerned = [node for i in self._seen_otherwise for node in nodes.having(i)]
            wanted = {node.id: node for node in (*concerned, *change.changed, *change.added)}
            for node in change.removed:
                wanted.pop(node.id, None)
            memory = Memory()
            for node in after if self._unmade else sorted(wanted.values(), key=lambda n: n.id):
                is_off = (name, frozenset(node.members)) in off
                result = self._makers.make(name, node, after, observed, memory)
                made.append(((name, node.id), FactorResult() if is_off else result))
        return gone, made

    def _proposals(self) -> list[Proposal]:
        """Return the pairs that all nodes take for one, as the map is now."""
        return [
            proposal
            for name in self._makers.concepts
            for proposal in self._makers.proposals(
                name, list(self._nodes[name].by_id.values()), self._observed.all
            )
        ]
