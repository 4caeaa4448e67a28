"""The installed concepts, as this version of the core sees them."""

from __future__ import annotations

from functools import cache

from sgraph_concepts.registry import Registry
from sgraph_core.network import ENCODER_VERSION

__all__ = ["BUILTINS", "installed", "new_registry"]

BUILTINS = {
    "clusterer": {"cycles": "sgraph_core.clustering.cycles:cluster"},
    "factor": {"published": "sgraph_core.backend.published:factors"},
}
"""Parts, by kind, that a declaration or the user may name without saying where they are."""


def new_registry() -> Registry:
    """Return a registry without concepts, to which any may be added."""
    return Registry(ENCODER_VERSION, BUILTINS)


@cache
def installed() -> Registry:
    """Return the registry of the installed plugins, loaded once."""
    registry = new_registry()
    registry.load_entry_points()
    return registry
