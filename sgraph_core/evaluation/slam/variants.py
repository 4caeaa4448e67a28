"""The methods that are compared: each makes a solved S-Graph of the same drive."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np

from sgraph_concepts.types import FloatArray, SurfaceArrays
from sgraph_core.api import infer_and_optimize
from sgraph_core.backend import optimize
from sgraph_core.detector import Detector
from sgraph_core.evaluation.slam.free_space import free_space_rooms
from sgraph_core.evaluation.slam.merging import merged
from sgraph_core.evaluation.slam.nodes import corrupted, described
from sgraph_core.graph import SGraph

__all__ = ["BASELINE", "VARIANTS", "Detectors", "Trial", "Variant"]

PUBLISHED = {"room": "published", "wall": "published"}
BOTH = ("room", "wall")


@dataclass(frozen=True, eq=False)
class Trial:
    """One drive, as every method gets it.

    Attributes:
        seed: of the drive.
        graph: the map along dead-reckoned keyframes; its truth, if any, is only for scores.
        scans: of each keyframe, as :func:`free_space_rooms` takes them.
        reference: true poses of the keyframes, [K, 7].
        true_surfaces: what the map should be.
        same: ids of the wall surfaces that are one surface in truth, group by group; None where
            nobody knows.
    """

    seed: int
    graph: SGraph
    scans: Sequence[FloatArray]
    reference: FloatArray
    true_surfaces: SurfaceArrays
    same: Sequence[Sequence[int]] | None = None

    @cached_property
    def straightened(self) -> SGraph:
        """The map after its own odometry and planes were solved for."""
        return optimize(self.graph).graph


@dataclass(frozen=True, eq=False)
class Detectors:
    """Who finds rooms and walls.

    Attributes:
        ours: the shipped one.
        paper: the paper's, if weights of it are at hand, else ours.
    """

    ours: Detector = field(default_factory=Detector)
    paper: Detector = field(default_factory=Detector)

    @classmethod
    def load(cls, paper_weights: Path | None = None) -> Detectors:
        """Return the shipped detector and, if given, one with the paper's network and clusterer."""
        ours = Detector()
        if paper_weights is None:
            return cls(ours, ours)
        return cls(ours, Detector(weights=paper_weights, clusterers={"room": "cycles"}))


Solve = Callable[[Trial, Detectors], SGraph]
Detect = Callable[[SGraph, Sequence[FloatArray], Detectors], SGraph]


@dataclass(frozen=True)
class Variant:
    """One method.

    Attributes:
        name: in tables.
        solve: returns a drive's solved S-Graph, with the concepts that describe it in the end.
        detect: returns a map with its concepts, as the method finds them while the map grows.
        concepts: that are scored.
        needs_truth: whether it only runs where the truth of surfaces, rooms and walls is known.
    """

    name: str
    solve: Solve
    detect: Detect | None = None
    concepts: tuple[str, ...] = ()
    needs_truth: bool = False


def _odometry(trial: Trial, _detectors: Detectors) -> SGraph:
    return trial.graph


def _planes_only(trial: Trial, _detectors: Detectors) -> SGraph:
    return trial.straightened


def _free_space(trial: Trial, detectors: Detectors) -> SGraph:
    found = _detect_free_space(trial.straightened, trial.scans, detectors)
    solved = optimize(found, {"room": "published"}).graph
    return _detect_free_space(solved, trial.scans, detectors)


def _detect_free_space(
    graph: SGraph, scans: Sequence[FloatArray], _detectors: Detectors
) -> SGraph:
    found = graph.copy()
    found.concepts = {"room": free_space_rooms(graph, scans)}
    return found


def _paper(concepts: tuple[str, ...]) -> tuple[Solve, Detect]:
    published = {name: "published" for name in concepts}

    def solve(trial: Trial, detectors: Detectors) -> SGraph:
        return infer_and_optimize(trial.graph, detectors.paper, concepts, published)[0]

    def detect(graph: SGraph, _scans: Sequence[FloatArray], detectors: Detectors) -> SGraph:
        return detectors.paper.infer(graph, concepts)

    return solve, detect


def _ours(concepts: tuple[str, ...]) -> tuple[Solve, Detect]:
    def solve(trial: Trial, detectors: Detectors) -> SGraph:
        return infer_and_optimize(trial.graph, detectors.ours, concepts)[0]

    def detect(graph: SGraph, _scans: Sequence[FloatArray], detectors: Detectors) -> SGraph:
        return detectors.ours.infer(graph, concepts)

    return solve, detect


def _true_association(trial: Trial, detectors: Detectors) -> SGraph:
    """Merge the surfaces that are one in truth, and tie the true walls."""
    assert trial.same is not None
    graph = optimize(merged(trial.straightened, trial.same)).graph
    assert graph.truth is not None
    graph.concepts = {
        "wall": described(graph, "wall", graph.truth.walls, detectors.ours.registry)
    }
    return optimize(graph).graph


def _corrupted(trial: Trial, detectors: Detectors) -> SGraph:
    registry = detectors.ours.registry
    found = detectors.ours.infer(trial.straightened, BOTH)
    return optimize(corrupted(found, registry, np.random.default_rng(trial.seed))).graph


BASELINE = "planes only"
"""What the others are compared with."""

VARIANTS: Mapping[str, Variant] = {
    variant.name: variant
    for variant in (
        Variant("odometry", _odometry),
        Variant(BASELINE, _planes_only),
        Variant("free space", _free_space, _detect_free_space, ("room",)),
        Variant("paper, rooms", *_paper(("room",)), ("room",)),
        Variant("paper, rooms + walls", *_paper(BOTH), BOTH),
        Variant("ours, rooms", *_ours(("room",)), ("room",)),
        Variant("ours, rooms + walls", *_ours(BOTH), BOTH),
        Variant("ours, corrupted", _corrupted, needs_truth=True),
        Variant("true association", _true_association, needs_truth=True),
    )
}
