"""How far trajectory and map are from the truth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely

from sgraph_concepts.errors import InputError, MissingExtraError
from sgraph_concepts.types import FloatArray, SurfaceArrays
from sgraph_core.geometry import dot, lines_of, points_of
from sgraph_core.graph import SGraph

__all__ = ["Alignment", "align", "map_rmse", "require_evo"]

FEWEST_POSES = 3
POINT_SPACING_M = 0.1


@dataclass(frozen=True, eq=False)
class Alignment:
    """The rigid motion that brings a trajectory closest to its reference.

    Attributes:
        rotation: [3, 3].
        translation: [3].
        ate_rmse_m: RMSE of the positions that remains.
    """

    rotation: FloatArray
    translation: FloatArray
    ate_rmse_m: float


def require_evo() -> None:
    """Raise MissingExtraError if evo, which measures trajectories, is not installed."""
    try:
        import evo  # noqa: F401
    except ImportError as error:
        raise MissingExtraError("evo", "bench") from error


def align(graph: SGraph, reference: FloatArray) -> Alignment:
    """Align an S-Graph's keyframes with reference poses, and measure what error remains, by evo.

    The absolute trajectory error (ATE) is that of positions, after alignment by rotation and
    translation (Umeyama without scale).

    Args:
        graph: K keyframes.
        reference: pose of each as x, y, z, qx, qy, qz, qw, [K, 7].

    Raises:
        InputError: there are fewer than three keyframes, not as many reference poses, or they lie
            on one line.
        MissingExtraError: evo is not installed.
    """
    poses = graph.keyframes.poses
    if len(poses) < FEWEST_POSES or len(poses) != len(reference):
        raise InputError(
            f"trajectories of {len(poses)} and {len(reference)} poses: "
            f"need as many of both, and {FEWEST_POSES} or more"
        )
    require_evo()
    from evo.core.geometry import GeometryException
    from evo.core.metrics import APE, PoseRelation, StatisticsType
    from evo.core.trajectory import PosePath3D

    def path(rows: FloatArray) -> PosePath3D:
        return PosePath3D(rows[:, :3], np.roll(rows[:, 3:], 1, axis=1))  # evo: w first

    true, estimate = path(reference), path(poses)
    try:
        rotation, translation, _ = estimate.align(true)
    except GeometryException as error:
        raise InputError(f"the trajectories cannot be aligned: {error}") from error
    ape = APE(PoseRelation.translation_part)
    ape.process_data((true, estimate))
    return Alignment(rotation, translation, float(ape.get_statistic(StatisticsType.rmse)))


def map_rmse(graph: SGraph, reference: SurfaceArrays, alignment: Alignment) -> float:
    """Return the RMSE of mapped surface points to the reference surfaces, in metres.

    The map is moved by the trajectory's alignment. Its points are 10 cm apart along its surfaces;
    each counts with its distance to the nearest reference surface among those that face within 90
    degrees of its own surface's direction: the other side of a thin wall is no match.

    Args:
        graph: the map.
        reference: surfaces of the truth.
        alignment: of the trajectory.

    Raises:
        InputError: the map or the reference has no surface.
    """
    surfaces = graph.wall_surfaces.ordered()
    if not len(surfaces) or not len(reference):
        raise InputError(f"maps of {len(surfaces)} and {len(reference)} surfaces: both need some")
    turn, shift = alignment.rotation[:2, :2], alignment.translation[:2]
    lines = lines_of(reference.segments)
    squares = []
    for segment, normal in zip(surfaces.segments, surfaces.normals, strict=True):
        count = max(2, round(np.linalg.norm(segment[1] - segment[0]) / POINT_SPACING_M) + 1)
        points = np.linspace(segment[0], segment[1], int(count)) @ turn.T + shift
        facing = dot(reference.normals, turn @ normal) > 0
        targets = shapely.multilinestrings(lines[facing] if facing.any() else lines)
        squares.append(shapely.distance(points_of(points), targets) ** 2)
    return float(np.sqrt(np.concatenate(squares).mean()))
