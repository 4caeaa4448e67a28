"""Which maps are scored together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from sgraph_concepts.errors import InputError

__all__ = ["Source", "find_sources"]


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
            passed over, so that one list serves several folders.

    Raises:
        InputError: a folder holds no map, a list cannot be read, or none of its names is there.
    """
    names = {file: _read_list(file) for file in lists}
    sources = []
    for path in paths:
        maps = _maps_in(path)
        if not lists:
            sources.append(Source(path.stem, maps))
        for file, wanted in names.items():
            chosen = tuple(file for file in maps if file.stem in wanted)
            if not chosen:
                raise InputError(f"{path}: holds none of the maps that {file} names")
            sources.append(Source(f"{path.stem} ({file.stem})", chosen))
    return sources


def _maps_in(path: Path) -> tuple[Path, ...]:
    if not path.is_dir():
        return (path,)
    files = tuple(sorted(path.glob("*.json")))
    if not files:
        raise InputError(f"{path}: holds no .json file")
    return files


def _read_list(file: Path) -> set[str]:
    try:
        lines = file.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{file}: is no readable list of maps: {error}") from error
    return {line.strip() for line in lines if not line.startswith("#")} - {""}
