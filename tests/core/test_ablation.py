"""The ablation: variants differ in what they say, and finished trainings are not run again."""

from __future__ import annotations

from pathlib import Path

import pytest
from plans import block, plan, rectangle

from sgraph_concepts.errors import InputError, MapFileError
from sgraph_core import map_file
from sgraph_core.concepts import installed
from sgraph_core.graph import TrueRoom, Truth
from sgraph_core.training import ablation
from sgraph_core.training.config import TrainingConfig

SMALL = TrainingConfig(floors=4, validation_floors=2, steps=4, floors_per_step=2, hidden=8)


def say_nothing(_what: str, _done: int, _total: int) -> None:
    pass


def test_variants_have_names_of_their_own_and_settings_that_exist() -> None:
    names = [variant.name for variant in ablation.VARIANTS]
    assert len(set(names)) == len(names)
    for variant in ablation.VARIANTS:
        TrainingConfig.model_validate({**SMALL.model_dump(), **variant.changes})


def test_maps_that_cannot_be_scored_are_named_before_any_training(tmp_path: Path) -> None:
    untrue = plan(rectangle(0, 0, 5, 4))
    untrue.truth = None
    map_file.save(untrue, tmp_path / "untrue.json")
    for name, error in (("missing.json", MapFileError), ("untrue.json", InputError)):
        rows = ablation.ablate(
            SMALL, [tmp_path / name], tmp_path / "runs", installed(), say_nothing
        )
        with pytest.raises(error, match=name):
            next(iter(rows))
        assert not (tmp_path / "runs").exists()


def test_an_interrupted_ablation_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    graph = block(0.15)
    rooms = tuple(TrueRoom(k, None, tuple(range(4 * k, 4 * k + 4)), None) for k in range(4))
    graph.truth = Truth(rooms, ())
    map_file.save(graph, tmp_path / "block.json")
    wide = ablation.Variant("wider", {"hidden": 12})
    variants = (ablation.Variant("ours", {}), ablation.Variant("cycles", {}, False, "cycles"), wide)
    monkeypatch.setattr(ablation, "VARIANTS", variants)
    trained: list[int] = []
    train = ablation.train

    def count(config: TrainingConfig, *args: object, **kwargs: object) -> object:
        trained.append(config.hidden)
        return train(config, *args, **kwargs)  # type: ignore[arg-type]

    monkeypatch.setattr(ablation, "train", count)

    def run() -> list[str]:
        maps = [tmp_path / "block.json"]
        rows = ablation.ablate(SMALL, maps, tmp_path / "runs", installed(), say_nothing)
        return [name for name, (report,) in rows if report.floors]

    assert run() == ["ours", "cycles", "wider"]
    assert trained == [8, 12]  # the clusterer needs no training of its own
    assert run() == ["ours", "cycles", "wider"]
    assert trained == [8, 12]
