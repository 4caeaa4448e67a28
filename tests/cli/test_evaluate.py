"""The commands that measure: evaluate's calibration and lists, calibrate, sweep."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest
from plans import block, plan, rectangle

from sgraph_core import map_file
from sgraph_core.evaluation.sweeps import SWEEPS


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    folder = tmp_path / "floors"
    folder.mkdir()
    map_file.save(block(0.15, 0.3), folder / "block.json")
    map_file.save(plan(rectangle(0, 0, 5, 4)), folder / "room.json")
    return folder


def test_evaluate_prints_the_calibration_errors(sgraph: Any, folder: Path) -> None:
    table = sgraph("evaluate", folder)
    assert re.search(r"\| room ECE \|.*\| wall ECE \|.*\| ATE \[m\] \|", table.stdout)
    (ours,) = json.loads(sgraph("evaluate", folder, "--json").stdout)
    (raw,) = json.loads(sgraph("evaluate", folder, "--json", "--uncalibrated").stdout)
    keys = ["room_ece", "wall_ece", "room_edge_ece_all", "wall_edge_ece_all"]
    assert all(0 <= row[key] < 0.5 for row in (ours, raw) for key in keys)
    assert ours["room_ece"] != raw["room_ece"]
    assert ours["room_edge_ece_all"] != raw["room_edge_ece_all"]


def test_what_a_file_holds_has_nodes_but_no_edges(sgraph: Any, folder: Path) -> None:
    for name in ("block", "room"):
        file = folder / f"{name}.json"
        assert sgraph("infer", file, "-o", file).returncode == 0
    (stored,) = json.loads(sgraph("evaluate", folder, "--stored", "--json").stdout)
    (anew,) = json.loads(sgraph("evaluate", folder, "--json").stdout)
    assert stored["room_ece"] == pytest.approx(anew["room_ece"])
    assert stored["room_edge_ece"] is stored["wall_edge_ece_all"] is None


def test_evaluate_draws_reliability_diagrams(sgraph: Any, folder: Path, tmp_path: Path) -> None:
    picture = tmp_path / "reliability.png"
    result = sgraph("evaluate", folder, folder / "block.json", "--reliability", picture)
    assert (result.returncode, result.stderr) == (0, "")
    assert picture.stat().st_size > 1000
    bad = sgraph("evaluate", folder, "--reliability", tmp_path / "reliability.txt")
    assert (bad.returncode, bad.stdout) == (1, "")
    assert bad.stderr.splitlines()[0].endswith("must end in .png, .svg, .pdf")


def test_evaluate_takes_lists_of_maps(sgraph: Any, folder: Path, tmp_path: Path) -> None:
    for name, text in (("some", "block\nelsewhere\n"), ("other", "room\n"), ("none", "attic\n")):
        (tmp_path / f"{name}.txt").write_text(text)
    lists = ["--only", tmp_path / "some.txt", "--only", tmp_path / "other.txt"]
    result = sgraph("evaluate", folder, *lists, "--json")
    assert result.stderr == (f"sgraph: warning: {tmp_path / 'some.txt'}: no PATH holds elsewhere\n")
    rows = json.loads(result.stdout)
    assert [(row["source"], row["floors"]) for row in rows] == [
        ("floors (some)", 1),
        ("floors (other)", 1),
    ]
    nothing = sgraph("evaluate", folder, "--only", tmp_path / "none.txt")
    assert (nothing.returncode, nothing.stdout) == (1, "")
    (line,) = nothing.stderr.splitlines()
    assert "holds none of the maps that" in line


def test_calibrate_prints_what_declarations_take(sgraph: Any, folder: Path) -> None:
    result = sgraph("calibrate", folder)
    assert result.returncode == 0
    number = r"-?\d+\.\d+"
    constants = f"intercept={number}, slope={number}, members={number}"
    lines = iter(result.stdout.splitlines())
    for concept in ("room", "wall"):
        line = rf"{concept}: head=HeadSpec\(\.\.\., intercept={number}, slope={number}\)"
        assert re.fullmatch(line, next(lines))
        assert re.fullmatch(rf"{concept}: confidence=ConfidenceSpec\({constants}\)", next(lines))
    assert "fitted to 5 nodes of 2 maps" in result.stderr


def test_calibrate_says_what_there_is_nothing_to_fit_to(sgraph: Any, folder: Path) -> None:
    result = sgraph("calibrate", folder / "room.json")
    assert result.returncode == 0
    assert result.stdout.startswith("room: ")
    assert "no wall was found" in result.stderr


def test_sweep_writes_scores_and_a_figure(sgraph: Any, tmp_path: Path) -> None:
    result = sgraph("sweep", "-o", tmp_path / "out", "--floors", 1)
    assert (result.returncode, result.stdout) == (0, "")
    record = json.loads((tmp_path / "out" / "sweeps.json").read_text())
    assert (record["floors"], record["seed"]) == (1, 1000)
    for sweep in SWEEPS:
        points = record["sweeps"][sweep.name]
        assert [point["value"] for point in points] == list(sweep.values)
        assert all(0 <= point["room_exact_f1"] <= point["room_f1"] <= 1 for point in points)
    assert (tmp_path / "out" / "sweeps.png").stat().st_size > 10_000
