"""Inference with the exported network; needs ONNX Runtime, not torch."""

from __future__ import annotations

import importlib.resources
from importlib.resources.abc import Traversable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sgraph_concepts.errors import WeightsError
from sgraph_concepts.registry import RegisteredConcept
from sgraph_concepts.types import Scene, ScoredEdges
from sgraph_core.features import edge_features, edge_index, node_features
from sgraph_core.network import ENCODER_VERSION

__all__ = ["Network"]


class Network:
    """The shared encoder and the heads that have been asked for, each loaded once.

    Safe to use from several threads: ONNX Runtime's sessions are, and nothing else is kept.

    Args:
        encoder: the encoder's ONNX file; the shipped one by default.
        threads: threads that ONNX Runtime may use for one scene.

    Raises:
        WeightsError: the file is absent, damaged or of another version.
    """

    def __init__(self, encoder: Traversable | None = None, threads: int = 1) -> None:
        self._threads = threads
        file = encoder or importlib.resources.files("sgraph_core") / "weights" / "encoder.onnx"
        self._encoder, metadata = self._open(file)
        self._fingerprint = metadata.get("encoder_fingerprint", "")
        self._heads: dict[str, Any] = {}

    def encode(self, scene: Scene) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return node embeddings [N, H] and edge embeddings [2E, H] of a scene with pairs."""
        nodes, edges = self._encoder.run(
            None,
            {
                "x": node_features(scene),
                "edge_index": edge_index(scene),
                "edge_attr": edge_features(scene),
            },
        )
        return nodes, edges

    def score(
        self,
        concept: RegisteredConcept,
        scene: Scene,
        embeddings: tuple[NDArray[np.float32], NDArray[np.float32]],
    ) -> ScoredEdges:
        """Return the relation of one concept, from what :meth:`encode` returned for the scene.

        Raises:
            WeightsError: the head's file is absent, damaged, or was trained on another encoder.
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
        file = concept.weights_file()
        session, metadata = self._open(file)
        if metadata.get("encoder_fingerprint") != self._fingerprint:
            raise WeightsError(
                f"{file.name} of concept {concept.spec.name!r} was trained on other encoder "
                f"weights than the installed ones: train it again with "
                f"'sgraph train --concept {concept.spec.name}'"
            )
        return session

    def _open(self, file: Traversable) -> tuple[Any, dict[str, str]]:
        import onnxruntime

        try:
            model = file.read_bytes()
        except OSError as error:
            raise WeightsError(f"{file}: cannot be read: {error.strerror}") from error
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = self._threads
        options.inter_op_num_threads = 1
        options.log_severity_level = 3
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
        return session, metadata
