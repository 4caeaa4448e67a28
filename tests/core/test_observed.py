"""The observed surfaces: a batch and a growing map find the same ones near a place."""

from __future__ import annotations

import numpy as np
import shapely
from drive import drive

from sgraph_core.backend.observed import observed_in
from sgraph_core.slam.observed import ObservedSurfaces


def test_what_is_near_a_box_is_found_wherever_surfaces_have_moved() -> None:
    graph, rng = drive(0).graph, np.random.default_rng(0)
    graph.add_wall_surface(99, [[0.0, 2.0], [1.0, 2.0]], [0, 1])  # nobody observed it
    before = observed_in(graph)
    assert len(before.surfaces) == len(graph.wall_surfaces.ids) - 1
    growing = ObservedSurfaces()
    order = rng.permutation(len(before.surfaces))
    growing.add(before.surfaces.take(order[:5]), before.first_seen[order[:5]])
    growing.add(before.surfaces.take(order[5:]), before.first_seen[order[5:]])
    table = graph.wall_surfaces
    moved = graph.moved(
        graph.keyframes.poses, table.segments + np.array([3.0, -1.0]), table.normals
    )
    growing.move(moved.wall_surfaces.ordered())
    after = observed_in(moved)
    seen = set()
    for corner in rng.uniform(-4, 14, (50, 2)):
        box = np.append(corner, corner + rng.uniform(0.5, 4, 2))
        lines = shapely.linestrings(after.surfaces.segments)
        near = {int(i) for i in after.surfaces.ids[shapely.STRtree(lines).query(shapely.box(*box))]}
        for observed in (after, growing.all):
            assert set(observed.near(box).ids.tolist()) == near
        seen.add(len(near))
    assert len(seen) > 3
    assert {i: after.first_seen[row] for i, row in after.rows.items()} == {
        i: growing.all.first_seen[row] for i, row in growing.all.rows.items()
    }
