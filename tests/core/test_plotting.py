"""Pictures are written whole, in the wanted format."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from plans import block

from sgraph_concepts.errors import InputError
from sgraph_concepts.types import ConceptNode, NodeShape, OccupancyGrid
from sgraph_core.detector import Detector
from sgraph_core.graph import SGraph
from sgraph_core.plotting import draw, new_figure, plot


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


def test_holes_are_not_filled(tmp_path: Path) -> None:
    square = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])
    hole = tuple(map(tuple, (0.3 + 0.4 * square).tolist()))
    outline = tuple(map(tuple, square.tolist()))
    graph = SGraph()
    graph.concepts["room"] = [ConceptNode(0, (), shape=NodeShape(None, outline, (hole,)))]
    figure = new_figure(5, 5)
    axes = figure.add_subplot()
    draw(graph, axes)
    axes.autoscale_view()
    figure.savefig(tmp_path / "room.png", dpi=figure.dpi)
    pixels = np.asarray(Image.open(tmp_path / "room.png").convert("RGB"))[::-1]
    places = axes.transData.transform([(0.1, 0.1), (0.5, 0.5)]).astype(int)
    filled, empty = (pixels[row, column].tolist() for column, row in places)
    assert empty == [255, 255, 255]
    assert filled != empty


def test_a_grid_lies_where_its_cells_are() -> None:
    cells = np.full((3, 2), OccupancyGrid.UNKNOWN, np.uint8)
    graph = SGraph()
    graph.grid = OccupancyGrid(cells, 0.5, np.array([100.0, -20.0, 0.7]))
    axes = new_figure(5, 5).add_subplot()
    draw(graph, axes)
    (image,) = axes.images
    corners = np.array([[0.0, 0.0], [2.0, 0.0], [0.0, 3.0]])
    to_world = image.get_transform() - axes.transData
    np.testing.assert_allclose(to_world.transform(corners), graph.grid.to_world(corners))
    assert image.get_extent() == [0, 2, 0, 3]
    assert axes.get_xlim()[0] < 100 < axes.get_xlim()[1]


def test_walls_of_a_large_grid_are_not_thinned_away() -> None:
    cells = np.full((3, 6001), OccupancyGrid.FREE, np.uint8)
    cells[:, 4] = OccupancyGrid.OCCUPIED
    graph = SGraph()
    graph.grid = OccupancyGrid(cells, 0.05, np.zeros(3))
    axes = new_figure(5, 5).add_subplot()
    draw(graph, axes)
    array = axes.images[0].get_array()
    assert array.shape == (1, 1501)
    assert np.flatnonzero(array == OccupancyGrid.OCCUPIED).tolist() == [1]


def test_an_empty_map_gives_a_picture_too(tmp_path: Path) -> None:
    plot(SGraph("a $name_ with^ marks"), tmp_path / "empty.png")
    assert (tmp_path / "empty.png").exists()


def test_other_formats_are_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"a\.bmp: a picture's name must end in \.png"):
        plot(SGraph(), tmp_path / "a.bmp")
