"""`sgraph infer --explain`: what is asked, and how the answer is printed."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import typer

from sgraph_cli.console import print_table

if TYPE_CHECKING:
    from rich.table import Table

    from sgraph_core.detector import Detector
    from sgraph_core.explain import (
        Balance,
        BorderOpening,
        Link,
        NodeExplanation,
        Outsider,
        PairExplanation,
        Relation,
    )
    from sgraph_core.graph import SGraph
    from sgraph_core.sight import Sight

__all__ = ["Question", "answer", "parse_question", "print_answer"]

MOST_LINKS = 3
"""How many of the links that decided are named."""
ID = "[0-9]{1,16}"
"""An id; the map file allows none of more digits."""


@dataclass(frozen=True)
class Question:
    """A node (``concept`` and one id), or a pair of wall surfaces (no concept, two ids)."""

    concept: str
    ids: tuple[int, ...]


def parse_question(text: str) -> Question:
    """Return what ``room:7`` or ``12,45`` asks for.

    Raises:
        typer.BadParameter: the text is of neither form.
    """
    node = re.fullmatch(rf"(\w+):({ID})", text)
    if node:
        return Question(node[1], (int(node[2]),))
    pair = re.fullmatch(rf"({ID}),({ID})", text)
    if pair:
        return Question("", (int(pair[1]), int(pair[2])))
    raise typer.BadParameter(
        f"{text!r} must be CONCEPT:ID, such as room:7, or two wall surfaces, such as 12,45",
        param_hint="--explain",
    )


def answer(
    question: Question, graph: SGraph, detector: Detector
) -> NodeExplanation | PairExplanation:
    """Return the explanation of what a detector has inferred in a graph."""
    from sgraph_core.explain import explain_node, explain_pair

    if question.concept:
        return explain_node(graph, detector, question.concept, question.ids[0])
    return explain_pair(graph, detector, *question.ids)


def print_answer(answered: NodeExplanation | PairExplanation, graph: SGraph) -> None:
    """Print an explanation to stdout."""
    from sgraph_core.explain import NodeExplanation

    if isinstance(answered, NodeExplanation):
        _print_node(answered, graph)
    else:
        _print_pair(answered, graph)


# -- a node ----------------------------------------------------------------------------------------


def _print_node(answered: NodeExplanation, graph: SGraph) -> None:
    concept, node = answered.concept, answered.node
    title = f"{concept} {node.id} of {graph.name or 'map'}"
    if node.confidence is not None:
        title += f": confidence {node.confidence:.2f}"
    table = _table(title, "surface", "linked to", "mean probability", "sum of log-odds")
    table.add_column("strongest link")
    table.add_column()
    for member in answered.members:
        support, strongest = member.support, next(iter(member.support.links), None)
        notes = ["weakest"] if member.id == answered.weakest else []
        notes += [f"pinned together with {_listed(member.pinned)}"] if member.pinned else []
        notes += [] if member.copy_of is None else [f"copy of {member.copy_of}"]
        table.add_row(
            str(member.id),
            f"{len({link.two for link in support.links})} of {len(answered.members) - 1}",
            "" if support.mean_probability is None else f"{support.mean_probability:.2f}",
            f"{support.total:+.1f}",
            "" if strongest is None else f"{strongest.two}: {strongest.probability:.2f}",
            ", ".join(notes),
        )
    print_table(table)
    if answered.outsider is not None:
        typer.echo(_outsider(answered.outsider, concept, graph))
    if answered.border:
        print_table(_border(answered.border, concept, graph))
    elif node.shape.polygon is not None:
        typer.echo("its border has no openings")


def _outsider(outsider: Outsider, concept: str, graph: SGraph) -> str:
    support = outsider.support
    pinned = f"pinned apart from {_listed(outsider.pinned)}, " if outsider.pinned else ""
    line = (
        f"strongest outside: {_placed(outsider.id, concept, graph)}, {pinned}"
        f"log-odds {support.total:+.1f} in sum, strongest link {_named(support.links[:1])}"
    )
    if outsider.own is not None and outsider.own.links:
        line += f"; {outsider.own.total:+.1f} to the rest of its own {concept}"
    return line


def _border(border: Sequence[BorderOpening], concept: str, graph: SGraph) -> Table:
    table = _table("openings in its border", "", "length", "from", "to")
    table.add_column("facing it")
    table.add_column("facing away")
    for opening in border:
        pieces = zip(opening.opening.segments.tolist(), opening.opening.lengths_m, strict=True)
        facing, behind = (
            ", ".join(_placed(surface, concept, graph) for surface in surfaces)
            for surfaces in (opening.facing, opening.behind)
        )
        for number, (segment, length) in enumerate(pieces):
            ends = [f"{x:.2f}, {y:.2f}" for x, y in segment]
            what = "" if number else opening.opening.kind
            table.add_row(what, f"{length:.2f} m", *ends, *([] if number else [facing, behind]))
    return table


# -- a pair ----------------------------------------------------------------------------------------


def _print_pair(answered: PairExplanation, graph: SGraph) -> None:
    one, two = answered.one, answered.two
    for surface, kept in answered.copies.items():
        typer.echo(f"{surface} repeats {kept}, which stands for it")
    if answered.sight is None:
        typer.echo(f"{one} and {two} are one surface, mapped twice")
        return
    typer.echo(f"{one} and {two} of {graph.name or 'map'} are {answered.distance_m:.2f} m apart")
    typer.echo(_sight(answered.sight))
    table = _table("", "relation", "probability", "scored log-odds", f"{one} is in", f"{two} is in")
    for relation in answered.relations:
        link = relation.link
        score = (
            ("not scored", "")
            if link is None
            else (f"{link.probability:.2f}", f"{link.logit:+.1f}")
        )
        held = (_nodes(relation.concept, nodes) for nodes in relation.nodes)
        table.add_row(relation.relation, *score, *held)
    print_table(table)
    if any(relation.link is None for relation in answered.relations):
        typer.echo(_not_scored(answered.sight, answered.distance_m))
    for relation in answered.relations:
        reason = _reason(relation, answered)
        if reason:
            typer.echo(f"{relation.relation}: {reason}")


def _sight(sight: Sight) -> str:
    line = f"{sight.free} of {sight.lines} lines of sight are free"
    if sight.behind:
        line += f", {sight.behind} start or end behind one of the two"
    blocked = ", ".join(f"{surface} ({count})" for surface, count in sight.blockers)
    return f"{line}; blocked by {blocked}" if blocked else line


def _not_scored(sight: Sight, distance_m: float) -> str:
    from sgraph_core.proximity import CLOSE_M

    if sight.free or distance_m <= CLOSE_M:
        return "not scored: both have many nearer neighbours"
    return f"not scored: they do not see each other and are more than {CLOSE_M} m apart"


def _reason(relation: Relation, answered: PairExplanation) -> str:
    """Return what two surfaces are pinned to be, or why the clusterer went against their relation.

    Empty if neither holds.
    """
    if relation.pinned is not None:
        return f"pinned {relation.pinned}"
    concept, balance = relation.concept, relation.balance
    scored_for = relation.link is not None and relation.link.scored_for
    if relation.strays:
        held = dict(zip((answered.one, answered.two), relation.nodes, strict=True))
        strays = [
            _stray(f"a piece of {surface}" if held[surface] else str(surface), links, concept)
            for surface, links in relation.strays
        ]
        return f"scored for, but {' and '.join(strays)}"
    if balance is None:
        apart = scored_for and not relation.shared
        return f"scored for, but the clusterer makes no {concept} of the two" if apart else ""
    count = len(balance.links)
    links = f"{count} link{'' if count == 1 else 's'}, log-odds {balance.total:+.1f} in sum"
    if relation.shared:
        score = "not scored" if relation.link is None else "scored against"
        return (
            f"{score}, but {answered.one} and the rest of {_nodes(concept, relation.shared)} "
            f"have {links}, the strongest {_named(balance.links[:MOST_LINKS])}"
        )
    one, two = (_nodes(concept, nodes) for nodes in relation.nodes)
    weakest = _named(balance.links[: -MOST_LINKS - 1 : -1])
    return f"scored for, but {one} and {two} have {links}, the weakest {weakest}"


def _stray(name: str, balance: Balance, concept: str) -> str:
    scored_for = [link for link in balance.links if link.scored_for]
    return f"{name} is in no {concept} (scored for: {_named(scored_for[:MOST_LINKS])})"


# -- words -----------------------------------------------------------------------------------------


def _table(title: str, *columns: str) -> Table:
    from rich import box
    from rich.table import Table

    table = Table(title=title, box=box.SIMPLE_HEAD)
    for column in columns:
        table.add_column(column, justify="right")
    return table


def _listed(ids: Sequence[int]) -> str:
    return ", ".join(map(str, ids))


def _named(links: Sequence[Link]) -> str:
    return ", ".join(f"{link.one}-{link.two} ({link.probability:.2f})" for link in links)


def _placed(surface: int, concept: str, graph: SGraph) -> str:
    nodes = [node.id for node in graph.concepts[concept] if surface in node.members]
    return f"{surface} ({_nodes(concept, nodes)})"


def _nodes(concept: str, ids: Sequence[int]) -> str:
    return ", ".join(f"{concept} {node}" for node in ids) or f"no {concept}"
