"""Maps that grow in a ConceptTracker, and what their nodes must be."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pytest

from sgraph_core.detector import Detector
from sgraph_core.graph import SGraph
from sgraph_core.slam import ConceptTracker, Update
from sgraph_core.synth.building import draw_building
from sgraph_core.synth.config import BuildingConfig, ViewConfig

NOISY = BuildingConfig(view=ViewConfig(noise_m=(0.01, 0.02, 0.05)))
"""Exact corners would leave it to rounding whether a line of sight that touches one is free."""


def assert_as_inferred_at_once(tracker: ConceptTracker, detector: Detector) -> None:
    """Same nodes, as sure, and with the same shapes."""
    now = tracker.snapshot()
    whole = detector.infer(now)
    for concept, nodes in whole.concepts.items():
        found = {frozenset(node.members): node for node in now.concepts[concept]}
        assert found.keys() == {frozenset(node.members) for node in nodes}
        for node in nodes:
            other = found[frozenset(node.members)]
            assert other.confidence == pytest.approx(node.confidence, abs=0.021)
            doors, others = (n.shape.attributes.get("doorways", []) for n in (node, other))
            assert len(doors) == len(others)
            area = node.shape.attributes.get("area_m2", 0.0)
            assert other.shape.attributes.get("area_m2", 0.0) == pytest.approx(area, abs=0.02)
            if concept == "wall" or area > 0.1:  # whether a sliver has an outline is rounding
                # outlines are simplified to 1 mm, from wherever they begin
                assert other.shape.centre == pytest.approx(node.shape.centre, abs=2e-3)


def add(tracker: ConceptTracker, graph: SGraph, surfaces: Sequence[int]) -> Update:
    for surface in surfaces:
        view = graph.wall_surface(surface)
        tracker.add_wall_surface(surface, view.segment, view.normal)
    return tracker.update()


def building(seed: int) -> SGraph:
    drawn = draw_building(np.random.default_rng(seed), NOISY)
    graph = SGraph()
    count = len(drawn.segments)
    unknown = np.full((count, 2), np.nan)
    graph.extend_wall_surfaces(np.arange(count), drawn.segments, drawn.normals, unknown)
    return graph


def eastwards(graph: SGraph, rng: np.random.Generator) -> list[int]:
    """Return the surfaces as a robot that drives east may find them."""
    x = graph.wall_surfaces.segments[:, :, 0].mean(axis=1)
    order = np.argsort(x + rng.normal(0, 2.0, len(x)))
    return [int(i) for i in graph.wall_surfaces.ids[order]]


def keyframes_of(graph: SGraph) -> list[Callable[[SGraph | ConceptTracker], None]]:
    """Return a call for each keyframe that adds it, and all that it sees, to a graph or tracker."""
    first_seen: dict[int, int] = {}
    table, motion, seen = graph.keyframes, graph.odometry, graph.observations
    for surface, keyframe in zip(
        seen.surface_ids.tolist(), seen.keyframe_ids.tolist(), strict=True
    ):
        first_seen.setdefault(surface, keyframe)

    def enter(target: SGraph | ConceptTracker, keyframe: int) -> None:
        target.add_keyframe(keyframe, table.poses[keyframe])
        for row in np.flatnonzero(motion.to_ids == keyframe):
            target.add_odometry(
                int(motion.from_ids[row]), keyframe, motion.poses[row], motion.sigmas[row]
            )
        for surface, first in first_seen.items():
            if first == keyframe:
                view = graph.wall_surface(surface)
                target.add_wall_surface(surface, view.segment, view.normal)
        for row in np.flatnonzero(seen.keyframe_ids == keyframe):
            surface = int(seen.surface_ids[row])
            target.observe(surface, keyframe, seen.planes[row], seen.sigmas[row], seen.at[row])

    return [lambda target, k=k: enter(target, k) for k in table.ids.tolist()]  # type: ignore[misc]
