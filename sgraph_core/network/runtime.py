"""Inference with the exported network; needs ONNX Runtime, not torch."""

from __future__ import annotations

import importlib.resources
from collections.abc import Mapping, Sequence
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from sgraph_concepts.errors import WeightsError
from sgraph_concepts.registry import RegisteredConcept
from sgraph_concepts.types import Scene, ScoredEdges
from sgraph_core.features import (
    EDGE_FEATURES,
    NODE_FEATURES,
    FeatureSet,
    edge_features,
    edge_index,
    node_features,
)
from sgraph_core.network import ENCODER_VERSION
from sgraph_core.proximity import Neighbours

__all__ = ["Inputs", "Network"]

GRAPH = ("x", "edge_index", "edge_attr")
"""Names of the inputs of encoder and heads."""
PART = ("known", "before")
"""Names of the encoder's further inputs: see :meth:`Network.encode_part`."""
Inputs = dict[str, NDArray[Any]]
"""Of the encoder: x [N, F_v], edge_index [2, 2E], edge_attr [2E, F_e]."""
Vectors = NDArray[np.float32]


class Network:
    """The shared encoder and the heads that have been asked for, each loaded once.

    Safe to use from several threads: ONNX Runtime's sessions are, and nothing else is kept.

    Attributes:
        features: what the encoder is given of nodes and edges.
        neighbours: the pairs that it is given.
        layers: how many message-passing layers it has.
        hidden: width H of the embeddings.

    Args:
        folder: where ``encoder.onnx`` and a head per concept are, as ``sgraph train`` writes them;
            the shipped ones by default.

    Raises:
        WeightsError: the file is absent, damaged, no encoder, or of another version.
    """

    features: FeatureSet
    neighbours: Neighbours
    layers: int
    hidden: int

    def __init__(self, folder: Path | None = None) -> None:
        self._folder = folder
        shipped = importlib.resources.files("sgraph_core") / "weights"
        file = (folder or shipped) / "encoder.onnx"
        self._encoder, metadata = self._open(file, (*GRAPH, *PART), ("nodes", "edges"))
        self.features = _stored(metadata, "features", get_args(FeatureSet), file)
        self.neighbours = _stored(metadata, "neighbours", get_args(Neighbours), file)
        nodes, edges = NODE_FEATURES[self.features], EDGE_FEATURES[self.features]
        _check_widths(self._encoder, len(nodes), len(edges), file)
        after, self.hidden = (tensor.shape[1] for tensor in self._encoder.get_outputs())
        self.layers = after // self.hidden
        self._fingerprint = metadata.get("encoder_fingerprint", "")
        self._heads: dict[str, Any] = {}

    def inputs(self, scene: Scene) -> Inputs:
        """Return what the encoder is given of a scene."""
        return {
            "x": node_features(scene, self.features),
            "edge_index": edge_index(scene),
            "edge_attr": edge_features(scene, self.features),
        }

    def encode(self, inputs: Inputs) -> tuple[Vectors, Vectors]:
        """Return node embeddings [N, H] and edge embeddings [2E, H] of a scene with pairs."""
        total = len(inputs["x"])
        nothing = np.zeros((total, self.layers * self.hidden), np.float32)
        nodes, edges = self.encode_part(inputs, np.zeros(total, bool), nothing)
        return self.final(nodes), edges

    def encode_part(
        self, inputs: Inputs, known: NDArray[np.bool_], before: Vectors
    ) -> tuple[Vectors, Vectors]:
        """Return node embeddings after each layer [N, layers * H] and edge embeddings [2E, H].

        Args:
            inputs: of a part of a scene, with pairs.
            known: nodes whose embeddings are known, as they lack neighbours in this part, [N].
            before: what this returned for them, [N, layers * H]; the others' are not looked at.
        """
        nodes, edges = self._encoder.run(None, {**inputs, "known": known, "before": before})
        return nodes, edges

    def final(self, nodes: Vectors) -> Vectors:
        """Return the embeddings after the last of all layers, [N, H]."""
        return np.ascontiguousarray(nodes[:, -self.hidden :])

    def score(
        self,
        concept: RegisteredConcept,
        scene: Scene,
        embeddings: tuple[Vectors, Vectors],
    ) -> ScoredEdges:
        """Return the relation of one concept, from what :meth:`encode` returned for the scene.

        Raises:
            WeightsError: the head's file is absent, damaged, no head, or was trained on another
                encoder.
        """
        name = concept.spec.name
        if name not in self._heads:
            self._heads[name] = self._open_head(concept)
        nodes, edges = embeddings
        (logits,) = self._heads[name].run(
            None, {"x": nodes, "edge_index": edge_index(scene), "edge_attr": edges}
        )
        forward, backward = np.split(logits.astype(np.float64), 2)
        return ScoredEdges(scene.pairs, (forward + backward) / 2)

    def _open_head(self, concept: RegisteredConcept) -> Any:
        if self._folder is None:
            file = concept.weights_file()
        else:
            file = self._folder / f"{concept.spec.name}.onnx"
        session, metadata = self._open(file, GRAPH, ("logits",))
        if metadata.get("encoder_fingerprint") != self._fingerprint:
            raise WeightsError(
                f"{file.name} of concept {concept.spec.name!r} was trained on other encoder "
                f"weights than the installed ones: train it again with "
                f"'sgraph train --concept {concept.spec.name}'"
            )
        _check_widths(session, self.hidden, self.hidden, file)
        return session

    def _open(
        self, file: Traversable, inputs: Sequence[str], outputs: Sequence[str]
    ) -> tuple[Any, dict[str, str]]:
        """Return a model that takes these inputs and gives these outputs, and its metadata."""
        import onnxruntime

        try:
            model = file.read_bytes()
        except OSError as error:
            raise WeightsError(f"{file}: cannot be read: {error.strerror}") from error
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = 1  # with more, ScatterND loses some of the rows that meet
        options.inter_op_num_threads = 1
        options.log_severity_level = 3
        options.enable_cpu_mem_arena = False  # it would keep what the largest scene took
        try:
            session = onnxruntime.InferenceSession(
                model, options, providers=["CPUExecutionProvider"]
            )
        except Exception as error:  # ONNX Runtime's own exceptions share no public base
            raise WeightsError(f"{file}: is no ONNX model: {error}") from error
        metadata = dict(session.get_modelmeta().custom_metadata_map)
        if metadata.get("encoder") != ENCODER_VERSION:
            raise WeightsError(
                f"{file}: is of encoder version {metadata.get('encoder')!r}, "
                f"but version {ENCODER_VERSION!r} is installed"
            )
        taken = [tensor.name for tensor in session.get_inputs()]
        given = [tensor.name for tensor in session.get_outputs()]
        if set(taken) != set(inputs) or given != list(outputs):
            raise WeightsError(
                f"{file}: takes {', '.join(taken)} and gives {', '.join(given)}, "
                f"but must take {', '.join(inputs)} and give {', '.join(outputs)}: "
                "train it again with 'sgraph train'"
            )
        return session, metadata


def _stored(metadata: Mapping[str, str], key: str, known: Sequence[str], file: Traversable) -> Any:
    """Return what an encoder's file says that it was trained with."""
    value = metadata.get(key)
    if value not in known:
        rule = f"must be one of {', '.join(known)}: train it again with 'sgraph train'"
        raise WeightsError(f"{file}: {key} = {value!r}: {rule}")
    return value


def _check_widths(session: Any, nodes: int, edges: int, file: Traversable) -> None:
    """Check that a model takes as many features of a node and of an edge as it is given."""
    shapes = {tensor.name: tensor.shape for tensor in session.get_inputs()}
    found = shapes["x"][-1], shapes["edge_attr"][-1]
    if found != (nodes, edges):
        raise WeightsError(
            f"{file}: takes {found[0]} features of a node and {found[1]} of an edge, "
            f"but is given {nodes} and {edges}"
        )
