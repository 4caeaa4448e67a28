"""The YAML file of a ROS map_server map: what it may say, and reading it without trusting it."""

from __future__ import annotations

import json
import math
import re
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

import yaml

from sgraph_concepts.errors import MapFileError
from sgraph_core.tables import LARGEST_COORDINATE_M

__all__ = ["GridDescription", "Mode", "read_description", "shown"]

LARGEST_YAML_BYTES = 2**16
"""map_server's files have 150 bytes; this leaves room for comments and other programs' keys."""
DEEPEST_NESTING = 8
"""The origin's list is nested two deep; other programs' keys may go deeper, recursion may not."""
FINEST_RESOLUTION_M = 1e-3
"""No robot maps finer, and what the extraction of surfaces looks at grows with finer cells."""
COARSEST_RESOLUTION_M = 1.0
"""A wider cell is as wide as a doorway: the number is probably not in metres."""

REQUIRED = ("image", "resolution", "origin", "negate", "occupied_thresh", "free_thresh")
KNOWN = (*REQUIRED, "mode")
NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?")
INTEGER = re.compile(r"[+-]?[0-9]+")
TRUE, FALSE = {"true", "yes", "on", "y"}, {"false", "no", "off", "n"}

Tree = str | list["Tree"] | dict[str, "Tree"]
"""YAML without its types: every scalar is text."""


class Mode(StrEnum):
    """How map_server turns brightness into occupancy."""

    TRINARY = "trinary"
    SCALE = "scale"
    RAW = "raw"


@dataclass(frozen=True)
class GridDescription:
    """What the YAML file says.

    Attributes:
        image: the image file; a relative path is relative to the YAML file's folder.
        resolution: side of a pixel in metres.
        origin: pose of the lower-left pixel's corner: x, y in metres, yaw in radians.
        negate: whether bright pixels are occupied.
        occupied_thresh, free_thresh: a cell is occupied above the one and free below the other.
        mode: how brightness becomes occupancy.
        unknown: keys that are not map_server's. They are not read, as map_server does not.
    """

    image: Path
    resolution: float
    origin: tuple[float, float, float]
    negate: bool
    occupied_thresh: float
    free_thresh: float
    mode: Mode
    unknown: tuple[str, ...] = ()


def read_description(path: str | Path) -> GridDescription:
    """Read the YAML file of a map_server map. The image is not looked at.

    Nothing in the file is constructed but text, lists and mappings; tags, anchors and aliases are
    refused.

    Raises:
        MapFileError: the file cannot be read or breaks a rule.
    """
    document = _parse(_read_text(path), path)
    for key in REQUIRED:
        if key not in document:
            raise MapFileError(path, key, None, "is required")
    return _Checks(path, document).description()


def _read_text(path: str | Path) -> str:
    try:
        with Path(path).open("rb") as file:
            data = file.read(LARGEST_YAML_BYTES + 1)
    except OSError as error:
        raise MapFileError(path, "", None, f"cannot be read: {error.strerror}") from error
    if len(data) > LARGEST_YAML_BYTES:
        rule = f"is no map_server YAML: it has more than {LARGEST_YAML_BYTES} bytes"
        raise MapFileError(path, "", None, rule)
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise MapFileError(path, f"byte {error.start}", None, "is not UTF-8 text") from error


# -- YAML ------------------------------------------------------------------------------------------


def _parse(text: str, path: str | Path) -> dict[str, Tree]:
    try:
        _refuse_tricks(text, path)
        node = yaml.compose(text, Loader=yaml.BaseLoader)
    except yaml.YAMLError as error:
        raise _yaml_error(error, path) from error
    document = None if node is None else _tree(node, path)
    if not isinstance(document, dict):
        raise MapFileError(path, "", None, "must hold keys and values, such as resolution: 0.05")
    return document


def _refuse_tricks(text: str, path: str | Path) -> None:
    """Refuse, event by event, what could run code, grow without bound or recurse too deeply."""
    depth = 0
    for event in yaml.parse(text, Loader=yaml.BaseLoader):
        if isinstance(event, yaml.NodeEvent) and event.anchor is not None:
            rule = "anchors and aliases are not read"
            raise MapFileError(path, _line(event), shown(event.anchor), rule)
        tag = getattr(event, "tag", None)
        if tag is not None:
            raise MapFileError(path, _line(event), shown(tag), "tags are not read")
        depth += isinstance(event, yaml.CollectionStartEvent)
        depth -= isinstance(event, yaml.CollectionEndEvent)
        if depth > DEEPEST_NESTING:
            rule = f"is nested more than {DEEPEST_NESTING} deep"
            raise MapFileError(path, _line(event), None, rule)


def _tree(node: yaml.Node, path: str | Path) -> Tree:
    if isinstance(node, yaml.MappingNode):
        tree: dict[str, Tree] = {}
        for key, value in node.value:
            name = _tree(key, path)
            if not isinstance(name, str):
                raise MapFileError(path, _line(key), None, "a key must be text")
            if name in tree:
                raise MapFileError(path, _line(key), shown(name), "key occurs twice")
            tree[name] = _tree(value, path)
        return tree
    if isinstance(node, yaml.SequenceNode):
        return [_tree(value, path) for value in node.value]
    return str(node.value)


def _yaml_error(error: yaml.YAMLError, path: str | Path) -> MapFileError:
    place, problem = "", str(error)
    if isinstance(error, yaml.MarkedYAMLError):
        place = "" if error.problem_mark is None else f"line {error.problem_mark.line + 1}"
        problem = error.problem or problem
    return MapFileError(path, place, None, f"is not YAML: {' '.join(problem.split())}")


def _line(part: yaml.Event | yaml.Node) -> str:
    return "" if part.start_mark is None else f"line {part.start_mark.line + 1}"


def shown(value: Tree) -> str:
    """Return a value as it stands in the file, without characters that a terminal may obey."""
    return value if isinstance(value, str) and value.isprintable() else json.dumps(value)


# -- the keys --------------------------------------------------------------------------------------


class _Checks:
    """The rules of the keys, applied to one document."""

    def __init__(self, path: str | Path, document: dict[str, Tree]) -> None:
        self.path = path
        self.document = document

    def description(self) -> GridDescription:
        free, occupied = self.share("free_thresh"), self.share("occupied_thresh")
        if free > occupied:
            raise self.error("free_thresh", "must not be above occupied_thresh")
        return GridDescription(
            self.image(),
            self.resolution(),
            self.origin(),
            self.negate(),
            occupied,
            free,
            self.mode(),
            tuple(shown(key) for key in self.document if key not in KNOWN),
        )

    def error(self, key: str, rule: str) -> MapFileError:
        return MapFileError(self.path, key, shown(self.document[key]), rule)

    def image(self) -> Path:
        name = self.document["image"]
        if not isinstance(name, str) or not name:
            raise self.error("image", "must name a file")
        return Path(self.path).parent / name

    def resolution(self) -> float:
        value = self.number("resolution", self.document["resolution"])
        if not FINEST_RESOLUTION_M <= value <= COARSEST_RESOLUTION_M:
            rule = f"must be metres per pixel from {FINEST_RESOLUTION_M:g} to "
            raise self.error("resolution", rule + f"{COARSEST_RESOLUTION_M:g}")
        return value

    def origin(self) -> tuple[float, float, float]:
        values = self.document["origin"]
        if not isinstance(values, list) or len(values) != 3:
            raise self.error("origin", "must be [x, y, yaw]")
        x, y, yaw = (self.number("origin", value) for value in values)
        if max(abs(x), abs(y)) > LARGEST_COORDINATE_M:
            raise self.error("origin", f"must be within {LARGEST_COORDINATE_M:g} m")
        return x, y, math.remainder(yaw, math.tau)

    def negate(self) -> bool:
        value = self.document["negate"]
        if isinstance(value, str):
            if INTEGER.fullmatch(value):
                return value.strip("+-0") != ""
            if value.lower() in TRUE | FALSE:
                return value.lower() in TRUE
        raise self.error("negate", "must be 0 or 1")

    def share(self, key: str) -> float:
        value = self.number(key, self.document[key])
        if not 0 <= value <= 1:
            raise self.error(key, "must be from 0 to 1")
        return value

    def mode(self) -> Mode:
        value = self.document.get("mode", Mode.TRINARY.value)
        names = [mode.value for mode in Mode]
        if not isinstance(value, str) or value.lower() not in names:
            raise self.error("mode", f"must be one of {', '.join(names)}")
        return Mode(value.lower())

    def number(self, key: str, value: Tree) -> float:
        if isinstance(value, str) and NUMBER.fullmatch(value):
            number = float(value)
            if math.isfinite(number):
                return number
        raise self.error(key, "must be a finite number")
