"""Synthetic floors as the network sees them, made in parallel and kept on disk."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sgraph_concepts.errors import ConceptError
from sgraph_concepts.registry import Registry
from sgraph_concepts.types import BuildingTruth, IntArray, Scene
from sgraph_core.concepts import installed
from sgraph_core.features import edge_features, edge_index, node_features
from sgraph_core.files import write_whole
from sgraph_core.grid.extraction import extract
from sgraph_core.preprocess import preprocess
from sgraph_core.proximity import build_scene
from sgraph_core.synth.building import draw_building
from sgraph_core.synth.robot_grid import draw_grid_building
from sgraph_core.training.config import TrainingConfig

__all__ = ["Progress", "Sample", "make_samples", "sample_floor"]

CHUNK = 50
"""Floors per file: what an interruption loses at most."""

Progress = Callable[[str, int, int], None]
"""Called with what is being done, how much of it is done, and how much there is."""


@dataclass(frozen=True, eq=False)
class Sample:
    """One floor.

    Attributes:
        x: node features, [N, F_v].
        edge_index: j in row 0, i in row 1, [2, 2E]; edge e + E is edge e reversed.
        edge_attr: edge features, [2E, F_e].
        labels: whether each pair is related, by concept, [E].
    """

    x: NDArray[np.float32]
    edge_index: NDArray[np.int64]
    edge_attr: NDArray[np.float32]
    labels: Mapping[str, NDArray[np.bool_]]


def make_samples(
    config: TrainingConfig,
    numbers: range,
    concepts: Sequence[str],
    folder: Path,
    progress: Progress,
) -> list[Sample]:
    """Return the floors of the given numbers, from the folder where they are already there.

    A floor depends only on configuration, seed and its number.

    Args:
        config: of the run.
        numbers: which floors.
        concepts: whose labels are wanted; installed plugins with a labeller.
        folder: where chunks of floors are kept; another run's must not be in it.
        progress: told after every chunk.
    """
    chunks = [numbers[k : k + CHUNK] for k in range(0, len(numbers), CHUNK)]
    files = [folder / f"floors-{chunk.start:06d}-{chunk.stop:06d}.npz" for chunk in chunks]
    todo = [(chunk, file) for chunk, file in zip(chunks, files, strict=True) if not file.exists()]
    make = partial(_make_chunk, config, tuple(concepts))
    context = multiprocessing.get_context("spawn")  # forking a process that runs threads may hang
    with ProcessPoolExecutor(os.cpu_count(), mp_context=context) as pool:
        done = len(chunks) - len(todo)
        try:
            for _ in pool.map(make, *zip(*todo, strict=True)) if todo else ():
                done += 1
                progress("drawing buildings", min(done * CHUNK, len(numbers)), len(numbers))
        except BaseException:
            pool.shutdown(cancel_futures=True)  # or what is left would be drawn first
            raise
    return [sample for file in files for sample in _read_chunk(file, concepts)]


def sample_floor(
    rng: np.random.Generator, config: TrainingConfig, concepts: Sequence[str], registry: Registry
) -> Sample:
    """Draw a building that has pairs to relate, and return it as a sample.

    Raises:
        ConceptError: a labeller returned nonsense.
    """
    draw = _draw_grid if rng.random() < config.grid_share else _draw_surfaces
    while True:
        scene, truth = draw(rng, config)
        if len(scene.pairs):
            break
    labels = {name: _labels(name, truth, scene, registry) for name in concepts}
    return Sample(
        node_features(scene, config.features),
        edge_index(scene),
        edge_features(scene, config.features),
        labels,
    )


def _draw_surfaces(rng: np.random.Generator, config: TrainingConfig) -> tuple[Scene, BuildingTruth]:
    """Draw a building that is mapped as surfaces."""
    building = draw_building(rng, config.building)
    surfaces = preprocess(building.graph("floor").wall_surfaces.ordered()).surfaces
    return build_scene(surfaces, config.neighbours), building.truth(surfaces)


def _draw_grid(rng: np.random.Generator, config: TrainingConfig) -> tuple[Scene, BuildingTruth]:
    """Draw a building that is mapped as a grid, and extract its surfaces."""
    building = draw_grid_building(rng, config.building)
    surfaces = preprocess(extract(building.grid).wall_surfaces.ordered()).surfaces
    scene = build_scene(surfaces, config.neighbours, building.grid)
    return scene, building.truth(surfaces)


def _labels(name: str, truth: BuildingTruth, scene: Scene, registry: Registry) -> NDArray[np.bool_]:
    related = np.asarray(registry.part(name, "labeller")(truth))
    total = len(truth.surfaces)
    if related.size == 0:
        return np.zeros(len(scene.pairs), bool)
    if related.ndim != 2 or related.shape[1] != 2 or related.dtype.kind not in "iu":
        raise ConceptError(f"labeller of concept {name!r} must return pairs of rows, [P, 2]")
    if related.min() < 0 or related.max() >= total:
        raise ConceptError(
            f"labeller of concept {name!r} named row {related.max()} of {total} surfaces"
        )
    itself = related[related[:, 0] == related[:, 1], 0]
    if len(itself):
        raise ConceptError(f"labeller of concept {name!r} related row {itself[0]} to itself")

    def keys(pairs: IntArray) -> IntArray:
        return np.asarray(pairs.min(axis=1) * total + pairs.max(axis=1))

    return np.isin(keys(scene.pairs), keys(related))


def _make_chunk(
    config: TrainingConfig, concepts: tuple[str, ...], numbers: range, file: Path
) -> None:
    registry = installed()
    arrays: dict[str, NDArray[Any]] = {}
    for number in numbers:
        sample = sample_floor(
            np.random.default_rng([config.seed, number]), config, concepts, registry
        )
        arrays[f"{number}/x"] = sample.x
        arrays[f"{number}/edge_index"] = sample.edge_index.astype(np.int32)
        arrays[f"{number}/edge_attr"] = sample.edge_attr
        for name, label in sample.labels.items():
            arrays[f"{number}/label/{name}"] = label
    write_whole(file, lambda temporary: np.savez(temporary, **arrays))  # type: ignore[arg-type]


def _read_chunk(file: Path, concepts: Sequence[str]) -> Iterator[Sample]:
    with np.load(file) as arrays:
        numbers = dict.fromkeys(name.partition("/")[0] for name in arrays)
        for number in numbers:
            yield Sample(
                arrays[f"{number}/x"],
                arrays[f"{number}/edge_index"].astype(np.int64),
                arrays[f"{number}/edge_attr"],
                {name: arrays[f"{number}/label/{name}"] for name in concepts},
            )
