"""Arguments that several subcommands share."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sgraph_cli.console import note, progress, warn_about_plugins, warnings_as_notes

if TYPE_CHECKING:
    from sgraph_core.detector import Detector
    from sgraph_core.graph import SGraph

__all__ = [
    "Clusterers",
    "MapFile",
    "Scorer",
    "ScorerName",
    "Weights",
    "by_concept",
    "load_map",
    "make_detector",
    "naming",
    "refuse_beside",
    "warn_about_absent",
    "warn_about_lists",
]


class ScorerName(StrEnum):
    """Who scores the relations."""

    network = "network"
    baseline = "baseline"


MapFile = Annotated[
    Path,
    typer.Argument(
        metavar="MAP", help="A sgraph-map JSON file, or the YAML file of a ROS map_server map."
    ),
]
Scorer = Annotated[
    ScorerName, typer.Option(help="The trained network, or the rules without learning.")
]
Weights = Annotated[
    Path | None, typer.Option(help="Folder that `sgraph train` wrote, to take weights from.")
]
Clusterers = Annotated[
    list[str] | None,
    typer.Option(
        metavar="CONCEPT=NAME",
        help="Another clusterer for a concept, such as room=cycles (the paper's Algorithm 1).",
    ),
]


def make_detector(
    scorer: ScorerName,
    weights: Path | None,
    clusterer: Sequence[str] | None,
    *,
    calibrated: bool = True,
) -> Detector:
    """Return the detector that the options of these names ask for; warn of broken plugins.

    Raises:
        typer.BadParameter: the options contradict one another, or one is malformed.
    """
    if scorer is ScorerName.baseline:
        refuse_beside("--scorer baseline", {"--weights": weights})
    clusterers = by_concept(clusterer or [], "--clusterer")
    from sgraph_core.detector import Detector

    detector = Detector(
        scorer=scorer.value, clusterers=clusterers, weights=weights, calibrated=calibrated
    )
    warn_about_plugins(list(detector.registry.problems))
    return detector


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


def refuse_beside(option: str, others: Mapping[str, object]) -> None:
    """Refuse what an option leaves without effect.

    Args:
        option: the option, which was given.
        others: values of other options by name; one that is false or None was not given.

    Raises:
        typer.BadParameter: another one was given too.
    """
    for other, value in others.items():
        if value:
            raise typer.BadParameter(f"cannot be combined with {option}", param_hint=other)


def warn_about_lists(paths: Sequence[Path], lists: Sequence[Path]) -> None:
    """Say on stderr which names of lists are of no map in any of the paths."""
    from sgraph_core.evaluation.sources import absent_names

    warn_about_absent(absent_names(paths, lists))


def warn_about_absent(absent: Mapping[Path, Sequence[str]]) -> None:
    """Say on stderr which names, by the list they stand in, are of no map."""
    for file, names in absent.items():
        note(f"sgraph: warning: {file}: no PATH holds {', '.join(names)}")


def load_map(path: Path) -> SGraph:
    """Read a map of any supported format; warn of what looks wrong in it."""
    from sgraph_core.formats import load

    with progress() as report, warnings_as_notes():
        return load(path, report)


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Let what cannot be done with a map be told with its file's name first.

    What is wrong with a concept is told with the concept's name already.
    """
    from sgraph_concepts.errors import InputError, OptimizationError, SGraphError

    try:
        yield
    except (InputError, OptimizationError) as error:
        raise SGraphError(f"{path}: {error}") from error
