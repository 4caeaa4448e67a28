"""`sgraph concepts`: which concepts are installed, and how they are declared."""

from __future__ import annotations

from typing import Annotated

import typer

from sgraph_cli.console import print_table, warn_about_plugins

__all__ = ["app"]

app = typer.Typer(help="Show the installed concepts.", no_args_is_help=True)


@app.command("list")
def list_concepts() -> None:
    """List the installed concepts, each after what it groups."""
    from rich import box
    from rich.table import Table

    from sgraph_core.concepts import installed

    registry = installed()
    table = Table(box=box.SIMPLE_HEAD)
    for column in ("concept", "groups", "relation", "distribution", "description"):
        table.add_column(column)
    for concept in registry:
        spec = concept.spec
        source = f"{concept.distribution} {concept.version}".strip()
        table.add_row(spec.name, spec.groups, spec.relation, source, spec.description)
    print_table(table)
    warn_about_plugins(list(registry.problems))


@app.command("show")
def show_concept(
    name: Annotated[str, typer.Argument(metavar="CONCEPT", help="Name of a concept.")],
) -> None:
    """Print the declaration of one concept as JSON."""
    from sgraph_core.concepts import installed

    registry = installed()
    typer.echo(registry[name].spec.model_dump_json(indent=1))
    warn_about_plugins(list(registry.problems))
