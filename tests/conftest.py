"""Fixtures shared by all tests."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import settings

from sgraph_core.detector import Detector

settings.register_profile("repeatable", derandomize=True)
settings.load_profile("repeatable")


@pytest.fixture(scope="session")
def detector() -> Detector:
    return Detector()


@pytest.fixture(scope="session")
def baseline() -> Detector:
    return Detector(scorer="baseline")


@pytest.fixture(scope="session")
def demo_map() -> Path:
    return Path(__file__).parent.parent / "docs" / "demo" / "office.json"


@pytest.fixture(scope="session")
def real_buildings() -> Path:
    """The folder of real buildings, where the environment names one."""
    folder = os.environ.get("SGRAPH_DATA", "")
    if not folder or not (Path(folder) / "surfaces").is_dir():
        pytest.skip("SGRAPH_DATA names no folder of real buildings")
    return Path(folder)
