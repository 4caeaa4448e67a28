"""What a concept is: the vocabulary, its declaration, the hooks and the registry.

Importing this package loads neither torch nor gtsam. A plugin needs nothing else to declare
itself::

    from sgraph_concepts import ConceptSpec, Registrar, hookimpl

    @hookimpl
    def sgraph_register(registry: Registrar) -> None:
        registry.add(ConceptSpec(name="corridor", ...))
"""

from sgraph_concepts.errors import SGraphError
from sgraph_concepts.hookspecs import ENTRY_POINT_GROUP, Registrar, hookimpl
from sgraph_concepts.registry import PluginProblem, RegisteredConcept, Registry
from sgraph_concepts.spec import WALL_SURFACE, ConceptSpec, ConfidenceSpec, HeadSpec

__all__ = [
    "ENTRY_POINT_GROUP",
    "WALL_SURFACE",
    "ConceptSpec",
    "ConfidenceSpec",
    "HeadSpec",
    "PluginProblem",
    "RegisteredConcept",
    "Registrar",
    "Registry",
    "SGraphError",
    "hookimpl",
]
