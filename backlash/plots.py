"""Plots of the virtual sensor's answers: arrays in, a matplotlib figure out."""

from io import BytesIO
from pathlib import Path
from textwrap import fill

import matplotlib as mpl
from matplotlib import pyplot as plt
from matplotlib.figure import Figure

from backlash.answer import Estimate
from backlash.refusals import one_line
from replication.figures import STYLE, in_style
from replication.files import write_bytes

_SHOWN_TURNS = 3
_TITLE_LETTERS = 70  # in a line
# Dates would make each file another.
_UNDATED: dict[str, dict[str, None]] = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}


def save_figure(figure: Figure, path: Path) -> None:
    """Write a figure whole or not at all, the same bytes each time; it is closed."""
    content, ending = BytesIO(), path.suffix.lower()
    with mpl.rc_context(STYLE):
        figure.savefig(content, format=ending[1:], metadata=_UNDATED.get(ending))
    plt.close(figure)
    write_bytes(path, content.getvalue())


@in_style
def estimate_figure(answer: Estimate) -> Figure:
    """Show three turns in the middle of a log as measured and by the model, and what the model leaves of the whole log.

    By the torque that is the torque, else the motor's speed.
    """
    trace = answer.trace
    if trace is None:
        raise ValueError(f"{answer.file}: there is no fit to show")
    figure, (above, below) = plt.subplots(2, figsize=(5.3, 4.4), height_ratios=(3, 2))
    t = trace.t - trace.t[0]
    middle = t[-1] / 2
    half = min(_SHOWN_TURNS * (answer.turn_period_s or t[-1]), t[-1]) / 2
    above.plot(t, trace.model, color="C0", linewidth=2.2, label="model")
    above.plot(t, trace.measured, color="0.2", linewidth=0.6, label="measured")
    title = fill(f"(a) {one_line(answer.summary)}", _TITLE_LETTERS)
    above.set(xlim=(middle - half, middle + half), title=title)
    above.set(xlabel="time [s]", ylabel=trace.signal)
    below.plot(t, trace.measured - trace.model, color="C1", linewidth=0.7)
    below.set(xlim=(0, t[-1]), title="(b) what the model leaves")
    below.set(xlabel="time [s]", ylabel=f"residual {trace.signal[trace.signal.find('[') :]}")
    figure.legend(loc="outside lower center", ncols=2)
    return figure
