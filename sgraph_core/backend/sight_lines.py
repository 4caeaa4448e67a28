"""What keyframes saw through: a corrected map must not put walls there.

A keyframe that saw a surface had a free view of it. Where a correction is right, the window that it
moves sees past the older walls, and older keyframes see past those that the window mapped. Where it
is wrong, many of these lines of sight are blocked, even if walls fit onto walls.
"""

from __future__ import annotations

import numpy as np
import shapely

from sgraph_concepts.types import FloatArray
from sgraph_core.backend.visits import AWAY
from sgraph_core.geometry import dot, lines_of, turn_left
from sgraph_core.graph import SGraph
from sgraph_core.tables import turned

__all__ = ["SightLines"]

CLEAR_M = 0.3
"""How far lines of sight end in front of what they show."""
LOOSE_M = 0.2
"""What a surface loses at each end: lines of sight pass its ends closely, and it may be inexact."""


class SightLines:
    """The lines of sight of an S-Graph's observations, seen from above.

    A line leads from a keyframe to the point of the surface that is nearest to the observation's
    point ``at``. Heights are not looked at: what is mapped is taken to block all that crosses it.

    Args:
        graph: an S-Graph whose low layers are solved.
    """

    def __init__(self, graph: SGraph) -> None:
        table, surfaces = graph.observations, graph.wall_surfaces.ordered()
        rows = np.array([graph.keyframe_row(i) for i in table.keyframe_ids.tolist()], np.int64)
        order = np.argsort(rows, kind="stable")
        self._rows = rows[order]
        of = [graph.surface_row(i) for i in table.surface_ids[order].tolist()]
        self._of = np.array(of, np.int64)
        self._since = np.full(len(surfaces), len(graph.keyframes.ids))
        np.minimum.at(self._since, self._of, self._rows)
        poses = graph.keyframes.poses[self._rows]
        at = (poses[:, :3] + turned(table.at[order], poses[:, 3:]))[:, :2]
        self._lines = _cleared(poses[:, :2], _nearest(surfaces.segments[self._of], at))
        self._among_lines = shapely.STRtree(lines_of(self._lines))
        half = surfaces.tangents * (surfaces.lengths / 2 - LOOSE_M)[:, None]
        self._walls = np.stack([surfaces.midpoints - half, surfaces.midpoints + half], axis=1)
        self._among_walls = shapely.STRtree(lines_of(self._walls))
        self._solid = surfaces.lengths > 2 * LOOSE_M

    def blocked(self, first: int, last: int, move: FloatArray, centre: FloatArray) -> float:
        """Return which share of the lines of sight about a window its correction blocks.

        These are the window's own, which the walls mapped long before it may block, and all of long
        before that come to the box around the walls that the window mapped.

        Args:
            first: row of the window's first keyframe.
            last: row of the first keyframe after it.
            move: the correction: angle, x and y; see
                :class:`sgraph_core.backend.corrections.Corrections`.
            centre: about which it turns, [2].
        """
        long_before, start, end = np.searchsorted(self._rows, [first - AWAY, first, last]).tolist()
        seen = np.zeros(len(self._since), bool)
        seen[self._of[start:end]] = True
        known = self._since < first - AWAY
        others = self._solid & known & ~seen
        mine = self._solid & seen & ~known
        lines = lines_of(_moved(self._lines[start:end], move, centre))
        line, wall = self._among_walls.query(lines, predicate="intersects")
        blocked = np.unique(line[others[wall]])
        walls = lines_of(_moved(self._walls[mine], move, centre))
        around = self._among_lines.query(shapely.multilinestrings(walls))  # boxes that meet
        _, crossed = self._among_lines.query(walls, predicate="intersects")
        older = np.unique(crossed[crossed < long_before])
        judged = len(lines) + int(np.count_nonzero(around < long_before))
        return (len(blocked) + len(older)) / max(judged, 1)


def _nearest(segments: FloatArray, points: FloatArray) -> FloatArray:
    """Return the point of each segment that is nearest to a point, [N, 2]."""
    along = segments[:, 1] - segments[:, 0]
    shares = dot(points - segments[:, 0], along) / dot(along, along)
    return np.asarray(segments[:, 0] + np.clip(shares, 0, 1)[:, None] * along)


def _cleared(eyes: FloatArray, points: FloatArray) -> FloatArray:
    """Return lines of sight that end in front of what they show, [N, 2, 2]."""
    views = points - eyes
    ranges = np.linalg.norm(views, axis=1)
    shares = np.maximum(ranges - CLEAR_M, 0) / np.maximum(ranges, CLEAR_M)
    return np.stack([eyes, eyes + shares[:, None] * views], axis=1)


def _moved(segments: FloatArray, move: FloatArray, centre: FloatArray) -> FloatArray:
    return np.asarray(segments + move[1:] + move[0] * turn_left(segments - centre))
