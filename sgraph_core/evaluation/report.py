"""Scores of many maps, per source."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sgraph_concepts.types import FloatArray
from sgraph_core.detector import Detector
from sgraph_core.evaluation.calibration import (
    Calibration,
    Reliability,
    edges_calibration,
    nodes_calibration,
)
from sgraph_core.evaluation.scores import Counts, FloorScore, score_floor
from sgraph_core.evaluation.sources import find_sources, load_with_truth
from sgraph_core.evaluation.trajectory import trajectory_error

__all__ = ["FloorReport", "SourceReport", "as_rows", "evaluate"]


@dataclass(frozen=True)
class FloorReport:
    """One map.

    Attributes:
        name: the file's, without suffix.
        score: its rooms and walls.
        calibration: whether confidences and probabilities mean what they say; of what a file
            holds, those of nodes only.
        seconds: that inferring it took, NaN if what it holds was scored.
        ate_m: absolute trajectory error of its keyframes, NaN without a reference.
    """

    name: str
    score: FloorScore
    calibration: Calibration
    seconds: float
    ate_m: float


@dataclass(frozen=True)
class SourceReport:
    """Maps that are scored together.

    Attributes:
        source: what they are called.
        floors: the maps.
    """

    source: str
    floors: tuple[FloorReport, ...]

    @property
    def rooms(self) -> Counts:
        """Pooled counts of rooms at Jaccard index 0.5."""
        return sum((floor.score.rooms for floor in self.floors), Counts())

    @property
    def exact_rooms(self) -> Counts:
        """Pooled counts of rooms with exactly the true members."""
        return sum((floor.score.exact_rooms for floor in self.floors), Counts())

    @property
    def walls(self) -> Counts:
        """Pooled counts of walls."""
        return sum((floor.score.walls for floor in self.floors), Counts())

    @property
    def calibration(self) -> Calibration:
        """Pooled confidences and probabilities."""
        return sum((floor.calibration for floor in self.floors), Calibration())

    @property
    def mean_room_f1(self) -> float:
        """Mean over the floors of the rooms' F1."""
        return float(np.mean([floor.score.rooms.f1 for floor in self.floors]))

    @property
    def mean_wall_f1(self) -> float:
        """Mean over the floors of the walls' F1."""
        return float(np.mean([floor.score.walls.f1 for floor in self.floors]))

    @property
    def mean_ate_m(self) -> float:
        """Mean over the floors of the absolute trajectory error."""
        return float(np.mean([floor.ate_m for floor in self.floors]))

    @property
    def median_seconds(self) -> float:
        """Median over the floors of the seconds to infer one."""
        return float(np.median([floor.seconds for floor in self.floors]))


Trajectory = tuple[FloatArray, FloatArray]
"""Stamps [K] and positions [K, 3]."""


def evaluate(
    paths: Sequence[Path],
    detector: Detector | None,
    reference: Trajectory | None = None,
    progress: Callable[[str, int, int], object] = lambda _what, _done, _total: None,
    only: Sequence[Path] = (),
) -> list[SourceReport]:
    """Score maps against their truth.

    Args:
        paths: map files, or folders of them; each becomes one report.
        detector: infers each map anew; None scores the concepts that the files hold.
        reference: the true trajectory of the maps' keyframes, if their error is wanted.
        progress: told after every map.
        only: lists of maps (see :func:`find_sources`); each gives a report of its own per path.

    Raises:
        InputError: a map has no truth, a folder no map, or a list names none of them.
        MapFileError: a map cannot be read.
    """
    sources = find_sources(paths, only)
    total = sum(len(source.files) for source in sources)
    reports, done = [], 0
    for source in sources:
        floors = []
        for file in source.files:
            floors.append(_evaluate_floor(file, detector, reference))
            done += 1
            progress("evaluating", done, total)
        reports.append(SourceReport(source.name, tuple(floors)))
    return reports


def _evaluate_floor(
    file: Path, detector: Detector | None, reference: Trajectory | None
) -> FloorReport:
    graph, truth = load_with_truth(file)
    seconds, edges = float("nan"), Calibration()
    if detector is not None:
        start = time.perf_counter()
        found = detector.trace(graph)
        seconds = time.perf_counter() - start
        graph = found.graph
        edges = edges_calibration(found.relations, found.scene.surfaces.ids, truth)
    score = score_floor(graph, truth)
    ate = float("nan") if reference is None else trajectory_error(graph, *reference)
    return FloorReport(file.stem, score, nodes_calibration(score.judged) + edges, seconds, ate)


def as_rows(reports: Iterable[SourceReport]) -> list[dict[str, float | int | str]]:
    """Return reports as flat records, for tables and JSON."""
    return [
        {
            "source": report.source,
            "floors": len(report.floors),
            "room_precision": report.rooms.precision,
            "room_recall": report.rooms.recall,
            "room_f1": report.rooms.f1,
            "room_f1_mean": report.mean_room_f1,
            "room_exact_f1": report.exact_rooms.f1,
            "rooms_left_out": report.rooms.left_out,
            "room_ece": _error(report.calibration.nodes, "room"),
            "wall_precision": report.walls.precision,
            "wall_recall": report.walls.recall,
            "wall_f1": report.walls.f1,
            "wall_f1_mean": report.mean_wall_f1,
            "walls_left_out": report.walls.left_out,
            "wall_ece": _error(report.calibration.nodes, "wall"),
            "room_edge_ece": _error(report.calibration.undecided, "room"),
            "wall_edge_ece": _error(report.calibration.undecided, "wall"),
            "room_edge_ece_all": _error(report.calibration.edges, "room"),
            "wall_edge_ece_all": _error(report.calibration.edges, "wall"),
            "seconds_per_floor": report.median_seconds,
            "ate_m": report.mean_ate_m,
        }
        for report in reports
    ]


def _error(reliabilities: Mapping[str, Reliability], concept: str) -> float:
    return reliabilities.get(concept, Reliability()).error
