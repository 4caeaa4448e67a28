"""The published factor of rooms and walls, kept to compare with.

S-Graphs+ and the paper add a variable for a node's centre c and one factor whose residual is
c - f(planes): for a four-wall room f is the point midway between both pairs of opposed planes, for
a corridor or a wall midway between its two planes. All are the point nearest to a reference point p
(the centre when the node was made) among those with the least sum of squared distances to the
planes:

    f(planes) = p - (sum n n^T)^+ sum (n.p + d) n,

which also serves rooms of any number of sides. Since c is free, the factor fits whatever the planes
are: it adds no information about them (tests/core/test_backend.py measures it).
"""

from __future__ import annotations

from collections.abc import Sequence

import gtsam
import numpy as np

from sgraph_concepts.types import ConceptNode, FactorContext, FactorResult, FloatArray

__all__ = ["centre_of", "factors"]

SIGMA_M = 0.1
PARALLEL = 0.05
"""Planes whose normals spread less than this across their main direction count as parallel (within
about 25 degrees of one another): where they cross says nothing about a centre."""
STEP = 1e-6
"""Of the central differences for the planes' Jacobians."""


def factors(node: ConceptNode, context: FactorContext) -> FactorResult:
    """Return a centre variable (a Point2) and the factor that ties it to the members' planes."""
    members = [member for member in node.members if member in context.plane_keys]
    if len(members) < 2 or node.shape.centre is None:
        return FactorResult()
    reference = np.array(node.shape.centre)
    key = context.new_key(0)
    plane_keys = [context.plane_keys[member] for member in members]
    noise = gtsam.noiseModel.Isotropic.Sigma(2, SIGMA_M)

    def residual(
        _factor: gtsam.CustomFactor, values: gtsam.Values, jacobians: list[FloatArray] | None
    ) -> FloatArray:
        planes = [values.atOrientedPlane3(plane_key) for plane_key in plane_keys]
        if jacobians is not None:
            jacobians[0] = np.eye(2, order="F")
            for k in range(len(planes)):
                jacobians[k + 1] = -_derivative(reference, planes, k)
        return np.asarray(values.atPoint2(key) - _centre_of_planes(reference, planes))

    factor = gtsam.CustomFactor(noise, [key, *plane_keys], residual)
    planes = np.array([context.planes[member] for member in members])
    return FactorResult([factor], [(key, centre_of(reference, planes))])


def centre_of(reference: FloatArray, planes: FloatArray) -> FloatArray:
    """Return f(planes) for vertical planes nx, ny, nz, d [P, 4] and a reference point [2]."""
    normals, offsets = planes[:, :2], planes[:, 3]
    shift = normals.T @ (normals @ reference + offsets)
    return np.asarray(reference - np.linalg.pinv(normals.T @ normals, rcond=PARALLEL) @ shift)


def _centre_of_planes(reference: FloatArray, planes: Sequence[gtsam.OrientedPlane3]) -> FloatArray:
    return centre_of(reference, np.array([plane.planeCoefficients() for plane in planes]))


def _derivative(
    reference: FloatArray, planes: Sequence[gtsam.OrientedPlane3], number: int
) -> FloatArray:
    """Return df / d(tangent of one plane) by central differences, [2, 3], as gtsam wants it."""
    columns = []
    for step in STEP * np.eye(3):
        forward, backward = list(planes), list(planes)
        forward[number] = planes[number].retract(step)
        backward[number] = planes[number].retract(-step)
        difference = _centre_of_planes(reference, forward) - _centre_of_planes(reference, backward)
        columns.append(difference / (2 * STEP))
    return np.asfortranarray(np.column_stack(columns))
