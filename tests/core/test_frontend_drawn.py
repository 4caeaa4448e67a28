"""Floors drawn at random, to drive through."""

from __future__ import annotations

import networkx as nx
import pytest

from sgraph_core.evaluation.trajectory import ate_rmse
from sgraph_core.frontend.drawn import draw_floor
from sgraph_core.frontend.mapping import build_map
from sgraph_core.frontend.route import route
from sgraph_core.frontend.simulation import simulate
from sgraph_core.synth.config import PlanConfig


@pytest.mark.parametrize("seed", range(12))
def test_tours_lead_through_doors_to_all_rooms_and_back(seed: int) -> None:
    floor = draw_floor(seed, PlanConfig(floor_area_m2=(80, 400)))
    doors: nx.Graph[str] = nx.Graph([(door.one, door.two) for door in floor.doors])
    assert set(floor.tour) == set(floor.rooms) == set(doors)
    assert floor.tour[0] == floor.tour[-1]
    assert all(doors.has_edge(a, b) for a, b in zip(floor.tour, floor.tour[1:], strict=False))
    assert len(route(floor.free, floor.stops())) >= len(floor.tour)


def test_drawn_floors_can_be_driven_and_mapped() -> None:
    recording = simulate(draw_floor(2, PlanConfig(floor_area_m2=(80, 200))), 0)
    drive = build_map(recording)
    drifted = ate_rmse(recording.dead_reckoned()[:, :3], recording.positions())
    assert ate_rmse(drive.graph.keyframes.poses[:, :3], recording.positions()) < 0.5 * drifted
