"""What a planner asks of a map's rooms."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sgraph_concepts.errors import InputError
from sgraph_core.graph import SGraph

if TYPE_CHECKING:
    import networkx

__all__ = ["adjacency"]


def adjacency(graph: SGraph) -> networkx.Graph[int]:
    """Return which rooms of an S-Graph lead into one another.

    Returns:
        A graph whose nodes are the rooms' ids, with ``centre`` (x, y), ``area_m2`` and ``name``,
        None where not known. Two rooms with doorways between them are joined by an edge that holds
        them as ``doorways``, a list of dicts with ``position`` (x, y) and ``width_m``.

    Raises:
        InputError: no rooms have been inferred, or a doorway leads to a room that is not there.
    """
    import networkx

    if "room" not in graph.concepts:
        raise InputError("the S-Graph holds no rooms: infer them first")
    result: networkx.Graph[int] = networkx.Graph()
    for room in graph.concepts["room"]:
        area = room.shape.attributes.get("area_m2")
        result.add_node(room.id, centre=room.shape.centre, area_m2=area, name=room.name)
    for room in graph.concepts["room"]:
        for door in room.shape.attributes.get("doorways", ()):
            one, two = door["rooms"]
            if one not in result or two not in result:
                raise InputError(
                    f"room {room.id} has a doorway to {two if one in result else one}, "
                    "which is not there"
                )
            if room.id == one:  # both rooms tell of the doorway
                if not result.has_edge(one, two):
                    result.add_edge(one, two, doorways=[])
                x, y = door["position"]
                result[one][two]["doorways"].append(
                    {"position": (x, y), "width_m": door["width_m"]}
                )
    return result
