"""The paper's tables and figures, beside our results."""

PAIRS = ["1-2", "1-3", "1-4", "1-5", "1-6"]
SETS = ["leuven", "bikes"]
TITLE = {"leuven": "Leuven", "bikes": "Bikes"}
MODELS = ["KT", "KTG", "KTGP"]
METHODS = ["ORB"] + MODELS

# Tables 1 and 3: number of matches (NM).
NM = {
    "leuven": {"KT": [833, 634, 514, 421, 359], "KTG": [791, 550, 406, 352, 315],
               "KTGP": [785, 546, 405, 352, 309]},
    "bikes": {"KT": [1019, 843, 525, 372, 257], "KTG": [934, 768, 459, 338, 206],
              "KTGP": [928, 767, 456, 330, 198]},
}
# Tables 4, 5 and 6: "ME" and "RMSE", which the paper gives in pixels but which are Hamming distances.
DISTANCE = {
    "leuven": {"KT": (23.85192, 25.37288), "KTG": (23.83598, 25.35014),
               "KTGP": (23.73106, 25.23356), "ORB": (33.90576, 37.02068)},
    "bikes": {"KT": (24.11962, 25.68636), "KTG": (24.08338, 25.64750),
              "KTGP": (23.99844, 25.56006), "ORB": (34.1985, 36.83376)},
}
# Table 6 and Figure 12.
REP = {"leuven": {"ORB": 0.37, "KTGP": 0.67}, "bikes": {"ORB": 0.45, "KTGP": 0.87}}
HEADLINE = 29.92  # per cent less "error" than ORB


class Measured:
    """The rows of ktgp_evaluate by set, pair and method."""

    def __init__(self, results):
        # Of sets whose names differ in their case, the first counts, as in image_sets.
        self.rows = {(r["set"].lower(), r["pair"], r["method"]): r for r in reversed(results)}

    def has(self, method):
        """Whether all pairs of both sets were measured."""
        return all((name, pair, method) in self.rows for name in SETS for pair in PAIRS)

    def values(self, name, method, key):
        """The values of the pairs; pairs without matches have none and are left out."""
        values = [self.rows[(name, pair, method)][key] for pair in PAIRS]
        return [v for v in values if v is not None]

    def mean(self, name, method, key):
        values = self.values(name, method, key)
        return sum(values) / len(values)


def change(ours, paper):
    return f"{100 * (ours / paper - 1):+.1f} %"


def table_1(measured):
    """Table 1: the number of matches (NM) of KTGP."""
    rows = []
    for i, pair in enumerate(PAIRS):
        row = [pair]
        for name in SETS:
            paper, ours = NM[name]["KTGP"][i], measured.values(name, "KTGP", "matches")[i]
            row += [paper, ours, change(ours, paper)]
        rows.append(row)
    return ["pair"] + [f"{TITLE[s]} {c}" for s in SETS for c in ("paper", "ours", "difference")], rows


def table_3(measured, name):
    """Table 3: the number of matches (NM) of each stage."""
    header = ["pair"] + [f"{m} {c}" for m in MODELS for c in ("paper", "ours", "difference")]
    rows = []
    ours = {m: measured.values(name, m, "matches") for m in MODELS}
    for i, pair in enumerate(PAIRS):
        row = [pair]
        for m in MODELS:
            row += [NM[name][m][i], ours[m][i], change(ours[m][i], NM[name][m][i])]
        rows.append(row)
    mean = ["mean"]
    for m in MODELS:
        p, o = sum(NM[name][m]) / 5, sum(ours[m]) / 5
        mean += [f"{p:.1f}", f"{o:.1f}", change(o, p)]
    return header, rows + [mean]


def distance_table(measured, which):
    """Table 4 (which = 0, mean) or 5 (which = 1, RMS)."""
    key = ("descriptor_distance_mean", "descriptor_distance_rms")[which]
    header = ["model"] + [f"{TITLE[s]} {c}" for s in SETS for c in ("paper", "ours", "difference")]
    rows = []
    for m in MODELS:
        row = [m]
        for name in SETS:
            paper, ours = DISTANCE[name][m][which], measured.mean(name, m, key)
            row += [f"{paper:.3f}", f"{ours:.3f}", change(ours, paper)]
        rows.append(row)
    return header, rows


def table_6(measured):
    """Table 6: ORB compared with KTGP."""
    header = ["metric", "set", "ORB paper", "ORB ours", "KTGP paper", "KTGP ours"]
    rows = []
    for name in SETS:
        eq9 = {m: measured.mean(name, m, "rep_eq9") for m in ("ORB", "KTGP")}
        rows.append(["REP (Eq. 9)", TITLE[name], REP[name]["ORB"], f"{eq9['ORB']:.2f}",
                     REP[name]["KTGP"], f"{eq9['KTGP']:.2f}"])
        for which, label, key in ((0, "mean distance (“ME”)", "descriptor_distance_mean"),
                                  (1, "RMS distance (“RMSE”)", "descriptor_distance_rms")):
            row = [label, TITLE[name]]
            for m in ("ORB", "KTGP"):
                row += [f"{DISTANCE[name][m][which]:.3f}", f"{measured.mean(name, m, key):.3f}"]
            rows.append(row)
    return header, rows


def headline(measured):
    """Mean drop of the mean distance from ORB to KTGP, per cent."""
    key = "descriptor_distance_mean"
    drops = [1 - measured.mean(s, "KTGP", key) / measured.mean(s, "ORB", key) for s in SETS]
    return 100 * sum(drops) / len(drops)
