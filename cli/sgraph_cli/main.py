"""The `sgraph` command: its subcommands, and how errors end it."""

from __future__ import annotations

import signal
import sys

import typer

from sgraph_cli.commands import (
    ablate,
    bench,
    calibrate,
    concepts,
    evaluate,
    infer,
    maps,
    plot,
    sweep,
    train,
)

__all__ = ["app", "main"]

app = typer.Typer(
    name="sgraph",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # plain help: drawing boxes would double its time
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        typer.echo(f"sgraph-concepts {version('sgraph-concepts')}")
        raise typer.Exit


@app.callback()
def _sgraph(
    version: bool = typer.Option(
        False, "--version", callback=_version, is_eager=True, help="Print the version and exit."
    ),
) -> None:
    """Infer rooms, walls and further concepts from the wall surfaces of a SLAM map."""


app.command("infer")(infer.infer)
app.command("evaluate")(evaluate.evaluate)
app.command("calibrate")(calibrate.calibrate)
app.command("plot")(plot.plot)
app.command("schema")(maps.schema)
app.command("sweep")(sweep.sweep)
app.command("synth")(maps.synth)
app.command("train")(train.train)
app.command("ablate")(ablate.ablate)
app.add_typer(bench.app, name="bench")
app.add_typer(concepts.app, name="concepts")


def main() -> None:
    """Run the command line; known errors become one line on stderr and exit code 1."""
    # as by Ctrl-C: worker processes end after what they are at, instead of going on without us
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        app()
    except OSError as error:
        _fail(f"{error.filename or 'i/o'}: {error.strerror or error}")
    except Exception as error:
        from sgraph_concepts.errors import SGraphError  # only now, or --help would pay for it

        if not isinstance(error, SGraphError):
            raise
        _fail(str(error))


def _fail(message: str) -> None:
    print("sgraph: " + " ".join(message.split()), file=sys.stderr)
    sys.exit(1)
