"""The drives that methods are compared on: the paper's scenes, and real logs."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from sgraph_core.evaluation.slam.trial import Trial
from sgraph_core.frontend.scenes import SCENES, scene
from sgraph_core.frontend.simulation import simulate

__all__ = ["Drive", "scene_drives"]


@dataclass(frozen=True)
class Drive:
    """A scene, or a log.

    Attributes:
        name: of the scene or log.
        log: the log's file, None for a scene.
    """

    name: str
    log: Path | None = None

    @property
    def has_truth(self) -> bool:
        """Whether its true rooms and walls are known."""
        return self.log is None

    def trial(self, seed: int) -> Trial:
        """Record the drive; equal seeds give equal ones."""
        return Trial(simulate(scene(self.name), seed), seed)


def scene_drives(names: list[str] | None = None) -> list[Drive]:
    """Return the drives through scenes of the given names, through all by default.

    Raises:
        InputError: there is no such scene.
    """
    return [Drive(scene(name).name) for name in names or SCENES]
