"""Centre and thickness of a wall."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from sgraph_concepts.types import IntArray, NodeShape, Scene
from sgraph_plugins.wall.geometry import back_to_back

__all__ = ["shape"]


def shape(members: Mapping[int, IntArray], scene: Scene) -> dict[int, NodeShape]:
    """Return each wall's middle, where its two sides overlap, and its thickness there."""
    one, two = np.array([rows[:2] for rows in members.values()], np.int64).reshape(-1, 2).T
    lie = back_to_back(scene.surfaces, one, two)
    return {
        wall: NodeShape(centre=(x, y), thickness=max(thickness, 0.0))
        for wall, (x, y), thickness in zip(
            members, lie.centres.tolist(), lie.thickness.tolist(), strict=True
        )
    }
