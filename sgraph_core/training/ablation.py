"""What each part of the method brings: the same training with one part changed."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sgraph_concepts.registry import Registry
from sgraph_core.detector import Detector
from sgraph_core.evaluation.report import SourceReport, evaluate
from sgraph_core.evaluation.sources import find_sources, load_with_truth
from sgraph_core.settings import read_settings
from sgraph_core.training.config import TrainingConfig, config_file
from sgraph_core.training.samples import Progress
from sgraph_core.training.trainer import RECORD, train

__all__ = ["VARIANTS", "Variant", "ablate"]


@dataclass(frozen=True)
class Variant:
    """One row of the table.

    Attributes:
        name: what is different, in words.
        changes: fields of the training's configuration that are.
        plain_buildings: train on the paper's kind of layouts.
        clusterer: of rooms, if not the declared one.
    """

    name: str
    changes: Mapping[str, Any]
    plain_buildings: bool = False
    clusterer: str | None = None


PAPER = {"features": "paper", "neighbours": "nearest"}
FRAME = {"features": "frame", "neighbours": "nearest"}
VARIANTS = (
    Variant("the paper's", PAPER, plain_buildings=True, clusterer="cycles"),
    Variant("+ features in each edge's frame", FRAME, plain_buildings=True, clusterer="cycles"),
    Variant("+ our buildings", FRAME, clusterer="cycles"),
    Variant("+ visible neighbours", {"features": "frame"}, clusterer="cycles"),
    Variant("+ visibility as feature", {"features": "visibility"}, clusterer="cycles"),
    Variant("+ what is in line", {}, clusterer="cycles"),
    Variant("+ multicut: ours", {}),
    Variant("ours, the paper's buildings", {}, plain_buildings=True),
    Variant("ours, nearest neighbours", {"neighbours": "nearest"}),
    Variant("ours, 1 layer", {"layers": 1}),
    Variant("ours, 3 layers", {"layers": 3}),
    Variant("ours, width 16", {"hidden": 16}),
    Variant("ours, width 96", {"hidden": 96}),
)


def ablate(
    base: TrainingConfig,
    maps: Sequence[Path],
    folder: Path,
    registry: Registry,
    progress: Progress,
) -> Iterator[tuple[str, list[SourceReport]]]:
    """Train every variant, score it on maps with truth, and yield its name and scores.

    Variants that train alike share a training. An interrupted run goes on where it stopped.

    Args:
        base: what the variants have in common.
        maps: map files or folders, each a source.
        folder: where trainings are kept, each under a digest of its configuration.
        registry: the concepts.
        progress: told how far a training or an evaluation is.

    Raises:
        TrainingError: the folder holds a run of another configuration.
        InputError: a map has no truth, or a folder no map; found before the first training.
        MapFileError: a map cannot be read; likewise.
    """
    for source in find_sources(maps):
        for file in source.files:
            load_with_truth(file)  # a bad map is better found before the trainings than after one
    plain = read_settings(config_file("paper"), TrainingConfig).building
    for variant in VARIANTS:
        changes = {
            **variant.changes,
            "building": plain if variant.plain_buildings else base.building,
        }
        config = base.model_copy(update=changes)
        weights = folder / hashlib.sha256(config.model_dump_json().encode()).hexdigest()[:12]
        if not (weights / RECORD).exists():
            train(
                config, weights, registry, resume=(weights / "run.json").exists(), progress=progress
            )
        clusterers = {"room": variant.clusterer} if variant.clusterer else {}
        detector = Detector(registry, clusterers=clusterers, weights=weights)
        yield variant.name, evaluate(maps, detector, progress=progress)
