"""Wall surfaces of one scan: split-and-merge and total least squares.

A turn of a 3-D lidar becomes a scan seen from above first (:func:`upright_scan`): in a column of
rays of one azimuth, a vertical surface returns the same horizontal distance in every ring, whatever
its direction, while floor and ceiling return distances that differ from ring to ring. The rings
that agree are averaged. So one extraction serves 3-D clouds and 2-D scans, no height of floor or
ceiling need be known, and a column of 16 rays costs as much as one ray of a 2-D scanner.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.random import Generator

from sgraph_concepts.types import FloatArray
from sgraph_core.frontend.lidar import Cloud
from sgraph_core.frontend.planar import rotated
from sgraph_core.frontend.recording import ObservedSurfaces
from sgraph_core.geometry import dot

__all__ = [
    "EXTRACTION",
    "Extraction",
    "Scan",
    "extract_surfaces",
    "horizontal_scan",
    "upright_scan",
]


@dataclass(frozen=True)
class Extraction:
    """What counts as an observed surface.

    Attributes:
        split_m: points farther than this from the chord of their run split it.
        jump_m: neighbouring points farther apart than this belong to different surfaces.
        fewest_points: of a surface.
        shortest_m: length of a surface.
        noise_m: least standard deviation of a point across a surface; more where points scatter
            more. Of an average over rings, it is the ranges' over the root of their number.
        uneven_m: how far each end of a stretch of wall departs from the wall's plane, as a
            standard deviation.
        least_angle: standard deviation of a normal's direction however long the stretch, in rad.
        agree_m: horizontal distances in a column of rings that agree within this are of one
            vertical surface: 3.5 standard deviations of the difference of two ranges of a VLP-16.
        fewest_rings: that must agree.
    """

    split_m: float = 0.1
    jump_m: float = 0.4
    fewest_points: int = 8
    shortest_m: float = 0.5
    noise_m: float = 0.01
    uneven_m: float = 0.015
    least_angle: float = 0.005
    agree_m: float = 0.15
    fewest_rings: int = 3

    def wall_sigmas(self, length_m: FloatArray | float) -> tuple[FloatArray, FloatArray]:
        """Return how far a stretch of wall departs from its plane: in angle, and in its middle."""
        angle = np.hypot(np.sqrt(2) * self.uneven_m / np.asarray(length_m), self.least_angle)
        return angle, np.full_like(angle, self.uneven_m / np.sqrt(2))


EXTRACTION = Extraction()


@dataclass(frozen=True, eq=False)
class Scan:
    """End points of rays seen from above, by ascending azimuth.

    Attributes:
        points: in the body frame, [P, 2].
        heights: lowest and highest z seen at each point, NaN where unknown, [P, 2].
        closed: whether the scan is a full turn, so that the last point neighbours the first.
    """

    points: FloatArray
    heights: FloatArray
    closed: bool

    @classmethod
    def flat(cls, points: FloatArray, closed: bool = False) -> Scan:
        """Return the scan of a 2-D scanner."""
        return cls(points, np.full((len(points), 2), np.nan), closed)


def horizontal_scan(cloud: Cloud, every: int = 5) -> FloatArray:
    """Return end points of the lowest ring above the horizon, which meets no floor, [P, 2]."""
    ring = int(np.argmax(cloud.elevations > 0))
    distances, azimuths = cloud.horizontal()[::every, ring], cloud.azimuths[::every]
    seen = ~np.isnan(distances)
    rays = np.stack([np.cos(azimuths), np.sin(azimuths)], axis=1)
    return np.asarray((distances[:, None] * rays)[seen])


def upright_scan(cloud: Cloud, config: Extraction) -> Scan:
    """Return where columns of rays met vertical surfaces.

    Of each column the largest set of adjacent rings that agree is taken, the nearest of equals.
    """
    distances = cloud.horizontal()
    agree = np.abs(np.diff(distances, axis=1)) <= config.agree_m
    count, ring_count = distances.shape
    run = np.zeros((count, ring_count), np.int64)
    run[:, 1:] = np.cumsum(~agree, axis=1)
    flat = (run + ring_count * np.arange(count)[:, None]).ravel()
    size = count * ring_count
    known = ~np.isnan(distances)
    sizes = np.bincount(flat, known.ravel(), size).reshape(count, ring_count)
    sums = np.bincount(flat, np.nan_to_num(distances).ravel(), size).reshape(count, ring_count)
    means = np.divide(sums, sizes, out=np.full_like(sums, np.inf), where=sizes > 0)
    best = np.lexsort((means, -sizes), axis=1)[:, 0]
    rows = np.arange(count)
    upright = sizes[rows, best] >= config.fewest_rings
    member = (run == best[:, None]) & known
    z = cloud.heights()
    low = np.where(member, z, np.inf).min(axis=1)
    high = np.where(member, z, -np.inf).max(axis=1)
    rays = np.stack([np.cos(cloud.azimuths), np.sin(cloud.azimuths)], axis=1)
    points = means[rows, best][upright, None] * rays[upright]
    return Scan(points, np.stack([low, high], axis=1)[upright], closed=True)


def extract_surfaces(scan: Scan, config: Extraction) -> ObservedSurfaces:
    """Return the wall surfaces that a scan shows."""
    scan = _opened(scan, config)
    rows = [
        run
        for chain in _chains(scan.points, config)
        for run in _merge(scan.points, _split(scan.points, chain, config), config)
    ]
    fits = [fit for run in rows if (fit := _fit(scan, run, config)) is not None]
    return ObservedSurfaces(
        np.array([fit.segment for fit in fits]).reshape(-1, 2, 2),
        np.array([fit.plane for fit in fits]).reshape(-1, 4),
        np.array([fit.sigmas for fit in fits]).reshape(-1, 2),
        np.array([fit.at for fit in fits]).reshape(-1, 2),
        np.array([fit.heights for fit in fits]).reshape(-1, 2),
    )


Run = tuple[int, int]
"""Rows of a scan from the first to before the last."""


def _opened(scan: Scan, config: Extraction) -> Scan:
    """Return a full turn begun where no surface is cut: at its widest jump, else in a corner."""
    if not scan.closed or len(scan.points) < 2:
        return scan
    steps = np.linalg.norm(scan.points - np.roll(scan.points, 1, axis=0), axis=1)
    start = int(np.argmax(steps))
    if steps[start] <= config.jump_m:
        start = int(np.argmax(np.linalg.norm(scan.points, axis=1)))
    return Scan(np.roll(scan.points, -start, axis=0), np.roll(scan.heights, -start, axis=0), False)


def _chains(points: FloatArray, config: Extraction) -> list[Run]:
    """Return runs without jumps."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    borders = [0, *(np.flatnonzero(steps > config.jump_m) + 1).tolist(), len(points)]
    return [(a, b) for a, b in pairwise(borders) if b - a >= 2]


def _split(points: FloatArray, chain: Run, config: Extraction) -> list[Run]:
    """Return runs whose points are close to the chord between their ends, in order."""
    result, waiting = [], [chain]
    while waiting:
        first, last = waiting.pop()
        chord = points[last - 1] - points[first]
        length = float(np.linalg.norm(chord))
        offset = points[first:last] - points[first]
        if length > 0:
            away = np.abs(offset[:, 0] * chord[1] - offset[:, 1] * chord[0]) / length
        else:
            away = np.linalg.norm(offset, axis=1)
        farthest = first + int(np.argmax(away))
        if away[farthest - first] > config.split_m and first < farthest < last - 1:
            waiting += [(farthest, last), (first, farthest + 1)]
        else:
            result.append((first, last))
    return result


def _merge(points: FloatArray, runs: list[Run], config: Extraction) -> list[Run]:
    """Return runs with neighbours joined that one line fits."""
    merged = runs[:1]
    for run in runs[1:]:
        both = (merged[-1][0], run[1])
        _, normal, centre, _ = _line(points[both[0] : both[1]])
        if np.abs((points[both[0] : both[1]] - centre) @ normal).max() <= config.split_m:
            merged[-1] = both
        else:
            merged.append(run)
    return merged


def _line(points: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return direction, normal, centre and scatter (along, across) of the best line."""
    centre = points.mean(axis=0)
    spread = (points - centre).T @ (points - centre)
    values, vectors = np.linalg.eigh(spread)
    return vectors[:, 1], vectors[:, 0], centre, values[::-1]


@dataclass(frozen=True, eq=False)
class _Fit:
    segment: FloatArray
    plane: FloatArray
    sigmas: FloatArray
    at: FloatArray
    heights: FloatArray


def _fit(scan: Scan, run: Run, config: Extraction) -> _Fit | None:
    """Fit a plane to a run; None if it is too short, too few points, or passes the sensor.

    With standard deviation s of a point across the line, P points and the moment m of their
    positions along it, the fit errs in its centre with variance s^2 / P and turns about it with
    f = s^2 / m. The wall itself departs from its plane in the middle of the stretch with variance
    o^2 and is turned about that by a^2. Together they turn by f + a^2, independently of the error
    in the mean of centre and middle with weights f and a^2, which is there, at a distance r between
    centre and middle, s^2 / P + o^2 + r^2 f a^2 / (f + a^2).
    """
    points = scan.points[run[0] : run[1]]
    kept = _without_ends(points, config)
    if kept.sum() < config.fewest_points:
        return None
    points, heights = points[kept], scan.heights[run[0] : run[1]][kept]
    along, normal, centre, (moment, scatter) = _line(points)
    reach = (points - centre) @ along
    offset = float(-normal @ centre)
    if np.ptp(reach) < config.shortest_m or offset == 0:
        return None
    if offset < 0:
        normal, offset = -normal, -offset
    noise = max(config.noise_m, float(np.sqrt(max(scatter, 0.0) / (len(points) - 2))))
    wall_angle, wall_offset = config.wall_sigmas(np.ptp(reach))
    turns = np.array([noise**2 / moment, wall_angle**2])
    angle = np.sqrt(turns.sum())
    middle = (reach.min() + reach.max()) / 2
    distance = np.sqrt(
        noise**2 / len(points) + wall_offset**2 + middle**2 * turns.prod() / turns.sum()
    )
    return _Fit(
        segment=centre + np.outer([reach.min(), reach.max()], along),
        plane=np.array([*normal, 0.0, offset]),
        sigmas=np.array([angle, distance]),
        at=centre + turns[1] / turns.sum() * middle * along,
        heights=np.array([heights[:, 0].min(), heights[:, 1].max()]),
    )


def _without_ends(points: FloatArray, config: Extraction) -> FloatArray:
    """Return which points are of the line: those of the next wall around a corner are not."""
    kept = np.ones(len(points), bool)
    for _ in range(2):
        if kept.sum() < config.fewest_points:
            break
        _, normal, centre, (_, scatter) = _line(points[kept])
        noise = max(config.noise_m, float(np.sqrt(max(scatter, 0.0) / kept.sum())))
        kept = np.abs((points - centre) @ normal) <= 2.5 * noise
    return kept


def uneven(observed: ObservedSurfaces, config: Extraction, rng: Generator) -> ObservedSurfaces:
    """Return observed surfaces as walls that are not ideal planes would show them.

    Every observation is turned about its middle and shifted by normal draws of the walls' own
    sigmas (:meth:`Extraction.wall_sigmas`).
    """
    middles = observed.segments.mean(axis=1)
    lengths = np.linalg.norm(observed.segments[:, 1] - observed.segments[:, 0], axis=1)
    angle, shift = (rng.normal(0, sigma) for sigma in config.wall_sigmas(lengths))
    normals = rotated(observed.planes[:, :2], angle)
    offsets = -dot(normals, middles) + shift
    kept = offsets > 0
    points = np.concatenate([observed.segments, observed.at[:, None]], axis=1) - middles[:, None]
    points = (middles - shift[:, None] * normals)[:, None] + rotated(points, angle[:, None])
    planes = np.column_stack([normals, np.zeros(len(normals)), offsets])
    return ObservedSurfaces(
        points[kept, :2],
        planes[kept],
        observed.sigmas[kept],
        points[kept, 2],
        observed.heights[kept],
    )
