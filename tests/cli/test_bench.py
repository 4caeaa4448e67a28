"""`sgraph bench paper` and `sgraph bench lidar`, from the command to the tables."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sgraph_core.evaluation.slam.variants import VARIANTS
from sgraph_core.training.config import config_file

TITLES = (
    "median ratio of the ATE to planes only",
    "Table II:",
    "Table III:",
    "Table IV:",
    "Figure 4:",
    "Table V: time to the first",
    "Table V: detection time",
)
ROOM = np.array([6.0, 4.0])


def write_log(path: Path) -> None:
    """Write a Carmen log of a robot that circles once in a room of 6 x 4 m."""
    lines = ["# by hand"]
    for number, turn in enumerate(np.linspace(0, 2 * np.pi, 60)):
        x, y = ROOM / 2 + [1.5 * np.cos(turn), np.sin(turn)]
        heading = turn + np.pi / 2
        rays = heading + np.radians(np.arange(181) - 90)
        ways = np.stack([np.cos(rays), np.sin(rays)])
        with np.errstate(divide="ignore"):
            walls = np.where(ways > 0, (ROOM - [x, y])[:, None], [[x], [y]]) / np.abs(ways)
        ranges = " ".join(f"{one:.3f}" for one in walls.min(axis=0))
        pose = f"{x:.4f} {y:.4f} {heading:.4f}"
        lines.append(f"FLASER 181 {ranges} {pose} {pose} {number}.0 robot {number}.0")
    path.write_text("\n".join(lines) + "\n")


def test_the_papers_tables_are_printed_and_an_ended_run_is_not_repeated(
    sgraph: Any, tmp_path: Path
) -> None:
    arguments = ["bench", "paper", "--scene", "C1F1s", "--seeds", 1, "-o", tmp_path / "kept"]
    run = sgraph(*arguments, "--json", tmp_path / "out.json")
    assert run.returncode == 0, run.stderr
    for title in TITLES:
        assert f"\n{title}" in run.stdout
    assert "the paper's own" in run.stdout
    results = json.loads((tmp_path / "out.json").read_text())["results"]
    assert [one["variant"] for one in results] == list(VARIANTS)
    files = {file: file.stat().st_mtime_ns for file in (tmp_path / "kept").rglob("*.json")}
    again = sgraph(*arguments)
    assert again.stdout == run.stdout
    assert {file: file.stat().st_mtime_ns for file in files} == files
    mixed = sgraph(*arguments, "--paper-weights", tmp_path)
    assert_one_line(mixed, "encoder.onnx: cannot be read")
    assert_one_line(sgraph(*arguments, "--drift", 3), "kept: holds results of other settings")


def test_the_papers_variants_take_the_weights_of_a_training(sgraph: Any, tmp_path: Path) -> None:
    settings = json.loads(config_file("paper").read_text())
    tiny = {"floors": 2, "validation_floors": 1, "floors_per_step": 2, "hidden": 8, "steps": 2}
    config = tmp_path / "config.json"
    config.write_text(json.dumps({**settings, **tiny}))
    trained = sgraph("train", "--config", config, "-o", tmp_path / "weights")
    assert trained.returncode == 0, trained.stderr
    arguments = ["bench", "paper", "--scene", "C1F1s", "--seeds", 1]
    kept, out = tmp_path / "kept", tmp_path / "out.json"
    run = sgraph(*arguments, "-o", kept, "--json", out, "--paper-weights", tmp_path / "weights")
    assert run.returncode == 0, run.stderr
    content = json.loads(out.read_text())
    assert content["settings"]["paper_weights"]
    walls = {one["variant"]: one["walls"] for one in content["results"]}
    assert walls["ours, rooms + walls"] != walls["paper, rooms + walls"]
    assert_one_line(sgraph(*arguments, "-o", kept), "kept: holds results of other settings")


def test_logs_are_compared_without_truth(sgraph: Any, tmp_path: Path) -> None:
    write_log(tmp_path / "circle.log")
    run = sgraph("bench", "lidar", tmp_path / "circle.log", "--seeds", 2, "-o", tmp_path / "kept")
    assert run.returncode == 0, run.stderr
    assert "\nATE RMSE [cm]" in run.stdout
    assert "the paper's own" not in run.stdout
    assert "precision" not in run.stdout
    rows = [line for line in run.stdout.splitlines() if line.startswith("| circle ")]
    assert rows[1].count("±") == len(VARIANTS) - 1  # all but the corrupted: that needs truth


def assert_one_line(run: Any, text: str) -> None:
    assert run.returncode == 1
    (line,) = run.stderr.splitlines()
    assert text in line


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["paper", "--scene", "C9"], "there is no scene 'C9': known are C1F1s"),
        (["paper", "--range", "nan"], "range_m = nan: must be a positive number"),
        (["lidar", "absent.log"], "absent.log: cannot be read"),
        (["lidar", "README.md"], "is no Carmen log"),
        (["lidar", "README.md", "--json", "./README.md"], "is a log that is read"),
        (
            ["paper", "--json", "absent/out.json"],
            "out.json: must be a file in a folder that exists",
        ),
    ],
)
def test_bad_input_is_one_line(
    sgraph: Any, arguments: list[str], text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "README.md").write_text("no log\n")
    assert_one_line(sgraph("bench", *arguments), text)
    assert list(tmp_path.iterdir()) == [tmp_path / "README.md"]


def test_a_file_in_place_of_the_folder_is_one_line(sgraph: Any, tmp_path: Path) -> None:
    (tmp_path / "kept").write_text("")
    run = sgraph("bench", "paper", "--scene", "C1F1s", "--seeds", 1, "-o", tmp_path / "kept")
    assert_one_line(run, "File exists")
