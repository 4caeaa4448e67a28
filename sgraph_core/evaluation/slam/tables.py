"""The paper's tables, and the paired comparison, from results."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sgraph_core.evaluation.scores import Counts
from sgraph_core.evaluation.slam.results import Result
from sgraph_core.evaluation.slam.statistics import Paired, compare, spread
from sgraph_core.evaluation.slam.variants import BASELINE, VARIANTS
from sgraph_core.files import write_whole

__all__ = ["PAPER", "Table", "paired", "tables", "write_json"]

PAPER: Mapping[str, Mapping[str, str]] = {
    "ate_m": {"free space": "3.09", "paper, rooms": "2.93", "paper, rooms + walls": "2.88"},
    "map_m": {"free space": "22.35", "paper, rooms": "22.28", "paper, rooms + walls": "21.95"},
    "walls": {"paper, rooms + walls": "1.00 / 0.80"},
    "rooms": {"paper, rooms": "over 0.80 / -"},
    "update_ms": {"free space": "77.8", "paper, rooms": "12.2"},
}
"""The paper's own means, on its own scenes and machine: ATE and times of its simulated scenes, maps
and walls of all. Its precision of rooms exceeds .80 in all scenes but one; it prints no numbers."""


@dataclass(frozen=True)
class Table:
    """Text to print.

    Attributes:
        title: what it shows, with units.
        columns: titles; the first is that of the rows' names.
        rows: cells, as many as columns.
    """

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True)
class _Quantity:
    """What one table shows.

    Attributes:
        key: field of a result.
        place: of the table in the paper.
        title: of the table.
        scale: from the field's unit to the table's.
        digits: after the point.
    """

    key: str
    place: str
    title: str
    scale: float = 1.0
    digits: int = 1


QUANTITIES = (
    _Quantity("ate_m", "Table II", "ATE RMSE [cm]", 100.0, 2),
    _Quantity("map_m", "Table III", "map matching accuracy, RMSE [cm]", 100.0, 2),
    _Quantity("walls", "Table IV", "precision / recall of walls"),
    _Quantity("rooms", "Figure 4", "precision / recall of rooms"),
    _Quantity("first_room_s", "Table V", "time to the first room [s of the drive]"),
    _Quantity("update_ms", "Table V", "detection time per update [ms]"),
)


def tables(results: Sequence[Result], paper: bool) -> list[Table]:
    """Return the tables of a study.

    A cell is mean and standard deviation over the seeds, or precision and recall pooled over them;
    the last row is the mean over the drives, or pooled.

    Args:
        results: of the methods on the same drives and seeds.
        paper: name the paper's tables, and add its own figures below.
    """
    found = [_table(results, quantity, paper) for quantity in QUANTITIES]
    return [_paired_table(results), *(table for table in found if len(table.columns) > 1)]


def paired(results: Sequence[Result]) -> dict[tuple[str, str], Paired]:
    """Return how the ATE of every method compares with planes only, by drive and method."""
    ate = {(r.drive, r.variant, r.seed): r.ate_m for r in results}
    comparisons = {}
    for drive, variant in dict.fromkeys((r.drive, r.variant) for r in results):
        seeds = [r.seed for r in results if (r.drive, r.variant) == (drive, variant)]
        if variant != BASELINE and all((drive, BASELINE, seed) in ate for seed in seeds):
            own = [ate[drive, variant, seed] for seed in seeds]
            comparisons[drive, variant] = compare(own, [ate[drive, BASELINE, s] for s in seeds])
    return comparisons


def write_json(results: Sequence[Result], settings: Mapping[str, Any], path: Path) -> None:
    """Write settings, all results, how they compare with planes only, and the paper's figures."""
    comparisons = [
        {"drive": drive, "variant": variant, **asdict(comparison)}
        for (drive, variant), comparison in paired(results).items()
    ]
    record = {
        "settings": settings,
        "results": [result.model_dump() for result in results],
        "ate_to_planes_only": comparisons,
        "the_papers_own": PAPER,
    }
    text = json.dumps(record, indent=1) + "\n"
    write_whole(path, lambda temporary: temporary.write_text(text))


def _table(results: Sequence[Result], quantity: _Quantity, paper: bool) -> Table:
    own = PAPER.get(quantity.key, {}) if paper else {}
    known = {r.variant for r in results if getattr(r, quantity.key) is not None}
    variants = [name for name in VARIANTS if name in known or (known and name in own)]
    drives = list(dict.fromkeys(r.drive for r in results))

    def cells(cell: Callable[[list[Result]], str], drive: str | None = None) -> tuple[str, ...]:
        chosen = [r for r in results if drive in {None, r.drive}]
        return tuple(cell([r for r in chosen if r.variant == name]) for name in variants)

    rows = [(drive, *cells(lambda rs: _cell(rs, quantity), drive)) for drive in drives]
    if len(drives) > 1:
        rows.append(("mean", *cells(lambda rs: _mean_cell(rs, quantity))))
    if known and own:
        rows.append(("the paper's own", *(own.get(name, "") for name in variants)))
    title = f"{quantity.place}: {quantity.title}" if paper else quantity.title
    return Table(title, ("drive", *variants), tuple(rows))


def _cell(results: Sequence[Result], quantity: _Quantity) -> str:
    values = [value for r in results if (value := getattr(r, quantity.key)) is not None]
    if not values:
        return ""
    if isinstance(values[0], Counts):
        return _precision_recall(values)
    over = spread([quantity.scale * value for value in values])
    text = f"{over.mean:.{quantity.digits}f}"
    if len(values) > 1:
        text += f" ± {over.deviation:.{quantity.digits}f}"
    return text if len(values) == len(results) else f"{text} ({len(values)} of {len(results)})"


def _mean_cell(results: Sequence[Result], quantity: _Quantity) -> str:
    """Return the mean of the drives' means, or all counts pooled."""
    by_drive: dict[str, list[float]] = {}
    counts = []
    for result in results:
        value = getattr(result, quantity.key)
        if isinstance(value, Counts):
            counts.append(value)
        elif value is not None:
            by_drive.setdefault(result.drive, []).append(quantity.scale * value)
    if counts:
        return _precision_recall(counts)
    if not by_drive:
        return ""
    return f"{np.mean([np.mean(values) for values in by_drive.values()]):.{quantity.digits}f}"


def _precision_recall(counts: Sequence[Counts]) -> str:
    pooled = sum(counts, Counts())
    return f"{pooled.precision:.2f} / {pooled.recall:.2f}"


def _paired_table(results: Sequence[Result]) -> Table:
    comparisons = paired(results)
    variants = [name for name in VARIANTS if any(name == variant for _, variant in comparisons)]
    drives = list(dict.fromkeys(drive for drive, _ in comparisons))
    rows = [
        (drive, *(_ratio_cell(comparisons.get((drive, name))) for name in variants))
        for drive in drives
    ]
    if len(drives) > 1:
        rows.append(("mean", *(_mean_ratio_cell(comparisons, name) for name in variants)))
    title = f"median ratio of the ATE to {BASELINE}, and drives won / lost by more than 2 %"
    return Table(title, ("drive", *variants), tuple(rows))


def _ratio_cell(comparison: Paired | None) -> str:
    if comparison is None:
        return ""
    return f"{comparison.median_ratio:.2f} ({comparison.wins} / {comparison.losses})"


def _mean_ratio_cell(comparisons: Mapping[tuple[str, str], Paired], variant: str) -> str:
    """Return the mean of the drives' medians, and the share of all drives won and lost."""
    own = [one for (_, name), one in comparisons.items() if name == variant]
    pairs = sum(one.pairs for one in own)
    won, lost = (sum(getattr(one, side) for one in own) / pairs for side in ("wins", "losses"))
    return f"{np.mean([one.median_ratio for one in own]):.2f} ({won:.0%} / {lost:.0%})"
