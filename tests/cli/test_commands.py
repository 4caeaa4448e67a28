"""The real command: results to stdout, everything else to stderr, exit codes, whole files."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from subprocess import CompletedProcess
from typing import Any

import pytest
from plans import block, plan, rectangle

from sgraph_core import map_file


@pytest.fixture
def block_map(tmp_path: Path) -> Path:
    file = tmp_path / "block.json"
    map_file.save(block(0.15, 0.3), file)
    return file


def assert_one_line(result: CompletedProcess[str], *parts: str) -> None:
    assert result.returncode == 1
    assert result.stdout == ""
    lines = result.stderr.splitlines()
    assert len(lines) == 1, result.stderr
    for part in parts:
        assert part in lines[0]


# -- infer -----------------------------------------------------------------------------------------


def test_infer_prints_a_table_of_rooms_and_walls(sgraph: Any, block_map: Path) -> None:
    result = sgraph("infer", block_map)
    assert result.returncode == 0
    assert result.stderr == ""
    assert "4 rooms" in result.stdout
    assert "4 walls" in result.stdout
    assert "centre [m]" in result.stdout
    assert "20.0 m²" in result.stdout
    assert "0.150 m thick" in result.stdout


def test_infer_writes_a_complete_map_and_nothing_to_stdout(
    sgraph: Any, block_map: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out.json"
    result = sgraph("infer", block_map, "-o", out)
    assert (result.returncode, result.stdout, result.stderr) == (0, "", "")
    before, after = map_file.load(block_map), map_file.load(out)
    assert (after.wall_surfaces.segments == before.wall_surfaces.segments).all()
    assert after.truth == before.truth
    assert len(after.concepts["room"]) == len(after.concepts["wall"]) == 4


def test_json_is_exactly_what_the_output_file_holds(
    sgraph: Any, block_map: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out.json"
    result = sgraph("infer", block_map, "-o", out, "--json")
    assert result.stdout == out.read_text(encoding="utf-8")


def test_the_output_may_replace_the_input_and_is_a_fixed_point(
    sgraph: Any, block_map: Path
) -> None:
    assert sgraph("infer", block_map, "-o", block_map).returncode == 0
    once = block_map.read_bytes()
    assert sgraph("infer", block_map, "-o", block_map).returncode == 0
    assert block_map.read_bytes() == once
    assert [p.name for p in block_map.parent.iterdir()] == ["block.json"]


def test_only_the_wanted_concept_is_inferred(sgraph: Any, block_map: Path) -> None:
    document = json.loads(sgraph("infer", block_map, "--json", "--concept", "wall").stdout)
    assert list(document["concepts"]) == ["wall"]


def test_scorer_and_clusterer_may_be_chosen(sgraph: Any, block_map: Path) -> None:
    for options in (["--scorer", "baseline"], ["--clusterer", "room=cycles"]):
        document = json.loads(sgraph("infer", block_map, "--json", *options).stdout)
        assert len(document["concepts"]["room"]) == 4


def with_pins(file: Path, **pins: Any) -> Path:
    document = json.loads(file.read_text(encoding="utf-8"))
    file.write_text(json.dumps(document | {"pins": pins}), encoding="utf-8")
    return file


@pytest.mark.parametrize("options", [[], ["--clusterer", "room=cycles"]])
def test_pins_hold_and_the_output_is_a_fixed_point(
    sgraph: Any, block_map: Path, options: list[str]
) -> None:
    assert sgraph("infer", block_map, "-o", block_map, *options).returncode == 0
    pins = {"same_room": [[0, 12]], "not_same_room": [[4, 6]], "room_names": {"1": "lab"}}
    result = sgraph("infer", with_pins(block_map, **pins), "-o", block_map, *options)
    assert (result.returncode, result.stderr) == (0, "")
    once = json.loads(block_map.read_bytes())
    assert once["pins"] == pins
    rooms = [set(room["members"]) for room in once["concepts"]["room"]]
    assert any({0, 12} <= room for room in rooms)
    assert not any({4, 6} <= room for room in rooms)
    assert [room.get("name") for room in once["concepts"]["room"] if room["id"] == 1] == ["lab"]
    assert sgraph("infer", block_map, "-o", block_map, *options).returncode == 0
    assert json.loads(block_map.read_bytes()) == once


@pytest.mark.parametrize("suffix", ["png", "svg"])
def test_infer_and_plot_write_pictures(
    sgraph: Any, block_map: Path, tmp_path: Path, suffix: str
) -> None:
    picture = tmp_path / f"a.{suffix}"
    assert sgraph("infer", block_map, "--plot", picture).returncode == 0
    assert picture.stat().st_size > 1000
    picture.unlink()
    assert sgraph("plot", block_map, "-o", picture).returncode == 0
    assert picture.stat().st_size > 1000


def test_optimize_reports_to_stderr_and_moves_the_map(
    sgraph: Any, demo_map: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out.json"
    result = sgraph("infer", demo_map, "--optimize", "-o", out)
    assert result.returncode == 0
    assert result.stdout == ""
    assert re.search(r"optimised \d+ factors in \d+ iterations: error \S+ -> \S+", result.stderr)
    before, after = map_file.load(demo_map), map_file.load(out)
    assert (before.keyframes.poses != after.keyframes.poses).any()
    assert len(after.concepts["room"]) == 16


# -- bad input -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("content", "parts"),
    [
        (None, ["cannot be read: No such file"]),
        (b"", ["is empty"]),
        (bytes(range(256)), ["is not UTF-8"]),
        (b"[" * 20_000, ["nested too deeply"]),
        (b'{"format": "sgraph-map", "version": 7}', ["version = 7", "must be 1"]),
    ],
)
def test_bad_files_get_one_line_and_exit_1(
    sgraph: Any, tmp_path: Path, content: bytes | None, parts: list[str]
) -> None:
    file, out = tmp_path / "bad.json", tmp_path / "out.json"
    if content is not None:
        file.write_bytes(content)
    assert_one_line(sgraph("infer", file, "-o", out), str(file), *parts)
    assert not out.exists()


def test_pins_that_contradict_one_another_are_named(
    sgraph: Any, block_map: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out.json"
    with_pins(block_map, same_room=[[0, 1], [2, 1]], not_same_room=[[4, 0], [0, 2]])
    assert_one_line(
        sgraph("infer", block_map, "-o", out),
        f"{block_map}: pins.not_same_room[1] = [0, 2]: contradicts same_room [0, 1], [1, 2]",
    )
    assert not out.exists()


def test_output_that_cannot_be_written_is_named(sgraph: Any, block_map: Path) -> None:
    result = sgraph("infer", block_map, "-o", "/no/such/folder/out.json")
    assert_one_line(result, "/no/such/folder/out.json: No such file or directory")


def test_no_picture_is_left_of_a_map_that_cannot_be_written(
    sgraph: Any, block_map: Path, tmp_path: Path
) -> None:
    picture = tmp_path / "block.png"
    result = sgraph("infer", block_map, "-o", "/no/such/folder/out.json", "--plot", picture)
    assert_one_line(result, "/no/such/folder/out.json: No such file or directory")
    assert not picture.exists()


def test_a_pictures_name_is_checked_before_the_work(sgraph: Any) -> None:
    assert_one_line(sgraph("infer", "missing.json", "--plot", "a.xyz"), "a.xyz: a picture's name")


def test_a_map_without_keyframes_cannot_be_optimised(sgraph: Any, block_map: Path) -> None:
    assert_one_line(sgraph("infer", block_map, "--optimize"), "0 keyframes and 0 observations")


def test_a_map_that_cannot_be_optimised_is_named(
    sgraph: Any, demo_map: Path, tmp_path: Path
) -> None:
    file, content = tmp_path / "gap.json", json.loads(demo_map.read_text())
    file.write_text(json.dumps({**content, "odometry": content["odometry"][:10]}))
    assert_one_line(
        sgraph("infer", file, "--optimize"), f"sgraph: {file}: odometry does not connect"
    )


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        (["--concept", "roof"], "no concept 'roof'"),
        (["--clusterer", "room=magic"], "'magic' is neither"),
        (["--plot", "picture.bmp"], "must end in .png"),
    ],
)
def test_unknown_names_get_one_line(
    sgraph: Any, block_map: Path, arguments: list[str], part: str
) -> None:
    assert_one_line(sgraph("infer", block_map, *arguments), part)


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["--concept", "roof"], "sgraph: there is no concept 'roof'"),
        (["--factor", "roof=none"], "sgraph: there is no concept 'roof'"),
        (["--factor", "wall=magic"], "sgraph: factor of concept 'wall': 'magic' is neither"),
    ],
)
def test_a_wrong_option_of_an_optimisation_is_not_blamed_on_the_map(
    sgraph: Any, demo_map: Path, arguments: list[str], text: str
) -> None:
    assert_one_line(sgraph("infer", demo_map, "--optimize", *arguments), text)


@pytest.mark.parametrize(
    "arguments",
    [
        ["infer"],
        ["infer", "a.json", "--no-such-option"],
        ["infer", "a.json", "--clusterer", "cycles"],
        ["infer", "a.json", "--scorer", "magic"],
        ["infer", "a.json", "--scorer", "baseline", "--weights", "w"],
        ["infer", "a.json", "--factor", "wall=published"],
        ["evaluate", "a.json", "--scorer", "baseline", "--weights", "w"],
        ["evaluate", "a.json", "--stored", "--scorer", "baseline"],
        ["evaluate", "a.json", "--stored", "--weights", "w"],
        ["evaluate", "a.json", "--stored", "--clusterer", "room=cycles"],
        ["evaluate", "a.json", "--stored", "--uncalibrated"],
        ["no-such-command"],
        ["synth", "-o", "x", "--count", "0"],
    ],
)
def test_bad_usage_exits_2(sgraph: Any, arguments: list[str]) -> None:
    assert sgraph(*arguments).returncode == 2


# -- the other commands ----------------------------------------------------------------------------


def test_evaluate_prints_scores_of_folders_and_files(
    sgraph: Any, block_map: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "floors"
    folder.mkdir()
    map_file.save(plan(rectangle(0, 0, 5, 4)), folder / "one.json")
    map_file.save(block(0.1), folder / "two.json")
    result = sgraph("evaluate", block_map, folder)
    assert result.returncode == 0
    assert re.search(r"\| block +\| +1 \| +1\.000 \| 1\.000", result.stdout)
    assert re.search(r"\| floors +\| +2 \| +1\.000", result.stdout)
    rows = json.loads(sgraph("evaluate", folder, "--json", "--per-floor").stdout)
    assert [row["source"] for row in rows] == ["one", "two"]
    assert all(row["room_exact_f1"] == 1 for row in rows)


def test_evaluate_scores_what_a_file_holds(sgraph: Any, block_map: Path, tmp_path: Path) -> None:
    assert json.loads(sgraph("evaluate", block_map, "--stored", "--json").stdout)[0]["room_f1"] == 0
    assert sgraph("infer", block_map, "-o", block_map).returncode == 0
    (row,) = json.loads(sgraph("evaluate", block_map, "--stored", "--json").stdout)
    assert (row["room_f1"], row["wall_f1"], row["seconds_per_floor"]) == (1, 1, None)


def test_evaluate_prints_the_trajectory_error(sgraph: Any, demo_map: Path) -> None:
    reference = demo_map.with_suffix(".tum")
    result = sgraph("evaluate", demo_map, "--trajectory", reference)
    assert re.search(r"\| office .*\| +0\.4\d\d \|", result.stdout)


def test_evaluate_needs_truth(sgraph: Any, tmp_path: Path) -> None:
    graph = block(0.1)
    graph.truth = None
    map_file.save(graph, tmp_path / "map.json")
    assert_one_line(sgraph("evaluate", tmp_path / "map.json"), "has no truth")
    (tmp_path / "empty").mkdir()
    assert_one_line(sgraph("evaluate", tmp_path / "empty"), "holds no .json file")


def test_synth_writes_reproducible_maps(sgraph: Any, tmp_path: Path) -> None:
    for folder in ("one", "two"):
        result = sgraph("synth", "-o", tmp_path / folder, "--count", 3, "--seed", 5)
        assert result.returncode == 0
    names = sorted(p.name for p in (tmp_path / "one").iterdir())
    assert len(names) == 3
    for name in names:
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()


def test_synth_writes_reproducible_grids(sgraph: Any, tmp_path: Path) -> None:
    for folder in ("a", "b"):
        result = sgraph("synth", "--grid", "-o", tmp_path / folder, "--count", 2, "--seed", 5)
        assert (result.returncode, result.stdout) == (0, "")
        assert "wrote 2 maps to" in result.stderr
    for number in range(2):
        for file in ("map.yaml", "map.png", "rooms.png"):
            one, two = (
                tmp_path / folder / f"synthetic-5-{number:05d}" / file for folder in ("a", "b")
            )
            assert one.read_bytes() == two.read_bytes()


def test_synth_takes_ingredients_from_a_file(sgraph: Any, tmp_path: Path) -> None:
    config = tmp_path / "config.json"
    config.write_text('{"plan": {"floor_area_m2": [80, 80], "aspect": [1, 1]}}')
    assert sgraph("synth", "-o", tmp_path / "maps", "--config", config).returncode == 0
    config.write_text('{"plan": {"aspect": [3, 1]}}')
    result = sgraph("synth", "-o", tmp_path / "maps", "--config", config)
    assert_one_line(result, "config.json: plan.aspect: Value error, lower bound")


def test_growth_is_told_of_two_sizes_or_more(sgraph: Any) -> None:
    told = "whole inference grows with surfaces to the power of"
    one = sgraph("bench", "speed", "--size", 30, "--size", 30, "--repeats", 1)
    assert (one.returncode, one.stderr) == (0, "")
    assert told not in one.stdout
    assert told in sgraph("bench", "speed", "--size", 30, "--size", 60, "--repeats", 1).stdout


def test_updates_are_timed_by_room(sgraph: Any) -> None:
    result = sgraph("bench", "updates", "--rooms", 3, "--rooms", 6)
    assert (result.returncode, result.stderr) == (0, "")
    assert re.search(
        r"update and ISAM2 in 6 rooms take [\d.]+ times as long as in 3", result.stdout
    )


def test_optimisation_is_timed_on_blocks_of_rooms(sgraph: Any) -> None:
    run = sgraph("bench", "solve", "--rooms", 4, "--rooms", 6, "--repeats", 1)
    assert (run.returncode, run.stderr) == (0, "")
    rows = [line.split("|")[1].strip() for line in run.stdout.splitlines() if line.startswith("|")]
    assert rows[2:] == ["4", "6"]


def test_schema_prints_json(sgraph: Any) -> None:
    schema = json.loads(sgraph("schema").stdout)
    assert schema["title"] == "sgraph-map"


def test_concepts_are_listed_and_shown(sgraph: Any) -> None:
    listed = sgraph("concepts", "list")
    assert listed.returncode == 0
    assert re.search(r"room +wall_surface +same_room +sgraph-concepts", listed.stdout)
    shown = json.loads(sgraph("concepts", "show", "wall").stdout)
    assert shown["relation"] == "same_wall"
    assert_one_line(sgraph("concepts", "show", "roof"), "no concept 'roof' (known: room, wall)")


def test_the_version_is_printed(sgraph: Any) -> None:
    assert re.match(r"sgraph-concepts \d+\.\d+\.\d+\n$", sgraph("--version").stdout)


@pytest.mark.parametrize("by", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_training_says_how_to_go_on(by: signal.Signals, tmp_path: Path) -> None:
    out = tmp_path / "run"
    # the paper's layouts are drawn in no time
    command = [Path(sys.executable).parent / "sgraph", "train", "--config", "paper", "-o", out]
    with subprocess.Popen(
        command,
        stderr=subprocess.PIPE,
        text=True,
        # whoever runs the tests in the background may have it ignored
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # noqa: PLW1509
    ) as process:
        while process.poll() is None and not list(out.glob("floors/*.npz")):
            time.sleep(0.05)
        process.send_signal(by)
        _, errors = process.communicate(timeout=60)
    assert process.returncode == 130
    assert errors == f"sgraph: interrupted: the same command with --resume goes on in {out}\n"


def test_training_from_the_command_line(sgraph: Any, tmp_path: Path) -> None:
    out = tmp_path / "weights"
    config = tmp_path / "config.json"
    config.write_text('{"validation_floors": 1, "floors_per_step": 2, "hidden": 8}')
    options = ["--floors", 2, "--steps", 2, "--seed", 3, "--config", config]
    result = sgraph("train", "-o", out, *options)
    assert result.returncode == 0, result.stderr
    assert result.stdout == ""
    assert "wrote weights of room, wall" in result.stderr
    assert {"encoder.onnx", "room.onnx", "wall.onnx"} <= {p.name for p in out.iterdir()}
    assert_one_line(sgraph("train", "-o", out, *options), "already holds a training run")
