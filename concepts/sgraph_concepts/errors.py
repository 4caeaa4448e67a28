"""The errors of S-Graph Concepts, a leaf module that every other one may import.

::

    SGraphError                  anything a caller may want to catch; its text is one line
    ├── MapFileError             a map file: path, place inside it, value, rule
    ├── InputError               an argument or an S-Graph that breaks a documented rule
    ├── ConceptError             a concept's declaration, or what one of its parts returned
    ├── PluginError              an entry point that could not be loaded
    ├── WeightsError             network weights that are absent or of another encoder
    ├── OptimizationError        a factor graph that cannot be solved
    ├── TrainingError            training that cannot go on
    └── MissingExtraError        an optional dependency that is not installed
    MapWarning                   a warning: a map that can be read and looks wrong
"""

from __future__ import annotations

from collections.abc import Callable

__all__ = [
    "ConceptError",
    "InputError",
    "MapFileError",
    "MapWarning",
    "MissingExtraError",
    "OptimizationError",
    "PluginError",
    "SGraphError",
    "TrainingError",
    "WeightsError",
    "one_line",
    "shorten",
]

_LONGEST_VALUE = 80


class SGraphError(Exception):
    """Base of all errors raised on purpose by this project."""


class InputError(SGraphError, ValueError):
    """An argument or an S-Graph breaks a documented rule."""


class MapFileError(SGraphError):
    """A map file that cannot be read.

    Attributes:
        path: the file.
        place: where inside the file, such as ``wall_surfaces[3].normal``; empty for the whole file.
        value: the offending value as text, shortened; empty where there is none to show.
        rule: what the format asks for.
    """

    def __init__(self, path: object, place: str, value: object, rule: str) -> None:
        self.path = str(path)
        self.place = place
        self.value = "" if value is None else shorten(value)
        self.rule = rule
        where = f"{place} = {self.value}" if place and self.value else place or self.value
        super().__init__(": ".join(part for part in (self.path, where, rule) if part))


class MapWarning(UserWarning):
    """A map can be read and looks wrong; the text is one line."""


class ConceptError(SGraphError):
    """A concept's declaration breaks a rule, or one of its parts returned nonsense."""


class PluginError(SGraphError):
    """An entry point that could not be loaded."""


class WeightsError(SGraphError):
    """Network weights that are absent, damaged, or of another encoder or feature version."""


class OptimizationError(SGraphError):
    """A factor graph that cannot be solved."""


class TrainingError(SGraphError):
    """Training that cannot start or go on."""


class MissingExtraError(SGraphError, ImportError):
    """An optional dependency is absent; the text names the extra that installs it."""

    def __init__(self, package: str, extra: str) -> None:
        super().__init__(
            f"{package} is not installed: pip install 'sgraph-concepts[{extra}]' brings it"
        )


def shorten(value: object, show: Callable[[object], str] = str) -> str:
    """Return a value as errors show it: in one line, and not in too long a one."""
    try:
        text = " ".join(show(value).split())
    except ValueError:  # an integer of more digits than Python prints
        return "..."
    return text if len(text) <= _LONGEST_VALUE else f"{text[: _LONGEST_VALUE - 3]}..."


def one_line(error: BaseException) -> str:
    """Return the text of an error that somebody else's code raised, in one line."""
    return " ".join(str(error).split()) or "no message"
