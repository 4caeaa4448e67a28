"""Which surfaces are the same, by a gate on angle, offset and overlap."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sgraph_concepts.types import FloatArray, IntArray
from sgraph_core.frontend.planar import placed, rotated
from sgraph_core.frontend.recording import ObservedSurfaces
from sgraph_core.geometry import cross, dot, turn_left

__all__ = ["GATE", "NONE", "Gate", "Lines", "aligned", "matches", "seen_from_pose"]

NONE = -1
ALIGNMENT_STEPS = 2
"""Of Gauss-Newton: the second one corrects what turning about far points bends."""


@dataclass(frozen=True)
class Gate:
    """How close two surfaces must be to be taken for one.

    The defaults were chosen on simulated scenes and the log belgioioso: wider offsets take fronts
    of furniture for the wall behind, wider gaps make one surface of the walls of two rooms.

    Attributes:
        angle_deg: between their normals.
        offset_m: between them, in the middle of where they overlap.
        gap_m: between their ends, where they do not overlap.
    """

    angle_deg: float = 6.0
    offset_m: float = 0.1
    gap_m: float = 0.1


GATE = Gate()


@dataclass(frozen=True, eq=False)
class Lines:
    """N surfaces in the world: endpoints in any order [N, 2, 2] and normals [N, 2]."""

    segments: FloatArray
    normals: FloatArray

    def __len__(self) -> int:
        return len(self.normals)

    def take(self, rows: NDArray[np.bool_]) -> Lines:
        """Return the rows of a mask."""
        return Lines(self.segments[rows], self.normals[rows])


def seen_from_pose(observed: ObservedSurfaces, pose: FloatArray) -> Lines:
    """Return observed surfaces in the world of a keyframe's pose x, y, yaw."""
    normals = rotated(observed.planes[:, :2], np.full(len(observed), pose[2]))
    return Lines(placed(pose, observed.segments), normals)


def matches(seen: Lines, known: Lines, gate: Gate) -> IntArray:
    """Return for each seen surface the nearest known one within the gate, or NONE, [S]."""
    if not len(seen) or not len(known):
        return np.full(len(seen), NONE)
    middles = known.segments.mean(axis=1)
    tangents = turn_left(known.normals)
    offset = seen.segments[:, None] - middles[:, None]  # [S, N, 2 ends, 2]
    along = dot(offset, tangents[:, None])
    across = dot(offset, known.normals[:, None])
    half = np.linalg.norm(known.segments[:, 1] - known.segments[:, 0], axis=1) / 2
    low = np.maximum(along.min(axis=2), -half)
    high = np.minimum(along.max(axis=2), half)
    share = ((low + high) / 2 - along[..., 0]) / _away_from_zero(along[..., 1] - along[..., 0])
    apart = np.abs(across[..., 0] + np.clip(share, 0, 1) * (across[..., 1] - across[..., 0]))
    angle = np.arccos(np.clip(seen.normals @ known.normals.T, -1, 1))
    within = (angle <= np.radians(gate.angle_deg)) & (apart <= gate.offset_m)
    within &= high - low >= -gate.gap_m
    cost = (angle / np.radians(gate.angle_deg)) ** 2 + (apart / gate.offset_m) ** 2
    cost += np.maximum(low - high, 0) / max(gate.gap_m, 1e-9)
    cost = np.where(within, cost, np.inf)
    best = cost.argmin(axis=1)
    return np.where(np.isfinite(cost[np.arange(len(seen)), best]), best, NONE)


def aligned(
    pose: FloatArray,
    sigmas: FloatArray,
    observed: ObservedSurfaces,
    known: Lines,
    matched: IntArray,
) -> FloatArray:
    """Return a predicted pose corrected by what a keyframe observed again.

    Weighted least squares on the pose x, y, yaw: the prediction with its sigmas, and for each match
    the angle between the normals and the mapped plane's distance from the observed point ``at``.

    Args:
        pose: the prediction, [3].
        sigmas: its standard deviations, [3].
        observed: what the keyframe observed.
        known: the mapped surfaces.
        matched: of each observed surface the row of the mapped one, or NONE, [S].
    """
    found = matched != NONE
    mapped, seen_normals = matched[found], observed.planes[found, :2]
    normals, middles = known.normals[mapped], known.segments[mapped].mean(axis=1)
    angle_sigmas, offset_sigmas = observed.sigmas[found].T
    estimate = pose
    for _ in range(ALIGNMENT_STEPS):
        seen = rotated(seen_normals, np.full(len(mapped), estimate[2]))
        turn = np.arctan2(cross(seen, normals), dot(seen, normals))
        at = placed(estimate, observed.at[found])
        offset = -dot(normals, at - middles)
        arms = cross(at - estimate[:2], normals)
        rows = np.concatenate(
            [
                np.diag(1 / sigmas),
                np.column_stack([np.zeros((len(turn), 2)), 1 / angle_sigmas]),
                np.column_stack([normals, arms]) / offset_sigmas[:, None],
            ]
        )
        left = (pose - estimate) / sigmas, turn / angle_sigmas, offset / offset_sigmas
        estimate = estimate + np.linalg.lstsq(rows, np.concatenate(left), rcond=None)[0]
    return np.asarray(estimate)


def _away_from_zero(values: FloatArray) -> FloatArray:
    return np.where(np.abs(values) < 1e-9, 1e-9, values)
