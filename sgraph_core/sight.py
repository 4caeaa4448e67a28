"""What lies between two surfaces: which of their lines of sight are free, and who blocks the rest.

The lines of sight are those of the visibility (docs/network.md), for one pair at a time.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np
import shapely

from sgraph_concepts.types import SurfaceArrays
from sgraph_core.geometry import lines_of
from sgraph_core.rays import Rays

__all__ = ["Sight", "sight"]


@dataclass(frozen=True)
class Sight:
    """The lines of sight between two surfaces.

    Attributes:
        lines: how many there are.
        free: how many of them are free.
        behind: how many leave or arrive at the back of one of the two.
        blockers: ids of the surfaces that cross the others, and how many each crosses; the one
            that crosses most comes first.
    """

    lines: int
    free: int
    behind: int
    blockers: tuple[tuple[int, int], ...]


def sight(surfaces: SurfaceArrays, one: int, two: int) -> Sight:
    """Return the lines of sight between the surfaces in rows ``one`` and ``two``."""
    rays = Rays.between(surfaces, np.array([[one, two]]))
    lines, in_front = lines_of(rays.lines[:, 0]), rays.valid[:, 0]
    tree = shapely.STRtree(lines_of(surfaces.segments))
    line, row = tree.query(lines[in_front], predicate="intersects")
    others = (row != one) & (row != two)
    line, row = line[others], row[others]
    crossed = set(zip(surfaces.ids[row].tolist(), line.tolist(), strict=True))
    blocked = Counter(surface for surface, _ in crossed)
    return Sight(
        lines=len(lines),
        free=int(in_front.sum()) - len(np.unique(line)),
        behind=int((~in_front).sum()),
        blockers=tuple(sorted(blocked.items(), key=lambda item: (-item[1], item[0]))),
    )
