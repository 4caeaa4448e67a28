"""The drives that methods are compared on: the paper's scenes, and real logs."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path

from sgraph_concepts.errors import InputError
from sgraph_core.evaluation.slam.trial import Trial
from sgraph_core.frontend.building import Floor
from sgraph_core.frontend.carmen import CarmenLog, read_carmen, record
from sgraph_core.frontend.lidar import VLP16
from sgraph_core.frontend.odometry import DRIFT, Drift
from sgraph_core.frontend.recording import Recording
from sgraph_core.frontend.scenes import SCENES, scene
from sgraph_core.frontend.simulation import simulate

__all__ = ["Conditions", "Drive", "log_drives", "scene_drives"]


@dataclass(frozen=True)
class Conditions:
    """How hard a drive is.

    Attributes:
        drift_deg: standard deviation of odometry's heading, per square root of a metre.
        range_m: of the lidar; has no effect on logs.
        keyframe_m: distance between keyframes; likewise.

    Raises:
        InputError: one of them is not a positive number.
    """

    drift_deg: float = DRIFT.heading_deg
    range_m: float = VLP16.range_m
    keyframe_m: float = 1.0

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            if not (0 < value < math.inf):
                raise InputError(f"{name} = {value:g}: must be a positive number")

    def record(self, floor: Floor, seed: int) -> Recording:
        """Return a drive through a floor."""
        return simulate(
            floor,
            seed,
            keyframe_m=self.keyframe_m,
            lidar=replace(VLP16, range_m=self.range_m),
            drift=self._drift,
        )

    def record_log(self, log: CarmenLog, seed: int) -> Recording:
        """Return a log as a drive."""
        return record(log, seed, drift=self._drift)

    @property
    def _drift(self) -> Drift:
        return replace(DRIFT, heading_deg=self.drift_deg)


@dataclass(frozen=True)
class Drive:
    """A scene, or a log.

    Attributes:
        name: of the scene or log.
        conditions: how hard it is.
        log: the log's file, None for a scene.
        digest: of the log's content, empty for a scene.
    """

    name: str
    conditions: Conditions
    log: Path | None = None
    digest: str = ""

    @property
    def key(self) -> str:
        """What its results are kept under."""
        return f"{self.name}-{self.digest}" if self.digest else self.name

    @property
    def has_truth(self) -> bool:
        """Whether its true rooms and walls are known."""
        return self.log is None

    def trial(self, seed: int) -> Trial:
        """Record the drive; equal seeds give equal ones.

        Raises:
            InputError: the log cannot be read, the robot hardly moves, or it sees no wall surfaces.
        """
        if self.log is None:
            return Trial(self.conditions.record(scene(self.name), seed), seed)
        recording = self.conditions.record_log(_read(self.log), seed)
        if not any(map(len, recording.observations)):
            raise InputError(f"{self.log}: no wall surface is found in the scans of its keyframes")
        return Trial(recording, seed)


_read = cache(read_carmen)


def scene_drives(names: Sequence[str], conditions: Conditions) -> list[Drive]:
    """Return the drives through scenes of the given names, through all of them if none is given.

    Raises:
        InputError: there is no such scene.
    """
    return [Drive(scene(name).name, conditions) for name in dict.fromkeys(names or SCENES)]


def log_drives(files: Sequence[Path], conditions: Conditions) -> list[Drive]:
    """Return the drives of Carmen logs.

    Raises:
        InputError: a log cannot be read, or two have the same name.
    """
    drives: dict[str, Drive] = {}
    for file in files:
        name = read_carmen(file).name
        if name in drives:
            raise InputError(f"{file}: another log is called {name!r} too: rename one")
        digest = hashlib.sha256(file.read_bytes()).hexdigest()[:8]
        drives[name] = Drive(name, conditions, file, digest)
    return list(drives.values())
