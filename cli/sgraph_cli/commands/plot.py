"""`sgraph plot`: a picture of a map as it is stored."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from sgraph_cli.arguments import MapFile, load_map

__all__ = ["plot"]


def plot(
    map_file: MapFile,
    output: Annotated[
        Path, typer.Option("-o", "--output", help="The picture (.png, .svg or .pdf).")
    ],
) -> None:
    """Draw a map with the concepts that it holds."""
    from sgraph_core.formats import check_outputs
    from sgraph_core.plotting import plot as draw

    check_outputs(map_file, [output])
    draw(load_map(map_file), output)
