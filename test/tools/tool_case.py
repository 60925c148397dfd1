"""Common code of the tests of the command-line programs."""
import csv
import json
import os
import pathlib
import random
import re
import struct
import subprocess
import tempfile
import unittest

import cv2
import numpy as np

WIDTH, HEIGHT = 320, 240
NEAR, FAR = 2.0, 6.0  # m, of two_depths()
TOOLS = pathlib.Path(os.environ.get("KTGP_ORB_TOOLS", ""))
SOURCE = pathlib.Path(__file__).resolve().parents[2]


def picture(seed=1):
    """Overlapping rectangles, so that there are corners everywhere."""
    rng = random.Random(seed)
    grey = np.full((HEIGHT + 40, WIDTH + 40), 128, np.uint8)
    for _ in range(700):
        x, y = rng.randrange(WIDTH + 30), rng.randrange(HEIGHT + 30)
        w, h = rng.randrange(4, 30), rng.randrange(4, 30)
        grey[y:y + h, x:x + w] = rng.randrange(256)
    return grey


def window(grey, dx=0, dy=0):
    """Returns a part of WIDTH x HEIGHT, with its top-left corner at (dx, dy)."""
    return grey[dy:dy + HEIGHT, dx:dx + WIDTH]


def write_pgm(path, grey, dx=0, dy=0):
    assert cv2.imwrite(str(path), window(grey, dx, dy))


def write_tiff(path, grey, kinds, order="<", big=False):
    """Writes a TIFF or BigTIFF of the picture; its pages have these subfile types: 0 a page, 1 a smaller copy, 4 a
    mask. `order`: < with the lowest byte first, > with the highest."""
    height, width = grey.shape
    form, entry, start = ("Q", "HHQI4x", 16) if big else ("I", "HHII", 8)
    data = (b"II" if order == "<" else b"MM") + struct.pack(order + ("HHHQ" if big else "HI"), *(
        (43, 8, 0) if big else (42,)), start + grey.size) + grey.tobytes()
    for i, kind in enumerate(kinds):
        tags = {254: kind, 256: width, 257: height, 258: 8, 259: 1, 262: 1, 273: start, 277: 1, 278: height,
                279: grey.size}
        count = struct.pack(order + ("Q" if big else "H"), len(tags))
        entries = b"".join(struct.pack(order + entry, tag, 4, 1, value) for tag, value in tags.items())
        end = len(data) + len(count) + len(entries) + struct.calcsize("<" + form)
        data += count + entries + struct.pack(order + form, end if i + 1 < len(kinds) else 0)
    pathlib.Path(path).write_bytes(data)


def translation(x, y):
    return f"1 0 {x}\n0 1 {y}\n0 0 1\n"


def shift(x, y):
    return np.array([[1.0, 0, x], [0, 1, y], [0, 0, 1]])


def mapped(homography, points):
    """Points under a homography of nine numbers."""
    return cv2.perspectiveTransform(np.array([points], float), np.array(homography, float).reshape(3, 3))[0]


def corners_off(homography, truth, size=(640, 480)):
    """By how much two homographies place the corners of an image apart, px in x and y of each."""
    corners = [(x, y) for x in (0, size[0] - 1) for y in (0, size[1] - 1)]
    return mapped(homography, corners) - mapped(truth, corners)


def two_depths(first, K, distance, direction, rotation=np.eye(3)):
    """Returns the view after a motion, in the terms of two-view geometry; the left half of the first view shows a wall
    at the distance NEAR, the right half one at FAR."""
    height, width = first.shape
    second = np.full_like(first, 128)
    for depth, columns in ((FAR, slice(width // 2, width)), (NEAR, slice(0, width // 2))):
        H = K @ (rotation + distance / depth * np.outer(direction, [0, 0, 1])) @ np.linalg.inv(K)
        part = np.zeros_like(first)
        part[:, columns] = 255
        where = cv2.warpPerspective(part, H, (width, height), flags=cv2.INTER_NEAREST) > 0
        second[where] = cv2.warpPerspective(first, H, (width, height), flags=cv2.INTER_CUBIC)[where]
    return second


# A motion over a plane, in units of its distance, that always leaves a second one: along the view and across it.
OVER_A_PLANE = np.array([-0.2, 0.0, 0.15])


def tilted_plane(first, K, tilt):
    """Returns the view of a picture on a plane, turned by `tilt` about y, after the motion OVER_A_PLANE."""
    normal = cv2.Rodrigues(np.array([0.0, tilt, 0.0]))[0][:, 2]
    H = K @ (np.eye(3) + np.outer(OVER_A_PLANE, normal)) @ np.linalg.inv(K)
    return cv2.warpPerspective(first, H, first.shape[::-1], flags=cv2.INTER_CUBIC)


def parameter_rows():
    """Name and a value other than the default of each parameter in the table of the matcher."""
    other = {"descriptor": "teblid", "distribution": "uniform", "geometry": "auto", "mask_image": "none.png",
             "roi": "0 0 150 100", "calibration": "raw", "stretch": "range", "reference_mode": "keyframe",
             "reference_image": "none.png", "overlay_style": "flow"}
    text = (SOURCE / "src/parameters/table.def").read_text()
    rows = re.findall(r"^KTGP_(BOOL|INT|DOUBLE|STRING|CHOICE)\((\w+), ([^,]+), ([^,]+), ", text, re.M)
    assert len(rows) > 25
    for kind, name, usual, low in rows:
        if kind == "BOOL":
            yield name, "false" if usual == "true" else "true"
        elif name in other:
            yield name, other[name]
        else:
            yield name, low if float(low) != float(usual) else str(type(eval(usual))(eval(usual) + 1))


def without_times(found):
    """A result as JSON without what is measured in time."""
    if isinstance(found, dict):
        return {name: without_times(value) for name, value in found.items()
                if "milliseconds" not in name and "ms" not in name.split("_")}
    return [without_times(each) for each in found] if isinstance(found, list) else found


class FolderCase(unittest.TestCase):
    """With a folder that is deleted after each test, and a way to run programs in it."""
    timeout = 300  # s, of a program
    prefix = None  # of the folder's name

    def setUp(self):
        folder = tempfile.TemporaryDirectory(prefix=self.prefix)
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)

    def path(self, *names):
        """For OpenCV and rosbag, which take no pathlib.Path."""
        return str(self.folder.joinpath(*names))

    def write(self, name, text):
        (self.folder / name).write_text(text)

    def read(self, name):
        return (self.folder / name).read_text()

    def json(self, name="out.json"):
        return json.loads(self.read(name))

    def table(self, name="out.csv"):
        """The rows of a file of comma-separated values."""
        with open(self.folder / name, newline="", encoding="utf-8") as file:
            return list(csv.DictReader(file))

    def damage(self, name, share):
        """Cuts a file off after that share of it."""
        content = (self.folder / name).read_bytes()
        (self.folder / name).write_bytes(content[:int(share * len(content))])

    def start(self, *command, **options):
        return subprocess.Popen(command, **self._usual(options))

    def run_program(self, *command, code=0, words=(), prints=(), **options):
        """Runs it to its end; for the rest see check_end()."""
        run = subprocess.run([str(word) for word in command], timeout=self.timeout, check=False, **self._usual(options))
        self.check_end(run, code, words, prints)
        return run

    def check_end(self, run, code=0, words=(), prints=()):
        """It has ended with this exit code (None: any). A text, or several: words on its standard error, and what it
        printed on its standard output."""
        if code is not None:
            self.assertEqual(run.returncode, code, (run.args, run.stdout, run.stderr))
        for expected, output in ((words, run.stderr), (prints, run.stdout)):
            for each in [expected] if isinstance(expected, str) else expected:
                self.assertIn(each, output)

    def _usual(self, options):
        return dict(dict(cwd=self.folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, universal_newlines=True,
                         errors="replace"), **options)


class ToolCase(FolderCase):
    timeout = 60

    def run_tool(self, tool, *arguments, **options):
        return self.run_program(TOOLS / tool, *arguments, **options)

    def check_each_parameter(self, result, same):
        """Each parameter of the table, set by --params, changes the result of a run, is refused, or is named as one
        without effect, and then has none. `result(name)` runs the program with the file one.yaml that sets the
        parameter `name`, and returns the run and all that the parameters can change. `same`: parameters that are used,
        but not by these inputs, or that have no effect on the result."""
        self.write("one.yaml", "features: 2000\n")
        usual = result("features")[1]
        unseen = set()
        for name, value in parameter_rows():
            self.write("one.yaml", f"{name}: {value}\n")
            run, found = result(name)
            if run.returncode == 2:
                self.assertRegex(run.stderr, f"{name} (is )?'?{re.escape(value)}")
                continue
            self.assertIn(run.returncode, (0, 1), (name, run.stderr))
            is_named = re.findall("^without effect in this run: (.*)$", run.stderr, re.M)
            self.assertIn(is_named, ([], [name]))
            if is_named:
                self.assertEqual(found, usual, f"{name} has an effect")
            elif found == usual:
                unseen.add(name)
        self.assertEqual(unseen, same)

    def check_each_parameter_of_pairs(self, tool, *arguments, same):
        """Also the options that --json names are those of the file."""
        def result(name):
            run = self.run_tool(tool, *arguments, "--params", "one.yaml", "--json", "out.json", "--force", code=None)
            if run.returncode == 2:
                return run, None
            found = self.json()
            options, value = found.pop("options"), self.read("one.yaml").split(": ")[1].strip()
            if name in options:
                used = str(options[name]).lower()
                self.assertEqual(used.rstrip("0").rstrip("."), value.rstrip("0").rstrip("."), name)
            return run, without_times(found)
        self.check_each_parameter(result, same)


class PairCase(ToolCase):
    """Two views of one picture."""

    def setUp(self):
        super().setUp()
        write_pgm(self.folder / "a.pgm", picture(), 20, 20)
        write_pgm(self.folder / "b.pgm", picture(), 13, 24)  # the scene moves by (7, -4)
        self.write("H.txt", translation(7, -4))
        self.write("pairs.txt", "ab a.pgm b.pgm H.txt\n")
