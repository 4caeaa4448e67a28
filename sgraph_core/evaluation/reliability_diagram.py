"""The reliability diagram: how often what was given a probability came true."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from sgraph_core.evaluation.calibration import UNDECIDED, Reliability
from sgraph_core.evaluation.report import SourceReport
from sgraph_core.plotting import check_name, new_figure, write_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["draw_reliability"]

PANEL_INCH = 4.0
SMALLEST_DOT, LARGEST_DOT = 8.0, 120.0
"""Areas of the dots, in square points."""


def draw_reliability(reports: Sequence[SourceReport], path: Path) -> None:
    """Draw how reliable nodes (left) and undecided edges (right) are, a row for every source.

    The area of a dot grows with the number of probabilities in its bin.

    Raises:
        InputError: the file's suffix is no picture's.
        OSError: the file cannot be written.
    """
    check_name(path)
    figure = new_figure(2 * PANEL_INCH, PANEL_INCH * len(reports))
    panels = figure.subplots(len(reports), 2, squeeze=False)
    low, high = UNDECIDED
    for report, (nodes, edges) in zip(reports, panels, strict=True):
        pooled = report.calibration
        _draw(nodes, pooled.nodes)
        nodes.set(title=f"{report.source}: nodes", xlabel="confidence", ylabel="share right")
        _draw(edges, pooled.undecided)
        edges.set(
            title=f"edges between {low} and {high}",
            xlabel="probability",
            ylabel="share related",
        )
    write_figure(figure, path)


def _draw(axes: Axes, reliabilities: Mapping[str, Reliability]) -> None:
    axes.plot([0, 1], [0, 1], color="0.7", lw=1)
    for number, (concept, reliability) in enumerate(sorted(reliabilities.items())):
        filled = reliability.count > 0
        count = reliability.count[filled]
        if not len(count):
            continue
        expected = reliability.expected[filled] / count
        came_true = reliability.came_true[filled] / count
        area = SMALLEST_DOT + (LARGEST_DOT - SMALLEST_DOT) * count / count.max()
        colour = f"C{number}"
        axes.scatter(expected, came_true, area, color=colour)
        label = f"{concept}: ECE {reliability.error:.3f}, {count.sum()}"
        axes.plot(expected, came_true, color=colour, label=label)
    axes.set(xlim=(0, 1), ylim=(0, 1.02), aspect="equal")
    if len(axes.get_legend_handles_labels()[0]):
        axes.legend(loc="best")
