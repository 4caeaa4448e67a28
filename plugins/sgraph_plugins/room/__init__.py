"""Rooms: surfaces that enclose one free space."""

from sgraph_concepts import ConceptSpec, ConfidenceSpec, HeadSpec, Registrar, hookimpl

ROOM = ConceptSpec(
    name="room",
    relation="same_room",
    description="Wall surfaces that enclose one free space.",
    head=HeadSpec(weights="room.onnx", encoder="1", intercept=0.78, slope=1.437),
    baseline="sgraph_plugins.room.baseline:score",
    clusterer="sgraph_plugins.room.cluster:cluster",
    confidence=ConfidenceSpec(intercept=-4.939, slope=2.627, members=1.808),
    shape="sgraph_plugins.room.shape:shape",
    factor="sgraph_plugins.room.factor:factors",
    labeller="sgraph_plugins.room.labeller:label",
)


@hookimpl
def sgraph_register(registry: Registrar) -> None:
    """Declare the room."""
    registry.add(ROOM)
