"""The recipes for one's own code, as the documents print them: the library of doc/cpp.md in the devel space of this
build, and the node of doc/own_node.md in a workspace together with the package, in its devel and install spaces."""

import os
import subprocess
import unittest

PACKAGE = os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'package')


class CMakePackageTest(unittest.TestCase):
    def succeeds(self, script, *arguments, without=()):
        environment = {name: value for name, value in os.environ.items() if name not in without}
        run = subprocess.run([os.path.join(PACKAGE, script), *arguments], stdout=subprocess.PIPE,
                             stderr=subprocess.STDOUT, universal_newlines=True, env=environment)
        self.assertEqual(run.returncode, 0, run.stdout)

    def test_the_library_builds_and_unknown_components_are_refused(self):
        self.succeeds('check_core_package', os.environ['KTGP_ORB_DEVEL'])

    def test_the_node_builds_in_every_kind_of_workspace(self):
        # Without the devel space of this build, where the headers exist already.
        self.succeeds('check_node', without=('CMAKE_PREFIX_PATH', 'ROS_PACKAGE_PATH', 'LD_LIBRARY_PATH',
                                             'PKG_CONFIG_PATH', 'PYTHONPATH'))
