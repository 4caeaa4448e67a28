"""How long the stages of an inference take, and how they grow with the map."""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from sgraph_concepts.registry import RegisteredConcept
from sgraph_concepts.types import Scene, SurfaceArrays
from sgraph_core.detector import Detector
from sgraph_core.graph import SGraph
from sgraph_core.network.runtime import Inputs, Network
from sgraph_core.preprocess import preprocess
from sgraph_core.synth.building import draw_building
from sgraph_core.synth.config import BuildingConfig

__all__ = ["SIZES", "StageTimes", "growth", "time_stages"]

SIZES = (240, 1000, 4000, 20_000)
BETWEEN_FLOORS_M = 5.0


@dataclass(frozen=True)
class StageTimes:
    """Median seconds of processor time of the stages of one inference.

    Attributes:
        surfaces: wall surfaces of the map.
        preprocessing: duplicates and crossings.
        features: neighbours, visibility and features of the network.
        forward: encoder and all heads.
        total: the whole inference, with clustering and shapes.
    """

    surfaces: int
    preprocessing: float
    features: float
    forward: float
    total: float


def time_stages(
    detector: Detector, sizes: Sequence[int], repeats: int, seed: int
) -> Iterator[StageTimes]:
    """Time inference on synthetic maps of the given sizes, one after the other.

    Args:
        detector: infers the maps; ONNX Runtime has one thread unless its network says otherwise.
        sizes: numbers of wall surfaces.
        repeats: how often each stage is run; the median counts.
        seed: of the maps.
    """
    network = detector.network
    concepts = [concept for concept in detector.registry if concept.spec.head is not None]
    for size in sizes:
        graph = _map_of(size, np.random.default_rng(seed))
        surfaces = graph.wall_surfaces.ordered()
        fragments = preprocess(surfaces).surfaces
        scene = detector.scene(fragments)
        inputs = network.inputs(scene)
        stages: tuple[Callable[[], object], ...] = (
            partial(preprocess, surfaces),
            partial(_features, detector, fragments),
            partial(_forward, network, concepts, scene, inputs),
            partial(detector.infer, graph),
        )
        yield StageTimes(size, *(_median_seconds(stage, repeats) for stage in stages))


def growth(times: Sequence[StageTimes]) -> float:
    """Return the exponent k with which total time grows as surfaces^k, by least squares.

    Args:
        times: of maps of two sizes or more.
    """
    surfaces, totals = zip(*((t.surfaces, t.total) for t in times), strict=True)
    return float(np.polyfit(np.log(surfaces), np.log(totals), 1)[0])


def _features(detector: Detector, fragments: SurfaceArrays) -> None:
    detector.network.inputs(detector.scene(fragments))


def _forward(
    network: Network, concepts: Sequence[RegisteredConcept], scene: Scene, inputs: Inputs
) -> None:
    embeddings = network.encode(inputs)
    for concept in concepts:
        network.score(concept, scene, embeddings)


def _median_seconds(call: Callable[[], object], repeats: int) -> float:
    call()  # the first time also loads weights and warms caches
    seconds = []
    for _ in range(repeats):
        # processor time: on a busy machine a long stage is interrupted and a short one is not,
        # which would falsify their ratio
        start = time.process_time()
        call()
        seconds.append(time.process_time() - start)
    return statistics.median(seconds)


def _map_of(size: int, rng: np.random.Generator) -> SGraph:
    """Return a map of synthetic floors in a square grid, cut off at ``size`` surfaces."""
    segments, normals = [], []
    count, spacing = 0, 0.0
    while count < size:
        building = draw_building(rng, BuildingConfig())
        ends = building.segments
        centred = ends - (ends.min(axis=(0, 1)) + ends.max(axis=(0, 1))) / 2
        spacing = max(spacing, 2 * float(np.abs(centred).max()) + BETWEEN_FLOORS_M)
        segments.append(centred)
        normals.append(building.normals)
        count += len(centred)
    side = math.ceil(math.sqrt(len(segments)))
    places = (spacing * np.array(divmod(number, side)) for number in range(len(segments)))
    moved = [floor + place for floor, place in zip(segments, places, strict=True)]
    graph = SGraph(f"{size} surfaces")
    graph.extend_wall_surfaces(
        np.arange(size),
        np.concatenate(moved)[:size],
        np.concatenate(normals)[:size],
        np.full((size, 2), np.nan),
    )
    return graph
