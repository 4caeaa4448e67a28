"""What a robot maps of a building: what it sees, in pieces, some missing, cut short, doubled."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import shapely
from numpy.random import Generator
from numpy.typing import NDArray

from sgraph_concepts.types import FloatArray, IntArray
from sgraph_core.geometry import dot, points_of
from sgraph_core.synth.config import ViewConfig
from sgraph_core.synth.occlusion import seen_from
from sgraph_core.synth.pieces import IN_CAVITY, SHORTEST_PIECE_M, Pieces
from sgraph_core.synth.surfaces import Floor
from sgraph_core.synth.trajectory import draw_poses

__all__ = ["add_noise", "draw_view", "join_through"]

THROUGH_GAP_M = 0.5
"""Surfaces are mapped as one over gaps up to this: the end of a wall between two rooms."""


def draw_view(floor: Floor, rng: Generator, config: ViewConfig) -> Pieces:
    """Return what is mapped of a floor's surfaces, free of drift and noise."""
    pieces = floor.pieces
    if rng.random() < config.occluded_share:
        pieces = seen_from(
            draw_poses(floor, rng, config), pieces, rng.uniform(*config.sensor_range_m)
        )
    if rng.random() < config.fragmented_share:
        pieces = _fragment(pieces, rng, config)
    pieces = pieces.take(rng.random(len(pieces)) >= rng.choice(config.missing_share))
    pieces = _crop(pieces, rng, rng.choice(config.cropped_share))
    doubled = rng.random(len(pieces)) < rng.choice(config.duplicate_share)
    return Pieces.joined(pieces, pieces.take(doubled))


def _fragment(pieces: Pieces, rng: Generator, config: ViewConfig) -> Pieces:
    """Break long surfaces into pieces, with or without gaps between them."""
    longest = rng.uniform(*config.longest_piece_m)
    gap = rng.uniform(*config.piece_gap_m) * rng.choice([0, 0, 1])
    irregular = rng.random() < 0.4
    rows, segments = [], []
    for row, (start, end) in enumerate(pieces.segments):
        length = float(np.linalg.norm(end - start))
        count = max(1, int(np.ceil(length / longest)))
        inner = rng.uniform(0.1, 0.9, count - 1) if irregular else np.arange(1, count) / count
        borders = np.concatenate([[0.0], np.sort(inner), [1.0]])
        for low, high in pairwise(borders):
            shortened = high - gap / length if high < 1 else high
            if (shortened - low) * length > SHORTEST_PIECE_M:
                rows.append(row)
                segments.append([start + low * (end - start), start + shortened * (end - start)])
    return pieces.parts(rows, segments)


def _crop(pieces: Pieces, rng: Generator, share: float) -> Pieces:
    """Cut up to a quarter off some ends."""
    cut = rng.uniform(0, 0.25, (len(pieces), 2)) * (rng.random((len(pieces), 2)) < share)
    along = pieces.segments[:, 1] - pieces.segments[:, 0]
    start = pieces.segments[:, 0] + cut[:, :1] * along
    end = pieces.segments[:, 1] - cut[:, 1:] * along
    return pieces.moved(np.stack([start, end], axis=1))


def join_through(pieces: Pieces, rng: Generator, share: float) -> IntArray:
    """Return which surface each piece is mapped as part of, [P].

    A piece may be mapped as one with the next collinear piece that faces the same way, although a
    wall between two rooms ends there.
    """
    ends, starts = pieces.segments[:, 1], pieces.segments[:, 0]
    near = shapely.STRtree(points_of(starts)).query(
        points_of(ends), predicate="dwithin", distance=THROUGH_GAP_M
    )
    one, two = near
    gap = starts[two] - ends[one]
    collinear = dot(pieces.normals[one], pieces.normals[two]) > np.cos(np.radians(1.0))
    collinear &= np.abs(dot(gap, pieces.normals[one])) < 0.02
    joins = pieces.structural & (pieces.rooms != IN_CAVITY)
    collinear &= (one != two) & joins[one] & joins[two]
    surface = np.arange(len(pieces))
    for first, second in near.T[collinear & (rng.random(len(one)) < share)].tolist():
        surface[surface == surface[second]] = surface[first]
    _, numbered = np.unique(surface, return_inverse=True)
    return numbered.astype(np.int64)


def add_noise(
    segments: FloatArray, rng: Generator, sigma_m: float
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Add noise to endpoints; say which surfaces it neither turns around nor shrinks to nothing."""
    noisy = segments + rng.normal(0, sigma_m, segments.shape)
    before, after = _along(segments), _along(noisy)
    kept = (dot(before, after) > 0) & (np.linalg.norm(after, axis=1) > SHORTEST_PIECE_M)
    return noisy, np.asarray(kept)


def _along(segments: FloatArray) -> FloatArray:
    return np.asarray(segments[:, 1] - segments[:, 0])
