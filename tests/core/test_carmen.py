"""Carmen logs: what is read, and what is refused."""

from __future__ import annotations

import gzip
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sgraph_concepts.errors import InputError
from sgraph_core.frontend.carmen import CarmenLog, read_carmen, record


def flaser(ranges: list[float], x: float = 0.0, stamp: float = 1.0) -> str:
    numbers = " ".join(f"{value:.4f}" for value in ranges)
    return f"FLASER {len(ranges)} {numbers} {x} 0.5 0.1 {x} 0.5 0.1 {stamp} host {stamp}\n"


def robotlaser(ranges: list[float], x: float = 0.0, farthest: float = 80.0) -> str:
    numbers = " ".join(map(str, ranges))
    step = np.pi / (len(ranges) - 1)
    return (
        f"ROBOTLASER1 0 {-np.pi / 2} {np.pi} {step} {farthest} 0.01 0 {len(ranges)} {numbers} 0 "
        f"{x} 2.0 0.3 9 9 9 0 0 0 0 0 5.5 host 6.5\n"
    )


def write(path: Path, text: str) -> Path:
    path.write_bytes(gzip.compress(text.encode()) if path.suffix == ".gz" else text.encode())
    return path


@pytest.mark.parametrize("name", ["a.log", "a.log.gz", "a.gz"])
def test_scans_poses_and_stamps_are_read(tmp_path: Path, name: str) -> None:
    text = "# a comment\nPARAM x y\n\n" + flaser([1, 2, 3, 81.9, 5], stamp=4) + "ODOM 0 0 0\n"
    log = read_carmen(write(tmp_path / name, text))
    assert log.name == "a"
    assert log.poses.tolist() == [[0.0, 0.5, 0.1]]
    assert log.stamps.tolist() == [4.0]
    half = np.sqrt(0.5)
    expected = [[0, -1], [2 * half, -2 * half], [3, 0], [0, 5]]  # 81.9 m: nothing was hit
    assert log.scans[0] == pytest.approx(np.array(expected, float), abs=1e-12)


def test_a_compressed_log_needs_no_name_that_says_so(tmp_path: Path) -> None:
    path = tmp_path / "a.log"
    path.write_bytes(gzip.compress(flaser([1, 2, 3]).encode()))
    assert len(read_carmen(path).scans) == 1


@pytest.mark.parametrize(
    ("count", "last_deg"), [(180, 89.0), (181, 90.0), (360, 89.5), (401, 50.0)]
)
def test_beams_go_where_their_number_says(tmp_path: Path, count: int, last_deg: float) -> None:
    (scan,) = read_carmen(write(tmp_path / "a.log", flaser([2.0] * count))).scans
    angles = np.degrees(np.arctan2(scan[:, 1], scan[:, 0]))
    assert angles[0] == pytest.approx(-50.0 if count == 401 else -90.0)
    assert angles[-1] == pytest.approx(last_deg)


def test_robotlaser_says_where_its_beams_go(tmp_path: Path) -> None:
    log = read_carmen(write(tmp_path / "a.log", robotlaser([1, 2, 9], x=7.0, farthest=9.0)))
    assert log.poses.tolist() == [[7.0, 2.0, 0.3]]
    assert log.stamps.tolist() == [6.5]
    assert log.scans[0] == pytest.approx(np.array([[0, -1], [2, 0]], float), abs=1e-12)


def test_of_two_kinds_of_messages_the_first_is_read(tmp_path: Path) -> None:
    text = robotlaser([1, 2, 3]) + flaser([1, 2, 3]) + robotlaser([1, 2, 3])
    assert len(read_carmen(write(tmp_path / "a.log", text)).scans) == 2


def test_keyframes_are_half_a_metre_or_twenty_degrees_apart() -> None:
    steps = [(0, 0), (0.4, 0), (0.6, 0), (0.7, 0), (0.7, 0.3), (0.7, 0.4), (1.3, 0.4)]
    poses = np.array([(x, 0.0, yaw) for x, yaw in steps])
    scans = tuple(np.empty((0, 2)) for _ in steps)
    recording = record(CarmenLog("a", np.arange(7.0), poses, scans), 0)
    assert recording.stamps.tolist() == [0.0, 2.0, 5.0, 6.0]
    assert recording.reference[:, 0].tolist() == [0.0, 0.6, 0.7, 1.3]
    unusable = record(CarmenLog("a", np.full(7, 1e9), poses, scans), 0)
    assert unusable.stamps.tolist() == [0.0, 1.0, 2.0, 3.0]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is no Carmen log"),
        ("PARAM a b\nhello\n", "is no Carmen log"),
        ("FLASER\n", "line 1: FLASER: number of ranges = ''"),
        ("\nFLASER -3 1 1 1\n", "line 2: FLASER: number of ranges = '-3'"),
        ("FLASER 99999999 1\n", "must be an integer up to 10000"),
        ("FLASER 3 1 2 3 0 0 0\n", "holds 7 fields: must hold 13 or more"),
        (flaser([1, 2, float("nan")]), "must be finite numbers"),
        (flaser([1, 2, 3], x=float("inf")), "must be finite numbers"),
        (flaser([1, 2, 3]).replace("1.0000", "one"), "must be finite numbers"),
        ("#\n" + flaser([1, 2, float("nan")]), "line 2: FLASER: field 5 = 'nan': ranges, angles"),
        (flaser([1, 2, 3]).replace("3.0000", "3.o"), "line 1: FLASER: field 5 = '3.o': ranges"),
        (flaser([1, 2, 3], x=float("inf")), "line 1: FLASER: field 6 = 'inf': ranges"),
        (flaser([1, 2, 3], stamp=2e12), "line 1: FLASER: field 14 = '2000000000000.0': ranges"),
        (robotlaser([1, 2, 3], farthest=float("nan")), "ROBOTLASER1: field 6 = 'nan': ranges"),
        (robotlaser([1, 2, 3], x=float("nan")), "ROBOTLASER1: field 14 = 'nan': ranges"),
        (flaser([81.9, 30, 0.01]) * 5, "no scan hits anything from 0.05 to 30 m"),
        (robotlaser([1, 2, 3])[:40], "line 1: ROBOTLASER1: holds"),
        ("x" * 1_000_001, "line 1: must be under 1000000 bytes"),
    ],
)
def test_bad_logs_are_refused_in_one_line(tmp_path: Path, text: str, message: str) -> None:
    path = write(tmp_path / "bad.log", text)
    with pytest.raises(InputError) as caught:
        read_carmen(path)
    assert message in str(caught.value)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


def test_damaged_and_missing_files_are_named(tmp_path: Path) -> None:
    whole = gzip.compress((flaser([1.0] * 180) * 50).encode())
    for name, content in {
        "cut.gz": whole[:-20],
        "plain.gz": b"FLASER 1",
        "bits.gz": whole[:60],
    }.items():
        (tmp_path / name).write_bytes(content)
        with pytest.raises(InputError, match=f"{name}: cannot be read"):
            read_carmen(tmp_path / name)
    with pytest.raises(InputError, match="No such file"):
        read_carmen(tmp_path / "absent.log")


def test_where_a_log_has_its_origin_does_not_matter() -> None:
    poses = np.array([[x, 0.5, 0.1] for x in np.arange(0, 5, 0.5)])
    scans = [np.array([[3.0, y] for y in np.arange(-2, 2, 0.05)])] * len(poses)
    logs = [
        CarmenLog("moved", np.arange(10.0), poses + np.array([*by, 0]), scans)
        for by in ((0, 0), (5e5, 5e6))
    ]
    here, there = (record(log, 0) for log in logs)
    assert there.reference == pytest.approx(here.reference, abs=1e-8)
    assert there.odometry == pytest.approx(here.odometry, abs=1e-8)
    assert logs[1].poses[0].tolist() == [5e5, 5e6 + 0.5, 0.1], "the log stays as it is"


def test_a_robot_that_stands_still_leaves_no_recording(tmp_path: Path) -> None:
    log = read_carmen(write(tmp_path / "a.log", flaser([1, 2, 3]) * 5))
    with pytest.raises(InputError, match="does not move"):
        record(log, 0)


LINE = st.lists(
    st.sampled_from(
        ["FLASER", "ROBOTLASER1", "3", "0", "1.5", "-1", "nan", "1e999", "x", "é", "10001"]
    )
    | st.floats().map(str),
    max_size=24,
).map(" ".join)


@given(st.lists(LINE, max_size=6).map("\n".join).map(str.encode) | st.binary(max_size=200))
def test_anything_is_read_or_refused(
    tmp_path_factory: pytest.TempPathFactory, content: bytes
) -> None:
    path = tmp_path_factory.getbasetemp() / "fuzz.log"
    for damaged in (content, flaser([1.0, 2.0, 3.0]).encode() + content):
        path.write_bytes(damaged)
        with suppress(InputError):
            log = read_carmen(path)
            assert np.isfinite(log.poses).all()
            assert all(np.isfinite(scan).all() for scan in log.scans)
