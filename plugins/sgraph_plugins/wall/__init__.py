"""Walls: the two sides of one wall body."""

from sgraph_concepts import ConceptSpec, ConfidenceSpec, HeadSpec, Registrar, hookimpl

WALL = ConceptSpec(
    name="wall",
    relation="same_wall",
    description="The two opposed surfaces of one wall.",
    head=HeadSpec(weights="wall.onnx", encoder="1", intercept=-0.58, slope=1.049),
    baseline="sgraph_plugins.wall.baseline:score",
    clusterer="sgraph_plugins.wall.cluster:cluster",
    confidence=ConfidenceSpec(intercept=1.105, slope=0.678, members=0.0),
    shape="sgraph_plugins.wall.shape:shape",
    factor="sgraph_plugins.wall.factor:factors",
    labeller="sgraph_plugins.wall.labeller:label",
    exclusive=False,
    local=True,
)


@hookimpl
def sgraph_register(registry: Registrar) -> None:
    """Declare the wall."""
    registry.add(WALL)
