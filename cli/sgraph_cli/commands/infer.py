"""`sgraph infer`: a map in; rooms, walls and corrected poses out."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sgraph_cli.arguments import (
    Clusterers,
    MapFile,
    Scorer,
    ScorerName,
    Weights,
    by_concept,
    load_map,
    make_detector,
    naming,
    refuse_beside,
)
from sgraph_cli.console import note, print_table
from sgraph_cli.explanation import answer, parse_question, print_answer

if TYPE_CHECKING:
    from sgraph_concepts.types import NodeShape
    from sgraph_core.backend import Optimization
    from sgraph_core.graph import SGraph

__all__ = ["infer"]


def infer(
    map_file: MapFile,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            help="Write the map with its concepts here; may equal a JSON MAP. If it ends in .png: "
            "of an occupancy grid, an image of the rooms' labels, and a YAML file beside it.",
        ),
    ] = None,
    plot: Annotated[
        Path | None, typer.Option("--plot", help="Write a picture here (.png, .svg or .pdf).")
    ] = None,
    optimize: Annotated[
        bool,
        typer.Option("--optimize", help="Also solve the factor graph and move poses and surfaces."),
    ] = False,
    concept: Annotated[
        list[str] | None,
        typer.Option("--concept", help="Infer this concept only; may be repeated."),
    ] = None,
    explain: Annotated[
        str | None,
        typer.Option(
            metavar="WHAT",
            help="Instead of the table, print why a node is what it is (room:7), or why two wall "
            "surfaces are together or not (12,45).",
        ),
    ] = None,
    json_: Annotated[
        bool, typer.Option("--json", help="Print to stdout what the output file would hold.")
    ] = False,
    scorer: Scorer = ScorerName.network,
    weights: Weights = None,
    clusterer: Clusterers = None,
    factor: Annotated[
        list[str] | None,
        typer.Option(
            metavar="CONCEPT=NAME",
            help="Another factor type for --optimize, such as wall=published or room=none.",
        ),
    ] = None,
) -> None:
    """Infer rooms, walls and further concepts of a map.

    Without -o, --json and --explain, a table is printed.
    """
    question = None if explain is None else parse_question(explain)
    if json_:
        refuse_beside("--json", {"--explain": question})
    if factor and not optimize:
        raise typer.BadParameter("needs --optimize", param_hint="--factor")
    factors = by_concept(factor or [], "--factor")
    detector = make_detector(scorer, weights, clusterer)
    from sgraph_core.formats import check_outputs
    from sgraph_core.grid.label_image import (
        SUFFIX,
        check_label_image,
        description_of,
        save_label_image,
    )
    from sgraph_core.map_file import dump, save
    from sgraph_core.plotting import check_name
    from sgraph_core.plotting import plot as draw

    if plot is not None:
        check_name(plot)
    paints = output is not None and output.suffix.lower() == SUFFIX
    beside = [description_of(output)] if output is not None and paints else []
    check_outputs(map_file, [file for file in (output, plot) if file is not None], beside)
    graph = load_map(map_file)
    if output is not None and paints:
        check_label_image(graph, output)
    if optimize:
        from sgraph_core.api import infer_and_optimize

        with naming(map_file):
            result, solved = infer_and_optimize(graph, detector, concept, factors)
        _report(solved)
    else:
        result = detector.infer(graph, concept)
    answered = None if question is None else answer(question, result, detector)
    if output is not None:
        (save_label_image if paints else save)(result, output)
    if plot is not None:
        draw(result, plot)
    if answered is not None:
        print_answer(answered, result)
    elif json_:
        typer.echo(dump(result), nl=False)
    elif output is None:
        _print_nodes(result)


def _report(solved: Optimization) -> None:
    note(
        f"optimised {solved.factors} factors in {solved.iterations} iterations: "
        f"error {solved.initial_error:.6g} -> {solved.final_error:.6g}"
    )
    if not solved.converged:
        note("the solution has not converged: odometry or observations contradict one another")
    if solved.association.same:
        note(f"tied {len(solved.association.same)} pairs of surfaces that are one, mapped twice")
    for refusal in solved.refusals:
        note(f"switched off {refusal}")


def _print_nodes(graph: SGraph) -> None:
    from rich import box
    from rich.table import Table

    for concept, nodes in graph.concepts.items():
        table = Table(title=f"{graph.name or 'map'}: {len(nodes)} {concept}s", box=box.SIMPLE_HEAD)
        table.add_column("id", justify="right")
        table.add_column("name")
        table.add_column("members")
        table.add_column("centre [m]", justify="right")
        table.add_column("size", justify="right")
        table.add_column("confidence", justify="right")
        for node in nodes:
            shape = node.shape
            centre = "" if shape.centre is None else f"{shape.centre[0]:.2f}, {shape.centre[1]:.2f}"
            table.add_row(
                str(node.id),
                node.name or "",
                " ".join(map(str, node.members)),
                centre,
                _size(shape),
                "" if node.confidence is None else f"{node.confidence:.2f}",
            )
        print_table(table)


def _size(shape: NodeShape) -> str:
    if shape.thickness is not None:
        return f"{shape.thickness:.3f} m thick"
    area, open_m = shape.attributes.get("area_m2"), shape.attributes.get("open_m")
    size = f"{area:.1f} m²" if isinstance(area, float) else ""
    return f"{size}, {open_m:.1f} m open" if isinstance(open_m, float) and open_m > 0 else size
