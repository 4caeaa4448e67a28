"""Which maps are scored together, and what they are scored against."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from sgraph_concepts.errors import InputError
from sgraph_core.graph import SGraph, Truth
from sgraph_core.map_file import load

__all__ = ["Source", "absent_names", "find_sources", "load_with_truth", "read_list"]


@dataclass(frozen=True)
class Source:
    """Maps that are scored together.

    Attributes:
        name: of the folder or file, and of the list that chose from it.
        files: the maps.
    """

    name: str
    files: tuple[Path, ...]


def find_sources(paths: Sequence[Path], lists: Sequence[Path] = ()) -> list[Source]:
    """Return the maps that paths name: each path a source, or each list's part of each path.

    Args:
        paths: map files, or folders of them.
        lists: text files with the name of a map (its file's name without suffix) per line; empty
            lines and lines that begin with # do not count. Names of maps that are not there are
            passed over, so that one list serves several folders; see :func:`absent_names`.

    Raises:
        InputError: a folder holds no map, a list cannot be read, or none of its names is there.
    """
    names = {file: read_list(file) for file in lists}
    sources = []
    for path in paths:
        maps, name = _maps_in(path), path.absolute().stem
        if not lists:
            sources.append(Source(name, maps))
        for file, wanted in names.items():
            chosen = tuple(file for file in maps if file.stem in wanted)
            if not chosen:
                raise InputError(f"{path}: holds none of the maps that {file} names")
            sources.append(Source(f"{name} ({file.stem})", chosen))
    return sources


def absent_names(paths: Sequence[Path], lists: Sequence[Path]) -> dict[Path, list[str]]:
    """Return the names that are of no map in any of the paths, sorted, by the list they stand in.

    Raises:
        InputError: as :func:`find_sources` does.
    """
    there = {file.stem for source in find_sources(paths, lists) for file in source.files}
    absent = {file: sorted(read_list(file) - there) for file in lists}
    return {file: names for file, names in absent.items() if names}


def load_with_truth(file: Path) -> tuple[SGraph, Truth]:
    """Read a map that can be scored.

    Raises:
        InputError: the map has no truth.
        MapFileError: the map cannot be read.
    """
    graph = load(file)
    if graph.truth is None:
        raise InputError(f"{file}: has no truth to evaluate against")
    return graph, graph.truth


def _maps_in(path: Path) -> tuple[Path, ...]:
    if not path.is_dir():
        return (path,)
    files = tuple(sorted(path.glob("*.json")))
    if not files:
        raise InputError(f"{path}: holds no .json file")
    return files


def read_list(file: Path) -> set[str]:
    """Return the names of maps that a text file lists.

    Raises:
        InputError: it cannot be read.
    """
    try:
        text = file.read_text(encoding="utf-8-sig")  # editors may put a byte order mark first
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{file}: is no readable list of maps: {error}") from error
    names = {line.strip() for line in text.splitlines()}
    return {name for name in names if name and not name.startswith("#")}
