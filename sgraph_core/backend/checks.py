"""What a plugin's factors must be before they enter a graph: gtsam accepts nearly anything."""

from __future__ import annotations

from collections.abc import Mapping

import gtsam
import numpy as np

from sgraph_concepts.errors import ConceptError, one_line
from sgraph_concepts.types import FactorResult, FloatArray

__all__ = ["check_factors"]


def check_factors(
    what: str, result: FactorResult, planes: Mapping[int, FloatArray], others: gtsam.Values
) -> None:
    """Check the factors that a plugin returned for one node.

    Each factor that calls back into Python is linearised once: gtsam takes Jacobians of the wrong
    width without a word, and solves something else.

    Args:
        what: named in the error.
        result: the node's factors and variables.
        planes: the variables that the factors may use besides their own: nx, ny, nz, d by key.
        others: variables of other nodes.

    Raises:
        ConceptError: a key is taken or unknown, or an error or derivative is not finite or not of
            the size that its variables have.
    """
    own = gtsam.Values()
    for key, value in result.values:
        if own.exists(key) or others.exists(key) or key in planes:
            raise ConceptError(f"{what}: the key {gtsam.DefaultKeyFormatter(key)} is taken")
        try:
            own.insert(key, value)
        except TypeError as error:
            raise ConceptError(f"{what}: {value!r} is no value for gtsam") from error
    for factor in result.factors:
        if not isinstance(factor, gtsam.NonlinearFactor):
            raise ConceptError(f"{what}: {factor!r} is no gtsam factor")
        _check(what, factor, own, planes)


def _check(
    what: str,
    factor: gtsam.NonlinearFactor,
    own: gtsam.Values,
    planes: Mapping[int, FloatArray],
) -> None:
    keys = factor.keys()
    for key in keys:
        if key not in planes and not own.exists(key):
            name = gtsam.DefaultKeyFormatter(key)
            raise ConceptError(f"{what}: {name} is neither a member's plane nor the node's own")
    _check_noise(what, factor)
    if not isinstance(factor, gtsam.CustomFactor):
        return
    point = own.extract([key for key in keys if own.exists(key)])
    for key in set(keys) & planes.keys():
        point.insert(key, gtsam.OrientedPlane3(*planes[key]))
    try:
        jacobian, error = factor.linearize(point).jacobian()
    except Exception as problem:  # a third party's code may raise anything
        raise ConceptError(f"{what} cannot be linearised: {one_line(problem)}") from problem
    if jacobian.shape[1] != point.dim():
        raise ConceptError(
            f"{what}: its Jacobians are {jacobian.shape[1]} wide together, "
            f"its variables {point.dim()}"
        )
    if not (np.isfinite(jacobian).all() and np.isfinite(error).all()):
        raise ConceptError(f"{what}: its error or Jacobians are not finite")


def _check_noise(what: str, factor: gtsam.NonlinearFactor) -> None:
    model = factor.noiseModel() if isinstance(factor, gtsam.NoiseModelFactor) else None
    if isinstance(model, gtsam.noiseModel.Diagonal):
        definite = all(0 < sigma < np.inf for sigma in model.sigmas().tolist())
    elif isinstance(model, gtsam.noiseModel.Gaussian):
        root = model.R()
        definite = bool(np.isfinite(root).all() and (np.diag(root) > 0).all())
    else:
        return
    if not definite:
        raise ConceptError(f"{what}: its covariance is not positive definite")
