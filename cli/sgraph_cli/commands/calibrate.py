"""`sgraph calibrate`: from scores to probabilities that mean what they say."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from sgraph_cli.arguments import warn_about_lists
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
    """Fit the probabilities of rooms and walls, and print them as their declarations take them.

    The maps should be neither those that the network was trained on nor those that are reported.
    """
    import numpy as np

    from sgraph_core.detector import Detector
    from sgraph_core.evaluation.fitting import fit_confidence, fit_relation, gather_outcomes

    detector = Detector(calibrated=False)
    warn_about_plugins(list(detector.registry.problems))
    warn_about_lists(paths, only or [])
    with progress() as report:
        outcomes = gather_outcomes(paths, only or [], detector, report)
    for concept, found in outcomes.items():
        logits = np.concatenate(found.logits)
        intercept, slope = fit_relation(logits, np.concatenate(found.related))
        typer.echo(f"{concept}: head=HeadSpec(..., intercept={intercept}, slope={slope})")
        note(f"  fitted to {len(logits)} pairs of {len(found.logits)} maps")
        if not found.judged:
            note(f"sgraph: warning: no {concept} was found on labelled surfaces: nothing to fit")
            continue
        constants = ", ".join(f"{name}={value}" for name, value in fit_confidence(found.judged))
        typer.echo(f"{concept}: confidence=ConfidenceSpec({constants})")
        note(f"  fitted to {len(found.judged)} nodes of {len(found.logits)} maps")
