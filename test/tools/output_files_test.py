"""No program destroys a file or calls a failure a success: ktgp_match, ktgp_evaluate and, where they
are built, ktgp_bag and make_demo_bag from outside."""
import os
import pathlib
import resource
import signal
import subprocess
import time
import unittest

from tool_case import ToolCase, picture, translation, write_pgm

TOOLS = pathlib.Path(os.environ["KTGP_ORB_TOOLS"])
WITH_ROS = (TOOLS / "make_demo_bag").exists()


def small_files(limit):
    """For preexec_fn: writing a file beyond so many bytes fails, as on a full disk."""
    def apply():
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
    return apply


def little_memory(limit):
    def apply():
        resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    return apply


class OutputCase(ToolCase):
    def setUp(self):
        super().setUp()
        rows = picture()
        write_pgm(self.folder / "a.pgm", rows, 20, 20)
        write_pgm(self.folder / "b.pgm", rows, 13, 24)
        (self.folder / "H.txt").write_text(translation(7, -4))
        (self.folder / "pairs.txt").write_text("ab a.pgm b.pgm H.txt\n")

    def run_with(self, tool, *arguments, preexec=None, stdout=subprocess.PIPE):
        return subprocess.run([TOOLS / tool, *map(str, arguments)], cwd=self.folder, stdout=stdout,
                              stderr=subprocess.PIPE, text=True, timeout=300, check=False,
                              preexec_fn=preexec)

    def contents(self):
        return {path.name: path.read_bytes() for path in self.folder.iterdir() if path.is_file()}

    def refused(self, tool, *arguments, words, preexec=None):
        """It ends with 2, says why in a line, and has neither changed nor left a file."""
        before = self.contents()
        run = self.run_with(tool, *arguments, preexec=preexec)
        self.assertEqual(run.returncode, 2, (arguments, run.stdout, run.stderr))
        self.assertIn(words, run.stderr)
        self.assertEqual(self.contents(), before, arguments)


class MatchOutput(OutputCase):
    def test_what_exists_is_replaced_only_when_forced(self):
        for option in ("--json", "--csv", "--draw", "--draw-stages", "--draw-final"):
            (self.folder / "out.png").write_text("mine")
            self.refused("ktgp_match", "a.pgm", "b.pgm", option, "out.png", words="--force")
            run = self.run_with("ktgp_match", "a.pgm", "b.pgm", option, "out.png", "--force")
            self.assertEqual(run.returncode, 0, run.stderr)
            self.assertGreater((self.folder / "out.png").stat().st_size, 1000)

    def test_an_output_is_never_an_input_nor_another_output(self):
        (self.folder / "soft.pgm").symlink_to("a.pgm")
        os.link(self.folder / "a.pgm", self.folder / "hard.pgm")
        for name in ("a.pgm", "./a.pgm", "soft.pgm", "hard.pgm"):
            for option in ("--draw", "--csv", "--json"):
                self.refused("ktgp_match", "a.pgm", "b.pgm", option, name, "--force",
                             words="is the input")
        self.refused("ktgp_match", "a.pgm", "b.pgm", "--ground-truth", "H.txt", "--json", "H.txt",
                     "--force", words="is the input")
        (self.folder / "dangling").symlink_to("new.csv")
        self.refused("ktgp_match", "a.pgm", "b.pgm", "--csv", "new.csv", "--json", "dangling",
                     words="is an output already")

    def test_a_link_stays_a_link(self):
        (self.folder / "target.csv").write_text("old")
        (self.folder / "link.csv").symlink_to("target.csv")
        run = self.run_with("ktgp_match", "a.pgm", "b.pgm", "--csv", "link.csv", "--force")
        self.assertEqual(run.returncode, 0, run.stderr)
        self.assertTrue((self.folder / "link.csv").is_symlink())
        self.assertIn("reference_index", (self.folder / "target.csv").read_text())

    def test_only_regular_files_are_replaced(self):
        os.mkfifo(self.folder / "fifo")
        (self.folder / "folder").mkdir()
        for name in ("/dev/full", "/dev/null", "fifo", "folder"):
            self.refused("ktgp_match", "a.pgm", "b.pgm", "--csv", name, "--force",
                         words="not a regular file")

    def test_an_unwritable_place_is_named_before_any_work(self):
        self.refused("ktgp_match", "a.pgm", "b.pgm", "--csv", "no/such/out.csv",
                     words="no/such/out.csv")
        if os.getuid() != 0:
            (self.folder / "locked").mkdir(mode=0o500)
            self.refused("ktgp_match", "a.pgm", "b.pgm", "--csv", "locked/out.csv",
                         words="locked/out.csv")

    def test_a_full_disk_is_a_failure_and_leaves_what_was_there(self):
        (self.folder / "out.ppm").write_text("mine")
        for option in ("--draw", "--csv", "--json"):
            self.refused("ktgp_match", "a.pgm", "b.pgm", option, "out.ppm", "--force",
                         words="out.ppm", preexec=small_files(512))

    def test_a_full_standard_output_is_a_failure(self):
        with open("/dev/full", "w", encoding="ascii") as full:
            for tool, arguments in (("ktgp_match", ("a.pgm", "b.pgm")),
                                    ("ktgp_evaluate", ("pairs.txt", "--methods", "KT"))):
                run = self.run_with(tool, *arguments, stdout=full)
                self.assertEqual(run.returncode, 2)
                self.assertIn("standard output", run.stderr)

    def test_too_little_memory_for_the_threads_is_said(self):
        run = self.run_with("ktgp_match", "a.pgm", "b.pgm", "--threads", 256,
                            preexec=little_memory(700 << 20))
        self.assertEqual(run.returncode, 2, run.stderr)
        self.assertIn("fewer", run.stderr)

    def test_version_and_codes_are_the_same_everywhere(self):
        tools = ["ktgp_match", "ktgp_evaluate"]
        tools += ["ktgp_bag", "ktgp_evaluate_bag", "make_demo_bag"] if WITH_ROS else []
        for tool in tools:
            self.assertRegex(self.run_with(tool, "--version").stdout, r"^ktgp_orb \d+\.\d+\.\d+\n$")
            text = self.run_with(tool, "--help").stdout
            for words in ("Exit code: 0 ", ", 1 ", ", 2 ", "130 interrupted (Ctrl-C)", "--force"):
                self.assertIn(words, text.replace("\n", " "), tool)


class EvaluateOutput(OutputCase):
    def test_outputs_are_checked_as_everywhere(self):
        for option in ("--json", "--csv"):
            self.refused("ktgp_evaluate", "pairs.txt", option, "pairs.txt", "--force",
                         words="is the input")
            (self.folder / "out").write_text("mine")
            self.refused("ktgp_evaluate", "pairs.txt", option, "out", words="--force")
        self.refused("ktgp_evaluate", "pairs.txt", "--csv", "x", "--json", "x",
                     words="is an output already")

    def test_too_little_memory_for_the_jobs_is_said(self):
        run = self.run_with("ktgp_evaluate", "pairs.txt", "--jobs", 256,
                            preexec=little_memory(700 << 20))
        self.assertEqual(run.returncode, 2, run.stderr)

    def test_ctrl_c_ends_with_130(self):
        process = subprocess.Popen(
            [TOOLS / "ktgp_evaluate", "pairs.txt", "--repeat", "1000", "--json", "out.json"],
            cwd=self.folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        with open(f"/proc/{process.pid}/status", encoding="ascii") as status:
            # Until it catches the signal: bit 1 of SigCgt is SIGINT.
            while not self.catches_interrupt(status):
                self.assertIsNone(process.poll())
                time.sleep(0.01)
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=60)
        self.assertEqual(process.returncode, 130)
        self.assertFalse((self.folder / "out.json").exists())

    @staticmethod
    def catches_interrupt(status):
        status.seek(0)
        caught = next(line for line in status if line.startswith("SigCgt"))
        return int(caught.split()[1], 16) & (1 << (signal.SIGINT - 1))

    def test_a_bag_belongs_to_another_program(self):
        self.refused("ktgp_evaluate", "--bag", "some.bag", words="ktgp_evaluate_bag some.bag")


@unittest.skipUnless(WITH_ROS, "built without ROS")
class BagOutput(OutputCase):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.made = pathlib.Path(os.environ.get("TMPDIR", "/tmp")) / f"ktgp_orb_{os.getpid()}.bag"
        subprocess.run([TOOLS / "make_demo_bag", cls.made, "--seconds", "0.3", "--force"],
                       check=True)
        cls.addClassCleanup(cls.made.unlink)

    def setUp(self):
        super().setUp()
        self.bag = self.folder / "it's a bag.bag"
        self.bag.write_bytes(self.made.read_bytes())

    def test_the_only_image_topic_needs_no_name(self):
        run = self.run_with("ktgp_bag", self.bag, "out.bag")
        self.assertEqual(run.returncode, 0, run.stderr)
        self.assertIn("9 images of /camera/image_raw", run.stderr)
        self.assertEqual(sorted(p.name for p in self.folder.glob("out*")), ["out.bag"])

    def test_a_part_of_the_bag(self):
        run = self.run_with("ktgp_bag", self.bag, "out.bag", "--start", 0.09, "--duration", 0.1)
        self.assertEqual(run.returncode, 0, run.stderr)
        self.assertIn("3 images", run.stderr)
        self.refused("ktgp_bag", self.bag, "no.bag", "--start", "60", words="in the time asked for")
        for value in ("nan", "-1", "x"):
            for option in ("--start", "--duration"):
                self.refused("ktgp_bag", self.bag, "no.bag", f"{option}={value}", words=option)
        for option in ("--max_reference_age", "--keyframe_min_overlap", "--max_latency"):
            self.refused("ktgp_bag", self.bag, "no.bag", f"{option}=nan", words="expected a number")
        self.refused("make_demo_bag", "no.bag", "--seconds", "nan", words="--seconds")

    def test_the_recording_is_never_written(self):
        (self.folder / "soft.bag").symlink_to(self.bag.name)
        os.link(self.bag, self.folder / "hard.bag")
        for name in (self.bag, "soft.bag", "hard.bag"):
            self.refused("ktgp_bag", self.bag, "out.bag", "--csv", name, "--force",
                         words="is the input")
            self.refused("ktgp_bag", self.bag, name, "--force", words="is the input")
        self.refused("ktgp_bag", self.bag, "out.bag", "--csv", "out.bag",
                     words="is an output already")

    def test_an_earlier_result_outlives_every_failure(self):
        (self.folder / "out.bag").write_text("mine")
        for arguments in (("--csv", "no/such.csv"), ("--topic", "/none"), ("--T_w", "nan"),
                          ("--reference_mode", "fixed", "--reference_image", "none.png")):
            self.refused("ktgp_bag", self.bag, "out.bag", "--force", *arguments,
                         words=arguments[-1].replace("nan", "T_w"))
        self.refused("ktgp_bag", self.bag, "out.bag", words="--force")

    def test_a_full_disk_is_a_failure(self):
        (self.folder / "out.bag").write_text("mine")
        for limit in (100, 20000):
            self.refused("ktgp_bag", self.bag, "out.bag", "--force", words="out.bag",
                         preexec=small_files(limit))
        self.refused("make_demo_bag", "out.bag", "--force", "--seconds", "0.3", words="out.bag",
                     preexec=small_files(20000))

    def test_a_damaged_bag_is_called_so(self):
        content = self.bag.read_bytes()
        self.bag.write_bytes(content[:int(0.6 * len(content))])
        run = self.run_with("ktgp_bag", self.bag, "out.bag")
        self.assertEqual(run.returncode, 1, run.stderr)
        self.assertIn("damaged or cut off at byte", run.stderr)
        self.assertIn("images of /camera/image_raw matched", run.stderr)
        self.refused("ktgp_evaluate_bag", self.bag, words="is damaged")

    def test_devices_are_left_alone(self):
        for name in ("/dev/full", "/dev/null"):
            for arguments in ((self.bag, name), (self.bag, "out.bag", "--csv", name)):
                self.refused("ktgp_bag", *arguments, "--force", words="not a regular file")
            self.refused("make_demo_bag", name, "--force", words="not a regular file")

    def test_too_little_memory_for_the_threads_is_said(self):
        run = self.run_with("ktgp_bag", self.bag, "out.bag", "--threads", 256,
                            preexec=little_memory(900 << 20))
        self.assertEqual(run.returncode, 2, run.stderr)
        self.assertFalse((self.folder / "out.bag").exists())


if __name__ == "__main__":
    unittest.main()
