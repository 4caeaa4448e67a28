"""The factors of single nodes, made while the map changes."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import gtsam

from sgraph_concepts.registry import RegisteredConcept, Registry
from sgraph_concepts.types import (
    ConceptNode,
    FactorContext,
    FactorResult,
    FloatArray,
    Memory,
)
from sgraph_core.backend.association import Proposal
from sgraph_core.backend.checks import check_factors
from sgraph_core.backend.concept_factors import factor_context, factor_functions, made_by
from sgraph_core.backend.keys import Keys
from sgraph_core.backend.observed import Observed

__all__ = ["FactorMakers"]


class FactorMakers:
    """The concepts' factor functions.

    Args:
        registry: what the functions are declared in.
        concepts: those that group wall surfaces and are inferred.
        factor_types: by concept, another factor type than the declared one.
        keys: the keys of surfaces and nodes.

    Raises:
        ConceptError: a concept or a factor type is unknown.
    """

    def __init__(
        self,
        registry: Registry,
        concepts: Sequence[RegisteredConcept],
        factor_types: Mapping[str, str],
        keys: Keys,
    ) -> None:
        self._keys = keys
        self._makers = factor_functions(registry, concepts, factor_types)

    @property
    def concepts(self) -> Collection[str]:
        """Names of the concepts that have factors."""
        return self._makers.keys()

    def make(
        self,
        concept: str,
        node: ConceptNode,
        nodes: Sequence[ConceptNode],
        observed: Observed,
        memory: Memory,
    ) -> FactorResult:
        """Return the checked factors of a node.

        Args:
            concept: its concept.
            node: whose factors.
            nodes: all nodes of the concept.
            observed: the surfaces that some keyframe observed.
            memory: of what the functions compute once for all of these nodes.

        Raises:
            ConceptError: the factor function fails, or its factors are not fit for a graph.
        """
        context = factor_context(concept, node, nodes, self._keys, observed, memory)
        result = made_by(self._makers[concept], concept, node, context)
        check_factors(f"factor of {concept} {node.id}", result, _planes(context), gtsam.Values())
        return result

    def proposals(
        self, concept: str, nodes: Sequence[ConceptNode], observed: Observed
    ) -> list[Proposal]:
        """Return the pairs of surfaces that each node of a concept takes for one.

        Raises:
            ConceptError: the factor function fails.
        """
        make, memory = self._makers[concept], Memory()
        contexts = (
            factor_context(concept, node, nodes, self._keys, observed, memory) for node in nodes
        )
        return [
            Proposal(concept, node.id, made_by(make, concept, node, context).same)
            for node, context in zip(nodes, contexts, strict=True)
        ]


def _planes(context: FactorContext) -> dict[int, FloatArray]:
    return {key: context.planes[member] for member, key in context.plane_keys.items()}
