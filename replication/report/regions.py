"""A small picture for a cell: the region it is judged by, the printed number and ours."""

import math

from markupsafe import Markup

from replication.report.cells import Cell, Judgement, number

WIDTH, HEIGHT = 240, 30


def span(cell: Cell, judgement: Judgement) -> tuple[float, float]:
    """The range to draw: it holds the region, the printed number and ours, with a margin."""
    bounded = [edge for edge in (judgement.low, judgement.high) if math.isfinite(edge)]
    points = [cell.value, *bounded]
    if math.isfinite(judgement.ours):
        points.append(judgement.ours)
    low, high = min(points), max(points)
    margin = 0.08 * (high - low) or abs(high) or 1.0
    return low - margin, high + margin


def picture(cell: Cell, judgement: Judgement) -> Markup:
    """Draw the region as a bar, the printed number as a line across it and ours as a dot."""
    low, high = span(cell, judgement)

    def at(value: float) -> float:
        return round(WIDTH * (min(max(value, low), high) - low) / (high - low), 1)

    start, end = at(judgement.low), at(judgement.high)
    words = f"printed {number(cell.value)}, region {region(judgement)}"
    shapes = [
        f'<path d="M0 15H{WIDTH}" class="axis"/>',
        f'<rect x="{start}" y="8" width="{max(end - start, 1.5):.1f}" height="14" class="region"/>',
        f'<path d="M{at(cell.value)} 3V27" class="printed"/>',
    ]
    if math.isfinite(judgement.ours):
        words += f", ours {number(judgement.ours)}"
        shapes.append(f'<circle cx="{at(judgement.ours)}" cy="15" r="5" class="ours"/>')
    return Markup(
        f'<svg class="picture" role="img" aria-label="{words}" viewBox="-6 0 {WIDTH + 12} {HEIGHT}" '
        f'width="{WIDTH + 12}" height="{HEIGHT}">{"".join(shapes)}</svg>'
    )


def region(judgement: Judgement) -> str:
    """The region in words; nothing where there is none."""
    if math.isnan(judgement.low):
        return ""
    if math.isinf(judgement.high):
        return f"{number(judgement.low)} or more"
    return f"{number(judgement.low)} to {number(judgement.high)}"
