"""Drives through floors with a simulated lidar and drifting odometry."""

from __future__ import annotations

import numpy as np

from sgraph_core.frontend.building import Floor
from sgraph_core.frontend.lidar import VLP16, Lidar, cast
from sgraph_core.frontend.odometry import DRIFT, Drift, drifting_odometry
from sgraph_core.frontend.planar import as_rows
from sgraph_core.frontend.recording import Recording
from sgraph_core.frontend.route import drive_along, route
from sgraph_core.frontend.surfaces import (
    EXTRACTION,
    Extraction,
    extract_surfaces,
    horizontal_scan,
    uneven,
    upright_scan,
)

__all__ = ["simulate"]

SPEED_M_S = 0.5


def simulate(
    floor: Floor,
    seed: int,
    *,
    keyframe_m: float = 1.0,
    lidar: Lidar = VLP16,
    drift: Drift = DRIFT,
    extraction: Extraction = EXTRACTION,
) -> Recording:
    """Drive the tour of a floor; the same seed gives the same recording.

    Args:
        floor: where to drive.
        seed: of all noise.
        keyframe_m: distance between keyframes along the way.
        lidar: the sensor.
        drift: the odometry's errors.
        extraction: how surfaces are found in its scans, and how uneven they are.

    Raises:
        InputError: a door is in no wall, or there is no way through doors from stop to stop.
    """
    rng = np.random.default_rng(seed)
    poses = drive_along(route(floor.free, floor.stops()), keyframe_m)
    odometry, sigmas = drifting_odometry(poses, drift, rng)
    panels = floor.panels()
    clouds = [cast(lidar, panels, pose, rng) for pose in poses]
    observed = [extract_surfaces(upright_scan(cloud, extraction), extraction) for cloud in clouds]
    return Recording(
        name=floor.name,
        stamps=np.arange(len(poses), dtype=np.float64) * (keyframe_m / SPEED_M_S),
        odometry=odometry,
        odometry_sigmas=sigmas,
        reference=as_rows(poses),
        scans=tuple(horizontal_scan(cloud) for cloud in clouds),
        observations=tuple(uneven(surfaces, extraction, rng) for surfaces in observed),
        building=floor.truth(),
    )
