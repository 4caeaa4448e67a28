"""The S-Graph's tables: arrays that grow by rows, and the rules every row keeps."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from sgraph_concepts.errors import InputError, shorten
from sgraph_concepts.types import FloatArray, IntArray, SurfaceArrays

__all__ = [
    "GREATEST_SIGMA",
    "ID_RULE",
    "LARGEST_COORDINATE_M",
    "LARGEST_ID",
    "LEAST_SIGMA",
    "PERPENDICULAR_TOLERANCE_RAD",
    "SHORTEST_SEGMENT_M",
    "SIGMA_RULE",
    "Check",
    "Keyframes",
    "Observations",
    "Odometry",
    "RowError",
    "RuleError",
    "Table",
    "WallSurfaces",
    "is_id",
    "turned",
]

Rows = TypeVar("Rows")

LARGEST_ID = 2**53 - 1
"""Ids are integers that every JSON reader holds exactly."""
ID_RULE = f"must be an integer from 0 to {LARGEST_ID}"
LARGEST_COORDINATE_M = 1e8
"""Positions beyond this are no map's: UTM needs 1e7, and float64 resolves 15 nm here."""
LEAST_SIGMA, GREATEST_SIGMA = 1e-8, 1e6
"""Standard deviations, rad or m: below the first float64 no longer solves what they ask for."""
SIGMA_RULE = f"must be from {LEAST_SIGMA:g} to {GREATEST_SIGMA:g}"
NORM_TOLERANCE = 1e-3
"""How far the norm of a normal or quaternion may be from 1."""
PERPENDICULAR_TOLERANCE_RAD = np.radians(5.0)
"""How far a surface's normal may be from perpendicular to its segment."""
SHORTEST_SEGMENT_M = 1e-3
"""Shorter segments have no direction worth the name."""


class RuleError(InputError):
    """A part of a map, of a file or of an S-Graph, breaks a rule.

    Attributes:
        place: where, named as in the map file; in one line, shortened.
        value: the offending value.
        rule: what is asked for.
    """

    def __init__(self, place: str, value: object, rule: str) -> None:
        self.place, self.value, self.rule = shorten(place), value, rule
        super().__init__(f"{self.place} = {shorten(value)}: {rule}")


class RowError(InputError):
    """A row of one of the S-Graph's tables breaks a rule.

    Attributes:
        table: the table, named as in the map file.
        row: the row's index among those being added.
        field: the field, named as in the map file.
        value: the offending value.
        rule: what is asked for.
    """

    def __init__(self, table: str, row: int, field_name: str, value: object, rule: str) -> None:
        self.table, self.row, self.field, self.value, self.rule = (
            table,
            row,
            field_name,
            value,
            rule,
        )
        super().__init__(f"{table}[{row}].{field_name} = {value!r}: {rule}")


@dataclass(frozen=True, eq=False)
class Keyframes:
    """K keyframes.

    Attributes:
        ids: [K].
        poses: world_T_body as x, y, z, qx, qy, qz, qw, [K, 7].
        stamps: seconds, NaN where unknown, [K].
    """

    ids: IntArray = field(default_factory=lambda: np.empty(0, np.int64))
    poses: FloatArray = field(default_factory=lambda: np.empty((0, 7)))
    stamps: FloatArray = field(default_factory=lambda: np.empty(0))


@dataclass(frozen=True, eq=False)
class Odometry:
    """M relative poses between keyframes.

    Attributes:
        from_ids, to_ids: keyframe ids, [M].
        poses: from_T_to as x, y, z, qx, qy, qz, qw, [M, 7].
        sigmas: standard deviations in the tangent space of from_T_to, rotation first,
            rad and m, [M, 6].
    """

    from_ids: IntArray = field(default_factory=lambda: np.empty(0, np.int64))
    to_ids: IntArray = field(default_factory=lambda: np.empty(0, np.int64))
    poses: FloatArray = field(default_factory=lambda: np.empty((0, 7)))
    sigmas: FloatArray = field(default_factory=lambda: np.empty((0, 6)))


@dataclass(frozen=True, eq=False)
class WallSurfaces:
    """N wall surfaces, as they came.

    Attributes:
        ids: [N].
        segments: endpoints in the world, in any order, [N, 2, 2].
        normals: unit vectors from the wall body to the observed side, [N, 2].
        heights: lowest and highest z, NaN where unknown, [N, 2].
    """

    ids: IntArray = field(default_factory=lambda: np.empty(0, np.int64))
    segments: FloatArray = field(default_factory=lambda: np.empty((0, 2, 2)))
    normals: FloatArray = field(default_factory=lambda: np.empty((0, 2)))
    heights: FloatArray = field(default_factory=lambda: np.empty((0, 2)))

    def take(self, rows: IntArray) -> WallSurfaces:
        """Return some of the surfaces."""
        return WallSurfaces(
            self.ids[rows], self.segments[rows], self.normals[rows], self.heights[rows]
        )

    def ordered(self) -> SurfaceArrays:
        """Return the surfaces with their endpoints ordered by their normals."""
        along = self.segments[:, 1] - self.segments[:, 0]
        swap = self.normals[:, 0] * along[:, 1] < self.normals[:, 1] * along[:, 0]
        segments = self.segments.copy()
        segments[swap] = segments[swap, ::-1]
        return SurfaceArrays(self.ids, segments, self.normals)


@dataclass(frozen=True, eq=False)
class Observations:
    """O planes of wall surfaces as keyframes saw them.

    Attributes:
        surface_ids, keyframe_ids: who was seen from where, [O].
        planes: nx, ny, nz, d in the keyframe's body frame with n.x + d = 0, unit n pointing to the
            keyframe, hence d > 0, [O, 4].
        sigmas: standard deviations of the normal's angle and of the plane's distance from the point
            ``at``, which err independently, rad and m, [O, 2].
        at: points of the body frame, [O, 3]. At the origin the distance is d.
    """

    surface_ids: IntArray = field(default_factory=lambda: np.empty(0, np.int64))
    keyframe_ids: IntArray = field(default_factory=lambda: np.empty(0, np.int64))
    planes: FloatArray = field(default_factory=lambda: np.empty((0, 4)))
    sigmas: FloatArray = field(default_factory=lambda: np.empty((0, 2)))
    at: FloatArray = field(default_factory=lambda: np.empty((0, 3)))


def is_id(value: object) -> bool:
    """Return whether a value can be an id."""
    integer = isinstance(value, int | np.integer) and not isinstance(value, bool)
    return integer and 0 <= int(value) <= LARGEST_ID  # type: ignore[call-overload]


def turned(vectors: FloatArray, quaternions: FloatArray) -> FloatArray:
    """Return vectors [R, 3] turned by quaternions qx, qy, qz, qw [R, 4]."""
    axis, real = quaternions[:, :3], quaternions[:, 3:]
    return np.asarray(vectors + 2 * np.cross(axis, np.cross(axis, vectors) + real * vectors))


class Table(Generic[Rows]):
    """Arrays that grow at the end in amortised constant time per row."""

    def __init__(self, rows: Rows) -> None:
        self._type = type(rows)
        self._columns: dict[str, NDArray[Any]] = {
            column.name: getattr(rows, column.name)
            for column in fields(rows)  # type: ignore[arg-type]
        }
        self._size = 0

    def view(self) -> Rows:
        """Return the rows so far, without copying them; only this table may change them."""
        columns = {name: array[: self._size] for name, array in self._columns.items()}
        for column in columns.values():
            column.flags.writeable = False
        return self._type(**columns)

    def append(self, rows: Rows) -> None:
        """Add rows at the end."""
        new = {name: np.asarray(getattr(rows, name)) for name in self._columns}
        size = self._size + len(next(iter(new.values())))
        for name, array in self._columns.items():
            if size > len(array):
                grown = np.empty((max(size, 2 * len(array)), *array.shape[1:]), array.dtype)
                grown[: self._size] = array[: self._size]
                self._columns[name] = grown
            self._columns[name][self._size : size] = new[name]
        self._size = size

    def overwrite(
        self, column: str, values: NDArray[Any], rows: IntArray | slice = slice(None)
    ) -> None:
        """Replace one column of all rows, or of some."""
        self._columns[column][: self._size][rows] = values


class Check:
    """The rules of the tables; each raises RowError for the first row that breaks it."""

    def __init__(self, table: str) -> None:
        self._table = table

    def that(
        self, holds: NDArray[np.bool_] | np.bool_, name: str, values: NDArray[Any], rule: str
    ) -> None:
        """Raise unless a condition holds for every row."""
        if not np.all(holds):
            row = int(np.argmin(holds))
            raise RowError(self._table, row, name, values[row].tolist(), rule)

    def new_ids(self, ids: IntArray, taken: Mapping[int, int]) -> None:
        """Ids are integers in range that nobody else has."""
        self.that(
            (ids >= 0) & (ids <= LARGEST_ID), "id", ids, "must be an integer from 0 to 2^53 - 1"
        )
        _, first = np.unique(ids, return_index=True)
        fresh = np.zeros(len(ids), bool)
        fresh[first] = True
        fresh &= np.array([int(i) not in taken for i in ids], bool)
        self.that(fresh, "id", ids, "must be unique")

    def known_ids(self, name: str, ids: IntArray, known: Mapping[int, int], kind: str) -> None:
        """Ids refer to rows of another table."""
        found = np.array([int(i) in known for i in ids], bool)
        self.that(found, name, ids, f"must be the id of a {kind}")

    def positions(self, name: str, values: FloatArray) -> None:
        """Positions are finite and on Earth."""
        axes = tuple(range(1, values.ndim))
        self.that(np.isfinite(values).all(axis=axes), name, values, "must be finite")
        small = np.abs(values) <= LARGEST_COORDINATE_M
        self.that(small.all(axis=axes), name, values, "must be within 1e8 m")

    def unit(self, name: str, vectors: FloatArray, shown: FloatArray) -> None:
        """Vectors have norm 1."""
        self.that(np.isfinite(vectors).all(axis=1), name, shown, "must be finite")
        norm = np.linalg.norm(vectors, axis=1)
        self.that(np.abs(norm - 1) <= NORM_TOLERANCE, name, shown, "norm must be within 1e-3 of 1")

    def poses(self, name: str, poses: FloatArray) -> None:
        """Poses are positions and unit quaternions."""
        self.positions(name, poses[:, :3])
        self.unit(name, poses[:, 3:], poses)

    def sigmas(self, sigmas: FloatArray) -> None:
        """Standard deviations are positive, and such as an instrument or a guess may have."""
        good = (sigmas >= LEAST_SIGMA) & (sigmas <= GREATEST_SIGMA)
        self.that(good.all(axis=1), "sigmas", sigmas, SIGMA_RULE)
