"""The training loop: encoder and heads together, or one head on the frozen encoder."""

from __future__ import annotations

import importlib.metadata
import importlib.resources
import io
import json
import platform
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from pickle import UnpicklingError
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn.functional import binary_cross_entropy_with_logits

from sgraph_concepts.errors import ConceptError, MissingExtraError, TrainingError, WeightsError
from sgraph_concepts.registry import Registry
from sgraph_concepts.spec import WALL_SURFACE
from sgraph_core.files import write_whole
from sgraph_core.network import ENCODER_VERSION
from sgraph_core.network.export import export_encoder, export_head, fingerprint
from sgraph_core.network.model import Encoder, Head, initialise, symmetric
from sgraph_core.training.config import TrainingConfig
from sgraph_core.training.samples import Progress, Sample, make_samples

__all__ = ["train"]

STEPS_PER_CHECKPOINT = 100
CHECKPOINT = "checkpoint.pt"
RECORD = "training.json"


def train(
    config: TrainingConfig,
    folder: Path,
    registry: Registry,
    *,
    concept: str | None = None,
    resume: bool = False,
    progress: Progress = lambda _what, _done, _total: None,
) -> dict[str, Any]:
    """Train on synthetic buildings and write the weights.

    ``folder`` then holds ``encoder.onnx``, ``encoder.safetensors``, a head per concept and
    ``training.json``, the record of how they came about. Until then it holds a checkpoint, from
    which an interrupted run goes on and ends with the same weights. A run that has stopped goes on
    to a later stop in the same way.

    Args:
        config: the run.
        folder: where to write; it is made if need be.
        registry: the concepts; those that group wall surfaces and have head and labeller are
            trained.
        concept: train the head of this concept only, on the shipped encoder.
        resume: go on from the folder's checkpoint, rather than refuse to touch it.
        progress: told how far the run is.

    Returns:
        The record.

    Raises:
        TrainingError: the folder holds another run, or the loss is no number any more.
        ConceptError: the concept cannot be trained.
        MissingExtraError: the extra ``train`` is not installed.
    """
    _require_extra()
    names = _trainable(registry, concept)
    encoder = None if concept is None else _shipped_encoder(config)
    _claim(folder, config, names, resume)
    samples = _make_all(config, names, folder, progress)
    with _repeatable(config.seed):
        run = _Run.new(config, names, registry, encoder, samples.training)
        if resume:
            run.load(folder / CHECKPOINT)
        for step in range(run.step, config.last_step):
            run.learn(_batch(samples.training, config, step))
            if run.step % STEPS_PER_CHECKPOINT == 0 or run.step == config.last_step:
                run.validate(samples.validation)
                run.save(folder / CHECKPOINT)
            progress("training", run.step, config.last_step)
    record = _record(config, names, run, concept)
    _write(folder, run, record, names)
    return record


@contextmanager
def _repeatable(seed: int) -> Iterator[None]:
    """Let torch compute the same again, however many cores there are: sums depend on threads."""
    before, threads = torch.are_deterministic_algorithms_enabled(), torch.get_num_threads()
    torch.manual_seed(seed)
    torch.use_deterministic_algorithms(True)
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.use_deterministic_algorithms(before)
        torch.set_num_threads(threads)


def _require_extra() -> None:
    try:
        import onnx  # noqa: F401
        import onnxscript  # noqa: F401
        import safetensors  # noqa: F401
    except ImportError as error:
        raise MissingExtraError(str(error.name), "train") from error


def _trainable(registry: Registry, concept: str | None) -> list[str]:
    names = [
        c.spec.name
        for c in registry
        if c.spec.head and c.spec.labeller and c.spec.groups == WALL_SURFACE
    ]
    if concept is None:
        return names
    if concept not in names:
        registry[concept]  # raises if there is none
        raise ConceptError(
            f"concept {concept!r} cannot be trained: it needs a head, a labeller, "
            f"and to group {WALL_SURFACE}"
        )
    return [concept]


def _claim(folder: Path, config: TrainingConfig, names: Sequence[str], resume: bool) -> None:
    """Make sure that a folder's files are those of this run, wherever it is to stop."""
    settings = config.model_dump(mode="json", exclude={"stop"})
    run = {"encoder": ENCODER_VERSION, "concepts": list(names), "config": settings}
    claim, wanted = folder / "run.json", json.dumps(run, indent=1)
    if claim.exists():
        if not resume:
            raise TrainingError(
                f"{folder} already holds a training run: resume it, or choose another folder"
            )
        if claim.read_text() != wanted:
            raise TrainingError(
                f"{folder} holds a run of another configuration, or of other features: "
                f"{claim} says which"
            )
    elif resume:
        raise TrainingError(f"{folder} holds no training run to resume")
    folder.mkdir(parents=True, exist_ok=True)
    write_whole(claim, lambda temporary: temporary.write_text(wanted))


@dataclass(frozen=True)
class _Samples:
    training: list[Sample]
    validation: list[Sample]


def _make_all(
    config: TrainingConfig, names: Sequence[str], folder: Path, progress: Progress
) -> _Samples:
    total = config.floors + config.validation_floors
    floors = folder / "floors"
    floors.mkdir(exist_ok=True)
    samples = make_samples(config, range(total), names, floors, progress)
    return _Samples(samples[: config.floors], samples[config.floors :])


@dataclass(frozen=True)
class _Batch:
    """Several floors as one graph: x, edge_index, edge_attr, and the labels of the pairs."""

    x: Tensor
    edge_index: Tensor
    edge_attr: Tensor
    labels: Mapping[str, Tensor]


def _collate(samples: Sequence[Sample]) -> _Batch:
    """Join floors. Edges of all floors come first in one direction, then in the other."""
    sizes = np.cumsum([0, *(len(sample.x) for sample in samples)])
    edges = [s.edge_index + start for s, start in zip(samples, sizes, strict=False)]
    index = np.concatenate(
        [half for side in (0, 1) for half in (np.split(e, 2, axis=1)[side] for e in edges)], axis=1
    )
    attributes = np.concatenate(
        [np.split(sample.edge_attr, 2)[side] for side in (0, 1) for sample in samples]
    )
    labels = {
        name: torch.from_numpy(np.concatenate([s.labels[name] for s in samples])).float()
        for name in samples[0].labels
    }
    return _Batch(
        torch.from_numpy(np.concatenate([sample.x for sample in samples])),
        torch.from_numpy(index),
        torch.from_numpy(attributes),
        labels,
    )


def _batch(samples: Sequence[Sample], config: TrainingConfig, step: int) -> _Batch:
    """Return the batch of a step: the floors in a new random order every epoch."""
    per_epoch = max(1, len(samples) // config.floors_per_step)
    epoch, place = divmod(step, per_epoch)
    order = np.random.default_rng([config.seed, epoch]).permutation(len(samples))
    chosen = order[place * config.floors_per_step : (place + 1) * config.floors_per_step]
    return _collate([samples[k] for k in chosen])


class _Run:
    """The state of a training run."""

    def __init__(
        self,
        config: TrainingConfig,
        encoder: Encoder,
        heads: Mapping[str, Head],
        frozen: bool,
    ) -> None:
        self.config, self.encoder, self.heads = config, encoder, nn.ModuleDict(heads)
        self.frozen, self.step = frozen, 0
        self.history: list[dict[str, float]] = []
        self._losses: list[float] = []
        parameters = list(self.heads.parameters())
        if not frozen:
            parameters += list(encoder.parameters())
        self._parameters = parameters
        self._optimizer = torch.optim.AdamW(
            parameters, lr=config.learning_rate, weight_decay=config.weight_decay
        )
        self._schedule = torch.optim.lr_scheduler.OneCycleLR(
            self._optimizer, config.learning_rate, total_steps=config.steps + 1, pct_start=0.05
        )

    @classmethod
    def new(
        cls,
        config: TrainingConfig,
        names: Sequence[str],
        registry: Registry,
        frozen: Encoder | None,
        samples: Sequence[Sample],
    ) -> _Run:
        encoder = frozen or Encoder(config.hidden, config.layers, config.features)
        if frozen is None:
            initialise(encoder)
            _set_normalisation(encoder, samples)
        heads = {}
        for name in names:
            spec = registry[name].spec.head
            assert spec is not None  # _trainable saw to it
            heads[name] = Head(encoder.hidden, spec.hidden)
            initialise(heads[name])
        return cls(config, encoder, heads, frozen is not None)

    def learn(self, batch: _Batch) -> None:
        """Take one step.

        Raises:
            TrainingError: the loss is no number any more; the last checkpoint is still good.
        """
        loss = torch.stack(list(self._concept_losses(batch).values())).sum()
        if not torch.isfinite(loss):
            raise TrainingError(
                f"the loss is {loss.item()} at step {self.step}: the last checkpoint is kept, "
                "try a lower learning rate"
            )
        self._optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        nn.utils.clip_grad_norm_(self._parameters, self.config.largest_gradient)
        self._optimizer.step()
        self._schedule.step()
        self._losses.append(loss.item())
        self.step += 1

    def _concept_losses(self, batch: _Batch) -> dict[str, Tensor]:
        with torch.set_grad_enabled(torch.is_grad_enabled() and not self.frozen):
            x, edge_attr = self.encoder(batch.x, batch.edge_index, batch.edge_attr)
        return {
            name: binary_cross_entropy_with_logits(
                symmetric(head(x, batch.edge_index, edge_attr)), batch.labels[name]
            )
            for name, head in self.heads.items()
        }

    @torch.no_grad()
    def validate(self, samples: Sequence[Sample]) -> None:
        """Append the mean losses since the last time, and those of the validation floors."""
        parts = [
            self._concept_losses(_collate(samples[k : k + self.config.floors_per_step]))
            for k in range(0, len(samples), self.config.floors_per_step)
        ]
        entry = {"step": float(self.step), "training": float(np.mean(self._losses))}
        for name in self.heads:
            entry[f"validation {name}"] = float(np.mean([part[name].item() for part in parts]))
        self._losses = []
        self.history.append(entry)

    def save(self, path: Path) -> None:
        """Write a checkpoint."""
        state = {
            "step": self.step,
            "encoder": self.encoder.state_dict(),
            "heads": self.heads.state_dict(),
            "optimizer": self._optimizer.state_dict(),
            "schedule": self._schedule.state_dict(),
            "history": self.history,
        }
        content = io.BytesIO()  # torch's own writer does not say that a disk is full
        torch.save(state, content)
        write_whole(path, lambda temporary: temporary.write_bytes(content.getvalue()))

    def load(self, path: Path) -> None:
        """Go on from a checkpoint, if there is one yet.

        Raises:
            TrainingError: it cannot be read or belongs to another model.
        """
        if not path.exists():
            return
        try:
            state = torch.load(path, weights_only=True)
            self.encoder.load_state_dict(state["encoder"])
            self.heads.load_state_dict(state["heads"])
            self._optimizer.load_state_dict(state["optimizer"])
            self._schedule.load_state_dict(state["schedule"])
            self.step, self.history = state["step"], state["history"]
        except (OSError, KeyError, RuntimeError, ValueError, UnpicklingError) as error:
            raise TrainingError(f"{path}: is no checkpoint of this run: {error}") from error
        if self.step > self.config.last_step:
            raise TrainingError(
                f"{path}: is at step {self.step}, which is after the last, {self.config.last_step}"
            )


def _set_normalisation(encoder: Encoder, samples: Sequence[Sample]) -> None:
    """Store the features' means and standard deviations with the encoder."""
    few = samples[:300]
    for name, rows in (
        ("node", np.concatenate([s.x for s in few])),
        ("edge", np.concatenate([s.edge_attr for s in few])),
    ):
        getattr(encoder, f"{name}_mean").copy_(torch.from_numpy(rows.mean(axis=0)))
        scale = np.maximum(rows.std(axis=0), 1e-6)
        getattr(encoder, f"{name}_scale").copy_(torch.from_numpy(scale))


def _shipped_encoder(run: TrainingConfig) -> Encoder:
    from safetensors.torch import load

    folder = importlib.resources.files("sgraph_core") / "weights"
    try:
        made_with = json.loads((folder / RECORD).read_text())["config"]
        state = load((folder / "encoder.safetensors").read_bytes())
    except OSError as error:
        raise WeightsError(f"the shipped encoder cannot be read: {error}") from error
    for name in ("features", "neighbours"):
        wanted, given = made_with[name], getattr(run, name)
        if wanted != given:
            raise TrainingError(
                f"{name} = {given!r}: must be {wanted!r}, as for the shipped encoder"
            )
    encoder = Encoder(made_with["hidden"], made_with["layers"], made_with["features"])
    encoder.load_state_dict(state)
    return encoder.eval()


def _record(
    config: TrainingConfig, names: Sequence[str], run: _Run, concept: str | None
) -> dict[str, Any]:
    return {
        "concepts": list(names),
        "encoder": ENCODER_VERSION,
        "encoder_fingerprint": fingerprint(run.encoder),
        "encoder_frozen": concept is not None,
        "config": config.model_dump(mode="json"),
        "history": run.history,
        "parameters": sum(p.numel() for p in (*run.encoder.parameters(), *run.heads.parameters())),
        "finished": datetime.now(UTC).isoformat(timespec="seconds"),
        "python": platform.python_version(),
        "machine": platform.machine(),
        "versions": dict(_versions("sgraph-concepts", "torch", "torch-geometric", "numpy")),
    }


def _versions(*distributions: str) -> Iterator[tuple[str, str]]:
    for name in distributions:
        yield name, importlib.metadata.version(name)


def _write(folder: Path, run: _Run, record: Mapping[str, Any], names: Sequence[str]) -> None:
    from safetensors.torch import save

    if not run.frozen:
        export_encoder(
            run.encoder, folder / "encoder.onnx", run.config.features, run.config.neighbours
        )
        tensors = save(run.encoder.state_dict())
        write_whole(
            folder / "encoder.safetensors", lambda temporary: temporary.write_bytes(tensors)
        )
    for name in names:
        head = run.heads[name]
        assert isinstance(head, Head)
        export_head(head, run.encoder, folder / f"{name}.onnx")
    text = json.dumps(record, indent=1) + "\n"
    write_whole(folder / RECORD, lambda temporary: temporary.write_text(text))
