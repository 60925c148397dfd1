#!/usr/bin/python3
"""Measures every method on the given data and writes report/index.html and report/report.md."""
import argparse
import io
import json
import pathlib
import subprocess
import sys
import tempfile

from PIL import Image

import paper
import plots
from accuracy import EXPLANATION, add_accuracy, number
from document import Document
from sequence import add_sequence

RATIOS = [round(0.1 * i, 1) for i in range(1, 10)]
GMS_FACTORS = list(range(1, 10))
ENDINGS = [".ppm", ".pgm", ".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp"]
PICTURE_WIDTH = 1400  # px


class Tools:
    """Runs the command-line programs and collects their error messages."""

    def __init__(self, folder):
        self.folder = pathlib.Path(folder)
        self.problems = []

    def run(self, tool, *arguments, accepted=(0, 1)):
        command = [str(self.folder / tool), *map(str, arguments)]
        done = subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
                              text=True, check=False)
        if done.returncode not in accepted:
            sys.exit(f"{' '.join(command)} ended with {done.returncode}:\n{done.stderr}")
        return done

    def evaluate(self, *arguments, tool="ktgp_evaluate"):
        """The JSON of ktgp_evaluate or ktgp_evaluate_bag."""
        with tempfile.TemporaryDirectory() as folder:
            out = pathlib.Path(folder) / "out.json"
            self.run(tool, *arguments, "--json", out)
            return json.loads(out.read_text())

    def picture(self, kind, reference, target):
        """A picture written by ktgp_match, as JPEG."""
        with tempfile.TemporaryDirectory() as folder:
            out = pathlib.Path(folder) / "out.png"
            self.run("ktgp_match", reference, target, "--preset", "ktgp", kind, out)
            with Image.open(out) as image:
                height = round(image.height * PICTURE_WIDTH / image.width)
                jpeg = io.BytesIO()
                image.resize((PICTURE_WIDTH, height), Image.LANCZOS).save(jpeg, "JPEG", quality=82)
                return jpeg.getvalue()


def progress(text):
    if sys.stderr.isatty():
        print(f"\r\033[K{text}", end="", file=sys.stderr, flush=True)


def add_paper_tables(document, measured):
    document.heading("The paper's tables")
    document.text(
        "Paper: the printed value. Ours: measured now, with 2000 ORB features, T_w 0.66, T_G 6 and "
        "a PROSAC threshold of 3 px. The paper does not say which detector settings and which "
        "version of OpenCV it used, so the counts cannot be equal; they should be close.")
    document.table("Table 1. Final matches (KTGP)", *paper.table_1(measured))
    for name in paper.SETS:
        document.table(f"Table 3. Matches after each stage, {paper.TITLE[name]}",
                       *paper.table_3(measured, name))
    document.text("The paper prints 525.8 as the mean of KTGP on Bikes; its own five values give "
                  "535.8.")
    document.table("Table 4. Mean descriptor distance (printed there as “ME (pixels)”)",
                   *paper.distance_table(measured, 0))
    document.table("Table 5. RMS descriptor distance (printed there as “RMSE (pixels)”)",
                   *paper.distance_table(measured, 1))
    document.table("Table 6. ORB with cross-check against KTGP", *paper.table_6(measured))
    document.text(f"The paper's headline, {paper.HEADLINE} % less error than ORB, is the drop of "
                  "the mean descriptor distance, averaged over both sets; here it is "
                  f"{paper.headline(measured):.1f} %.")
    document.heading("What cannot be reproduced, and why", 3)
    displacement = {s: measured.mean(s, "KTGP", "displacement_mean") for s in paper.SETS}
    document.items([
        "“ME” and “RMSE” as pixels (Eq. 10, 11): taken literally they measure how far the image "
        f"moved, which is {displacement['leuven']:.1f} px on Leuven and "
        f"{displacement['bikes']:.1f} px on Bikes, not 24 on both. The printed values are Hamming "
        "distances of the descriptors, and as such they come out above.",
        "REP (Eq. 9) as printed (0.67 and 0.87 for KTGP, 0.37 and 0.45 for ORB): matched over "
        "detected keypoints gives the values of Table 6 above, and no other reading that was tried "
        "gives the printed ones. Detector repeatability in the usual sense is in the tables below.",
        "Times: the paper gives none.",
    ])


def sweep(tools, folders, option, values, methods):
    """The results for each value of one threshold."""
    runs = []
    for value in values:
        progress(f"{option} {value}")
        found = tools.evaluate(*folders, "--methods", ",".join(methods), option, value)
        runs.append(paper.Measured(found["results"]))
    return runs


def add_paper_figures(document, tools, folders):
    document.heading("The paper's figures")
    ratios = sweep(tools, folders, "--T_w", RATIOS, ["KT"])
    for number, name in ((6, "leuven"), (7, "bikes")):
        series = {}
        for i, pair in enumerate(paper.PAIRS):
            series[pair] = [100 * run.values(name, "KT", "retention")[i] for run in ratios]
        document.picture(f"figure_{number}.svg",
                         f"Figure {number}. Retention Q against T_w, {paper.TITLE[name]}",
                         plots.lines(RATIOS, series, "T_w", "Q, %", [(0.66, "chosen")]))
    factors = sweep(tools, folders, "--T_G", GMS_FACTORS, ["KTG", "KTGP"])
    for number, name in ((8, "leuven"), (9, "bikes")):
        series = {}
        for i, pair in enumerate(paper.PAIRS):
            series[pair] = [run.values(name, "KTG", "matches")[i] for run in factors]
        document.picture(f"figure_{number}.svg",
                         f"Figure {number}. Matches after GMS against T_G, {paper.TITLE[name]}",
                         plots.lines(GMS_FACTORS, series, "T_G", "NM", [(6, "chosen")]))
    series = {}
    for name in paper.SETS:
        series[paper.TITLE[name]] = [run.mean(name, "KTG", "matches") -
                                     run.mean(name, "KTGP", "matches") for run in factors]
    document.picture("figure_10.svg", "Figure 10. Matches that PROSAC still removes after GMS, "
                     "average over five pairs, against T_G",
                     plots.lines(GMS_FACTORS, series, "T_G", "NM(KTG) − NM(KTGP)",
                                 [(6, "chosen")]))


def add_figure_12(document, measured):
    models = ["ORB", "KT", "KTG", "KTGP"]
    series = {}
    for name in paper.SETS:
        series[f"{paper.TITLE[name]}, Eq. 9"] = [measured.mean(name, m, "rep_eq9") for m in models]
        series[f"{paper.TITLE[name]}, as printed"] = [paper.REP[name].get(m) for m in models]
    document.picture("figure_12.svg", "Figure 12. REP of each model; printed values are known for "
                     "ORB and KTGP only", plots.bars(models, series, "REP", (7.0, 3.2)))


def find_pair(folder, pair):
    """The files of the two images of pair "1-k" in an Oxford folder."""
    return [next(path for path in images_in(folder) if path.stem == f"img{k}") for k in pair.split("-")]


def add_match_pictures(document, tools, folders):
    document.heading("Matches", 3)
    for name in paper.SETS:
        reference, target = find_pair(folders[name], "1-2")
        document.picture(f"figure_4_{name}.jpg", f"Figure 4. The four stages, {paper.TITLE[name]} "
                         "1-2", tools.picture("--draw-stages", reference, target))
    for name in paper.SETS:
        for pair in paper.PAIRS:
            progress(f"picture {name} {pair}")
            document.picture(f"figure_5_{name}_{pair}.jpg",
                             f"Figure 5. Final matches, {paper.TITLE[name]} {pair}",
                             tools.picture("--draw-final", *find_pair(folders[name], pair)), half=True)


def add_method_tables(document, measured):
    document.heading("Every method on every set")
    document.text(
        "Averages over the pairs of a set. Matches: NM. Q: matches over target keypoints. P: share "
        "of matches within 1, 2, 3 px of the ground truth, 0 for a pair without matches. Correct: "
        "matches within 3 px. Distance: Hamming. Error: reprojection error against the ground "
        "truth, px. Motion: displacement in the image, px. "
        "ms: all stages, median of the repetitions, one thread, without feature extraction. The "
        "ground truth itself is good to about a pixel.")
    header = ["method", "matches", "Q %", "REP Eq. 9", "P 1 px %", "P 2 px %", "P 3 px %",
              "correct", "distance", "RMS", "error", "RMS", "motion", "ms"]
    sets = list(dict.fromkeys(s["set"] for s in measured["summary"]))
    for name in sets:
        rows = [s for s in measured["summary"] if s["set"] == name]
        table = []
        for s in rows:
            table.append([s["method"], number(s["matches"]), number(s["retention"], 1, 100),
                          number(s["rep_eq9"], 2)]
                         + [number(s[f"precision_{k}px"], 1, 100) for k in (1, 2, 3)]
                         + [number(s["correct_3px"])]
                         + [number(s[f"descriptor_distance_{k}"], 2) for k in ("mean", "rms")]
                         + [number(s[f"reprojection_error_{k}"], 2) for k in ("mean", "rms")]
                         + [number(s["displacement_mean"])]
                         + [number(s["ms"], 2)])
        first = rows[0]
        document.table(f"{name}: {first['pairs']} pairs, detector repeatability "
                       f"{first['detector_repeatability']:.2f}, features of a pair in "
                       f"{first['extraction_ms']:.1f} ms", header, table)
    document.heading("Accuracy over time")
    document.text(EXPLANATION)
    add_accuracy(document, measured, "Image pairs", "pairs", 3)


def add_warps(document, tools, arguments):
    """Exact warps of the data's own images."""
    folders = image_folders(arguments.data)
    if not folders or arguments.warp_pairs == 0:
        return
    progress("exact warps")
    measured = tools.evaluate(*folders, "--warps", "small,medium,large", "--warp-pairs",
                              arguments.warp_pairs, "--methods", arguments.methods)
    document.heading("Exact warps")
    document.text(
        "640×480 views rendered from the data's own images, so that the truth is exact; every "
        "second target has gain, gamma, blur and noise. Small: rotation up to 2°, zoom 1.04, tilt "
        "2°, shift 20 px. Medium: 25°, 1.4, 20°, 60 px. Large: 180°, 2.2, 40°, 80 px.")
    if measured["summary"]:
        add_accuracy(document, measured, "Exact warps", "warps", 1)


def images_in(folder):
    """The images that ktgp_evaluate finds in a folder; of those with the same name, the one that it uses is first."""
    images = [path for path in folder.glob("*") if path.suffix.lower() in ENDINGS]
    return sorted(images, key=lambda path: ENDINGS.index(path.suffix.lower()))


def image_sets(paths):
    """Name and folder of every image set that is one of `paths` or a folder directly in one of them."""
    folders = {}
    for path in map(pathlib.Path, paths):
        for folder in [path, *sorted(p for p in path.glob("*") if p.is_dir())]:
            if any(image.stem == "img1" for image in images_in(folder)):
                folders.setdefault(folder.resolve().name.lower(), folder)
    return folders


def image_folders(paths):
    """The folders with images that are one of `paths` or directly in one of them."""
    found = []
    for path in map(pathlib.Path, paths):
        for folder in [path, *sorted(p for p in path.glob("*") if p.is_dir())]:
            if images_in(folder):
                found.append(folder)
    return found


def parse_arguments():
    parser = argparse.ArgumentParser(
        prog="scripts/evaluate", description=__doc__,
        usage="%(prog)s [--built FOLDER] [--data DIR ...] [--bag FILE] [options]",
        formatter_class=argparse.ArgumentDefaultsHelpFormatter)
    # --tools comes from scripts/evaluate, which reads --built.
    parser.add_argument("--tools", default="", help=argparse.SUPPRESS)
    parser.add_argument("--built", default=argparse.SUPPRESS, metavar="FOLDER",
                        help="first of all: take the programs of this build, and build nothing")
    parser.add_argument("--data", action="append", default=[], metavar="DIR",
                        help="Oxford or HPatches folder, folder of those, or list; may be repeated")
    parser.add_argument("--bag", help="also evaluate this bag as a sequence")
    parser.add_argument("--topic", default="/camera/image_raw", help="image topic of the bag")
    parser.add_argument("--output", default="report", help="folder to write")
    parser.add_argument("--methods", default="all", help="methods of the comparison")
    parser.add_argument("--warp-pairs", type=int, default=48,
                        help="exact warps of each kind made from the data's images, 0 = none")
    parser.add_argument("--repeat", type=int, default=3, help="runs of each method, for the times")
    return parser.parse_args()


def make_output(folder):
    """Makes the folder before anything is measured, and ends with exit code 2 if nothing can be written there."""
    try:
        pathlib.Path(folder, "figures").mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        print(f"evaluate: --output {folder} cannot be written: {error.strerror}", file=sys.stderr)
        sys.exit(2)


def main():
    arguments = parse_arguments()
    make_output(arguments.output)
    tools = Tools(arguments.tools)
    document = Document("KTGP-ORB: how good is it?")
    problems = []
    if arguments.data:
        progress("all methods over all sets")
        measured = tools.evaluate(*arguments.data, "--methods", arguments.methods, "--repeat",
                                  arguments.repeat)
        problems += measured["problems"]
        by_pair = paper.Measured(measured["results"])
        folders = image_sets(arguments.data)
        missing = [method for method in paper.METHODS if not by_pair.has(method)]
        if not all(name in folders for name in paper.SETS):
            document.text("The paper's tables need the Leuven and Bikes sets, which are not among "
                          "the data; scripts/fetch_oxford downloads them.")
        elif missing:
            document.text("The paper's tables need the methods "
                          f"{', '.join(paper.METHODS)}; not measured: {', '.join(missing)}.")
        else:
            both = [folders[name] for name in paper.SETS]
            add_paper_tables(document, by_pair)
            add_paper_figures(document, tools, both)
            add_figure_12(document, by_pair)
            add_match_pictures(document, tools, folders)
        if measured["summary"]:
            add_method_tables(document, measured)
        add_warps(document, tools, arguments)
    if arguments.bag:
        progress(f"sequence {arguments.bag}")
        add_sequence(document, tools.evaluate(arguments.bag, "--topic", arguments.topic,
                                              tool="ktgp_evaluate_bag"))
    if problems:
        document.heading("Files that could not be used")
        document.items(problems)
    document.write(arguments.output)
    progress("")
    print(f"{arguments.output}/index.html")
    for problem in problems:
        print(problem, file=sys.stderr)
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
