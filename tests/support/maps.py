"""ROS map_server maps to read."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

FREE, OCCUPIED, UNKNOWN = 254, 0, 205
"""Brightness as map_saver writes it."""
KEYS = {
    "resolution": 0.05,
    "origin": "[0.0, 0.0, 0.0]",
    "negate": 0,
    "occupied_thresh": 0.65,
    "free_thresh": 0.196,
}


def write_map(folder: Path, pixels: Any = None, *, image: str = "map.png", **keys: Any) -> Path:
    """Write a map; a key that is None is left out."""
    file = folder / "map.yaml"
    lines = {"image": image, **KEYS, **keys}
    file.write_text("".join(f"{k}: {v}\n" for k, v in lines.items() if v is not None))
    if pixels is not None:
        Image.fromarray(np.asarray(pixels)).save(folder / image)
    return file


def two_rooms(walls: int = OCCUPIED, outside: int = UNKNOWN) -> np.ndarray:
    """Return the pixels of two rooms of 4 m x 3 m, at 5 cm, with a door between them."""
    pixels = np.full((80, 180), outside, np.uint8)
    pixels[8:72, 8:172] = walls
    pixels[10:70, 10:170] = FREE
    pixels[10:70, 89:91] = walls
    pixels[30:46, 89:91] = FREE
    return pixels
