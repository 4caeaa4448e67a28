"""Pieces of wall surfaces with what is true of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sgraph_concepts.types import FloatArray, IntArray

__all__ = ["IN_CAVITY", "NO_ROOM", "SHORTEST_PIECE_M", "Pieces"]

NO_ROOM = -1
IN_CAVITY = -2
SHORTEST_PIECE_M = 0.05


@dataclass(frozen=True, eq=False)
class Pieces:
    """P pieces of surfaces with what is true of them.

    Attributes:
        segments: [P, 2, 2].
        normals: [P, 2].
        rooms: index of the room each belongs to, [P]; NO_ROOM for none, IN_CAVITY for none because
            it faces the cavity of a double wall.
        structural: whether a piece is a side of a wall, as opposed to clutter, [P].
    """

    segments: FloatArray
    normals: FloatArray
    rooms: IntArray
    structural: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.rooms)

    @property
    def facades(self) -> NDArray[np.bool_]:
        """Which pieces are outer faces of the building, [P]."""
        return np.asarray(self.structural & (self.rooms == NO_ROOM))

    def take(self, rows: IntArray | NDArray[np.bool_]) -> Pieces:
        """Return the given rows, by index or mask."""
        return Pieces(
            self.segments[rows], self.normals[rows], self.rooms[rows], self.structural[rows]
        )

    def moved(self, segments: FloatArray) -> Pieces:
        """Return the pieces with other endpoints; normals stay."""
        return Pieces(segments, self.normals, self.rooms, self.structural)

    def parts(self, rows: ArrayLike, segments: ArrayLike) -> Pieces:
        """Return parts of pieces: of which row each is a part, [Q], and its ends, [Q, 2, 2]."""
        ends = np.asarray(segments, np.float64).reshape(-1, 2, 2)
        return self.take(np.asarray(rows, np.int64)).moved(ends)

    @staticmethod
    def joined(*parts: Pieces) -> Pieces:
        """Return the rows of all parts."""
        return Pieces(
            np.concatenate([part.segments for part in parts]),
            np.concatenate([part.normals for part in parts]),
            np.concatenate([part.rooms for part in parts]),
            np.concatenate([part.structural for part in parts]),
        )
