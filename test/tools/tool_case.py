"""Common code of the tests of the command-line programs."""
import os
import pathlib
import random
import subprocess
import tempfile
import unittest

WIDTH, HEIGHT = 320, 240


def picture(seed=1):
    """Rows of grey values: overlapping rectangles, so that there are corners everywhere."""
    rng = random.Random(seed)
    rows = [bytearray([128] * (WIDTH + 40)) for _ in range(HEIGHT + 40)]
    for _ in range(700):
        x, y = rng.randrange(WIDTH + 30), rng.randrange(HEIGHT + 30)
        w, h, grey = rng.randrange(4, 30), rng.randrange(4, 30), rng.randrange(256)
        for row in rows[y:y + h]:
            row[x:x + w] = bytes([grey] * len(row[x:x + w]))
    return rows


def write_pgm(path, rows, dx=0, dy=0):
    """A window of WIDTH x HEIGHT whose top-left corner is at (dx, dy)."""
    body = b"".join(bytes(row[dx:dx + WIDTH]) for row in rows[dy:dy + HEIGHT])
    pathlib.Path(path).write_bytes(b"P5\n%d %d\n255\n" % (WIDTH, HEIGHT) + body)


def translation(x, y):
    return f"1 0 {x}\n0 1 {y}\n0 0 1\n"


class ToolCase(unittest.TestCase):
    """A temporary folder and a way to run a program in it."""

    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)

    def run_tool(self, tool, *arguments):
        program = pathlib.Path(os.environ["KTGP_ORB_TOOLS"]) / tool
        return subprocess.run([program, *map(str, arguments)], cwd=self.folder,
                              capture_output=True, text=True, timeout=60, check=False)


class PairCase(ToolCase):
    """Two views of one picture."""

    def setUp(self):
        super().setUp()
        rows = picture()
        write_pgm(self.folder / "a.pgm", rows, 20, 20)
        write_pgm(self.folder / "b.pgm", rows, 13, 24)  # the scene moves by (7, -4)
        (self.folder / "H.txt").write_text(translation(7, -4))
        (self.folder / "pairs.txt").write_text("ab a.pgm b.pgm H.txt\n")
