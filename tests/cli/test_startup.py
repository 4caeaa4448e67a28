"""What the command imports, and what a broken plugin does to it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

HEAVY = {
    "torch", "torch_geometric", "gtsam", "onnxruntime", "numpy", "scipy", "shapely",
    "networkx", "matplotlib", "PIL",
}  # fmt: skip


def imported_by(*arguments: str) -> set[str]:
    """Return the top-level modules that a command line leaves imported."""
    code = f"""
import sys
from sgraph_cli.main import main
sys.argv = ["sgraph", *{arguments!r}]
try:
    main()
except SystemExit:
    pass
print("MODULES", *{{name.partition(".")[0] for name in sys.modules}})
"""
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return set(run.stdout.rpartition("MODULES")[2].split())


@pytest.mark.parametrize("arguments", [["--help"], ["infer", "--help"], ["--version"]])
def test_help_imports_nothing_heavy(arguments: list[str]) -> None:
    assert imported_by(*arguments) & HEAVY == set()


def test_the_overview_imports_typer_and_little_else() -> None:
    assert imported_by("--help") & {"sgraph_concepts", "sgraph_core", "pydantic", "rich"} == set()


@pytest.mark.parametrize("arguments", [["concepts", "list"], ["concepts", "show", "room"]])
def test_listing_concepts_imports_neither_torch_nor_gtsam(arguments: list[str]) -> None:
    assert imported_by(*arguments) & HEAVY <= {"numpy"}


def test_inference_needs_neither_torch_nor_gtsam(demo_map: Path) -> None:
    modules = imported_by("infer", str(demo_map))
    assert "onnxruntime" in modules
    assert modules & {"torch", "torch_geometric", "gtsam", "matplotlib", "scipy"} == set()


def install(folder: Path, name: str, module: str, source: str | None) -> None:
    """Install a distribution with one plugin into a folder for PYTHONPATH."""
    if source is not None:
        (folder / f"{module}.py").write_text(source)
    info = folder / f"{name}-9.9.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 9.9\n")
    (info / "entry_points.txt").write_text(f"[sgraph]\n{name} = {module}\n")


GOOD = """
from sgraph_concepts import ConceptSpec, hookimpl

@hookimpl
def sgraph_register(registry):
    registry.add(ConceptSpec(
        name="zone", relation="same_zone", baseline="zone:everything", clusterer="zone:one_node"))
"""
BROKEN = {
    "missing-module": None,
    "raises": "1 / 0",
    "exits": "import sys; sys.exit('no licence')",
    "clashes": GOOD.replace('"zone"', '"room"'),
    "nonsense": GOOD.replace('name="zone"', 'name="Zone!"'),
    "syntax": "def (:",
}


def test_broken_plugins_beside_ours_are_reported_and_the_rest_works(
    sgraph: Any, tmp_path: Path, demo_map: Path
) -> None:
    install(tmp_path, "good-plugin", "good_plugin", GOOD)
    for name, source in BROKEN.items():
        install(tmp_path, f"{name}-plugin", f"{name.replace('-', '_')}_plugin", source)
    support = Path(__file__).parent.parent / "support"
    path = os.pathsep.join([str(tmp_path), str(support), os.environ.get("PYTHONPATH", "")])
    result = sgraph("concepts", "list", PYTHONPATH=path)
    assert result.returncode == 0
    for concept in ("room", "wall", "zone"):
        assert f"  {concept} " in result.stdout
    warnings = result.stderr.splitlines()
    assert len(warnings) == len(BROKEN)
    for name in BROKEN:
        (line,) = [w for w in warnings if f"{name}-plugin" in w]
        assert f"of {name}-plugin 9.9 is left out" in line
        assert f"pip uninstall {name}-plugin" in line
    inferred = sgraph("infer", demo_map, "-o", tmp_path / "out.json", PYTHONPATH=path)
    assert inferred.returncode == 0
    assert len(inferred.stderr.splitlines()) == len(BROKEN)
    timed = sgraph("bench", "speed", "--size", 30, "--repeats", 1, PYTHONPATH=path)
    assert timed.returncode == 0
    assert len(timed.stderr.splitlines()) == len(BROKEN)
