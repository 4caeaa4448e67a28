"""`sgraph plot`: a picture of a map as it is stored."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from sgraph_cli.arguments import load_map

__all__ = ["plot"]


def plot(
    map_file: Annotated[Path, typer.Argument(metavar="MAP", help="A sgraph-map JSON file.")],
    output: Annotated[
        Path, typer.Option("-o", "--output", help="The picture (.png, .svg or .pdf).")
    ],
) -> None:
    """Draw a map with the concepts that it holds."""
    from sgraph_core.plotting import plot as draw

    draw(load_map(map_file), output)
