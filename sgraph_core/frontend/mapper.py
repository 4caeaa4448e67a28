"""The planes-only SLAM behind :mod:`sgraph_core.frontend.mapping`, one keyframe at a time."""

from __future__ import annotations

from dataclasses import replace

import gtsam
import numpy as np

from sgraph_concepts.errors import OptimizationError, one_line
from sgraph_concepts.types import FloatArray, IntArray
from sgraph_core.backend.keys import Keys
from sgraph_core.backend.low_layers import PRIOR_SIGMA, pose3
from sgraph_core.backend.sightings import plane_noise, plane_value
from sgraph_core.frontend.association import (
    NONE,
    Gate,
    Lines,
    aligned,
    matches,
    seen_from_pose,
)
from sgraph_core.frontend.planar import as_rows, composed, from_rows, in_space, rotated
from sgraph_core.frontend.recording import ObservedSurfaces, Recording
from sgraph_core.geometry import dot, turn_left

__all__ = ["Mapper"]

RELINEARIZE = 0.02
"""A variable that has changed by more than this, in rad and m, is linearised anew."""
WIDER = 2.0
"""By which the gate is wider as long as a pose is only predicted."""


class Mapper:
    """Maps keyframe by keyframe.

    A surface keeps its ends in the body frame of the keyframe that saw it last, so that they move
    with that keyframe when poses are corrected.

    Attributes:
        associations: per keyframe, the mapped surface of each observed one.
        poses: the current estimate x, y, yaw of each keyframe, [K, 3].
    """

    def __init__(self, first_pose: FloatArray, gate: Gate) -> None:
        parameters = gtsam.ISAM2Params()
        parameters.setRelinearizeThreshold(RELINEARIZE)
        parameters.relinearizeSkip = 1
        self._isam = gtsam.ISAM2(parameters)
        self._keys = Keys()
        self._gate = gate
        self._first_pose = first_pose
        self.poses = np.empty((0, 3))
        self.associations: list[IntArray] = []
        self._surface_keys: list[int] = []
        self._planes = np.empty((0, 3))
        self._ends = np.empty((0, 2, 2))
        self._last_seen = np.empty(0, np.int64)

    @classmethod
    def run(cls, recording: Recording, gate: Gate) -> Mapper:
        """Map a recording from its first to its last keyframe."""
        mapper = cls(from_rows(recording.reference[:1])[0], gate)
        mapper.add(recording.observations[0])
        for motion, sigmas, observed in zip(
            recording.odometry,
            recording.odometry_sigmas,
            recording.observations[1:],
            strict=True,
        ):
            mapper.add(observed, motion, sigmas)
        return mapper

    def add(
        self,
        observed: ObservedSurfaces,
        odometry: FloatArray | None = None,
        sigmas: FloatArray | None = None,
    ) -> None:
        """Add a keyframe: what it observed and, but for the first, the motion to it with sigmas.

        Raises:
            OptimizationError: the estimate is under-determined.
        """
        factors, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        pose = self._add_pose(odometry, sigmas, factors, values)
        if sigmas is not None:
            pose = self._aligned(pose, sigmas, observed)
        seen = seen_from_pose(observed, pose)
        surfaces = matches(seen, self.surfaces(), self._gate)
        new = np.flatnonzero(surfaces == NONE)
        surfaces[new] = len(self._planes) + np.arange(len(new))
        offsets = -dot(seen.normals, seen.segments.mean(axis=1))
        planes = np.column_stack([seen.normals, offsets])
        for row in new.tolist():
            nx, ny, d = planes[row].tolist()
            key = self._keys.surface(int(surfaces[row]))
            self._surface_keys.append(key)
            values.insert(key, plane_value(np.array([nx, ny, 0.0, d])))
        self._add_observations(observed, surfaces, factors)
        self._update(factors, values)
        self._grow(seen, planes, surfaces, pose)
        self._read_estimate()

    def surfaces(self) -> Lines:
        """Return the mapped surfaces by the current estimate."""
        return Lines(self._projected(self._ends_in_world()), self._planes[:, :2])

    def _update(self, factors: gtsam.NonlinearFactorGraph, values: gtsam.Values) -> None:
        try:
            self._isam.update(factors, values)
        except RuntimeError as error:
            number = len(self.poses) - 1
            raise OptimizationError(
                f"keyframe {number} cannot be mapped: {one_line(error)}"
            ) from error

    def _aligned(
        self, pose: FloatArray, sigmas: FloatArray, observed: ObservedSurfaces
    ) -> FloatArray:
        """Return a pose predicted by odometry, corrected by what a wider gate finds again."""
        known, wide = self.surfaces(), replace(self._gate, offset_m=WIDER * self._gate.offset_m)
        matched = matches(seen_from_pose(observed, pose), known, wide)
        return aligned(pose, sigmas[[3, 4, 2]], observed, known, matched)

    def _add_pose(
        self,
        odometry: FloatArray | None,
        sigmas: FloatArray | None,
        factors: gtsam.NonlinearFactorGraph,
        values: gtsam.Values,
    ) -> FloatArray:
        number = len(self.poses)
        key = self._keys.keyframe(number)
        if odometry is None or sigmas is None:
            pose = self._first_pose
            hold = gtsam.noiseModel.Isotropic.Sigma(6, PRIOR_SIGMA)
            factors.add(gtsam.PriorFactorPose3(key, pose3(as_rows(pose[None])[0]), hold))
        else:
            pose = composed(self.poses[-1], from_rows(odometry[None])[0])
            before = self._keys.keyframe(number - 1)
            noise = gtsam.noiseModel.Diagonal.Sigmas(sigmas)
            factors.add(gtsam.BetweenFactorPose3(before, key, pose3(odometry), noise))
        values.insert(key, pose3(as_rows(pose[None])[0]))
        self.poses = np.vstack([self.poses, pose])
        return pose

    def _add_observations(
        self, observed: ObservedSurfaces, surfaces: IntArray, factors: gtsam.NonlinearFactorGraph
    ) -> None:
        keyframe = self._keys.keyframe(len(self.poses) - 1)
        for surface, plane, sigmas, at in zip(
            surfaces.tolist(), observed.planes, observed.sigmas, in_space(observed.at), strict=True
        ):
            noise = plane_noise(plane, sigmas, at, planar=True)
            key = self._surface_keys[surface]
            factors.add(gtsam.OrientedPlane3Factor(plane, noise, keyframe, key))
        self.associations.append(surfaces)

    def _grow(self, seen: Lines, planes: FloatArray, surfaces: IntArray, pose: FloatArray) -> None:
        """Extend the surfaces by what was seen; put their ends into the new keyframe's frame."""
        count = max(len(self._planes), int(surfaces.max(initial=-1)) + 1)
        fresh = count - len(self._planes)
        known = count - fresh
        new = np.flatnonzero(surfaces >= known)
        world = np.concatenate([self._projected(self._ends_in_world()), seen.segments[new]])
        self._planes = np.concatenate([self._planes, planes[new]])
        keyframe = len(self.poses) - 1
        self._ends = np.concatenate([self._ends, np.empty((fresh, 2, 2))])
        self._last_seen = np.append(self._last_seen, np.full(fresh, keyframe))
        tangents = turn_left(self._planes[:, :2])
        for surface, segment in zip(surfaces.tolist(), seen.segments, strict=True):
            points = np.concatenate([world[surface], segment])
            along = points @ tangents[surface]
            world[surface] = points[[int(np.argmin(along)), int(np.argmax(along))]]
        touched = np.unique(surfaces)
        self._last_seen[touched] = keyframe
        self._ends[touched] = rotated(world[touched] - pose[:2], -np.asarray(pose[2]))

    def _ends_in_world(self) -> FloatArray:
        poses = self.poses[self._last_seen][:, None]
        return poses[..., :2] + rotated(self._ends, poses[..., 2])

    def _projected(self, segments: FloatArray) -> FloatArray:
        """Return segments [N, 2, 2] moved onto the surfaces' planes."""
        normals, offsets = self._planes[:, None, :2], self._planes[:, None, 2]
        return segments - (dot(segments, normals) + offsets)[..., None] * normals

    def _read_estimate(self) -> None:
        estimate = self._isam.calculateEstimate()
        rows = gtsam.utilities.extractPose3(estimate)  # ordered by key: rotation, then position
        self.poses = np.column_stack([rows[:, 9:11], np.arctan2(rows[:, 3], rows[:, 0])])
        planes = np.array(
            [estimate.atOrientedPlane3(key).planeCoefficients() for key in self._surface_keys]
        ).reshape(-1, 4)
        sizes = np.linalg.norm(planes[:, :2], axis=1)
        self._planes = planes[:, [0, 1, 3]] / sizes[:, None]
