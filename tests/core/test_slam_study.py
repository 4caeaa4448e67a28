"""Studies keep their results, go on where they stopped, and sum up in tables."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sgraph_concepts.errors import InputError
from sgraph_core.evaluation.scores import Counts
from sgraph_core.evaluation.slam import study
from sgraph_core.evaluation.slam.drives import Conditions, Drive, log_drives, scene_drives
from sgraph_core.evaluation.slam.results import Result, Store
from sgraph_core.evaluation.slam.tables import Table, paired, tables, write_json
from sgraph_core.evaluation.slam.variants import BASELINE, VARIANTS


def result(drive: str, seed: int, variant: str, ate_m: float, **others: Any) -> Result:
    return Result(drive=drive, seed=seed, variant=variant, ate_m=ate_m, map_m=0.1, **others)


SOME = result("C1F1s", 3, "ours, rooms + walls", 0.02, rooms=Counts(1, 2, 3), first_room_s=4.5)


def test_a_result_survives_its_file(tmp_path: Path) -> None:
    Store(tmp_path / "new", {"drift": 1}).put("C1F1s", SOME)
    store = Store(tmp_path / "new", {"drift": 1})
    assert store.get("C1F1s", 3, "ours, rooms + walls") == SOME
    assert store.get("C1F1s", 3, "ours, rooms") is None
    assert store.get("C1F1s", 2, "ours, rooms + walls") is None


def test_every_method_has_a_file_of_its_own(tmp_path: Path) -> None:
    store = Store(tmp_path, {"drift": 1})
    for name in VARIANTS:
        store.put("C1F1s", result("C1F1s", 0, name, 1.0))
    found = [store.get("C1F1s", 0, name) for name in VARIANTS]
    assert [one.variant for one in found if one] == list(VARIANTS)


def test_results_of_other_settings_and_damaged_ones_are_refused(tmp_path: Path) -> None:
    store = Store(tmp_path, {"drift": 1})
    store.put("C1F1s", SOME)
    with pytest.raises(InputError, match="other settings or another version of the code"):
        Store(tmp_path, {"drift": 2})
    (file,) = tmp_path.glob("*/*/*.json")
    file.write_text("{}")
    with pytest.raises(InputError, match=r"ours-rooms-walls\.json: is no result"):
        store.get("C1F1s", 3, "ours, rooms + walls")


@pytest.fixture
def tasks(monkeypatch: pytest.MonkeyPatch) -> list[study.Task]:
    """What is computed, in place of which the results are made up."""
    done: list[study.Task] = []

    def make_up(wanted: Sequence[study.Task], _weights: Path | None) -> Iterator[study.Finished]:
        for task in wanted:
            done.append(task)
            drive, seed, names = task
            yield drive, [result(drive.name, seed, name, 1.0 + seed) for name in names]

    monkeypatch.setattr(study, "_in_parallel", make_up)
    return done


def test_nothing_is_computed_twice(tmp_path: Path, tasks: list[study.Task]) -> None:
    store, told = Store(tmp_path, {"drift": 1}), []

    def run(seeds: int) -> list[Result]:
        return study.run_study(
            scene_drives(["C1F1s", "SE2s"], Conditions()),
            seeds,
            store,
            lambda *report: told.append(report),
        )

    first = run(2)
    assert [(drive.name, seed) for drive, seed, _ in tasks] == [
        ("C1F1s", 0), ("C1F1s", 1), ("SE2s", 0), ("SE2s", 1),
    ]  # fmt: skip
    assert len(first) == 4 * len(VARIANTS)
    assert told[-1] == ("driving", len(first), len(first))
    tasks.clear()
    assert run(2) == first
    assert tasks == []
    (tmp_path / "SE2s" / "0001" / "odometry.json").unlink()
    assert run(2) == first
    assert [(drive.name, *rest) for drive, *rest in tasks] == [("SE2s", 1, ["odometry"])]
    tasks.clear()
    assert len(run(3)) == 6 * len(VARIANTS)
    assert {seed for _, seed, _ in tasks} == {2}


def test_methods_that_need_truth_do_not_run_on_logs(
    tmp_path: Path, tasks: list[study.Task]
) -> None:
    log = Drive("office", Conditions(), Path("office.log"), "12345678")
    study.run_study([log], 1, Store(tmp_path, {"drift": 1}), lambda *_: None)
    ((_, _, names),) = tasks
    assert set(VARIANTS) - set(names) == {"ours, corrupted"}
    assert (tmp_path / "office-12345678" / "0000" / "odometry.json").exists()


def test_settings_tell_conditions_and_weights_apart(tmp_path: Path) -> None:
    plain = Conditions()
    assert study.settings(plain) == study.settings(plain)
    (tmp_path / "room.onnx").write_bytes(b"1")
    found = [
        study.settings(plain),
        study.settings(Conditions(2.0)),
        study.settings(plain, tmp_path),
    ]
    (tmp_path / "room.onnx").write_bytes(b"2")
    found.append(study.settings(plain, tmp_path))
    assert len({json.dumps(one) for one in found}) == 4


def test_conditions_make_drives_harder() -> None:
    (plain,), (hard,) = (
        scene_drives(["C1F1s"], conditions)
        for conditions in (Conditions(), Conditions(drift_deg=5.0, range_m=4.0, keyframe_m=2.0))
    )
    one, two = plain.trial(0).recording, hard.trial(0).recording
    assert len(two) == pytest.approx(len(one) / 2, abs=1)
    assert max(np.linalg.norm(scan, axis=1).max() for scan in two.scans) < 4.5
    assert max(np.linalg.norm(scan, axis=1).max() for scan in one.scans) > 10
    assert two.odometry_sigmas[0, 2] == pytest.approx(5 * np.sqrt(2) * one.odometry_sigmas[0, 2])


@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), float("inf")])
def test_conditions_are_positive_numbers(value: float) -> None:
    with pytest.raises(InputError, match=r"range_m = .*: must be a positive number"):
        Conditions(range_m=value)


def test_two_logs_of_one_name_are_refused(tmp_path: Path) -> None:
    line = "FLASER 2 1.0 1.0 0 0 0 0 0 0 1.0 robot 1.0\n"
    for folder in ("one", "two"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "office.log").write_text(line)
    with pytest.raises(InputError, match="another log is called 'office' too"):
        log_drives([tmp_path / folder / "office.log" for folder in ("one", "two")], Conditions())


HAND_MADE = [
    result("A", 0, BASELINE, 0.10),
    result("A", 1, BASELINE, 0.20),
    result("B", 0, BASELINE, 0.10),
    result("B", 1, BASELINE, 0.10),
    result("A", 0, "ours, rooms", 0.05, rooms=Counts(3, 4, 4), first_room_s=1.0, update_ms=20.0),
    result("A", 1, "ours, rooms", 0.30, rooms=Counts(1, 4, 4), update_ms=40.0),
    result("B", 0, "ours, rooms", 0.05, rooms=Counts(4, 8, 4), first_room_s=3.0, update_ms=10.0),
    result("B", 1, "ours, rooms", 0.10, rooms=Counts(2, 4, 8), first_room_s=5.0, update_ms=10.0),
]


def by_title(start: str) -> Table:
    (table,) = [table for table in tables(HAND_MADE, False) if table.title.startswith(start)]
    return table


def test_tables_of_hand_made_results() -> None:
    ate = by_title("ATE RMSE")
    assert ate.columns == ("drive", BASELINE, "ours, rooms")
    assert ate.rows == (
        ("A", "15.00 ± 7.07", "17.50 ± 17.68"),
        ("B", "10.00 ± 0.00", "7.50 ± 3.54"),
        ("mean", "12.50", "12.50"),
    )
    assert by_title("precision / recall of rooms").rows == (
        ("A", "0.50 / 0.50"),
        ("B", "0.50 / 0.50"),
        ("mean", "0.50 / 0.50"),
    )
    first = by_title("time to the first room")
    assert first.rows == (("A", "1.0 (1 of 2)"), ("B", "4.0 ± 1.4"), ("mean", "2.5"))
    assert by_title("detection time").rows[2] == ("mean", "20.0")
    assert by_title("median ratio").rows == (
        ("A", "1.00 (1 / 1)"),
        ("B", "0.75 (1 / 0)"),
        ("mean", "0.88 (50% / 25%)"),
    )


def test_the_papers_own_figures_stand_below_its_methods() -> None:
    results = [result("A", 0, BASELINE, 0.1), result("A", 0, "free space", 0.1, update_ms=50.0)]
    found = {table.title: table for table in tables(results, True)}
    ate = found["Table II: ATE RMSE [cm]"]
    assert ate.columns == (
        "drive", BASELINE, "free space", "paper, rooms", "paper, rooms + walls",
    )  # fmt: skip
    assert ate.rows == (
        ("A", "10.00", "10.00", "", ""),
        ("the paper's own", "", "3.09", "2.93", "2.88"),
    )
    assert found["Table V: detection time per update [ms]"].rows[-1][1:] == ("77.8", "12.2")
    assert not [title for title in found if "walls" in title]


def test_the_json_holds_results_and_comparisons(tmp_path: Path) -> None:
    write_json(HAND_MADE, {"drift": 1}, tmp_path / "out.json")
    record = json.loads((tmp_path / "out.json").read_text())
    assert record["settings"] == {"drift": 1}
    assert [Result(**one) for one in record["results"]] == HAND_MADE
    first = record["ate_to_planes_only"][0]
    assert first.pop("median_ratio") == pytest.approx(1.0)
    assert first == {"drive": "A", "variant": "ours, rooms", "pairs": 2, "wins": 1, "losses": 1}
    assert set(paired(HAND_MADE)) == {("A", "ours, rooms"), ("B", "ours, rooms")}


def test_a_log_without_wall_surfaces_is_named(tmp_path: Path) -> None:
    path = tmp_path / "fog.log"
    path.write_text("".join(f"FLASER 3 2 9 4 {x} 0 0 {x} 0 0 {x} host {x}\n" for x in range(5)))
    (drive,) = log_drives([path], Conditions())
    with pytest.raises(InputError, match=r"fog\.log: no wall surface is found"):
        drive.trial(0)
