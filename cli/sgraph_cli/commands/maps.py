"""`sgraph schema` and `sgraph synth`: the map format, and maps to try things on."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from sgraph_cli.console import note, progress

__all__ = ["schema", "synth"]


def schema() -> None:
    """Print the JSON Schema of the map file."""
    import json

    from sgraph_core.map_file import schema as map_schema

    typer.echo(json.dumps(map_schema(), indent=1))


def synth(
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder to write the maps to.")],
    count: Annotated[int, typer.Option(min=1, help="How many maps.")] = 1,
    seed: Annotated[int, typer.Option(min=0, help="Equal seeds give equal maps.")] = 0,
    config: Annotated[
        str | None,
        typer.Option(
            metavar="FILE|paper",
            help="JSON file with the ingredients (docs/synthetic-buildings.md), or the paper's "
            "kind of layouts.",
        ),
    ] = None,
    grid: Annotated[
        bool,
        typer.Option("--grid", help="Occupancy grids with labelled rooms: a folder per map."),
    ] = False,
) -> None:
    """Write synthetic buildings with their truth as map files, or as occupancy grids."""
    import numpy as np

    from sgraph_core.map_file import save
    from sgraph_core.settings import read_settings
    from sgraph_core.synth.building import draw_building
    from sgraph_core.synth.config import BuildingConfig
    from sgraph_core.synth.grid_files import write_grid
    from sgraph_core.synth.robot_grid import draw_grid_building
    from sgraph_core.training.config import PAPER, TrainingConfig, config_file

    if config == PAPER:
        building_config = read_settings(config_file(PAPER), TrainingConfig).building
    else:
        building_config = read_settings(config_file(config), BuildingConfig)
    output.mkdir(parents=True, exist_ok=True)
    with progress() as report:
        for number in range(count):
            rng, name = np.random.default_rng([seed, number]), f"synthetic-{seed}-{number:05d}"
            if grid:
                write_grid(draw_grid_building(rng, building_config), output / name)
            else:
                save(draw_building(rng, building_config).graph(name), output / f"{name}.json")
            report("drawing buildings", number + 1, count)
    note(f"wrote {count} maps to {output}")
