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
axes are equally far away. Predicted and measured normal must be on the same side of a jump, or the
errors would change places. In a planar problem all normals are horizontal, farthest from the
vertical axis however they turn. In any other, an observation near a jump loses its correlation: its
d errs by what the distance from p and the angle do together. Maps that were drawn begin exactly on
a jump, where gtsam would linearise wrongly: see :func:`plane_value`.
"""

from __future__ import annotations

import gtsam
import numpy as np

from sgraph_concepts.types import FloatArray
from sgraph_core.backend.keys import Keys
from sgraph_core.tables import Keyframes, Observations, Odometry

__all__ = ["add_observations", "is_planar", "plane_noise", "plane_value"]

LEVEL = 1e-9
"""What is tilted by no more is level, in rad."""
OFF_AXES = 1e-8
"""By how much the first guess of a plane is turned off the axes, in rad."""
CLEAR = 0.2
"""By how much a normal's two least components must differ, for it to be clear of a jump."""


def is_planar(keyframes: Keyframes, odometry: Odometry, observations: Observations) -> bool:
    """Return whether bodies are level, motions turn about the vertical, and planes are vertical."""
    tilts = keyframes.poses[:, 3:5], odometry.poses[:, 3:5]
    upright = (np.abs(observations.planes[:, 2]) <= LEVEL).all()
    return bool(upright and all((np.abs(tilt) <= LEVEL / 2).all() for tilt in tilts))


def plane_value(plane: FloatArray) -> gtsam.OrientedPlane3:
    """Return a vertical plane as the first guess of a variable, [4]: exactly along no axis."""
    nx, ny, _, d = plane.tolist()
    return gtsam.OrientedPlane3(nx - OFF_AXES * ny, ny + OFF_AXES * nx, 0.0, d)


def add_observations(
    table: Observations, planar: bool, keys: Keys, factors: gtsam.NonlinearFactorGraph
) -> None:
    """Add the factors of observed planes.

    Args:
        table: the observations.
        planar: whether the whole problem is; see :func:`is_planar`.
        keys: the keys of keyframes and surfaces.
        factors: grows.
    """
    measured = table.planes / np.linalg.norm(table.planes[:, :3], axis=1)[:, None]
    rows = zip(
        table.surface_ids.tolist(),
        table.keyframe_ids.tolist(),
        measured,
        table.sigmas,
        table.at,
        strict=True,
    )
    for surface, keyframe, plane, sigmas, at in rows:
        noise = plane_noise(plane, sigmas, at, planar)
        factors.add(
            gtsam.OrientedPlane3Factor(plane, noise, keys.keyframe(keyframe), keys.surface(surface))
        )


def plane_noise(
    plane: FloatArray, sigmas: FloatArray, at: FloatArray, planar: bool
) -> gtsam.noiseModel.Gaussian:
    """Return the noise model of an OrientedPlane3Factor.

    Args:
        plane: as measured in the body frame, with n.x + d = 0 and unit n, [4].
        sigmas: standard deviations of the normal's angle and of the plane's distance from ``at``,
            rad and m, [2].
        at: point of the body frame, [3].
        planar: whether bodies and motions of the whole problem are exactly level, and all measured
            planes exactly vertical. Else a normal within 12 degrees of a plane between two axes
            of the body that are equally far from it, such as of a wall along the driving direction,
            loses the correlation of angle and distance.
    """
    angle, distance = sigmas.tolist()
    if not at.any():
        return gtsam.noiseModel.Diagonal.Sigmas(np.array([angle, angle, distance]))
    arms = at @ _basis(plane[:3], planar)
    if not (planar or _clear(plane[:3])):
        apart = np.sqrt(distance**2 + angle**2 * (arms @ arms))
        return gtsam.noiseModel.Diagonal.Sigmas(np.array([angle, angle, apart]))
    errors = np.diag([1 / angle, 1 / angle, 1 / distance])
    errors[2, :2] = -arms / distance
    # gtsam takes a lower triangle for a diagonal matrix, and a diagonal for standard deviations
    upper = np.linalg.qr(errors).R
    return gtsam.noiseModel.Gaussian.SqrtInformation(upper * np.sign(np.diag(upper))[:, None])


def _basis(normal: FloatArray, planar: bool) -> FloatArray:
    """Return gtsam's basis of the plane that is perpendicular to a normal, [3, 2]."""
    if planar:  # exactly along an axis gtsam has another one than on either side of it
        return np.array([[normal[1], 0.0], [-normal[0], 0.0], [0.0, -1.0]])
    return np.asarray(gtsam.Unit3(normal).basis())


def _clear(normal: FloatArray) -> bool:
    """Return whether small errors leave the axis the same that a normal has least of."""
    least, next_to, _ = np.sort(np.abs(normal))
    return bool(next_to - least >= CLEAR)
