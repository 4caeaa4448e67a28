"""The real command on labelled grids: evaluate, and labelled images of the rooms."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from maps import two_rooms, write_map
from PIL import Image
from plans import plan, rectangle

from sgraph_core import map_file

WEST, EAST = np.s_[10:70, 10:89], np.s_[10:70, 91:170]
MOST_OF_EAST = np.s_[10:70, 91:139]
"""60 % of its columns: intersection over union 0.6."""


def write_labelled(folder: Path, *rooms: tuple[slice, slice]) -> None:
    folder.mkdir(parents=True)
    write_map(folder, two_rooms())
    labels = np.zeros(two_rooms().shape, np.uint16)
    for number, room in enumerate(rooms):
        labels[room] = 300 * (number + 1)
    labels[0:5, 0:5] = 7  # 0.06 m2: too small to count
    Image.fromarray(labels).save(folder / "rooms.png")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_labelled(tmp_path / "huts" / "hut", WEST, EAST)
    write_labelled(tmp_path / "huts" / "hut-furnished", WEST)
    write_labelled(tmp_path / "huts" / "robot-hut", WEST, MOST_OF_EAST)
    return tmp_path / "huts"


def rows_of(result: Any) -> dict[str, dict[str, float]]:
    assert (result.returncode, result.stderr) == (0, "")
    return {row["map"]: row for row in json.loads(result.stdout)}


@pytest.mark.parametrize("how", [[], ["--classic", "watershed"]], ids=["detector", "watershed"])
def test_grids_get_the_scores_that_they_were_made_for(
    sgraph: Any, folder: Path, how: list[str]
) -> None:
    rows = rows_of(sgraph("evaluate", folder, *how, "--json"))
    means = ["mean of 1 plain", "mean of 1 furnished", "mean of 1 robot"]
    assert list(rows) == ["hut", "hut-furnished", "robot-hut", *means]
    known = {
        "hut": ((1, 1, 1), (1, 1, 1), 0.98),
        "hut-furnished": ((0.5, 1, 2 / 3), (0.5, 1, 2 / 3), 0.98),
        "robot-hut": ((1, 1, 1), (0.5, 0.5, 0.5), (0.98 + 0.6) / 2),
    }
    for (name, (loose, strict, iou)), mean in zip(known.items(), means, strict=True):
        scores = [f"room_{score}" for score in ("precision", "recall", "f1")]
        assert [rows[name][f"{score}_50"] for score in scores] == pytest.approx(loose)
        assert [rows[name][f"{score}_70"] for score in scores] == pytest.approx(strict)
        assert rows[name]["mean_iou"] == pytest.approx(iou, abs=0.02)
        assert {**rows[name], "map": mean} == rows[mean]
    if how:
        assert rows["hut"]["surface_recall"] is None
    else:
        assert rows["hut"]["surface_recall"] > 0.95
        assert rows["hut"]["surface_precision"] > 0.95


def test_a_grid_is_named_by_its_folder_or_its_file(
    sgraph: Any, folder: Path, tmp_path: Path
) -> None:
    hut = folder / "hut"
    assert "hut" in rows_of(sgraph("evaluate", hut, "--json"))
    assert "hut" in rows_of(sgraph("evaluate", hut / "map.yaml", "--json"))
    truth = (hut / "rooms.png").rename(tmp_path / "truth.png")
    assert "hut" in rows_of(sgraph("evaluate", hut, "--truth", truth, "--json"))
    absent = sgraph("evaluate", hut)
    assert absent.returncode == 1
    assert absent.stderr.endswith("map.yaml: has no rooms.png to evaluate against\n")
    Image.new("L", (3, 4)).save(truth)
    other = sgraph("evaluate", hut, "--truth", truth)
    assert other.returncode == 1
    assert other.stderr.endswith("truth.png: size = (3, 4): must have the map's 180 x 80 pixels\n")


def test_lists_pictures_and_tables(sgraph: Any, folder: Path, tmp_path: Path) -> None:
    (tmp_path / "list.txt").write_text("hut\nelsewhere\n")
    map_file.save(plan(rectangle(0, 0, 5, 4)), tmp_path / "room.json")
    plots = ["--plots", tmp_path / "plots"]
    result = sgraph("evaluate", folder, "--only", tmp_path / "list.txt", *plots)
    assert result.returncode == 0
    assert result.stderr == f"sgraph: warning: {tmp_path / 'list.txt'}: no PATH holds elsewhere\n"
    assert "| hut " in result.stdout
    assert "hut-furnished" not in result.stdout
    (picture,) = (tmp_path / "plots").iterdir()
    with Image.open(picture) as image:
        assert image.size == (172, 72)  # cropped to what is known or labelled
    both = sgraph("evaluate", folder / "hut", tmp_path / "room.json")
    assert both.stdout.count("rooms P") == 2
    only_grids = sgraph("evaluate", folder, tmp_path / "room.json", "--classic", "watershed")
    assert (only_grids.returncode, only_grids.stdout) == (2, "")
    stored = sgraph("evaluate", folder, "--stored")
    assert (stored.returncode, stored.stdout) == (2, "")


def test_infer_writes_a_labelled_image_or_nothing(
    sgraph: Any, folder: Path, tmp_path: Path
) -> None:
    hut, image = folder / "hut" / "map.yaml", tmp_path / "out" / "rooms.png"
    image.parent.mkdir()
    result = sgraph("infer", hut, "-o", image)
    assert (result.returncode, result.stdout, result.stderr) == (0, "", "")
    with Image.open(image) as opened:
        labels = np.asarray(opened)
    assert labels.shape == two_rooms().shape
    assert np.unique(labels).tolist() == [0, 1, 2]
    assert len(np.unique(labels[WEST])) == 1
    assert "rooms:\n- {label: 1, id: 0, name: null, area_m2: " in (
        image.with_suffix(".yaml").read_text()
    )
    before = {file: file.read_bytes() for file in hut.parent.iterdir()}
    plain = tmp_path / "room.json"
    map_file.save(plan(rectangle(0, 0, 5, 4)), plain)
    for source, target, message in (
        (plain, tmp_path / "room.png", "and this map has none"),
        (hut, hut.with_suffix(".png"), "belongs to the map that is read"),
    ):
        bad = sgraph("infer", source, "-o", target)
        assert (bad.returncode, bad.stdout) == (1, "")
        assert message in bad.stderr
        assert len(bad.stderr.splitlines()) == 1
    assert {file: file.read_bytes() for file in hut.parent.iterdir()} == before
    assert not (tmp_path / "room.png").exists()
