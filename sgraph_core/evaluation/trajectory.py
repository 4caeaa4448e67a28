"""Absolute trajectory error."""

from __future__ import annotations

import warnings
from pathlib import Path

import gtsam
import numpy as np

from sgraph_concepts.errors import InputError
from sgraph_concepts.types import FloatArray
from sgraph_core.graph import SGraph

__all__ = ["ate_rmse", "read_tum", "trajectory_error"]

SAME_STAMP_S = 0.01
FEWEST_POSES = 3


def ate_rmse(positions: FloatArray, reference: FloatArray) -> float:
    """Return the RMSE of positions [K, 3] after rigid alignment with a reference [K, 3], in metres.

    evo's definition of the absolute trajectory error: translation part, aligned by rotation and
    translation (Umeyama without scale).

    Raises:
        InputError: there are fewer than three positions.
    """
    if len(positions) < FEWEST_POSES or positions.shape != reference.shape:
        raise InputError(
            f"trajectories of {len(positions)} and {len(reference)} positions: "
            f"need as many of both, and {FEWEST_POSES} or more"
        )
    alignment = gtsam.Pose3.Align(reference.T, positions.T)
    if alignment is None:
        raise InputError("the trajectories cannot be aligned")
    aligned = alignment.transformFrom(np.asfortranarray(positions.T)).T
    return float(np.sqrt(((aligned - reference) ** 2).sum(axis=1).mean()))


def read_tum(path: str | Path) -> tuple[FloatArray, FloatArray]:
    """Return stamps [K] and positions [K, 3] of a trajectory file in TUM format.

    Each line holds ``stamp x y z qx qy qz qw``; lines that begin with # are comments.

    Raises:
        InputError: the file cannot be read or holds something else.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # an empty file is named below
            rows = np.loadtxt(path, ndmin=2)
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: is no trajectory in TUM format: {error}") from error
    if rows.shape[1] != 8 or not np.isfinite(rows).all():
        raise InputError(f"{path}: each line must hold 8 finite numbers: stamp x y z qx qy qz qw")
    return rows[:, 0], rows[:, 1:4]


def trajectory_error(graph: SGraph, stamps: FloatArray, positions: FloatArray) -> float:
    """Return the ATE RMSE of an S-Graph's keyframes against a reference trajectory, in metres.

    Keyframes are matched with the reference poses of the same stamp (within 10 ms).

    Raises:
        InputError: fewer than three keyframes have a counterpart.
    """
    table = graph.keyframes
    gaps = np.abs(table.stamps[:, None] - stamps[None, :])
    matched = [
        (row, int(np.nanargmin(gap)))
        for row, gap in enumerate(gaps)
        if np.nanmin(gap, initial=np.inf) <= SAME_STAMP_S
    ]
    rows = np.array(matched, np.int64).reshape(-1, 2)
    return ate_rmse(table.poses[rows[:, 0], :3], positions[rows[:, 1]])
