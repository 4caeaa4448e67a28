"""`sgraph calibrate`: from the clusterers' confidences to the probability that a node is right."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from sgraph_cli.console import note, progress, warn_about_plugins

__all__ = ["calibrate"]


def calibrate(
    paths: Annotated[
        list[Path], typer.Argument(metavar="PATH...", help="Map files with truth, or folders.")
    ],
    only: Annotated[
        list[Path] | None, typer.Option(help="Only the maps that this text file names.")
    ] = None,
) -> None:
    """Fit the confidence of rooms and walls, and print it as their declarations take it.

    The maps should be neither those that the network was trained on nor those that are reported.
    """
    from sgraph_core.detector import Detector
    from sgraph_core.evaluation.node_confidence import fit_confidence
    from sgraph_core.evaluation.report import evaluate

    detector = Detector(calibrated=False)
    warn_about_plugins(list(detector.registry.problems))
    with progress() as report:
        reports = evaluate(paths, detector, None, report, only or [])
    floors = [floor for source in reports for floor in source.floors]
    for concept in ("room", "wall"):
        judged = [one for floor in floors for one in floor.score.judged[concept]]
        if not judged:
            note(f"sgraph: warning: no {concept} was found on labelled surfaces: nothing to fit")
            continue
        spec = fit_confidence(judged)
        constants = ", ".join(f"{name}={value}" for name, value in spec)
        typer.echo(f"{concept}: confidence=ConfidenceSpec({constants})")
        note(f"  fitted to {len(judged)} nodes of {len(floors)} maps")
