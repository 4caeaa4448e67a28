"""Where things are printed: results to stdout, everything else to stderr."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

__all__ = [
    "ProgressReport",
    "note",
    "print_markdown",
    "print_table",
    "progress",
    "warn_about_plugins",
    "warnings_as_notes",
]

WIDEST = 300


class ProgressReport(Protocol):
    """Told what is being done, how much of it is done, and how much there is."""

    def __call__(self, what: str, done: int, total: int, /) -> None:
        """Show it."""
        ...


def print_table(table: Table) -> None:
    """Print a rich table to stdout; piped, it is as wide as it needs to be."""
    _stdout().print(table)


def print_markdown(
    columns: Iterable[str], rows: Iterable[Iterable[str]], *, named: bool = False
) -> None:
    """Print a table of numbers in Markdown; its first column may hold the names of the rows."""
    from rich import box
    from rich.table import Table

    table = Table(box=box.MARKDOWN)
    for number, column in enumerate(columns):
        table.add_column(column, justify="left" if named and number == 0 else "right")
    for row in rows:
        table.add_row(*row)
    print_table(table)


def _stdout() -> Console:
    from rich.console import Console

    console = Console(highlight=False, markup=False)  # "[m]" is a unit, not markup
    if not console.is_terminal:
        console.width = WIDEST
    return console


def note(message: str) -> None:
    """Print a line to stderr."""
    print(message, file=sys.stderr)


def warn_about_plugins(problems: list[object]) -> None:
    """Say on stderr which plugins are left out, and why."""
    for problem in problems:
        note(f"sgraph: warning: {problem}")


@contextmanager
def warnings_as_notes() -> Iterator[None]:
    """Say on stderr what Python warns of; nothing if an error comes out."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", UserWarning)
        yield
    for warning in caught:
        note("sgraph: warning: " + " ".join(str(warning.message).split()))


@contextmanager
def progress() -> Iterator[ProgressReport]:
    """Show a progress bar on stderr, once there is progress, if it is a terminal."""
    if not sys.stderr.isatty():
        yield lambda _what, _done, _total: None
        return
    from rich.console import Console
    from rich.progress import Progress, TaskID, TimeRemainingColumn

    tasks: dict[str, TaskID] = {}
    bar = Progress(
        *Progress.get_default_columns()[:-1],
        TimeRemainingColumn(elapsed_when_finished=True),
        console=Console(stderr=True),
    )

    def report(what: str, done: int, total: int, /) -> None:
        if what not in tasks:
            bar.start()
            tasks[what] = bar.add_task(what, total=total)
        bar.update(tasks[what], completed=done)

    try:
        yield report
    finally:
        bar.stop()
