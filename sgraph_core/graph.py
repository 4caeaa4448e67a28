"""The S-Graph: keyframes, odometry, wall surfaces, observations and concept nodes."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import ArrayLike

from sgraph_concepts.errors import InputError, shorten
from sgraph_concepts.spec import WALL_SURFACE
from sgraph_concepts.types import ConceptNode, FloatArray, IntArray, OccupancyGrid
from sgraph_core.tables import (
    PERPENDICULAR_TOLERANCE_RAD,
    SHORTEST_SEGMENT_M,
    Check,
    Keyframes,
    Observations,
    Odometry,
    Table,
    WallSurfaces,
    turned,
)

if TYPE_CHECKING:
    import networkx

__all__ = ["Keyframe", "Pins", "SGraph", "TrueRoom", "Truth", "WallSurface"]


@dataclass(frozen=True, eq=False)
class Keyframe:
    """One keyframe; ``pose`` is world_T_body as x, y, z, qx, qy, qz, qw."""

    id: int
    pose: FloatArray
    stamp: float | None


@dataclass(frozen=True, eq=False)
class WallSurface:
    """One wall surface; see :class:`WallSurfaces` for the fields."""

    id: int
    segment: FloatArray
    normal: FloatArray
    height: FloatArray | None


@dataclass(frozen=True)
class Pins:
    """What a person has decided and inference respects; see docs/map-file.md.

    Attributes:
        same_room, not_same_room: pairs of wall surface ids; they must not contradict one another.
        room_names: name by room id.
    """

    same_room: tuple[tuple[int, int], ...] = ()
    not_same_room: tuple[tuple[int, int], ...] = ()
    room_names: Mapping[int, str] = field(default_factory=dict)


@dataclass(frozen=True)
class TrueRoom:
    """A room as a person labelled it; ``members`` are wall surface ids."""

    id: str | int | None
    name: str | None
    members: tuple[int, ...]
    polygon: tuple[tuple[float, float], ...] | None


@dataclass(frozen=True)
class Truth:
    """Labels to evaluate with; inference never reads them."""

    rooms: tuple[TrueRoom, ...] = ()
    walls: tuple[tuple[int, int], ...] = ()


class SGraph:
    """A Situational Graph: what SLAM built, and the concepts inferred from it.

    The low layers are tables of arrays (``keyframes``, ``odometry``, ``wall_surfaces``,
    ``observations``); single rows are viewed as objects (``keyframe(id)``, ``wall_surface(id)``).
    ``concepts`` maps a concept's name to its nodes, whose ``members`` are links to the layer below:
    the wall surfaces, or what ``groups`` says for the concept. ``grid`` is the occupancy grid that
    the surfaces were extracted from, if any; a map file does not hold it.

    Rows are only ever added or moved, so an id keeps its meaning. Both check the same rules as
    reading a map file and raise before anything is changed.
    """

    def __init__(self, name: str | None = None) -> None:
        self.name = name
        self.concepts: dict[str, list[ConceptNode]] = {}
        self.groups: dict[str, str] = {}
        self.pins: Pins | None = None
        self.truth: Truth | None = None
        self.grid: OccupancyGrid | None = None
        self._keyframes = Table(Keyframes())
        self._odometry = Table(Odometry())
        self._wall_surfaces = Table(WallSurfaces())
        self._observations = Table(Observations())
        self._keyframe_rows: dict[int, int] = {}
        self._surface_rows: dict[int, int] = {}

    # -- the tables ---------------------------------------------------------------------------

    @property
    def keyframes(self) -> Keyframes:
        """The keyframes, K rows."""
        return self._keyframes.view()

    @property
    def odometry(self) -> Odometry:
        """The odometry, M rows."""
        return self._odometry.view()

    @property
    def wall_surfaces(self) -> WallSurfaces:
        """The wall surfaces, N rows."""
        return self._wall_surfaces.view()

    @property
    def observations(self) -> Observations:
        """The observations, O rows."""
        return self._observations.view()

    def keyframe(self, keyframe_id: int) -> Keyframe:
        """View one keyframe.

        Raises:
            InputError: there is none of that id.
        """
        row, table = self.keyframe_row(keyframe_id), self.keyframes
        stamp = float(table.stamps[row])
        return Keyframe(keyframe_id, table.poses[row], None if np.isnan(stamp) else stamp)

    def wall_surface(self, surface_id: int) -> WallSurface:
        """View one wall surface.

        Raises:
            InputError: there is none of that id.
        """
        row, table = self.surface_row(surface_id), self.wall_surfaces
        height = table.heights[row]
        return WallSurface(
            surface_id,
            table.segments[row],
            table.normals[row],
            None if np.isnan(height).any() else height,
        )

    def keyframe_row(self, keyframe_id: int) -> int:
        """Return the row of a keyframe. Raises InputError if there is none of that id."""
        return _row_of(self._keyframe_rows, keyframe_id, "keyframe")

    def surface_row(self, surface_id: int) -> int:
        """Return the row of a wall surface. Raises InputError if there is none of that id."""
        return _row_of(self._surface_rows, surface_id, "wall surface")

    def node(self, concept: str, node_id: int) -> ConceptNode:
        """Return one node of a concept. Raises InputError if there is none of that id."""
        for node in self.concepts.get(concept, []):
            if node.id == node_id:
                return node
        raise InputError(f"there is no {concept} {node_id}")

    # -- building ------------------------------------------------------------------------------

    def add_keyframe(self, keyframe_id: int, pose: ArrayLike, stamp: float | None = None) -> None:
        """Add a keyframe.

        Args:
            keyframe_id: a new id from 0 to 2^53 - 1.
            pose: world_T_body as x, y, z, qx, qy, qz, qw.
            stamp: time in seconds.

        Raises:
            InputError: the id is taken or a number breaks the map file's rules.
        """
        self.extend_keyframes(
            _ids([keyframe_id]),
            _row("pose", pose, (7,)),
            _row("stamp", np.nan if stamp is None else stamp, ()),
        )

    def add_odometry(self, from_id: int, to_id: int, pose: ArrayLike, sigmas: ArrayLike) -> None:
        """Add the motion between two keyframes.

        Args:
            from_id: id of a keyframe.
            to_id: id of another one.
            pose: from_T_to as x, y, z, qx, qy, qz, qw.
            sigmas: standard deviations rx, ry, rz, x, y, z in rad and m.

        Raises:
            InputError: a keyframe is unknown or a number breaks the map file's rules.
        """
        self.extend_odometry(
            _ids([from_id]), _ids([to_id]), _row("pose", pose, (7,)), _row("sigmas", sigmas, (6,))
        )

    def add_wall_surface(
        self,
        surface_id: int,
        segment: ArrayLike,
        normal: ArrayLike,
        height: ArrayLike | None = None,
    ) -> None:
        """Add a wall surface.

        Args:
            surface_id: a new id from 0 to 2^53 - 1.
            segment: the two endpoints in the world, in any order, [2, 2]. A surface that comes as
                points is flattened by :func:`sgraph_core.preprocess.flatten` first.
            normal: unit vector from the wall body to the observed side; it is recomputed from the
                segment, which it must be perpendicular to within 5 degrees.
            height: lowest and highest z.

        Raises:
            InputError: the id is taken or a number breaks the map file's rules.
        """
        self.extend_wall_surfaces(
            _ids([surface_id]),
            _row("segment", segment, (2, 2)),
            _row("normal", normal, (2,)),
            _row("height", [np.nan, np.nan] if height is None else height, (2,)),
        )

    def observe(
        self,
        surface_id: int,
        keyframe_id: int,
        plane: ArrayLike,
        sigmas: ArrayLike,
        at: ArrayLike = (0.0, 0.0, 0.0),
    ) -> None:
        """Add the observation of a wall surface from a keyframe.

        A plane is known best in the middle of what was seen of it: there its distance errs
        independently of its angle. An error of the angle tilts it about that point, so that far
        away, such as at the robot, angle and distance err together.

        Args:
            surface_id: who was seen.
            keyframe_id: from where.
            plane: nx, ny, nz, d in the keyframe's body frame with n.x + d = 0, unit n pointing to
                the keyframe, hence d > 0. Turned by the keyframe's pose, n must be within 90
                degrees of the surface's normal: the other side would be another surface.
            sigmas: standard deviations of the normal's angle and of the plane's distance from the
                point ``at``, in rad and m.
            at: point of the keyframe's body frame where angle and distance err independently; by
                default its origin, where the distance is d.

        Raises:
            InputError: an id is unknown or a number breaks the map file's rules.
        """
        self.extend_observations(
            _ids([surface_id]),
            _ids([keyframe_id]),
            _row("plane", plane, (4,)),
            _row("sigmas", sigmas, (2,)),
            _row("at", at, (3,)),
        )

    def extend_keyframes(self, ids: IntArray, poses: FloatArray, stamps: FloatArray) -> None:
        """Add rows of :class:`Keyframes`. Raises InputError as :meth:`add_keyframe` does."""
        check = Check("keyframes")
        check.new_ids(ids, self._keyframe_rows)
        check.poses("pose", poses)
        check.that(~np.isinf(stamps), "stamp", stamps, "must be finite")
        _number(self._keyframe_rows, ids)
        self._keyframes.append(Keyframes(ids, poses, stamps))

    def extend_odometry(
        self, from_ids: IntArray, to_ids: IntArray, poses: FloatArray, sigmas: FloatArray
    ) -> None:
        """Add rows of :class:`Odometry`. Raises InputError as :meth:`add_odometry` does."""
        check = Check("odometry")
        check.known_ids("from", from_ids, self._keyframe_rows, "keyframe")
        check.known_ids("to", to_ids, self._keyframe_rows, "keyframe")
        check.that(from_ids != to_ids, "to", to_ids, "must differ from 'from'")
        check.poses("pose", poses)
        check.sigmas(sigmas)
        self._odometry.append(Odometry(from_ids, to_ids, poses, sigmas))

    def extend_wall_surfaces(
        self, ids: IntArray, segments: FloatArray, normals: FloatArray, heights: FloatArray
    ) -> None:
        """Add rows of :class:`WallSurfaces`. Raises InputError as :meth:`add_wall_surface` does."""
        check = Check("wall_surfaces")
        check.new_ids(ids, self._surface_rows)
        normals = _perpendicular(check, segments, normals)
        check.that(
            ~(heights[:, 0] > heights[:, 1]), "z", heights, "lowest must not be above highest"
        )
        check.that(~np.isinf(heights).any(axis=1), "z", heights, "must be finite")
        _number(self._surface_rows, ids)
        self._wall_surfaces.append(WallSurfaces(ids, segments, normals, heights))

    def extend_observations(
        self,
        surface_ids: IntArray,
        keyframe_ids: IntArray,
        planes: FloatArray,
        sigmas: FloatArray,
        at: FloatArray,
    ) -> None:
        """Add rows of :class:`Observations`. Raises InputError as :meth:`observe` does."""
        check = Check("observations")
        check.known_ids("surface", surface_ids, self._surface_rows, "wall surface")
        check.known_ids("keyframe", keyframe_ids, self._keyframe_rows, "keyframe")
        check.positions("plane", planes)
        check.unit("plane", planes[:, :3], planes)
        check.that(
            planes[:, 3] > 0, "plane", planes, "n must point to the keyframe, so d must be positive"
        )
        check.sigmas(sigmas)
        check.positions("at", at)
        poses = self.keyframes.poses[[self._keyframe_rows[int(i)] for i in keyframe_ids]]
        normals = self.wall_surfaces.normals[[self._surface_rows[int(i)] for i in surface_ids]]
        seen = turned(planes[:, :3], poses[:, 3:])[:, :2]
        check.that(
            (seen * normals).sum(axis=1) > 0,
            "plane",
            planes,
            "n, turned by the keyframe's pose, must be within 90 degrees of the surface's normal",
        )
        self._observations.append(Observations(surface_ids, keyframe_ids, planes, sigmas, at))

    # -- moving -------------------------------------------------------------------------------

    def move(
        self,
        keyframes: Mapping[int, ArrayLike] | None = None,
        surfaces: Mapping[int, tuple[ArrayLike, ArrayLike]] | None = None,
    ) -> None:
        """Give keyframes other poses, and wall surfaces other segments and normals.

        Args:
            keyframes: poses by id, as in :meth:`add_keyframe`.
            surfaces: segments and normals by id, as in :meth:`add_wall_surface`.

        Raises:
            InputError: an id is unknown or a number breaks the map file's rules.
        """
        keyframes, surfaces = keyframes or {}, surfaces or {}
        keyframe_ids, surface_ids = _ids(list(keyframes)), _ids(list(surfaces))
        poses = _rows("pose", list(keyframes.values()), (7,))
        segments = _rows("segment", [segment for segment, _ in surfaces.values()], (2, 2))
        normals = _rows("normal", [normal for _, normal in surfaces.values()], (2,))
        check = Check("keyframes")
        check.known_ids("id", keyframe_ids, self._keyframe_rows, "keyframe")
        check.poses("pose", poses)
        check = Check("wall_surfaces")
        check.known_ids("id", surface_ids, self._surface_rows, "wall surface")
        normals = _perpendicular(check, segments, normals)
        rows = np.array([self._keyframe_rows[i] for i in keyframes], np.int64)
        self._keyframes.overwrite("poses", poses, rows)
        rows = np.array([self._surface_rows[i] for i in surfaces], np.int64)
        self._wall_surfaces.overwrite("segments", segments, rows)
        self._wall_surfaces.overwrite("normals", normals, rows)

    # -- derived graphs --------------------------------------------------------------------------

    def copy(self) -> Self:
        """Return a copy that can be changed without changing this graph.

        Nodes are shared, since they do not change.
        """
        nodes = {id(node): node for some in self.concepts.values() for node in some}
        return copy.deepcopy(self, nodes)

    def moved(self, poses: FloatArray, segments: FloatArray, normals: FloatArray) -> Self:
        """Return a copy with other keyframe poses [K, 7], segments [N, 2, 2] and normals [N, 2]."""
        other = self.copy()
        other._keyframes.overwrite("poses", poses)
        other._wall_surfaces.overwrite("segments", segments)
        other._wall_surfaces.overwrite("normals", normals)
        return other

    def networkx(self) -> networkx.Graph[tuple[str, int]]:
        """Return all layers and links as an undirected networkx graph.

        Nodes are (layer, id): ``keyframe``, ``wall_surface`` or a concept's name. Edges carry
        ``link``: ``odometry``, ``observation`` or ``member``.
        """
        import networkx

        graph: networkx.Graph[tuple[str, int]] = networkx.Graph()
        graph.add_nodes_from(("keyframe", int(i)) for i in self.keyframes.ids)
        graph.add_nodes_from((WALL_SURFACE, int(i)) for i in self.wall_surfaces.ids)
        for one, two in zip(self.odometry.from_ids, self.odometry.to_ids, strict=True):
            graph.add_edge(("keyframe", int(one)), ("keyframe", int(two)), link="odometry")
        seen = self.observations
        for surface, keyframe in zip(seen.surface_ids, seen.keyframe_ids, strict=True):
            graph.add_edge(
                ("keyframe", int(keyframe)), (WALL_SURFACE, int(surface)), link="observation"
            )
        for concept, nodes in self.concepts.items():
            layer = self.groups.get(concept, WALL_SURFACE)
            for node in nodes:
                graph.add_node((concept, node.id), concept_node=node)
                for member in node.members:
                    graph.add_edge((concept, node.id), (layer, member), link="member")
        return graph


def _perpendicular(check: Check, segments: FloatArray, normals: FloatArray) -> FloatArray:
    """Check segments and normals; return the normals exactly perpendicular to the segments."""
    check.positions("segment", segments)
    along = segments[:, 1] - segments[:, 0]
    length = np.linalg.norm(along, axis=1)
    check.that(
        length >= SHORTEST_SEGMENT_M,
        "segment",
        segments,
        "endpoints must be 1 mm or more apart",
    )
    check.unit("normal", normals, normals)
    along /= length[:, None]
    slant = np.arcsin(np.clip(np.abs((along * normals).sum(axis=1)), 0, 1))
    check.that(
        slant <= PERPENDICULAR_TOLERANCE_RAD,
        "normal",
        normals,
        "must be perpendicular to the segment within 5 degrees",
    )
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    side = np.where((across * normals).sum(axis=1) < 0, -1.0, 1.0)
    return np.asarray(across * side[:, None] + 0.0)


def _ids(values: Sequence[int]) -> IntArray:
    array = np.asarray(values)
    if len(values) and array.dtype.kind not in "iu":
        raise InputError(f"id {values[0]!r}: must be an integer from 0 to 2^53 - 1")
    return array.astype(np.int64)


def _row(name: str, value: ArrayLike, shape: tuple[int, ...]) -> FloatArray:
    array = np.asarray(value, np.float64)
    if array.shape != shape:
        raise InputError(f"{name} = {shorten(value)}: must have shape {list(shape)}")
    return array[None]


def _rows(name: str, values: Sequence[ArrayLike], shape: tuple[int, ...]) -> FloatArray:
    return np.concatenate([np.empty((0, *shape)), *(_row(name, value, shape) for value in values)])


def _row_of(rows: Mapping[int, int], row_id: int, kind: str) -> int:
    if row_id not in rows:
        raise InputError(f"there is no {kind} {row_id}")
    return rows[row_id]


def _number(rows: dict[int, int], ids: IntArray) -> None:
    rows.update({int(row_id): len(rows) + k for k, row_id in enumerate(ids)})
