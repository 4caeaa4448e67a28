"""What a training run is made of; stored beside the weights that came out of it."""

from __future__ import annotations

import importlib.resources
from importlib.resources.abc import Traversable
from pathlib import Path

from pydantic import BaseModel, ConfigDict, Field

from sgraph_core.features import FeatureSet
from sgraph_core.proximity import Neighbours
from sgraph_core.synth.config import BuildingConfig

__all__ = ["PAPER", "TrainingConfig", "config_file"]

PAPER = "paper"
"""Name of the settings that reproduce the paper's network, neighbours and layouts."""


def config_file(name: str | None) -> Traversable | None:
    """Return the file that holds settings: one of a user's, or ``paper``."""
    if name == PAPER:
        return importlib.resources.files(__package__) / "paper.json"
    return None if name is None else Path(name)


class TrainingConfig(BaseModel):
    """Everything that decides the outcome of a training run."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    seed: int = Field(default=0, ge=0, description="Of the buildings, the batches and the weights.")
    floors: int = Field(default=1500, ge=1, description="Synthetic floors to train on.")
    validation_floors: int = Field(default=100, ge=1, description="Further floors to validate on.")
    steps: int = Field(default=600, ge=1, description="Steps of the one-cycle schedule.")
    stop: int | None = Field(
        default=None,
        ge=1,
        description="Step after which training stops; at the end of the schedule if not given.",
    )
    floors_per_step: int = Field(default=24, ge=1, description="Floors in one batch.")
    learning_rate: float = Field(default=2e-3, gt=0, description="Peak of the one-cycle schedule.")
    weight_decay: float = Field(default=1e-4, ge=0, description="Of AdamW.")
    largest_gradient: float = Field(default=5.0, gt=0, description="Gradients are clipped to it.")
    features: FeatureSet = Field(
        default="support", description="What the network is given of nodes and edges."
    )
    neighbours: Neighbours = Field(
        default="visible", description="The pairs of surfaces that it is given."
    )
    hidden: int = Field(default=48, ge=1, description="Width of the embeddings.")
    layers: int = Field(default=2, ge=1, description="Layers of the encoder.")
    grid_share: float = Field(
        default=0.0,
        ge=0,
        le=1,
        description="Floors that are rendered as a grid, from which their surfaces are extracted.",
    )
    building: BuildingConfig = Field(
        default=BuildingConfig(), description="The distribution of the buildings."
    )

    @property
    def last_step(self) -> int:
        """The step after which training stops."""
        return self.steps if self.stop is None else min(self.stop, self.steps)
