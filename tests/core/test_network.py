"""The network's definition, and that the shipped export computes the same."""

from __future__ import annotations

import importlib.resources
import json
from pathlib import Path

import numpy as np
import onnx
import pytest
import torch
from plans import L_SHAPE, block, plan, rectangle
from safetensors.torch import load_file

from sgraph_concepts.errors import WeightsError
from sgraph_concepts.types import Scene
from sgraph_core.concepts import installed
from sgraph_core.detector import Detector
from sgraph_core.features import (
    EDGE_FEATURES,
    NODE_FEATURES,
    edge_features,
    edge_index,
    node_features,
)
from sgraph_core.graph import SGraph
from sgraph_core.network import ENCODER_VERSION
from sgraph_core.network.export import export_encoder, export_head, fingerprint
from sgraph_core.network.model import Encoder, Head, initialise, symmetric
from sgraph_core.network.runtime import Network
from sgraph_core.proximity import build_scene

SCENES = [
    block(0.15),
    plan(rectangle(0, 0, 5, 4)),
    plan(L_SHAPE, rectangle(8.2, 0, 5, 4), rectangle(30, 0, 5, 4)),
]


def scene_of(graph: SGraph) -> Scene:
    return build_scene(graph.wall_surfaces.ordered())


def tensors(scene: Scene) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    return (
        torch.from_numpy(node_features(scene)),
        torch.from_numpy(edge_index(scene)),
        torch.from_numpy(edge_features(scene)),
    )


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory) -> tuple[Encoder, Head, Path]:
    torch.manual_seed(1)
    encoder, head = Encoder(hidden=16, layers=3), Head(width=16, hidden=8)
    initialise(encoder)
    initialise(head)
    folder = tmp_path_factory.mktemp("weights")
    export_encoder(encoder, folder / "encoder.onnx")
    export_head(head, encoder, folder / "head.onnx")
    return encoder, head, folder


@pytest.mark.parametrize("graph", SCENES)
def test_any_exported_encoder_equals_the_torch_one(
    exported: tuple[Encoder, Head, Path], graph: SGraph
) -> None:
    encoder, _, folder = exported
    scene = scene_of(graph)
    network = Network(folder)
    nodes, edges = network.encode(network.inputs(scene))
    with torch.no_grad():
        torch_nodes, torch_edges = encoder(*tensors(scene))
    assert nodes == pytest.approx(torch_nodes.numpy(), abs=1e-5)
    assert edges == pytest.approx(torch_edges.numpy(), abs=1e-5)


def shipped_encoder() -> Encoder:
    weights = importlib.resources.files("sgraph_core") / "weights"
    config = json.loads((weights / "training.json").read_text())["config"]
    encoder = Encoder(config["hidden"], config["layers"])
    encoder.load_state_dict(load_file(str(weights / "encoder.safetensors")))
    return encoder


@pytest.mark.parametrize("graph", SCENES)
def test_the_shipped_encoder_equals_the_torch_one(graph: SGraph) -> None:
    scene = scene_of(graph)
    network = Network()
    nodes, edges = network.encode(network.inputs(scene))
    with torch.no_grad():
        torch_nodes, torch_edges = shipped_encoder()(*tensors(scene))
    assert nodes == pytest.approx(torch_nodes.numpy(), abs=1e-5)
    assert edges == pytest.approx(torch_edges.numpy(), abs=1e-5)


def test_the_shipped_record_belongs_to_the_shipped_weights() -> None:
    weights = importlib.resources.files("sgraph_core") / "weights"
    record = json.loads((weights / "training.json").read_text())
    assert record["encoder"] == ENCODER_VERSION
    assert record["encoder_fingerprint"] == fingerprint(shipped_encoder())
    metadata = {p.key: p.value for p in onnx.load(str(weights / "encoder.onnx")).metadata_props}
    assert metadata["encoder_fingerprint"] == record["encoder_fingerprint"]


def test_shipped_weights_are_small() -> None:
    files = [installed()[name].weights_file() for name in ("room", "wall")]
    folder = importlib.resources.files("sgraph_core") / "weights"
    files += [file for file in folder.iterdir() if file.is_file()]
    assert sum(len(file.read_bytes()) for file in files) < 2_000_000


def test_a_part_is_encoded_like_the_whole_where_it_has_all_neighbours(
    exported: tuple[Encoder, Head, Path],
) -> None:
    network = Network(exported[2])
    inputs = network.inputs(scene_of(SCENES[0]))
    total = len(inputs["x"])
    nothing = np.zeros((total, network.layers * network.hidden), np.float32)
    whole, edges = network.encode_part(inputs, np.zeros(total, bool), nothing)
    j, i = inputs["edge_index"]
    inner = np.arange(total) == 2
    kept = inner[i] | inner[j]
    assert not kept.all()
    part = {
        "x": inputs["x"],
        "edge_index": inputs["edge_index"][:, kept],
        "edge_attr": inputs["edge_attr"][kept],
    }
    before = np.where(inner[:, None], np.nan, whole).astype(np.float32)
    nodes, some = network.encode_part(part, ~inner, before)
    assert nodes == pytest.approx(whole, abs=1e-5)
    assert some == pytest.approx(edges[kept], abs=1e-5)
    assert network.final(nodes) == pytest.approx(network.encode(inputs)[0], abs=1e-5)


def test_rows_are_aggregated_whole() -> None:
    """Element by element, aggregation would take most of the encoder's time."""
    weights = importlib.resources.files("sgraph_core") / "weights"
    graph = onnx.load(str(weights / "encoder.onnx")).graph
    by_element = [node for node in graph.node if node.op_type == "ScatterElements"]
    reductions = [onnx.helper.get_node_attr_value(node, "reduction") for node in by_element]
    assert set(reductions) <= {b"add"}, "of attention's weights, one number a row"
    assert "ScatterND" in [node.op_type for node in graph.node]


def test_edges_enter_the_attention(exported: tuple[Encoder, Head, Path]) -> None:
    """Node embeddings change with edge features, which the published code never lets in."""
    encoder = exported[0]
    x, index, attributes = tensors(scene_of(SCENES[0]))
    with torch.no_grad():
        before, _ = encoder(x, index, attributes)
        after, _ = encoder(x, index, attributes * 0.5)
    assert not torch.allclose(before, after)


def test_a_surface_without_neighbours_has_an_embedding(
    exported: tuple[Encoder, Head, Path],
) -> None:
    encoder, _, folder = exported
    x, index, attributes = tensors(scene_of(SCENES[0]))
    lonely = torch.cat([x, x[:1]])
    with torch.no_grad():
        nodes, _ = encoder(lonely, index, attributes)
    assert torch.isfinite(nodes).all()
    inputs = {"x": lonely, "edge_index": index, "edge_attr": attributes}
    run, _ = Network(folder).encode({name: tensor.numpy() for name, tensor in inputs.items()})
    assert run == pytest.approx(nodes.numpy(), abs=1e-5)


def test_relations_are_symmetric(exported: tuple[Encoder, Head, Path]) -> None:
    encoder, head, _ = exported
    x, index, attributes = tensors(scene_of(SCENES[0]))
    with torch.no_grad():
        logits = symmetric(head(*_encoded(encoder, x, index, attributes)))
        count = index.shape[1] // 2
        swapped = torch.cat([index[:, count:], index[:, :count]], dim=1)
        turned = torch.cat([attributes[count:], attributes[:count]])
        again = symmetric(head(*_encoded(encoder, x, swapped, turned)))
    assert torch.allclose(logits, again, atol=1e-6)


def _encoded(
    encoder: Encoder, x: torch.Tensor, index: torch.Tensor, attributes: torch.Tensor
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    nodes, edges = encoder(x, index, attributes)
    return nodes, index, edges


def test_weights_start_xavier_uniform() -> None:
    torch.manual_seed(0)
    head = Head(width=64, hidden=64)
    initialise(head)
    weight = head.layers[0].weight
    bound = (6 / sum(weight.shape)) ** 0.5
    assert weight.abs().max() <= bound
    assert weight.std().item() == pytest.approx(bound / 3**0.5, rel=0.05)
    assert (head.layers[0].bias == 0).all()


def test_the_input_layer_fits_the_features() -> None:
    encoder = Encoder()
    assert encoder.node_mean.shape == (len(NODE_FEATURES["support"]),)
    assert encoder.edge_mean.shape == (len(EDGE_FEATURES["support"]),)


def test_a_head_of_other_encoder_weights_is_refused(
    exported: tuple[Encoder, Head, Path], tmp_path: Path
) -> None:
    (tmp_path / "encoder.onnx").write_bytes((exported[2] / "encoder.onnx").read_bytes())
    (tmp_path / "room.onnx").write_bytes(installed()["room"].weights_file().read_bytes())
    with pytest.raises(WeightsError, match="trained on other encoder weights"):
        Detector(weights=tmp_path).infer(SCENES[0], ["room"])


@pytest.mark.parametrize(
    ("content", "message"),
    [(None, "cannot be read"), (b"", "is no ONNX model"), (b"pickle", "is no ONNX model")],
)
def test_damaged_weights_are_named(tmp_path: Path, content: bytes | None, message: str) -> None:
    file = tmp_path / "encoder.onnx"
    if content is not None:
        file.write_bytes(content)
    with pytest.raises(WeightsError, match=message):
        Network(tmp_path)


def test_weights_of_another_version_are_refused(
    exported: tuple[Encoder, Head, Path], tmp_path: Path
) -> None:
    model = onnx.load(str(exported[2] / "encoder.onnx"))
    onnx.helper.set_model_props(model, {"encoder": "0.1"})
    onnx.save(model, str(tmp_path / "encoder.onnx"))
    with pytest.raises(WeightsError, match=r"version '0\.1', but version '1' is installed"):
        Network(tmp_path)


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("features", None, "features = None: must be one of support, visibility, frame, paper"),
        (
            "features",
            "colour",
            "features = 'colour': must be one of support, visibility, frame, paper",
        ),
        ("neighbours", None, "neighbours = None: must be one of visible, nearest"),
        ("features", "paper", "takes 8 features of a node and 28 of an edge, but is given 3 and 3"),
    ],
)
def test_an_encoder_of_other_features_is_refused(
    exported: tuple[Encoder, Head, Path],
    tmp_path: Path,
    key: str,
    value: str | None,
    message: str,
) -> None:
    model = onnx.load(str(exported[2] / "encoder.onnx"))
    stored = {entry.key: entry.value for entry in model.metadata_props}
    stored = {name: text for name, text in {**stored, key: value}.items() if text is not None}
    onnx.helper.set_model_props(model, stored)
    onnx.save(model, str(tmp_path / "encoder.onnx"))
    with pytest.raises(WeightsError, match=message):
        Network(tmp_path)


def test_models_of_another_form_are_refused(
    exported: tuple[Encoder, Head, Path], tmp_path: Path
) -> None:
    encoder, _, folder = exported
    (tmp_path / "encoder.onnx").write_bytes((folder / "head.onnx").read_bytes())
    with pytest.raises(
        WeightsError, match=r"gives logits, but must .* nodes, edges: train it again"
    ):
        Network(tmp_path)
    (tmp_path / "encoder.onnx").write_bytes((folder / "encoder.onnx").read_bytes())
    (tmp_path / "room.onnx").write_bytes((folder / "encoder.onnx").read_bytes())
    with pytest.raises(
        WeightsError, match=r"room\.onnx: takes .* and gives nodes, edges, but must"
    ):
        Detector(weights=tmp_path).infer(SCENES[0], ["room"])
    narrow = Encoder(hidden=8, layers=3)
    export_head(Head(width=8, hidden=8), narrow, tmp_path / "room.onnx")
    model = onnx.load(str(tmp_path / "room.onnx"))
    print_of = {"encoder": ENCODER_VERSION, "encoder_fingerprint": fingerprint(encoder)}
    onnx.helper.set_model_props(model, print_of)
    onnx.save(model, str(tmp_path / "room.onnx"))
    with pytest.raises(WeightsError, match=r"takes 8 features of a node .* given 16 and 16"):
        Detector(weights=tmp_path).infer(SCENES[0], ["room"])


def test_exported_files_hold_no_paths_of_the_machine(
    exported: tuple[Encoder, Head, Path],
) -> None:
    for file in exported[2].iterdir():
        assert b"site-packages" not in file.read_bytes()


def test_one_scene_is_encoded_once_for_all_concepts(monkeypatch: pytest.MonkeyPatch) -> None:
    detector, calls = Detector(), []
    encode = Network.encode
    monkeypatch.setattr(Network, "encode", lambda *a: calls.append(1) or encode(*a))
    detector.infer(SCENES[0])
    assert len(calls) == 1


def test_infinite_scores_never_leave_the_network() -> None:
    scene = scene_of(SCENES[2])
    detector = Detector()
    logits = detector.score(installed()["room"], scene).logits
    assert np.isfinite(logits).all()
    assert logits.dtype == np.float64
