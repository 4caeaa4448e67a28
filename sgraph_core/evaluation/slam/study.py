"""All methods on all drives, in parallel, each result kept as soon as it is there."""

from __future__ import annotations

import hashlib
import importlib
import importlib.metadata
import multiprocessing
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict
from functools import cache
from pathlib import Path
from typing import Any

from sgraph_concepts.errors import InputError, OptimizationError
from sgraph_core.concepts import installed
from sgraph_core.evaluation.scores import score_floor
from sgraph_core.evaluation.slam.drives import Conditions, Drive
from sgraph_core.evaluation.slam.growth import watch
from sgraph_core.evaluation.slam.metrics import align, map_rmse, require_evo
from sgraph_core.evaluation.slam.results import Result, Store
from sgraph_core.evaluation.slam.trial import Trial
from sgraph_core.evaluation.slam.variants import VARIANTS, Detectors, Variant

__all__ = ["measure", "run_study", "settings"]

Progress = Callable[[str, int, int], object]
"""Told what is being done, how much of it is done, and how much there is."""
PARTS = (".py", ".onnx", ".json")
"""Of a package: files that results may depend on."""


def run_study(
    drives: Sequence[Drive],
    seeds: int,
    store: Store,
    progress: Progress,
    paper_weights: Path | None = None,
) -> list[Result]:
    """Return the results of every method on every drive and seed, by drive, seed and method.

    What the store holds is not computed again. A drive is made once per seed, for all methods that
    are missing.

    Args:
        drives: scenes or logs.
        seeds: how many; they count from 0.
        store: keeps the results.
        progress: told at the start and after every drive.
        paper_weights: folder of a training with the paper's configuration.

    Raises:
        MissingExtraError: evo is not installed.
        WeightsError: the paper's weights cannot be used, or are not the paper's.
        InputError: a log cannot be read, a result in the store is damaged, or a trajectory cannot
            be aligned with its reference; the text says which.
        OptimizationError: a map cannot be solved; likewise.
    """
    require_evo()
    if paper_weights is not None:
        _detectors(paper_weights).require_papers(paper_weights)
    wanted = [
        (drive, seed, [v.name for v in VARIANTS.values() if drive.has_truth or not v.needs_truth])
        for drive in drives
        for seed in range(seeds)
    ]
    todo = []
    for drive, seed, names in wanted:
        missing = [name for name in names if store.get(drive.key, seed, name) is None]
        if missing:
            todo.append((drive, seed, missing))
    total = sum(len(names) for *_, names in wanted)
    done = total - sum(len(names) for *_, names in todo)
    progress("driving", done, total)
    for drive, results in _in_parallel(todo, paper_weights):
        for result in results:
            store.put(drive.key, result)
        done += len(results)
        progress("driving", done, total)
    found = (store.get(d.key, seed, name) for d, seed, names in wanted for name in names)
    return [result for result in found if result is not None]


def settings(conditions: Conditions, paper_weights: Path | None = None) -> dict[str, Any]:
    """Return what results depend on besides drive, seed and method."""
    plugins = {concept.package.partition(".")[0] for concept in installed() if concept.package}
    packages = sorted({"sgraph_core", *plugins})
    weights = [] if paper_weights is None else sorted(paper_weights.glob("*.onnx"))
    return {
        "version": importlib.metadata.version("sgraph-concepts"),
        "code": _digest(file for name in packages for file in _parts(name)),
        "paper_weights": _digest(weights) if weights else None,
        "conditions": asdict(conditions),
    }


def _parts(package: str) -> list[Path]:
    files = Path(str(importlib.import_module(package).__file__)).parent.rglob("*")
    return sorted(file for file in files if file.suffix in PARTS)


def _digest(files: Iterable[Path]) -> str:
    digest = hashlib.sha256()
    for file in files:
        digest.update(file.read_bytes())
    return digest.hexdigest()[:12]


Task = tuple[Drive, int, list[str]]
"""A drive, its seed, and the methods that are missing."""
Finished = tuple[Drive, list[Result]]


def _in_parallel(tasks: Sequence[Task], paper_weights: Path | None) -> Iterator[Finished]:
    if not tasks:
        return
    context = multiprocessing.get_context("spawn")  # forking a process that runs threads may hang
    workers = min(os.cpu_count() or 1, len(tasks))
    with ProcessPoolExecutor(workers, mp_context=context) as pool:
        futures = {pool.submit(_run_task, *task, paper_weights): task[0] for task in tasks}
        try:
            for future in as_completed(futures):
                yield futures[future], future.result()
        except BaseException:
            pool.shutdown(cancel_futures=True)  # or what is left would be driven first
            raise


_detectors = cache(Detectors.load)


def _run_task(
    drive: Drive, seed: int, names: Sequence[str], paper_weights: Path | None
) -> list[Result]:
    trial = drive.trial(seed)
    detectors = _detectors(paper_weights)
    results = []
    for name in names:
        try:
            results.append(measure(trial, VARIANTS[name], detectors))
        except (InputError, OptimizationError) as error:
            # a kind of InputError may ask for more than a text
            kind = InputError if isinstance(error, InputError) else OptimizationError
            raise kind(f"{drive.name}, seed {seed}, {name}: {error}") from error
    return results


def measure(trial: Trial, variant: Variant, detectors: Detectors) -> Result:
    """Run one method on one drive, and score what it makes of it.

    Raises:
        InputError: the trajectory cannot be aligned with its reference, or the map is empty.
        OptimizationError: the map cannot be solved.
    """
    solved = variant.solve(trial, detectors)
    alignment = align(solved, trial.recording.reference)
    scores = None if solved.truth is None else score_floor(solved, solved.truth)
    growth = watch(trial, variant, detectors)
    return Result(
        drive=trial.recording.name,
        seed=trial.seed,
        variant=variant.name,
        ate_m=alignment.ate_rmse_m,
        map_m=map_rmse(solved, trial.true_surfaces, alignment),
        rooms=scores.rooms if scores and "room" in variant.concepts else None,
        walls=scores.walls if scores and "wall" in variant.concepts else None,
        first_room_s=growth.first_room_s,
        update_ms=growth.update_ms,
    )
