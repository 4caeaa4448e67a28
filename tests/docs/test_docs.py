"""The docs' code runs, and what they list is what there is."""

from __future__ import annotations

import inspect
import json
import re
from pathlib import Path

import pytest

from sgraph_concepts import hookspecs
from sgraph_concepts.spec import ConceptSpec
from sgraph_core.concepts import BUILTINS
from sgraph_core.map_schema import MapRecord
from sgraph_core.synth.config import FittingConfig, GridConfig, PlanConfig, ViewConfig

ROOT = Path(__file__).parent.parent.parent
DOCS = ROOT / "docs"


def code_blocks(page: Path, language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)


@pytest.mark.parametrize(
    "page",
    [DOCS / "api.md", DOCS / "slam.md", ROOT / "README.md"],
    ids=["api", "slam", "readme"],
)
def test_the_pages_python_code_runs(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "docs").symlink_to(DOCS)
    monkeypatch.chdir(tmp_path)
    blocks = code_blocks(page, "python")
    assert blocks
    namespace: dict[str, object] = {}
    for block in blocks:
        exec(compile(block, str(page), "exec"), namespace)
    assert (tmp_path / "rooms.json").exists()


def test_the_front_ends_code_runs() -> None:
    blocks = code_blocks(DOCS / "frontend.md", "python")
    assert blocks
    for block in blocks:
        exec(compile(block, "frontend.md", "exec"), {})


def test_every_hook_is_documented_with_its_arguments() -> None:
    text = (DOCS / "concepts.md").read_text(encoding="utf-8")
    hooks = [f for f in vars(hookspecs).values() if hasattr(f, "sgraph_spec")]
    assert hooks
    for hook in hooks:
        arguments = ", ".join(inspect.signature(hook).parameters)
        assert f"### `{hook.__name__}({arguments})`" in text


def test_every_field_of_a_declaration_is_documented() -> None:
    text = (DOCS / "concepts.md").read_text(encoding="utf-8")
    for name in ConceptSpec.model_fields:
        assert f"| `{name}` |" in text


def test_every_built_in_part_is_documented() -> None:
    text = (DOCS / "concepts.md").read_text(encoding="utf-8")
    for kind, parts in BUILTINS.items():
        for name in parts:
            assert f"`{name}`, a {kind}:" in text


def test_every_key_of_the_map_file_is_in_its_example() -> None:
    text = (DOCS / "map-file.md").read_text(encoding="utf-8")
    schema = MapRecord.model_json_schema()
    for definition in [schema, *schema["$defs"].values()]:
        for key in definition.get("properties", {}):
            assert f'"{key}"' in text, key


def test_every_ingredient_of_a_building_is_documented_with_its_default() -> None:
    text = (DOCS / "synthetic-buildings.md").read_text(encoding="utf-8")
    for model in (PlanConfig, FittingConfig, ViewConfig, GridConfig):
        for name, field in model.model_fields.items():
            default = json.dumps(field.default)
            assert f"| `{name}` | {default} | {field.description} |" in text


def test_links_between_pages_lead_somewhere() -> None:
    for page in [*DOCS.glob("*.md"), *ROOT.glob("*.md")]:
        for target in re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", page.read_text(encoding="utf-8")):
            if not target.startswith("http"):
                assert (page.parent / target).exists(), f"{page.name} -> {target}"
