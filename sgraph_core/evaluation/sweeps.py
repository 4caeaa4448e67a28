"""How scores change with one property of the building or of its map at a time."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sgraph_core.detector import Detector
from sgraph_core.evaluation.scores import Counts, score_floor
from sgraph_core.files import write_whole
from sgraph_core.graph import SGraph, TrueRoom, Truth
from sgraph_core.plotting import new_figure, write_figure
from sgraph_core.synth.building import draw_building
from sgraph_core.synth.config import BuildingConfig, FittingConfig, PlanConfig, ViewConfig

__all__ = ["PLAIN", "SWEEPS", "Point", "Sweep", "building_config", "run_sweep", "write_sweeps"]

PLAIN = BuildingConfig(
    plan=PlanConfig(
        floor_area_m2=(150.0, 400.0),
        chamfered_outline_share=0.0,
        wall_thickness_m=(0.15, 0.15),
        thicknesses=(1, 1),
        oblique_share=(0.0,),
        merged_share=(0.1,),
        chamfered_share=(0.0,),
        niche_share=(0.0,),
        crooked_m=(0.0,),
        column_share=(0.0,),
        partition_share=(0.0,),
        double_wall_share=(0.0,),
        cubicle_share=(0.0,),
        open_plan_share=(0.0,),
    ),
    fittings=FittingConfig(
        door_share=(0.6,),
        door_width_m=(0.9, 0.9),
        opening_share=(0.0,),
        second_door_share=0.0,
        broken_behind_share=(0.0,),
        facade_share=0.0,
        door_leaf_share=(0.0,),
        furnished_share=(0.0,),
        window_share=(0.0,),
        curtain_share=(0.0,),
    ),
    view=ViewConfig(
        occluded_share=0.0,
        drifted_share=0.0,
        through_share=(0.0,),
        fragmented_share=0.0,
        piece_gap_m=(0.0, 0.0),
        missing_share=(0.0,),
        cropped_share=(0.0,),
        duplicate_share=(0.0,),
        noise_m=(0.01,),
    ),
)
"""What is not swept: floors of right angles, 15 cm walls, doors of 0.9 m, all mapped to 1 cm."""


@dataclass(frozen=True)
class Sweep:
    """One property and the values it takes.

    Attributes:
        name: short, for files.
        label: of the axis, with its unit.
        values: ascending.
        overrides: from a value to the fields of ``BuildingConfig`` that differ from ``PLAIN``.
        turns: whether the value is an angle in degrees by which the maps are turned.
    """

    name: str
    label: str
    values: tuple[float, ...]
    overrides: Callable[[float], Mapping[str, Mapping[str, Any]]] = lambda _value: {}
    turns: bool = False


SWEEPS = (
    Sweep("yaw", "yaw of the map [degrees]", (0, 15, 30, 45, 60, 75, 90), turns=True),
    Sweep(
        "noise",
        "noise of the endpoints [m]",
        (0, 0.01, 0.02, 0.03, 0.05, 0.07, 0.1),
        lambda value: {"view": {"noise_m": (value,)}},
    ),
    Sweep(
        "missing",
        "share of the surfaces that are missing",
        (0, 0.1, 0.2, 0.3, 0.4, 0.5),
        lambda value: {"view": {"missing_share": (value,)}},
    ),
    Sweep(
        "fragments",
        "length of the pieces of long surfaces [m]",
        (0.75, 1, 1.5, 2, 3, 5, 8),
        lambda value: {"view": {"fragmented_share": 1.0, "longest_piece_m": (value, value)}},
    ),
    Sweep(
        "thickness",
        "thickness of the walls [m]",
        (0.06, 0.1, 0.15, 0.2, 0.3, 0.4),
        lambda value: {"plan": {"wall_thickness_m": (value, value)}},
    ),
    Sweep(
        "doorway",
        "width of the doorways [m]",
        (0.7, 0.9, 1.2, 1.6, 2, 2.5, 3),
        lambda value: {"fittings": {"door_width_m": (value, value)}},
    ),
)


@dataclass(frozen=True)
class Point:
    """Pooled scores at one value of a sweep.

    Attributes:
        value: of the property.
        room_f1: of rooms matched at Jaccard index 0.5 or more.
        room_exact_f1: of rooms with exactly the true members.
        wall_f1: of pairs of surfaces.
    """

    value: float
    room_f1: float
    room_exact_f1: float
    wall_f1: float


def run_sweep(sweep: Sweep, floors: int, seed: int, detector: Detector) -> Iterator[Point]:
    """Score synthetic buildings, drawn from the same seeds at every value of a sweep.

    Args:
        sweep: what changes.
        floors: buildings per value.
        seed: of the buildings.
        detector: infers them.
    """
    for value in sweep.values:
        config = building_config(sweep, value)
        angle = np.radians(value) if sweep.turns else 0.0
        scores = []
        for number in range(floors):
            building = draw_building(np.random.default_rng([seed, number]), config)
            graph = _turned(building.graph(f"{sweep.name}-{number}"), angle)
            assert graph.truth is not None
            scores.append(score_floor(detector.infer(graph), graph.truth))
        yield Point(
            value,
            sum((score.rooms for score in scores), Counts()).f1,
            sum((score.exact_rooms for score in scores), Counts()).f1,
            sum((score.walls for score in scores), Counts()).f1,
        )


def building_config(sweep: Sweep, value: float) -> BuildingConfig:
    """Return the distribution of the buildings at one value of a sweep."""
    parts = PLAIN.model_dump()
    for part, fields in sweep.overrides(value).items():
        parts[part].update(fields)
    return BuildingConfig.model_validate(parts)


def _turned(graph: SGraph, angle_rad: float) -> SGraph:
    """Return the surfaces of a map, turned about the origin, with its true rooms and walls."""
    cosine, sine = np.cos(angle_rad), np.sin(angle_rad)
    turn = np.array([[cosine, sine], [-sine, cosine]])
    table = graph.wall_surfaces
    turned = SGraph(graph.name)
    turned.extend_wall_surfaces(
        table.ids, table.segments @ turn, table.normals @ turn, table.heights
    )
    assert graph.truth is not None
    rooms = (TrueRoom(room.id, room.name, room.members, None) for room in graph.truth.rooms)
    turned.truth = Truth(tuple(rooms), graph.truth.walls)
    return turned


def write_sweeps(
    results: Mapping[str, Sequence[Point]], floors: int, seed: int, folder: Path
) -> None:
    """Write ``sweeps.json`` and ``sweeps.png``, with a panel per sweep, whole or not at all.

    Args:
        results: points of every sweep, by its name.
        floors: buildings per value.
        seed: of the buildings.
        folder: an existing folder.
    """
    record = {
        "floors": floors,
        "seed": seed,
        "plain": PLAIN.model_dump(mode="json"),
        "sweeps": {name: [asdict(point) for point in points] for name, points in results.items()},
    }
    text = json.dumps(record, indent=1) + "\n"
    write_whole(folder / "sweeps.json", lambda temporary: temporary.write_text(text))
    figure = new_figure(12, 7)
    panels = figure.subplots(2, 3, sharey=True)
    for sweep, axes in zip(SWEEPS, panels.flat, strict=True):
        points = results[sweep.name]
        for key, label in (("room_f1", "rooms"), ("room_exact_f1", "exact"), ("wall_f1", "walls")):
            values = [getattr(point, key) for point in points]
            axes.plot([point.value for point in points], values, "o-", ms=3, label=label)
        axes.set(xlabel=sweep.label, ylim=(0, 1.03))
        axes.grid(alpha=0.3)
    for axes in panels[:, 0]:
        axes.set_ylabel("F1")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper center", ncols=3)
    write_figure(figure, folder / "sweeps.png")
