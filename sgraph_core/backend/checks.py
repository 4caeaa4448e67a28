"""What a plugin's factors must be before they enter a graph: gtsam accepts nearly anything."""

from __future__ import annotations

import gtsam
import numpy as np

from sgraph_concepts.errors import ConceptError, one_line
from sgraph_concepts.types import FactorResult

__all__ = ["check_factors"]


def check_factors(
    what: str, result: FactorResult, planes: gtsam.Values, others: gtsam.Values
) -> None:
    """Check the factors that a plugin returned for one node.

    Each factor that calls back into Python is linearised once: gtsam takes Jacobians of the wrong
    width without a word, and solves something else.

    Args:
        what: named in the error.
        result: the node's factors and variables.
        planes: the variables that the factors may use besides their own.
        others: variables of other nodes.

    Raises:
        ConceptError: a key is taken or unknown, or an error or derivative is not finite or not of
            the size that its variables have.
    """
    own = gtsam.Values()
    for key, value in result.values:
        if own.exists(key) or others.exists(key) or planes.exists(key):
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
    what: str, factor: gtsam.NonlinearFactor, own: gtsam.Values, planes: gtsam.Values
) -> None:
    for key in factor.keys():  # noqa: SIM118  (a gtsam factor is no mapping)
        if not own.exists(key) and not planes.exists(key):
            name = gtsam.DefaultKeyFormatter(key)
            raise ConceptError(f"{what}: {name} is neither a member's plane nor the node's own")
    _check_noise(what, factor)
    if not isinstance(factor, gtsam.CustomFactor):
        return
    keys = factor.keys()
    point = own.extract([key for key in keys if own.exists(key)])
    point.insert(planes.extract([key for key in keys if not own.exists(key)]))
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
    if not isinstance(model, gtsam.noiseModel.Gaussian):
        return
    root = model.R()
    if not np.isfinite(root).all() or (np.diag(root) <= 0).any():
        raise ConceptError(f"{what}: its covariance is not positive definite")
