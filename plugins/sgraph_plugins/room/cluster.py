"""Rooms from the scored relation *same room*."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import shapely

from sgraph_concepts.types import (
    Cluster,
    OccupancyGrid,
    Scene,
    ScoredEdges,
    SurfaceArrays,
)
from sgraph_core.clustering.canonical import Relation, canonical_relation
from sgraph_core.clustering.confidence import clusters_of
from sgraph_core.clustering.multicut import multicut
from sgraph_core.geometry import dot, rectangle_sides
from sgraph_core.grid.passages import separated
from sgraph_core.grid.regions import label_cells, spaces_faced
from sgraph_core.grid.strips import count_labels

__all__ = ["cluster"]

FEWEST_MEMBERS = 3
"""Two surfaces enclose nothing."""
ABSORB_LOGIT = -2.0
"""A smaller cluster joins the room of its most likely relation, if that is not less likely."""
NARROWEST_M = 0.5
"""Nobody fits into less: the cavity of a double wall is no room."""
FULL_WEIGHT_M = 1.0
"""What relates surfaces shorter than this counts less, in proportion to their lengths: the end of a
wall in a doorway sees as much of the one room as of the other."""
NARROW_M = 1.5
NARROW_LOGIT = -4.0
"""Where a grid is known: log-odds of surfaces that face spaces which only passages narrower than
this join, as doors do. Both were chosen on the maps of docs/splits/grids-selection.txt."""
THING_M2 = 2.0
CLOSET_M2 = 0.5
"""Where a grid is known: a cluster that covers less than the first may be a thing in a room, and
joins the room that it most likely belongs to, as a smaller cluster does. If there is none, it stays
a room from the second on. The first was chosen on the same maps."""
IN_FRONT_M = 0.3
"""How far a room must reach in front of what joins it."""


def cluster(edges: ScoredEdges, scene: Scene) -> list[Cluster]:
    """Partition the surfaces by multicut, let stray ones join, and drop what is no room."""
    if scene.grid is not None:
        apart = separated(scene.surfaces, edges.pairs, scene.grid, NARROW_M)
        edges = replace(edges, logits=edges.logits + NARROW_LOGIT * apart)
    relation = canonical_relation(edges, scene)
    surfaces = scene.surfaces.take(relation.rows)
    weights = np.minimum(surfaces.lengths / FULL_WEIGHT_M, 1.0)[relation.pairs].prod(axis=1)
    groups = multicut(len(relation.rows), relation.pairs, weights * relation.logits)
    if scene.grid is not None:
        groups = [part for group in groups for part in _by_space(group, surfaces, scene.grid)]
    large = [group for group in groups if len(group) >= FEWEST_MEMBERS]
    small = [group for group in groups if len(group) < FEWEST_MEMBERS]
    encloses = _enclose_a_room(surfaces, large)
    covered: dict[int, float] = {}
    if scene.grid is not None:
        covered = _covered([g for g in large if encloses[g[0]]], surfaces, scene.grid)
    things = [group for group in large if covered.get(group[0], THING_M2) < THING_M2]
    large = [group for group in large if covered.get(group[0], THING_M2) >= THING_M2]
    joined = _absorb(large, small + things, relation, surfaces)
    taken = {row for group in joined for row in group}
    return clusters_of(
        relation,
        [
            *(room for core, room in zip(large, joined, strict=True) if encloses[core[0]]),
            *(g for g in things if g[0] not in taken and covered[g[0]] >= CLOSET_M2),
        ],
    )


def _by_space(group: list[int], surfaces: SurfaceArrays, grid: OccupancyGrid) -> list[list[int]]:
    """Cut a group that winds around spaces without a way between them: they are no one room."""
    if len(group) < FEWEST_MEMBERS:
        return [group]
    faced = spaces_faced(surfaces.take(np.array(group)), grid, THING_M2, IN_FRONT_M)
    return [np.array(group)[faced == space].tolist() for space in np.unique(faced)]


def _covered(
    groups: list[list[int]], surfaces: SurfaceArrays, grid: OccupancyGrid
) -> dict[int, float]:
    """Return the area that groups cover of a grid, in m2, by their first members."""
    labels = label_cells([surfaces.take(np.array(group)) for group in groups], grid)
    areas = (count_labels(labels, len(groups))[1:] * grid.resolution**2).tolist()
    return {group[0]: area for group, area in zip(groups, areas, strict=True)}


def _absorb(
    large: list[list[int]], small: list[list[int]], relation: Relation, surfaces: SurfaceArrays
) -> list[list[int]]:
    """Let each small group join the large one in front of it that it most likely belongs to."""
    owner = np.full(len(relation.rows), -1)
    for number, group in enumerate(large):
        owner[group] = number
    best: dict[int, tuple[float, int]] = {}
    group_of = {member: k for k, group in enumerate(small) for member in group}
    pairs = np.concatenate([relation.pairs, relation.pairs[:, ::-1]])
    logits = np.tile(relation.logits, 2)
    offered = (logits > ABSORB_LOGIT) & (owner[pairs[:, 0]] < 0) & (owner[pairs[:, 1]] >= 0)
    for (stray, other), logit in zip(
        pairs[offered].tolist(), logits[offered].tolist(), strict=True
    ):
        if _faces(surfaces, stray, large[owner[other]]):
            offer = (logit, -int(owner[other]))
            best[group_of[stray]] = max(best.get(group_of[stray], offer), offer)
    joined = [list(group) for group in large]
    for number, (_, joins) in best.items():
        joined[-joins] += small[number]
    return joined


def _faces(surfaces: SurfaceArrays, one: int, others: list[int]) -> bool:
    """Return whether any of the others reaches in front of a surface: to a facade, no room does."""
    in_front = (surfaces.segments[others] - surfaces.midpoints[one]) @ surfaces.normals[one]
    return bool(in_front.max() > IN_FRONT_M)


def _enclose_a_room(surfaces: SurfaceArrays, groups: list[list[int]]) -> dict[int, bool]:
    """Return, by first members, which groups face a space that is wide enough for a room.

    A facade's face away from the space between them. By the divergence theorem, the sum of length *
    (midpoint - centre) . normal over a closed outline is minus twice its area where the normals
    point inwards, and twice it otherwise.
    """
    if not groups:
        return {}
    sizes = np.array([len(group) for group in groups])
    some, of = surfaces.take(np.concatenate(groups)), np.repeat(np.arange(len(groups)), sizes)
    chains = shapely.linestrings(some.segments.reshape(-1, 2), indices=np.repeat(of, 2))
    widths = rectangle_sides(np.asarray(chains))[:, 0]
    first = np.cumsum(sizes) - sizes
    lengths, midpoints = some.lengths, some.midpoints
    sums = np.add.reduceat(np.column_stack([lengths, lengths[:, None] * midpoints]), first)
    centres = (sums[:, 1:] / sums[:, :1])[of]
    areas = -np.add.reduceat(lengths * dot(midpoints - centres, some.normals), first)
    rooms = (areas > 0) & (widths >= NARROWEST_M)
    return {group[0]: is_room for group, is_room in zip(groups, rooms.tolist(), strict=True)}
