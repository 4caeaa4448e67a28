"""Bad map_server maps give one line that names file, place, value and rule."""

from __future__ import annotations

import io
import os
import struct
import warnings
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from maps import FREE, OCCUPIED, write_map
from PIL import Image

from sgraph_concepts.errors import MapFileError, MapWarning
from sgraph_core.grid.reader import read_grid

PIXELS = np.array([[FREE, OCCUPIED], [FREE, FREE]], np.uint8)


def error_of(file: Path) -> str:
    with pytest.raises(MapFileError) as caught:
        read_grid(file)
    text = str(caught.value)
    assert "\n" not in text
    return text


# -- YAML ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"image": ""}, "image: must name a file"),
        ({"image": "[a.png]"}, 'image = ["a.png"]: must name a file'),
        ({"image": "none.png"}, "none.png: cannot be read: No such file or directory"),
        ({"image": '"\\e[31m.png"'}, r'\u001b[31m.png": cannot be read'),
        ({"image": "."}, ": must be a file"),
        ({"image": '"a\\0b.png"'}, "image: must name a file"),
        ({"image": '"\\ud800.png"'}, "image: must name a file"),
        ({"resolution": None}, "resolution: is required"),
        ({"resolution": 0}, "resolution = 0: must be metres per pixel from 0.001 to 1"),
        ({"resolution": -0.05}, "resolution = -0.05: must be metres per pixel"),
        ({"resolution": 50}, "resolution = 50: must be metres per pixel"),
        ({"resolution": "1e-300"}, "resolution = 1e-300: must be metres per pixel"),
        ({"resolution": ".nan"}, "resolution = .nan: must be a finite number"),
        ({"resolution": "nan"}, "resolution = nan: must be a finite number"),
        ({"resolution": "1e999"}, "resolution = 1e999: must be a finite number"),
        ({"resolution": "[0.05]"}, 'resolution = ["0.05"]: must be a finite number'),
        ({"resolution": "0.05 m"}, "resolution = 0.05 m: must be a finite number"),
        ({"resolution": '"0.05\\e[31m"'}, r'resolution = "0.05\u001b[31m": must be a finite'),
        ({"origin": None}, "origin: is required"),
        ({"origin": "[0, 0]"}, 'origin = ["0", "0"]: must be [x, y, yaw]'),
        ({"origin": "[0, 0, 0, 0]"}, "must be [x, y, yaw]"),
        ({"origin": 0}, "origin = 0: must be [x, y, yaw]"),
        ({"origin": "{x: 0, y: 0, yaw: 0}"}, "must be [x, y, yaw]"),
        ({"origin": "[0, .inf, 0]"}, "must be a finite number"),
        ({"origin": "[0, [0], 0]"}, "must be a finite number"),
        ({"origin": "[2e8, 0, 0]"}, "must be within 1e+08 m"),
        ({"negate": "maybe"}, "negate = maybe: must be 0 or 1"),
        ({"negate": 0.5}, "negate = 0.5: must be 0 or 1"),
        ({"negate": None}, "negate: is required"),
        ({"free_thresh": None}, "free_thresh: is required"),
        ({"occupied_thresh": 65}, "occupied_thresh = 65: must be from 0 to 1"),
        ({"free_thresh": 0.7}, "free_thresh = 0.7: must not be above occupied_thresh"),
        ({"mode": "binary"}, "mode = binary: must be one of trinary, scale, raw"),
        ({"mode": "[raw]"}, 'mode = ["raw"]: must be one of'),
        ({"resolution ": 1}, "line 7 = resolution: key occurs twice"),
        ({"? [a]": 1}, "line 7: a key must be text"),
        ({"x": "!!python/object/apply:os.system [id]"}, "tags are not read"),
        ({"x": "!include other.yaml"}, "line 7 = !include: tags are not read"),
        ({"resolution": "!!float 0.05"}, "tags are not read"),
        ({"x": "&a [1]"}, "line 7 = a: anchors and aliases are not read"),
        ({"x": "*a"}, "line 7 = a: anchors and aliases are not read"),
        ({"x": "[" * 9 + "]" * 9}, "line 7: is nested more than 8 deep"),
        ({"x": "[" * 50_000}, "line 7: is nested more than 8 deep"),
        ({"x": "[1"}, "is not YAML: expected ',' or ']'"),
        ({"x": "\t- 1"}, "is not YAML: found character"),
        ({"x": "a\x00b"}, "is not YAML: unacceptable character"),
        ({"x": "1\n---\ny: 2"}, "is not YAML: but found another document"),
    ],
)
def test_one_wrong_key_is_named(tmp_path: Path, keys: dict[str, Any], message: str) -> None:
    Image.fromarray(PIXELS).save(tmp_path / "map.png")
    assert message in error_of(write_map(tmp_path, **keys))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "must hold keys and values"),
        (b"- 1\n- 2\n", "must hold keys and values"),
        (b"\xff\xfe\x00", "byte 0: is not UTF-8 text"),
        (b"# " + bytes(2**16), "it has more than 65536 bytes"),
        (b"a: &a [x,x]\nb: &b [*a,*a]\nc: &c [*b,*b]\n", "line 1 = a: anchors and aliases"),
    ],
)
def test_what_is_no_map_server_yaml_is_refused(
    tmp_path: Path, content: bytes, message: str
) -> None:
    file = tmp_path / "map.yaml"
    file.write_bytes(content)
    assert message in error_of(file)


def test_a_yaml_of_100_mb_is_not_read_whole(tmp_path: Path) -> None:
    file = tmp_path / "map.yaml"
    with file.open("wb") as opened:
        opened.truncate(10**8)
    assert "it has more than 65536 bytes" in error_of(file)


def test_a_pipe_is_no_image(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "map.png")
    assert "map.png: must be a file" in error_of(write_map(tmp_path))


# -- images ----------------------------------------------------------------------------------------


def chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def png_header(width: int, height: int, bits: int = 8, colour: int = 0) -> bytes:
    header = struct.pack(">IIBBBBB", width, height, bits, colour, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "must be a PNG or PGM (P2, P5) image"),
        (b"GIF89a" + bytes(100), "must be a PNG or PGM (P2, P5) image"),
        (b"P6 1 1 255\n123", "must be a PNG or PGM (P2, P5) image"),
        (b"\x89PNG", "has no PNG header"),
        (png_header(0, 5), "size = 0 x 5: must have pixels"),
        (png_header(65535, 65535), "size = 65535 x 65535: must have at most 200000000 pixels"),
        (png_header(2**31, 1), "must be at most 65536 long and wide"),
        (png_header(10_000, 10_000) + bytes(67), "is more than the file holds: it is cut off"),
        (png_header(5, 5), "is cut off: pixels are missing"),
        (
            png_header(1, 1, colour=3) + chunk(b"IDAT", zlib.compress(b"\0\0")),
            "is damaged: its palette is missing",
        ),
        (
            png_header(2, 2) + chunk(b"IDAT", zlib.compress(bytes(5))) + chunk(b"IEND", b""),
            "is cut off: pixels are missing",
        ),
        (
            png_header(1, 1)
            + png_header(60_000, 60_000)[8:]
            + chunk(b"IDAT", zlib.compress(b"ab")),
            "is damaged: it has two headers",
        ),
        (png_header(5, 5, colour=9), "has no PNG header"),
        (b"P5\n", "has no PGM header"),
        (b"P5 x", "has no PGM header"),
        (b"P5 0 0 255\n", "size = 0 x 0: must have pixels"),
        (b"P5 2 2 0\n1234", "largest value = 0: must be from 1 to 65535"),
        (b"P5 2 2 70000\n12345678", "largest value = 70000: must be from 1 to 65535"),
        (b"P5 2 2 255\n123", "size = 2 x 2: is more than the file holds"),
        (b"P5 2 2 65535\n1234567", "size = 2 x 2: is more than the file holds"),
        (b"P5 60000 3000 255\n" + bytes(80), "60000 x 3000: is more than the file holds"),
        (b"P5 99999999999 1 255\n", "has no PGM header"),
        (b"P5 2 2 100\n\x00\x64\x65\x00", "pixel = 101: must not be above the largest value, 100"),
        (b"P2 2 2 255\n1 2 3 # 4\n", "is cut off: pixels are missing"),
        (b"P2 2 2 255\n1 2 -3 4\n", "holds what is no number"),
        (b"P2 2 2 255\n1 2 3 4e1\n", "holds what is no number"),
        (b"P2 2 2 255\n1 2 3 " + b"4" * 30, "holds what is no number"),
        (b"P2 2 2 255\n1 2 3 " + b"4" * 19 + b"\n", "must not be above the largest value, 255"),
        (b"P2 2 2 255\n1 2 3 256\n", "pixel = 256: must not be above the largest value, 255"),
    ],
)
def test_a_bad_image_is_named(tmp_path: Path, content: bytes, message: str) -> None:
    image = tmp_path / "map.png"
    image.write_bytes(content)
    text = error_of(write_map(tmp_path))
    assert text.startswith(f"{image}: ")
    assert message in text


def images() -> dict[str, bytes]:
    """Return a map of 60 x 60 noisy pixels in each format, as bytes."""
    pixels = np.random.default_rng(0).integers(0, 256, (60, 60)).astype(np.uint8)
    written = {}
    for form in ("png", "ppm"):
        buffer = io.BytesIO()
        Image.fromarray(pixels).save(buffer, form)
        written[form] = buffer.getvalue()
    written["plain"] = b"P2 60 60 255\n" + b" ".join(b"%d" % p for p in pixels.flat)
    return written


IMAGES = images()


@pytest.mark.parametrize("form", list(IMAGES))
@pytest.mark.parametrize("share", [0.05, 0.5, 0.9])
def test_a_truncated_image_is_refused(tmp_path: Path, form: str, share: float) -> None:
    data = IMAGES[form]
    (tmp_path / "map.png").write_bytes(data[: int(share * len(data))])
    text = error_of(write_map(tmp_path))
    assert "damaged" in text or "cut off" in text


def test_an_image_of_more_than_a_gigabyte_is_refused(tmp_path: Path) -> None:
    with (tmp_path / "map.png").open("wb") as file:
        file.truncate(2**30 + 1)
    assert "bytes = 1073741825: must be at most 1073741824" in error_of(write_map(tmp_path))


# -- whatever comes --------------------------------------------------------------------------------


def read_or_refuse(file: Path) -> None:
    """Read a map: a grid or a one-line error, and nothing else."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", MapWarning)
        warnings.filterwarnings("ignore", "Invalid APNG")  # pillow's own, of pictures that move
        try:
            cells, problem = read_grid(file).cells, ""
        except MapFileError as error:
            cells, problem = np.zeros((1, 1)), str(error)
    assert "\n" not in problem
    assert cells.size > 0
    assert cells.max() <= 2


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("fuzz")
    write_map(made, PIXELS)
    return made


YAML = (
    "image: map.png\nresolution: 0.05\norigin: [0.0, 0.0, 0.0]\nnegate: 0\n"
    "occupied_thresh: 0.65\nfree_thresh: 0.196\nmode: trinary\n"
)
FRAGMENTS = st.sampled_from(
    ["&a ", "*a", "!!python/object:os.x ", "[", "]", "{", "}", "? ", "- ", ": ", "\n", "|", ">-\n",
     "%YAML 1.1\n", "---\n", "...\n", "<<: ", "~", "null", ".inf", ".nan", "-1", "1e400", '"\\x00"',
     "'", "\t", "\ud7ff", "\x85", "# ", "0x1p3", "image: ", "resolution: "]
)  # fmt: skip


@settings(max_examples=200, deadline=None)
@given(st.binary(max_size=300))
def test_any_bytes_as_yaml(folder: Path, data: bytes) -> None:
    (folder / "any.yaml").write_bytes(data)
    read_or_refuse(folder / "any.yaml")


@settings(max_examples=300, deadline=None)
@given(
    st.lists(
        st.tuples(
            st.integers(0, len(YAML)), st.integers(0, 12), st.one_of(FRAGMENTS, st.text(max_size=8))
        ),
        max_size=4,
    )
)
def test_a_damaged_yaml(folder: Path, cuts: list[tuple[int, int, str]]) -> None:
    text = YAML
    for start, length, instead in cuts:
        text = text[:start] + instead + text[start + length :]
    (folder / "damaged.yaml").write_text(text, encoding="utf-8")
    read_or_refuse(folder / "damaged.yaml")


@settings(max_examples=200, deadline=None)
@given(
    st.sampled_from([b"", b"\x89PNG\r\n\x1a\n", png_header(3, 3), b"P5 ", b"P2 ", b"P5 2 2 255\n"]),
    st.binary(max_size=100),
)
@example(b"P2 3 3 255\n", b"#" * 50)
def test_any_bytes_as_image(folder: Path, start: bytes, rest: bytes) -> None:
    (folder / "any.png").write_bytes(start + rest)
    write_map(folder, image="any.png")
    read_or_refuse(folder / "map.yaml")


CHUNKS = st.tuples(
    st.sampled_from([b"PLTE", b"tRNS", b"gAMA", b"iCCP", b"acTL", b"fcTL", b"fdAT", b"zTXt",
                     b"IHDR", b"iTXt", b"eXIf", b"pHYs", b"IEND", b"abcd"]),
    st.binary(max_size=30),
)  # fmt: skip


@settings(max_examples=200, deadline=None)
@given(
    st.tuples(st.integers(1, 9), st.integers(1, 9)),
    st.sampled_from([(1, 0), (8, 0), (16, 0), (8, 2), (1, 3), (8, 3), (16, 4), (8, 6), (3, 7)]),
    st.tuples(st.integers(0, 1), st.integers(0, 1), st.integers(0, 2)),
    st.lists(CHUNKS, max_size=3),
    st.one_of(st.binary(max_size=200), st.sampled_from([bytes(1000), b"\0\xff\x07" * 300])),
    st.lists(CHUNKS, max_size=2),
)
def test_any_chunks_as_png(
    folder: Path,
    size: tuple[int, int],
    kind: tuple[int, int],
    methods: tuple[int, int, int],
    before: list[tuple[bytes, bytes]],
    rows: bytes,
    after: list[tuple[bytes, bytes]],
) -> None:
    header = struct.pack(">IIBBBBB", *size, *kind, *methods)
    parts = [(b"IHDR", header), *before, (b"IDAT", zlib.compress(rows)), *after, (b"IEND", b"")]
    data = b"\x89PNG\r\n\x1a\n" + b"".join(chunk(*part) for part in parts)
    (folder / "chunks.png").write_bytes(data)
    write_map(folder, image="chunks.png")
    read_or_refuse(folder / "map.yaml")


@settings(max_examples=300, deadline=None)
@given(
    st.sampled_from(sorted(IMAGES)),
    st.lists(
        st.tuples(st.floats(0, 1), st.integers(0, 10), st.binary(max_size=10)),
        min_size=1,
        max_size=4,
    ),
)
def test_a_damaged_image(folder: Path, form: str, cuts: list[tuple[float, int, bytes]]) -> None:
    data = IMAGES[form]
    for share, length, instead in cuts:
        start = int(share**4 * len(data))  # mostly in the header
        data = data[:start] + instead + data[start + length :]
    (folder / "damaged.png").write_bytes(data)
    write_map(folder, image="damaged.png")
    read_or_refuse(folder / "map.yaml")
