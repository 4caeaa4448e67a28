"""Stages are timed on maps of the wanted size; how fast they are is nobody's test."""

from __future__ import annotations

from dataclasses import astuple

import pytest

from sgraph_core.detector import Detector
from sgraph_core.evaluation.incremental import time_updates
from sgraph_core.evaluation.speed import StageTimes, growth, time_stages


def test_every_stage_of_every_size_is_timed() -> None:
    times = list(time_stages(Detector(), [30, 90], repeats=1, seed=0))
    assert [t.surfaces for t in times] == [30, 90]
    for t in times:
        assert min(t.preprocessing, t.features, t.forward, t.total) > 0


def test_growth_is_the_exponent_of_a_power_law() -> None:
    times = [StageTimes(n, 0, 0, 0, 1e-3 * n**1.5) for n in (100, 1000, 10_000)]
    assert growth(times) == pytest.approx(1.5)


def test_updates_are_timed_in_maps_of_every_size() -> None:
    first, last = time_updates(Detector(), [4, 9], seed=0, repeats=2)
    assert [t.rooms for t in first] == [t.rooms for t in last] == [4, 9]
    for t in (*first, *last):
        assert min(t.inference, t.optimisation, t.whole) > 0
        assert min(astuple(t.work)) > 0
