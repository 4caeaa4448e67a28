"""Arguments that several subcommands share."""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from sgraph_core.graph import SGraph

__all__ = ["ScorerName", "Weights", "by_concept", "load_map"]

Weights = Annotated[
    Path | None,
    typer.Option(
        help="Folder that `sgraph train` wrote, instead of the shipped weights.", show_default=False
    ),
]


class ScorerName(StrEnum):
    """Who scores the relations."""

    network = "network"
    baseline = "baseline"


def by_concept(choices: Sequence[str], option: str) -> dict[str, str]:
    """Return ``concept=choice`` arguments as a mapping.

    Raises:
        typer.BadParameter: an argument is not of that form.
    """
    pairs = [choice.partition("=") for choice in choices]
    for concept, equals, choice in pairs:
        if not (concept and equals and choice):
            raise typer.BadParameter(
                f"{concept + equals + choice!r} must be CONCEPT=NAME", param_hint=option
            )
    return {concept: choice for concept, _, choice in pairs}


def load_map(path: Path) -> SGraph:
    """Read a map of any supported format."""
    from sgraph_core.map_file import load

    return load(path)
