"""Carmen logs: the scans and corrected poses of real robots.

Read are the messages ``FLASER`` (the old format) and ``ROBOTLASER1``:

    FLASER n r_1 .. r_n x y theta odom_x odom_y odom_theta time host logger_time
    ROBOTLASER1 type start fov step max accuracy remission n r_1 .. r_n m e_1 .. e_m
        laser_x laser_y laser_theta x y theta tv rv ... time host logger_time

The pose taken is that of the laser: ``x y theta`` of FLASER, ``laser_x laser_y laser_theta`` of
ROBOTLASER1. In the logs that are handed around, a mapping program has corrected these poses, so
they are the reference. Their odometry is often corrected too, so it is drawn by
:mod:`.odometry` instead.

A FLASER scan looks ahead over 180 degrees (with 401 ranges over 100 degrees) from right to left;
its steps are n, or n - 1 where n is odd. ROBOTLASER1 says where its beams go.
"""

from __future__ import annotations

import gzip
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sgraph_concepts.errors import InputError
from sgraph_concepts.types import FloatArray, IntArray
from sgraph_core.frontend.odometry import DRIFT, Drift, drifting_odometry
from sgraph_core.frontend.planar import as_rows, between
from sgraph_core.frontend.recording import Recording
from sgraph_core.frontend.surfaces import EXTRACTION, Extraction, Scan, extract_surfaces
from sgraph_core.geometry import origin_near
from sgraph_core.tables import LARGEST_COORDINATE_M

__all__ = ["CarmenLog", "read_carmen", "record"]

KEYFRAME_M, KEYFRAME_RAD = 0.5, np.radians(20.0)
"""A scan becomes a keyframe when the robot has moved or turned this far since the last one."""
FARTHEST_M = 30.0
"""Longer ranges, and such at a ROBOTLASER1's own maximum, mean that nothing was hit."""
NEAREST_M = 0.05
MOST_BEAMS = 10_000
BEAMS_OF_100_DEGREES = 401
LONGEST_LINE = 1_000_000
GZIP = b"\x1f\x8b"
"""What compressed logs begin with."""
LARGEST_NUMBER = 1e12
FEWEST_KEYFRAMES = 2


@dataclass(frozen=True, eq=False)
class CarmenLog:
    """The S scans of a log, as they are.

    Attributes:
        name: of the log.
        stamps: the logger's time, in seconds, [S].
        poses: of the laser, x, y, theta, [S, 3].
        scans: end points of the beams that hit something, in the laser's frame, right to left,
            [P_s, 2] each.
    """

    name: str
    stamps: FloatArray
    poses: FloatArray
    scans: tuple[FloatArray, ...]


def read_carmen(path: str | Path) -> CarmenLog:
    """Read a Carmen log, which may be compressed by gzip.

    Of a log that holds both kinds of messages, the kind that comes first is read. Lines of other
    messages are passed over.

    Raises:
        InputError: the file cannot be read or is damaged, holds no scans or only such that hit
            nothing, or a scan's message holds a wrong number of fields or something other than
            finite numbers.
    """
    kind, stamps, poses, scans = "", [], [], []
    for number, line in _lines(Path(path)):
        fields = line.split()
        if fields and fields[0] in _READERS and kind in ("", fields[0]):
            kind = fields[0]
            try:
                stamp, pose, points = _READERS[kind](fields[1:])
            except ValueError as error:
                raise InputError(f"{path}: line {number}: {kind}: {error}") from None
            stamps.append(stamp)
            poses.append(pose)
            scans.append(points)
    if not scans:
        raise InputError(f"{path}: is no Carmen log: it holds no {' or '.join(_READERS)} message")
    if not any(map(len, scans)):
        raise InputError(f"{path}: no scan hits anything from {NEAREST_M:g} to {FARTHEST_M:g} m")
    name = Path(path).name.removesuffix(".gz").removesuffix(".log")
    return CarmenLog(name, np.array(stamps), np.array(poses), tuple(scans))


def record(
    log: CarmenLog, seed: int, *, drift: Drift = DRIFT, extraction: Extraction = EXTRACTION
) -> Recording:
    """Return a log's keyframes as a recording with drifting odometry of a seed.

    A keyframe is taken every 0.5 m or 20 degrees. The reference begins within 100 m of the origin:
    a log in UTM coordinates is shifted by whole hundreds of metres. Stamps are the logger's where
    they ascend, else they count the keyframes: some logs hold times of too few digits.

    Raises:
        InputError: the robot hardly moves, so that there is only one keyframe.
    """
    rows = _keyframes(log.poses)
    if len(rows) < FEWEST_KEYFRAMES:
        raise InputError(f"{log.name}: the robot does not move {KEYFRAME_M:g} m or 20 degrees")
    poses, stamps = log.poses[rows], log.stamps[rows]
    poses[:, :2] -= origin_near(poses[:1, :2])
    odometry, sigmas = drifting_odometry(poses, drift, np.random.default_rng(seed))
    scans = tuple(log.scans[row] for row in rows)
    return Recording(
        name=log.name,
        stamps=stamps if (np.diff(stamps) > 0).all() else np.arange(len(rows), dtype=np.float64),
        odometry=odometry,
        odometry_sigmas=sigmas,
        reference=as_rows(poses),
        scans=scans,
        observations=tuple(extract_surfaces(Scan.flat(scan), extraction) for scan in scans),
    )


def _keyframes(poses: FloatArray) -> IntArray:
    """Return the rows of scans far enough from the keyframe before."""
    rows = [0]
    for row in range(1, len(poses)):
        motion = between(poses[rows[-1]], poses[row])
        if np.hypot(*motion[:2]) >= KEYFRAME_M or abs(motion[2]) >= KEYFRAME_RAD:
            rows.append(row)
    return np.array(rows)


def _lines(path: Path) -> Iterator[tuple[int, str]]:
    """Yield the numbered lines of a file; a line that is too long ends with an error."""
    try:
        with path.open("rb") as content:
            packed = path.suffix == ".gz" or content.peek(2).startswith(GZIP)
            file = gzip.GzipFile(fileobj=content) if packed else content
            number = 0
            while line := file.readline(LONGEST_LINE):
                number += 1
                if len(line) == LONGEST_LINE:
                    raise InputError(f"{path}: line {number}: must be under {LONGEST_LINE} bytes")
                yield number, line.decode("latin-1")
    except (EOFError, OSError, zlib.error) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError(f"{path}: cannot be read: {reason}") from None


_Message = tuple[float, FloatArray, FloatArray]
"""Stamp, pose [3] and end points [P, 2] of a scan."""


def _flaser(fields: list[str]) -> _Message:
    count = _count("number of ranges", fields[:1])
    _need(fields, 1 + count + 9)
    ranges, pose = _numbers(fields, 1, count), _pose(fields, 1 + count)
    field_of_view = 100.0 if count == BEAMS_OF_100_DEGREES else 180.0
    steps = max(count - count % 2, 1)  # 180 and 181 ranges are both one degree apart
    angles = np.radians(field_of_view) * (np.arange(count) / steps - 0.5)
    (stamp,) = _numbers(fields, count + 9, 1)
    return stamp, pose, _points(ranges, angles, FARTHEST_M)


def _robotlaser(fields: list[str]) -> _Message:
    _need(fields, 8)
    start, _, step, farthest = _numbers(fields, 1, 4)
    count = _count("number of ranges", fields[7:8])
    _need(fields, 8 + count + 1)
    remissions = _count("number of remissions", fields[8 + count : 9 + count])
    first = 9 + count + remissions
    _need(fields, first + 14)
    angles = start + step * np.arange(count)
    ranges = _numbers(fields, 8, count)
    (stamp,) = _numbers(fields, first + 13, 1)
    pose = _pose(fields, first)
    return stamp, pose, _points(ranges, angles, min(farthest, FARTHEST_M))


_READERS = {"FLASER": _flaser, "ROBOTLASER1": _robotlaser}


def _points(ranges: FloatArray, angles: FloatArray, farthest: float) -> FloatArray:
    hit = (ranges > NEAREST_M) & (ranges < farthest)
    rays = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return np.asarray((ranges[:, None] * rays)[hit])


def _count(name: str, fields: list[str]) -> int:
    text = fields[0] if fields else ""
    if not text.isascii() or not text.isdigit() or len(text) > 6 or int(text) > MOST_BEAMS:
        raise ValueError(f"{name} = {text[:20]!r}: must be an integer up to {MOST_BEAMS}")
    return int(text)


def _need(fields: list[str], count: int) -> None:
    if len(fields) < count:
        raise ValueError(f"holds {len(fields)} fields: must hold {count} or more")


def _numbers(fields: list[str], first: int, count: int) -> FloatArray:
    texts = fields[first : first + count]
    try:
        values = np.array(texts, np.float64)
    except ValueError:
        values = np.array([_number(text) for text in texts])
    bad = np.flatnonzero(~(np.abs(values) <= LARGEST_NUMBER))
    if len(bad):
        field, text = first + bad[0] + 2, texts[bad[0]]  # counted from 1, the message's name too
        raise ValueError(
            f"field {field} = {text[:20]!r}: ranges, angles, poses and times "
            f"must be finite numbers up to {LARGEST_NUMBER:g}"
        )
    return values


def _number(text: str) -> float:
    """Return a text's number, NaN if it is none."""
    try:
        return float(text)
    except ValueError:
        return np.nan


def _pose(fields: list[str], first: int) -> FloatArray:
    pose = _numbers(fields, first, 3)
    if (np.abs(pose[:2]) > LARGEST_COORDINATE_M).any():
        x, y = pose[:2].tolist()
        raise ValueError(f"pose at ({x:g}, {y:g}): must be within {LARGEST_COORDINATE_M:g} m")
    return pose
