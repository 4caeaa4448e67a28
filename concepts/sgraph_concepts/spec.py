"""How a concept is declared: a frozen, validated description that imports nothing heavy."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

from sgraph_concepts.errors import ConceptError

__all__ = ["WALL_SURFACE", "ConceptSpec", "ConfidenceSpec", "HeadSpec", "Reference", "resolve"]

WALL_SURFACE = "wall_surface"
"""The layer every map has: what a concept groups unless it groups another concept's nodes."""


def _check_reference(text: str) -> str:
    module, _, attribute = text.partition(":")
    names = [*module.split("."), *attribute.split(".")] if attribute else [module]
    if not all(name.isidentifier() for name in names) or (not attribute and "." in module):
        raise ValueError(
            f"{text!r} must be 'package.module:attribute' or the bare name of a built-in part"
        )
    return text


Name = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$", max_length=64)]
Reference = Annotated[str, AfterValidator(_check_reference)]
"""A part of a concept: ``package.module:attribute``, or the bare name of a built-in."""


class _Frozen(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)


class HeadSpec(_Frozen):
    """The classifier that turns the shared encoder's embeddings into one relation's log-odds."""

    weights: str = Field(
        description="ONNX file of the trained head, beside the module that declares the concept.",
        pattern=r"^[\w.-]+\.onnx$",
    )
    encoder: str = Field(
        description="Version of the shared encoder and its features that the head was trained on."
    )
    hidden: int = Field(
        default=32, ge=1, le=1024, description="Width of the head's two hidden layers."
    )
    intercept: float = Field(
        default=0.0,
        description="Log-odds of the relation where the head says 0; `sgraph calibrate` fits it.",
    )
    slope: float = Field(
        default=1.0,
        gt=0,
        description="Log-odds of the relation per unit of what the head says; likewise.",
    )


class ConfidenceSpec(_Frozen):
    """From the confidence that the clusterer gives a node to the probability that it is right.

    The log-odds that a node is right are ``intercept + slope * log-odds of the clusterer's
    confidence + members * log(number of members)``. `sgraph calibrate` fits the constants; they
    hold for the scorer and the clusterer that the concept declares.
    """

    intercept: float = Field(description="Log-odds where both terms vanish.")
    slope: float = Field(description="Per unit of the log-odds of the clusterer's confidence.")
    members: float = Field(description="Per unit of the logarithm of the number of members.")


class ConceptSpec(_Frozen):
    """Everything the framework needs to know about one concept.

    Parts are references, resolved when first used, so that listing concepts stays cheap. A part
    is a function; docs/concepts.md gives each one's signature and contract.
    """

    name: Name = Field(description="What a node of the concept is called, such as 'room'.")
    groups: Name = Field(
        default=WALL_SURFACE,
        description="What the concept's members are: 'wall_surface' or another concept's name.",
    )
    relation: Name = Field(
        description="The relation between two members of one node, such as 'same_room'."
    )
    description: str = Field(default="", description="One line for `sgraph concepts list`.")
    head: HeadSpec | None = Field(
        default=None, description="The learned scorer of the relation; none if it is not learned."
    )
    baseline: Reference | None = Field(
        default=None,
        description="A scorer without learning: (Scene) -> log-odds of the scene's pairs, [E].",
    )
    clusterer: Reference = Field(
        description="(ScoredEdges, Scene) -> list of Cluster, independent of the order of rows."
    )
    confidence: ConfidenceSpec | None = Field(
        default=None,
        description="Makes a node's confidence the probability that it is right; without it a "
        "node's confidence is what the clusterer says.",
    )
    shape: Reference | None = Field(
        default=None,
        description="(rows of members by node id, Scene) -> NodeShape by node id; the mean of the "
        "members' midpoints if none.",
    )
    factor: Reference | None = Field(
        default=None,
        description="(ConceptNode, FactorContext) -> FactorResult; none if it adds no factors.",
    )
    labeller: Reference | None = Field(
        default=None,
        description="(BuildingTruth) -> related pairs of rows, [P, 2]; needed to train the head.",
    )
    exclusive: bool = Field(
        default=True,
        description="Whether a fragment of a surface may belong to one node of the concept only. "
        "A surface that was mapped twice then joins its node together with its copy; otherwise "
        "the copy gives nodes of its own.",
    )
    local: bool = Field(
        default=False,
        description="Whether the clusterer decides about surfaces, and how sure it is, apart from "
        "all that no chain of pairs more likely related than not links them to.",
    )

    @model_validator(mode="after")
    def _check_scorers(self) -> ConceptSpec:
        if self.head is None and self.baseline is None:
            raise ValueError("a concept needs a head or a baseline to score its relation with")
        if self.groups == self.name:
            raise ValueError(f"a concept cannot group its own nodes, but {self.name!r} does")
        return self


def resolve(reference: str, builtins: Mapping[str, str], used_by: str) -> Any:
    """Return the object that a reference names.

    Args:
        reference: ``package.module:attribute`` or the bare name of a built-in.
        builtins: references of the built-in parts of the kind wanted, by name.
        used_by: who asks, for the error's text, such as ``clusterer of concept 'room'``.

    Raises:
        ConceptError: the name is unknown, the module fails to import or lacks the attribute.
    """
    target = reference if ":" in reference else builtins.get(reference)
    if target is None:
        known = ", ".join(sorted(builtins)) or "none"
        raise ConceptError(
            f"{used_by}: {reference!r} is neither 'package.module:attribute' "
            f"nor a built-in (known: {known})"
        )
    module_name, _, attribute = target.partition(":")
    try:
        part: Any = importlib.import_module(module_name)
        for name in attribute.split("."):
            part = getattr(part, name)
    except Exception as error:  # a third party's module may raise anything while it is imported
        raise ConceptError(f"{used_by}: {target!r} cannot be loaded: {error}") from error
    return part
