"""`sgraph bench`: what rooms and walls do for trajectory and map, and how long inference takes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sgraph_cli.console import note, print_markdown, progress, warn_about_plugins

if TYPE_CHECKING:
    from sgraph_core.evaluation.slam.drives import Conditions, Drive

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
    """Time the stages of inference on synthetic maps, on one thread, in processor time."""
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
    columns = (
        "surfaces", "preprocessing [ms]", "features [ms]", "forward pass [ms]",
        "features / forward pass", "whole inference [ms]",
    )  # fmt: skip
    rows = [
        (
            str(t.surfaces),
            *(f"{1e3 * seconds:.1f}" for seconds in (t.preprocessing, t.features, t.forward)),
            f"{t.features / t.forward:.1f}",
            f"{1e3 * t.total:.1f}",
        )
        for t in times
    ]
    print_markdown(columns, rows)
    if len(set(sizes)) > 1:
        typer.echo(f"whole inference grows with surfaces to the power of {growth(times):.2f}")


@app.command("updates")
def updates(
    rooms: Annotated[
        list[int] | None,
        typer.Option(min=2, help="Rooms of a map; 20, 100 and 1000 if not given."),
    ] = None,
    repeats: Annotated[int, typer.Option(min=1, help="Drives through each; medians count.")] = 3,
    seed: Annotated[int, typer.Option(min=0, help="Of the first drives' maps.")] = 0,
) -> None:
    """Time updates keyframe by keyframe at the end of drives through grids of rooms."""
    from dataclasses import astuple

    from sgraph_core.detector import Detector
    from sgraph_core.evaluation.incremental import ROOMS, time_updates

    detector = Detector()
    warn_about_plugins(list(detector.registry.problems))
    sizes = rooms or list(ROOMS)
    with progress() as report:
        for done, so_far in enumerate(time_updates(detector, sizes, seed, repeats), start=1):
            times = so_far
            report("timing", done, repeats)
    columns = (
        "rooms", "update [ms]", "ISAM2 [ms]", "whole inference instead [ms]",
        "surfaces preprocessed", "pairs looked at", "rows of the network", "rows clustered",
    )  # fmt: skip
    rows = [
        (
            str(t.rooms),
            *(f"{1e3 * seconds:.1f}" for seconds in (t.inference, t.optimisation, t.whole)),
            *map(str, astuple(t.work)),
        )
        for t in times
    ]
    print_markdown(columns, rows)
    first, last = times[0], times[-1]
    if last.rooms != first.rooms:
        ratio = (last.inference + last.optimisation) / (first.inference + first.optimisation)
        typer.echo(
            f"update and ISAM2 in {last.rooms} rooms take {ratio:.2f} times as long "
            f"as in {first.rooms}"
        )


@app.command("solve")
def solve(
    rooms: Annotated[
        list[int] | None, typer.Option(min=1, help="Rooms of a block; 20, 300, 1000 if not given.")
    ] = None,
    repeats: Annotated[int, typer.Option(min=1, help="Runs of each; the fastest counts.")] = 3,
    seed: Annotated[int, typer.Option(min=0, help="Of the blocks.")] = 0,
) -> None:
    """Time batch optimisation of blocks of rooms, with the concepts' factors and without."""
    from sgraph_core.evaluation.block import time_optimization

    sizes = rooms or [20, 300, 1000]
    columns = (
        "rooms", "planes only [s]", "iterations", "with rooms and walls [s]", "iterations", "ratio",
    )  # fmt: skip
    rows = []
    with progress() as report:
        for done, t in enumerate(time_optimization(sizes, repeats, seed), start=1):
            report("optimising", done, len(sizes))
            rows.append(
                (
                    str(t.rooms),
                    f"{t.planes:.2f}",
                    str(t.plane_iterations),
                    f"{t.concepts:.2f}",
                    str(t.concept_iterations),
                    f"{t.concepts / t.planes:.2f}",
                )
            )
    print_markdown(columns, rows)


Seeds = Annotated[int, typer.Option(min=1, help="Drives per scene or log, with seeds from 0.")]
Json = Annotated[
    Path | None, typer.Option("--json", metavar="OUT", help="Also write all results as JSON.")
]
Output = Annotated[
    Path,
    typer.Option("-o", "--output", help="Folder for single results; it may hold some already."),
]
PaperWeights = Annotated[
    Path | None,
    typer.Option(
        help="Folder of `sgraph train --config paper`; without it the paper's variants take the "
        "shipped detector's rooms and walls."
    ),
]
Drift = Annotated[
    float, typer.Option(help="Of odometry's heading, in degrees per square root of a metre.")
]
OUTPUT = Path("sgraph-bench")


@app.command("paper")
def paper(
    seeds: Seeds = 20,
    scene: Annotated[
        list[str] | None, typer.Option(help="Only this scene; may be repeated.")
    ] = None,
    drift: Drift = 1.0,
    range_: Annotated[
        float, typer.Option("--range", metavar="M", help="Of the lidar, in metres.")
    ] = 100.0,
    keyframe: Annotated[float, typer.Option(help="Metres from one keyframe to the next.")] = 1.0,
    json_: Json = None,
    output: Output = OUTPUT,
    paper_weights: PaperWeights = None,
) -> None:
    """Compare methods on drives through the paper's scenes, and print its tables.

    The same command goes on with an interrupted run.
    """
    from sgraph_core.evaluation.slam.drives import Conditions, scene_drives

    conditions = Conditions(drift, range_, keyframe)
    drives = scene_drives(scene or (), conditions)
    _compare(drives, conditions, seeds, json_, output, paper_weights, paper=True)


@app.command("lidar")
def lidar(
    logs: Annotated[
        list[Path], typer.Argument(metavar="LOG...", help="Carmen logs, also compressed (.gz).")
    ],
    seeds: Seeds = 20,
    drift: Drift = 1.0,
    json_: Json = None,
    output: Output = OUTPUT,
    paper_weights: PaperWeights = None,
) -> None:
    """Compare methods on logs of real robots, with drifting odometry drawn from each seed.

    The same command goes on with an interrupted run.
    """
    from sgraph_concepts.errors import InputError
    from sgraph_core.evaluation.slam.drives import Conditions, log_drives

    if json_ is not None and json_.resolve() in [log.resolve() for log in logs]:
        raise InputError(f"{json_}: is a log that is read, and is not replaced")
    conditions = Conditions(drift)
    drives = log_drives(logs, conditions)
    _compare(drives, conditions, seeds, json_, output, paper_weights, paper=False)


def _compare(
    drives: Sequence[Drive],
    conditions: Conditions,
    seeds: int,
    json_: Path | None,
    output: Path,
    paper_weights: Path | None,
    *,
    paper: bool,
) -> None:
    from sgraph_concepts.errors import InputError
    from sgraph_core.concepts import installed
    from sgraph_core.evaluation.slam.results import Store
    from sgraph_core.evaluation.slam.study import run_study, settings
    from sgraph_core.evaluation.slam.tables import tables, write_json

    warn_about_plugins(list(installed().problems))
    if json_ is not None and (json_.is_dir() or not json_.absolute().parent.is_dir()):
        raise InputError(f"{json_}: must be a file in a folder that exists")
    store = Store(output, settings(conditions, paper_weights))
    with progress() as report:
        results = run_study(drives, seeds, store, report, paper_weights)
    if json_ is not None:
        write_json(results, store.settings, json_)
        note(f"wrote {len(results)} results to {json_}")
    for content in tables(results, paper):
        typer.echo(f"\n{content.title}\n")
        print_markdown(content.columns, content.rows, named=True)
