"""How far a drive may have drifted between two keyframes, by the noise of what it measured.

Odometry and planes tell how well each motion is known. What the front end recognised on a later
visit is not believed here, since it may have taken a wrong wall: each visit to a surface sees a
plane of its own. What remains is a chain of motions, linearised once, in the plane.

The error of a keyframe is a small motion (angle a, shift s) of all that it sees about a common
origin: a point p goes to p + s + a J p, with J the quarter turn. Odometry from i to j measures the
difference of the errors of j and i at the position of j. A plane with normal n errs by its turn a
and its shift b along n, and an observation of it by keyframe k, the distance being that of a point
p, measures

    a - a_k    and    (b + a n.Jp) - (n.s_k + a_k n.Jp).
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array, csc_array, diags_array, eye_array
from scipy.sparse.linalg import splu

from sgraph_concepts.errors import OptimizationError
from sgraph_concepts.types import FloatArray, IntArray
from sgraph_core.backend.failing import failing_as
from sgraph_core.backend.visits import AWAY
from sgraph_core.geometry import cross
from sgraph_core.graph import SGraph
from sgraph_core.tables import turned

__all__ = ["Drift"]

UNTOLD = "how far the drive has drifted cannot be told"
UNKNOWN = 1e5
"""Standard deviation, in rad and m, of what nothing measures."""


class Drift:
    """How well an S-Graph's measurements fix its keyframes relative to each other.

    Args:
        graph: an S-Graph whose low layers are solved.

    Raises:
        OptimizationError: sigmas differ by so much that the smallest drown all others.
    """

    def __init__(self, graph: SGraph) -> None:
        self._origin = graph.keyframes.poses[:, :2].mean(axis=0)
        columns, factors = (
            np.concatenate(parts)
            for parts in zip(self._motions(graph), self._sightings(graph), strict=True)
        )
        rows = np.broadcast_to(np.arange(len(columns))[:, None], columns.shape)
        poses = 3 * len(graph.keyframes.ids)
        shape = len(columns), max(poses, int(columns.max()) + 1)
        entries = factors.ravel(), (rows.ravel(), columns.ravel())
        measured = coo_array(entries, shape).tocsc()
        information = (measured.T @ measured + eye_array(shape[1]) / UNKNOWN**2).tocsc()
        with failing_as(UNTOLD), np.errstate(divide="raise", over="raise", invalid="raise"):
            self._information = splu(_without_planes(information, poses))

    def between(self, one: int, two: int, point: FloatArray) -> FloatArray:
        """Return the covariance of how two keyframes' views differ from one rigid map, [3, 3].

        Args:
            one: row of a keyframe.
            two: row of another.
            point: about which angle, x and y of the difference are taken, in the world, [2].

        Raises:
            OptimizationError: sigmas differ by too much; likewise.
        """
        x, y = (point - self._origin).tolist()
        at_point = np.array([[1.0, 0.0, 0.0], [-y, 1.0, 0.0], [x, 0.0, 1.0]])
        difference = np.zeros((self._information.shape[0], 3))
        difference[3 * one : 3 * one + 3] -= at_point.T
        difference[3 * two : 3 * two + 3] += at_point.T
        covariance = np.asarray(difference.T @ self._information.solve(difference))
        if not np.isfinite(covariance).all():
            raise OptimizationError(f"{UNTOLD}: its covariance is not finite")
        return covariance

    def _motions(self, graph: SGraph) -> tuple[IntArray, FloatArray]:
        """Return the equations of odometry: variables [E, 6] and their whitened factors."""
        from scipy.spatial.transform import Rotation

        table, poses = graph.odometry, graph.keyframes.poses
        one, two = (_rows(graph, ids) for ids in (table.from_ids, table.to_ids))
        at = poses[two, :2] - self._origin
        axes = Rotation.from_quat(poses[two, 3:]).as_matrix()[:, :2, :2]
        change = np.zeros((len(two), 3, 3))
        change[:, 0, 0] = 1
        for axis in range(2):  # of the body: its turn about the origin, its shift
            change[:, 1 + axis, 0] = cross(at, axes[:, :, axis])
            change[:, 1 + axis, 1:] = axes[:, :, axis]
        change /= table.sigmas[:, [2, 3, 4], None]
        columns = np.concatenate(
            [3 * one[:, None] + np.arange(3), 3 * two[:, None] + np.arange(3)], axis=1
        )
        return np.repeat(columns, 3, axis=0), np.concatenate([-change, change], axis=2).reshape(
            -1, 6
        )

    def _sightings(self, graph: SGraph) -> tuple[IntArray, FloatArray]:
        """Return the equations of observed planes, each visit's its own; likewise."""
        table = graph.observations
        by, of = _rows(graph, table.keyframe_ids), table.surface_ids
        order = np.lexsort((by, of))
        by, of, sigmas = by[order], of[order], table.sigmas[order]
        poses = graph.keyframes.poses[by]
        points = (poses[:, :3] + turned(table.at[order], poses[:, 3:]))[:, :2]
        again = (np.diff(of) == 0) & (np.diff(by) <= AWAY)
        visits = np.cumsum(np.append(True, ~again)[: len(of)]) - 1
        normals = graph.wall_surfaces.normals[[graph.surface_row(i) for i in of.tolist()]]
        arms = cross(points - self._origin, normals)
        planes = 3 * len(graph.keyframes.ids) + 2 * visits
        columns = np.stack([3 * by, 3 * by + 1, 3 * by + 2, planes, planes + 1], axis=1)
        angle, offset = np.zeros((2, len(by), 5))
        angle[:, 0], angle[:, 3] = -1, 1
        offset[:, 0], offset[:, 1:3], offset[:, 3], offset[:, 4] = -arms, -normals, arms, 1
        factors = np.concatenate([angle / sigmas[:, :1], offset / sigmas[:, 1:]])
        padding = np.zeros((len(factors), 1))
        return np.pad(np.tile(columns, (2, 1)), ((0, 0), (0, 1)), mode="edge"), np.hstack(
            [factors, padding]
        )


def _without_planes(information: csc_array, poses: int) -> csc_array:
    """Return what an information matrix says of poses alone: its Schur complement.

    Args:
        information: of variables of poses, then two of each plane; no factor joins two planes.
        poses: how many variables the poses have.
    """
    links, planes = information[:poses, poses:], information[poses:, poses:]
    if not planes.shape[0]:
        return information
    one, two, both = planes.diagonal()[::2], planes.diagonal()[1::2], planes.diagonal(1)[::2]
    determinants = one * two - both**2  # of the blocks [[one, both], [both, two]]
    own = np.stack([two, one], axis=1).ravel() / determinants.repeat(2)
    beside = np.stack([-both / determinants, np.zeros(len(both))], axis=1).ravel()[:-1]
    covariance = diags_array([own, beside, beside], offsets=[0, 1, -1])
    return (information[:poses, :poses] - links @ covariance @ links.T).tocsc()


def _rows(graph: SGraph, keyframes: IntArray) -> IntArray:
    return np.array([graph.keyframe_row(i) for i in keyframes.tolist()], np.int64)
