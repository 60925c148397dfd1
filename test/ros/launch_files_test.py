#!/usr/bin/python3
"""Every launch file loads, every argument is described, every parameter of the matcher exists."""

import glob
import os
import subprocess
import sys
import tempfile
import unittest
import xml.etree.ElementTree as xml

import roslaunch
sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from ktgp_testing import check_each
from roslaunch.config import load_config_default
from ktgp_orb.cfg import KtgpConfig

PACKAGE = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
FILES = sorted(glob.glob(os.path.join(PACKAGE, 'launch', '*.launch')))
STATIC_PARAMETERS = {'image_transport', 'queue_size'}


def load(path, bag):
    """The file as roslaunch understands it; a bag file where it takes one."""
    arguments = {element.get('name') for element in xml.parse(path).getroot().iter('arg')}
    values = ['bag:=' + bag] if 'bag' in arguments else []
    return load_config_default([(path, values)], None, verbose=False, assign_machines=False)


class LaunchFilesTest(unittest.TestCase):
    def setUp(self):
        self.bag = tempfile.NamedTemporaryFile(suffix='.bag')
        self.addCleanup(self.bag.close)

    def test_there_are_launch_files(self):
        names = {os.path.basename(path) for path in FILES}
        self.assertLessEqual({'matcher.launch', 'bag.launch', 'tune.launch', 'demo.launch'}, names)

    def test_every_file_passes_roslaunch(self):
        def check(path):
            config = load(path, self.bag.name)
            self.assertEqual(config.config_errors, [])
            self.assertTrue(config.nodes)
        check_each(FILES, check)

    def test_every_program_exists(self):
        optional = {'rviz'}
        for path in FILES:
            for node in load(path, self.bag.name).nodes:
                if node.package in optional:
                    continue
                machine = node.machine or roslaunch.core.local_machine()
                roslaunch.node_args.create_local_process_args(node, machine)  # raises if missing

    def test_every_argument_is_described(self):
        for path in FILES:
            for element in xml.parse(path).getroot().iterfind('arg'):
                self.assertTrue(element.get('doc'), '%s: %s' % (path, element.get('name')))

    def test_every_parameter_of_the_matcher_exists(self):
        known = set(KtgpConfig.defaults) | STATIC_PARAMETERS
        seen = set()
        for path in FILES:
            for name in load(path, self.bag.name).params:
                if '/matcher/' in name:
                    own = name.rsplit('/', 1)[1]
                    seen.add(own)
                    self.assertIn(own, known, '%s sets %s' % (path, name))
        self.assertEqual(set(KtgpConfig.defaults) - seen, set(),
                         'parameters that matcher.launch does not offer')

    def test_defaults_are_those_of_the_parameter_file(self):
        config = load(os.path.join(PACKAGE, 'launch', 'matcher.launch'), self.bag.name)
        for name, default in KtgpConfig.defaults.items():
            self.assertEqual(config.params['/camera/matcher/' + name].value, default, name)

    def test_a_missing_bag_is_named(self):
        for name in ('bag.launch', 'tune.launch'):
            result = subprocess.run(
                ['roslaunch', os.path.join(PACKAGE, 'launch', name), 'bag:=/no/such/file.bag'],
                stdout=subprocess.PIPE, stderr=subprocess.STDOUT, universal_newlines=True)
            self.assertNotEqual(result.returncode, 0)
            self.assertIn('/no/such/file.bag', result.stdout)
