"""--help of every script prints what it is for, ends at once and changes nothing."""
import importlib.util
import os
import pathlib
import re
import subprocess
import unittest

ROOT = pathlib.Path(__file__).resolve().parents[2]


class Help(unittest.TestCase):
    def test_every_script_has_help(self):
        scripts = [path for folder in ("scripts", "dev", "examples/fleet") for path in (ROOT / folder).iterdir()
                   if path.is_file() and os.access(path, os.X_OK)]
        self.assertGreater(len(scripts), 20)
        if importlib.util.find_spec("rospy") is None:
            scripts = [path for path in scripts if "import rospy" not in path.read_text()]
        processes = {path: subprocess.Popen([path, "--help"], cwd="/", stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                                            stdin=subprocess.DEVNULL, text=True) for path in scripts}
        for path, process in processes.items():
            output, _ = process.communicate(timeout=100)
            with self.subTest(path.name):
                self.assertEqual(process.returncode, 0, output)
                self.assertGreater(len(output.split()), 8, output)
                self.assertNotIn("installing", output)
                self.assertNotIn("Traceback", output)
                self.assertNotIn("#!", output)

    def test_the_debian_packages_say_what_each_is_for(self):
        control = (ROOT / "debian/control").read_text()
        packages = dict(re.findall(r"^Package: (\S+)\n(.*?)(?=^Package: |\Z)", control, re.MULTILINE | re.DOTALL))
        titles = {re.search("^Description: (.*)", text, re.MULTILINE).group(1) for text in packages.values()}
        self.assertEqual(len(titles), len(packages))
        for words in ("matcher", "mosaic", "stabilizer", "flat targets", "motion above the ground"):
            self.assertIn(words, packages["ros-ktgp-orb"].replace("\n ", " "))
        pages = dict(re.findall(r'page (ktgp_\w+) "(.*?)"', (ROOT / "debian/rules").read_text()))
        self.assertGreaterEqual(len(pages), 5)
        self.assertEqual(len(set(pages.values())), len(pages))

    def test_every_part_of_nightly_has_a_row_with_its_last_result(self):
        listed = subprocess.run([ROOT / "dev/nightly", "--list"], stdout=subprocess.PIPE, text=True, check=True).stdout
        parts = [re.sub("^mutate_.*", "mutate_*", line.split()[0]) for line in listed.splitlines()]
        self.assertGreater(len(parts), 20)
        rows = re.findall(r"^\| (.*?) \|(.*)", (ROOT / "doc/measurements/nightly.md").read_text(), re.MULTILINE)
        named = [name for first, _ in rows[1:] for name in first.split(":")[0].split(", ")]
        self.assertEqual(set(named), set(parts))
        for first, rest in rows:
            self.assertTrue(rest.strip(" |"), first)

    def test_every_bound_of_security_has_its_test(self):
        rows = re.findall(r"^\| (.*) \| (.*) \| (.*) \|$", (ROOT / "SECURITY.md").read_text(), re.MULTILINE)[1:]
        self.assertGreater(len(rows), 8)
        known = {path.name.split(".")[0] for path in (ROOT / "test").rglob("*_test.*")}
        for what, _, tests in rows:
            names = [name.replace("long_", "") for name in re.findall("`(.*?)`", tests)]
            self.assertTrue(names, what)
            for name in names:
                self.assertTrue({name, name + "_test"} & known, what + ": " + name)
