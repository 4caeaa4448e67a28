"""Settings from JSON files."""

from __future__ import annotations

from importlib.resources.abc import Traversable
from typing import TypeVar

from pydantic import BaseModel, ValidationError

from sgraph_concepts.errors import InputError

__all__ = ["read_settings"]

Settings = TypeVar("Settings", bound=BaseModel)


def read_settings(path: Traversable | None, kind: type[Settings]) -> Settings:
    """Return settings from a JSON file; what it does not name, or no file, means the defaults.

    Raises:
        InputError: the file cannot be read or breaks a rule of the settings.
    """
    if path is None:
        return kind()
    try:
        return kind.model_validate_json(path.read_bytes())
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error
    except ValidationError as error:
        problem = error.errors(include_url=False)[0]
        place = ".".join(map(str, problem["loc"]))
        parts = (str(path), place, problem["msg"])
        raise InputError(": ".join(part for part in parts if part)) from error
