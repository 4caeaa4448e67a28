"""ROS map_server maps become the cells that map_server would make of them, or one clear line."""

from __future__ import annotations

import math
import re
import struct
import tracemalloc
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from maps import FREE, OCCUPIED, UNKNOWN, two_rooms, write_map
from PIL import Image

from sgraph_concepts.errors import MapFileError, MapWarning
from sgraph_concepts.types import OccupancyGrid
from sgraph_core.grid import pgm, picture
from sgraph_core.grid.description import Mode, read_description
from sgraph_core.grid.reader import grid_files, read_grid

THREE = np.array([[FREE, OCCUPIED, UNKNOWN], [FREE, FREE, OCCUPIED]], np.uint8)
CELLS = [[0, 0, 1], [0, 1, 2]]  # from the lower row up

quiet = pytest.mark.filterwarnings("ignore::sgraph_concepts.errors.MapWarning")


# -- the frame -------------------------------------------------------------------------------------


def test_the_lower_left_pixels_corner_is_at_the_origin(tmp_path: Path) -> None:
    grid = read_grid(write_map(tmp_path, THREE, resolution=0.5, origin="[10, -20, 1.5707963]"))
    assert grid.cells.tolist() == CELLS
    assert grid.cells.dtype == np.uint8
    corner, right, up = grid.to_world(np.array([[0.0, 0.0], [3.0, 0.0], [0.0, 2.0]]))
    np.testing.assert_allclose(corner, [10, -20], atol=1e-6)
    np.testing.assert_allclose(right, [10, -18.5], atol=1e-6)
    np.testing.assert_allclose(up, [9, -20], atol=1e-6)


def test_a_yaw_of_many_turns_is_the_same_pose(tmp_path: Path) -> None:
    grid = read_grid(write_map(tmp_path, THREE, origin=f"[0, 0, {0.5 + 20 * math.pi}]"))
    assert grid.origin[2] == pytest.approx(0.5)


def test_the_image_is_found_beside_the_yaml_or_by_its_whole_path(tmp_path: Path) -> None:
    (tmp_path / "maps" / "images").mkdir(parents=True)
    for name in ("images/a.png", "../b.png", str(tmp_path / "c.png")):
        file = write_map(tmp_path / "maps", THREE, image=name)
        assert read_grid(file).cells.tolist() == CELLS
        assert grid_files(file) == (file, tmp_path / "maps" / name)


@pytest.mark.parametrize("name", ["'*.png'", "~/map.png", "$HOME/map.png", "file:map.png"])
def test_the_images_name_is_nothing_but_a_path(tmp_path: Path, name: str) -> None:
    (tmp_path / "map.png").write_bytes(b"")
    with pytest.raises(MapFileError, match="cannot be read: No such file"):
        read_grid(write_map(tmp_path, image=name))


# -- what pixels mean ------------------------------------------------------------------------------


def by_the_rules(pixel: list[int], white: int, keys: Any) -> int:
    """Return a cell as nav2_map_server computes it, pixel by pixel."""
    *colour, alpha = pixel if len(pixel) == 4 else (*pixel, None)
    channels = [*colour, alpha] if keys.mode is Mode.TRINARY and alpha is not None else colour
    shade = sum(channels) / len(channels) / white
    occupancy = shade if keys.negate else 1 - shade
    if keys.mode is Mode.RAW:
        percent = round(255 * shade)
        if percent <= round(100 * keys.free_thresh):
            return OccupancyGrid.FREE
        occupied = round(100 * keys.occupied_thresh) <= percent <= 100
        return OccupancyGrid.OCCUPIED if occupied else OccupancyGrid.UNKNOWN
    if keys.mode is Mode.SCALE and alpha is not None and alpha != white:
        return OccupancyGrid.UNKNOWN
    if occupancy > keys.occupied_thresh:
        return OccupancyGrid.OCCUPIED
    return OccupancyGrid.FREE if occupancy < keys.free_thresh else OccupancyGrid.UNKNOWN


@quiet
@pytest.mark.parametrize("channels", [1, 2, 3, 4])
@pytest.mark.parametrize("mode", list(Mode))
@pytest.mark.parametrize("negate", [0, 1])
def test_every_pixel_becomes_the_cell_that_map_server_makes_of_it(
    tmp_path: Path, channels: int, mode: Mode, negate: int
) -> None:
    rng = np.random.default_rng(channels)
    pixels = rng.integers(0, 256, (24, 24, channels)).astype(np.uint8)
    pixels[:, 12:, :] = pixels[:, 12:, :1]  # grey, and all values about the thresholds
    pixels[:, :12:2, -1] = 255
    file = write_map(tmp_path, pixels.squeeze(), mode=mode, negate=negate)
    keys = read_description(file)
    grey = channels < 3
    full = [[[*p[:1] * (3 if grey else 1), *p[1:]] for p in row] for row in pixels.tolist()]
    wanted = [[by_the_rules(p, 255, keys) for p in row] for row in full]
    assert read_grid(file).cells[::-1].tolist() == wanted
    assert {cell for row in wanted for cell in row} == {0, 1, 2}


def test_the_thresholds_themselves_are_unknown(tmp_path: Path) -> None:
    pixels = np.array([[203, 204, 205, 50, 51, 52]], np.uint8)  # 204 / 255 = 0.8, 51 / 255 = 0.2
    file = write_map(tmp_path, pixels, free_thresh=1 - 204 / 255, occupied_thresh=1 - 51 / 255)
    assert read_grid(file).cells.tolist() == [[2, 2, 0, 1, 2, 2]]


def test_a_raw_map_holds_percentages(tmp_path: Path) -> None:
    pixels = np.array([[0, 20, 21, 64, 65, 100, 101, 255]], np.uint8)
    for negate in (0, 1):  # which map_server leaves without effect
        file = write_map(tmp_path, pixels, mode="raw", negate=negate)
        assert read_grid(file).cells.tolist() == [[0, 0, 2, 2, 1, 1, 2, 2]]


@pytest.mark.parametrize(
    ("written", "meant"),
    [("0", False), ("1", True), ("2", True), ("-0", False), ("No", False), ("true", True)],
)
def test_negate_is_a_number_or_a_word(tmp_path: Path, written: str, meant: bool) -> None:
    assert read_description(write_map(tmp_path, negate=written)).negate is meant


def test_numbers_are_read_as_map_server_reads_them(tmp_path: Path) -> None:
    file = write_map(tmp_path, resolution="5e-2", origin="[1, -.5, +2.]", mode="Scale")
    keys = read_description(file)
    assert (keys.resolution, keys.origin, keys.mode) == (0.05, (1, -0.5, 2), Mode.SCALE)


# -- image formats ---------------------------------------------------------------------------------


def small_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(picture, "STRIP_PIXELS", 50)
    monkeypatch.setattr(pgm, "BLOCK_BYTES", 7)


@pytest.mark.parametrize("image", ["map.png", "map.pgm"])
def test_a_picture_read_in_many_strips_is_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, image: str
) -> None:
    small_steps(monkeypatch)
    file = write_map(tmp_path, two_rooms(), image=image)
    assert (read_grid(file).cells == cells_of(two_rooms())).all()


def test_a_plain_pgm_read_in_many_blocks_is_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    small_steps(monkeypatch)
    pixels = two_rooms()
    rows = [" ".join(map(str, row)) for row in pixels.tolist()]
    text = f"P2 180 80 255 {rows[0]}# a comment of 3 blocks 1 2 3\n" + "\n#\n".join(rows[1:])
    file = write_map(tmp_path, image="map.pgm")
    (tmp_path / "map.pgm").write_text(text)
    assert (read_grid(file).cells == cells_of(pixels)).all()


def cells_of(pixels: np.ndarray) -> np.ndarray:
    return np.select([pixels == FREE, pixels == OCCUPIED], [0, 1], 2)[::-1]


def plain(pixels: np.ndarray, white: int) -> bytes:
    height, width = pixels.shape
    rows = "\n".join(" ".join(map(str, row)) for row in pixels.tolist())
    return f"P2 # made by hand\n{width} {height}\n# largest\n{white}\n{rows} # end".encode()


def binary(pixels: np.ndarray, white: int) -> bytes:
    height, width = pixels.shape
    depth = np.uint8 if white < 256 else np.dtype(">u2")
    header = f"P5\n# CREATOR: map_saver.cpp 0.050 m/pix\n{width} {height}\n{white}\n"
    return header.encode() + pixels.astype(depth).tobytes()


@pytest.mark.parametrize("form", [plain, binary])
@pytest.mark.parametrize("white", [100, 255, 1000, 65535])
def test_pgm_of_any_depth(tmp_path: Path, form: Any, white: int) -> None:
    pixels = np.array([[white, 0, round(0.8 * white)], [white, white, 0]])
    file = write_map(tmp_path, image="map.pgm")
    (tmp_path / "map.pgm").write_bytes(form(pixels, white))
    assert read_grid(file).cells.tolist() == CELLS


def palette(pixels: np.ndarray) -> Image.Image:
    return Image.fromarray(pixels).convert("P")


def grey_16_bit(pixels: np.ndarray) -> Image.Image:
    return Image.fromarray(pixels.astype(np.uint16) * 257)


def colour(pixels: np.ndarray) -> Image.Image:
    return Image.fromarray(pixels).convert("RGB")


@pytest.mark.parametrize("form", [Image.fromarray, palette, grey_16_bit, colour])
@pytest.mark.parametrize("mode", ["trinary", "scale"])
def test_png_of_any_kind(tmp_path: Path, form: Any, mode: str) -> None:
    pixels = two_rooms()
    file = write_map(tmp_path, mode=mode)
    form(pixels).save(tmp_path / "map.png")
    assert (read_grid(file).cells == cells_of(pixels)).all()


def test_pgm_as_pillow_writes_it(tmp_path: Path) -> None:
    file = write_map(tmp_path, two_rooms(), image="map.pgm")
    assert (read_grid(file).cells == cells_of(two_rooms())).all()


def test_a_bitmap_is_free_and_occupied(tmp_path: Path) -> None:
    pixels = two_rooms(outside=OCCUPIED)
    file = write_map(tmp_path, pixels == FREE)
    assert Image.open(tmp_path / "map.png").mode == "1"
    assert (read_grid(file).cells == cells_of(pixels)).all()


def test_a_transparent_grey_counts_as_alpha(tmp_path: Path) -> None:
    for depth, key in ((1, UNKNOWN), (257, UNKNOWN * 257)):
        file = write_map(tmp_path, mode="scale")
        pixels = (THREE * np.uint16(depth)).astype(np.uint16 if depth > 1 else np.uint8)
        image = Image.fromarray(pixels)
        image.save(tmp_path / "map.png", transparency=key)
        assert read_grid(file).cells.tolist() == CELLS
        image.save(tmp_path / "map.png", transparency=OCCUPIED)
        assert read_grid(file).cells.tolist() == [[0, 0, 2], [0, 2, 2]]


def chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def png(header: bytes, rows: bytes) -> bytes:
    chunks = chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + chunks


def test_an_interlaced_png_is_read(tmp_path: Path) -> None:
    """Pillow cannot write one: of 1 x 2 pixels, both of them in passes of their own."""
    header = struct.pack(">IIBBBBB", 1, 2, 8, 0, 0, 0, 1)
    file = write_map(tmp_path)
    (tmp_path / "map.png").write_bytes(png(header, bytes([0, FREE, 0, OCCUPIED])))
    assert read_grid(file).cells.tolist() == [[1], [0]]


@given(
    st.integers(1, 40).flatmap(
        lambda width: st.lists(
            st.lists(st.sampled_from([FREE, OCCUPIED, UNKNOWN]), min_size=width, max_size=width),
            min_size=1,
            max_size=40,
        )
    ),
    st.sampled_from(["map.png", "map.pgm"]),
)
@quiet
def test_what_is_written_is_read_back(
    tmp_path_factory: pytest.TempPathFactory, rows: list[list[int]], image: str
) -> None:
    pixels = np.array(rows, np.uint8)
    file = write_map(tmp_path_factory.mktemp("map"), pixels, image=image)
    assert (read_grid(file).cells == cells_of(pixels)).all()


@pytest.mark.parametrize("image", ["map.png", "map.pgm"])
def test_memory_is_two_bytes_a_pixel_and_some(tmp_path: Path, image: str) -> None:
    pixels = np.tile(two_rooms(), (38, 17))[:3000, :3000]
    file = write_map(tmp_path, pixels, image=image)
    read_grid(file)  # imports scipy
    tracemalloc.start()
    try:
        grid = read_grid(file)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert grid.cells.size == 9_000_000
    strip = 24 * 2**20  # what a strip of a million pixels takes while it is classified
    assert peak < 2 * grid.cells.size + strip


def test_progress_is_told_up_to_the_last_row(tmp_path: Path) -> None:
    told: list[tuple[str, int, int]] = []
    read_grid(write_map(tmp_path, np.tile(two_rooms(), (20, 10))), lambda *what: told.append(what))
    assert [done for _, done, _ in told] == sorted({done for _, done, _ in told})
    assert len(told) > 1
    assert told[-1] == ("reading the map", 1600, 1600)


# -- maps that look wrong --------------------------------------------------------------------------


def on_yellow(pixels: np.ndarray) -> np.ndarray:
    """Return a colour image with unknown cells in a yellow of the same brightness."""
    return np.where((pixels == UNKNOWN)[..., None], [255, 255, 105], pixels[..., None])


@pytest.mark.parametrize(
    ("pixels", "keys", "message"),
    [
        (np.full((20, 20), UNKNOWN, np.uint8), {}, "no cell is free, so there are no rooms"),
        (np.full((20, 20), FREE, np.uint8), {}, "all cells are free, so there are no rooms"),
        (two_rooms(), {"negate": 1}, "the map looks inverted (set negate: 0 in the YAML)"),
        (255 - two_rooms(), {}, "the map looks inverted (set negate: 1 in the YAML)"),
        (255 - two_rooms(outside=OCCUPIED), {}, "the map looks inverted"),
        (255 - two_rooms(outside=FREE), {}, "the map looks inverted"),
        (
            np.full((9, 9), 100, np.uint8),
            {"mode": "raw"},
            "no cell is free, so there are no rooms (inv",
        ),
        (two_rooms(), {"layer": "{a: [1]}", "x\\ny": 1}, "layer, x\\ny: no key of map_server"),
        (on_yellow(two_rooms()), {}, "27% of the image is coloured"),
    ],
)
def test_what_looks_wrong_is_read_with_a_warning(
    tmp_path: Path, pixels: np.ndarray, keys: dict[str, Any], message: str
) -> None:
    file = write_map(tmp_path, pixels.astype(np.uint8), **keys)
    with pytest.warns(MapWarning, match=re.escape(message)) as caught:
        grid = read_grid(file)
    assert grid.cells.shape == pixels.shape[:2]
    assert str(caught[0].message).startswith(f"{file}: ")
    assert "\n" not in str(caught[0].message)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("outside", [UNKNOWN, FREE, OCCUPIED])
def test_corridors_around_a_solid_block_give_no_warning(tmp_path: Path, outside: int) -> None:
    pixels = np.full((300, 400), outside, np.uint8)
    pixels[8:292, 8:392] = OCCUPIED
    pixels[10:290, 10:390] = FREE
    pixels[50:250, 50:350] = OCCUPIED
    read_grid(write_map(tmp_path, pixels))


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("outside", [UNKNOWN, FREE, OCCUPIED])
@pytest.mark.parametrize("walls", [OCCUPIED, UNKNOWN])
def test_a_good_map_gives_no_warning(tmp_path: Path, outside: int, walls: int) -> None:
    read_grid(write_map(tmp_path, two_rooms(walls, outside)))
