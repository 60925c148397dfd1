#!/usr/bin/python3
"""ktgp_evaluate_bag on the demo bag, which contains the truth."""

import json
import os
import subprocess
import tempfile
import unittest

TOOL, BAG = os.environ['KTGP_ORB_EVALUATE'], os.environ['KTGP_ORB_DEMO_BAG']


class BagEvaluationTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        cls.run_result = cls.evaluate(BAG, '--json', 'out.json')
        cls.addClassCleanup(cls.folder.cleanup)

    @classmethod
    def evaluate(cls, bag, *options):
        return subprocess.run([TOOL, bag] + list(options), cwd=cls.folder.name,
                              stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                              universal_newlines=True)

    def test_every_frame_is_matched_close_to_the_truth(self):
        self.assertEqual(self.run_result.returncode, 0, self.run_result.stderr)
        with open(os.path.join(self.folder.name, 'out.json')) as file:
            sequence = json.load(file)['sequence']
        self.assertEqual(len(sequence['frames']), 300)
        errors = sorted(frame['corner_error'] for frame in sequence['frames']
                        if frame.get('corner_error') is not None)
        self.assertGreater(len(errors), 290)
        self.assertLess(errors[len(errors) // 2], 0.5)
        self.assertLess(errors[int(0.95 * len(errors))], 1.5)

    def test_a_missing_bag_is_named(self):
        run = self.evaluate('no_such.bag')
        self.assertNotEqual(run.returncode, 0)
        self.assertIn('no_such.bag', run.stderr)
