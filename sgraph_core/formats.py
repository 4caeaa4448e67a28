"""The formats that maps come in. A further format is one entry of ``FORMATS``."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from sgraph_concepts.errors import InputError
from sgraph_core import map_file
from sgraph_core.graph import SGraph

__all__ = ["FORMATS", "Format", "Progress", "check_outputs", "load"]

Progress = Callable[[str, int, int], object]
"""Told what is being done, how much of it is done, and how much there is."""


@dataclass(frozen=True)
class Format:
    """A map format other than sgraph-map JSON.

    Attributes:
        suffixes: of its files, in lower case.
        load: returns the S-Graph of a file.
        files: returns all files that a map consists of.
    """

    suffixes: tuple[str, ...]
    load: Callable[[Path, Progress], SGraph]
    files: Callable[[Path], Iterable[Path]]


def load(path: str | Path, progress: Progress = lambda _what, _done, _total: None) -> SGraph:
    """Read a map of any supported format: its suffix tells which; others are sgraph-map JSON.

    Args:
        path: the file.
        progress: told how far long work is.

    Raises:
        MapFileError: the file cannot be read or breaks a rule of its format.

    Warns:
        MapWarning: the map can be read and looks wrong.
    """
    known = _format_of(path)
    return map_file.load(path) if known is None else known.load(Path(path), progress)


def check_outputs(path: str | Path, outputs: Sequence[Path], beside: Sequence[Path] = ()) -> None:
    """Check before the work that its outputs replace neither one another nor the map.

    A sgraph-map JSON file may be replaced: what is written holds all that it held.

    Args:
        path: the map.
        outputs: files that a person named.
        beside: files that will be written beside them.

    Raises:
        InputError: two outputs are one file; or one is a file of a map in another format, or named
            like one.
        MapFileError: the map cannot be read.
    """
    known = _format_of(path)
    inputs = [] if known is None else [file.resolve() for file in known.files(Path(path))]
    for output in (*outputs, *beside):
        if output.resolve() in inputs:
            raise InputError(f"{output}: belongs to the map that is read, and is not replaced")
    written = [output.resolve() for output in (*outputs, *beside)]
    for output in (*outputs, *beside):
        if written.count(output.resolve()) > 1:
            raise InputError(f"{output}: would be written twice: name two files")
    for output in outputs:
        named = _format_of(output)
        if named is not None:
            suffixes = ", ".join(named.suffixes)
            raise InputError(f"{output}: is written as JSON, so it must not end in {suffixes}")


def _format_of(path: str | Path) -> Format | None:
    suffix = Path(path).suffix.lower()
    return next((known for known in FORMATS if suffix in known.suffixes), None)


def _load_grid(path: Path, progress: Progress) -> SGraph:
    from sgraph_core.grid.extraction import extract
    from sgraph_core.grid.reader import read_grid

    return extract(read_grid(path, progress), path.stem, progress=progress)


def _grid_files(path: Path) -> Iterable[Path]:
    from sgraph_core.grid.reader import grid_files

    return grid_files(path)


FORMATS = (Format((".yaml", ".yml"), _load_grid, _grid_files),)
