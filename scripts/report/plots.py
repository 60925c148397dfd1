"""The plots of the report, as SVG."""
import io

import matplotlib

matplotlib.use("svg")
# pylint: disable=wrong-import-position
import matplotlib.pyplot as plt  # noqa: E402

plt.rcParams.update({"svg.hashsalt": "ktgp_orb", "axes.grid": True, "grid.alpha": 0.3,
                     "axes.spines.top": False, "axes.spines.right": False, "font.size": 9,
                     "legend.frameon": False})


def _svg(figure):
    out = io.BytesIO()
    figure.tight_layout()
    figure.savefig(out, format="svg", metadata={"Date": None})
    plt.close(figure)
    return out.getvalue()


def lines(x, series, x_label, y_label, marks=(), size=(5.6, 3.0)):
    """A plot of lines. `series`: name -> values. `marks`: x positions of dashed vertical lines with a label."""
    figure, axes = plt.subplots(figsize=size)
    for name, values in series.items():
        axes.plot(x, values, marker="o" if len(x) < 30 else None, markersize=3, linewidth=1.2,
                  label=name)
    for position, label in marks:
        axes.axvline(position, color="black", linestyle="--", linewidth=0.8, label=label)
    axes.set_xlabel(x_label)
    axes.set_ylabel(y_label)
    axes.set_ylim(bottom=0)
    if len(series) > 1 or marks:
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    return _svg(figure)


def bars(groups, series, y_label, size=(5.2, 3.2)):
    """A bar chart. `series`: name -> one value for each group, or None."""
    figure, axes = plt.subplots(figsize=size)
    width = 0.8 / len(series)
    for i, (name, values) in enumerate(series.items()):
        places = [g + (i - (len(series) - 1) / 2) * width for g in range(len(groups))]
        drawn = axes.bar(places, [v or 0 for v in values], width * 0.9, label=name)
        labels = ["" if v is None else f"{v:.2f}" for v in values]
        for bar, label in zip(drawn, labels):
            axes.annotate(label, (bar.get_x() + bar.get_width() / 2, bar.get_height()),
                          ha="center", va="bottom", fontsize=7)
    axes.set_xticks(range(len(groups)), groups)
    axes.set_ylabel(y_label)
    axes.grid(axis="x", visible=False)
    axes.legend()
    return _svg(figure)


OURS = ("KTGP", "KTGP+ALIGN", "ROBUST", "ROBUST-TEBLID")  # drawn in another colour


def _write_names(axes, points):
    """Writes each name to the right of its point, or above existing names; ours first."""
    height, width = 7.0, 4.4  # size of a letter, in points
    scale = 72.0 / axes.figure.dpi
    written = []  # left, right and bottom
    for name, point in sorted(points.items(), key=lambda p: (p[0] not in OURS, p[1][1])):
        x, y = axes.transData.transform(point) * scale
        left, right, bottom = x + 4, x + 4 + width * len(name), y - 2
        for other_left, other_right, other_bottom in sorted(written, key=lambda w: w[2]):
            if left < other_right and other_left < right and abs(bottom - other_bottom) < height:
                bottom = other_bottom + height
        written.append((left, right, bottom))
        axes.annotate(name, point, xytext=(4, bottom - y), textcoords="offset points", fontsize=7)


def trade_off(points, x_label, y_label, size=(6.4, 4.0)):
    """A plot of points with their names. `points`: name -> (x, y). The x axis is logarithmic."""
    figure, axes = plt.subplots(figsize=size)
    for name, (x, y) in points.items():
        final = name in OURS
        axes.plot(x, y, "o", markersize=5, color="tab:red" if final else "tab:blue")
    axes.set_xscale("log")
    axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.xaxis.set_minor_formatter(  # more labels would overlap
        lambda value, _: f"{value:g}" if f"{value:e}"[0] in "25" else "")
    _write_names(axes, points)
    axes.set_xlabel(x_label)
    axes.set_ylabel(y_label)
    return _svg(figure)
