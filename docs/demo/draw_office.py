"""Draw the demonstration map: an office floor, and a robot that drove through it.

The floor is drawn by hand below, wall by wall; the generator of training buildings has no part in
it. A robot with a 2-D scanner then drives a hand-drawn path. Its odometry drifts; the map holds
what it would have put together: keyframes, odometry, surfaces where they seemed to be, and the
planes it observed. Run ``python docs/demo/draw_office.py`` to write ``office.json`` and the true
trajectory ``office.tum`` anew.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray

from sgraph_core.graph import SGraph, TrueRoom, Truth
from sgraph_core.map_file import save

Array = NDArray[np.float64]

SEED = 0
STEP_M = 0.6
"""Distance between keyframes."""
RANGE_M = 8.0
"""Of the scanner."""
SAMPLE_M = 0.1
"""Distance between the points at which a surface is hit."""
FEWEST_HITS = 5
PLANE_SIGMAS = (0.01, 0.02)
"""Of an observed plane: angle [rad] and offset [m]."""
ODOMETRY_SIGMAS = (0.012, 0.02)
"""Of one step between keyframes: heading [rad] and each direction [m]."""
ASSOCIATE_M, ASSOCIATE_RAD = 0.3, 0.2
"""A plane that is seen again within this of where its surface is mapped is taken for it; else it
becomes a surface of its own."""
FORGET_KEYFRAMES = 10
"""A surface not seen for this long has to be associated anew."""

# Rooms as corners, counter-clockwise, in metres. Walls along the corridor are 15 cm thick, walls
# between rooms 12 cm.
ROOMS: dict[str, list[tuple[float, float]]] = {
    "corridor": [(0, 7), (28, 7), (28, 9), (0, 9)],
    "reception": [(0, 0), (6, 0), (6, 6.85), (0, 6.85)],
    "office 1": [(6.12, 0), (10, 0), (10, 6.85), (6.12, 6.85)],
    "office 2": [(10.12, 0), (14, 0), (14, 6.85), (10.12, 6.85)],
    "meeting room": [(14.12, 0), (20, 0), (20, 6.85), (14.12, 6.85)],
    "kitchen": [(20.12, 0), (24, 0), (24, 6.85), (20.12, 6.85)],
    "toilet 1": [(24.12, 3.5), (26, 3.5), (26, 6.85), (24.12, 6.85)],
    "toilet 2": [(26.12, 3.5), (28, 3.5), (28, 6.85), (26.12, 6.85)],
    "store": [(24.12, 0), (28, 0), (28, 3.38), (24.12, 3.38)],
    "open office": [(0, 9.15), (10, 9.15), (10, 12), (6, 12), (6, 15), (0, 15)],
    "phone booth": [(6.12, 12.12), (10, 12.12), (10, 15), (6.12, 15)],
    "office 3": [(10.12, 9.15), (14, 9.15), (14, 15), (10.12, 15)],
    "office 4": [(14.12, 9.15), (18, 9.15), (18, 15), (14.12, 15)],
    "laboratory": [(18.12, 9.15), (25, 9.15), (25, 15), (18.12, 15)],
    "server room": [(25.12, 9.15), (28, 9.15), (28, 15), (25.12, 15)],
    "stairs": [(28.15, 5), (32, 5), (32, 11), (28.15, 11)],
}

# Doorways as boxes (west, south, east, north) that are cut out of both sides of a wall.
DOORS = [
    (3.0, 6.8, 4.0, 7.05),  # reception
    (8.0, 6.8, 8.9, 7.05),  # office 1
    (12.4, 6.8, 13.3, 7.05),  # office 2
    (16.0, 6.8, 17.8, 7.05),  # meeting room, a double door
    (21.5, 6.8, 22.4, 7.05),  # kitchen
    (24.7, 6.8, 25.5, 7.05),  # toilet 1
    (26.7, 6.8, 27.5, 7.05),  # toilet 2
    (23.95, 1.2, 24.2, 2.1),  # kitchen to store
    (2.0, 8.95, 3.2, 9.2),  # open office
    (7.6, 11.95, 8.5, 12.2),  # open office to phone booth
    (11.6, 8.95, 12.5, 9.2),  # office 3
    (15.4, 8.95, 16.3, 9.2),  # office 4
    (21.0, 8.95, 22.2, 9.2),  # laboratory
    (26.2, 8.95, 27.1, 9.2),  # server room
    (27.95, 7.5, 28.2, 8.6),  # stairs
]

# Surfaces that the robot never got to see (behind shelves, glass): room and edge.
MISSED = {("office 2", 0), ("store", 1), ("laboratory", 2), ("stairs", 1), ("office 4", 1)}

# The drive: along the corridor, into the rooms on the way, and back to where it began.
PATH = [
    (1.5, 8.0), (3.5, 8.0), (3.5, 4.0), (2.5, 2.0), (3.5, 4.0), (3.5, 8.0), (2.6, 8.0),
    (2.6, 11.0), (4.0, 13.0), (3.0, 10.8), (8.0, 10.5), (8.05, 13.5), (8.0, 10.5), (3.0, 10.5),
    (2.6, 8.0), (8.4, 8.0), (8.4, 3.0), (8.4, 8.0), (12.0, 8.0), (12.05, 12.5), (12.05, 8.0),
    (12.8, 8.0), (12.8, 3.0), (12.8, 8.0), (15.8, 8.0), (15.85, 12.5), (15.85, 8.0),
    (16.9, 8.0), (16.9, 3.5), (18.5, 2.5), (16.9, 8.0), (21.9, 8.0), (21.9, 2.0), (23.0, 1.65),
    (26.0, 1.65), (23.0, 1.65), (21.9, 2.0), (21.9, 8.0), (21.6, 8.0), (21.6, 12.5),
    (23.5, 13.0), (21.6, 12.0), (21.6, 8.0), (25.1, 8.0), (25.1, 4.6), (25.1, 8.0), (27.1, 8.0),
    (27.1, 4.6), (27.1, 8.0), (26.6, 8.0), (26.6, 13.0), (26.6, 8.0), (27.5, 8.05),
    (30.0, 8.05), (30.5, 9.5), (30.0, 6.5),
]  # fmt: skip


@dataclass(frozen=True, eq=False)
class Side:
    """One side of a wall as built: endpoints [2, 2], normal [2], and its room."""

    segment: Array
    normal: Array
    room: str


@dataclass(eq=False)
class Landmark:
    """A surface as the robot mapped it."""

    side: int
    normal: Array
    offset: float
    points: list[Array] = field(default_factory=list)
    last_seen: int = 0


def built_sides() -> list[Side]:
    """Return the sides of all walls, doorways cut out, without the missed ones."""
    doors = shapely.union_all([shapely.box(*door) for door in DOORS])
    sides = []
    for room, outline in ROOMS.items():
        corners = np.array(outline, float)
        for edge, (start, end) in enumerate(zip(corners, np.roll(corners, -1, 0), strict=True)):
            if (room, edge) in MISSED:
                continue
            along = (end - start) / np.linalg.norm(end - start)
            rest = shapely.difference(shapely.LineString([start, end]), doors)
            for part in shapely.get_parts(rest):
                segment = shapely.get_coordinates(part)
                sides.append(Side(segment, np.array([-along[1], along[0]]), room))
    return sides


def drive() -> Array:
    """Return the true poses along the path: x, y, heading, [K, 3]."""
    path = shapely.LineString(PATH)
    reach = np.arange(0, path.length, STEP_M)
    here = shapely.get_coordinates(shapely.line_interpolate_point(path, reach))
    ahead = shapely.get_coordinates(shapely.line_interpolate_point(path, reach + 0.05))
    heading = np.arctan2(*(ahead - here).T[::-1])
    return np.column_stack([here, heading])


def compose(pose: Array, motion: Array) -> Array:
    """Return pose * motion for x, y, heading."""
    cosine, sine = np.cos(pose[2]), np.sin(pose[2])
    x, y, turn = motion
    return np.array(
        [pose[0] + cosine * x - sine * y, pose[1] + sine * x + cosine * y, pose[2] + turn]
    )


def between(one: Array, two: Array) -> Array:
    """Return one^-1 * two for x, y, heading."""
    cosine, sine = np.cos(one[2]), np.sin(one[2])
    x, y = two[:2] - one[:2]
    turn = (two[2] - one[2] + np.pi) % (2 * np.pi) - np.pi
    return np.array([cosine * x + sine * y, -sine * x + cosine * y, turn])


def as_row(pose: Array) -> list[float]:
    """Return x, y, heading as x, y, z, qx, qy, qz, qw."""
    return [pose[0], pose[1], 0.0, 0.0, 0.0, np.sin(pose[2] / 2), np.cos(pose[2] / 2)]


def drifted(true: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """Return the measured motions [K - 1, 3] and the poses [K, 3] that they add up to."""
    turn, shift = ODOMETRY_SIGMAS
    motions = np.array([between(one, two) for one, two in pairwise(true)])
    motions = motions + rng.normal(0, 1, motions.shape) * [shift, shift, turn]
    poses = [true[0]]
    for motion in motions:
        poses.append(compose(poses[-1], motion))
    return motions, np.array(poses)


def hits(pose: Array, side: Side, walls: shapely.STRtree) -> Array:
    """Return the points of a side that are seen from a pose, [H, 2]."""
    length = np.linalg.norm(side.segment[1] - side.segment[0])
    shares = np.linspace(0, 1, max(2, int(length / SAMPLE_M)))[1:-1]
    points = side.segment[0] + shares[:, None] * (side.segment[1] - side.segment[0])
    rays = points - pose[:2]
    seen = (rays @ side.normal < 0) & (np.linalg.norm(rays, axis=1) < RANGE_M)
    points = points[seen]
    starts = np.broadcast_to(pose[:2], points.shape)
    lines = shapely.linestrings(np.stack([starts, points + 0.01 * side.normal], axis=1))
    blocked, _ = walls.query(lines, predicate="crosses")
    free = np.ones(len(points), bool)
    free[blocked] = False
    return points[free]


def observe(pose: Array, side: Side, rng: np.random.Generator) -> Array:
    """Return the plane of a side as measured from a pose: nx, ny, nz, d in the body frame."""
    angle, offset = PLANE_SIGMAS
    turn = np.arctan2(side.normal[1], side.normal[0]) - pose[2] + rng.normal(0, angle)
    distance = side.normal @ (pose[:2] - side.segment[0]) + rng.normal(0, offset)
    return np.array([np.cos(turn), np.sin(turn), 0.0, distance])


def associate(
    landmarks: list[Landmark], side: int, pose: Array, plane: Array, keyframe: int
) -> int | None:
    """Return the landmark that an observed plane is taken for."""
    heading = pose[2] + np.arctan2(plane[1], plane[0])
    normal = np.array([np.cos(heading), np.sin(heading)])
    for number, landmark in reversed(list(enumerate(landmarks))):
        if landmark.side != side:
            continue
        if keyframe - landmark.last_seen <= FORGET_KEYFRAMES:
            return number
        distance = landmark.normal @ pose[:2] + landmark.offset
        if (
            normal @ landmark.normal > np.cos(ASSOCIATE_RAD)
            and abs(distance - plane[3]) < ASSOCIATE_M
        ):
            return number
    return None


def draw() -> tuple[SGraph, Array]:
    """Return the map and the true poses."""
    rng = np.random.default_rng(SEED)
    sides, true = built_sides(), drive()
    walls = shapely.STRtree(shapely.linestrings([side.segment for side in sides]))
    motions, poses = drifted(true, rng)
    graph, landmarks, seen = SGraph("office"), [], []
    for keyframe, (pose, real) in enumerate(zip(poses, true, strict=True)):
        graph.add_keyframe(keyframe, as_row(pose), stamp=float(keyframe))
        for number, side in enumerate(sides):
            points = hits(real, side, walls)
            if len(points) < FEWEST_HITS:
                continue
            plane = observe(real, side, rng)
            if plane[3] <= 0.05:
                continue
            mapped = np.array(
                [compose(pose, [*between(real, [*p, 0.0])[:2], 0.0])[:2] for p in points]
            )
            found = associate(landmarks, number, pose, plane, keyframe)
            if found is None:
                heading = pose[2] + np.arctan2(plane[1], plane[0])
                normal = np.array([np.cos(heading), np.sin(heading)])
                landmarks.append(Landmark(number, normal, plane[3] - normal @ pose[:2]))
                found = len(landmarks) - 1
            landmarks[found].points.append(mapped)
            landmarks[found].last_seen = keyframe
            seen.append((found, keyframe, plane))
    add_odometry(graph, motions)
    add_surfaces(graph, landmarks, seen)
    add_truth(graph, landmarks, sides)
    return graph, true


def add_odometry(graph: SGraph, motions: Array) -> None:
    """Add the measured motions."""
    turn, shift = ODOMETRY_SIGMAS
    sigmas = [1e-3, 1e-3, turn, shift, shift, 1e-3]
    for number, motion in enumerate(motions):
        graph.add_odometry(number, number + 1, as_row(motion), sigmas)


def add_surfaces(
    graph: SGraph, landmarks: list[Landmark], seen: list[tuple[int, int, Array]]
) -> None:
    """Put each surface where it was first observed, as long as all its points reach."""
    for number, landmark in enumerate(landmarks):
        tangent = np.array([-landmark.normal[1], landmark.normal[0]])
        reach = np.concatenate(landmark.points) @ tangent
        foot = -landmark.offset * landmark.normal
        segment = foot + np.outer([reach.min(), reach.max()], tangent)
        graph.add_wall_surface(number, segment, landmark.normal, [0.0, 2.6])
    for found, keyframe, plane in seen:
        graph.observe(found, keyframe, plane, PLANE_SIGMAS)


def add_truth(graph: SGraph, landmarks: list[Landmark], sides: list[Side]) -> None:
    """Label the mapped surfaces with what they were mapped of."""
    rooms = []
    for number, (name, outline) in enumerate(ROOMS.items()):
        own = [k for k, landmark in enumerate(landmarks) if sides[landmark.side].room == name]
        rooms.append(TrueRoom(number, name, tuple(own), tuple(outline)))
    walls = [
        (k, m)
        for k, one in enumerate(landmarks)
        for m, two in enumerate(landmarks)
        if k < m and back_to_back(sides[one.side], sides[two.side])
    ]
    graph.truth = Truth(tuple(rooms), tuple(walls))


def back_to_back(one: Side, two: Side) -> bool:
    """Return whether two sides as built belong to one wall, over at least 0.3 m."""
    if one.normal @ two.normal > -0.99:
        return False
    depth = one.normal @ (one.segment[0] - two.segment[0])
    tangent = np.array([-one.normal[1], one.normal[0]])
    reach = np.sort(one.segment @ tangent), np.sort(two.segment @ tangent)
    overlap = min(reach[0][1], reach[1][1]) - max(reach[0][0], reach[1][0])
    return bool(0 < depth < 0.4 and overlap >= 0.3)


def main() -> None:
    """Write the map and the true trajectory beside this file."""
    graph, true = draw()
    folder = Path(__file__).parent
    save(graph, folder / "office.json")
    rows = [[float(stamp), *as_row(pose)] for stamp, pose in enumerate(true)]
    header = "stamp x y z qx qy qz qw of the robot's true poses, TUM format"
    np.savetxt(folder / "office.tum", rows, fmt="%.6f", header=header)


if __name__ == "__main__":
    main()
