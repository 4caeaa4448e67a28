"""The real command on ROS map_server maps."""

from __future__ import annotations

import contextlib
import json
import os
import pty
import subprocess
import sys
from pathlib import Path
from subprocess import CompletedProcess
from typing import Any

import numpy as np
import pytest
from maps import FREE, OCCUPIED, UNKNOWN, two_rooms, write_map

import sgraph_core
from sgraph_core.formats import FORMATS


@pytest.fixture
def rooms_map(tmp_path: Path) -> Path:
    return write_map(tmp_path, two_rooms(), origin="[100, -50, 0.3]")


def assert_one_line(result: CompletedProcess[str], part: str) -> None:
    assert (result.returncode, result.stdout) == (1, "")
    assert len(result.stderr.splitlines()) == 1, result.stderr
    assert part in result.stderr


def test_rooms_of_a_map_are_found_in_its_frame(
    sgraph: Any, rooms_map: Path, tmp_path: Path
) -> None:
    out, picture = tmp_path / "rooms.json", tmp_path / "rooms.png"
    result = sgraph("infer", rooms_map, "-o", out, "--plot", picture)
    assert (result.returncode, result.stdout, result.stderr) == (0, "", "")
    assert picture.stat().st_size > 1000
    document = json.loads(out.read_text())
    assert document["name"] == "map"
    rooms = document["concepts"]["room"]
    assert [room["attributes"]["area_m2"] for room in rooms] == pytest.approx([12, 12], rel=0.05)
    grid = sgraph_core.load(rooms_map).grid
    assert grid is not None
    centres = sorted(grid.to_cells(np.array(room["centre"])).tolist() for room in rooms)
    np.testing.assert_allclose(centres, [[49.5, 40], [130.5, 40]], atol=4)


def test_json_is_what_the_output_file_holds(sgraph: Any, rooms_map: Path, tmp_path: Path) -> None:
    out = tmp_path / "rooms.json"
    result = sgraph("infer", rooms_map, "-o", out, "--json")
    assert result.stdout == out.read_text(encoding="utf-8")


def test_the_table_is_printed(sgraph: Any, rooms_map: Path) -> None:
    assert "map: 2 rooms" in sgraph("infer", rooms_map).stdout


def test_a_grid_is_drawn(sgraph: Any, rooms_map: Path, tmp_path: Path) -> None:
    result = sgraph("plot", rooms_map, "-o", tmp_path / "plot.svg")
    assert (result.returncode, result.stderr) == (0, "")
    assert (tmp_path / "plot.svg").stat().st_size > 1000


@pytest.mark.parametrize(
    ("pixels", "keys", "part"),
    [
        (np.full((50, 50), UNKNOWN, np.uint8), {}, "no cell is free"),
        (np.full((50, 50), FREE, np.uint8), {}, "all cells are free"),
        (np.full((1, 1), OCCUPIED, np.uint8), {}, "no cell is free"),
        (
            two_rooms(),
            {"negate": 1},
            "most of what is enclosed is occupied: the map looks inverted",
        ),
    ],
)
def test_a_map_without_rooms_is_a_result_with_a_warning(
    sgraph: Any, tmp_path: Path, pixels: np.ndarray, keys: dict[str, Any], part: str
) -> None:
    file = write_map(tmp_path, pixels, **keys)
    result = sgraph("infer", file, "--json", "--plot", tmp_path / "picture.png")
    assert result.returncode == 0
    assert json.loads(result.stdout)["concepts"].get("room", []) == []
    assert len(result.stderr.splitlines()) == 1
    assert result.stderr.startswith(f"sgraph: warning: {file}: {part}")
    assert (tmp_path / "picture.png").exists()


def test_neither_yaml_nor_image_is_replaced(sgraph: Any, rooms_map: Path, tmp_path: Path) -> None:
    link = tmp_path / "link.json"
    link.symlink_to(rooms_map)
    before = [file.read_bytes() for file in (rooms_map, tmp_path / "map.png")]
    for command in (
        ["infer", rooms_map, "-o", rooms_map],
        ["infer", rooms_map, "-o", link],
        ["infer", rooms_map, "--plot", tmp_path / "map.png"],
        ["plot", rooms_map, "-o", tmp_path / "map.png"],
    ):
        assert_one_line(sgraph(*command), "belongs to the map that is read, and is not replaced")
    assert [file.read_bytes() for file in (rooms_map, tmp_path / "map.png")] == before


def test_two_outputs_are_two_files(sgraph: Any, rooms_map: Path, tmp_path: Path) -> None:
    out = tmp_path / "rooms.png"
    result = sgraph("infer", rooms_map, "-o", out, "--plot", tmp_path / "." / "rooms.png")
    assert_one_line(result, "rooms.png: would be written twice")
    assert not out.exists()


@pytest.mark.parametrize("blocked", ["rooms.png", "rooms.yaml"])
def test_a_labelled_image_is_written_with_its_yaml_or_not_at_all(
    sgraph: Any, rooms_map: Path, tmp_path: Path, blocked: str
) -> None:
    (tmp_path / blocked).mkdir()
    before = sorted(tmp_path.iterdir())
    result = sgraph("infer", rooms_map, "-o", tmp_path / "rooms.png")
    assert_one_line(result, f"{blocked}: is there and is no file")
    assert sorted(tmp_path.iterdir()) == before


def test_json_is_not_written_under_a_grids_name(
    sgraph: Any, demo_map: Path, tmp_path: Path
) -> None:
    assert FORMATS[0].suffixes == (".yaml", ".yml")
    out = tmp_path / "out.YAML"
    part = "out.YAML: is written as JSON, so it must not end in .yaml, .yml"
    assert_one_line(sgraph("infer", demo_map, "-o", out), part)
    assert not out.exists()


def test_a_grid_cannot_be_optimised(sgraph: Any, rooms_map: Path) -> None:
    assert_one_line(sgraph("infer", rooms_map, "--optimize"), "0 keyframes and 0 observations")


@pytest.mark.parametrize(
    ("damage", "part"),
    [
        (lambda folder: (folder / "map.png").unlink(), "map.png: cannot be read: No such file"),
        (lambda folder: (folder / "map.png").write_bytes(b"P5 65000 3000 255\n"), "is cut off"),
        (lambda folder: write_map(folder, resolution=0), "resolution = 0: must be metres per pix"),
    ],
)
def test_bad_maps_get_one_line_and_leave_nothing(
    sgraph: Any, rooms_map: Path, tmp_path: Path, damage: Any, part: str
) -> None:
    damage(tmp_path)
    out = tmp_path / "out.json"
    assert_one_line(sgraph("infer", rooms_map, "-o", out, "--plot", tmp_path / "a.svg"), part)
    assert {file.suffix for file in tmp_path.iterdir()} <= {".yaml", ".png"}


def on_a_terminal(*arguments: object) -> bytes:
    """Return what the command writes to stderr when that is a terminal."""
    command = [Path(sys.executable).parent / "sgraph", *map(str, arguments)]
    ours, theirs = pty.openpty()
    written = b""
    with subprocess.Popen(command, stderr=theirs), os.fdopen(ours, "rb", 0) as terminal:
        os.close(theirs)
        with contextlib.suppress(OSError):  # which is how Linux says that nobody writes any more
            while block := terminal.read(4096):
                written += block
    return written


def test_a_bar_shows_progress_on_a_terminal(
    rooms_map: Path, demo_map: Path, tmp_path: Path
) -> None:
    assert b"reading the map" in on_a_terminal("infer", rooms_map, "-o", tmp_path / "out.json")
    assert on_a_terminal("infer", demo_map, "-o", tmp_path / "out.json") == b""


def test_a_map_is_the_same_in_python(rooms_map: Path) -> None:
    result = sgraph_core.infer(sgraph_core.load(rooms_map))
    assert len(result.concepts["room"]) == 2
    assert result.grid is not None
