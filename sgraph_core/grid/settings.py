"""What counts as a wall surface in an occupancy grid."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, Field

__all__ = ["SurfaceSettings"]


class SurfaceSettings(BaseModel):
    """Thresholds of extracting wall surfaces. Lengths are metres, whatever the grid's resolution.

    The defaults were chosen on the maps of docs/splits/grids-selection.txt.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    narrowest_free_m: float = Field(
        0.1,
        gt=0,
        description="Free space into which no square of this side fits is the trace of a ray, not "
        "space. The square has two cells at least.",
    )
    smallest_free_m2: float = Field(
        0.5, ge=0, description="Free space that is enclosed and smaller bounds no room."
    )
    smallest_blob_m: float = Field(
        0.6,
        ge=0,
        description="Lone things of a smaller extent are no walls: legs of tables, noise.",
    )
    lone_gap_m: float = Field(
        0.1,
        ge=0,
        description="Things this close to one another count as one thing; thin things in line do "
        "so up to the widest gap, since walls may be broken into short pieces.",
    )
    outline_tolerance_m: float = Field(
        0.075,
        gt=0,
        description="How far an outline may stray from a straight surface; one cell at least.",
    )
    widest_gap_m: float = Field(
        0.4, ge=0, description="Collinear surfaces this close are one, if all is free in front."
    )
    front_m: float = Field(0.2, gt=0, description="How far in front of a gap it must be free.")
    shortest_surface_m: float = Field(
        0.15, gt=0, description="Shorter surfaces are dropped, and those under two cells."
    )
