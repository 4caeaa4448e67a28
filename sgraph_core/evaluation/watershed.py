"""A classic to compare with: rooms by a watershed of the distance to the nearest obstacle."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sgraph_concepts.errors import MissingExtraError
from sgraph_concepts.types import OccupancyGrid

__all__ = ["watershed_rooms"]

LARGEST_FILLED_M2 = 0.3
"""Connected cells that are not free, up to this area, are furniture and count as free."""
LEAST_RISE_M = 0.4
"""Two rooms are told apart where the way between them is narrower on each side by this much."""


def watershed_rooms(grid: OccupancyGrid) -> NDArray[np.int64]:
    """Return the number of the room of each cell, -1 for none, [H, W].

    The distance transform of free space is flooded from its summits, which are the middles of
    rooms; where floods meet, such as in doorways, rooms end. Both thresholds were chosen on the
    maps of docs/splits/grids-selection.txt.

    Raises:
        MissingExtraError: scikit-image is not installed.
    """
    try:
        from skimage.morphology import h_maxima
        from skimage.segmentation import watershed
    except ImportError as error:
        raise MissingExtraError("scikit-image", "classic") from error
    from scipy.ndimage import distance_transform_edt, label

    free = grid.cells == OccupancyGrid.FREE
    blobs, _ = label(~free, np.ones((3, 3)))
    filled = np.bincount(blobs.ravel()) * grid.resolution**2 <= LARGEST_FILLED_M2
    free |= filled[blobs]
    distance = grid.resolution * distance_transform_edt(free)
    summits, _ = label(h_maxima(distance.astype(np.float32), LEAST_RISE_M), np.ones((3, 3)))
    return np.asarray(watershed(-distance, summits, mask=free), np.int64) - 1
