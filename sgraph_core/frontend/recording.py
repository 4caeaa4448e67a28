"""What a drive leaves behind: odometry, observed surfaces, and the reference to judge by."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sgraph_concepts.errors import InputError
from sgraph_concepts.types import BuildingTruth, FloatArray
from sgraph_core.frontend.planar import as_rows, chained, from_rows

__all__ = ["ObservedSurfaces", "Recording"]


@dataclass(frozen=True, eq=False)
class ObservedSurfaces:
    """The S wall surfaces that one keyframe observed, in its body frame.

    Attributes:
        segments: endpoints of what was seen, [S, 2, 2], in metres.
        planes: nx, ny, nz, d with n.x + d = 0, unit n pointing to the keyframe, hence d > 0,
            [S, 4].
        sigmas: standard deviations of the normal's angle and of the plane's distance from the point
            ``at``, which err independently, rad and m, [S, 2].
        at: points of the planes, [S, 2].
        heights: lowest and highest z that was seen, NaN where unknown, [S, 2].
    """

    segments: FloatArray
    planes: FloatArray
    sigmas: FloatArray
    at: FloatArray
    heights: FloatArray

    def __len__(self) -> int:
        return len(self.planes)


@dataclass(frozen=True, eq=False)
class Recording:
    """A drive of K keyframes.

    Attributes:
        name: of the scene or log.
        stamps: seconds, ascending, [K].
        odometry: from_T_to between consecutive keyframes as x, y, z, qx, qy, qz, qw, [K - 1, 7].
        odometry_sigmas: standard deviations in the tangent space of from_T_to, rotation first,
            rad and m, [K - 1, 6].
        reference: world_T_body, the truth of a simulated drive or a log's corrected poses, [K, 7].
        scans: per keyframe the end points of a horizontal scan in the body frame, [P_k, 2]: the
            space between the sensor and them is free.
        observations: per keyframe the surfaces that were extracted from its scan.
        building: truth of a simulated drive; its surfaces' ids are their rows.
    """

    name: str
    stamps: FloatArray
    odometry: FloatArray
    odometry_sigmas: FloatArray
    reference: FloatArray
    scans: tuple[FloatArray, ...]
    observations: tuple[ObservedSurfaces, ...]
    building: BuildingTruth | None = None

    def __post_init__(self) -> None:
        count = len(self.stamps)
        lengths = {
            "reference": len(self.reference),
            "scans": len(self.scans),
            "observations": len(self.observations),
            "odometry": len(self.odometry) + 1,
            "odometry_sigmas": len(self.odometry_sigmas) + 1,
        }
        for field, length in lengths.items():
            if length != count:
                raise InputError(
                    f"recording {self.name}: {field} is for {length} keyframes, stamps for {count}"
                )

    def __len__(self) -> int:
        return len(self.stamps)

    def dead_reckoned(self) -> FloatArray:
        """Return the poses that odometry alone adds up to, from the first reference pose, [K, 7].

        Motion is taken to be in the plane, as that of all recordings of this package is.
        """
        first = from_rows(self.reference[:1])[0]
        return as_rows(chained(first, from_rows(self.odometry)))

    def positions(self) -> FloatArray:
        """Return the reference positions, [K, 3]."""
        return np.asarray(self.reference[:, :3])
