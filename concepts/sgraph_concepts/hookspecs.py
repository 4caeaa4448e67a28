"""The hooks that a plugin may implement."""

from __future__ import annotations

from typing import Protocol

import pluggy

from sgraph_concepts.spec import ConceptSpec

__all__ = ["ENTRY_POINT_GROUP", "Registrar", "hookimpl", "hookspec", "sgraph_register"]

ENTRY_POINT_GROUP = "sgraph"
"""Entry points of this group are modules or objects that implement the hooks below."""

hookspec = pluggy.HookspecMarker(ENTRY_POINT_GROUP)
hookimpl = pluggy.HookimplMarker(ENTRY_POINT_GROUP)


class Registrar(Protocol):
    """What a plugin is handed to declare its concepts with."""

    def add(self, spec: ConceptSpec) -> None:
        """Declare one concept."""
        ...


@hookspec
def sgraph_register(registry: Registrar) -> None:
    """Declare the plugin's concepts with ``registry.add(spec)``.

    Called once when the plugins are loaded. It should only declare: everything heavy belongs into
    the modules that the declaration refers to.
    """
