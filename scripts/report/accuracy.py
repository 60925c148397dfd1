"""Accuracy of the homographies, as a table and as plots over the time that they take."""
import plots

HEADER = ["method", "AUC 1 px %", "AUC 3 px %", "AUC 5 px %", "AUC 10 px %", "median px", "found %",
          "wrong %", "ZNCC", "ms"]

EXPLANATION = (
    "AUC: area under the curve of the mean corner error of the homography up to 1, 3, 5, 10 px, "
    "by the trapezoid rule. "
    "Median: of the corner error, over all pairs. Found: pairs with a homography that the method "
    "calls good. Wrong: those of them that are more than 20 px off. ZNCC: correlation of the two "
    "images laid over each other, mean of the pairs found; it needs no ground truth. ms: the whole "
    "pair from the images to the homography, one thread. Only methods that estimate a homography. "
    "SIFT, AKAZE, FLOW and ECC are OpenCV's; they have no verdict and call good whatever comes out.")


def number(value, digits=1, scale=1.0):
    """A number as text, or a dash if there is none."""
    return "–" if value is None else f"{scale * value:.{digits}f}"


def _row(summary):
    return ([summary["method"]]
            + [number(summary[f"auc_{k}"], 1, 100) for k in (1, 3, 5, 10)]
            + [number(summary["median_corner_error"], 3), number(summary["found"], 1, 100),
               number(summary["wrong"], 1, 100), number(summary["zncc"], 4),
               number(summary["total_ms"])])


def add_accuracy(document, measured, title, slug, threshold):
    """For each set, a table and a plot of the AUC up to `threshold` px over the time of a pair."""
    rated = [s for s in measured["summary"] if "auc_1" in s]
    names = list(dict.fromkeys(s["set"] for s in rated))
    for name in names:
        rows = [s for s in rated if s["set"] == name]
        document.table(f"{title}, {name}: {rows[0]['pairs']} pairs", HEADER, [_row(s) for s in rows])
    for name in names:
        points = {s["method"]: (s["total_ms"], 100 * s[f"auc_{threshold}"])
                  for s in rated if s["set"] == name}
        document.picture(f"accuracy_{slug}_{name}.svg",
                         f"Accuracy over the time of a whole pair: {title}, {name}",
                         plots.trade_off(points, "ms per pair, one thread",
                                         f"AUC at {threshold} px, %"), half=True)
