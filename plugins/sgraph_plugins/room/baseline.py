"""Same room without learning: surfaces that see much of each other."""

from __future__ import annotations

import numpy as np

from sgraph_concepts.types import FloatArray, Scene

__all__ = ["score"]

SEEN = 0.6
"""Share of free lines of sight at which two surfaces are as likely as not of one room."""
STEEPNESS = 4.0
BLIND_LOGIT = -0.7
"""Log-odds of two surfaces that are close and do not see each other at all: corners of one room,
or the two sides of a wall."""
DOORS_CLOSED = 1
"""Column of the visibility in which gaps of a door's width count as closed."""


def score(scene: Scene) -> FloatArray:
    """Return the log-odds of the pairs, [E]: the visibility, compared with a threshold."""
    seen = scene.visibility[:, DOORS_CLOSED]
    logits = STEEPNESS * (np.sqrt(seen) - np.sqrt(SEEN))
    return np.where(seen > 0, logits, BLIND_LOGIT)
