"""Calibration errors counted by hand, and confidences that come true as often as they say."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from plans import block, plan, rectangle

from sgraph_concepts.errors import InputError
from sgraph_concepts.spec import ConceptSpec, ConfidenceSpec, HeadSpec
from sgraph_concepts.types import ConceptNode, ScoredEdges
from sgraph_core import map_file
from sgraph_core.clustering.confidence import probability_right
from sgraph_core.concepts import installed, new_registry
from sgraph_core.detector import Detector
from sgraph_core.evaluation.calibration import (
    Calibration,
    Reliability,
    edges_calibration,
    nodes_calibration,
    same_room,
    same_wall,
)
from sgraph_core.evaluation.fitting import (
    Outcomes,
    fit_confidence,
    fit_relation,
    gather_outcomes,
)
from sgraph_core.evaluation.scores import Judged, score_floor
from sgraph_core.evaluation.sources import absent_names, find_sources
from sgraph_core.graph import SGraph, TrueRoom, Truth

CHANCES = st.lists(st.tuples(st.floats(0, 1), st.booleans()), min_size=1, max_size=30)


def of(outcomes: list[tuple[float, bool]]) -> Reliability:
    return Reliability.of([chance for chance, _ in outcomes], [ok for _, ok in outcomes])


# -- reliability -----------------------------------------------------------------------------------


def test_the_error_is_the_mean_gap_of_the_bins() -> None:
    # bins of .1: |.05 - 0|, |.15 - 1|, |.95 + .95 - 1|, over four probabilities
    reliability = of([(0.05, False), (0.15, True), (0.95, True), (0.95, False)])
    assert reliability.error == pytest.approx((0.05 + 0.85 + 0.9) / 4)


def test_gaps_within_a_bin_cancel_but_between_bins_do_not() -> None:
    assert of([(0.5, True), (0.5, False)]).error == 0
    assert of([(0.45, True), (0.55, False)]).error == pytest.approx(0.55)


def test_certainty_falls_into_the_outermost_bins() -> None:
    reliability = of([(0.0, False), (1.0, True)])
    assert reliability.count.tolist() == [1, 0, 0, 0, 0, 0, 0, 0, 0, 1]
    assert reliability.error == 0


def test_no_probabilities_have_no_error() -> None:
    assert np.isnan(Reliability().error)
    assert np.isnan(Reliability.of([], []).error)


def test_draws_from_the_probabilities_are_calibrated_and_others_are_not() -> None:
    rng = np.random.default_rng(0)
    chances = rng.random(100_000)
    assert Reliability.of(chances, rng.random(100_000) < chances).error < 0.01
    # what comes true with p squared is off by the mean of p - p^2
    too_sure = Reliability.of(chances, rng.random(100_000) < chances**2)
    assert too_sure.error == pytest.approx(1 / 2 - 1 / 3, abs=0.01)


@given(CHANCES, CHANCES)
def test_reliabilities_add_up_to_that_of_all(
    one: list[tuple[float, bool]], two: list[tuple[float, bool]]
) -> None:
    together = of(one) + of(two)
    assert together.error == pytest.approx(of(one + two).error)
    assert 0 <= together.error <= 1


# -- nodes and edges -------------------------------------------------------------------------------


def truth(rooms: list[set[int]], walls: list[tuple[int, int]] | None = None) -> Truth:
    return Truth(
        tuple(TrueRoom(k, None, tuple(room), None) for k, room in enumerate(rooms)),
        tuple(walls or ()),
    )


def test_nodes_count_when_they_are_scored_and_say_how_sure_they_are() -> None:
    graph = SGraph()
    graph.concepts["room"] = [
        ConceptNode(0, (1, 2, 3), confidence=0.9),
        ConceptNode(1, (4, 5, 9), confidence=0.7),  # most of it right
        ConceptNode(2, (6, 7), confidence=0.6),  # most of a wrong one
        ConceptNode(3, (20, 21, 22), confidence=0.8),  # on nothing labelled: left out
        ConceptNode(4, (10, 11, 12)),  # right, and does not say
    ]
    graph.concepts["wall"] = [
        ConceptNode(0, (1, 4), confidence=0.8),
        ConceptNode(1, (2, 5), confidence=0.4),
        ConceptNode(2, (30, 31), confidence=0.1),
    ]
    true = truth([{1, 2, 3}, {4, 5, 8}, {6, 13, 14, 15, 7}, {10, 11, 12}], [(4, 1)])
    nodes = nodes_calibration(score_floor(graph, true).judged).nodes
    assert nodes["room"].count.sum() == 3
    assert nodes["room"].error == pytest.approx((0.1 + 0.3 + 0.6) / 3)
    assert nodes["wall"].error == pytest.approx((0.2 + 0.4) / 2)


def test_sharing_a_room_is_known_of_surfaces_in_one_room() -> None:
    true = truth([{1, 2}, {3, 4, 5}, {5, 6}])
    pairs = np.array([[1, 2], [3, 4], [2, 3], [3, 3], [4, 5], [5, 6], [1, 9], [9, 9]])
    known, related = same_room(pairs, true)
    assert known.tolist() == [True, True, True, True, False, False, False, False]
    assert related[known].tolist() == [True, True, False, True]


def test_being_a_wall_is_known_of_surfaces_in_rooms_and_walls() -> None:
    true = truth([{1, 2, 3}], [(2, 7)])
    pairs = np.array([[7, 2], [1, 2], [3, 7], [1, 1], [1, 9]])
    known, related = same_wall(pairs, true)
    assert known.tolist() == [True, True, True, True, False]
    assert related[known].tolist() == [True, False, False, False]


def test_no_pairs_have_no_truth() -> None:
    for look_up in (same_room, same_wall):
        known, related = look_up(np.empty((0, 2), np.int64), truth([{1, 2}]))
        assert (known.shape, related.shape) == ((0,), (0,))


def test_edges_are_pairs_of_fragments_and_the_obvious_ones_count_apart() -> None:
    parents = np.array([10, 10, 11, 12])  # rows 0 and 1 are fragments of surface 10
    chances = np.array([0.99, 0.9, 0.3])
    relation = ScoredEdges(np.array([[0, 1], [1, 2], [0, 3]]), np.log(chances / (1 - chances)))
    true = truth([{10, 11, 1}, {12, 2, 3}])
    found = edges_calibration({"room": relation, "lift": relation}, parents, true)
    assert list(found.edges) == ["room"]
    assert found.edges["room"].error == pytest.approx((0.01 + 0.1 + 0.3) / 3)
    assert found.undecided["room"].error == pytest.approx((0.1 + 0.3) / 2)


def test_calibrations_of_floors_add_up() -> None:
    one = Calibration({"room": of([(0.9, True)])}, {"room": of([(0.2, False)])})
    two = Calibration({"room": of([(0.9, False)]), "wall": of([(0.5, True)])})
    both = one + two
    assert both.nodes["room"].error == pytest.approx(0.4)
    assert both.nodes["wall"].error == pytest.approx(0.5)
    assert both.edges["room"].error == pytest.approx(0.2)


# -- confidence of nodes ---------------------------------------------------------------------------


def chance(spec: ConfidenceSpec, confidence: float, members: int) -> float:
    (one,) = probability_right(spec, np.array([confidence]), np.array([members]))
    return float(one)


@given(st.floats(0.001, 0.999), st.integers(1, 100))
def test_neutral_constants_leave_a_confidence_as_it_is(confidence: float, members: int) -> None:
    neutral = ConfidenceSpec(intercept=0.0, slope=1.0, members=0.0)
    assert chance(neutral, confidence, members) == pytest.approx(confidence)


@given(st.floats(0, 1), st.floats(-10, 10), st.floats(-10, 10), st.floats(-10, 10))
def test_whatever_the_constants_it_is_a_probability(
    confidence: float, intercept: float, slope: float, members: float
) -> None:
    spec = ConfidenceSpec(intercept=intercept, slope=slope, members=members)
    assert 0 <= chance(spec, confidence, 7) <= 1


def drawn(spec: ConfidenceSpec, members: tuple[int, ...]) -> list[Judged]:
    """Draw nodes that are right as often as a spec says."""
    rng = np.random.default_rng(0)
    nodes = []
    for number in range(5000):
        confidence, size = float(rng.uniform(0.05, 0.95)), int(rng.choice(members))
        right = rng.random() < chance(spec, confidence, size)
        nodes.append(
            Judged(ConceptNode(number, tuple(range(size)), None, confidence=confidence), right)
        )
    return nodes


def test_the_fit_finds_the_constants_that_the_outcomes_were_drawn_with() -> None:
    wanted = ConfidenceSpec(intercept=-2.0, slope=1.5, members=0.8)
    found = fit_confidence(drawn(wanted, (3, 4, 6, 10, 30)))
    assert found.intercept == pytest.approx(wanted.intercept, abs=0.2)
    assert found.slope == pytest.approx(wanted.slope, abs=0.1)
    assert found.members == pytest.approx(wanted.members, abs=0.1)


def test_the_fit_makes_confidences_calibrated() -> None:
    nodes = drawn(ConfidenceSpec(intercept=1.0, slope=0.4, members=0.0), (2,))
    assert nodes_calibration({"wall": nodes}).nodes["wall"].error > 0.1
    fitted = fit_confidence(nodes)
    assert fitted.members == 0
    chances = [chance(fitted, one.node.confidence or 0, 2) for one in nodes]
    assert Reliability.of(chances, [one.right for one in nodes]).error < 0.02


def test_nodes_that_are_all_right_give_finite_constants() -> None:
    nodes = [Judged(ConceptNode(k, (1, 2), confidence=0.6 + k / 100), True) for k in range(30)]
    fitted = fit_confidence(nodes)
    assert 0.9 < chance(fitted, 0.75, 2) < 1


def test_nothing_to_fit_to_is_an_error() -> None:
    with pytest.raises(InputError, match="no scored node with a confidence"):
        fit_confidence([Judged(ConceptNode(0, (1, 2)), True)])


def test_confidences_are_calibrated_for_what_is_declared_only(detector: Detector) -> None:
    graph = plan(rectangle(0, 0, 10, 8), rectangle(10.15, 0, 10, 8), walls=[(1, 7)])
    raw = Detector(calibrated=False).infer(graph).concepts
    found = detector.infer(graph).concepts
    for concept in ("room", "wall"):
        spec = detector.registry[concept].spec.confidence
        assert spec is not None
        for ours, theirs in zip(found[concept], raw[concept], strict=True):
            assert ours.members == theirs.members
            wanted = chance(spec, theirs.confidence or 0, len(ours.members))
            assert ours.confidence == pytest.approx(wanted)
    for other in ({"scorer": "baseline"}, {"clusterers": {"room": "cycles"}}):
        as_it_is = Detector(**other, calibrated=False).infer(graph)  # type: ignore[arg-type]
        unfitted = Detector(**other).infer(graph)  # type: ignore[arg-type]
        assert unfitted.concepts["room"] == as_it_is.concepts["room"]


def test_a_concept_without_constants_keeps_its_clusterers_confidence() -> None:
    for spec, wanted in (
        (None, 0.5),
        (ConfidenceSpec(intercept=3.0, slope=1.0, members=0.0), 0.953),
    ):
        registry = new_registry()
        parts = {"baseline": "zone:everything", "clusterer": "zone:one_node"}
        registry.add(ConceptSpec(name="zone", relation="same_zone", confidence=spec, **parts))
        (zone,) = Detector(registry).infer(block(0.1)).concepts["zone"]
        assert zone.confidence == pytest.approx(wanted, abs=1e-3)


def test_a_relation_is_fitted_to_what_came_true() -> None:
    rng = np.random.default_rng(0)
    logits = rng.normal(0, 3, 20_000)
    related = rng.random(len(logits)) < 1 / (1 + np.exp(-(0.7 + 1.5 * logits)))
    assert fit_relation(logits, related) == pytest.approx((0.7, 1.5), abs=0.06)


def test_outcomes_are_those_of_the_installed_concepts(tmp_path: Path) -> None:
    file = tmp_path / "block.json"
    map_file.save(block(0.15), file)

    def outcomes(*concepts: str) -> dict[str, Outcomes]:
        registry = new_registry()
        for name in concepts:
            registry.add(installed()[name].spec, package=installed()[name].package)
        detector = Detector(registry, calibrated=False)
        return gather_outcomes([file], [], detector, lambda *_: None)

    both, rooms = outcomes("room", "wall"), outcomes("room")
    assert (list(both), list(rooms)) == (["room", "wall"], ["room"])
    assert len(both["room"].judged) == len(rooms["room"].judged) == 4
    assert rooms["room"].logits[0] == pytest.approx(both["room"].logits[0])
    with pytest.raises(InputError, match="none of the concepts room, wall is installed"):
        outcomes()


def test_declared_constants_change_probabilities_and_not_what_is_found() -> None:
    registry = new_registry()
    room = installed()["room"].spec
    head = HeadSpec(weights="room.onnx", encoder="1", intercept=1.0, slope=2.0)
    registry.add(room.model_copy(update={"head": head}), package=installed()["room"].package)
    declared, raw = (Detector(registry, calibrated=c).trace(block(0.15)) for c in (True, False))
    edges, as_scored = declared.relations["room"], raw.relations["room"]
    assert edges.logits == pytest.approx(as_scored.logits)
    log_odds = np.log(edges.probabilities / (1 - edges.probabilities))
    assert log_odds == pytest.approx(1.0 + 2.0 * as_scored.logits, abs=1e-3)
    assert [n.members for n in declared.graph.concepts["room"]] == [
        n.members for n in raw.graph.concepts["room"]
    ]


def test_a_trace_holds_what_led_to_the_nodes(detector: Detector) -> None:
    graph = block(0.15)
    trace = detector.trace(graph)
    assert trace.graph.concepts == detector.infer(graph).concepts
    assert set(trace.scene.surfaces.ids.tolist()) == set(graph.wall_surfaces.ids.tolist())
    for concept in ("room", "wall"):
        assert (trace.relations[concept].pairs == trace.scene.pairs).all()


# -- lists of maps ---------------------------------------------------------------------------------


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    folder = tmp_path / "floors"
    folder.mkdir()
    for name in ("one", "two", "three.b"):
        (folder / f"{name}.json").touch()
    return folder


def write(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


def test_every_path_is_a_source(folder: Path) -> None:
    alone = folder / "one.json"
    assert [(s.name, len(s.files)) for s in find_sources([folder, alone])] == [
        ("floors", 3),
        ("one", 1),
    ]


def test_every_list_is_a_source_of_its_own(folder: Path, tmp_path: Path) -> None:
    some = write(tmp_path / "some.txt", "# a comment\none\n\nthree.b \nnot there\n")
    rest = write(tmp_path / "rest.txt", "two")
    found = find_sources([folder], [some, rest])
    assert [(s.name, [f.stem for f in s.files]) for s in found] == [
        ("floors (some)", ["one", "three.b"]),
        ("floors (rest)", ["two"]),
    ]


def test_a_list_may_have_a_byte_order_mark_and_indented_comments(
    folder: Path, tmp_path: Path
) -> None:
    marked = write(tmp_path / "marked.txt", "\ufeffone\n  # two\n")
    ((_, files),) = ((s.name, s.files) for s in find_sources([folder], [marked]))
    assert [file.stem for file in files] == ["one"]
    assert absent_names([folder], [marked]) == {}


def test_names_that_no_path_holds_are_told_by_list(folder: Path, tmp_path: Path) -> None:
    other = tmp_path / "other"
    other.mkdir()
    (other / "attic.json").touch()
    some = write(tmp_path / "some.txt", "two\nthre.b\nonne\n")
    rest = write(tmp_path / "rest.txt", "one\nattic\n")
    assert absent_names([folder], [some]) == {some: ["onne", "thre.b"]}
    assert absent_names([folder], [rest]) == {rest: ["attic"]}
    assert absent_names([folder, other], [write(rest, "attic\none\n")]) == {}


def test_the_working_directory_is_a_source_by_its_name(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder)
    assert [source.name for source in find_sources([Path()])] == ["floors"]


def test_lists_that_match_nothing_or_cannot_be_read_are_named(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"floors: holds none of the maps that .*none\.txt names"):
        find_sources([folder], [write(tmp_path / "none.txt", "four\n")])
    with pytest.raises(InputError, match=r"absent\.txt: is no readable list of maps"):
        find_sources([folder], [tmp_path / "absent.txt"])


def test_the_committed_lists_keep_buildings_apart() -> None:
    lists = Path(__file__).parents[2] / "docs" / "splits"
    names = {
        file.stem: {line for line in file.read_text().splitlines() if not line.startswith("#")}
        for file in lists.glob("*.txt")
    }
    assert names["selection"].isdisjoint(names["report"])
    assert names["ifc"].isdisjoint(names["traced"])
    assert names["selection"] | names["report"] == names["ifc"] | names["traced"]
