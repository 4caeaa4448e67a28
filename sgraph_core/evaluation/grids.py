"""Scores of rooms found in occupancy grids against labelled images."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sgraph_concepts.errors import InputError, MapFileError
from sgraph_concepts.types import OccupancyGrid
from sgraph_core import formats
from sgraph_core.detector import Detector
from sgraph_core.evaluation.grid_rooms import RoomScore, score_rooms
from sgraph_core.evaluation.grid_surfaces import SurfaceScore, score_surfaces, true_surfaces
from sgraph_core.evaluation.sources import read_list
from sgraph_core.graph import SGraph
from sgraph_core.grid.painting import paint
from sgraph_core.grid.reader import read_grid

__all__ = [
    "Found",
    "GridReport",
    "LabelledGrid",
    "Segmenter",
    "absent_from",
    "as_rows",
    "evaluate",
    "find_grids",
    "only_named",
]

MAP, TRUTH = "map.yaml", "rooms.png"
SUFFIXES = (".yaml", ".yml")

Segmenter = Callable[[OccupancyGrid], NDArray[np.int64]]
"""Returns the number of the room of each cell, -1 for none, [H, W]."""


@dataclass(frozen=True)
class LabelledGrid:
    """A map with its truth.

    Attributes:
        name: of its folder; of the YAML file if that is called otherwise than ``map.yaml``.
        file: the YAML file.
        truth: image with a number per room, 0 for none, on the map's pixels.
    """

    name: str
    file: Path
    truth: Path

    @property
    def kind(self) -> str:
        """``robot``, ``furnished`` or ``plain``, as the name says."""
        if self.name.startswith("robot-"):
            return "robot"
        return "furnished" if self.name.endswith("-furnished") else "plain"


@dataclass(frozen=True, eq=False)
class Found:
    """What was found in a map.

    Attributes:
        grid: the map.
        painted: number of the room of each cell, -1 for none, [H, W].
        true: likewise, by the truth.
        graph: the S-Graph, if rooms were inferred from one.
    """

    grid: OccupancyGrid
    painted: NDArray[np.int64]
    true: NDArray[np.int64]
    graph: SGraph | None


@dataclass(frozen=True)
class GridReport:
    """Scores of one map.

    Attributes:
        labelled: the map.
        rooms: of its rooms.
        surfaces: of its wall surfaces, if rooms were inferred from some.
        seconds: from the file to the rooms.
    """

    labelled: LabelledGrid
    rooms: RoomScore
    surfaces: SurfaceScore | None
    seconds: float


def find_grids(path: Path, truth: Path | None = None) -> list[LabelledGrid]:
    """Return the maps that a path names, none if it names no grids.

    Args:
        path: a YAML file, a folder with ``map.yaml``, or a folder of such folders.
        truth: the labelled image; by default ``rooms.png`` beside the YAML file.
    """
    if path.suffix.lower() in SUFFIXES:
        files = [path]
    elif (path / MAP).is_file():
        files = [path / MAP]
    else:
        files = sorted(path.glob(f"*/{MAP}"))
    return [
        LabelledGrid(
            file.absolute().parent.name if file.name == MAP else file.stem,
            file,
            truth or file.parent / TRUTH,
        )
        for file in files
    ]


def only_named(grids: Sequence[LabelledGrid], lists: Sequence[Path]) -> list[LabelledGrid]:
    """Return the maps that any of the lists names, all if there is no list.

    Raises:
        InputError: a list cannot be read or names none of the maps.
    """
    if not lists:
        return list(grids)
    wanted: set[str] = set()
    for file in lists:
        names = read_list(file)
        if not names & {grid.name for grid in grids}:
            raise InputError(f"{file}: names none of the grids")
        wanted |= names
    return [grid for grid in grids if grid.name in wanted]


def absent_from(grids: Sequence[LabelledGrid], lists: Sequence[Path]) -> dict[Path, list[str]]:
    """Return the names that are of none of the maps, sorted, by the list they stand in.

    Raises:
        InputError: a list cannot be read.
    """
    there = {grid.name for grid in grids}
    absent = {file: sorted(read_list(file) - there) for file in lists}
    return {file: names for file, names in absent.items() if names}


def evaluate(
    grids: Sequence[LabelledGrid],
    how: Detector | Segmenter,
    progress: Callable[[str, int, int], object] = lambda _what, _done, _total: None,
    show: Callable[[LabelledGrid, Found], object] = lambda _labelled, _found: None,
) -> list[GridReport]:
    """Find the rooms of maps and score them.

    Args:
        grids: the maps.
        how: a detector, or another algorithm to compare with.
        progress: told after every map.
        show: handed what was found in each map.

    Raises:
        InputError: a map has no truth, or one on other pixels.
        MapFileError: a map or its truth cannot be read.
        MissingExtraError: what the algorithm needs is not installed.
    """
    reports = []
    for done, labelled in enumerate(grids, 1):
        start = time.perf_counter()
        if isinstance(how, Detector):
            graph = how.infer(formats.load(labelled.file))
            if graph.grid is None:
                raise InputError(f"{labelled.file}: holds no occupancy grid")
            grid, painted = graph.grid, np.full(graph.grid.cells.shape, -1, np.int64)
            rooms = graph.concepts["room"]
            paint(rooms, grid, [room.id for room in rooms], painted)
        else:
            graph, grid = None, read_grid(labelled.file)
            painted = how(grid)
        seconds = time.perf_counter() - start
        found = Found(grid, painted, _read_truth(labelled, grid), graph)
        reports.append(_score(labelled, found, seconds))
        show(labelled, found)
        progress("evaluating", done, len(grids))
    return reports


def _score(labelled: LabelledGrid, found: Found, seconds: float) -> GridReport:
    surfaces = None
    if found.graph is not None:
        true = true_surfaces(found.grid, found.true + 1)
        surfaces = score_surfaces(found.graph.wall_surfaces.ordered(), true)
    rooms = score_rooms(found.painted, found.true, found.grid.resolution**2)
    return GridReport(labelled, rooms, surfaces, seconds)


def _read_truth(labelled: LabelledGrid, grid: OccupancyGrid) -> NDArray[np.int64]:
    from PIL import Image

    if not labelled.truth.exists():
        raise InputError(f"{labelled.file}: has no {labelled.truth.name} to evaluate against")
    try:
        with Image.open(labelled.truth) as image:
            if image.size != grid.cells.shape[::-1]:
                rule = f"must have the map's {grid.cells.shape[1]} x {grid.cells.shape[0]} pixels"
                raise MapFileError(labelled.truth, "size", f"{image.size}", rule)
            labels = np.asarray(image)
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        raise MapFileError(labelled.truth, "", None, f"is no readable image: {error}") from error
    if labels.ndim != 2 or not np.issubdtype(labels.dtype, np.integer):
        raise MapFileError(labelled.truth, "", None, "must have one channel of whole numbers")
    return labels[::-1].astype(np.int64) - 1


Row = dict[str, float | str]
"""``map``, and the scores by name."""


def as_rows(reports: Sequence[GridReport]) -> list[Row]:
    """Return a flat record per map, and one per kind of map with the means over its maps."""
    rows: list[Row] = [{"map": r.labelled.name, **_scores(r)} for r in reports]
    for kind in ("plain", "furnished", "robot"):
        some = [_scores(report) for report in reports if report.labelled.kind == kind]
        if some:
            mean = {key: float(np.mean([scores[key] for scores in some])) for key in some[0]}
            rows.append({"map": f"mean of {len(some)} {kind}", **mean})
    return rows


def _scores(report: GridReport) -> dict[str, float]:
    surfaces, rooms = report.surfaces, report.rooms
    return {
        "surface_recall": surfaces.recall if surfaces else float("nan"),
        "surface_precision": surfaces.precision if surfaces else float("nan"),
        "room_precision_50": rooms.loose.precision,
        "room_recall_50": rooms.loose.recall,
        "room_f1_50": rooms.loose.f1,
        "room_precision_70": rooms.strict.precision,
        "room_recall_70": rooms.strict.recall,
        "room_f1_70": rooms.strict.f1,
        "mean_iou": rooms.mean_iou,
        "seconds": report.seconds,
    }
