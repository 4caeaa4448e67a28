"""Which gtsam key stands for what."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass

import gtsam

from sgraph_concepts.errors import InputError

__all__ = ["Keys"]


def _keyframe(keyframe_id: int) -> int:
    return int(gtsam.symbol("x", keyframe_id))


def _surface(surface_id: int) -> int:
    return int(gtsam.symbol("s", surface_id))


ID_BITS, VARIABLE_BITS, TIED_BITS = 32, 8, 28


def _node(concept: str, node_id: int, variable: int) -> int:
    """Pack concept, id and variable into a symbol's 56 bits; 16 of them tell concepts apart."""
    if node_id >= 1 << ID_BITS or variable >= 1 << VARIABLE_BITS:
        raise InputError(
            f"{concept} {node_id}: the default keys hold ids below 2^32 and 256 variables per node"
        )
    number = zlib.crc32(concept.encode()) & 0xFFFF
    return int(gtsam.symbol("c", (number << ID_BITS | node_id) << VARIABLE_BITS | variable))


def _tie(one: int, two: int) -> int:
    """Pack two surface ids into a symbol's 56 bits."""
    low, high = min(one, two), max(one, two)
    if high >= 1 << TIED_BITS:
        raise InputError(f"wall surface {high}: the default keys of ties hold ids below 2^28")
    return int(gtsam.symbol("t", low << TIED_BITS | high))


@dataclass(frozen=True)
class Keys:
    """The keys of the variables; give your own functions to fit a graph of your own.

    Attributes:
        keyframe: key of a keyframe's Pose3 by its id; ``x`` symbols by default.
        surface: key of a wall surface's OrientedPlane3 by its id; ``s`` symbols by default.
        node: key of a node's variable by concept, node id and the variable's number; ``c`` symbols
            by default, of ids below 2^32 and numbers below 256.
        tie: key of the anchor between two surfaces, by their ids, that are one surface mapped
            twice; ``t`` symbols by default, of ids below 2^28.
    """

    keyframe: Callable[[int], int] = _keyframe
    surface: Callable[[int], int] = _surface
    node: Callable[[str, int, int], int] = _node
    tie: Callable[[int, int], int] = _tie
