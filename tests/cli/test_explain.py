"""`sgraph infer --explain`: the answer on stdout, bad questions refused."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
from plans import block, plan, rectangle

from sgraph_cli.explanation import print_answer
from sgraph_concepts.spec import ConceptSpec
from sgraph_core import map_file
from sgraph_core.concepts import new_registry
from sgraph_core.detector import Detector
from sgraph_core.explain import explain_pair
from sgraph_core.graph import Pins, SGraph


@pytest.fixture
def block_map(tmp_path: Path) -> Path:
    file = tmp_path / "block.json"
    map_file.save(block(0.15), file)
    return file


@pytest.fixture
def open_map(tmp_path: Path) -> Path:
    """Two rooms of 5 x 4 m side by side; the wall's side in the first, surface 1, is missing."""
    whole = plan(rectangle(0, 0, 5, 4), rectangle(5.15, 0, 5, 4)).wall_surfaces
    graph = SGraph("flat")
    for row in (0, 2, 3, 4, 5, 6, 7):
        graph.add_wall_surface(row, whole.segments[row], whole.normals[row])
    file = tmp_path / "open.json"
    map_file.save(graph, file)
    return file


def test_a_room_is_explained_by_its_members_and_its_border(sgraph: Any, open_map: Path) -> None:
    result = sgraph("infer", open_map, "--explain", "room:0")
    assert (result.returncode, result.stderr) == (0, "")
    assert "room 0 of flat: confidence" in result.stdout
    assert len(re.findall(r"^ +[023] +2 of 2 ", result.stdout, re.MULTILINE)) == 3
    assert result.stdout.count("weakest") == 1
    assert re.search(r"open side +4\.00 m +5\.00, 4\.00 +5\.00, 0\.00 +7 \(room 1\)", result.stdout)
    assert "4 walls" not in result.stdout


def test_a_wall_is_explained(sgraph: Any, block_map: Path) -> None:
    result = sgraph("infer", block_map, "--explain", "wall:0")
    assert result.returncode == 0
    assert re.search(r"^ +1 +1 of 1 .* 7: [01]\.\d\d", result.stdout, re.MULTILINE)
    assert "border" not in result.stdout


def test_a_pair_is_explained_by_what_blocks_its_view(sgraph: Any, block_map: Path) -> None:
    result = sgraph("infer", block_map, "--explain", "3,5")
    assert result.returncode == 0
    lines = result.stdout.splitlines()
    assert lines[0] == "3 and 5 of plan are 10.15 m apart"
    assert lines[1] == "0 of 16 lines of sight are free; blocked by 1 (16), 7 (16)"
    assert re.search(r"same_room +not scored +room 0 +room 1", result.stdout)
    assert lines[-1] == ("not scored: they do not see each other and are more than 0.7 m apart")


@pytest.fixture
def pinned_map(tmp_path: Path) -> Path:
    graph = block(0.15)
    graph.pins = Pins(((0, 12),), ((0, 1),))
    file = tmp_path / "pinned.json"
    map_file.save(graph, file)
    return file


@pytest.mark.parametrize(
    ("pair", "pinned"), [("0,1", "apart"), ("1,12", "apart"), ("0,12", "together")]
)
def test_a_pin_is_the_reason_that_is_given(
    sgraph: Any, pinned_map: Path, pair: str, pinned: str
) -> None:
    lines = sgraph("infer", pinned_map, "--explain", pair).stdout.splitlines()
    assert [line for line in lines if line.startswith("same_room:")] == [
        f"same_room: pinned {pinned}"
    ]


def test_members_and_outsiders_that_are_pinned_are_marked(sgraph: Any, pinned_map: Path) -> None:
    room = sgraph("infer", pinned_map, "--explain", "room:0").stdout
    assert re.search(r"^ +0 .* pinned together with 12 *$", room, re.MULTILINE)
    assert re.search(r"^ +1[345] .* weakest *$", room, re.MULTILINE)
    other = sgraph("infer", pinned_map, "--explain", "room:1").stdout
    assert "strongest outside: 0 (room 0), pinned apart from 1, log-odds +" in other


@pytest.mark.parametrize(
    ("scores", "clusterer", "pair", "reason"),
    [
        ("everything", "two_nodes", (1, 7), "same_zone: scored for, but zone 0 and zone 1 have"),
        ("everything", "first_node", (1, 7), "same_zone: scored for, but 7 is in no zone (scored"),
        ("nothing", "two_nodes", (0, 2), "same_zone: scored against, but 0 and the rest of zone 0"),
    ],
)
def test_where_the_clusterer_went_against_the_score_a_line_says_why(
    capsys: pytest.CaptureFixture[str],
    scores: str,
    clusterer: str,
    pair: tuple[int, int],
    reason: str,
) -> None:
    registry = new_registry()
    parts = {"baseline": f"zone:{scores}", "clusterer": f"zone:{clusterer}"}
    registry.add(ConceptSpec(name="zone", relation="same_zone", **parts))
    detector = Detector(registry)
    graph = detector.infer(plan(rectangle(0, 0, 5, 4), rectangle(5.15, 0, 5, 4)))
    print_answer(explain_pair(graph, detector, *pair), graph)
    assert f"\n{reason}" in capsys.readouterr().out


def test_files_are_written_as_without_an_explanation(
    sgraph: Any, block_map: Path, tmp_path: Path
) -> None:
    plain, explained = tmp_path / "plain.json", tmp_path / "explained.json"
    assert sgraph("infer", block_map, "-o", plain).stdout == ""
    assert (
        "room 2 of plan"
        in sgraph("infer", block_map, "-o", explained, "--explain", "room:2").stdout
    )
    assert explained.read_bytes() == plain.read_bytes()


def test_the_optimised_map_is_explained(sgraph: Any, demo_map: Path) -> None:
    result = sgraph("infer", demo_map, "--optimize", "--explain", "room:0")
    assert result.returncode == 0
    assert "room 0 of office" in result.stdout


@pytest.mark.parametrize(
    ("question", "part"),
    [
        ("room:99", "there is no room 99"),
        ("roof:0", "there is no concept 'roof'"),
        ("0,99", "there is no wall surface 99"),
        ("4,4", "compared with itself"),
    ],
)
def test_what_does_not_exist_gets_one_line_and_nothing_is_written(
    sgraph: Any, block_map: Path, tmp_path: Path, question: str, part: str
) -> None:
    out = tmp_path / "out.json"
    result = sgraph("infer", block_map, "-o", out, "--explain", question)
    assert (result.returncode, result.stdout) == (1, "")
    (line,) = result.stderr.splitlines()
    assert part in line
    assert not out.exists()


@pytest.mark.parametrize(
    "question",
    [
        "",
        "room",
        "room:",
        "room:x",
        ":3",
        "1",
        "1,",
        "1,2,3",
        "-1,2",
        "room:" + "9" * 5000,
        "1," + "9" * 5000,
    ],
)
def test_malformed_questions_are_bad_usage(sgraph: Any, block_map: Path, question: str) -> None:
    result = sgraph("infer", block_map, "--explain", question)
    assert (result.returncode, result.stdout) == (2, "")
    assert "must be CONCEPT:ID" in result.stderr


def test_an_explanation_is_not_json(sgraph: Any, block_map: Path) -> None:
    result = sgraph("infer", block_map, "--explain", "room:0", "--json")
    assert (result.returncode, result.stdout) == (2, "")
