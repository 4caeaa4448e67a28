"""What a map's own measurements say about how well its surfaces are known to one another.

The low layers, linearised at the map as it is and seen from above: a keyframe is (x, y, yaw), a
plane (heading of its normal, offset along it at the middle q of its segment). One sparse
factorisation then answers for any pair of planes how sure their difference is.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Protocol

import numpy as np
import scipy.sparse
from scipy.sparse.linalg import splu

from sgraph_concepts.types import FloatArray, IntArray
from sgraph_core.backend.low_layers import PRIOR_SIGMA
from sgraph_core.graph import SGraph

__all__ = ["Uncertainty"]

class Tied(Protocol):
    """Two planes that are held together, or antiparallel at a distance.

    Attributes:
        pair: ids of the surfaces.
        point: where their distance holds.
        sigmas: of angle and offset, rad and m.
    """

    @property
    def pair(self) -> tuple[int, int]: ...
    @property
    def point(self) -> tuple[float, float]: ...
    @property
    def sigmas(self) -> tuple[float, float]: ...


COLUMNS_AT_ONCE = 256
Entry = tuple[IntArray, IntArray, FloatArray]
"""Rows, columns and values of a sparse matrix."""


class Uncertainty:
    """Covariances of the differences between the planes of a map.

    Args:
        graph: an S-Graph whose low layers are solved; odometry must connect its keyframes.
        tied: pairs of planes that the map has been solved with.
    """

    def __init__(
        self,
        graph: SGraph,
        tied: Sequence[Tied] = (),
    ) -> None:
        table = graph.wall_surfaces
        self.surfaces = np.unique(graph.observations.surface_ids)
        rows = np.array([graph.surface_row(i) for i in self.surfaces.tolist()], np.int64)
        self._middles = table.segments[rows].mean(axis=1)
        self._normals = table.normals[rows]
        self._first_plane = 3 * len(graph.keyframes.ids)
        self._size = self._first_plane + 2 * len(rows)
        jacobian = scipy.sparse.vstack([self._jacobian(graph), self._ties(tied)])
        self._solver = splu(
            (jacobian.T @ jacobian).tocsc(),
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )

    def differences(self, pairs: IntArray, points: FloatArray) -> scipy.sparse.csr_matrix:
        """Return the Jacobian of how pairs of planes differ, two rows a pair, [2P, variables].

        Args:
            pairs: ids of observed surfaces, [P, 2].
            points: where the offsets are compared, [P, 2].
        """
        first, second = np.searchsorted(self.surfaces, pairs).T
        entries = [*self._difference(first, points, 1.0), *self._difference(second, points, -1.0)]
        return _matrix(entries, (2 * len(pairs), self._size))

    def _difference(self, planes: IntArray, points: FloatArray, sign: float) -> Iterator[Entry]:
        count = np.arange(len(planes))
        heading = self._first_plane + 2 * planes
        turned = _left(self._normals[planes])
        lever = (turned * (points - self._middles[planes])).sum(axis=1)
        one = np.full(len(planes), sign)
        yield 2 * count, heading, one
        yield 2 * count + 1, heading, sign * lever
        yield 2 * count + 1, heading + 1, one

    def covariance(self, jacobian: scipy.sparse.csr_matrix) -> FloatArray:
        """Return the covariance of quantities with the given Jacobian [M, variables], [M, M]."""
        parts = [
            jacobian @ self._solver.solve(jacobian[k : k + COLUMNS_AT_ONCE].toarray().T)
            for k in range(0, jacobian.shape[0], COLUMNS_AT_ONCE)
        ]
        return np.asarray(np.hstack(parts)) if parts else np.empty((0, 0))

    def _ties(self, tied: Sequence[Tied]) -> scipy.sparse.csr_matrix:
        pairs = np.array([tie.pair for tie in tied], np.int64).reshape(-1, 2)
        points = np.array([tie.point for tie in tied]).reshape(-1, 2)
        weights = 1 / np.array([tie.sigmas for tie in tied]).reshape(-1)
        return scipy.sparse.diags(weights) @ self.differences(pairs, points)

    def _jacobian(self, graph: SGraph) -> scipy.sparse.csr_matrix:
        keyframes, yaws = graph.keyframes, _yaws(graph.keyframes.poses)
        entries: list[Entry] = []
        hold = np.arange(3)
        entries.append((hold, hold, np.full(3, 1 / PRIOR_SIGMA)))
        first = 3
        for new, rows in (
            _odometry(graph, keyframes.poses[:, :2], yaws),
            self._observations(graph, keyframes.poses[:, :2]),
        ):
            entries += [(row + first, column, value) for row, column, value in new]
            first += rows
        return _matrix(entries, (first, self._size))

    def _observations(self, graph: SGraph, positions: FloatArray) -> tuple[list[Entry], int]:
        table = graph.observations
        count = np.arange(len(table.planes))
        keyframes = np.array([graph.keyframe_row(i) for i in table.keyframe_ids.tolist()], np.int64)
        planes = np.searchsorted(self.surfaces, table.surface_ids)
        normals, heading = self._normals[planes], self._first_plane + 2 * planes
        lever = (_left(normals) * (positions[keyframes] - self._middles[planes])).sum(axis=1)
        angle, offset = 1 / table.sigmas.T
        entries = [
            (2 * count, 3 * keyframes + 2, -angle),
            (2 * count, heading, angle),
            (2 * count + 1, 3 * keyframes, normals[:, 0] * offset),
            (2 * count + 1, 3 * keyframes + 1, normals[:, 1] * offset),
            (2 * count + 1, heading, lever * offset),
            (2 * count + 1, heading + 1, offset),
        ]
        return entries, 2 * len(count)


def _odometry(graph: SGraph, positions: FloatArray, yaws: FloatArray) -> tuple[list[Entry], int]:
    table = graph.odometry
    count = np.arange(len(table.poses))
    one = np.array([graph.keyframe_row(i) for i in table.from_ids.tolist()], np.int64)
    two = np.array([graph.keyframe_row(i) for i in table.to_ids.tolist()], np.int64)
    weights = 1 / table.sigmas[:, [3, 4, 2]]
    motion = positions[two] - positions[one]
    cosine, sine = np.cos(yaws[two]), np.sin(yaws[two])
    axes = np.stack([np.stack([cosine, sine], 1), np.stack([-sine, cosine], 1)], 1)
    entries = []
    for k in range(2):  # along the axes of the keyframe that is reached
        axis = axes[:, k] * weights[:, k, None]
        row = 3 * count + k
        swept = -(axis * _left(motion)).sum(axis=1)
        for column, value in ((0, axis[:, 0]), (1, axis[:, 1])):
            entries += [(row, 3 * two + column, value), (row, 3 * one + column, -value)]
        entries.append((row, 3 * one + 2, swept))
    row = 3 * count + 2
    entries += [(row, 3 * two + 2, weights[:, 2]), (row, 3 * one + 2, -weights[:, 2])]
    return entries, 3 * len(count)


def _matrix(entries: list[Entry], shape: tuple[int, int]) -> scipy.sparse.csr_matrix:
    rows, columns, values = (np.concatenate(part) for part in zip(*entries, strict=True))
    return scipy.sparse.csr_matrix((values, (rows, columns)), shape=shape)


def _left(vectors: FloatArray) -> FloatArray:
    return np.stack([-vectors[:, 1], vectors[:, 0]], axis=1)


def _yaws(poses: FloatArray) -> FloatArray:
    x, y, z, w = poses[:, 3:].T
    return np.asarray(np.arctan2(2 * (w * z + x * y), w**2 + x**2 - y**2 - z**2))
