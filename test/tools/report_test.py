"""The report: its tables compared with the known figures, and its HTML in a browser."""
import html.parser
import json
import math
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import unittest

import numpy as np
from tool_case import TOOLS, FolderCase

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path.append(str(ROOT / "scripts/report"))
import motion  # noqa: E402  pylint: disable=wrong-import-position
DATA = os.environ.get("KTGP_ORB_DATA", "")
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")

try:
    import matplotlib  # noqa: F401  pylint: disable=unused-import
    import PIL.Image
    DRAWING = True
except ImportError:
    DRAWING = False
try:
    import rosbag
    import rospy
    from geometry_msgs.msg import Quaternion, Transform, TransformStamped, Vector3
    from tf2_msgs.msg import TFMessage
    ROS = True
except ImportError:
    ROS = False


def expected():
    """The table of test/matching/paper_test.cpp: set -> (rows of counts, distances)."""
    text = (ROOT / "test/matching/paper_test.cpp").read_text()
    found = {}
    for name in ("leuven", "bikes"):
        body = text[text.index(f'{{"{name}"'):]
        rows = re.findall(r"\{(\d), (\d+), (\d+), (\d+)\}", body)[:5]
        distances = re.findall(r"\{(\d+\.\d+), (\d+\.\d+)\}", body)[:3]
        found[name] = ([tuple(map(int, r[1:])) for r in rows],
                       [tuple(map(float, d)) for d in distances])
    return found


class Page(html.parser.HTMLParser):
    """Tables by caption, sources of images, and whether the tags are balanced."""

    VOID = {"meta", "link", "img", "br"}

    def __init__(self, text):
        super().__init__()
        self.open, self.tables, self.images, self.links = [], {}, [], []
        self.rows, self.caption, self.text = [], "", ""
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        attrs = dict(attrs)
        if tag == "img":
            self.images.append(attrs["src"])
        self.links += [attrs[k] for k in ("src", "href") if k in attrs]
        if tag not in self.VOID:
            self.open.append(tag)
        if tag == "table":
            self.rows = []
        if tag == "tr":
            self.rows.append([])
        if tag in ("td", "th", "caption"):
            self.text = ""

    def handle_data(self, data):
        self.text += data

    def handle_endtag(self, tag):
        if self.open.pop() != tag:
            raise AssertionError(f"</{tag}> closes another element")
        if tag in ("td", "th"):
            self.rows[-1].append(self.text)
        if tag == "caption":
            self.caption = self.text
        if tag == "table":
            self.tables[self.caption] = self.rows

    def table(self, beginning):
        return next(rows for caption, rows in self.tables.items() if caption.startswith(beginning))


@unittest.skipUnless(DATA, "KTGP_ORB_DATA is not set: this test needs it")
@unittest.skipUnless(DRAWING, "python3-matplotlib or python3-pil is not installed")
class Report(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        cls.output = pathlib.Path(cls.folder.name) / "report"
        data = pathlib.Path(DATA) / "oxford"
        leuven = pathlib.Path(cls.folder.name) / "leuven"  # with another ending
        shutil.copytree(data / "leuven", leuven)
        for image in leuven.glob("img*"):
            PIL.Image.open(image).save(image.with_suffix(".BMP"), "BMP")
            image.unlink()
        subprocess.run([sys.executable, "-B", ROOT / "scripts/report", "--tools",
                        TOOLS, "--data", leuven, "--data",
                        data / "bikes", "--output", cls.output, "--repeat", "1", "--warp-pairs", "2", "--methods",
                        "ORB,ORB+RANSAC,KT,KTG,KTGP"], check=True, stdout=subprocess.DEVNULL)
        cls.text = (cls.output / "index.html").read_text(encoding="utf-8")
        cls.page = Page(cls.text)

    @classmethod
    def tearDownClass(cls):
        cls.folder.cleanup()

    def test_counts_are_the_known_ones(self):
        for name, (rows, _) in expected().items():
            table = self.page.table(f"Table 3. Matches after each stage, {name.capitalize()}")
            for measured, (kt, ktg, ktgp) in zip(table[1:6], rows):
                self.assertEqual([int(measured[2]), int(measured[5])], [kt, ktg], measured)
                self.assertAlmostEqual(int(measured[8]), ktgp, delta=0.1 * ktgp)
                self.assertLessEqual(int(measured[8]), ktg)

    def test_table_1_is_the_last_stage_of_table_3(self):
        for column, name in ((2, "Leuven"), (5, "Bikes")):
            table = self.page.table(f"Table 3. Matches after each stage, {name}")
            for short, long in zip(self.page.table("Table 1.")[1:], table[1:6]):
                self.assertEqual(short[column], long[8])

    def test_distances_are_the_known_ones(self):
        for which, number in ((0, "4"), (1, "5")):
            table = self.page.table(f"Table {number}.")
            for column, name in ((2, "leuven"), (5, "bikes")):
                for row, known, tolerance in zip(table[1:], expected()[name][1],
                                                 (0.01, 0.01, 0.4)):
                    self.assertAlmostEqual(float(row[column]), known[which], delta=tolerance)

    def test_table_6_has_the_cross_checked_baseline(self):
        table = self.page.table("Table 6.")
        self.assertAlmostEqual(float(table[2][3]), 32.288, delta=0.01)
        self.assertAlmostEqual(float(table[5][3]), 31.003, delta=0.01)

    def test_every_figure_of_the_paper_is_there(self):
        captions = re.findall(r"<figcaption>(.*?)</figcaption>", self.text)
        for n in (4, 5, 6, 7, 8, 9, 10, 12):
            self.assertTrue(any(c.startswith(f"Figure {n}.") for c in captions), n)
        self.assertEqual(sum(c.startswith("Figure 5.") for c in captions), 10)
        self.assertIn("What cannot be reproduced", self.text)

    def test_accuracy_of_pairs_and_of_exact_warps(self):
        for beginning in ("Image pairs, leuven: 5", "Image pairs, all: 10", "Exact warps, small: 2",
                          "Exact warps, medium: 2", "Exact warps, large: 2"):
            header, *rows = self.page.table(beginning)
            self.assertEqual([row[0] for row in rows], ["ORB+RANSAC", "KTGP"], beginning)
            for row in rows:
                auc = [float(row[header.index(f"AUC {k} px %")]) for k in (1, 3, 5, 10)]
                self.assertEqual(auc, sorted(auc), row)
                self.assertTrue(0 <= auc[0] and auc[3] <= 100, row)
                self.assertGreater(float(row[-1]), 0)
        small = self.page.table("Exact warps, small")[2]
        self.assertGreater(float(small[2]), 60, "AUC up to 3 px")
        self.assertEqual(small[6], "100.0")
        self.assertEqual(small[7], "0.0")
        self.assertGreater(float(small[8]), 0.9, "ZNCC")
        for name in ("pairs_all", "warps_small", "warps_medium", "warps_large"):
            picture = (self.output / "figures" / f"accuracy_{name}.svg").read_text()
            self.assertIn("KTGP", picture)

    def test_page_is_balanced_and_needs_nothing_else(self):
        self.assertEqual(self.page.open, [])
        for link in self.page.links:
            self.assertTrue(link.startswith("data:"), link[:80])

    def test_markdown_has_the_same_tables_and_its_pictures(self):
        text = (self.output / "report.md").read_text(encoding="utf-8")
        for caption in self.page.tables:
            self.assertIn(f"**{caption}**", text)
        pictures = re.findall(r"\]\((figures/.*?)\)", text)
        self.assertEqual(len(pictures), len(self.page.images))
        for picture in pictures:
            self.assertGreater((self.output / picture).stat().st_size, 1000, picture)

    @unittest.skipUnless(CHROMIUM, "chromium is not installed: the page is not opened in a browser")
    def test_browser_shows_every_image_without_an_error(self):
        # The page itself has no script; this copy of it counts what was drawn.
        count = ("<script>addEventListener('load', () => { document.title = 'broken ' + "
                 "[...document.images].filter(i => !i.complete || !i.naturalWidth).length + "
                 "' of ' + document.images.length })</script></body>")
        copy = self.output / "copy.html"
        copy.write_text(self.text.replace("</body>", count), encoding="utf-8")
        with tempfile.TemporaryDirectory() as profile:
            run = subprocess.run(
                [CHROMIUM, "--headless", "--no-sandbox", "--disable-gpu", "--no-first-run",
                 "--disable-background-networking", "--disable-component-update", "--disable-sync",
                 f"--user-data-dir={profile}", "--enable-logging=stderr", "--dump-dom",
                 copy.as_uri()], capture_output=True, text=True, timeout=120, check=False)
        self.assertIn(f"<title>broken 0 of {len(self.page.images)}</title>", run.stdout)
        self.assertEqual([x for x in run.stderr.splitlines() if "CONSOLE" in x], [])


@unittest.skipUnless(DRAWING, "python3-matplotlib or python3-pil is not installed")
class ReportOfBrokenData(FolderCase):
    def test_names_what_is_missing_and_still_writes(self):
        self.run_program(sys.executable, "-B", ROOT / "scripts/report", "--tools", TOOLS, "--data", "nowhere",
                         "--output", "report", code=1, words="nowhere")
        page = (self.folder / "report/index.html").read_text(encoding="utf-8")
        self.assertIn("nowhere", page)
        self.assertIn("fetch_oxford", page)

    def test_an_output_that_cannot_be_written_is_named_before_anything_is_measured(self):
        (self.folder / "file").write_text("no folder")
        for output in ("file", "file/report"):
            run = self.run_program(sys.executable, "-B", ROOT / "scripts/report", "--tools", "no/programs", "--data",
                                   "nowhere", "--output", output, code=2,
                                   words=f"evaluate: --output {output} cannot be written: Not a directory")
            self.assertEqual(len(run.stderr.splitlines()), 1, run.stderr)


class CompareBenchmarks(FolderCase):
    def compare(self, new, code, words="", prints=""):
        self.write("old.json", json.dumps({"machine": "any", "rows": [
            {"name": name, "median": 1.0, "noise": 0.0, "unit": "ms"} for name in ("first", "second")]}))
        self.write("new.json", json.dumps(new))
        run = self.run_program(sys.executable, "-B", ROOT / "scripts/bench", "--compare", "old.json", "new.json",
                               code=code, words=words, prints=prints)
        self.assertNotIn("Traceback", run.stderr)

    def test_what_is_gone_or_cannot_be_compared_is_no_success(self):
        first, second, third = ({"name": name, "median": 1.01, "noise": 0.0, "unit": "ms"}
                                for name in ("first", "second", "third"))
        self.compare({"machine": "any", "rows": [first, second]}, 0, prints="0 of 2 benchmarks changed")
        self.compare({"machine": "any", "rows": [first, third]}, 1, prints="gone: second\nnew: third")
        failed = {"name": "second", "error": "out of memory"}
        self.compare({"machine": "any", "rows": [first, failed]}, 1, prints="gone: second")
        self.compare({"machine": "any", "rows": [dict(first, median=2.0), second]}, 1, prints="1 of them are slower")
        self.compare({"machine": "any", "rows": [third]}, 2, words="old.json and new.json have no benchmark in common")
        for other in ({"rows": [first]}, [], {"context": {}, "benchmarks": []}):
            self.compare(other, 2, words="new.json is not written by scripts/bench")


@unittest.skipUnless(ROS, "python3-rosbag is not installed: scripts/evaluate --motion needs ROS")
class MotionOfBrokenData(FolderCase):
    """scripts/evaluate --motion with a ktgp_bag that writes a table and ends with the exit code CODE."""

    def setUp(self):
        super().setUp()
        self.bag = self.folder / "flight.bag"
        self.write_bag(200)
        tool = self.folder / "ktgp_bag"
        tool.write_text("""#!/bin/sh
[ "$CODE" -lt 2 ] || exit "$CODE"
echo "$@" > options
while [ "$1" != --motion ]; do shift; done
echo stamp,x,vx > "$2"
for i in 5 6 7 8; do echo "2.$i,,"; done >> "$2"
exit "$CODE"
""")
        tool.chmod(0o755)

    def write_bag(self, count, *broken):
        with rosbag.Bag(str(self.bag), "w", chunk_threshold=1000) as bag:
            for i in range(count):
                pose = TransformStamped()
                pose.header.stamp = rospy.Time.from_sec(1 + 0.01 * i)
                pose.header.frame_id, pose.child_frame_id = "ground", "base_link"
                pose.transform.translation.x, pose.transform.translation.z = 0.001 * i, 0.01 * i
                pose.transform.rotation.w = 1
                for transform in [pose.transform, *broken] if i == 3 else [pose.transform]:
                    pose.transform = transform
                    bag.write("/tf", TFMessage([pose]), pose.header.stamp)

    def evaluate(self, bag, of_tool=0, options=(), **expected):
        run = self.run_program(sys.executable, "-B", ROOT / "scripts/report/motion.py", "--tools", self.folder,
                               "--motion", bag, *options, env=dict(os.environ, CODE=str(of_tool)), **expected)
        self.assertNotIn("Traceback", run.stderr)
        return run

    def refused(self, bag, *words, of_tool=0):
        run = self.evaluate(bag, of_tool, code=2, words=("evaluate: ", str(bag), *words))
        self.assertEqual((run.stdout, len(run.stderr.splitlines())), ("", 1), run.stderr)

    def test_a_bag_that_cannot_be_read_is_named(self):
        self.refused(self.folder / "none.bag", "No such file")
        self.refused(self.folder, "directory")
        whole = self.bag.read_bytes()
        cut = self.folder / "cut.bag"
        cut.write_bytes(whole[:4096 + (len(whole) - 4096) // 3])
        self.refused(cut, "is not complete", f"rosbag reindex {cut}")
        cut.write_bytes(b"no bag at all\n")
        self.refused(cut)
        cut.write_bytes(b"")
        self.refused(cut)

    def test_a_table_of_a_part_of_the_data_is_shown(self):
        whole = self.evaluate(self.bag, prints="| 0.1 m | 3 | 100 % |")
        self.assertEqual(whole.stderr, "")
        part = self.evaluate(self.bag, 1, code=1, words="could not use all of the data")
        self.assertEqual(part.stdout, whole.stdout)

    def test_a_pose_that_is_none_is_left_out_and_counted(self):
        whole = self.evaluate(self.bag).stdout
        of_zeros = Transform()  # its quaternion
        no_place = Transform(Vector3(math.nan, 0, 0), Quaternion(0, 0, 0, 1))
        self.write_bag(200, of_zeros, no_place)
        found = self.evaluate(self.bag, words="2 of 202 transforms from ground to base_link are no poses")
        self.assertEqual(found.stdout, whole)
        self.write_bag(9, of_zeros, no_place)
        self.evaluate(self.bag, code=2, words="has 9 transforms")

    def test_a_gap_does_not_end_the_measurement_of_the_drift(self):
        """The position is right for 30 s and then drifts by a fifth of the way; there is no answer from 22 to 25 s."""
        track = []
        for time in [i / 10 for i in range(1000) if not 220 < i < 250]:
            off = 0.4 * max(0, time - 30)
            track.append((time, (np.array([2 * time, 0, 10]), np.eye(3)), (np.array([2 * time, off, 10]), np.eye(3))))
        self.assertAlmostEqual(motion.drift(track, 10), 0.2, places=3)

    def test_no_default_overrides_an_option_of_the_user(self):
        names = "--reference_mode", "--guided", "--gms_grid", "--motion_normal_source"
        for given, added in (((), "--reference_mode previous --guided true --gms_grid 0 --motion_normal_source imu"),
                             (("--guided", "false"), "--reference_mode previous --gms_grid 0 --motion_normal_source imu"),
                             (("--gms_grid=20",), "--reference_mode previous --guided true --motion_normal_source imu"),
                             (("--reference_mode", "keyframe"), "--motion_normal_source imu"),
                             (("--params", "my.yaml"), "--motion_normal_source imu"),
                             (("--preset=robust", "--motion_normal_source", "fixed"), "")):
            self.evaluate(self.bag, options=given)
            passed = (self.folder / "options").read_text().split()
            passed = passed[passed.index("base_link") + 1:]
            self.assertEqual(passed, [*given, *added.split()])
            words = [option.split("=")[0] for option in passed]
            self.assertTrue(all(words.count(name) <= 1 for name in names), words)

    def test_without_a_table_the_exit_code_is_said(self):
        self.refused(self.bag, "ktgp_bag ended with exit code 3", of_tool=3)
