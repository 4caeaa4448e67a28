"""The ingredients of synthetic buildings. Every one is a parameter with its unit."""

from __future__ import annotations

from typing import Annotated, Literal, TypeVar

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

__all__ = ["BuildingConfig", "FittingConfig", "GridConfig", "PlanConfig", "ViewConfig"]


def _ascending(interval: tuple[float, float]) -> tuple[float, float]:
    if interval[0] > interval[1]:
        raise ValueError("lower bound must not exceed upper bound")
    return interval


Item = TypeVar("Item")
Interval = Annotated[tuple[Item, Item], AfterValidator(_ascending)]
Choices = Annotated[tuple[Item, ...], Field(min_length=1)]

Share = Annotated[float, Field(ge=0, le=1)]
Part = Annotated[float, Field(ge=0.01, le=1)]
Ratio = Annotated[float, Field(ge=1, le=20)]
Count = Annotated[int, Field(ge=1, le=1000)]
Area = Annotated[float, Field(ge=1, le=10_000)]
Length = Annotated[float, Field(ge=0.01, le=200)]
Spacing = Annotated[float, Field(ge=0.5, le=200)]
"""Of what is repeated: the smaller, the more of it, and the longer a building takes."""
Offset = Annotated[float, Field(ge=0, le=5)]
Angle = Annotated[float, Field(ge=0, le=45)]
Resolution = Annotated[float, Field(ge=0.02, le=0.5)]
Density = Annotated[float, Field(ge=0, le=10)]
Beams = Annotated[int, Field(ge=8, le=10_000)]


class _Config(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class PlanConfig(_Config):
    """The rooms and the walls between them."""

    floor_area_m2: Interval[Area] = Field(
        default=(60.0, 2200.0), description="Area of a floor; log-uniform."
    )
    aspect: Interval[Ratio] = Field(
        default=(1.0, 3.0), description="Length over width of the outline."
    )
    notched_share: Share = Field(
        default=0.45, description="Floors whose outline is not a rectangle (L, U, T, Z)."
    )
    chamfered_outline_share: Share = Field(
        default=0.15, description="Floors whose outline has cut corners."
    )
    wall_thickness_m: Interval[Length] = Field(
        default=(0.06, 0.4), description="Walls between rooms."
    )
    thicknesses: Interval[Count] = Field(
        default=(1, 3), description="How many wall thicknesses one building mixes."
    )
    room_area_m2: Interval[Area] = Field(
        default=(5.0, 45.0), description="A building's typical room; log-uniform."
    )
    room_area_spread: float = Field(
        default=0.7,
        ge=0,
        le=3,
        description="Standard deviation of the rooms' log area in a building.",
    )
    corridor_share: Share = Field(default=0.7, description="Floors with straight corridors.")
    ring_corridor_share: Share = Field(default=0.15, description="Floors with a ring corridor.")
    corridor_width_m: Interval[Length] = Field(
        default=(1.2, 3.5), description="Width of corridors."
    )
    oblique_share: Choices[Share] = Field(
        default=(0.0, 0.0, 0.05, 0.25),
        description="Share of walls that meet others obliquely; one is drawn per building.",
    )
    merged_share: Choices[Share] = Field(
        default=(0.0, 0.05, 0.15, 0.3),
        description="Merges of neighbouring rooms per room (L, T, U shapes); one per building.",
    )
    chamfered_share: Choices[Share] = Field(
        default=(0.0, 0.0, 0.1), description="Rooms with cut corners; one is drawn per building."
    )
    niche_share: Choices[Share] = Field(
        default=(0.0, 0.15, 0.3),
        description="Rooms with niches or pilasters; one is drawn per building.",
    )
    crooked_m: Choices[Offset] = Field(
        default=(0.0, 0.0, 0.01, 0.03),
        description="Standard deviation of the corners; one is drawn per building.",
    )
    column_share: Choices[Share] = Field(
        default=(0.0, 0.0, 0.0, 0.5),
        description="Rooms of 25 m2 or more with columns; one is drawn per building.",
    )
    column_side_m: Interval[Length] = Field(default=(0.2, 0.7), description="Sides of columns.")
    column_spacing_m: Interval[Spacing] = Field(
        default=(3.5, 8.0), description="Spacing of the grid that columns stand on."
    )
    partition_share: Choices[Share] = Field(
        default=(0.0, 0.0, 0.0, 0.1),
        description="Rooms of 25 m2 or more with free-standing partitions; one is drawn per "
        "building.",
    )
    partition_length_m: Interval[Length] = Field(
        default=(1.2, 4.0), description="Length of partitions."
    )
    partition_thickness_m: Interval[Length] = Field(
        default=(0.05, 0.15), description="Thickness of partitions."
    )
    double_wall_share: Choices[Share] = Field(
        default=(0.0, 0.0, 0.0, 0.1),
        description="Walls between two rooms that consist of two leaves with a cavity between "
        "them; one is drawn per building.",
    )
    leaf_m: Interval[Length] = Field(
        default=(0.06, 0.2),
        description="Thickness of each leaf; a wall that was thicker keeps its thickness.",
    )
    cavity_m: Interval[Length] = Field(default=(0.03, 0.4), description="Width of the cavity.")
    cubicle_share: Choices[Share] = Field(
        default=(0.0, 0.8),
        description="Rooms of 40 m2 or more with rows of cubicles; one is drawn per building.",
    )
    cubicle_m: Interval[Spacing] = Field(
        default=(1.8, 3.5), description="Width of cubicles, and depth."
    )
    cubicle_partition_m: Interval[Length] = Field(
        default=(0.04, 0.2), description="Thickness of the partitions between them."
    )
    aisle_m: Interval[Length] = Field(
        default=(1.0, 2.5), description="Aisles between rows of cubicles, and around them."
    )
    open_plan_share: Choices[Share] = Field(
        default=(0.0, 0.0, 0.0, 0.03),
        description="Neighbouring rooms whose common wall is missing; one is drawn per building.",
    )
    open_part: Interval[Part] = Field(
        default=(0.4, 1.0), description="Missing part of a wall that is not missing as a whole."
    )
    whole_wall_share: Share = Field(
        default=0.5, description="Missing walls that are missing as a whole."
    )

    @model_validator(mode="after")
    def _check_corridors(self) -> PlanConfig:
        if self.corridor_share + self.ring_corridor_share > 1:
            raise ValueError(
                f"corridor_share {self.corridor_share:g} and ring_corridor_share "
                f"{self.ring_corridor_share:g} must not add up to more than 1"
            )
        return self


class FittingConfig(_Config):
    """Doors, facades, furniture."""

    door_share: Choices[Share] = Field(
        default=(0.0, 0.3, 0.6, 0.9),
        description="Neighbouring rooms joined by a door; one is drawn per building.",
    )
    door_width_m: Interval[Length] = Field(default=(0.7, 1.1), description="Width of doors.")
    opening_share: Choices[Share] = Field(
        default=(0.05, 0.05, 0.1, 0.6),
        description="Doors that are wide openings; one is drawn per building.",
    )
    opening_width_m: Interval[Length] = Field(
        default=(1.3, 3.0), description="Width of wide openings."
    )
    cubicle_opening: Interval[Part] = Field(
        default=(0.4, 0.9), description="Open part of a cubicle's side."
    )
    second_door_share: Share = Field(default=0.15, description="Neighbours with two doors.")
    broken_behind_share: Choices[Share] = Field(
        default=(0.0, 0.0, 0.5, 1.0),
        description="Surfaces broken where a wall meets theirs from behind, as in maps from plans "
        "and building models; one is drawn per building.",
    )
    facade_share: Share = Field(
        default=0.5, description="Buildings whose outer faces are mapped too."
    )
    facade_thickness_m: Interval[Length] = Field(default=(0.1, 0.45), description="Outer walls.")
    door_leaf_share: Choices[Share] = Field(
        default=(0.0, 0.0, 0.5),
        description="Doors whose leaf stands open as clutter; one is drawn per building.",
    )
    furnished_share: Choices[Share] = Field(
        default=(0.0, 0.0, 0.3, 0.8),
        description="Rooms with furniture as clutter; one is drawn per building.",
    )
    furniture_size_m: Interval[Length] = Field(
        default=(0.2, 1.2), description="Sides of furniture."
    )
    cavity_share: Share = Field(
        default=0.5,
        description="Buildings with double walls whose cavities are mapped, as in building models.",
    )
    window_share: Choices[Share] = Field(
        default=(0.0, 0.0, 0.0, 0.5),
        description="Outer walls of rooms with windows, mapped as gaps; one is drawn per building.",
    )
    window_width_m: Interval[Length] = Field(default=(0.6, 2.5), description="Width of windows.")
    window_spacing_m: Interval[Spacing] = Field(
        default=(1.5, 5.0), description="Length of outer wall for each window."
    )
    curtain_share: Choices[Share] = Field(
        default=(0.0, 0.0, 0.0, 0.2),
        description="Outer walls of rooms that are windows between mullions from end to end; one "
        "is drawn per building.",
    )
    mullion_m: Interval[Length] = Field(
        default=(0.06, 0.15), description="Width of the mullions of such walls."
    )
    pane_m: Interval[Spacing] = Field(
        default=(0.8, 2.5), description="Largest distance between them."
    )


class ViewConfig(_Config):
    """What a robot maps of the building."""

    occluded_share: Share = Field(
        default=0.25, description="Buildings mapped only as far as the robot sees on its way."
    )
    visited_share: Interval[Share] = Field(
        default=(0.5, 1.0), description="Rooms such a robot enters, of all rooms."
    )
    pose_spacing_m: Interval[Spacing] = Field(
        default=(2.0, 5.0), description="Least distance between its poses in a room."
    )
    sensor_range_m: Interval[Length] = Field(default=(5.0, 20.0), description="How far it sees.")
    through_share: Choices[Share] = Field(
        default=(0.0, 0.0, 0.3),
        description="Collinear surfaces of neighbouring rooms mapped as one; one per building.",
    )
    fragmented_share: Share = Field(
        default=0.5, description="Buildings whose long surfaces are mapped in pieces."
    )
    longest_piece_m: Interval[Spacing] = Field(
        default=(2.5, 12.0), description="Length of such pieces."
    )
    piece_gap_m: Interval[Offset] = Field(default=(0.0, 0.3), description="Gap between two pieces.")
    missing_share: Choices[Share] = Field(
        default=(0.0, 0.05, 0.1, 0.2, 0.3, 0.4),
        description="Surfaces that were not mapped; one is drawn per building.",
    )
    cropped_share: Choices[Share] = Field(
        default=(0.0, 0.0, 0.3),
        description="Ends of surfaces that were not mapped; one is drawn per building.",
    )
    duplicate_share: Choices[Share] = Field(
        default=(0.0, 0.0, 0.05), description="Surfaces mapped twice; one is drawn per building."
    )
    drifted_share: Share = Field(
        default=0.2, description="Buildings with drift between the robot's visits."
    )
    visit_rooms: Interval[Count] = Field(
        default=(1, 12), description="Rooms mapped in one visit on average; they drift together."
    )
    drift_m: Interval[Offset] = Field(
        default=(0.01, 0.05),
        description="Standard deviation of a visit's shift at the far end of the floor; it grows "
        "with the distance from the first visit.",
    )
    drift_deg: Interval[Angle] = Field(
        default=(0.0, 0.3), description="Standard deviation of a visit's turn, likewise."
    )
    noise_m: Choices[Offset] = Field(
        default=(0.0, 0.01, 0.02, 0.05),
        description="Standard deviation of the endpoints; one is drawn per building.",
    )


class GridConfig(_Config):
    """The occupancy grid that a robot, or a plan, leaves of the building.

    A robot enters as many rooms and sees as far as the view says.
    """

    resolution_m: Choices[Resolution] = Field(
        default=(0.05, 0.05, 0.1), description="Side of a cell; one is drawn per building."
    )
    margin_m: Interval[Offset] = Field(
        default=(0.5, 4.0), description="How far the grid reaches beyond the building."
    )
    aligned_share: Share = Field(
        default=0.5, description="Grids with rows along the building's walls; others lie any way."
    )
    outside_share: Share = Field(
        default=0.2, description="Of buildings with mapped facades: the outside is known too."
    )
    cupboard_share: Choices[Share] = Field(
        default=(0.0, 0.3, 0.8),
        description="Rooms with furniture against the walls; one is drawn per building.",
    )
    cupboard_length_m: Interval[Length] = Field(
        default=(0.4, 2.0), description="Length of such furniture along the wall."
    )
    cupboard_depth_m: Interval[Length] = Field(
        default=(0.2, 0.8), description="How far such furniture stands out."
    )
    table_share: Choices[Share] = Field(
        default=(0.0, 0.3, 0.8),
        description="Rooms with tables and chairs, whose legs are seen; one is drawn per building.",
    )
    leg_side_m: Interval[Length] = Field(default=(0.03, 0.1), description="Sides of legs.")
    speckles_per_m2: Choices[Density] = Field(
        default=(0.0, 0.0, 0.02, 0.2),
        description="Single known cells that became something else; one is drawn per building.",
    )
    drawn_share: Share = Field(
        default=0.4,
        description="Grids drawn from the plan, where all is known; others are scanned.",
    )
    drawn_walls: Choices[Literal["faces", "solid", "unknown"]] = Field(
        default=("faces", "faces", "solid", "unknown"),
        description="Of drawn grids: occupied are the walls' faces, whole walls, or nothing, and "
        "walls are unknown; one is drawn per building.",
    )
    drawn_furniture: Choices[Literal["occupied", "unknown"]] = Field(
        default=("occupied", "unknown"),
        description="Of drawn grids: what furniture is; one is drawn per building.",
    )
    pose_spacing_m: Interval[Spacing] = Field(
        default=(1.0, 3.0), description="Least distance between scans in a room."
    )
    beams: Choices[Beams] = Field(
        default=(360, 720, 1440), description="Rays of a full turn; one is drawn per building."
    )
    range_noise_m: Choices[Offset] = Field(
        default=(0.0, 0.01, 0.03),
        description="Standard deviation of a ray's length; one is drawn per building.",
    )
    pose_noise_m: Choices[Offset] = Field(
        default=(0.0, 0.01, 0.03),
        description="Standard deviation of a scan's place in the map; one is drawn per building.",
    )
    pose_noise_deg: Choices[Angle] = Field(
        default=(0.0, 0.0, 0.3),
        description="Standard deviation of a scan's direction; one is drawn per building.",
    )
    glass_share: Choices[Share] = Field(
        default=(0.0, 0.3, 1.0),
        description="Rays that windows reflect rather than let out; one is drawn per building.",
    )
    clearing_share: Share = Field(
        default=0.3, description="Grids in which rays that meet nothing free the cells they pass."
    )
    dark_share: Choices[Share] = Field(
        default=(0.0, 0.0, 0.2),
        description="Surfaces with a stretch that returns no ray; one is drawn per building.",
    )
    dark_m: Interval[Length] = Field(default=(0.05, 0.4), description="Length of such stretches.")
    occupied_from: Part = Field(
        default=0.25,
        description="Share of the rays through or into a cell that end there, from which on it "
        "is occupied.",
    )


class BuildingConfig(_Config):
    """A distribution of buildings and of their maps."""

    plan: PlanConfig = PlanConfig()
    fittings: FittingConfig = FittingConfig()
    view: ViewConfig = ViewConfig()
    grid: GridConfig = GridConfig()
