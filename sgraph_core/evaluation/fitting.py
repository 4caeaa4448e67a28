"""Fits what makes probabilities of relations and confidences of nodes mean what they say."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sgraph_concepts.errors import InputError
from sgraph_concepts.spec import ConfidenceSpec
from sgraph_concepts.types import FloatArray
from sgraph_core.clustering.confidence import evidence
from sgraph_core.detector import Detector
from sgraph_core.evaluation.calibration import TRUE_RELATIONS
from sgraph_core.evaluation.scores import Judged, score_floor
from sgraph_core.evaluation.sources import find_sources, load_with_truth

__all__ = ["Outcomes", "fit_confidence", "fit_relation", "gather_outcomes"]

DIGITS = 3


@dataclass(frozen=True)
class Outcomes:
    """What one concept's scores foretold on several maps, and what came true.

    Attributes:
        logits: of the pairs whose truth is known, per map.
        related: whether they are, per map.
        judged: the nodes that are scored.
    """

    logits: list[FloatArray] = field(default_factory=list)
    related: list[NDArray[np.bool_]] = field(default_factory=list)
    judged: list[Judged] = field(default_factory=list)


def gather_outcomes(
    paths: Sequence[Path],
    only: Sequence[Path],
    detector: Detector,
    progress: Callable[[str, int, int], object],
) -> dict[str, Outcomes]:
    """Infer maps and return what came true of the concepts room and wall, where installed.

    Args:
        paths: map files with truth, or folders of them.
        only: lists of maps (see :func:`find_sources`).
        detector: one that is not calibrated.
        progress: told after every map.

    Raises:
        InputError: a map has no truth, a folder no map, a list names none of them, or neither
            concept is installed.
        MapFileError: a map cannot be read.
    """
    outcomes: dict[str, Outcomes] = {}
    files = [file for source in find_sources(paths, only) for file in source.files]
    for done, file in enumerate(files, start=1):
        graph, truth = load_with_truth(file)
        trace = detector.trace(graph)
        judged = score_floor(trace.graph, truth).judged
        surfaces = trace.scene.surfaces.ids[trace.scene.pairs]
        for concept, look_up in TRUE_RELATIONS.items():
            if concept not in trace.relations:
                continue
            known, related = look_up(surfaces, truth)
            found = outcomes.setdefault(concept, Outcomes())
            found.logits.append(trace.relations[concept].logits[known])
            found.related.append(related[known])
            found.judged.extend(judged[concept])
        progress("evaluating", done, len(files))
    if not outcomes:
        raise InputError(f"none of the concepts {', '.join(TRUE_RELATIONS)} is installed")
    return outcomes


def fit_relation(logits: FloatArray, related: NDArray[np.bool_]) -> tuple[float, float]:
    """Return the intercept and slope of the logits under which the truth is likeliest.

    Platt scaling: a temperature, and a shift for how often the relation holds on real maps.

    Args:
        logits: of pairs of any maps, [E].
        related: whether they are related, [E].
    """
    terms = np.stack([np.ones(len(related)), logits], axis=1)
    intercept, slope = _likeliest(terms, related, np.array([0.0, 1.0]))
    return intercept, slope


def fit_confidence(judged: Sequence[Judged]) -> ConfidenceSpec:
    """Return the constants under which the nodes' outcomes are likeliest.

    Platt scaling with the number of members beside the confidence. Where all nodes have as many
    members, as walls do, their number is left out.

    Args:
        judged: nodes with the confidences that their clusterer gave them.

    Raises:
        InputError: no node has a confidence.
    """
    sure = [one for one in judged if one.node.confidence is not None]
    if not sure:
        raise InputError("there is no scored node with a confidence to fit to")
    confidences = np.array([one.node.confidence for one in sure], np.float64)
    terms = evidence(confidences, np.array([len(one.node.members) for one in sure]))
    if np.ptp(terms[:, 2]) == 0:
        terms[:, 2] = 0
    right = np.array([one.right for one in sure])
    intercept, slope, members = _likeliest(terms, right, np.array([0.0, 1.0, 0.0]))
    return ConfidenceSpec(intercept=intercept, slope=slope, members=members)


def _likeliest(terms: FloatArray, outcomes: NDArray[np.bool_], prior: FloatArray) -> list[float]:
    """Return the constants of a logistic regression, rounded.

    A prior of unit variance around constants that change nothing keeps them finite when all
    outcomes are alike, and decides nothing else.
    """
    from scipy.optimize import minimize

    signs = np.where(outcomes, 1.0, -1.0)

    def loss(constants: FloatArray) -> float:
        unlikely = np.logaddexp(0, -signs * (terms @ constants)).sum()
        return float(unlikely + ((constants - prior) ** 2).sum() / 2)

    found: list[float] = np.round(minimize(loss, prior).x, DIGITS).tolist()
    return found
