"""`sgraph benchmark`: how long inference takes, and how that grows with the map."""

from __future__ import annotations

from dataclasses import astuple
from typing import TYPE_CHECKING, Annotated

import typer

from sgraph_cli.console import print_table, progress, warn_about_plugins

if TYPE_CHECKING:
    from rich.table import Table

    from sgraph_core.detector import Detector

__all__ = ["benchmark"]


def benchmark(
    size: Annotated[
        list[int] | None,
        typer.Option(min=3, help="Wall surfaces of a map; 240, 1000, 4000 and 20000 if not given."),
    ] = None,
    repeats: Annotated[int, typer.Option(min=1, help="Runs of each stage; the median counts.")] = 5,
    seed: Annotated[int, typer.Option(min=0, help="Of the synthetic maps.")] = 0,
    incremental: Annotated[
        bool, typer.Option("--incremental", help="Time updates keyframe by keyframe instead.")
    ] = False,
    rooms: Annotated[
        list[int] | None,
        typer.Option(
            min=2, help="With --incremental: rooms of a map; 20, 100 and 1000 if not given."
        ),
    ] = None,
) -> None:
    """Time the stages of inference on synthetic maps, on one thread."""
    from sgraph_core.detector import Detector

    if rooms and not incremental:
        raise typer.BadParameter("goes with --incremental", param_hint="--rooms")
    if incremental and size:
        raise typer.BadParameter("does not go with --incremental", param_hint="--size")
    detector = Detector()
    warn_about_plugins(list(detector.registry.problems))
    if incremental:
        _time_updates(detector, rooms, seed)
    else:
        _time_stages(detector, size, repeats, seed)


def _time_stages(detector: Detector, sizes: list[int] | None, repeats: int, seed: int) -> None:
    from sgraph_core.evaluation.benchmark import SIZES, growth, time_stages

    sizes = sizes or list(SIZES)
    times = []
    with progress() as report:
        for done, stage_times in enumerate(time_stages(detector, sizes, repeats, seed), start=1):
            times.append(stage_times)
            report("timing", done, len(sizes))
    table = _table(
        "surfaces", "preprocessing [ms]", "features [ms]", "forward pass [ms]",
        "features / forward pass", "whole inference [ms]",
    )  # fmt: skip
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


def _time_updates(detector: Detector, rooms: list[int] | None, seed: int) -> None:
    from sgraph_core.evaluation.incremental import ROOMS, time_updates

    rooms = rooms or list(ROOMS)
    times = []
    with progress() as report:
        for done, update_times in enumerate(time_updates(detector, rooms, seed), start=1):
            times.append(update_times)
            report("timing", done, len(rooms))
    table = _table(
        "rooms", "update [ms]", "ISAM2 [ms]", "whole inference instead [ms]",
        "surfaces preprocessed", "pairs looked at", "rows of the network", "rows clustered",
    )  # fmt: skip
    for t in times:
        table.add_row(
            str(t.rooms),
            *(f"{1e3 * seconds:.1f}" for seconds in (t.inference, t.optimisation, t.whole)),
            *(str(round(count)) for count in astuple(t.work)),
        )
    print_table(table)
    first, last = times[0], times[-1]
    if last.rooms != first.rooms:
        ratio = (last.inference + last.optimisation) / (first.inference + first.optimisation)
        typer.echo(
            f"update and ISAM2 in {last.rooms} rooms take {ratio:.2f} times as long "
            f"as in {first.rooms}"
        )


def _table(*columns: str) -> Table:
    from rich import box
    from rich.table import Table

    table = Table(box=box.MARKDOWN)
    for column in columns:
        table.add_column(column, justify="right")
    return table
