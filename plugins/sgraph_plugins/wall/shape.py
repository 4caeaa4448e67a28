"""Centre and thickness of a wall."""

from __future__ import annotations

from sgraph_concepts.types import IntArray, NodeShape, Scene
from sgraph_plugins.wall.geometry import back_to_back

__all__ = ["shape"]


def shape(members: IntArray, scene: Scene) -> NodeShape:
    """Return the middle of the wall body, where the two sides overlap, and its thickness there."""
    lie = back_to_back(scene.surfaces, members[:1], members[1:2])
    return NodeShape(
        centre=(float(lie.centres[0, 0]), float(lie.centres[0, 1])),
        thickness=max(float(lie.thickness[0]), 0.0),
    )
