"""Pictures: of an S-Graph seen from above, and how any figure becomes a file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from sgraph_concepts.errors import InputError
from sgraph_concepts.types import ConceptNode, FloatArray, OccupancyGrid
from sgraph_core.files import write_whole
from sgraph_core.graph import SGraph

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["FORMATS", "check_name", "draw", "new_figure", "plot", "write_figure"]

FORMATS = (".png", ".svg", ".pdf")
LARGEST_SIDE_INCH = 14.0
SMALLEST_SIDE_INCH = 5.0
INCHES_PER_METRE = 0.5
MOST_GRID_PIXELS = 2000
"""Longer sides of a grid are thinned out: a picture has hardly more pixels."""
GRID_COLOURS = ("1.0", "0.4", "0.85")
"""Of free, occupied and unknown cells."""


def plot(graph: SGraph, path: str | Path) -> None:
    """Write a picture of an S-Graph, whole or not at all.

    Args:
        graph: what to draw.
        path: the file; its suffix (.png, .svg or .pdf) decides the format.

    Raises:
        InputError: the suffix is another one.
        OSError: the file cannot be written.
    """
    check_name(path)
    figure = new_figure(*_size(graph))
    draw(graph, figure.add_subplot())
    write_figure(figure, path)


def check_name(path: str | Path) -> None:
    """Check the name of a picture before the work that it shows.

    Raises:
        InputError: its suffix is none of ``FORMATS``.
    """
    if Path(path).suffix.lower() not in FORMATS:
        raise InputError(f"{path}: a picture's name must end in {', '.join(FORMATS)}")


def new_figure(width_inch: float, height_inch: float) -> Figure:
    """Return an empty figure that needs no display."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width_inch, height_inch), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def write_figure(figure: Figure, path: str | Path) -> None:
    """Write a figure, whole or not at all; the suffix decides the format.

    Raises:
        OSError: the file cannot be written.
    """
    write_whole(path, lambda temporary: figure.savefig(temporary, dpi=110))


def draw(graph: SGraph, axes: Axes) -> None:
    """Draw rooms as filled polygons, walls as bodies, surfaces as lines and keyframes as a path.

    The grid that the surfaces were extracted from, if any, lies underneath.
    """
    from matplotlib import colormaps

    colours = colormaps["tab20"].colors  # type: ignore[attr-defined]
    rooms = graph.concepts.get("room", [])
    room_colour = {room.id: colours[k % len(colours)] for k, room in enumerate(rooms)}
    _draw_walls(graph, axes)
    for room in rooms:
        _draw_room(room, room_colour[room.id], axes)
    _draw_surfaces(graph, room_colour, axes)
    poses = graph.keyframes.poses
    if len(poses):
        axes.plot(*poses[:, :2].T, ".-", color="0.35", lw=0.6, ms=2, zorder=5, label="keyframes")
        axes.legend(loc="upper right", fontsize="small")
    if graph.grid is not None:
        if not len(graph.wall_surfaces.ids):
            axes.update_datalim(_corners(graph.grid))
            axes.autoscale_view()
        _draw_grid(graph.grid, axes)
    axes.set_aspect("equal")
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    walls = len(graph.concepts.get("wall", []))
    title = f"{graph.name or 'map'}: {len(rooms)} rooms, {walls} walls"
    axes.set_title(title, parse_math=False)


def _size(graph: SGraph) -> tuple[float, float]:
    points = graph.wall_surfaces.segments.reshape(-1, 2)
    if not len(points) and graph.grid is not None:
        points = _corners(graph.grid)
    if not len(points):
        return SMALLEST_SIDE_INCH, SMALLEST_SIDE_INCH
    inches = INCHES_PER_METRE * np.ptp(points, axis=0)
    inches *= min(1.0, LARGEST_SIDE_INCH / max(inches.max(), 1e-9))
    width, height = np.maximum(inches, SMALLEST_SIDE_INCH).tolist()
    return width, height


def _corners(grid: OccupancyGrid) -> FloatArray:
    height, width = grid.cells.shape
    return grid.to_world(np.array([[0, 0], [width, 0], [width, height], [0, height]], float))


def _draw_grid(grid: OccupancyGrid, axes: Axes) -> None:
    from matplotlib.colors import ListedColormap
    from matplotlib.transforms import Affine2D

    axes.autoscale(False)  # the picture shows what was found, not all of the grid
    step = max(1, *(-(-side // MOST_GRID_PIXELS) for side in grid.cells.shape))
    cells = _coarse(grid.cells, step)
    to_world = Affine2D().scale(grid.resolution).rotate(grid.origin[2]).translate(*grid.origin[:2])
    height, width = cells.shape
    axes.imshow(
        cells,
        cmap=ListedColormap(GRID_COLOURS),
        vmin=0,
        vmax=len(GRID_COLOURS) - 1,
        extent=(0, width * step, 0, height * step),
        origin="lower",
        interpolation="nearest",
        transform=to_world + axes.transData,
        zorder=0,
    )


def _coarse(cells: NDArray[np.uint8], step: int) -> NDArray[np.uint8]:
    """Return every step-th cell; occupied cells between them are kept, or thin walls would go."""
    coarse = cells[::step, ::step].copy()
    for row in range(step):
        for column in range(step):
            occupied = cells[row::step, column::step] == OccupancyGrid.OCCUPIED
            height, width = occupied.shape
            coarse[:height, :width][occupied] = OccupancyGrid.OCCUPIED
    return coarse


def _draw_walls(graph: SGraph, axes: Axes) -> None:
    from matplotlib.patches import Polygon

    segments = graph.wall_surfaces.ordered().segments
    for wall in graph.concepts.get("wall", []):
        one, two = (segments[graph.surface_row(member)] for member in wall.members)
        direction = one[1] - one[0]
        low, high = _common(one, two, direction)
        if low < high:
            # opposed surfaces run in opposite directions, so their ends follow around the body
            body = [_at(one, low, direction), _at(one, high, direction)]
            body += [_at(two, high, direction), _at(two, low, direction)]
            axes.add_patch(Polygon(body, closed=True, facecolor="0.75", edgecolor="none", zorder=1))


def _common(one: np.ndarray, two: np.ndarray, direction: np.ndarray) -> tuple[float, float]:
    spans = [sorted((segment @ direction).tolist()) for segment in (one, two)]
    return max(span[0] for span in spans), min(span[1] for span in spans)


def _at(segment: np.ndarray, reach: float, direction: np.ndarray) -> np.ndarray:
    """Return the point of a segment's line at a given reach along a direction."""
    start, end = segment @ direction
    return np.asarray(segment[0] + (reach - start) / (end - start) * (segment[1] - segment[0]))


def _draw_room(room: ConceptNode, colour: tuple[float, ...], axes: Axes) -> None:
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path as Outline

    shape = room.shape
    if shape.polygon is not None:
        # matplotlib fills what rings wind around, so holes run the other way
        ways = (shape.polygon, *(hole[::-1] for hole in shape.holes))
        rings = [Outline([*ring, ring[0]], closed=True) for ring in ways]
        outline = Outline.make_compound_path(*rings)
        axes.add_patch(PathPatch(outline, facecolor=(*colour, 0.3), edgecolor="none", zorder=2))
    if shape.centre is not None:
        label = room.name or f"room {room.id}"
        if room.confidence is not None:
            label += f"\n{room.confidence:.2f}"
        axes.text(
            *shape.centre, label, ha="center", va="center", fontsize=7, zorder=6, parse_math=False
        )


def _draw_surfaces(graph: SGraph, room_colour: dict[int, tuple[float, ...]], axes: Axes) -> None:
    from matplotlib.collections import LineCollection

    colour_of = {
        member: room_colour[room.id]
        for room in graph.concepts.get("room", [])
        for member in room.members
    }
    table = graph.wall_surfaces
    colours = [colour_of.get(int(i), (0.0, 0.0, 0.0)) for i in table.ids]
    axes.add_collection(LineCollection(list(table.segments), colors=colours, lw=1.6, zorder=4))
    middle, tick = table.segments.mean(axis=1), 0.15 * table.normals
    ticks = np.stack([middle, middle + tick], axis=1)
    axes.add_collection(LineCollection(list(ticks), colors=colours, lw=0.8, zorder=4))
    axes.autoscale_view()
