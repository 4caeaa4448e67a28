"""Observed planes as factors.

gtsam's OrientedPlane3Factor compares the measured plane with the predicted one: the measured
normal's two components along a basis b1, b2 that is perpendicular to the predicted normal, and the
difference of the two d. A measured normal m = n + e1 b1 + e2 b2 gives the errors e1 and e2. At a
point p of the body the plane's distance then errs by

    (n.p + d) - (m.p + d_measured) = e3 - e1 b1.p - e2 b2.p,        e3 = d - d_measured,

which is independent of e1 and e2 where an observation says so: information for e = (e1, e2, e3) is

    A^T A,    A = [ 1/angle            0                  0
                    0                  1/angle            0
                    -b1.p/distance     -b2.p/distance     1/distance ].

gtsam crosses the normal with the axis that it has least of to get b1, so the basis jumps where two
axes are equally far away. Predicted and measured normal must be on the same side of the jump, or
the errors would change places. A body that is level sees vertical planes, which are farthest from
the vertical axis however they turn. For a body that is not, an observation near a jump loses its
correlation: its d errs by what the distance from p and the angle do together. Maps that were drawn
begin exactly on a jump, where gtsam would linearise wrongly: see :func:`plane_value`.
"""

from __future__ import annotations

import gtsam
import numpy as np

from sgraph_concepts.types import FloatArray
from sgraph_core.backend.keys import Keys
from sgraph_core.graph import SGraph
from sgraph_core.tables import Observations

__all__ = ["add_observations", "plane_noise", "plane_value"]

LEVEL = 1e-9
"""A body is level that is tilted by no more, in rad."""
CLEAR = 0.2
"""By how much a normal's two least components must differ, for it to be clear of a jump."""
OFF_AXES = 1e-9
"""By how much the first guess of a plane is turned off the axes, in rad."""


def plane_value(plane: FloatArray) -> gtsam.OrientedPlane3:
    """Return a vertical plane as the first guess of a variable, [4]: exactly along no axis."""
    nx, ny, _, d = plane.tolist()
    return gtsam.OrientedPlane3(nx - OFF_AXES * ny, ny + OFF_AXES * nx, 0.0, d)


def add_observations(
    table: Observations, graph: SGraph, keys: Keys, factors: gtsam.NonlinearFactorGraph
) -> None:
    """Add the factors of observed planes.

    Args:
        table: the observations.
        graph: the S-Graph that has the keyframes.
        keys: the keys of keyframes and surfaces.
        factors: grows.
    """
    keyframes = table.keyframe_ids.tolist()
    poses = graph.keyframes.poses[[graph.keyframe_row(i) for i in keyframes]].reshape(-1, 7)
    level: list[bool] = np.all(np.abs(poses[:, 3:5]) <= LEVEL / 2, axis=1).tolist()
    measured = table.planes / np.linalg.norm(table.planes[:, :3], axis=1)[:, None]
    rows = zip(measured, table.sigmas, table.at, level, strict=True)
    for surface, keyframe, row in zip(table.surface_ids.tolist(), keyframes, rows, strict=True):
        factors.add(
            gtsam.OrientedPlane3Factor(
                row[0], plane_noise(*row), keys.keyframe(keyframe), keys.surface(surface)
            )
        )


def plane_noise(
    plane: FloatArray, sigmas: FloatArray, at: FloatArray, level: bool
) -> gtsam.noiseModel.Gaussian:
    """Return the noise model of an OrientedPlane3Factor.

    Args:
        plane: as measured in the body frame, with n.x + d = 0 and unit n, [4].
        sigmas: standard deviations of the normal's angle and of the plane's distance from ``at``,
            rad and m, [2].
        at: point of the body frame, [3].
        level: whether the body is level and the plane vertical, but for errors.
    """
    angle, distance = sigmas.tolist()
    if not at.any():
        return gtsam.noiseModel.Diagonal.Sigmas(np.array([angle, angle, distance]))
    arms = at @ _basis(plane[:3], level)
    if not (level or _clear(plane[:3])):
        apart = np.sqrt(distance**2 + angle**2 * (arms @ arms))
        return gtsam.noiseModel.Diagonal.Sigmas(np.array([angle, angle, apart]))
    errors = np.diag([1 / angle, 1 / angle, 1 / distance])
    errors[2, :2] = -arms / distance
    return gtsam.noiseModel.Gaussian.Information(errors.T @ errors)


def _basis(normal: FloatArray, level: bool) -> FloatArray:
    """Return gtsam's basis of the plane that is perpendicular to a normal, [3, 2]."""
    if level:  # exactly along an axis gtsam has another one than on either side of it
        return np.array([[normal[1], 0.0], [-normal[0], 0.0], [0.0, -1.0]])
    return np.asarray(gtsam.Unit3(normal).basis())


def _clear(normal: FloatArray) -> bool:
    """Return whether small errors leave the axis the same that a normal has least of."""
    least, next_to, _ = np.sort(np.abs(normal))
    return bool(next_to - least >= CLEAR)
