"""Where surfaces are interrupted: doors, windows, missing walls, walls that meet from behind."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely
from numpy.random import Generator

from sgraph_concepts.types import FloatArray
from sgraph_core.geometry import lines_of
from sgraph_core.synth.config import FittingConfig
from sgraph_core.synth.cubicles import Cubicles
from sgraph_core.synth.pieces import SHORTEST_PIECE_M, Pieces
from sgraph_core.synth.walls import THICKEST_M, WallGaps

__all__ = [
    "Cutout",
    "border_cutouts",
    "cut",
    "draw_doors",
    "draw_windows",
    "junctions_behind",
    "openings",
]

DOOR_FRAME_M = 0.05
"""Doors stay this far from the ends of a wall."""
WINDOW_PIER_M = 0.2
"""Windows stay this far from the ends of a wall, and twice as far from one another."""


@dataclass(frozen=True, eq=False)
class Cutout:
    """A stretch that is cut out of surfaces, from point to point, [2] each.

    Attributes:
        rows: the surfaces: both sides of a wall, or one surface where a wall meets it from behind.
    """

    rows: tuple[int, ...]
    start: FloatArray
    end: FloatArray


def draw_doors(
    gaps: WallGaps, walls: Pieces, cubicles: Cubicles, rng: Generator, config: FittingConfig
) -> list[Cutout]:
    """Draw doors and wide openings between neighbouring rooms, and between rooms and outside.

    A cubicle is open towards the room that it stands in, and has no other door.
    """
    between: dict[tuple[int, int], list[int]] = defaultdict(list)
    for k, (one, two) in enumerate(zip(gaps.one, gaps.two, strict=True)):
        rooms = sorted((int(walls.rooms[one]), int(walls.rooms[two])))
        if rooms[0] != rooms[1]:
            between[rooms[0], rooms[1]].append(k)
    share, wide_share = rng.choice(config.door_share), rng.choice(config.opening_share)
    doors = []
    for (one, two), candidates in between.items():
        if one in cubicles or two in cubicles:
            if cubicles.get(two) == one:
                doors.append(_cubicle_opening(gaps, candidates, rng, config))
            continue
        if rng.random() >= share:
            continue
        for _ in range(2 if rng.random() < config.second_door_share else 1):
            wide = rng.random() < wide_share
            width = rng.uniform(*(config.opening_width_m if wide else config.door_width_m))
            gap = int(rng.choice(candidates))
            length = float(gaps.lengths[gap])
            if length > width + 2 * DOOR_FRAME_M:
                where = rng.uniform(DOOR_FRAME_M, length - width - DOOR_FRAME_M)
                doors.append(_cutout(gaps, gap, where, width))
    return doors


def _cubicle_opening(
    gaps: WallGaps, candidates: list[int], rng: Generator, config: FittingConfig
) -> Cutout:
    gap = int(rng.choice(candidates))
    length = float(gaps.lengths[gap])
    width = rng.uniform(*config.cubicle_opening) * length
    return _cutout(gaps, gap, rng.uniform(0, length - width), width)


def draw_windows(gaps: WallGaps, rng: Generator, config: FittingConfig) -> list[Cutout]:
    """Draw windows in the outer walls whose gaps are given.

    Some of them have rows of equal windows, others are glass from end to end but for mullions.
    """
    share, curtain_share = rng.choice(config.window_share), rng.choice(config.curtain_share)
    width, spacing = rng.uniform(*config.window_width_m), rng.uniform(*config.window_spacing_m)
    mullion, pane = rng.uniform(*config.mullion_m), rng.uniform(*config.pane_m)
    windows = []
    for gap in range(len(gaps)):
        length = float(gaps.lengths[gap])
        if rng.random() < curtain_share:
            count = int(np.ceil(length / pane))
            fitting, least = length / count - mullion, SHORTEST_PIECE_M
        elif rng.random() < share:
            count = max(1, int(length / spacing))
            fitting = min(width, length / count - 2 * WINDOW_PIER_M)
            least = config.window_width_m[0]
        else:
            continue
        for number in range(count if fitting >= least else 0):
            where = (number + 0.5) * length / count - fitting / 2
            windows.append(_cutout(gaps, gap, where, fitting))
    return windows


def _cutout(gaps: WallGaps, gap: int, where_m: float, width_m: float) -> Cutout:
    start, along = gaps.starts[gap], (gaps.ends[gap] - gaps.starts[gap]) / gaps.lengths[gap]
    rows = (int(gaps.one[gap]), int(gaps.two[gap]))
    return Cutout(rows, start + where_m * along, start + (where_m + width_m) * along)


def border_cutouts(walls: Pieces, borders: FloatArray) -> list[Cutout]:
    """Return the borders [B, 2, 2] at which no wall stands as cutouts of both rooms' outlines."""
    touch_m = 1e-3
    middles = shapely.points(borders.mean(axis=1))
    border, row = shapely.STRtree(lines_of(walls.segments)).query(
        middles, predicate="dwithin", distance=touch_m
    )
    return [
        Cutout(tuple(row[border == k].tolist()), start, end)
        for k, (start, end) in enumerate(borders)
    ]


def junctions_behind(gaps: WallGaps, count: int, rng: Generator, share: float) -> Iterator[Cutout]:
    """Yield where walls meet surfaces from behind: between the rooms that lie behind them."""
    behind: dict[int, list[tuple[FloatArray, FloatArray]]] = defaultdict(list)
    for one, two, start, end in zip(gaps.one, gaps.two, gaps.starts, gaps.ends, strict=True):
        behind[int(one)].append((start, end))
        behind[int(two)].append((end, start))  # opposed surfaces run in opposite directions
    for row in range(count):
        if len(behind[row]) < 2 or rng.random() >= share:
            continue
        along = behind[row][0][1] - behind[row][0][0]
        for (_, end), (start, _) in pairwise(sorted(behind[row], key=lambda s: s[0] @ along)):
            if (start - end) @ along >= 0 and np.linalg.norm(start - end) <= THICKEST_M:
                yield Cutout((row,), end, start)


def cut(walls: Pieces, cutouts: Iterable[Cutout]) -> Pieces:
    """Return what cutouts leave of surfaces."""
    cuts: dict[int, list[tuple[FloatArray, FloatArray]]] = defaultdict(list)
    for cutout in cutouts:
        for row in cutout.rows:
            cuts[row].append((cutout.start, cutout.end))
    rows, segments = [], []
    for row, segment in enumerate(walls.segments):
        length = float(np.linalg.norm(segment[1] - segment[0]))
        along = (segment[1] - segment[0]) / length
        spans = [(0.0, length)]
        for start, end in cuts[row]:
            ends = sorted(((start - segment[0]) @ along, (end - segment[0]) @ along))
            spans = [
                span
                for low, high in spans
                for span in ((low, min(high, ends[0])), (max(low, ends[1]), high))
                if span[1] - span[0] > SHORTEST_PIECE_M
            ]
        for low, high in spans:
            rows.append(row)
            segments.append([segment[0] + low * along, segment[0] + high * along])
    return walls.parts(rows, segments)


def openings(cutouts: Sequence[Cutout], walls: Pieces) -> FloatArray:
    """Return what cutouts of both sides of a wall take out of its body: corners in turn, [O, 4, 2].

    The first edge lies on the side whose row comes first.
    """
    rings = np.empty((len(cutouts), 4, 2))
    for ring, cutout in zip(rings, cutouts, strict=True):
        for ends, row in zip((slice(0, 2), slice(3, 1, -1)), cutout.rows, strict=True):
            start, along = walls.segments[row, 0], walls.segments[row, 1] - walls.segments[row, 0]
            reach = (np.stack([cutout.start, cutout.end]) - start) @ along / (along @ along)
            ring[ends] = start + reach[:, None] * along
    return rings
