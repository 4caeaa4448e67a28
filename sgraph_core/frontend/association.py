"""Which surfaces are the same, by a gate on angle, offset and overlap."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sgraph_concepts.types import FloatArray, IntArray
from sgraph_core.frontend.planar import placed, rotated
from sgraph_core.frontend.recording import ObservedSurfaces
from sgraph_core.geometry import dot
from sgraph_core.synth.polygons import turn_left

__all__ = ["GATE", "NONE", "Gate", "Lines", "matches", "seen_from_pose"]

NONE = -1


@dataclass(frozen=True)
class Gate:
    """How close two surfaces must be to be taken for one.

    Attributes:
        angle_deg: between their normals.
        offset_m: between them, in the middle of where they overlap.
        gap_m: between their ends, where they do not overlap: less than a doorway.
    """

    angle_deg: float = 10.0
    offset_m: float = 0.3
    gap_m: float = 0.3


GATE = Gate()


@dataclass(frozen=True, eq=False)
class Lines:
    """N surfaces in the world: endpoints in any order [N, 2, 2] and normals [N, 2]."""

    segments: FloatArray
    normals: FloatArray

    def __len__(self) -> int:
        return len(self.normals)


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


def _away_from_zero(values: FloatArray) -> FloatArray:
    return np.where(np.abs(values) < 1e-9, 1e-9, values)
