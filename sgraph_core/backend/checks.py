"""What a plugin's factors must be before they enter a graph: gtsam accepts nearly anything."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NoReturn

import gtsam
import numpy as np

from sgraph_concepts.errors import ConceptError, one_line, shorten
from sgraph_concepts.types import FactorResult, FloatArray
from sgraph_core.tables import is_id

__all__ = ["check_factors", "check_result"]


def check_result(what: str, result: FactorResult) -> None:
    """Check that a factor function returned lists of what they should hold.

    Args:
        what: named in the error.
        result: what it returned.

    Raises:
        ConceptError: something is no sequence, no key with its value, or no pair of surfaces.
    """

    def refuse(field: str, value: object, rule: str) -> NoReturn:
        raise ConceptError(f"{what}: {field} = {shorten(value, repr)}: {rule}")

    for field in ("factors", "values", "same"):
        if not isinstance(getattr(result, field), Sequence):
            refuse(field, getattr(result, field), "must be a sequence")
    for k, item in enumerate(result.values):
        if not (_is_pair(item) and isinstance(item[0], int)):
            refuse(f"values[{k}]", item, "must be a key and its value")
    for k, pair in enumerate(result.same):
        if not (_is_pair(pair) and all(map(is_id, pair)) and pair[0] != pair[1]):
            refuse(f"same[{k}]", pair, "must be the ids of two surfaces")


def _is_pair(value: object) -> bool:
    return isinstance(value, tuple | list) and len(value) == 2


def check_factors(
    what: str, result: FactorResult, planes: Mapping[int, FloatArray], others: gtsam.Values
) -> None:
    """Check the factors that a plugin returned for one node.

    Each factor's error and Jacobians are asked for once, unwhitened: gtsam takes Jacobians of the
    wrong width without a word and solves something else, and whitening those of the wrong height
    reads and writes beyond their ends.

    Args:
        what: named in the error.
        result: the node's factors and variables.
        planes: the variables that the factors may use besides their own: nx, ny, nz, d by key.
        others: variables of other nodes.

    Raises:
        ConceptError: a key is taken, unknown or named twice by one factor, a variable is of a type
            that its factor does not take, there is no noise model, a covariance is not positive
            definite, or an error or derivative is not finite or not of the size that noise model
            and variables have.
    """
    own = gtsam.Values()
    for key, value in result.values:
        if own.exists(key) or others.exists(key) or key in planes:
            raise ConceptError(f"{what}: the key {gtsam.DefaultKeyFormatter(key)} is taken")
        try:
            own.insert(key, value)
        except TypeError as error:
            raise ConceptError(f"{what}: {shorten(value, repr)} is no value for gtsam") from error
    for factor in result.factors:
        if not isinstance(factor, gtsam.NonlinearFactor):
            raise ConceptError(f"{what}: {shorten(factor, repr)} is no gtsam factor")
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
    if len(set(keys)) < len(keys):  # gtsam does not add up the Jacobians of one variable
        raise ConceptError(f"{what}: it names a variable twice")
    _check_noise(what, factor)
    point = own.extract([key for key in keys if own.exists(key)])
    for key in set(keys) & planes.keys():
        point.insert(key, plane=gtsam.OrientedPlane3(*planes[key]))
    try:
        error, jacobians = _evaluated(factor, point)
    except Exception as problem:  # a third party's code may raise anything
        raise ConceptError(f"{what} cannot be linearised: {one_line(problem)}") from problem
    if isinstance(factor, gtsam.CustomFactor):
        _check_sizes(what, factor, point.dims(), error, jacobians)
    if not all(np.isfinite(part).all() for part in (error, *jacobians)):
        raise ConceptError(f"{what}: its error or Jacobians are not finite")


def _check_noise(what: str, factor: gtsam.NonlinearFactor) -> None:
    if not isinstance(factor, gtsam.NoiseModelFactor):
        return
    model = factor.noiseModel()
    while isinstance(model, gtsam.noiseModel.Robust):
        model = model.noise()
    if model is None:
        raise ConceptError(f"{what}: it has no noise model")
    definite = True
    if isinstance(model, gtsam.noiseModel.Diagonal):
        definite = all(0 < sigma < np.inf for sigma in model.sigmas().tolist())
    elif isinstance(model, gtsam.noiseModel.Gaussian):
        root = model.R()
        definite = bool(np.isfinite(root).all() and (np.diag(root) > 0).all())
    if not definite:
        raise ConceptError(f"{what}: its covariance is not positive definite")


def _evaluated(
    factor: gtsam.NonlinearFactor, point: gtsam.Values
) -> tuple[FloatArray, list[FloatArray]]:
    """Return a factor's error and its Jacobians, one per key, before whitening."""
    if not isinstance(factor, gtsam.NoiseModelFactor):
        return np.array([factor.error(point)]), []
    jacobians = gtsam.JacobianVector([np.empty((0, 0))] * factor.size())
    return factor.unwhitenedError(point, jacobians), list(jacobians)


def _check_sizes(
    what: str,
    factor: gtsam.CustomFactor,
    dims: Mapping[int, int],
    error: FloatArray,
    jacobians: Sequence[FloatArray],
) -> None:
    """Check what Python returned before gtsam's C++ reads beyond its ends."""
    keys, rows = factor.keys(), factor.dim()
    if len(error) != rows:
        raise ConceptError(f"{what}: its error has {len(error)} rows, its noise model {rows}")
    if len(jacobians) != len(keys):
        raise ConceptError(f"{what}: it has {len(jacobians)} Jacobians for {len(keys)} variables")
    widths = sum(jacobian.shape[1] for jacobian in jacobians), sum(dims[key] for key in keys)
    for key, jacobian in zip(keys, jacobians, strict=True):
        if jacobian.shape != (rows, dims[key]):
            raise ConceptError(
                f"{what}: its Jacobians are {widths[0]} wide together, its variables {widths[1]}; "
                f"that of {gtsam.DefaultKeyFormatter(key)} is {jacobian.shape[0]} x "
                f"{jacobian.shape[1]}, must be {rows} x {dims[key]}"
            )
