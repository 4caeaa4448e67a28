"""Training end to end on few floors: whole files, exact resumption, clear refusals."""

from __future__ import annotations

import errno
import importlib.resources
import json
from pathlib import Path

import numpy as np
import pytest
import torch
from plans import block

from sgraph_concepts.errors import ConceptError, TrainingError
from sgraph_concepts.spec import ConceptSpec, HeadSpec
from sgraph_core.concepts import installed, new_registry
from sgraph_core.detector import Detector
from sgraph_core.network.runtime import Network
from sgraph_core.proximity import build_scene
from sgraph_core.settings import read_settings
from sgraph_core.synth.config import BuildingConfig, GridConfig, PlanConfig
from sgraph_core.training import trainer
from sgraph_core.training.config import TrainingConfig, config_file
from sgraph_core.training.samples import sample_floor

SMALL = TrainingConfig(floors=4, validation_floors=2, steps=6, floors_per_step=2, hidden=8)


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("trained")
    trainer.train(SMALL, folder, installed())
    return folder


def test_a_run_leaves_weights_that_infer(trained: Path) -> None:
    network = Network(trained)
    scene = build_scene(block(0.1).wall_surfaces.ordered())
    nodes, edges = network.encode(network.inputs(scene))
    assert nodes.shape[1] == edges.shape[1] == 8
    for name in ("room.onnx", "wall.onnx", "encoder.safetensors"):
        assert (trained / name).stat().st_size > 0


def test_the_record_says_how_the_weights_came_about(trained: Path) -> None:
    record = json.loads((trained / "training.json").read_text())
    assert TrainingConfig.model_validate(record["config"]) == SMALL
    assert record["concepts"] == ["room", "wall"]
    assert {"torch", "sgraph-concepts"} <= set(record["versions"])
    assert record["history"][-1]["step"] == 6
    assert np.isfinite(record["history"][-1]["validation room"])


def test_an_interrupted_run_ends_with_the_same_weights(
    trained: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(trainer, "STEPS_PER_CHECKPOINT", 2)

    def interrupt(what: str, done: int, _total: int) -> None:
        if (what, done) == ("training", 3):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        trainer.train(SMALL, tmp_path, installed(), progress=interrupt)
    assert not (tmp_path / "encoder.onnx").exists()
    trainer.train(SMALL, tmp_path, installed(), resume=True)
    for name in ("encoder.onnx", "encoder.safetensors", "room.onnx", "wall.onnx"):
        assert (tmp_path / name).read_bytes() == (trained / name).read_bytes(), name


def test_a_run_that_stopped_goes_on_to_a_later_stop(trained: Path, tmp_path: Path) -> None:
    (tmp_path / "floors").symlink_to(trained / "floors")
    early = SMALL.model_copy(update={"stop": 4})
    record = trainer.train(early, tmp_path, installed())
    assert record["history"][-1]["step"] == 4
    assert (tmp_path / "room.onnx").read_bytes() != (trained / "room.onnx").read_bytes()
    trainer.train(SMALL, tmp_path, installed(), resume=True)
    assert (tmp_path / "room.onnx").read_bytes() == (trained / "room.onnx").read_bytes()
    with pytest.raises(TrainingError, match="is at step 6, which is after the last, 4"):
        trainer.train(early, tmp_path, installed(), resume=True)


def test_the_papers_settings_train_and_infer(tmp_path: Path) -> None:
    paper = read_settings(config_file("paper"), TrainingConfig)
    assert (paper.features, paper.neighbours) == ("paper", "nearest")
    few = {"floors": 4, "validation_floors": 2, "steps": 4, "floors_per_step": 2}
    trainer.train(paper.model_copy(update=few), tmp_path, installed())
    network = Network(tmp_path)
    assert (network.features, network.neighbours) == ("paper", "nearest")
    result = Detector(weights=tmp_path, clusterers={"room": "cycles"}).infer(block(0.1))
    assert set(result.concepts) == {"room", "wall"}


def test_a_head_alone_is_trained_on_the_shipped_encoders_features(tmp_path: Path) -> None:
    config = SMALL.model_copy(update={"features": "frame"})
    with pytest.raises(TrainingError, match="features = 'frame': must be 'support'"):
        trainer.train(config, tmp_path, installed(), concept="wall")


def test_another_run_is_not_overwritten(trained: Path) -> None:
    with pytest.raises(TrainingError, match="already holds a training run"):
        trainer.train(SMALL, trained, installed())
    other = SMALL.model_copy(update={"seed": 5})
    with pytest.raises(TrainingError, match="another configuration"):
        trainer.train(other, trained, installed(), resume=True)


def test_a_run_of_other_features_is_not_resumed(
    trained: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(trainer, "ENCODER_VERSION", "2")
    with pytest.raises(TrainingError, match="or of other features"):
        trainer.train(SMALL, trained, installed(), resume=True)


def test_there_must_be_something_to_resume(tmp_path: Path) -> None:
    with pytest.raises(TrainingError, match="no training run to resume"):
        trainer.train(SMALL, tmp_path, installed(), resume=True)


def test_a_damaged_checkpoint_is_named(tmp_path: Path, trained: Path) -> None:
    (tmp_path / "floors").symlink_to(trained / "floors")
    (tmp_path / "run.json").write_text((trained / "run.json").read_text())
    (tmp_path / "checkpoint.pt").write_bytes(b"not a checkpoint")
    with pytest.raises(TrainingError, match=r"checkpoint\.pt: is no checkpoint of this run"):
        trainer.train(SMALL, tmp_path, installed(), resume=True)


def test_a_diverging_loss_ends_the_run_and_keeps_the_checkpoint(
    tmp_path: Path, trained: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(trainer, "STEPS_PER_CHECKPOINT", 2)
    (tmp_path / "floors").symlink_to(trained / "floors")
    learn = trainer._Run.learn

    def poisoned(run: trainer._Run, batch: trainer._Batch) -> None:
        if run.step == 3:
            with torch.no_grad():
                run.encoder.layers[0].edge_update.bias.fill_(float("nan"))
        learn(run, batch)

    monkeypatch.setattr(trainer._Run, "learn", poisoned)
    with pytest.raises(TrainingError, match="loss is nan at step 3: the last checkpoint is kept"):
        trainer.train(SMALL, tmp_path, installed())
    state = torch.load(tmp_path / "checkpoint.pt", weights_only=True)
    assert state["step"] == 2


def test_a_full_disk_is_named_and_keeps_the_last_checkpoint(
    tmp_path: Path, trained: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(trainer, "STEPS_PER_CHECKPOINT", 2)
    (tmp_path / "floors").symlink_to(trained / "floors")
    write, written = Path.write_bytes, []

    def write_until_full(path: Path, content: bytes) -> int:
        if "checkpoint" in path.name:
            if written:
                write(path, content[:100])
                raise OSError(errno.ENOSPC, "No space left on device")
            written.append(path)
        return write(path, content)

    monkeypatch.setattr(Path, "write_bytes", write_until_full)
    with pytest.raises(OSError, match=r"No space left on device: .*checkpoint\.pt"):
        trainer.train(SMALL, tmp_path, installed())
    assert torch.load(tmp_path / "checkpoint.pt", weights_only=True)["step"] == 2
    assert {file.name for file in tmp_path.iterdir()} == {"checkpoint.pt", "floors", "run.json"}


def test_one_head_is_trained_on_the_shipped_encoder(tmp_path: Path) -> None:
    config = TrainingConfig(floors=2, validation_floors=1, steps=2, floors_per_step=2)
    record = trainer.train(config, tmp_path, installed(), concept="wall")
    assert record["encoder_frozen"] is True
    assert not (tmp_path / "encoder.onnx").exists()
    shipped = importlib.resources.files("sgraph_core") / "weights" / "encoder.onnx"
    (tmp_path / "encoder.onnx").write_bytes(shipped.read_bytes())
    scene = build_scene(block(0.1).wall_surfaces.ordered())
    trained = Detector(weights=tmp_path).score(installed()["wall"], scene)
    assert np.isfinite(trained.logits).all()
    assert not np.allclose(trained.logits, Detector().score(installed()["wall"], scene).logits)


def test_concepts_that_cannot_be_trained_are_named(tmp_path: Path) -> None:
    registry = new_registry()
    registry.add(
        ConceptSpec(
            name="rule", relation="r", baseline="zone:everything", clusterer="zone:one_node"
        )
    )
    with pytest.raises(ConceptError, match="'rule' cannot be trained: it needs a head"):
        trainer.train(SMALL, tmp_path, registry, concept="rule")
    with pytest.raises(ConceptError, match="no concept 'roof'"):
        trainer.train(SMALL, tmp_path, registry, concept="roof")


@pytest.mark.parametrize(
    ("labeller", "message"),
    [
        ("zone:label_unknown_surface", r"labeller of concept 'zone' named row 9999 of \d+"),
        ("zone:label_flat", r"labeller of concept 'zone' must return pairs of rows"),
        ("zone:label_itself", r"labeller of concept 'zone' related row 1 to itself"),
    ],
)
def test_labellers_that_return_nonsense_are_named(labeller: str, message: str) -> None:
    registry = new_registry()
    registry.add(
        ConceptSpec(
            name="zone",
            relation="same_zone",
            head=HeadSpec(weights="zone.onnx", encoder="1"),
            clusterer="zone:one_node",
            labeller=labeller,
        )
    )
    with pytest.raises(ConceptError, match=message):
        sample_floor(np.random.default_rng(0), SMALL, ["zone"], registry)


def test_labels_cover_true_pairs_among_the_scenes_pairs() -> None:
    no_wall_inside_a_room = PlanConfig(
        merged_share=(0.0,), niche_share=(0.0,), column_share=(0.0,), partition_share=(0.0,)
    )
    config = SMALL.model_copy(update={"building": BuildingConfig(plan=no_wall_inside_a_room)})
    sample = sample_floor(np.random.default_rng(1), config, ["room", "wall"], installed())
    count = sample.edge_index.shape[1] // 2
    assert sample.labels["room"].shape == sample.labels["wall"].shape == (count,)
    assert 0 < sample.labels["room"].mean() < 1
    assert not (sample.labels["room"] & sample.labels["wall"]).any()


def test_a_share_of_the_floors_is_extracted_from_grids() -> None:
    plan = PlanConfig(floor_area_m2=(100.0, 150.0), corridor_share=0.0)
    building = BuildingConfig(plan=plan, grid=GridConfig(drawn_share=1.0))
    config = SMALL.model_copy(update={"grid_share": 1.0, "building": building})
    surfaces = config.model_copy(update={"grid_share": 0.0})
    extracted, drawn = (
        sample_floor(np.random.default_rng(5), one, ["room", "wall"], installed())
        for one in (config, surfaces)
    )
    assert extracted.x.shape[1] == drawn.x.shape[1]
    assert len(extracted.x) != len(drawn.x)
    assert extracted.labels["room"].any()
    assert extracted.labels["wall"].any()
