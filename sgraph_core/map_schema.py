"""The map file `sgraph-map` JSON, version 1, as pydantic models: its structure and its schema.

Rules that span several records (unique ids, references, normals) are those of the S-Graph's
tables; :mod:`sgraph_core.map_file` applies both.
"""

from __future__ import annotations

import sys
from typing import Annotated, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    JsonValue,
    field_validator,
)

from sgraph_core.tables import GREATEST_SIGMA, LARGEST_COORDINATE_M, LARGEST_ID, LEAST_SIGMA

__all__ = ["FORMAT", "UNITS", "VERSION", "MapRecord"]

FORMAT, VERSION, UNITS = "sgraph-map", 1, "m"

Id = Annotated[int, Field(strict=True, ge=0, le=LARGEST_ID)]
Real = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Sigma = Annotated[
    Real, Field(json_schema_extra={"minimum": LEAST_SIGMA, "maximum": GREATEST_SIGMA})
]
"""The S-Graph's tables check it, and name all of a row's standard deviations."""
Coordinate = Annotated[Real, Field(ge=-LARGEST_COORDINATE_M, le=LARGEST_COORDINATE_M)]
Text = Annotated[str, Field(strict=True)]
Point = tuple[Coordinate, Coordinate]
Ring = Annotated[list[Point], Field(min_length=3)]
Pose = tuple[Coordinate, Coordinate, Coordinate, Real, Real, Real, Real]
Pair = tuple[Id, Id]
Members = Annotated[list[Id], Field(min_length=1)]


def _finite(value: JsonValue) -> JsonValue:
    """JSON knows no NaN and no infinity, although Python's reader lets them pass.

    Integers beyond float64 are infinite to most readers, and the longest cannot be written.
    """
    parts = [value]
    while parts:
        part = parts.pop()
        if isinstance(part, int | float) and not abs(part) <= sys.float_info.max:
            raise ValueError("must be a finite number (float64)")
        if isinstance(part, list):
            parts += part
        elif isinstance(part, dict):
            parts += part.values()
    return value


Json = Annotated[JsonValue, AfterValidator(_finite)]


class Record(BaseModel):
    """A JSON object that allows no other keys than its own."""

    model_config = ConfigDict(extra="forbid", populate_by_name=True)


class KeyframeRecord(Record):
    """A keyframe."""

    id: Id
    pose: Pose = Field(description="world_T_body: x, y, z [m], qx, qy, qz, qw (unit quaternion).")
    stamp: Real | None = Field(default=None, description="Time [s].")


class OdometryRecord(Record):
    """The motion between two keyframes."""

    from_: Id = Field(alias="from", description="Keyframe id.")
    to: Id = Field(description="Keyframe id.")
    pose: Pose = Field(description="from_T_to: x, y, z [m], qx, qy, qz, qw (unit quaternion).")
    sigmas: tuple[Sigma, Sigma, Sigma, Sigma, Sigma, Sigma] = Field(
        description="Standard deviations rx, ry, rz [rad], x, y, z [m] in the tangent space."
    )


class ObservationRecord(Record):
    """A wall surface as a keyframe saw it."""

    keyframe: Id = Field(description="Keyframe id.")
    plane: tuple[Real, Real, Real, Coordinate] = Field(
        description="nx, ny, nz, d in the keyframe's body frame, n.x + d = 0, unit n pointing to "
        "the keyframe, hence d > 0 [m]."
    )
    sigmas: tuple[Sigma, Sigma] = Field(
        description="Standard deviations of the normal's angle [rad] and of the plane's distance "
        "from the point 'at' [m]."
    )
    at: tuple[Coordinate, Coordinate, Coordinate] = Field(
        default=(0.0, 0.0, 0.0),
        description="Point of the body frame where angle and distance err independently [m]: the "
        "middle of what was seen. At the origin the distance is d.",
    )


class WallSurfaceRecord(Record):
    """One observed side of a wall."""

    id: Id
    segment: tuple[Point, Point] = Field(description="Endpoints in the world [m], in any order.")
    normal: tuple[Real, Real] = Field(
        description="Unit vector in the world from the wall body to the observed side, "
        "perpendicular to the segment within 5 degrees."
    )
    z: tuple[Coordinate, Coordinate] | None = Field(
        default=None, description="Lowest and highest z [m]."
    )
    observations: list[ObservationRecord] | None = None


class ConceptRecord(Record):
    """A node of a concept, such as a room or a wall."""

    id: Id
    name: Text | None = None
    members: Members = Field(
        description="Ids of what the concept groups: for room and wall, of wall surfaces."
    )
    centre: Point | None = Field(default=None, description="A representative point [m].")
    polygon: Ring | None = Field(
        default=None, description="Outer ring [m]; the first point may be repeated at the end."
    )
    holes: list[Ring] | None = Field(default=None, description="Inner rings [m].")
    thickness: Annotated[Real, Field(ge=0)] | None = Field(
        default=None, description="Of a wall [m]."
    )
    confidence: Annotated[Real, Field(ge=0, le=1)] | None = None
    attributes: dict[str, Json] | None = Field(
        default=None, description="The concept's own fields."
    )


class PinsRecord(Record):
    """What a person has decided and inference respects."""

    same_room: list[Pair] | None = Field(default=None, description="Pairs of wall surface ids.")
    not_same_room: list[Pair] | None = Field(default=None, description="Pairs of wall surface ids.")
    room_names: dict[str, Text] | None = Field(default=None, description="Name by room id.")


class TrueRoomRecord(Record):
    """A room as a person labelled it."""

    id: Id | Text | None = None
    name: Text | None = None
    members: list[Id] = Field(description="Wall surface ids.")
    polygon: Ring | None = None


class TruthRecord(Record):
    """Labels to evaluate with; inference never reads them."""

    rooms: list[TrueRoomRecord] | None = None
    walls: list[Pair] | None = Field(default=None, description="Pairs of wall surface ids.")


class MapRecord(Record):
    """A map: what SLAM built, and the concepts inferred from it."""

    model_config = ConfigDict(title="sgraph-map", json_schema_extra={"$id": "sgraph-map-1"})

    format: Literal["sgraph-map"]
    version: Literal[1]
    units: Literal["m"]

    name: Text | None = None
    keyframes: list[KeyframeRecord] | None = None
    odometry: list[OdometryRecord] | None = None
    wall_surfaces: list[WallSurfaceRecord]
    concepts: dict[Annotated[str, Field(min_length=1)], list[ConceptRecord]] | None = None
    pins: PinsRecord | None = None
    truth: TruthRecord | None = None

    @field_validator("version", mode="before")
    @classmethod
    def _no_truth_value(cls, version: object) -> object:
        if isinstance(version, bool):
            raise ValueError("must be 1")  # in Python, true equals 1
        return version
