"""The CMake recipe of doc/cpp.md in the devel space of this build, as in a sourced workspace."""

import os
import subprocess
import unittest

CHECK = os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'package', 'check_core_package')


class CMakePackageTest(unittest.TestCase):
    def test_the_recipe_builds_and_unknown_components_are_refused(self):
        run = subprocess.run([CHECK, os.environ['KTGP_ORB_DEVEL']], stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                             universal_newlines=True)
        self.assertEqual(run.returncode, 0, run.stdout)
