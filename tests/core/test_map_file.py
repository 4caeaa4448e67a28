"""The map file is read and written without loss, and refuses what breaks its rules."""

from __future__ import annotations

import copy
import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sgraph_concepts.errors import MapFileError
from sgraph_core import map_file

FULL: dict[str, Any] = {
    "format": "sgraph-map",
    "version": 1,
    "units": "m",
    "name": "Büro",
    "keyframes": [
        {"id": 3, "pose": [0.0, 1.5, 0.0, 0.0, 0.0, 0.0, 1.0], "stamp": 12.3},
        {"id": 7, "pose": [1.0, 1.5, 0.0, 0.0, 0.0, 1.0, 0.0]},
    ],
    "odometry": [
        {
            "from": 3,
            "to": 7,
            "pose": [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0],
            "sigmas": [0.01, 0.01, 0.02, 0.05, 0.05, 0.05],
        }
    ],
    "wall_surfaces": [
        {
            "id": 12,
            "segment": [[0.0, 0.0], [4.0, 0.0]],
            "normal": [0.0, 1.0],
            "z": [0.0, 2.5],
            "observations": [
                {"keyframe": 3, "plane": [0.0, 1.0, 0.0, 1.5], "sigmas": [0.01, 0.02]},
                {
                    "keyframe": 7,
                    "plane": [0.0, -1.0, 0.0, 1.5],
                    "sigmas": [0.01, 0.02],
                    "at": [1.0, 1.5, 0.0],
                },
            ],
        },
        {"id": 31, "segment": [[4.0, -0.1], [0.0, -0.1]], "normal": [0.0, -1.0]},
        {"id": 40, "segment": [[4.0, 0.0], [4.0, 3.0]], "normal": [-1.0, 0.0]},
    ],
    "concepts": {
        "room": [
            {
                "id": 5,
                "name": "kitchen",
                "members": [12, 40],
                "centre": [2.0, 1.5],
                "polygon": [[0.0, 0.0], [4.0, 0.0], [4.0, 3.0], [0.0, 3.0]],
                "holes": [[[1.0, 1.0], [2.0, 1.0], [2.0, 2.0]]],
                "confidence": 0.97,
                "attributes": {"area_m2": 11.5, "tags": ["a", None, {"b": True}]},
            }
        ],
        "wall": [{"id": 0, "members": [12, 31], "centre": [2.0, -0.05], "thickness": 0.1}],
        "floor": [{"id": 1, "members": [5]}],
    },
    "pins": {
        "same_room": [[12, 40]],
        "not_same_room": [[12, 31]],
        "room_names": {"5": "kitchen"},
    },
    "truth": {
        "rooms": [
            {"id": "r1", "name": "Küche", "members": [12, 40], "polygon": [[0, 0], [4, 0], [4, 3]]},
            {"id": 2, "members": [31]},
        ],
        "walls": [[12, 31]],
    },
}


def parse(document: Any) -> Any:
    return map_file.parse(json.dumps(document).encode(), "map.json")


def test_every_field_survives_reading_and_writing() -> None:
    assert json.loads(map_file.dump(parse(FULL))) == FULL


def test_any_text_survives_reading_and_writing_escaped_or_not() -> None:
    document = copy.deepcopy(FULL)
    document["name"] = "\U0001f6aa \u0000 \\ud800"
    escaped = json.dumps(document, ensure_ascii=True)
    written = json.dumps(document, ensure_ascii=False)
    for text in (escaped, written):
        assert json.loads(map_file.dump(map_file.parse(text.encode()))) == document


def test_what_is_absent_stays_absent() -> None:
    least = {"format": "sgraph-map", "version": 1, "units": "m", "wall_surfaces": []}
    assert json.loads(map_file.dump(parse(least))) == least


def test_a_repeated_first_point_of_a_polygon_is_accepted_and_dropped() -> None:
    document = copy.deepcopy(FULL)
    polygon = document["concepts"]["room"][0]["polygon"]
    polygon.append(polygon[0])
    assert json.loads(map_file.dump(parse(document))) == FULL


def test_a_slightly_wrong_normal_is_recomputed_from_the_segment() -> None:
    document = copy.deepcopy(FULL)
    document["wall_surfaces"][0]["normal"] = [0.03, 0.9995]
    assert parse(document).wall_surface(12).normal.tolist() == [0.0, 1.0]


finite = st.floats(-1e7, 1e7)
points = st.tuples(finite, finite)


@given(st.lists(st.tuples(points, st.floats(0, 6.28), st.floats(0.1, 50)), max_size=8))
@settings(deadline=None)
def test_any_surfaces_survive_a_round_trip_exactly(
    rows: list[tuple[tuple[float, float], float, float]],
) -> None:
    graph = map_file.SGraph()
    for number, ((x, y), angle, length) in enumerate(rows):
        from math import cos, sin

        end = (x + length * cos(angle), y + length * sin(angle))
        graph.add_wall_surface(number * 3, [(x, y), end], [-sin(angle), cos(angle)])
    once = map_file.dump(graph)
    again = map_file.parse(once.encode())
    assert map_file.dump(again) == once
    assert (again.wall_surfaces.segments == graph.wall_surfaces.segments).all()


def _set(path: str, value: Any) -> Callable[[dict[str, Any]], None]:
    def change(document: dict[str, Any]) -> None:
        *steps, last = [int(s) if s.isdigit() else s for s in path.split("/")]
        target: Any = document
        for step in steps:
            target = target[step]
        target[last] = value

    return change


NAN, INFINITY = float("nan"), float("inf")

MUTATIONS: list[tuple[Callable[[dict[str, Any]], None], str]] = [
    (_set("format", "map"), "format = \"map\": must be 'sgraph-map'"),
    (_set("version", 2), "version = 2: must be 1"),
    (_set("version", True), "version = true: must be 1"),
    (_set("version", "1"), 'version = "1": must be 1'),
    (_set("units", "ft"), "units = \"ft\": must be 'm'"),
    (lambda d: d.pop("units"), "units: is required"),
    (lambda d: d.pop("wall_surfaces"), "wall_surfaces: is required"),
    (_set("colour", 1), "colour = 1: unknown key"),
    (_set("wall_surfaces/1/colour", 1), "wall_surfaces[1].colour = 1: unknown key"),
    (_set("wall_surfaces", {}), "wall_surfaces = {}: must be a valid list"),
    (_set("wall_surfaces/0/id", "12"), 'wall_surfaces[0].id = "12": must be a valid integer'),
    (_set("wall_surfaces/0/id", 12.0), "wall_surfaces[0].id = 12.0: must be a valid integer"),
    (_set("wall_surfaces/0/id", True), "wall_surfaces[0].id = true: must be a valid integer"),
    (_set("wall_surfaces/0/id", -1), "wall_surfaces[0].id = -1: must be greater than or equal"),
    (_set("wall_surfaces/0/id", 2**60), "must be less than or equal to 9007199254740991"),
    (_set("wall_surfaces/1/id", 12), "wall_surfaces[1].id = 12: must be unique"),
    (
        _set("wall_surfaces/0/segment/0/1", NAN),
        "wall_surfaces[0].segment[0][1] = NaN: must be a finite number",
    ),
    (_set("wall_surfaces/0/segment/0/1", INFINITY), "must be a finite number"),
    (_set("wall_surfaces/0/segment/0/1", 1e300), "less than or equal to 100000000"),
    (_set("wall_surfaces/0/segment/0/1", "0"), "must be a valid number"),
    (_set("wall_surfaces/0/segment", [[1, 1], [1, 1]]), "endpoints must be 1 mm or more apart"),
    (_set("wall_surfaces/0/segment", [[1, 1]]), "wall_surfaces[0].segment"),
    (_set("wall_surfaces/0/segment/0", [1, 1, 1]), "must have at most 2 items"),
    (
        _set("wall_surfaces/1/normal", [0, -2]),
        "wall_surfaces[1].normal = [0.0, -2.0]: norm must be within 1e-3 of 1",
    ),
    (_set("wall_surfaces/2/normal", [0, 1]), "must be perpendicular to the segment"),
    (_set("wall_surfaces/0/z", [2, 1]), "wall_surfaces[0].z = [2.0, 1.0]: lowest"),
    (
        _set("wall_surfaces/0/observations/1/keyframe", 4),
        "wall_surfaces[0].observations[1].keyframe = 4: must be the id of a keyframe",
    ),
    (
        _set("wall_surfaces/0/observations/0/plane", [0, 1, 0, -1.5]),
        "wall_surfaces[0].observations[0].plane = [0.0, 1.0, 0.0, -1.5]: n must point to",
    ),
    (
        _set("wall_surfaces/0/observations/0/plane", [0, -1, 0, 1.5]),
        "must be within 90 degrees of the surface's normal",
    ),
    (
        _set("wall_surfaces/0/observations/0/sigmas", [0, 1]),
        "wall_surfaces[0].observations[0].sigmas = [0.0, 1.0]: must be from 1e-08 to 1e+06",
    ),
    (
        _set("wall_surfaces/0/observations/1/sigmas", [1e-160, 0.1]),
        "wall_surfaces[0].observations[1].sigmas = [1e-160, 0.1]: must be from 1e-08 to 1e+06",
    ),
    (
        _set("odometry/0/sigmas/5", 1e7),
        "odometry[0].sigmas = [0.01, 0.01, 0.02, 0.05, 0.05, 10000000.0]: "
        "must be from 1e-08 to 1e+06",
    ),
    (_set("wall_surfaces/0/observations/1/at", [0, 1]), "observations[1].at"),
    (_set("keyframes/1/id", 3), "keyframes[1].id = 3: must be unique"),
    (_set("keyframes/0/pose", [0, 0, 0, 0, 0, 0, 2]), "keyframes[0].pose"),
    (_set("odometry/0/to", 8), "odometry[0].to = 8: must be the id of a keyframe"),
    (_set("odometry/0/to", 3), "odometry[0].to = 3: must differ from 'from'"),
    (_set("odometry/0/from", 9), "odometry[0].from = 9: must be the id of a keyframe"),
    (_set("concepts/room/0/members", [12, 99]), "concepts.room[0].members[1] = 99: must be the id"),
    (_set("concepts/room/0/members", []), "concepts.room[0].members = []: must have at least 1"),
    (_set("concepts/room/0/members", [12, 12]), "concepts.room[0].members = [12, 12]: must be uni"),
    (_set("concepts/room/0/confidence", 1.5), "less than or equal to 1"),
    (_set("concepts/room/0/attributes/area_m2", NAN), "attributes.area_m2"),
    (
        _set("concepts/room/0/attributes/area_m2", 10**400),
        "concepts.room[0].attributes.area_m2 = 1000000000",
    ),
    (_set("concepts/room/0/attributes", {"a\nb": NAN}), "room[0].attributes.a b = NaN: must be a"),
    (_set("concepts/room/0/polygon", [[0, 0], [1, 1]]), "must have at least 3 items"),
    (_set("concepts/wall/0/members", [12]), "a wall has exactly two members"),
    (_set("concepts/wall/0/members", [12, 5]), "concepts.wall[0].members[1] = 5: must be the id"),
    (_set("concepts/floor/0/members", [6]), "concepts.floor[0].members[0] = 6: must be the id"),
    (_set("pins/same_room/0", [12, 12]), "pins.same_room[0] = [12, 12]: must be two surfaces"),
    (_set("pins/same_room/0", [12, 13]), "pins.same_room[0][1] = 13: must be the id"),
    (
        _set("pins/not_same_room/0", [40, 12]),
        "pins.not_same_room[0] = [40, 12]: contradicts same_room [40, 12]",
    ),
    (
        _set("pins/same_room", [[31, 40], [12, 40]]),
        "pins.not_same_room[0] = [12, 31]: contradicts same_room [12, 40], [40, 31]",
    ),
    (_set("pins/room_names", {"x": "y"}), 'pins.room_names = "x": key must be a room id'),
    (
        _set("pins/room_names", {str(2**53): "y"}),
        'pins.room_names = "9007199254740992": key must be a room id, an integer from 0 to 9007199',
    ),
    (_set("pins/room_names", {"9" * 5000: "y"}), "...: key must be a room id"),
    (_set("pins/room_names", {"05": "y"}), 'pins.room_names = "05": key must be a room id'),
    (_set("name", "a\ud800"), 'name = "a\\ud800": must hold no lone surrogate'),
    (
        _set("concepts/room/0/attributes/tags/2/b", ["\udfff"]),
        'concepts.room[0].attributes.tags[2].b[0] = "\\udfff": must hold no lone surrogate',
    ),
    (
        _set("concepts/room/0/attributes/\ud800", 1),
        'concepts.room[0].attributes = "\\ud800": must hold no lone surrogate',
    ),
    (_set("concepts/\ud800", []), 'concepts = "\\ud800": must hold no lone surrogate'),
    (_set("truth/rooms/0/members", [1]), "truth.rooms[0].members[0] = 1: must be the id"),
    (_set("truth/walls/0", [12, 12]), "truth.walls[0] = [12, 12]: must be two surfaces"),
]


@pytest.mark.parametrize(("change", "message"), MUTATIONS, ids=[m for _, m in MUTATIONS])
def test_a_mutated_map_names_file_place_value_and_rule(
    change: Callable[[dict[str, Any]], None], message: str
) -> None:
    document = copy.deepcopy(FULL)
    change(document)
    with pytest.raises(MapFileError) as caught:
        parse(document)
    text = str(caught.value)
    assert text.startswith("map.json: ")
    assert message in text
    assert "\n" not in text


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "is empty"),
        (b" \n", "is empty"),
        (b"\x93NUMPY\x01\x00\xff\xfe", "is not UTF-8 text"),
        (b"{", "line 1 column 2: is not JSON"),
        (b"[1, 2]", "[1, 2]: must be an object"),
        (b"null", "must be an object"),
        (b"[" * 20_000 + b"]" * 20_000, "is nested too deeply"),
        (b'{"a":' * 20_000 + b"1" + b"}" * 20_000, "is nested too deeply"),
        (b'{"format": 1, "format": 2}', "format: key occurs twice"),
        (b'{"version": ' + b"9" * 5000 + b"}", "is not JSON"),
    ],
)
def test_what_is_no_map_at_all_gets_one_line(data: bytes, message: str) -> None:
    with pytest.raises(MapFileError) as caught:
        map_file.parse(data, "map.json")
    assert message in str(caught.value)


@given(st.binary(max_size=200))
@settings(deadline=None)
def test_random_bytes_raise_nothing_but_map_file_errors(data: bytes) -> None:
    with pytest.raises(MapFileError):
        map_file.parse(data)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(MapFileError, match=r"nothing\.json: cannot be read: No such file"):
        map_file.load(tmp_path / "nothing.json")


def test_a_failed_write_leaves_the_old_file_and_no_other(tmp_path: Path) -> None:
    target = tmp_path / "map.json"
    target.write_text("old")

    def fail(_path: Path) -> None:
        raise OSError(28, "No space left on device")

    with pytest.raises(OSError, match=r"No space left on device.*map\.json"):
        map_file.write_whole(target, fail)
    assert [p.name for p in tmp_path.iterdir()] == ["map.json"]
    assert target.read_text() == "old"


def test_what_is_no_file_is_not_replaced(tmp_path: Path) -> None:
    pipe, folder = tmp_path / "pipe.json", tmp_path / "folder.json"
    os.mkfifo(pipe)
    folder.mkdir()
    for target in (pipe, folder):
        with pytest.raises(OSError, match=rf"is no file that can be replaced.*{target.name}"):
            map_file.write_whole(target, lambda file: file.write_text("new"))
    assert sorted(p.name for p in tmp_path.iterdir()) == [folder.name, pipe.name]
    assert pipe.is_fifo()


def test_the_schema_accepts_the_example_and_forbids_other_keys() -> None:
    schema = map_file.schema()
    assert schema["additionalProperties"] is False
    assert set(schema["required"]) == {"format", "version", "units", "wall_surfaces"}
    assert set(FULL) <= set(schema["properties"])


def test_the_schema_bounds_standard_deviations_as_the_reader_does() -> None:
    records = map_file.schema()["$defs"]
    for record, count in (("OdometryRecord", 6), ("ObservationRecord", 2)):
        sigmas = records[record]["properties"]["sigmas"]["prefixItems"]
        assert sigmas == [{"type": "number", "minimum": 1e-8, "maximum": 1e6}] * count
