"""PGM pictures, plain (P2) and binary (P5), of 8 and 16 bits.

pillow reads them too, but pixel by pixel in Python where the largest value is neither 255 nor
65535, and plain ones in a time that grows with the square of their comments.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from sgraph_concepts.errors import MapFileError
from sgraph_core.grid.picture import Picture, check_size, rows_of_strip

__all__ = ["open_pgm"]

LONGEST_HEADER = 2**16
"""Bytes; headers have 15 and a comment."""
BLOCK_BYTES = 2**20
"""How much of a plain picture's text is read at a time."""
LONGEST_NUMBER = 20
"""Digits; the largest value has 5, and zeros may stand before it."""

GAP = rb"(?:\s|#[^\n\r]*[\n\r])+"
HEADER = re.compile(rb"P([25])" + 3 * (GAP + rb"([0-9]{1,10})") + rb"\s")
COMMENT = re.compile(rb"#[^\n\r]*[\n\r]")
DIGITS_AND_SPACE = b"0123456789 \t\n\r\v\f"


def open_pgm(file: BinaryIO, path: Path) -> Picture:
    """Read a PGM picture's header; its pixels follow as the strips are asked for.

    Raises:
        MapFileError: the header is damaged or claims what the file cannot hold; likewise the
            pixels, while they are read.
    """
    header = HEADER.match(file.read(LONGEST_HEADER))
    if header is None:
        raise MapFileError(path, "", None, "has no PGM header: it is damaged")
    kind, width, height, white = map(int, header.groups())
    if not 1 <= white <= 65535:
        raise MapFileError(path, "largest value", white, "must be from 1 to 65535")
    left = path.stat().st_size - header.end()
    file.seek(header.end())
    depth = np.dtype(np.uint8 if white < 256 else ">u2")
    plain = kind == 2
    # two plain pixels take a digit each and a space between them
    check_size(path, width, height, (left + 1) // 2 if plain else left // depth.itemsize)
    strips = _plain(file, path, width, height) if plain else _binary(file, width, height, depth)
    return Picture(width, height, white, _checked(strips, white, path))


def _checked(
    strips: Iterable[NDArray[np.integer[Any]]], white: int, path: Path
) -> Iterator[NDArray[np.integer[Any]]]:
    for strip in strips:
        if strip.max() > white:
            rule = f"must not be above the largest value, {white}: the picture is damaged"
            raise MapFileError(path, "pixel", int(strip.max()), rule)
        yield strip[..., None]


def _binary(
    file: BinaryIO, width: int, height: int, depth: np.dtype[np.integer[Any]]
) -> Iterator[NDArray[np.integer[Any]]]:
    rows = rows_of_strip(width)
    for low in range(0, height, rows):
        count = min(rows, height - low)
        data = file.read(count * width * depth.itemsize)
        yield np.frombuffer(data, depth).reshape(count, width)


def _plain(file: BinaryIO, path: Path, width: int, height: int) -> Iterator[NDArray[np.int64]]:
    rows = rows_of_strip(width)
    read, waiting = 0, np.empty(0, np.int64)
    for numbers in _numbers(file, path):
        waiting = np.concatenate([waiting, numbers])
        while read < height and len(waiting) >= (count := min(rows, height - read)) * width:
            yield waiting[: count * width].reshape(count, width)
            waiting = waiting[count * width :]
            read += count
        if read == height:
            return
    raise MapFileError(path, "", None, "is cut off: pixels are missing")


def _numbers(file: BinaryIO, path: Path) -> Iterator[NDArray[np.int64]]:
    """Yield the numbers of a text block by block."""
    rest, in_comment = b"", False
    while block := file.read(BLOCK_BYTES):
        if in_comment:
            block = b"#" + block
        block = COMMENT.sub(b" ", block)
        block, comment, _ = block.partition(b"#")
        in_comment = bool(comment)
        block = rest + block
        whole = len(block) if in_comment else len(block.rstrip(b"0123456789"))
        block, rest = block[:whole], block[whole:]
        if len(rest) > LONGEST_NUMBER or block.translate(None, DIGITS_AND_SPACE):
            raise MapFileError(path, "", None, "holds what is no number: it is damaged")
        yield np.fromstring(block.strip(), np.int64, sep=" ")  # spaces alone would be a 0
    yield np.fromstring(rest, np.int64, sep=" ")
