"""What one method made of one drive, and where that is kept."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, ValidationError

from sgraph_concepts.errors import InputError
from sgraph_core.evaluation.scores import Counts
from sgraph_core.files import write_whole

__all__ = ["Result", "Store"]


class Result(BaseModel):
    """One method on one drive.

    Attributes:
        drive: the scene or log.
        seed: of the drive.
        variant: the method.
        ate_m: RMSE of the trajectory after rigid alignment.
        map_m: RMSE of mapped surface points to the true surfaces.
        rooms: matched at Jaccard index 0.5 or more; None without truth or without rooms.
        walls: likewise, pairs of surfaces.
        first_room_s: from the start of the drive until the first right room is found (any room
            where there is no truth); None if none ever is.
        update_ms: median time of a detection while the map grows; None if nothing is detected.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    drive: str
    seed: int
    variant: str
    ate_m: float
    map_m: float
    rooms: Counts | None = None
    walls: Counts | None = None
    first_room_s: float | None = None
    update_ms: float | None = None


class Store:
    """Results in a folder, one file each.

    Args:
        folder: is made if it is not there.
        settings: what the results depend on besides drive, seed and variant, JSON values.

    Raises:
        InputError: the folder holds results of other settings.
    """

    def __init__(self, folder: Path, settings: Mapping[str, Any]) -> None:
        self._folder = folder
        self.settings = settings
        self._claim(json.dumps(settings, indent=1) + "\n")

    def _claim(self, text: str) -> None:
        file = self._folder / "settings.json"
        self._folder.mkdir(parents=True, exist_ok=True)
        if not file.exists():
            write_whole(file, lambda temporary: temporary.write_text(text))
        elif file.read_text() != text:
            raise InputError(
                f"{self._folder}: holds results of other settings or another version of the code: "
                "remove it, or name another folder"
            )

    def get(self, drive: str, seed: int, variant: str) -> Result | None:
        """Return a result, if it is there.

        Args:
            drive: the drive's key.
            seed: of the drive.
            variant: the method.

        Raises:
            InputError: its file is damaged.
        """
        file = self._file(drive, seed, variant)
        if not file.exists():
            return None
        try:
            return Result.model_validate_json(file.read_bytes())
        except ValidationError as error:
            raise InputError(f"{file}: is no result of this benchmark: remove it") from error

    def put(self, drive: str, result: Result) -> None:
        """Write a result, whole."""
        file = self._file(drive, result.seed, result.variant)
        file.parent.mkdir(parents=True, exist_ok=True)
        text = result.model_dump_json(indent=1) + "\n"
        write_whole(file, lambda temporary: temporary.write_text(text))

    def _file(self, drive: str, seed: int, variant: str) -> Path:
        return self._folder / drive / f"{seed:04d}" / f"{re.sub(r'[^a-z]+', '-', variant)}.json"
