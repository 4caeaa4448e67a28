"""Where an optimiser's values put the keyframes and wall surfaces of an S-Graph."""

from __future__ import annotations

import gtsam
import numpy as np
from numpy.typing import ArrayLike

from sgraph_concepts.errors import InputError, one_line
from sgraph_concepts.types import FloatArray, IntArray
from sgraph_core.backend.back_projection import carried, planes_of
from sgraph_core.backend.keys import Keys
from sgraph_core.backend.low_layers import pose_row
from sgraph_core.graph import SGraph

__all__ = ["Planes", "moves", "observations_of"]

LEVEL = 1e-6
"""A plane whose normal has no larger horizontal component is no wall's."""
Poses = dict[int, ArrayLike]
"""By id of the keyframe, as SGraph.move takes them."""
Surfaces = dict[int, tuple[ArrayLike, ArrayLike]]
"""Segments and normals by id of the surface, as SGraph.move takes them."""
Planes = tuple[IntArray, FloatArray]
"""Ids of surfaces, ascending, [N], and their planes, [N, 4]."""


def moves(graph: SGraph, keys: Keys, values: gtsam.Values) -> tuple[Poses, Surfaces, Planes]:
    """Return where values put the keyframes and the observed surfaces that they hold, and planes.

    A surface is carried along by the keyframes that observed it (the mean of where each takes its
    ends), then put onto its plane, so that it also moves lengthwise.

    Args:
        graph: where they were before.
        keys: of the values.
        values: Pose3 of keyframes, OrientedPlane3 of surfaces.

    Raises:
        InputError: a value has another type, or a plane is not finite or level.
    """
    table = graph.keyframes
    poses = table.poses.copy()
    held = [k for k, i in enumerate(table.ids.tolist()) if values.exists(keys.keyframe(i))]
    observed = np.unique(graph.observations.surface_ids)
    there = [values.exists(keys.surface(i)) for i in observed.tolist()]
    surfaces = observed[np.array(there, bool)]
    try:
        for k in held:
            poses[k] = pose_row(values.atPose3(keys.keyframe(int(table.ids[k]))))
        planes = planes_of(values, keys, surfaces.tolist())
    except RuntimeError as error:
        raise InputError(f"the values are not of this map: {one_line(error)}") from error
    upright = np.isfinite(planes).all(axis=1) & (np.abs(planes[:, :2]).max(axis=1) > LEVEL)
    if not upright.all():
        lost = int(np.argmin(upright))
        raise InputError(
            f"the values hold {planes[lost].tolist()} as the plane of wall surface "
            f"{surfaces[lost]}: must be finite and not level"
        )
    seen, by = observations_of(graph, surfaces)
    segments, normals = carried(
        graph.wall_surfaces.segments[[graph.surface_row(i) for i in surfaces.tolist()]],
        seen,
        by,
        table.poses,
        poses,
        planes,
    )
    moved = zip(surfaces.tolist(), segments, normals, strict=True)
    return (
        {int(table.ids[k]): poses[k] for k in held},
        {surface: (segment, normal) for surface, segment, normal in moved},
        (surfaces, planes),
    )


def observations_of(graph: SGraph, surfaces: IntArray) -> tuple[IntArray, IntArray]:
    """Return place among sorted surfaces and row of the keyframe of all observations of them."""
    observations, ids = graph.observations, graph.keyframes.ids
    rows = np.isin(observations.surface_ids, surfaces)
    order = np.argsort(ids)
    by = order[np.searchsorted(ids, observations.keyframe_ids[rows], sorter=order)]
    return np.searchsorted(surfaces, observations.surface_ids[rows]), by
