"""The values exchanged with plugins. They need numpy and nothing else.

Lengths are metres, angles radians, coordinates those of the map's world frame. Arrays are not
copied and not meant to be written to.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any, ClassVar, TypeVar

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "BuildingTruth",
    "Cluster",
    "ConceptNode",
    "FactorContext",
    "FactorResult",
    "FloatArray",
    "IntArray",
    "Memory",
    "NodeShape",
    "OccupancyGrid",
    "Scene",
    "ScoredEdges",
    "SurfaceArrays",
]

Result = TypeVar("Result")
FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class SurfaceArrays:
    """N wall surfaces as arrays: one row per observed side of a wall.

    Endpoints are ordered so that whoever stands in front of the surface (where its normal points)
    sees the first endpoint on the left: ``normals`` is ``tangents`` turned by -90 degrees.
    The order of endpoints in the input therefore carries no information.

    Attributes:
        ids: id of the input's surface each row belongs to, shape [N]. Fragments of one surface
            share its id.
        segments: endpoints, [N, 2, 2], in metres.
        normals: unit vectors from the wall body to the observed side, [N, 2].
    """

    ids: IntArray
    segments: FloatArray
    normals: FloatArray

    def __len__(self) -> int:
        return len(self.ids)

    @cached_property
    def midpoints(self) -> FloatArray:
        """Midpoints of the segments, [N, 2]."""
        return np.asarray(self.segments.mean(axis=1))

    @cached_property
    def lengths(self) -> FloatArray:
        """Lengths of the segments, the paper's width w_i, [N]."""
        return np.asarray(np.linalg.norm(self.segments[:, 1] - self.segments[:, 0], axis=1))

    @cached_property
    def tangents(self) -> FloatArray:
        """Unit vectors from the first to the second endpoint, [N, 2]."""
        return np.stack([-self.normals[:, 1], self.normals[:, 0]], axis=1)

    @property
    def content(self) -> tuple[bytes, bytes]:
        """Where the surfaces lie, as a key to remember things by."""
        return self.segments.tobytes(), self.normals.tobytes()

    def take(self, rows: IntArray | NDArray[np.bool_]) -> SurfaceArrays:
        """Return the given rows, by index or mask."""
        return SurfaceArrays(self.ids[rows], self.segments[rows], self.normals[rows])


def _none_near(_box: FloatArray) -> SurfaceArrays:
    return SurfaceArrays(np.empty(0, np.int64), np.empty((0, 2, 2)), np.empty((0, 2)))


@dataclass(frozen=True, eq=False)
class OccupancyGrid:
    """What a robot knows of a floor, cell by cell.

    As in ROS, row 0 and column 0 are at the grid's origin: the cell of row i and column j covers
    j to j + 1 along the grid's x axis and i to i + 1 along its y axis, in units of the resolution.

    Attributes:
        cells: ``FREE``, ``OCCUPIED`` or ``UNKNOWN``, uint8, [H, W].
        resolution: side of a cell, in metres.
        origin: pose of the corner of cell (0, 0): x, y in metres and yaw in radians, [3].
    """

    FREE: ClassVar[int] = 0
    OCCUPIED: ClassVar[int] = 1
    UNKNOWN: ClassVar[int] = 2

    cells: NDArray[np.uint8]
    resolution: float
    origin: FloatArray

    def to_world(self, points: FloatArray) -> FloatArray:
        """Return points given as (column, row), in cells from the origin's corner, in the world."""
        return np.asarray(self.origin[:2] + self.resolution * points @ self._axes)

    def to_cells(self, points: FloatArray) -> FloatArray:
        """Return points of the world as (column, row): the inverse of :meth:`to_world`."""
        return np.asarray((points - self.origin[:2]) @ self._axes.T / self.resolution)

    def shifted(self, by: FloatArray) -> OccupancyGrid:
        """Return the grid moved by a vector, [2]."""
        return replace(self, origin=self.origin + np.array([*by, 0.0]))

    @property
    def _axes(self) -> FloatArray:
        cosine, sine = np.cos(self.origin[2]), np.sin(self.origin[2])
        return np.array([[cosine, sine], [-sine, cosine]])


class Memory:
    """Results that a part of a concept may want again while one map grows.

    Args:
        size: how many are kept; the one that was not asked for the longest goes first.
    """

    def __init__(self, size: int = 2000) -> None:
        self._size = size
        self._results: dict[Hashable, Any] = {}

    def recall(self, key: Hashable, make: Callable[[], Result]) -> Result:
        """Return what was made for an equal key before, or make it."""
        result: Result = self._results.pop(key) if key in self._results else make()
        self._results[key] = result
        if len(self._results) > self._size:
            del self._results[next(iter(self._results))]
        return result


@dataclass(frozen=True, eq=False)
class Scene:
    """What a scorer sees: the items of one map and the pairs that may be related.

    Attributes:
        surfaces: the N surfaces after preprocessing; coordinates are relative to ``origin``.
        origin: world position of the scene's (0, 0), shape [2].
        pairs: row indices of the surfaces of each pair, first below second, [E, 2].
        distances: closest distance of the two surfaces of each pair, [E].
        visibility: share of the lines of sight between the two surfaces that are free, [E, V].
            Column 0 counts surfaces as obstacles; the further columns also count what may close
            a room: gaps between collinear surfaces and continued walls, up to growing widths
            (``sgraph_core.visibility.VISIBILITIES`` names them).
        nodes: the nodes to relate, when the concept groups another concept's nodes instead of
            wall surfaces; then ``pairs`` indexes them and ``surfaces`` holds their members.
        grid: the occupancy grid that the surfaces were extracted from, if any, in the scene's
            coordinates.
        support: what the surfaces have in common with the map, [N, 3]
            (``sgraph_core.support.SUPPORT`` names it); None in a scene of a whole map, which
            itself says it.
        memory: of the map that the scene is part of; empty if it is inferred once only. Scenes
            that share a memory share their origin.
    """

    surfaces: SurfaceArrays
    origin: FloatArray
    pairs: IntArray
    distances: FloatArray
    visibility: FloatArray
    nodes: Sequence[ConceptNode] = ()
    grid: OccupancyGrid | None = None
    support: FloatArray | None = None
    memory: Memory = field(default_factory=Memory)


@dataclass(frozen=True, eq=False)
class ScoredEdges:
    """A relation: pairs of rows with the log-odds that they are related.

    Attributes:
        pairs: row indices, first below second, each pair once, [E, 2].
        logits: log-odds of the relation as scored, which clusterers weigh against one another, [E].
        intercept, slope: what makes probabilities of them that mean what they say.
    """

    pairs: IntArray
    logits: FloatArray
    intercept: float = 0.0
    slope: float = 1.0

    @cached_property
    def probabilities(self) -> FloatArray:
        """Probabilities of the relation, [E]."""
        log_odds = self.intercept + self.slope * self.logits
        return np.asarray(0.5 * (1.0 + np.tanh(0.5 * log_odds)))


@dataclass(frozen=True)
class Cluster:
    """Rows that form one node of a concept.

    Attributes:
        members: row indices, ascending.
        confidence: probability from 0 to 1 that the cluster is what its concept says.
    """

    members: tuple[int, ...]
    confidence: float


def _holds_array(value: object, depth: int) -> bool:
    """Return whether a value is an array, or a collection of them down to a depth."""
    if depth and isinstance(value, Sequence):
        return any(_holds_array(part, depth - 1) for part in value)
    return isinstance(value, np.ndarray)


def _in_tuples(value: Any) -> Any:
    """Return arrays, and collections of them, as tuples of Python's numbers."""
    if isinstance(value, np.ndarray):
        value = value.tolist()
    return tuple(map(_in_tuples, value)) if isinstance(value, tuple | list) else value


@dataclass(frozen=True)
class NodeShape:
    """The geometry of a node: in the scene's coordinates from a plugin, in the world on a node.

    Attributes:
        centre: a representative point (x, y).
        polygon: outer ring, counter-clockwise, first point not repeated.
        holes: inner rings.
        thickness: of a wall, in metres.
        attributes: the concept's own fields, JSON values. The core does not look into them, so
            coordinates in them are the world's in any case.

    Arrays of points become tuples.
    """

    centre: tuple[float, float] | None = None
    polygon: tuple[tuple[float, float], ...] | None = None
    holes: tuple[tuple[tuple[float, float], ...], ...] = ()
    thickness: float | None = None
    attributes: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name, depth in (("centre", 0), ("polygon", 1), ("holes", 2)):
            if _holds_array(getattr(self, name), depth):
                object.__setattr__(self, name, _in_tuples(getattr(self, name)))

    def shifted(self, by: FloatArray) -> NodeShape:
        """Return the shape moved by a vector, [2]; attributes stay."""
        x, y = by.tolist()

        def ring(points: Sequence[tuple[float, float]]) -> tuple[tuple[float, float], ...]:
            return tuple((px + x, py + y) for px, py in points)

        return replace(
            self,
            centre=None if self.centre is None else ring([self.centre])[0],
            polygon=None if self.polygon is None else ring(self.polygon),
            holes=tuple(ring(hole) for hole in self.holes),
        )


@dataclass(frozen=True)
class ConceptNode:
    """A node of the S-Graph: one room, one wall, one of whatever a concept describes.

    Attributes:
        id: unique within its concept, stable over re-inference.
        members: ids of what the concept groups (wall surfaces, or another concept's nodes).
        name: what a person calls it, if anyone does.
        shape: its geometry, as far as known.
        confidence: probability from 0 to 1, where known.

    An array of members becomes a tuple.
    """

    id: int
    members: tuple[int, ...]
    name: str | None = None
    shape: NodeShape = field(default_factory=NodeShape)
    confidence: float | None = None

    def __post_init__(self) -> None:
        if isinstance(self.members, np.ndarray):
            object.__setattr__(self, "members", _in_tuples(self.members))


@dataclass(frozen=True, eq=False)
class FactorContext:
    """What a node's factors may refer to, in the coordinates of the factor graph.

    Attributes:
        plane_keys: gtsam key of each member's plane; a surface that no keyframe observed has none.
        planes: the same planes, nx, ny, nz, d with n.x + d = 0, [4] each.
        segments: endpoints of the same surfaces, [2, 2] each.
        nodes: all nodes of the concept.
        new_key: key of the node's own variable of the given number, counted from 0.
        near: returns the surfaces of the map, members or not, that some keyframe observed and whose
            bounding boxes meet a box x, y, x, y, [4].
        first_seen: number, in the order of the drive, of the keyframe that first observed each
            member that has a plane: how far apart two were mapped in time tells how much drift may
            lie between them.
        memory: shared by all nodes that come with the same ``nodes``: what follows from these need
            not be computed for each node.
        origin: world position of the coordinates' (0, 0), [2]; coordinates in the attributes of a
            node's shape are the world's in any case.
    """

    plane_keys: Mapping[int, int]
    planes: Mapping[int, FloatArray]
    segments: Mapping[int, FloatArray]
    nodes: Sequence[ConceptNode]
    new_key: Callable[[int], int]
    near: Callable[[FloatArray], SurfaceArrays] = _none_near
    first_seen: Mapping[int, int] = field(default_factory=dict)
    memory: Memory = field(default_factory=Memory)
    origin: FloatArray = field(default_factory=partial(np.zeros, 2))


@dataclass(frozen=True)
class FactorResult:
    """What a node puts into a factor graph.

    Attributes:
        factors: gtsam factors.
        values: initial values of the node's own variables: (key, gtsam value).
        same: pairs of observed surfaces, by id, that the node takes for one surface mapped twice.
            The back end ties them only where the map's own uncertainty allows it and where they
            agree with one another.
    """

    factors: Sequence[Any] = ()
    values: Sequence[tuple[int, Any]] = ()
    same: Sequence[tuple[int, int]] = ()


@dataclass(frozen=True, eq=False)
class BuildingTruth:
    """A synthetic building as a labeller sees it.

    Attributes:
        surfaces: the surfaces as preprocessing left them, N rows.
        rooms: room of each row as an index into ``polygons``, -1 for none, [N].
        polygons: outline of each room's free space, [K_r, 2] each.
        walls: pairs of rows, first below second, that are the two sides of one wall, [W, 2].
    """

    surfaces: SurfaceArrays
    rooms: IntArray
    polygons: Sequence[FloatArray]
    walls: IntArray
