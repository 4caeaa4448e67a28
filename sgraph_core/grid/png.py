"""PNG pictures, of any depth and colour type, read by pillow."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray
from PIL.Image import Image
from PIL.PngImagePlugin import PngImageFile

from sgraph_concepts.errors import MapFileError
from sgraph_core.grid.picture import Picture, check_size, rows_of_strip

__all__ = ["open_png"]

SIGNATURE = b"\x89PNG\r\n\x1a\n"
CHANNELS = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}
"""By colour type."""
MOST_PIXELS_PER_BYTE = 8 * 1032
"""What the best deflate stream holds of the smallest pixels."""
BLOCK_BYTES = 2**16
"""How much is inflated at a time when the data are counted."""
DAMAGED = (
    OSError,
    SyntaxError,
    ValueError,
    EOFError,
    IndexError,
    KeyError,
    TypeError,
    struct.error,
    zlib.error,
)
"""What pillow and zlib raise for damaged files."""


def open_png(file: BinaryIO, path: Path) -> Picture:
    """Read a PNG picture. Colours of 16 bits are read as their upper 8.

    Raises:
        MapFileError: the file is damaged, or its header claims what it cannot hold.
    """
    header = file.read(33)
    known = header[:8] == SIGNATURE and header[12:16] == b"IHDR" and len(header) == 33
    if not known or header[25] not in CHANNELS:
        raise MapFileError(path, "", None, "has no PNG header: it is damaged")
    width, height = struct.unpack(">II", header[16:24])
    check_size(path, width, height, path.stat().st_size * MOST_PIXELS_PER_BYTE)
    try:
        if not _holds(file, _needed(width, height, *header[24:29])):
            # pillow would fill the rest with black
            raise MapFileError(path, "", None, "is cut off: pixels are missing")
        file.seek(0)
        image = PngImageFile(file)  # not Image.open, whose limit of pixels is lower and global
        if image.size != (width, height):  # a second header, of a size that was not checked
            raise MapFileError(path, "", None, "is damaged: it has two headers")
        image.load()
    except DAMAGED as error:
        raise MapFileError(path, "", None, f"is damaged: {error}") from error
    if image.mode == "P" and image.palette is None:
        raise MapFileError(path, "", None, "is damaged: its palette is missing")
    white = 65535 if image.mode == "I;16" else 255
    return Picture(width, height, white, _strips(image, path))


def _holds(file: BinaryIO, needed: int) -> bool:
    """Tell whether the data chunks that follow in a PNG file hold that many bytes."""
    inflate, count = zlib.decompressobj(), 0
    while len(head := file.read(8)) == 8:
        length, kind = struct.unpack(">I4s", head)
        if kind != b"IDAT":
            file.seek(length + 4, 1)
            continue
        while length and (block := file.read(min(length, BLOCK_BYTES))):
            length -= len(block)
            while block and count < needed and not inflate.eof:
                count += len(inflate.decompress(block, BLOCK_BYTES))
                block = inflate.unconsumed_tail
        if count >= needed or inflate.eof:
            break
        file.seek(4, 1)
    return count >= needed or count + len(inflate.flush()) >= needed


def _needed(
    width: int, height: int, bits: int, colour: int, _deflate: int, _filter: int, interlaced: int
) -> int:
    """Return how many bytes the rows of a PNG picture take, each with its filter's number."""
    pixel = bits * CHANNELS[colour]

    def rows(columns: int, count: int) -> int:
        return count * (1 + (columns * pixel + 7) // 8) if columns else 0

    if not interlaced:
        return rows(width, height)
    # Adam7: first column and row of each pass, and the steps between them
    passes = ((0, 0, 8, 8), (4, 0, 8, 8), (0, 4, 4, 8), (2, 0, 4, 4), (0, 2, 2, 4), (1, 0, 2, 2))
    return sum(
        rows(len(range(x, width, dx)), len(range(y, height, dy)))
        for x, y, dx, dy in (*passes, (0, 1, 1, 2))
    )


def _strips(image: PngImageFile, path: Path) -> Iterator[NDArray[np.integer[Any]]]:
    width, height = image.size
    rows = rows_of_strip(width)
    for low in range(0, height, rows):
        strip = image.crop((0, low, width, min(low + rows, height)))
        try:
            yield _channels(strip)
        except DAMAGED as error:
            raise MapFileError(path, "", None, f"is damaged: {error}") from error


def _channels(image: Image) -> NDArray[np.integer[Any]]:
    """Return an image's pixels as grey, [R, W, 1], as colour or as colour and alpha."""
    if image.mode == "I;16":
        return _with_key(np.asarray(image), image.info.get("transparency"))
    if image.has_transparency_data:
        return np.asarray(image.convert("RGBA"))
    if image.mode in ("1", "L"):
        return np.asarray(image.convert("L"))[..., None]
    return np.asarray(image.convert("RGB"))


def _with_key(grey: NDArray[np.uint16], key: int | None) -> NDArray[np.uint16]:
    """Return grey pixels as [R, W, 1], or as [R, W, 4] if one grey value is transparent."""
    if key is None:
        return grey[..., None]
    alpha = np.where(grey == key, 0, 65535).astype(np.uint16)
    return np.stack([grey, grey, grey, alpha], axis=2)
