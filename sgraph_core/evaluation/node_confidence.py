"""Fits what makes a node's confidence the probability that it is right."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sgraph_concepts.errors import InputError
from sgraph_concepts.spec import ConfidenceSpec
from sgraph_concepts.types import FloatArray
from sgraph_core.clustering.confidence import evidence
from sgraph_core.evaluation.scores import Judged

__all__ = ["fit_confidence"]

AS_IT_IS = np.array([0.0, 1.0, 0.0])
"""The constants that leave a confidence as the clusterer says."""
DIGITS = 3


def fit_confidence(judged: Sequence[Judged]) -> ConfidenceSpec:
    """Return the constants under which the nodes' outcomes are likeliest.

    Logistic regression (Platt scaling with the number of members beside the confidence). A prior
    of unit variance around leaving the confidence as it is keeps the constants finite when all
    nodes are right, and decides nothing else. Where all nodes have as many members, as walls do,
    their number is left out.

    Args:
        judged: nodes with the confidences that their clusterer gave them.

    Raises:
        InputError: no node has a confidence.
    """
    from scipy.optimize import minimize

    sure = [one for one in judged if one.node.confidence is not None]
    if not sure:
        raise InputError("there is no scored node with a confidence to fit to")
    confidences = np.array([one.node.confidence for one in sure], np.float64)
    terms = evidence(confidences, np.array([len(one.node.members) for one in sure]))
    if np.ptp(terms[:, 2]) == 0:
        terms[:, 2] = 0
    signs = np.where([one.right for one in sure], 1.0, -1.0)

    def loss(constants: FloatArray) -> float:
        unlikely = np.logaddexp(0, -signs * (terms @ constants)).sum()
        return float(unlikely + ((constants - AS_IT_IS) ** 2).sum() / 2)

    intercept, slope, members = np.round(minimize(loss, AS_IT_IS).x, DIGITS).tolist()
    return ConfidenceSpec(intercept=intercept, slope=slope, members=members)
