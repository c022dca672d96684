"""The figure of readouts that follow: accuracy against the number of images measured, while the bench drifts."""

from collections.abc import Mapping, Sequence

from matplotlib.figure import Figure

from labctl.reports.canvas import Series, draw_series, legend_below, styled


@styled
def following_figure(drifts: Mapping[str, Sequence[Series]], *, chance: float) -> Figure:
    """A panel for each drift, two beside each other, all with the same axes and curves.

    Args:
        drifts: Title of each panel -> its curves: x = images measured; mean and sd of the accuracy of the images up to
            there since the point before, 0..1.
        chance: Accuracy of guessing, 0..1; the axes start there.
    """
    columns = min(2, len(drifts))
    rows = -(-len(drifts) // columns)
    figure = Figure(figsize=(6.4, 0.6 + 2.3 * rows))
    panels = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    for axes, (title, curves) in zip(panels.flat, drifts.items(), strict=False):
        draw_series(axes, [one.scaled(1, 100) for one in curves], highest=100)
        axes.set_title(title, loc="left", fontsize=9)
        axes.grid(visible=True, axis="y")
    for axes in panels.flat[len(drifts) :]:
        axes.set_visible(False)
    panels[0, 0].set_ylim(100 * chance, 101)
    for axes in panels[-1]:
        axes.set_xlabel("number of images")
    for axes in panels[:, 0]:
        axes.set_ylabel("accuracy (%), mean ± sd")
    legend_below(figure, *panels[0, 0].get_legend_handles_labels())
    return figure
