"""Centre and thickness of a wall."""

from __future__ import annotations

from collections.abc import Mapping

from sgraph_concepts.types import IntArray, NodeShape, Scene
from sgraph_plugins.wall.geometry import back_to_back

__all__ = ["shape"]


def shape(members: Mapping[int, IntArray], scene: Scene) -> dict[int, NodeShape]:
    """Return each wall's middle, where its two sides overlap, and its thickness there."""
    return {wall: _shape(rows, scene) for wall, rows in members.items()}


def _shape(rows: IntArray, scene: Scene) -> NodeShape:
    lie = back_to_back(scene.surfaces, rows[:1], rows[1:2])
    return NodeShape(
        centre=(float(lie.centres[0, 0]), float(lie.centres[0, 1])),
        thickness=max(float(lie.thickness[0]), 0.0),
    )
