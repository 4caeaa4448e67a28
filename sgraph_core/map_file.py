"""Reading and writing `sgraph-map` JSON files without loss."""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sgraph_concepts.errors import MapFileError
from sgraph_concepts.spec import WALL_SURFACE
from sgraph_concepts.types import ConceptNode, FloatArray, NodeShape
from sgraph_core.files import write_whole
from sgraph_core.graph import Pins, SGraph, TrueRoom, Truth
from sgraph_core.map_schema import (
    FORMAT,
    UNITS,
    VERSION,
    ConceptRecord,
    MapRecord,
    PinsRecord,
    TruthRecord,
)
from sgraph_core.nodes import check_links, checked_records
from sgraph_core.pins import check_pins
from sgraph_core.structure import REQUIRED, refuse_lone_surrogates, structured
from sgraph_core.tables import LARGEST_ID, RowError, RuleError

__all__ = ["dump", "load", "parse", "save", "schema"]

ID = re.compile(r"0|[1-9][0-9]{0,15}")
"""An id as the key of an object; a longer one is beyond the largest."""


def load(path: str | Path) -> SGraph:
    """Read a map file.

    Raises:
        MapFileError: the file cannot be read or breaks a rule of the format; the error names the
            file, the place inside it, the value and the rule.
    """
    try:
        data = Path(path).read_bytes()
    except OSError as error:
        raise MapFileError(path, "", None, f"cannot be read: {error.strerror}") from error
    return parse(data, path)


def save(graph: SGraph, path: str | Path) -> None:
    """Write a map file, whole or not at all.

    Raises:
        InputError: a node breaks the map file's rules.
        OSError: the file cannot be written.
    """
    text = dump(graph)
    write_whole(path, lambda temporary: temporary.write_text(text, encoding="utf-8"))


def schema() -> dict[str, Any]:
    """Return the JSON Schema of the map file."""
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **MapRecord.model_json_schema(),
    }


# -- reading ---------------------------------------------------------------------------------------


def parse(data: bytes, path: str | Path = "map") -> SGraph:
    """Return the S-Graph that a map file's bytes describe; ``path`` is for error texts only.

    Raises:
        MapFileError: see :func:`load`.
    """
    try:
        document = _parse_json(data, path)
        return _read(structured(document), path)
    except RuleError as error:
        value = None if error.rule == REQUIRED else _value(error.value)
        raise MapFileError(path, error.place, value, error.rule) from error


def _read(record: MapRecord, path: str | Path) -> SGraph:
    graph = SGraph(record.name)
    _read_tables(graph, record, path)
    known = {int(i) for i in graph.wall_surfaces.ids}
    if record.concepts is not None:
        graph.concepts = {
            concept: list(map(_node, group)) for concept, group in record.concepts.items()
        }
        check_links(graph.concepts, known)
    if record.pins is not None:
        graph.pins = _read_pins(record.pins, known, path)
    if record.truth is not None:
        graph.truth = _read_truth(record.truth, known, path)
    return graph


def _parse_json(data: bytes, path: str | Path) -> Any:
    if not data.strip():
        raise MapFileError(path, "", None, "is empty")

    def unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        keys = Counter(key for key, _ in pairs)
        for key, count in keys.items():
            if count > 1:
                raise MapFileError(path, "", key, "key occurs twice in one object")
        return dict(pairs)

    try:
        text = data.decode("utf-8-sig")
        document = json.loads(text, object_pairs_hook=unique)
    except UnicodeDecodeError as error:
        raise MapFileError(path, f"byte {error.start}", None, "is not UTF-8 text") from error
    except json.JSONDecodeError as error:
        place = f"line {error.lineno} column {error.colno}"
        raise MapFileError(path, place, None, f"is not JSON: {error.msg}") from error
    except RecursionError:
        raise MapFileError(path, "", None, "is nested too deeply") from None
    except ValueError as error:  # an integer of more digits than Python converts
        raise MapFileError(path, "", None, f"is not JSON: {error}") from error
    if "\\u" in text:  # UTF-8 itself cannot write them
        refuse_lone_surrogates(document)
    return document


def _value(value: Any) -> str:
    return json.dumps(value, default=str)


def _read_tables(graph: SGraph, record: MapRecord, path: str | Path) -> None:
    keyframes, odometry = record.keyframes or [], record.odometry or []
    surfaces = record.wall_surfaces
    seen = [(k, i, o) for k, s in enumerate(surfaces) for i, o in enumerate(s.observations or [])]

    def ids(values: list[int]) -> Any:
        return np.array(values, np.int64)

    def table(rows: list[Any], *shape: int) -> FloatArray:
        return np.array(rows, np.float64).reshape(len(rows), *shape)

    try:
        graph.extend_keyframes(
            ids([k.id for k in keyframes]),
            table([k.pose for k in keyframes], 7),
            table([np.nan if k.stamp is None else k.stamp for k in keyframes]),
        )
        graph.extend_odometry(
            ids([o.from_ for o in odometry]),
            ids([o.to for o in odometry]),
            table([o.pose for o in odometry], 7),
            table([o.sigmas for o in odometry], 6),
        )
        graph.extend_wall_surfaces(
            ids([s.id for s in surfaces]),
            table([s.segment for s in surfaces], 2, 2),
            table([s.normal for s in surfaces], 2),
            table([s.z or (np.nan, np.nan) for s in surfaces], 2),
        )
        graph.extend_observations(
            ids([surfaces[k].id for k, _, _ in seen]),
            ids([o.keyframe for _, _, o in seen]),
            table([o.plane for _, _, o in seen], 4),
            table([o.sigmas for _, _, o in seen], 2),
            table([o.at for _, _, o in seen], 3),
        )
    except RowError as error:
        place = f"{error.table}[{error.row}].{error.field}"
        if error.table == "observations":
            surface, observation, _ = seen[error.row]
            place = f"wall_surfaces[{surface}].observations[{observation}].{error.field}"
        raise MapFileError(path, place, _value(error.value), error.rule) from error


def _node(record: ConceptRecord) -> ConceptNode:
    shape = NodeShape(
        record.centre,
        None if record.polygon is None else _ring(record.polygon),
        tuple(_ring(hole) for hole in record.holes or []),
        record.thickness,
        record.attributes or {},
    )
    return ConceptNode(record.id, tuple(record.members), record.name, shape, record.confidence)


def _ring(points: Sequence[tuple[float, float]]) -> tuple[tuple[float, float], ...]:
    closed = len(points) > 3 and points[0] == points[-1]
    return tuple(points[:-1] if closed else points)


def _read_pins(record: PinsRecord, surfaces: set[int], path: str | Path) -> Pins:
    for key in record.room_names or {}:
        if not ID.fullmatch(key) or int(key) > LARGEST_ID:
            rule = f"key must be a room id, an integer from 0 to {LARGEST_ID}"
            raise MapFileError(path, "pins.room_names", _value(key), rule)
    pins = Pins(
        tuple(record.same_room or ()),
        tuple(record.not_same_room or ()),
        {int(key): name for key, name in (record.room_names or {}).items()},
    )
    check_pins(pins, surfaces)
    return pins


def _read_truth(record: TruthRecord, surfaces: set[int], path: str | Path) -> Truth:
    rooms, walls = record.rooms or [], record.walls or []
    for k, room in enumerate(rooms):
        _refuse_unknown(room.members, surfaces, f"truth.rooms[{k}].members", path)
        _refuse_repeats(room.members, "members", f"truth.rooms[{k}]", path)
    for k, wall in enumerate(walls):
        _refuse_unknown(wall, surfaces, f"truth.walls[{k}]", path)
        if wall[0] == wall[1]:
            raise MapFileError(path, f"truth.walls[{k}]", _value(wall), "must be two surfaces")
    return Truth(
        tuple(
            TrueRoom(
                room.id,
                room.name,
                tuple(room.members),
                None if room.polygon is None else _ring(room.polygon),
            )
            for room in rooms
        ),
        tuple(walls),
    )


def _refuse_unknown(members: Sequence[int], known: set[int], place: str, path: str | Path) -> None:
    for k, member in enumerate(members):
        if member not in known:
            raise MapFileError(path, f"{place}[{k}]", member, f"must be the id of a {WALL_SURFACE}")


def _refuse_repeats(ids: Sequence[int], name: str, place: str, path: str | Path) -> None:
    for value, count in Counter(ids).items():
        if count > 1:
            raise MapFileError(path, f"{place}: {name}", value, "must be unique")


# -- writing ---------------------------------------------------------------------------------------


def dump(graph: SGraph) -> str:
    """Return the map file's text: one record a line, so that versions can be compared.

    Raises:
        InputError: a node breaks the map file's rules.
    """
    lines = []
    for key, value in _document(graph).items():
        if isinstance(value, list) and value:
            rows = ",\n".join(f"  {_json(row)}" for row in value)
            lines.append(f" {_json(key)}: [\n{rows}\n ]")
        elif isinstance(value, dict) and value:
            groups = []
            for name, rows in value.items():
                if isinstance(rows, list) and rows and isinstance(rows[0], dict):
                    body = ",\n".join(f"   {_json(row)}" for row in rows)
                    groups.append(f"  {_json(name)}: [\n{body}\n  ]")
                else:
                    groups.append(f"  {_json(name)}: {_json(rows)}")
            joined = ",\n".join(groups)
            lines.append(f" {_json(key)}: {{\n{joined}\n }}")
        else:
            lines.append(f" {_json(key)}: {_json(value)}")
    return "{\n" + ",\n".join(lines) + "\n}\n"


def _json(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False, allow_nan=False)


def _document(graph: SGraph) -> dict[str, Any]:
    document: dict[str, Any] = {"format": FORMAT, "version": VERSION, "units": UNITS}
    if graph.name is not None:
        document["name"] = graph.name
    if len(graph.keyframes.ids):
        document["keyframes"] = list(_keyframe_records(graph))
    if len(graph.odometry.from_ids):
        document["odometry"] = list(_odometry_records(graph))
    document["wall_surfaces"] = list(_surface_records(graph))
    if graph.concepts:
        surfaces = set(graph.wall_surfaces.ids.tolist())
        document["concepts"] = checked_records(graph.concepts, surfaces)
    if graph.pins is not None:
        document["pins"] = _without_empty(
            same_room=[list(pair) for pair in graph.pins.same_room],
            not_same_room=[list(pair) for pair in graph.pins.not_same_room],
            room_names={str(key): name for key, name in graph.pins.room_names.items()},
        )
    if graph.truth is not None:
        document["truth"] = {
            "rooms": [
                {
                    **({} if room.id is None else {"id": room.id}),
                    **({} if room.name is None else {"name": room.name}),
                    "members": list(room.members),
                    **({} if room.polygon is None else {"polygon": _points(room.polygon)}),
                }
                for room in graph.truth.rooms
            ],
            "walls": [list(wall) for wall in graph.truth.walls],
        }
    return document


def _without_empty(**entries: Any) -> dict[str, Any]:
    return {key: value for key, value in entries.items() if value}


def _keyframe_records(graph: SGraph) -> Iterator[dict[str, Any]]:
    table = graph.keyframes
    for i, pose, stamp in zip(
        table.ids.tolist(), table.poses.tolist(), table.stamps.tolist(), strict=True
    ):
        yield {"id": i, "pose": pose, **({} if np.isnan(stamp) else {"stamp": stamp})}


def _odometry_records(graph: SGraph) -> Iterator[dict[str, Any]]:
    table = graph.odometry
    columns = (table.from_ids, table.to_ids, table.poses, table.sigmas)
    for one, two, pose, sigmas in zip(*(column.tolist() for column in columns), strict=True):
        yield {"from": one, "to": two, "pose": pose, "sigmas": sigmas}


def _surface_records(graph: SGraph) -> Iterator[dict[str, Any]]:
    table, seen = graph.wall_surfaces, graph.observations
    observations: dict[int, list[dict[str, Any]]] = {}
    columns = (seen.surface_ids, seen.keyframe_ids, seen.planes, seen.sigmas, seen.at)
    for i, keyframe, plane, sigmas, at in zip(
        *(column.tolist() for column in columns), strict=True
    ):
        observations.setdefault(i, []).append(
            {
                "keyframe": keyframe,
                "plane": plane,
                "sigmas": sigmas,
                **({"at": at} if any(at) else {}),
            }
        )
    rows = (table.ids, table.segments, table.normals, table.heights)
    for i, segment, normal, height in zip(*(column.tolist() for column in rows), strict=True):
        yield {
            "id": i,
            "segment": segment,
            "normal": normal,
            **({} if np.isnan(height).any() else {"z": height}),
            **({"observations": observations[i]} if i in observations else {}),
        }


def _points(ring: Sequence[tuple[float, float]]) -> list[list[float]]:
    return [list(point) for point in ring]
