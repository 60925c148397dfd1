"""Makes single writes fail: the program ends with 2 and a message, and leaves no partial file.
KTGP_ORB_ALL_FAULTS=1 tries every write of each program; otherwise only some of them."""
import os
import unittest

from tool_case import TOOLS, PairCase

STEP = 1.0 if os.environ.get("KTGP_ORB_ALL_FAULTS") else 1.7


class WriteFaults(PairCase):
    timeout = 300

    def run_failing(self, number, tool, *arguments):
        """Runs the program; returns also whether the write with that number was reached and failed."""
        mark = self.folder / "mark"
        mark.unlink(missing_ok=True)
        environment = dict(os.environ, LD_PRELOAD=os.environ["KTGP_ORB_FAULTS"],
                           KTGP_ORB_FAIL_WRITE=str(number), KTGP_ORB_FAIL_MARK=str(mark))
        return self.run_tool(tool, *arguments, code=None, env=environment), mark.exists()

    def check(self, tool, *arguments, outputs):
        number, failures = 1, 0
        while True:
            for output in outputs:
                self.write(output, "mine")
            run, failed = self.run_failing(number, tool, *arguments)
            if not failed:
                self.assertEqual(run.returncode, 0, run.stderr)
                break
            failures += 1
            what = f"{tool}, write {number}: {run.returncode} {run.stderr}"
            self.assertEqual(run.returncode, 2, what)
            self.assertTrue(any(output in run.stderr for output in outputs), what)
            for output in outputs:  # each is as it was, or complete
                content = (self.folder / output).read_bytes()
                if content != b"mine":
                    self.whole(self.folder / output, tool, arguments)
            left = [p.name for p in self.folder.iterdir() if p.name.startswith(("out", ".out"))]
            self.assertEqual(sorted(left), sorted(outputs), what)
            number = max(number + 1, int(number * STEP))
        self.assertGreater(failures, 0, "no write was made to fail")
        print(f"{tool}: {failures} writes made to fail of less than {number}")

    def whole(self, file, tool, arguments):
        """The same bytes as without a fault, except for measured times."""
        content = file.read_bytes()
        run, _ = self.run_failing(0, tool, *arguments)
        self.assertEqual(run.returncode, 0, run.stderr)
        self.assertLess(abs(len(file.read_bytes()) - len(content)), 0.02 * len(content) + 64, file)

    def test_match(self):
        self.check("ktgp_match", "a.pgm", "b.pgm", "--json", "out.json", "--draw", "out.png", "--force",
                   outputs=["out.json", "out.png"])

    def test_evaluate(self):
        self.check("ktgp_evaluate", "pairs.txt", "--methods", "KTGP", "--json", "out.json", "--force",
                   outputs=["out.json"])

    @unittest.skipUnless((TOOLS / "make_demo_bag").exists(), "built without ROS")
    def test_bag(self):
        self.run_tool("make_demo_bag", "in.bag", "--seconds", "0.2")
        self.check("ktgp_bag", "in.bag", "out.bag", "--csv", "out.csv", "--force", "--features", "200",
                   outputs=["out.bag", "out.csv"])
