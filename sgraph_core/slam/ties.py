"""Which surfaces are tied while the map changes."""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence

from sgraph_concepts.types import FactorResult
from sgraph_core.backend.association import Association, Proposal, Same, associate
from sgraph_core.backend.concept_factors import ties
from sgraph_core.backend.keys import Keys
from sgraph_core.graph import SGraph
from sgraph_core.slam.handout import Owner

__all__ = ["tied_anew"]


def tied_anew(
    graph: SGraph,
    keys: Keys,
    proposals: Sequence[Proposal],
    before: Mapping[Owner, Same],
    off: Container[object],
) -> tuple[dict[Owner, Same], list[tuple[Owner, FactorResult]]]:
    """Return the ties that stay or come, and the factors of those that come.

    Args:
        graph: the map.
        keys: of its variables.
        proposals: pairs of surfaces that nodes take for one.
        before: the ties so far; one that no node proposes any more goes.
        off: those that get no factors.
    """
    pairs = {frozenset(pair) for proposal in proposals for pair in proposal.pairs}
    same = [pair for pair in before.values() if frozenset(pair.pair) in pairs]
    new = associate(graph, proposals, Association(same)).same
    tied: dict[Owner, Same] = {("same", *pair.pair): pair for pair in (*same, *new)}
    fresh = {o: pair for o, pair in tied.items() if o not in before and o not in off}
    factors = ties(list(fresh.values()), graph, keys)
    return tied, list(zip(fresh, factors, strict=True))
