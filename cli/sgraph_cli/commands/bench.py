"""`sgraph bench`: how long inference takes."""

from __future__ import annotations

from typing import Annotated

import typer

from sgraph_cli.console import print_table, progress, warn_about_plugins

__all__ = ["app"]

app = typer.Typer(help="Measure how good and how fast the method is.", no_args_is_help=True)


@app.command("speed")
def speed(
    size: Annotated[
        list[int] | None,
        typer.Option(min=3, help="Wall surfaces of a map; 240, 1000, 4000 and 20000 if not given."),
    ] = None,
    repeats: Annotated[int, typer.Option(min=1, help="Runs of each stage; the median counts.")] = 5,
    seed: Annotated[int, typer.Option(min=0, help="Of the synthetic maps.")] = 0,
) -> None:
    """Time the stages of inference on synthetic maps, on one thread."""
    from rich import box
    from rich.table import Table

    from sgraph_core.detector import Detector
    from sgraph_core.evaluation.speed import SIZES, growth, time_stages

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
