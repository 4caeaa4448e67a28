"""The registry keeps what is sound and reports the rest."""

from __future__ import annotations

import sys
from importlib.metadata import EntryPoint
from types import ModuleType
from typing import Any

import pytest

from sgraph_concepts import ConceptSpec, HeadSpec, Registry, hookimpl, registry
from sgraph_concepts.errors import ConceptError


def concept(name: str, **fields: Any) -> ConceptSpec:
    values = {"relation": f"same_{name}", "baseline": "m:score", "clusterer": "m:cluster"}
    return ConceptSpec(name=name, **{**values, **fields})


class _Plugins:
    """Entry points whose modules are made up on the spot."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self._monkeypatch = monkeypatch
        self._points: list[EntryPoint] = []
        monkeypatch.setattr(registry, "entry_points", lambda group: self._points)

    def add(self, name: str, *specs: ConceptSpec, fails: Exception | None = None) -> None:
        module = ModuleType(f"plugin_{name}")

        @hookimpl
        def sgraph_register(registry: Any) -> None:
            for spec in specs:
                registry.add(spec)
            if fails:
                raise fails

        module.sgraph_register = sgraph_register  # type: ignore[attr-defined]
        self._monkeypatch.setitem(sys.modules, module.__name__, module)
        self.point_at(name, module.__name__)

    def point_at(self, name: str, target: str) -> None:
        self._points.append(EntryPoint(name=name, value=target, group="sgraph"))


@pytest.fixture
def plugins(monkeypatch: pytest.MonkeyPatch) -> _Plugins:
    return _Plugins(monkeypatch)


def load() -> Registry:
    result = Registry(encoder="1")
    result.load_entry_points()
    return result


def test_a_plugin_that_fails_to_import_leaves_the_others_working(plugins: _Plugins) -> None:
    plugins.add("good", concept("room"))
    plugins.point_at("broken", "no_such_module_anywhere")
    result = load()
    assert [c.spec.name for c in result] == ["room"]
    assert "'broken'" in str(result.problems[0])
    assert "ModuleNotFoundError" in result.problems[0].reason
    assert "pip uninstall" in result.problems[0].remedy


@pytest.mark.parametrize("error", [RuntimeError("x"), SystemExit(3), ConceptError("y")])
def test_a_plugin_that_fails_halfway_adds_nothing(plugins: _Plugins, error: BaseException) -> None:
    plugins.add("half", concept("room"), fails=error)  # type: ignore[arg-type]
    result = load()
    assert len(result) == 0
    assert type(error).__name__ in result.problems[0].reason


def test_a_module_without_the_hook_is_reported(plugins: _Plugins) -> None:
    plugins.point_at("silent", "json")
    assert "declares no concept" in load().problems[0].reason


def test_the_second_plugin_of_a_name_is_left_out(plugins: _Plugins) -> None:
    plugins.add("first", concept("room", description="mine"))
    plugins.add("second", concept("room", description="yours"), concept("hall"))
    result = load()
    assert result["room"].spec.description == "mine"
    assert "hall" in result
    assert "already declared" in result.problems[0].reason


def test_a_head_of_another_encoder_is_refused(plugins: _Plugins) -> None:
    head = HeadSpec(weights="room.onnx", encoder="0.9")
    plugins.add("old", concept("room", head=head))
    reason = load().problems[0].reason
    assert "'0.9'" in reason
    assert "'1'" in reason


def test_concepts_come_after_what_they_group(plugins: _Plugins) -> None:
    plugins.add("a", concept("building", groups="floor"), concept("floor", groups="room"))
    plugins.add("b", concept("room"))
    result = load()
    assert [c.spec.name for c in result] == ["room", "floor", "building"]
    assert [c.spec.name for c in result.select(["floor"])] == ["room", "floor"]


def test_concepts_that_group_nothing_known_or_each_other_are_left_out(plugins: _Plugins) -> None:
    plugins.add("lost", concept("floor", groups="storey"), concept("building", groups="floor"))
    plugins.add("circle", concept("hen", groups="egg"), concept("egg", groups="hen"))
    plugins.add("good", concept("room"))
    result = load()
    assert [c.spec.name for c in result] == ["room"]
    reasons = {problem.entry_point: problem.reason for problem in result.problems}
    assert set(reasons) == {"floor", "building", "hen", "egg"}
    assert "circle" in reasons["hen"]


def test_the_order_does_not_depend_on_the_order_of_installation(plugins: _Plugins) -> None:
    for name in ("wall", "room", "corridor"):
        plugins.add(name, concept(name))
    assert [c.spec.name for c in load()] == ["corridor", "room", "wall"]


def test_a_built_in_part_serves_as_what_it_is_only() -> None:
    result = Registry("1", {"clusterer": {"tau": "math:tau"}, "factor": {"pi": "math:pi"}})
    result.add(concept("room"))
    assert result.part("room", "clusterer", "tau") > 6
    with pytest.raises(ConceptError, match=r"'pi' is neither .* nor a built-in \(known: tau\)"):
        result.part("room", "clusterer", "pi")


def test_unknown_concepts_and_parts_are_named() -> None:
    result = Registry(encoder="1")
    result.add(concept("room"))
    with pytest.raises(ConceptError, match=r"no concept 'rom' \(known: room\)"):
        result["rom"]
    with pytest.raises(ConceptError, match="has no labeller"):
        result.part("room", "labeller")
    with pytest.raises(ConceptError, match="map's own layer"):
        result.add(concept("wall_surface", groups="room"))
