"""`sgraph benchmark`: how long inference takes, and how that grows with the map."""

from __future__ import annotations

from typing import Annotated

import typer

from sgraph_cli.console import print_table, progress, warn_about_plugins

__all__ = ["benchmark"]


def benchmark(
    size: Annotated[
        list[int] | None,
        typer.Option(min=3, help="Wall surfaces of a map; 240, 1000, 4000 and 20000 if not given."),
    ] = None,
    repeats: Annotated[int, typer.Option(min=1, help="Runs of each stage; the median counts.")] = 5,
    seed: Annotated[int, typer.Option(min=0, help="Of the synthetic maps.")] = 0,
    rooms: Annotated[
        list[int] | None,
        typer.Option(min=1, help="Time optimising a block of so many rooms instead."),
    ] = None,
) -> None:
    """Time the stages of inference on synthetic maps, on one thread."""
    if rooms:
        _time_optimization(rooms, repeats, seed)
        return
    from rich import box
    from rich.table import Table

    from sgraph_core.detector import Detector
    from sgraph_core.evaluation.benchmark import SIZES, growth, time_stages

    detector = Detector()
    warn_about_plugins(list(detector.registry.problems))
    sizes = size or list(SIZES)
    times = []
    with progress() as report:
        for done, stage_times in enumerate(time_stages(detector, sizes, repeats, seed), start=1):
            times.append(stage_times)
            report("timing", done, len(sizes))
    table = Table(box=box.MARKDOWN)
    for column in (
        "surfaces", "preprocessing [ms]", "features [ms]", "forward pass [ms]",
        "features / forward pass", "whole inference [ms]",
    ):  # fmt: skip
        table.add_column(column, justify="right")
    for t in times:
        stages = (t.preprocessing, t.features, t.forward)
        table.add_row(
            str(t.surfaces),
            *(f"{1e3 * seconds:.1f}" for seconds in stages),
            f"{t.features / t.forward:.1f}",
            f"{1e3 * t.total:.1f}",
        )
    print_table(table)
    if len(set(sizes)) > 1:
        typer.echo(f"whole inference grows with surfaces to the power of {growth(times):.2f}")


def _time_optimization(rooms: list[int], repeats: int, seed: int) -> None:
    from rich import box
    from rich.table import Table

    from sgraph_core.evaluation.block import time_optimization

    table = Table(box=box.MARKDOWN)
    for column in (
        "rooms", "planes only [s]", "iterations", "with rooms and walls [s]", "iterations", "ratio",
    ):  # fmt: skip
        table.add_column(column, justify="right")
    with progress() as report:
        for done, t in enumerate(time_optimization(rooms, repeats, seed), start=1):
            report("optimising", done, len(rooms))
            table.add_row(
                str(t.rooms),
                f"{t.planes:.2f}",
                str(t.plane_iterations),
                f"{t.concepts:.2f}",
                str(t.concept_iterations),
                f"{t.concepts / t.planes:.2f}",
            )
    print_table(table)
