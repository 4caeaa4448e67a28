"""The S-Graph and everything that works on all concepts alike.

::

    import sgraph_core

    graph = sgraph_core.load("map.json")
    result = sgraph_core.infer(graph)
    sgraph_core.save(result, "rooms.json")

Names are imported on first use: importing this package costs next to nothing.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sgraph_core.api import infer
    from sgraph_core.detector import Detector
    from sgraph_core.formats import load
    from sgraph_core.graph import SGraph
    from sgraph_core.map_file import save

__all__ = ["Detector", "SGraph", "infer", "load", "save"]

_HOMES = {
    "Detector": "sgraph_core.detector",
    "SGraph": "sgraph_core.graph",
    "infer": "sgraph_core.api",
    "load": "sgraph_core.formats",
    "save": "sgraph_core.map_file",
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(_HOMES[name]), name)
