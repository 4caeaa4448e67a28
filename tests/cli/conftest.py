"""Run the real command."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

Sgraph = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture(scope="session")
def sgraph() -> Sgraph:
    command = Path(sys.executable).parent / "sgraph"

    def run(*arguments: object, **environment: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [command, *map(str, arguments)],
            capture_output=True,
            text=True,
            check=False,
            timeout=120,
            env={**os.environ, **environment},
        )

    return run
