"""How long an incremental update takes, and how that depends on the size of the map."""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Iterator, Sequence
from dataclasses import astuple, dataclass
from itertools import pairwise

import numpy as np

from sgraph_concepts.types import FloatArray
from sgraph_core.backend.keys import Keys
from sgraph_core.detector import Detector
from sgraph_core.graph import SGraph
from sgraph_core.slam import ConceptTracker, Work
from sgraph_core.slam.smoother import Smoother

__all__ = ["ROOMS", "UpdateTimes", "Visit", "drive_through", "time_updates"]

ROOMS = (20, 100, 1000)
ROOM_M = (5.0, 4.0)
WALL_M = 0.15
DOOR_M = 0.9
UNEVEN_M = 0.01
"""How far surfaces lie off the plan, as a standard deviation: maps have no exact ties."""
STEP_SIGMAS = (1e-3, 1e-3, 1e-3, 0.01, 0.01, 0.01)
PLANE_SIGMAS = (0.01, 0.02)
TIMED_ROOMS = 5
"""The updates in so many rooms at the end of the drive are timed."""

Surface = tuple[int, FloatArray, FloatArray]


@dataclass(frozen=True)
class Visit:
    """One keyframe of a drive.

    Attributes:
        keyframe: its id.
        position: where it is, [2]; it looks along x.
        surfaces: id, segment and normal of the wall surfaces that it sees first.
    """

    keyframe: int
    position: FloatArray
    surfaces: list[Surface]

    def enter(self, target: SGraph | ConceptTracker, before: Visit | None) -> None:
        """Add the keyframe, the motion since the one before, and what it sees."""
        still = (0.0, 0.0, 0.0, 0.0, 1.0)
        target.add_keyframe(self.keyframe, [*self.position, *still])
        if before is not None:
            step = self.position - before.position
            target.add_odometry(before.keyframe, self.keyframe, [*step, *still], STEP_SIGMAS)
        for surface, segment, normal in self.surfaces:
            target.add_wall_surface(surface, segment, normal)
            distance = float(normal @ (self.position - segment[0]))
            target.observe(surface, self.keyframe, [*normal, 0.0, distance], PLANE_SIGMAS)


def drive_through(rooms: int, columns: int | None = None, seed: int = 0) -> list[Visit]:
    """Return a drive through a grid of rooms, row by row and back, two keyframes a room.

    Consecutive rooms are joined by a door. The first keyframe in a room sees half of its surfaces.

    Args:
        rooms: how many.
        columns: rooms in a row; about as many as rows by default.
        seed: of doors and unevenness.
    """
    rng = np.random.default_rng(seed)
    columns = columns or math.ceil(math.sqrt(rooms))
    places = [_place(number, columns) for number in range(rooms)]
    pitch = np.array(ROOM_M) + WALL_M
    doors = {frozenset(ends): float(rng.uniform(-0.8, 0.8)) for ends in pairwise(places)}
    visits: list[Visit] = []
    surface = 0
    for place in places:
        corner = pitch * place
        found = []
        for segment, normal in _sides(place, corner, doors):
            off = rng.normal(0, UNEVEN_M) * normal
            found.append((surface, segment + off, normal))
            surface += 1
        half = len(found) // 2
        for share, some in ((0.4, found[:half]), (0.6, found[half:])):
            visits.append(Visit(len(visits), corner + share * np.array(ROOM_M), some))
    return visits


def _place(number: int, columns: int) -> tuple[int, int]:
    row, column = divmod(number, columns)
    return (column if row % 2 == 0 else columns - 1 - column), row


def _sides(
    place: tuple[int, int], corner: FloatArray, doors: dict[frozenset[tuple[int, int]], float]
) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Yield segment and normal of a room's wall surfaces; a door divides its side in two."""
    corners = corner + np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * ROOM_M
    beyond = ((0, -1), (1, 0), (0, 1), (-1, 0))
    for side, (x, y) in enumerate(beyond):
        ends = corners[[side, (side + 1) % 4]]
        along = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
        normal = np.array([-along[1], along[0]])
        door = doors.get(frozenset({place, (place[0] + x, place[1] + y)}))
        if door is None:
            yield ends, normal
        else:
            middle = ends.mean(axis=0) + door * np.abs(along)
            yield np.array([ends[0], middle - DOOR_M / 2 * along]), normal
            yield np.array([middle + DOOR_M / 2 * along, ends[1]]), normal


@dataclass(frozen=True)
class UpdateTimes:
    """Median seconds of an update, one a keyframe, in a map of some size.

    Attributes:
        rooms: of the map.
        inference: ``ConceptTracker.update``.
        optimisation: the update of ISAM2 that takes its factors.
        whole: inferring the whole map anew instead.
        work: what an update computed, on average.
    """

    rooms: int
    inference: float
    optimisation: float
    whole: float
    work: Work


def time_updates(
    detector: Detector, rooms: Sequence[int], seed: int, repeats: int
) -> Iterator[list[UpdateTimes]]:
    """Time updates at the end of drives through grids of rooms.

    Updates of all sizes take turns, so that a machine whose speed drifts is as fast for each.

    Args:
        detector: infers the concepts.
        rooms: sizes of the grids.
        seed: of the first grids' doors and unevenness; those of each repeat get the next one.
        repeats: how many drives there are of each size.

    Yields:
        The times of each size, of all repeats so far.
    """
    measured: list[list[_Measured]] = [[] for _ in rooms]
    whole: list[list[float]] = [[] for _ in rooms]
    for repeat in range(repeats):
        drives = [_Drive.near_the_end(detector, count, seed + repeat) for count in rooms]
        for _ in range(2 * TIMED_ROOMS):
            for drive, steps in zip(drives, measured, strict=True):
                steps.extend(drive.next_step())
        for drive, seconds in zip(drives, whole, strict=True):
            start = time.perf_counter()
            detector.infer(drive.graph)
            seconds.append(time.perf_counter() - start)
        yield [_summed_up(*each) for each in zip(rooms, measured, whole, strict=True)]


_Measured = tuple[float, float, Work]
"""Seconds of an update, seconds of ISAM2's, and the work."""


def _summed_up(count: int, steps: Sequence[_Measured], whole: Sequence[float]) -> UpdateTimes:
    inference, optimisation, work = zip(*steps, strict=True)
    mean = np.mean([astuple(some) for some in work], axis=0)
    return UpdateTimes(
        count,
        statistics.median(inference),
        statistics.median(optimisation),
        statistics.median(whole),
        Work(*np.rint(mean).astype(int).tolist()),
    )


@dataclass(frozen=True, eq=False)
class _Drive:
    """A map, the tracker of its concepts, and the ISAM2 that takes the factors of both.

    Attributes:
        graph: the map.
        tracker: of its concepts.
        smoother: ISAM2.
        ahead: the keyframes to come, each with the one before.
    """

    graph: SGraph
    tracker: ConceptTracker
    smoother: Smoother
    ahead: Iterator[tuple[Visit, Visit]]

    @classmethod
    def near_the_end(cls, detector: Detector, count: int, seed: int) -> _Drive:
        """Return a drive through a grid of rooms that is still to see the last few."""
        visits = drive_through(count, seed=seed)
        first = len(visits) - 2 * min(TIMED_ROOMS, count - 1)
        ahead = pairwise(visits[first - 1 :])
        drive = cls(SGraph(), ConceptTracker(detector=detector), Smoother(Keys()), ahead)
        for k, visit in enumerate(visits[:first]):
            drive._enter(visit, visits[k - 1] if k else None)
        drive._update()
        return drive

    def next_step(self) -> list[_Measured]:
        """Go to the next keyframe and update; return what that took, nothing at the end."""
        step = next(self.ahead, None)
        if step is None:
            return []
        before, visit = step
        self._enter(visit, before)
        return [self._update()]

    def _enter(self, visit: Visit, before: Visit | None) -> None:
        for target in (self.graph, self.tracker):
            visit.enter(target, before)

    def _update(self) -> _Measured:
        start = time.perf_counter()
        update = self.tracker.update()
        inferred = time.perf_counter()
        self.smoother.check(self.graph)
        self.tracker.placed(self.smoother.add(self.graph, update))
        return inferred - start, time.perf_counter() - inferred, update.work
