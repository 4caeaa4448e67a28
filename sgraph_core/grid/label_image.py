"""The rooms of a map as an image on its grid's pixels, with a YAML file beside it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from sgraph_concepts.errors import InputError
from sgraph_concepts.types import ConceptNode, OccupancyGrid
from sgraph_core.files import write_whole
from sgraph_core.graph import SGraph
from sgraph_core.grid.painting import paint

__all__ = ["SUFFIX", "check_label_image", "description_of", "save_label_image"]

SUFFIX = ".png"
LARGEST_LABEL = 2**16 - 1


def description_of(path: str | Path) -> Path:
    """Return the YAML file that is written beside an image."""
    return Path(path).with_suffix(".yaml")


def check_label_image(graph: SGraph, path: str | Path) -> OccupancyGrid:
    """Return the grid to paint on; to be called before the work that the image shows.

    Raises:
        InputError: the map has no grid.
    """
    if graph.grid is None:
        raise InputError(
            f"{path}: a labelled room image is painted on an occupancy grid, and this map has none"
        )
    return graph.grid


def save_label_image(graph: SGraph, path: str | Path) -> None:
    """Write the rooms as a 16-bit PNG on the grid's pixels, and what its labels mean as YAML.

    A pixel holds the id of its room plus 1, and 0 outside all rooms. The YAML file has the keys of
    ROS's map_server, so that whatever places a map can place the image, and under ``rooms`` the
    label, id, name (null if it has none) and area of each room.

    Args:
        graph: an S-Graph with a grid and rooms.
        path: the image; the YAML file is named alike.

    Raises:
        InputError: there is no grid, no rooms were inferred, or an id is too large for 16 bits.
        OSError: a file cannot be written; neither is then left behind half-written.
    """
    from PIL import Image

    grid = check_label_image(graph, path)
    if "room" not in graph.concepts:
        raise InputError(f"{path}: there are no rooms to paint: they were not inferred")
    rooms = graph.concepts["room"]
    highest = max((room.id for room in rooms), default=0)
    if highest + 1 > LARGEST_LABEL:
        raise InputError(
            f"{path}: room {highest} does not fit into 16 bits, which hold ids up to "
            f"{LARGEST_LABEL - 1}"
        )
    labels = np.zeros(grid.cells.shape, np.uint16)
    paint(rooms, grid, [room.id + 1 for room in rooms], labels)
    text = _describe(Path(path).name, grid, rooms)

    def write(image: Path) -> None:
        Image.fromarray(labels[::-1]).save(image)
        write_whole(description_of(path), lambda file: file.write_text(text, encoding="utf-8"))

    write_whole(path, write)


def _describe(image: str, grid: OccupancyGrid, rooms: Sequence[ConceptNode]) -> str:
    import yaml

    placed = {
        "image": image,
        "mode": "raw",
        "resolution": grid.resolution,
        "origin": grid.origin.tolist(),
        "negate": 0,
        "occupied_thresh": 0.65,
        "free_thresh": 0.196,
    }
    known = [
        {
            "label": room.id + 1,
            "id": room.id,
            "name": room.name,
            "area_m2": room.shape.attributes.get("area_m2"),
        }
        for room in rooms
    ]
    text = yaml.safe_dump(placed, sort_keys=False, default_flow_style=None)
    lines = [
        f"- {yaml.safe_dump(r, sort_keys=False, default_flow_style=True, width=10**6)}"
        for r in known
    ]
    return text + ("rooms:\n" + "".join(lines) if lines else "rooms: []\n")
