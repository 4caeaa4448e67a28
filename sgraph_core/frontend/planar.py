"""Poses in the plane: x, y in metres and yaw in radians, as arrays [..., 3]."""

from __future__ import annotations

import numpy as np

from sgraph_concepts.types import FloatArray

__all__ = [
    "as_rows",
    "between",
    "chained",
    "composed",
    "from_rows",
    "in_space",
    "placed",
    "rotated",
    "wrapped",
]


def as_rows(poses: FloatArray) -> FloatArray:
    """Return planar poses [K, 3] as x, y, z, qx, qy, qz, qw, [K, 7]."""
    x, y, yaw = poses.T
    zero = np.zeros(len(poses))
    return np.column_stack([x, y, zero, zero, zero, np.sin(yaw / 2), np.cos(yaw / 2)])


def from_rows(rows: FloatArray) -> FloatArray:
    """Return poses x, y, z, qx, qy, qz, qw [K, 7] as planar poses [K, 3]: seen from above."""
    qx, qy, qz, qw = rows[:, 3:].T
    yaw = np.arctan2(2 * (qw * qz + qx * qy), 1 - 2 * (qy**2 + qz**2))
    return np.column_stack([rows[:, :2], yaw])


def in_space(points: FloatArray) -> FloatArray:
    """Return points in the plane [P, 2] as points with z = 0, [P, 3]."""
    return np.column_stack([points, np.zeros(len(points))])


def composed(poses: FloatArray, motions: FloatArray) -> FloatArray:
    """Return poses * motions, [..., 3]."""
    moved = poses[..., :2] + rotated(motions[..., :2], poses[..., 2])
    return np.concatenate([moved, wrapped(poses[..., 2:] + motions[..., 2:])], axis=-1)


def between(one: FloatArray, two: FloatArray) -> FloatArray:
    """Return one^-1 * two, [..., 3]."""
    offset = rotated(two[..., :2] - one[..., :2], -one[..., 2])
    return np.concatenate([offset, wrapped(two[..., 2:] - one[..., 2:])], axis=-1)


def chained(first: FloatArray, motions: FloatArray) -> FloatArray:
    """Return the poses that M motions add up to from a first pose, [M + 1, 3]."""
    poses = [first]
    for motion in motions:
        poses.append(composed(poses[-1], motion))
    return np.array(poses)


def placed(pose: FloatArray, points: FloatArray) -> FloatArray:
    """Return points [..., 2] of a body frame in the world of its pose [3]."""
    return np.asarray(pose[:2] + rotated(points, np.asarray(pose[2])))


def wrapped(angles: FloatArray) -> FloatArray:
    """Return angles from -pi to pi."""
    return np.asarray((angles + np.pi) % (2 * np.pi) - np.pi)


def rotated(vectors: FloatArray, angles: FloatArray) -> FloatArray:
    """Return vectors [..., 2] turned counter-clockwise by angles [...]."""
    cosine, sine = np.cos(angles), np.sin(angles)
    x, y = vectors[..., 0], vectors[..., 1]
    return np.stack([cosine * x - sine * y, sine * x + cosine * y], axis=-1)
