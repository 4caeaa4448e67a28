"""From torch to ONNX: the form in which weights are shipped and run."""

from __future__ import annotations

import hashlib
import logging
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from sgraph_concepts.errors import MissingExtraError
from sgraph_core.features import FeatureSet
from sgraph_core.files import write_whole
from sgraph_core.network import ENCODER_VERSION
from sgraph_core.network.model import Encoder, Head, PartEncoder
from sgraph_core.proximity import Neighbours

__all__ = ["export_encoder", "export_head", "fingerprint"]


def export_encoder(
    encoder: Encoder,
    path: Path,
    features: FeatureSet = "support",
    neighbours: Neighbours = "visible",
) -> None:
    """Write an encoder as ONNX, with the inputs and outputs of a :class:`PartEncoder`.

    They are named x, edge_index, edge_attr, known, before; nodes, edges.

    Args:
        encoder: the encoder.
        path: the file to write.
        features: what it is given of nodes and edges; stored with it, as are
        neighbours: the pairs that it is given.

    Raises:
        MissingExtraError: onnx or onnxscript is not installed.
    """
    inputs = {
        **_graph(len(encoder.node_mean), len(encoder.edge_mean)),
        "known": torch.zeros(3, dtype=torch.bool),
        "before": torch.zeros(3, len(encoder.layers) * encoder.hidden),
    }
    metadata = {
        "encoder_fingerprint": fingerprint(encoder),
        "features": features,
        "neighbours": neighbours,
    }
    _export(PartEncoder(encoder), inputs, ["nodes", "edges"], metadata, path)


def export_head(head: Head, encoder: Encoder, path: Path) -> None:
    """Write a head as ONNX with inputs x, edge_index, edge_attr and output logits.

    Args:
        head: the head.
        encoder: the encoder it was trained on; its fingerprint is stored with the head.
        path: the file to write.

    Raises:
        MissingExtraError: onnx or onnxscript is not installed.
    """
    inputs = _graph(encoder.hidden, encoder.hidden)
    _export(head, inputs, ["logits"], {"encoder_fingerprint": fingerprint(encoder)}, path)


def fingerprint(encoder: Encoder) -> str:
    """Return a short digest of an encoder's weights; a head only works with the encoder it saw."""
    digest = hashlib.sha256()
    for name, tensor in sorted(encoder.state_dict().items()):
        digest.update(name.encode())
        digest.update(tensor.detach().cpu().contiguous().numpy().tobytes())
    return digest.hexdigest()[:16]


def _graph(nodes: int, edges: int) -> dict[str, Tensor]:
    """Return a graph to export with, given how many features its nodes and edges have."""
    return {
        "x": torch.zeros(3, nodes),
        "edge_index": torch.tensor([[0, 1, 1, 2], [1, 0, 2, 1]]),
        "edge_attr": torch.zeros(4, edges),
    }


def _export(
    module: nn.Module,
    inputs: Mapping[str, Tensor],
    outputs: list[str],
    metadata: dict[str, str],
    path: Path,
) -> None:
    try:
        import onnx
        import onnxscript  # noqa: F401  (torch.onnx needs it)
    except ImportError as error:
        raise MissingExtraError("onnx with onnxscript", "train") from error
    rows, columns = torch.export.Dim("nodes", min=2), torch.export.Dim("edges", min=2)
    shapes = {name: {0: rows} for name in inputs}
    shapes |= {"edge_index": {1: columns}, "edge_attr": {0: columns}}
    logger = logging.getLogger("torch.onnx")
    level = logger.level
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the exporter warns about its own internals
        logger.setLevel(logging.ERROR)
        program = torch.onnx.export(
            module.eval(),
            tuple(inputs.values()),
            input_names=list(inputs),
            output_names=outputs,
            dynamic_shapes=shapes,
            custom_translation_table={torch.ops.aten.scatter_reduce.two: _largest_of_rows},
            dynamo=True,
            verbose=False,
        )
        logger.setLevel(level)
    assert program is not None
    model = program.model_proto
    del model.metadata_props[:]
    for node in [*model.graph.node, *(n for f in model.functions for n in f.node)]:
        node.doc_string = ""
        del node.metadata_props[:]  # stack traces with this machine's paths
    onnx.helper.set_model_props(model, {"encoder": ENCODER_VERSION, **metadata})
    write_whole(path, lambda temporary: temporary.write_bytes(model.SerializeToString()))


def _largest_of_rows(
    x: Any, dim: int, index: Any, source: Any, reduce: str, include_self: bool = True
) -> Any:
    """Return the largest of the source's rows that go to each row of x, and x where none does.

    What torch-geometric aggregates by. Its index is one number a row, repeated along the row. The
    exporter would hand all of them to two ScatterElements, which take most of an encoder's time:
    ScatterND takes whole rows. ONNX Runtime must run it in one thread: several race.
    """
    from onnxscript import opset18

    op: Any = opset18  # its types know constants of its own kind only
    if (dim, reduce, include_self) != (0, "amax", False):
        raise NotImplementedError(f"scatter_reduce by {reduce} along {dim}")
    rows = op.Slice(op.Flatten(index, axis=1), [0], [1], [1])
    least = op.Expand(op.Constant(value_float=float("-inf")), op.Shape(x))
    largest = op.ScatterND(least, rows, source, reduction="max")
    return op.Where(op.IsInf(largest, detect_positive=0), x, largest)
