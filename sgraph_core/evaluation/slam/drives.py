"""The drives that methods are compared on: the paper's scenes, and real logs."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from sgraph_concepts.errors import InputError
from sgraph_core.evaluation.slam.trial import Trial
from sgraph_core.frontend.carmen import read_carmen, record
from sgraph_core.frontend.scenes import SCENES, scene
from sgraph_core.frontend.simulation import simulate

__all__ = ["Drive", "log_drives", "scene_drives"]


@dataclass(frozen=True)
class Drive:
    """A scene, or a log.

    Attributes:
        name: of the scene or log.
        log: the log's file, None for a scene.
        digest: of the log's content, empty for a scene.
    """

    name: str
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
            InputError: the log cannot be read, or the robot hardly moves.
        """
        if self.log is None:
            return Trial(simulate(scene(self.name), seed), seed)
        return Trial(record(_read(self.log), seed), seed)


_read = cache(read_carmen)


def scene_drives(names: Sequence[str] = ()) -> list[Drive]:
    """Return the drives through scenes of the given names, through all of them by default.

    Raises:
        InputError: there is no such scene.
    """
    return [Drive(scene(name).name) for name in dict.fromkeys(names or SCENES)]


def log_drives(files: Sequence[Path]) -> list[Drive]:
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
        drives[name] = Drive(name, file, digest)
    return list(drives.values())
