"""From torch to ONNX: the form in which weights are shipped and run."""

from __future__ import annotations

import hashlib
import logging
import warnings
from pathlib import Path

import torch
from torch import Tensor, nn

from sgraph_concepts.errors import MissingExtraError
from sgraph_core.features import EDGE_FEATURES, NODE_FEATURES
from sgraph_core.files import write_whole
from sgraph_core.network import ENCODER_VERSION
from sgraph_core.network.model import Encoder, Head

__all__ = ["export_encoder", "export_head", "fingerprint"]


def export_encoder(encoder: Encoder, path: Path) -> None:
    """Write an encoder as ONNX with inputs x, edge_index, edge_attr and outputs nodes, edges.

    Raises:
        MissingExtraError: onnx or onnxscript is not installed.
    """
    nodes = torch.zeros(3, len(NODE_FEATURES))
    edges = torch.zeros(4, len(EDGE_FEATURES))
    _export(encoder, (nodes, edges), ["nodes", "edges"], fingerprint(encoder), path)


def export_head(head: Head, encoder: Encoder, path: Path) -> None:
    """Write a head as ONNX with inputs x, edge_index, edge_attr and output logits.

    Args:
        head: the head.
        encoder: the encoder it was trained on; its fingerprint is stored with the head.
        path: the file to write.

    Raises:
        MissingExtraError: onnx or onnxscript is not installed.
    """
    inputs = (torch.zeros(3, encoder.hidden), torch.zeros(4, encoder.hidden))
    _export(head, inputs, ["logits"], fingerprint(encoder), path)


def fingerprint(encoder: Encoder) -> str:
    """Return a short digest of an encoder's weights; a head only works with the encoder it saw."""
    digest = hashlib.sha256()
    for name, tensor in sorted(encoder.state_dict().items()):
        digest.update(name.encode())
        digest.update(tensor.detach().cpu().contiguous().numpy().tobytes())
    return digest.hexdigest()[:16]


def _export(
    module: nn.Module,
    features: tuple[Tensor, Tensor],
    outputs: list[str],
    encoder_fingerprint: str,
    path: Path,
) -> None:
    try:
        import onnx
        import onnxscript  # noqa: F401  (torch.onnx needs it)
    except ImportError as error:
        raise MissingExtraError("onnx with onnxscript", "train") from error
    x, edge_attr = features
    edge_index = torch.tensor([[0, 1, 1, 2], [1, 0, 2, 1]])
    rows, columns = torch.export.Dim("nodes", min=2), torch.export.Dim("edges", min=2)
    logger = logging.getLogger("torch.onnx")
    level = logger.level
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the exporter warns about its own internals
        logger.setLevel(logging.ERROR)
        program = torch.onnx.export(
            module.eval(),
            (x, edge_index, edge_attr),
            input_names=["x", "edge_index", "edge_attr"],
            output_names=outputs,
            dynamic_shapes={"x": {0: rows}, "edge_index": {1: columns}, "edge_attr": {0: columns}},
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
    metadata = {"encoder": ENCODER_VERSION, "encoder_fingerprint": encoder_fingerprint}
    onnx.helper.set_model_props(model, metadata)
    write_whole(path, lambda temporary: temporary.write_bytes(model.SerializeToString()))
