"""A declaration is refused, with the reason, when one thing about it is wrong."""

from __future__ import annotations

import pytest
from pydantic import ValidationError

from sgraph_concepts.errors import ConceptError
from sgraph_concepts.spec import ConceptSpec, HeadSpec, resolve

VALID = {
    "name": "corridor",
    "relation": "same_corridor",
    "head": HeadSpec(weights="corridor.onnx", encoder="1"),
    "clusterer": "my_package.corridor:cluster",
}


def test_a_valid_declaration_is_frozen_and_has_the_documented_defaults() -> None:
    spec = ConceptSpec(**VALID)
    assert (spec.groups, spec.exclusive, spec.labeller) == ("wall_surface", True, None)
    with pytest.raises(ValidationError, match="frozen"):
        spec.name = "other"


def test_every_field_is_described() -> None:
    for model in (ConceptSpec, HeadSpec):
        assert [n for n, f in model.model_fields.items() if not f.description] == []


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"name": "Corridor"}, "should match pattern"),
        ({"name": ""}, "should match pattern"),
        ({"clusterer": "my_package.corridor"}, "must be 'package.module:attribute'"),
        ({"clusterer": "a b:c"}, "must be 'package.module:attribute'"),
        ({"head": None}, "needs a head or a baseline"),
        ({"groups": "corridor"}, "cannot group its own nodes"),
        ({"colour": "red"}, "Extra inputs are not permitted"),
        ({"exclusive": "yes"}, "should be a valid boolean"),
    ],
)
def test_a_mutated_declaration_says_what_is_wrong(change: dict[str, object], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        ConceptSpec(**{**VALID, **change})


@pytest.mark.parametrize("weights", ["../evil.onnx", "sub/room.onnx", "room.pt", "/room.onnx"])
def test_weights_are_an_onnx_file_beside_the_declaration(weights: str) -> None:
    with pytest.raises(ValidationError):
        HeadSpec(weights=weights, encoder="1")


def test_references_resolve_to_objects_and_builtin_names() -> None:
    assert resolve("math:pi", {}, "test") == pytest.approx(3.14159, abs=1e-5)
    assert resolve("tau", {"tau": "math:tau"}, "test") > 6


@pytest.mark.parametrize(
    ("reference", "message"),
    [
        ("nowhere_at_all:f", "'nowhere_at_all:f' cannot be loaded"),
        ("math:nothing", "has no attribute 'nothing'"),
        ("unknown", "nor a built-in .known: cycles."),
    ],
)
def test_a_reference_to_nothing_names_who_asked(reference: str, message: str) -> None:
    with pytest.raises(ConceptError, match=f"clusterer of concept 'x': .*{message}"):
        resolve(reference, {"cycles": "m:f"}, "clusterer of concept 'x'")
