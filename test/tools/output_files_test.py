"""No program destroys a file or reports a failure as success: runs ktgp_match, ktgp_evaluate and, if
they are built, ktgp_bag and make_demo_bag."""
import itertools
import json
import os
import pathlib
import random
import re
import resource
import signal
import subprocess
import time
import unittest

import cv2
import numpy as np
from tool_case import TOOLS, PairCase, picture, write_pgm

WITH_ROS = (TOOLS / "make_demo_bag").exists()


def setUpModule():
    # nohup, for example, ignores it, and programs inherit that.
    signal.signal(signal.SIGHUP, signal.SIG_DFL)


def small_files(limit):
    """For preexec_fn: writing a file beyond this size fails, as on a full disk."""
    def apply():
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
    return apply


def little_memory(limit):
    def apply():
        resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    return apply


def wait_for(condition):
    while not condition():
        time.sleep(0.001)


def catches(process, stop):
    """Whether a program has a handler for this signal."""
    status = pathlib.Path(f"/proc/{process.pid}/status").read_text(encoding="ascii")
    return int(re.search(r"SigCgt:\s+(\w+)", status).group(1), 16) & (1 << (stop - 1))


def size(path):
    try:
        return path.stat().st_size
    except FileNotFoundError:  # it has its name by now
        return 0


class OutputCase(PairCase):
    timeout = 300

    def contents(self):
        return {path.name: path.read_bytes() for path in self.folder.iterdir() if path.is_file()}

    def refused(self, tool, *arguments, words, **options):
        """It ends with 2 and one line with the reason, and has neither changed nor left a file."""
        before = self.contents()
        self.run_tool(tool, *arguments, code=2, words=words, **options)
        self.assertEqual(self.contents(), before, arguments)


class KilledRuns(OutputCase):
    """A run that is killed at any time is done again by the same command, and leaves nothing else behind."""
    ALL = os.environ.get("KTGP_ORB_ALL_FAULTS")

    def names(self):
        return {path.name for path in self.folder.iterdir()}

    def check_killed_at_each_name(self, *command, primary, outputs):
        """Kills it at every call that gives a file its name or takes one; a second run then has all outputs."""
        inputs = self.names()
        kill_at, killed = 1, True
        while killed:
            environment = dict(os.environ, LD_PRELOAD=os.environ["KTGP_ORB_FAULTS"], KTGP_ORB_KILL_AT=str(kill_at))
            killed = self.run_tool(*command, code=None, env=environment).returncode == -signal.SIGKILL
            is_done = (self.folder / primary).exists() and os.stat(self.folder / primary).st_nlink == 1
            run = self.run_tool(*command, code=None)
            self.assertEqual(run.returncode, 2 if is_done and "--skip_finished" not in command else 0,
                             (kill_at, run.stderr))
            left = {name for name in self.names() - inputs if not (is_done and "unfinished" in name)}
            self.assertEqual(left, set(outputs), kill_at)
            for name in outputs:
                self.assertGreater(size(self.folder / name), 100, name)
            for name in self.names() - inputs:
                (self.folder / name).unlink()
            kill_at += 1
        self.assertGreater(kill_at, 2 * len(outputs))

    def test_of_a_pair_or_a_list_of_pairs(self):
        self.check_killed_at_each_name("ktgp_match", "a.pgm", "b.pgm", "--json", "m.json", "--csv", "m.csv", "--draw",
                                       "m.png", primary="m.png", outputs=["m.json", "m.csv", "m.png"])
        self.check_killed_at_each_name("ktgp_evaluate", "pairs.txt", "--methods", "KT", "--json", "e.json", "--csv",
                                       "e.csv", primary="e.csv", outputs=["e.json", "e.csv"])

    def make_bag(self):
        self.run_tool("make_demo_bag", "in.bag", "--seconds", "0.3")
        return "ktgp_bag", "in.bag", "out.bag", "--features", "200", "--threads", "1"

    @unittest.skipUnless(WITH_ROS, "built without ROS")
    def test_of_a_recording_while_its_files_get_their_names(self):
        command = self.make_bag()
        outputs = ["--csv", "o.csv", "--draw", "d.mp4", "--mosaic", "o.png", "--mosaic_poses", "p.csv",
                   "--stabilize", "o.mp4"]
        self.check_killed_at_each_name(*command, *outputs, "--skip_finished", primary="out.bag",
                                       outputs=["out.bag"] + outputs[1::2])

    def faults(self, **variables):
        return dict(os.environ, LD_PRELOAD=os.environ["KTGP_ORB_FAULTS"],
                    **{f"KTGP_ORB_{name}": str(value) for name, value in variables.items()})

    def writes_of(self, *command):
        """The number of its writes to files."""
        self.run_tool(*command, env=self.faults(COUNT=self.folder / "count"))
        count = int((self.folder / "count").read_text())
        (self.folder / "count").unlink()
        return count

    @unittest.skipUnless(WITH_ROS, "built without ROS")
    def test_of_a_recording_at_any_time(self):
        """Killed at a random one of its writes: between two of them nothing changes that a second run could see."""
        command = self.make_bag() + ("--skip_finished",)
        inputs = self.names()
        mosaic, stabilizer = ("--mosaic", "o.png"), ("--stabilize", "o.mp4")
        motion = "--motion", "g.csv", "--motion_base_frame", "", "--motion_normal_source", "imu"
        combinations = [sum(parts, ()) for parts in itertools.product(
            ((), ("--csv", "o.csv")), ((), ("--draw", "d.mp4")),
            ((), mosaic, mosaic + ("--mosaic_poses", "p.csv")),
            ((), stabilizer, stabilizer + ("--stabilizer_warps", "w.csv")), ((), motion))]
        random_ = random.Random(5)
        for chosen in combinations if self.ALL else random_.sample(combinations, 4):
            outputs = {"out.bag", *(name for name in chosen[1::2] if "." in name)}
            writes = self.writes_of(*command, *chosen)
            for _ in range(3 if self.ALL else 2):
                for name in outputs:
                    (self.folder / name).unlink()
                kill_at = random_.randint(1, writes)
                run = self.run_tool(*command, *chosen, code=None, env=self.faults(KILL_WRITE=kill_at))
                where = (chosen, kill_at, writes, run.stderr)
                self.assertEqual(run.returncode, -signal.SIGKILL, where)
                self.run_tool(*command, *chosen)
                self.assertEqual(self.names() - inputs, outputs, where)
                self.run_tool(*command, *chosen, words="out.bag is finished")
            for name in outputs:
                (self.folder / name).unlink()

    @unittest.skipUnless(WITH_ROS, "built without ROS")
    def test_of_a_fleet_that_xargs_runs(self):
        """The same line of xargs does the rest after a run that was killed, and then nothing."""
        for name in "ab":
            self.run_tool("make_demo_bag", name + ".bag", "--seconds", "0.3")
        line = ["xargs", "-P", "2", "-I{}", TOOLS / "ktgp_bag", "{}.bag", "{}_out.bag", "--features", "200",
                "--mosaic", "{}.png", "--skip_finished"]

        def run(**options):
            return subprocess.run(line, input="a\nb\n", cwd=self.folder, text=True, capture_output=True,
                                  timeout=self.timeout, check=False, **options)
        writes = self.writes_of("ktgp_bag", "a.bag", "a_out.bag", "--features", "200", "--mosaic", "a.png")
        for name in ("a_out.bag", "a.png"):
            (self.folder / name).unlink()
        self.assertNotEqual(run(env=self.faults(KILL_WRITE=writes * 3 // 4)).returncode, 0)
        for words in ("", "is finished"):
            again = run()
            self.assertEqual(again.returncode, 0, again.stderr)
            self.assertIn(words, again.stdout + again.stderr)
            self.assertLessEqual({"a_out.bag", "a.png", "b_out.bag", "b.png"}, self.names())

    def check_limit(self, limit, *command, file):
        """A limit of the shell (ulimit -f) is said as a full disk is: its signal does not end the program."""
        self.refused(*command, words=f"{file}: cannot be written: File too large",
                     preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)))

    def test_a_limit_of_the_shell_is_said_of_each_file_about_pictures(self):
        (self.folder / "posters").mkdir()
        write_pgm(self.folder / "posters/poster.pgm", picture(), 20, 20)
        pairs = "pairs.txt", "--methods", "KT"
        for command, option, name in ((("ktgp_match", "a.pgm", "b.pgm"), "--csv", "o.csv"),
                                      (("ktgp_match", "a.pgm", "b.pgm"), "--json", "o.json"),
                                      (("ktgp_match", "a.pgm", "b.pgm"), "--draw", "o.png"),
                                      (("ktgp_find", "b.pgm", "posters"), "--json", "o.json"),
                                      (("ktgp_find", "b.pgm", "posters"), "--draw", "o.png"),
                                      (("ktgp_evaluate", *pairs), "--csv", "o.csv"),
                                      (("ktgp_evaluate", *pairs), "--json", "o.json")):
            with self.subTest(command + (option,)):
                self.check_limit(100, *command, option, name, file=name)

    @unittest.skipUnless(WITH_ROS, "built without ROS")
    def test_a_limit_of_the_shell_is_said_of_each_file_of_a_recording(self):
        (self.folder / "images").mkdir()
        noise = np.random.RandomState(1).randint(0, 256, (500, 700), np.uint8)
        for i in range(6):
            cv2.imwrite(self.path("images", f"{i}.png"), noise[2 * i:480 + 2 * i, 5 * i:640 + 5 * i])
        command = "ktgp_bag", "images/*.png", "out.bag", "--features", "100"
        for option, name in (("--csv", "o.csv"), ("--draw", "o.mp4"), ("--stabilize", "o.mp4"), ("--mosaic", "o.png")):
            with self.subTest(option):
                self.check_limit(512, *command, option, name, file="out.bag")
                if option != "--csv":  # out.bag has 41 kB, the videos 170 and 200, the mosaic 1111
                    self.check_limit(100000, *command, option, name, file=name)
        self.make_bag()
        if (TOOLS / "ktgp_evaluate_bag").exists():
            self.check_limit(512, "ktgp_evaluate_bag", "in.bag", "--json", "o.json", file="o.json")

    @unittest.skipUnless(WITH_ROS, "built without ROS")
    def test_a_limit_of_the_shell_is_said_of_a_table_that_is_larger_than_its_bag(self):
        """Each picture that cannot be used has a row in the table, and nothing in the bag."""
        (self.folder / "images").mkdir()
        cv2.imwrite(self.path("images", "0.png"), picture())
        for i in range(1, 1500):
            self.write(f"images/{i}.png", "no image")
        self.check_limit(60000, "ktgp_bag", "images/*.png", "out.bag", "--csv", "o.csv", file="o.csv")


class MatchOutput(OutputCase):
    def refuses(self, *options, **expected):
        self.refused("ktgp_match", "a.pgm", "b.pgm", *options, **expected)

    def test_existing_files_are_replaced_only_when_forced(self):
        for option in ("--json", "--csv", "--draw", "--draw-stages", "--draw-final"):
            self.write("out.png", "mine")
            self.refuses(option, "out.png", words="--force")
            self.run_tool("ktgp_match", "a.pgm", "b.pgm", option, "out.png", "--force")
            self.assertGreater((self.folder / "out.png").stat().st_size, 1000)

    def test_a_dash_is_the_standard_output(self):
        before = self.contents()
        for tool, arguments in (("ktgp_match", ("a.pgm", "b.pgm")),
                                ("ktgp_evaluate", ("pairs.txt", "--methods", "KTGP"))):
            run = self.run_tool(tool, *arguments, "--json", "-")
            self.assertIn("options", json.loads(run.stdout))
            run = self.run_tool(tool, *arguments, "--csv", "-")
            self.assertEqual(len({line.count(",") for line in run.stdout.splitlines()}), 1, run.stdout[:300])
            self.refused(tool, *arguments, "--csv", "-", "--json", "-", words="is an output already")
        self.assertEqual(self.contents(), before)

    def test_an_output_is_never_an_input_nor_another_output(self):
        (self.folder / "soft.png").symlink_to("a.pgm")
        os.link(self.folder / "a.pgm", self.folder / "hard.png")
        for name in ("a.pgm", "./a.pgm", "soft.png", "hard.png"):
            for option in ("--draw", "--csv", "--json") if name.endswith(".png") else ("--csv", "--json"):
                self.refuses(option, name, "--force", words="is the file of")
        self.refuses("--ground-truth", "H.txt", "--json", "H.txt", "--force", words="is the file of")
        (self.folder / "dangling").symlink_to("new.csv")
        self.refuses("--csv", "new.csv", "--json", "dangling", words="is the file of --json and --csv")
        self.write("tuned.yaml", "T_w: 0.8\n")
        self.refuses("--params", "tuned.yaml", "--csv", "./tuned.yaml", "--force",
                     words="is the file of --csv and --params")

    def test_a_link_stays_a_link(self):
        self.write("target.csv", "old")
        (self.folder / "link.csv").symlink_to("target.csv")
        self.run_tool("ktgp_match", "a.pgm", "b.pgm", "--csv", "link.csv", "--force")
        self.assertTrue((self.folder / "link.csv").is_symlink())
        self.assertIn("reference_index", self.read("target.csv"))

    def test_only_regular_files_are_replaced(self):
        os.mkfifo(self.folder / "fifo")
        (self.folder / "folder").mkdir()
        for name in ("/dev/full", "/dev/null", "fifo", "folder"):
            self.refuses("--csv", name, "--force", words="not a regular file")

    def test_an_unwritable_place_is_named_before_any_work(self):
        self.refuses("--csv", "no/such/out.csv", words="no/such/out.csv")
        if os.getuid() != 0:
            (self.folder / "locked").mkdir(mode=0o500)
            self.refuses("--csv", "locked/out.csv", words="locked/out.csv")

    def test_a_full_disk_is_a_failure_and_leaves_what_was_there(self):
        self.write("out.ppm", "mine")
        for option in ("--draw", "--csv", "--json"):
            self.refuses(option, "out.ppm", "--force", words="out.ppm", preexec_fn=small_files(512))

    def test_a_full_standard_output_is_a_failure(self):
        with open("/dev/full", "w", encoding="ascii") as full:
            for tool, arguments in (("ktgp_match", ("a.pgm", "b.pgm")),
                                    ("ktgp_evaluate", ("pairs.txt", "--methods", "KT"))):
                self.run_tool(tool, *arguments, stdout=full, code=2, words="standard output")

    def test_too_little_memory_for_the_threads_is_said(self):
        self.run_tool("ktgp_match", "a.pgm", "b.pgm", "--threads", 256, preexec_fn=little_memory(700 << 20), code=2,
                      words="fewer")

    def test_version_and_codes_are_the_same_everywhere(self):
        tools = ["ktgp_match", "ktgp_evaluate"]
        tools += ["ktgp_bag", "ktgp_evaluate_bag", "make_demo_bag"] if WITH_ROS else []
        for tool in tools:
            self.assertRegex(self.run_tool(tool, "--version").stdout, r"^ktgp_orb \d+\.\d+\.\d+\n$")
            text = self.run_tool(tool, "--help", prints=f"Usage: {tool} ").stdout
            for words in ("Exit code: 0 ", ", 1 ", ", 2 ", "130 interrupted (Ctrl-C)", "--force"):
                self.assertIn(words, text.replace("\n", " "), tool)

    def test_an_ending_that_is_no_pictures_is_refused_before_any_work(self):
        self.write("text.png", "no image")  # would be read first
        for name in ("out", "out.xyz", "out.csv", "out.pgm", "out.pbm", "out.exr"):
            for option in ("--draw", "--draw-stages", "--draw-final"):
                self.refused("ktgp_match", "text.png", "b.pgm", option, name, words="expected .png")

    def test_matches_are_drawn_with_each_ending_that_is_recommended(self):
        for ending in ("png", "JPG", "tiff", "bmp", "ppm", "hdr"):
            self.run_tool("ktgp_match", "a.pgm", "b.pgm", "--draw", f"out.{ending}")
            self.assertIsNotNone(cv2.imread(self.path(f"out.{ending}")), ending)

    def test_names_that_are_not_utf_8_are_written(self):
        name = os.fsencode(self.folder) + b"/caf\xe9.pgm"
        pathlib.Path(os.fsdecode(name)).write_bytes((self.folder / "a.pgm").read_bytes())
        (self.folder / "latin.txt").write_bytes(b"ab caf\xe9.pgm b.pgm H.txt\nno \xe9 b.pgm H.txt\n")
        self.run_tool("ktgp_evaluate", "latin.txt", "--json", "out.json", "--methods", "KT", code=1)  # one is missing
        self.assertIn("\\xe9: is missing", self.json()["problems"][0])
        self.run_tool("ktgp_match", os.fsdecode(name), "b.pgm", "--json", "match.json")
        found = self.json("match.json")
        self.assertTrue(found["reference"]["file"].endswith("caf\ufffd.pgm"))

    def test_a_device_is_no_parameter_file(self):
        self.refuses("--params", "/dev/zero", words="longer than 1 MB", preexec_fn=little_memory(700 << 20))


class EvaluateOutput(OutputCase):
    def test_parameters_that_the_preset_of_two_views_replaces_are_named(self):
        camera = "300 300 160 120 1 0 0 0 1 0 0 0 1"
        self.write("cameras.txt", f"a.pgm {camera} 0 0 0\nb.pgm {camera} 1 0 0\n")
        (self.folder / "pairs.txt").unlink()
        words = "without effect in this run: T_w, mutual\n"
        for file, is_said in (("T_w: 0.8\nmutual: true\nfeatures: 1000\n", True),
                              ("T_w: 0.8\nmutual: true\nfeatures: 1000\ngeometry: auto\n", False)):
            self.write("tuned.yaml", file)
            run = self.run_tool("ktgp_evaluate", "--two-view", ".", "--methods", "SLAM", "--params", "tuned.yaml")
            self.assertEqual(words in run.stderr, is_said, run.stderr)

    def test_outputs_are_checked_as_everywhere(self):
        for option in ("--json", "--csv"):
            self.refused("ktgp_evaluate", "pairs.txt", option, "pairs.txt", "--force",
                         words="is the file of")
            self.write("out", "mine")
            self.refused("ktgp_evaluate", "pairs.txt", option, "out", words="--force")
            self.write("tuned.yaml", "T_w: 0.8\n")
            self.refused("ktgp_evaluate", "pairs.txt", "--params", "tuned.yaml", option, "tuned.yaml",
                         "--force", words="and --params")
        self.refused("ktgp_evaluate", "pairs.txt", "--csv", "x", "--json", "x",
                     words="--csv")

    def test_what_a_data_set_consists_of_is_not_overwritten(self):
        for name in ("a.pgm", "H.txt"):
            self.refused("ktgp_evaluate", "pairs.txt", "--csv", name, "--force", words="is the input")
        self.refused("ktgp_evaluate", "--warps", "small", "--warp-pairs", "1", ".", "--json", "b.pgm",
                     "--force", words="is the input")
        camera = "300 300 160 120 1 0 0 0 1 0 0 0 1"
        self.write("cameras.txt", f"a.pgm {camera} 0 0 0\nb.pgm {camera} 1 0 0\n")
        # Also where pairs.txt, a list of image files here, cannot be read as a list of rows.
        for name in ("cameras.txt", "b.pgm", "pairs.txt"):
            self.refused("ktgp_evaluate", "--two-view", ".", "--csv", name, "--force", words="is the input")

    def test_too_little_memory_for_the_jobs_is_said(self):
        self.run_tool("ktgp_evaluate", "pairs.txt", "--jobs", 256, preexec_fn=little_memory(700 << 20), code=2)

    def test_ctrl_c_and_a_closed_terminal_end_with_130(self):
        for stop in (signal.SIGINT, signal.SIGHUP):
            process = self.start(TOOLS / "ktgp_evaluate", "pairs.txt", "--repeat", "1000", "--json", "out.json")
            wait_for(lambda: catches(process, stop) or process.poll() is not None)
            process.send_signal(stop)
            process.communicate(timeout=60)
            self.assertEqual(process.returncode, 130)
            self.assertFalse((self.folder / "out.json").exists())

    def test_a_list_without_a_pair_is_named(self):
        for text in ("", "# nothing\n\n"):
            self.write("empty.txt", text)
            self.run_tool("ktgp_evaluate", "empty.txt", code=1, words="empty.txt: names no pair")

    def test_a_bag_belongs_to_another_program(self):
        self.refused("ktgp_evaluate", "--bag", "some.bag", words="ktgp_evaluate_bag some.bag")


@unittest.skipUnless(WITH_ROS, "built without ROS")
class RecordingCase(OutputCase):
    """Has a recording of nine images."""

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


class BagOutput(RecordingCase):
    def refuses(self, *options, **expected):
        self.refused("ktgp_bag", self.bag, "out.bag", *options, **expected)

    def test_the_only_image_topic_needs_no_name(self):
        self.run_tool("ktgp_bag", self.bag, "out.bag", words="9 images of /camera/image_raw")
        self.assertEqual(sorted(p.name for p in self.folder.glob("out*")), ["out.bag"])

    def test_a_part_of_the_bag(self):
        self.run_tool("ktgp_bag", self.bag, "out.bag", "--start", 0.09, "--duration", 0.1, words="3 images")
        self.refused("ktgp_bag", self.bag, "no.bag", "--start", "60", words="in the selected time")
        for value in ("nan", "-1", "x"):
            for option in ("--start", "--duration"):
                self.refused("ktgp_bag", self.bag, "no.bag", f"{option}={value}", words=option)
        for option in ("--max_reference_age", "--prosac_threshold"):
            self.refused("ktgp_bag", self.bag, "no.bag", f"{option}=nan", words="expected a number")
        self.refused("make_demo_bag", "no.bag", "--seconds", "nan", words="--seconds")

    def test_a_file_that_appears_during_the_run_is_not_overwritten(self):
        for option, name in ((None, "out.bag"), ("--csv", "out.csv"), ("--stabilize", "out.mp4"),
                             ("--mosaic", "out.png")):
            with self.subTest(name):
                arguments = [name] if option is None else [f"{name}.bag", option, name]
                process = self.start(TOOLS / "ktgp_bag", self.bag, *arguments, "--features", "200", "--threads", "1")
                # Something is in it when all outputs have been checked.
                wait_for(lambda: process.poll() is not None or
                         any(size(path) for path in self.folder.glob("*.unfinished*.bag")))
                process.send_signal(signal.SIGSTOP)
                stopped_in_time = not (self.folder / name).exists()
                self.write(name, "mine")
                process.send_signal(signal.SIGCONT)
                error = process.communicate(timeout=60)[1]
                self.assertTrue(stopped_in_time)
                self.assertEqual(process.returncode, 2, error)
                self.assertIn("was written by another program meanwhile", error)
                self.assertEqual(self.read(name), "mine")

    def test_one_of_two_runs_to_one_output_fails(self):
        runs = [self.start(TOOLS / "ktgp_bag", self.bag, "out.bag") for _ in range(2)]
        for run in runs:
            run.communicate(timeout=120)
        self.assertEqual(sorted(run.returncode for run in runs), [0, 2])

    def test_a_rerun_takes_over_what_a_killed_one_left(self):
        run = self.start(TOOLS / "ktgp_bag", self.bag, "out.bag", "--csv", "out.csv")
        wait_for(lambda: list(self.folder.glob("out.unfinished*.csv")) or run.poll() is not None)
        run.kill()
        run.communicate(timeout=60)
        self.assertTrue(list(self.folder.glob("out.unfinished*")))
        self.write("mine", "mine")
        (self.folder / "out.unfinished1.bag").symlink_to("mine")
        self.run_tool("ktgp_bag", self.bag, "out.bag", "--csv", "out.csv", "--force")
        self.assertEqual(sorted(p.name for p in self.folder.glob("out*")),
                         ["out.bag", "out.csv", "out.unfinished1.bag"])
        self.assertEqual(self.read("mine"), "mine")

    def test_a_closed_terminal_leaves_what_was_done(self):
        run = self.start(TOOLS / "ktgp_bag", self.bag, "out.bag", "--threads", "1")
        wait_for(lambda: list(self.folder.glob("out.unfinished*")) or run.poll() is not None)
        run.send_signal(signal.SIGSTOP)
        self.assertTrue(catches(run, signal.SIGHUP))
        run.send_signal(signal.SIGHUP)
        run.send_signal(signal.SIGCONT)
        run.communicate(timeout=60)
        self.assertIn(run.returncode, (0, 130))
        self.assertEqual([p.name for p in self.folder.glob("out*")], ["out.bag"])

    def test_an_ending_of_no_use_is_refused_before_any_work(self):
        self.bag.write_text("no bag")  # would be read first
        for option, expected in (("--mosaic", "expected .png"), ("--stabilize", "expected .mp4")):
            for name in ("zzz", "x.xyz", "x.csv"):
                self.refuses(option, name, words=expected)
        for ending in ("ppm", "pnm", "pgm", "pbm", "pfm", "hdr", "pic", "exr", "ras"):
            self.refuses("--mosaic", f"map.{ending}", words="with transparent parts; expected .png or .tiff")

    def test_a_mosaic_is_written_with_each_ending_that_is_accepted(self):
        for ending in ("png", "PNG", "tiff", "jpg", "bmp"):
            self.run_tool("ktgp_bag", self.bag, "out.bag", "--mosaic", f"map.{ending}", "--force")
            self.assertGreater(np.median(cv2.imread(self.path(f"map.{ending}"))), 20, ending)

    def test_an_empty_name_is_refused(self):
        for option in ("--csv", "--params", "--mosaic", "--stabilize", "--draw", "--motion", "--targets"):
            self.refuses(option, "", words=f"{option} is empty; expected a file")
        self.refuses("--mosaic", "map.png", "--mosaic_poses", "", words="--mosaic_poses is empty; expected a file")
        self.refused("ktgp_bag", self.bag, "", words="OUT.bag is empty; expected a file")
        self.refused("ktgp_bag", "", "out.bag", words="IN is empty; expected a file")
        self.run_tool("ktgp_bag", self.bag, "out.bag", "--mask_image", "", "--roi=")  # none: the defaults

    def test_options_without_effect_are_refused(self):
        for arguments, reason in (
                (("--calibration", "raw"), "--targets"), (("--lazy", "false"), "not expected: --lazy"),
                (("--max_latency", "1"), "not expected"),
                (("--reference_image", "a.pgm"), "fixed"),
                (("--overlay_style", "flow"), "--overlay"),
                (("--motion", "m", "--motion_height", "5"), "--motion_height_source parameter"),
                (("--motion", "m", "--motion_height_source", "tf_height", "--motion_range", "/a"),
                 "--motion_height_source range"),
                (("--motion", "m", "--motion_imu", "/a"), "--motion_normal_source imu or --motion_gyro"),
                (("--stabilizer_lag", "3"), "--stabilize"), (("--mosaic_poses", "x"), "--mosaic")):
            self.refuses(*arguments, words=reason)
        self.refuses("--reference_mode", "fixed", words="there is no reference")
        self.write("node.yaml", "lazy: false\nmax_latency: 1.0\n")
        self.run_tool("ktgp_bag", self.bag, "out.bag", "--params", "node.yaml")  # parameters of a node are not an error

    def test_topics_have_names_that_ros_takes(self):
        for name in ("/", "9x", "a//b", "a b", "~x", "a/", "", "//a"):
            self.refuses(f"--name={name}", words="expected letters, digits and _")
        for name in ("/robot1/matcher", "robot", "a_b/2"):
            self.run_tool("ktgp_bag", self.bag, "out.bag", "--force", "--name", name)

    def test_a_readout_time_has_a_meaning(self):
        for arguments in (("--motion", "m.csv", "--motion_readout_time=-0.5"),
                          ("--targets", ".", "--targets_readout_time=-0.5")):
            self.refuses(*arguments, words="expected -1, not known, 0, a global shutter, or up to 0.2 s")

    def test_the_ranges_are_those_of_the_node(self):
        for option, value, expected in (("--T_G", "45", "[0, 40]"), ("--max_reference_age", "601", "600]"),
                                        ("--stabilizer_lag", "31", "[0, 30]")):
            self.refuses("--stabilize", "x.mp4", option, value, words=expected)
        self.run_tool("ktgp_bag", self.bag, "out.bag", "--max_reference_age", "120")

    def test_matched_images_are_counted(self):
        run = self.run_tool("ktgp_bag", self.bag, "out.bag", "--max_rate", "10", "--csv", "out.csv")
        rows = len(self.read("out.csv").splitlines()) - 1
        self.assertIn(f"{rows} images of /camera/image_raw matched, 0 refused, {9 - rows} skipped",
                      run.stderr)

    def test_the_recording_is_never_written(self):
        (self.folder / "soft.bag").symlink_to(self.bag.name)
        os.link(self.bag, self.folder / "hard.bag")
        for name in (self.bag, "soft.bag", "hard.bag"):
            self.refuses("--csv", name, "--force", words="is the file of")
            self.refused("ktgp_bag", self.bag, name, "--force", words="is the file of")
        self.refuses("--csv", "out.bag", words="--csv")

    def test_no_file_that_is_read_is_written(self):
        self.write("tuned.yaml", "T_w: 0.8\n")
        self.write("fixed.yaml", "reference_mode: fixed\nreference_image: a.pgm\n")
        for option, name in (("--params", "tuned.yaml"), ("--mask_image", "a.pgm")):
            for output in ("--csv", "--motion"):
                self.refuses(option, name, output, name, "--force", words="is the file of ")
        self.refuses("--params", "fixed.yaml", "--csv", "a.pgm", "--force",
                     words="is the input a.pgm")  # named by the parameters
        self.refused("ktgp_evaluate_bag", self.bag, "--params", "tuned.yaml", "--json", "tuned.yaml",
                     "--force", words="and --params")

    def test_an_earlier_result_outlives_every_failure(self):
        self.write("out.bag", "mine")
        for arguments in (("--csv", "no/such.csv"), ("--topic", "/none"), ("--T_w", "nan"),
                          ("--reference_mode", "fixed", "--reference_image", "none.png")):
            self.refuses("--force", *arguments, words=arguments[-1].replace("nan", "T_w"))
        self.refuses(words="--force")

    def test_a_full_disk_is_a_failure(self):
        self.write("out.bag", "mine")
        for limit in (100, 20000):
            self.refuses("--force", words="out.bag", preexec_fn=small_files(limit))
        self.refused("make_demo_bag", "out.bag", "--force", "--seconds", "0.3", words="out.bag",
                     preexec_fn=small_files(20000))

    def test_a_damaged_bag_is_called_so(self):
        self.damage(self.bag, 0.6)
        self.run_tool("ktgp_bag", self.bag, "out.bag", code=1, words=("damaged or cut off at byte",
                                                                      "images of /camera/image_raw matched"))
        self.run_tool("ktgp_evaluate_bag", self.bag, code=1, words="damaged or cut off at byte",
                      prints="frames, homography for")

    def test_devices_are_left_alone(self):
        for name in ("/dev/full", "/dev/null"):
            for arguments in ((self.bag, name), (self.bag, "out.bag", "--csv", name)):
                self.refused("ktgp_bag", *arguments, "--force", words="not a regular file")
            self.refused("make_demo_bag", name, "--force", words="not a regular file")

    def test_too_little_memory_for_the_threads_is_said(self):
        self.run_tool("ktgp_bag", self.bag, "out.bag", "--threads", 256, preexec_fn=little_memory(900 << 20), code=2)
        self.assertFalse((self.folder / "out.bag").exists())
