"""`sgraph sweep`: how scores change with yaw, noise, what is missing, and so on."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from sgraph_cli.console import note, progress, warn_about_plugins

__all__ = ["sweep"]


def sweep(
    output: Annotated[
        Path, typer.Option("-o", "--output", help="Folder for sweeps.json and sweeps.png.")
    ],
    floors: Annotated[int, typer.Option(min=1, help="Buildings per value.")] = 20,
    seed: Annotated[
        int, typer.Option(min=0, help="Of the buildings; another one than training's.")
    ] = 1000,
) -> None:
    """Score synthetic buildings while one property at a time takes several values."""
    from sgraph_core.detector import Detector
    from sgraph_core.evaluation.sweeps import SWEEPS, Point, run_sweep, write_sweeps

    output.mkdir(parents=True, exist_ok=True)
    detector = Detector()
    warn_about_plugins(list(detector.registry.problems))
    results: dict[str, list[Point]] = {}
    total = sum(len(one.values) for one in SWEEPS)
    with progress() as report:
        for one in SWEEPS:
            results[one.name] = []
            for point in run_sweep(one, floors, seed, detector):
                results[one.name].append(point)
                report("sweeping", sum(map(len, results.values())), total)
    write_sweeps(results, floors, seed, output)
    note(f"wrote sweeps of {', '.join(results)} to {output}")
