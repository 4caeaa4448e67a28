"""A simulated 3-D lidar in a building: vectorised ray casting against vertical panels.

A building is its panels: vertical rectangles with a low and a high edge (walls, the lintels over
doors, the sides of furniture), between a floor and a ceiling. Each panel covers one interval of the
sensor's azimuths, so rays are only cast at what they can hit.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.random import Generator

from sgraph_concepts.types import FloatArray, IntArray
from sgraph_core.frontend.planar import rotated
from sgraph_core.geometry import dot

__all__ = ["VLP16", "Cloud", "Lidar", "Panels", "cast"]


@dataclass(frozen=True, eq=False)
class Panels:
    """What W vertical rectangles, a floor at z = 0 and a ceiling enclose.

    Attributes:
        segments: the panels seen from above, the space in front of them to the left on the way
            from the first to the second endpoint, [W, 2, 2]. Panels are not seen from behind.
        heights: their lowest and highest z, [W, 2].
        ceiling_m: z of the ceiling.
    """

    segments: FloatArray
    heights: FloatArray
    ceiling_m: float


@dataclass(frozen=True)
class Lidar:
    """A spinning lidar; the defaults are the Velodyne VLP-16's.

    16 channels from -15 to +15 degrees, 0.2 degrees of azimuth at 10 Hz, 100 m range. Its typical
    accuracy of 3 cm is taken as one standard deviation of independent errors.

    Attributes:
        elevations_deg: of the rings, ascending, R of them.
        azimuths: number of columns of one turn, A.
        range_m: what is farther away gives no return.
        sigma_m: standard deviation of a measured range.
        height_m: of the sensor above the floor, as on a small wheeled or legged robot.
    """

    elevations_deg: tuple[float, ...] = field(default=tuple(range(-15, 16, 2)))
    azimuths: int = 1800
    range_m: float = 100.0
    sigma_m: float = 0.03
    height_m: float = 0.6


VLP16 = Lidar()


@dataclass(frozen=True, eq=False)
class Cloud:
    """One turn of a lidar.

    Attributes:
        azimuths: direction of each column in the body frame, ascending from -pi, [A].
        elevations: of each ring, in rad, [R].
        ranges: along the rays, NaN without a return, [A, R].
        height_m: of the sensor above the floor.
    """

    azimuths: FloatArray
    elevations: FloatArray
    ranges: FloatArray
    height_m: float

    def horizontal(self) -> FloatArray:
        """Return the distances seen from above, [A, R]."""
        return np.asarray(self.ranges * np.cos(self.elevations))

    def heights(self) -> FloatArray:
        """Return the z of the returns above the floor, [A, R]."""
        return np.asarray(self.height_m + self.ranges * np.sin(self.elevations))


def cast(lidar: Lidar, panels: Panels, pose: FloatArray, rng: Generator | None = None) -> Cloud:
    """Return what a lidar measures at a pose x, y, yaw [3]; without noise where ``rng`` is None."""
    azimuths = -np.pi + 2 * np.pi * np.arange(lidar.azimuths) / lidar.azimuths
    elevations = np.radians(lidar.elevations_deg)
    slopes = np.tan(elevations)
    segments = rotated(panels.segments - pose[:2], -np.asarray(pose[2]))
    panel, column = _facing(segments, azimuths)
    rays = np.stack([np.cos(azimuths), np.sin(azimuths)], axis=1)[column]
    along = segments[:, 1] - segments[:, 0]
    normals = np.stack([-along[:, 1], along[:, 0]], axis=1)
    distances = dot(normals, segments[:, 0])[panel] / dot(normals[panel], rays)

    z = lidar.height_m + distances[:, None] * slopes
    low, high = panels.heights[panel].T
    hit = (z >= low[:, None]) & (z <= high[:, None])
    nearest = np.full((len(azimuths), len(slopes)), np.inf)
    np.minimum.at(nearest, column, np.where(hit, distances[:, None], np.inf))
    levels = np.where(slopes > 0, panels.ceiling_m, 0.0) - lidar.height_m
    flat = np.divide(levels, slopes, out=np.full(len(slopes), np.inf), where=slopes != 0)
    ranges = np.minimum(nearest, flat) / np.cos(elevations)
    ranges = np.where(ranges <= lidar.range_m, ranges, np.nan)
    if rng is not None:
        ranges = ranges + rng.normal(0, lidar.sigma_m, ranges.shape)
    return Cloud(azimuths, elevations, ranges, lidar.height_m)


def _facing(segments: FloatArray, azimuths: FloatArray) -> tuple[IntArray, IntArray]:
    """Return which panel faces the sensor in which column, as rows and columns, [P] each.

    A panel that faces the sensor runs counter-clockwise around it, by less than half a turn.
    """
    step = azimuths[1] - azimuths[0]
    starts, ends = np.arctan2(segments[..., 1], segments[..., 0]).T
    widths = (ends - starts) % (2 * np.pi)
    first = np.ceil((starts - azimuths[0]) / step)
    last = np.floor((starts + widths - azimuths[0]) / step)
    counts = np.where((widths > 1e-9) & (widths < np.pi), last - first + 1, 0).astype(np.int64)
    panel = np.repeat(np.arange(len(segments)), counts)
    within = np.arange(len(panel)) - np.repeat(np.cumsum(counts) - counts, counts)
    column = (first.astype(np.int64)[panel] + within) % len(azimuths)
    return panel, column
