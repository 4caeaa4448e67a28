"""Pictures are written whole, in the wanted format."""

from __future__ import annotations

from pathlib import Path

import pytest
from PIL import Image
from plans import block

from sgraph_concepts.errors import InputError
from sgraph_core.detector import Detector
from sgraph_core.graph import SGraph
from sgraph_core.plotting import plot


@pytest.mark.parametrize("suffix", [".png", ".svg", ".pdf"])
def test_a_picture_is_written(tmp_path: Path, suffix: str, detector: Detector) -> None:
    file = tmp_path / f"floor{suffix}"
    plot(detector.infer(block(0.2, 0.3)), file)
    assert file.stat().st_size > 1000
    assert [p.name for p in tmp_path.iterdir()] == [file.name]


def test_rooms_are_filled_with_colour(tmp_path: Path, detector: Detector) -> None:
    empty, full = tmp_path / "empty.png", tmp_path / "full.png"
    plot(block(0.2), empty)
    plot(detector.infer(block(0.2)), full)
    colours = [len(Image.open(file).convert("RGB").getcolors(1 << 24)) for file in (empty, full)]
    assert colours[1] > colours[0]


def test_an_empty_map_gives_a_picture_too(tmp_path: Path) -> None:
    plot(SGraph("a $name_ with^ marks"), tmp_path / "empty.png")
    assert (tmp_path / "empty.png").exists()


def test_other_formats_are_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"a\.bmp: a picture's name must end in \.png"):
        plot(SGraph(), tmp_path / "a.bmp")
