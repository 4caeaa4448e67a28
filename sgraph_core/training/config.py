"""What a training run is made of; stored beside the weights that came out of it."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, Field

from sgraph_core.synth.config import BuildingConfig

__all__ = ["TrainingConfig"]


class TrainingConfig(BaseModel):
    """Everything that decides the outcome of a training run."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    seed: int = Field(default=0, ge=0, description="Of the buildings, the batches and the weights.")
    floors: int = Field(default=3000, ge=1, description="Synthetic floors to train on.")
    validation_floors: int = Field(default=200, ge=1, description="Further floors to validate on.")
    steps: int = Field(default=1500, ge=1, description="Optimiser steps.")
    floors_per_step: int = Field(default=24, ge=1, description="Floors in one batch.")
    learning_rate: float = Field(default=2e-3, gt=0, description="Peak of the one-cycle schedule.")
    weight_decay: float = Field(default=1e-4, ge=0, description="Of AdamW.")
    largest_gradient: float = Field(default=5.0, gt=0, description="Gradients are clipped to it.")
    hidden: int = Field(default=32, ge=1, description="Width of the embeddings.")
    layers: int = Field(default=2, ge=1, description="Layers of the encoder.")
    building: BuildingConfig = Field(
        default=BuildingConfig(), description="The distribution of the buildings."
    )
