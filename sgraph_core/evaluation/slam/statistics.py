"""Paired comparison of two methods on the same drives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

__all__ = ["Paired", "Spread", "compare", "spread"]

DRAW = 0.02
"""A ratio within 2 % of 1 is neither won nor lost."""


@dataclass(frozen=True)
class Paired:
    """One method against another, drive by drive.

    Attributes:
        pairs: number of drives.
        median_ratio: median of the ratios of the errors, NaN without a drive.
        wins, losses: drives in which the error is smaller, or larger, by more than 2 %.
    """

    pairs: int
    median_ratio: float
    wins: int
    losses: int


@dataclass(frozen=True)
class Spread:
    """Mean and standard deviation (of the sample) over drives; the latter NaN for one drive."""

    mean: float
    deviation: float


def compare(errors: Sequence[float], baseline: Sequence[float]) -> Paired:
    """Compare positive errors with a baseline's in the same drives, in the same order."""
    ratios = np.asarray(errors, np.float64) / np.asarray(baseline, np.float64)
    return Paired(
        len(ratios),
        float(np.median(ratios)) if len(ratios) else float("nan"),
        int((ratios < 1 - DRAW).sum()),
        int((ratios > 1 + DRAW).sum()),
    )


def spread(values: Sequence[float]) -> Spread:
    """Return mean and spread of one value or more."""
    deviation = float(np.std(values, ddof=1)) if len(values) > 1 else float("nan")
    return Spread(float(np.mean(values)), deviation)
