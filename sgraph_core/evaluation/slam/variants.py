"""The methods that are compared: each makes a solved S-Graph of the same drive."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sgraph_concepts.errors import WeightsError
from sgraph_core.api import infer_and_optimize
from sgraph_core.backend import optimize
from sgraph_core.detector import Detector
from sgraph_core.evaluation.slam.free_space import free_space_rooms
from sgraph_core.evaluation.slam.nodes import corrupted, described
from sgraph_core.evaluation.slam.trial import Trial
from sgraph_core.graph import SGraph

__all__ = ["BASELINE", "VARIANTS", "Detectors", "Variant"]

BOTH = ("room", "wall")


@dataclass(frozen=True, eq=False)
class Detectors:
    """Who finds rooms and walls.

    Attributes:
        ours: the shipped one.
        paper: the paper's, if weights of it are at hand, else ours.
    """

    ours: Detector
    paper: Detector

    @classmethod
    def load(cls, paper_weights: Path | None = None) -> Detectors:
        """Return the shipped detector and, if given, one with the paper's network and clusterer."""
        ours = Detector()
        if paper_weights is None:
            return cls(ours, ours)
        return cls(ours, Detector(weights=paper_weights, clusterers={"room": "cycles"}))

    def require_papers(self, folder: Path) -> None:
        """Raise a WeightsError if the weights of a folder are not of the paper's network."""
        network = self.paper.network
        if (network.features, network.neighbours) != ("paper", "nearest"):
            raise WeightsError(
                f"{folder}: is no training of the paper's network, which "
                "'sgraph train --config paper' trains"
            )


Solve = Callable[[Trial, Detectors], SGraph]
Detect = Callable[[SGraph, Trial, Detectors], SGraph]


@dataclass(frozen=True)
class Variant:
    """One method.

    Attributes:
        name: in tables.
        solve: returns a drive's solved S-Graph, with the concepts that describe it in the end.
        detect: returns a map with its concepts, as the method finds them while the map grows.
        concepts: that are scored.
        papers: whether the paper's detector is the one that it uses.
        needs_truth: whether it only runs where true rooms and walls are known.
    """

    name: str
    solve: Solve
    detect: Detect | None = None
    concepts: tuple[str, ...] = ()
    papers: bool = False
    needs_truth: bool = False


def _odometry(trial: Trial, _detectors: Detectors) -> SGraph:
    return trial.dead_reckoned


def _planes_only(trial: Trial, _detectors: Detectors) -> SGraph:
    return trial.straightened


def _free_space(trial: Trial, detectors: Detectors) -> SGraph:
    found = _detect_free_space(trial.straightened, trial, detectors)
    solved = optimize(found, {"room": "published"}).graph
    return _detect_free_space(solved, trial, detectors)


def _detect_free_space(graph: SGraph, trial: Trial, _detectors: Detectors) -> SGraph:
    found = graph.copy()
    found.concepts = {"room": free_space_rooms(graph, trial.free_outlines)}
    return found


def _paper(concepts: tuple[str, ...]) -> tuple[Solve, Detect]:
    published = dict.fromkeys(concepts, "published")

    def solve(trial: Trial, detectors: Detectors) -> SGraph:
        return infer_and_optimize(trial.mapped.graph, detectors.paper, concepts, published)[0]

    def detect(graph: SGraph, _trial: Trial, detectors: Detectors) -> SGraph:
        return detectors.paper.infer(graph, concepts)

    return solve, detect


def _ours(concepts: tuple[str, ...]) -> tuple[Solve, Detect]:
    def solve(trial: Trial, detectors: Detectors) -> SGraph:
        return infer_and_optimize(trial.mapped.graph, detectors.ours, concepts)[0]

    def detect(graph: SGraph, _trial: Trial, detectors: Detectors) -> SGraph:
        return detectors.ours.infer(graph, concepts)

    return solve, detect


def _true_association(trial: Trial, detectors: Detectors) -> SGraph:
    """Solve the oracle's map with the true walls; of a log, with those found in that map."""
    graph = optimize(trial.oracle).graph
    if graph.truth is None:
        graph = detectors.ours.infer(graph, ["wall"])
    else:
        walls = described(graph, "wall", graph.truth.walls, detectors.ours.registry)
        graph.concepts = {"wall": walls}
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
        Variant("paper, rooms", *_paper(("room",)), ("room",), papers=True),
        Variant("paper, rooms + walls", *_paper(BOTH), BOTH, papers=True),
        Variant("ours, rooms", *_ours(("room",)), ("room",)),
        Variant("ours, rooms + walls", *_ours(BOTH), BOTH),
        Variant("ours, corrupted", _corrupted, needs_truth=True),
        Variant("true association", _true_association),
    )
}
