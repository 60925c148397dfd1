#!/usr/bin/python3
"""scripts/demo with an existing build, on a short flight: it ends by itself and writes all its files."""

import os
import re
import subprocess
import sys
import tempfile
import unittest

import cv2
import numpy as np
import rosbag

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from ktgp_orb.msg import MatchStatus
from ktgp_testing import TIMEOUT

PACKAGE = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
BUILD = os.environ['KTGP_ORB_BUILD']
FRAMES = 60


def frames_of(path):
    video = cv2.VideoCapture(path)
    count = 0
    while video.read()[0]:
        count += 1
    return count


def messages(path, topic):
    with rosbag.Bag(path) as bag:
        return [message for _, message, _ in bag.read_messages(topic)]


def matrix(message):
    return np.reshape(message.homography, (3, 3))


def corner_error(found, truth):
    """Mean over the corners of the image, px."""
    corners = np.array([[0, 0, 1], [639, 0, 1], [639, 479, 1], [0, 479, 1]], float).T
    a, b = found @ corners, truth @ corners
    return np.mean(np.linalg.norm(a[:2] / a[2] - b[:2] / b[2], axis=0))


class DemoTest(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory(prefix='ktgp_orb it\'s "')
        self.addCleanup(folder.cleanup)
        self.folder = folder.name

    def demo(self, *arguments):
        environment = dict(os.environ)
        environment.pop('DISPLAY', None)
        return subprocess.run([os.path.join(PACKAGE, 'scripts', 'demo'), '--built', BUILD] +
                              list(arguments), stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                              universal_newlines=True, env=environment, timeout=5 * TIMEOUT)

    def test_leaves_what_it_says(self):
        output = os.path.join(self.folder, 'out')
        # So slow that a busy machine drops no frame.
        result = self.demo('--seconds', str(FRAMES // 30), '--rate', '0.1', output)
        self.assertEqual(result.returncode, 0, result.stdout)
        self.assertEqual(sorted(os.listdir(output)),
                         ['demo.bag', 'matches.mp4', 'mosaic.png', 'report.log', 'roslaunch.log',
                          'stabilized.mp4', 'stages.png', 'summary.txt'])
        for name in ('matches.mp4', 'stabilized.mp4'):
            self.assertIn(frames_of(os.path.join(output, name)), range(FRAMES - 2, FRAMES + 1), name)
        with open(os.path.join(output, 'summary.txt')) as file:
            self.assertIn(file.read(), result.stdout)
        mosaic = cv2.imread(os.path.join(output, 'mosaic.png'), cv2.IMREAD_UNCHANGED)
        self.assertEqual(mosaic.shape[2], 4)
        self.assertGreater((mosaic[:, :, 3] > 0).sum(), 1.1 * 640 * 480, 'more than one frame')
        error = float(re.search(r'off by ([0-9.]+) px', result.stdout).group(1))
        self.assertLess(error, 2.0, result.stdout)
        drift = re.search(r'motion +drift ([\d.]+) % of', result.stdout)
        self.assertTrue(drift, result.stdout)
        self.assertLess(float(drift.group(1)), 2.0, 'noise on the range and the Imu')
        self.assertEqual(cv2.imread(os.path.join(output, 'stages.png')).shape[2], 3)

    def test_the_target_of_the_demo_is_where_the_truth_says(self):
        flight, target, out = [os.path.join(self.folder, name)
                               for name in ('flight.bag', 'place.png', 'out.bag')]
        programs = os.path.join(BUILD, 'devel', 'lib', 'ktgp_orb')
        subprocess.check_call([os.path.join(programs, 'make_demo_bag'), '--seconds',
                               str(FRAMES // 30), '--target', target, flight])
        subprocess.check_call([os.path.join(programs, 'ktgp_bag'), flight, out, '--reference_mode',
                               'fixed', '--reference_image', target], stdout=subprocess.DEVNULL)
        found = messages(out, '/camera/matcher/homography')
        steps = [matrix(m) for m in messages(flight, '/camera/ground_truth/homography')]
        self.assertEqual((len(found), len(steps)), (FRAMES, FRAMES - 1))
        truth = [np.eye(3)]  # from the first frame
        for step in steps:
            truth.append(step @ truth[-1])
        to_first = np.linalg.inv(truth[FRAMES // 2])
        errors = [corner_error(matrix(m), h @ to_first) for m, h in zip(found, truth)
                  if m.status == MatchStatus.STATUS_OK]
        self.assertGreater(len(errors), 0.9 * FRAMES)
        self.assertLess(np.median(errors), 0.5)
        self.assertLess(np.max(errors), 5.0)

    def test_the_flight_tilts_as_asked(self):
        program = os.path.join(BUILD, 'devel', 'lib', 'ktgp_orb', 'make_demo_bag')
        for degrees in (0, 15):
            bag = os.path.join(self.folder, '%d.bag' % degrees)
            subprocess.check_call([program, '--seconds', '2', '--tilt', str(degrees), bag])
            for topic, noise in (('ground_truth/odometry', 0.1), ('imu', 2.5)):
                readings = messages(bag, '/camera/' + topic)
                self.assertEqual(len(readings), FRAMES)
                turns = [m.pose.pose.orientation if topic != 'imu' else m.orientation for m in readings]
                # The optical axis of the camera is the z axis of the Imu, and -z of the odometry.
                tilts = [np.degrees(np.arccos(min(1.0, abs(1 - 2 * (q.x ** 2 + q.y ** 2))))) for q in turns]
                self.assertLess(np.max(tilts), degrees * np.hypot(1, 0.8) + noise, topic)
                self.assertGreater(np.max(tilts), 0.5 * degrees, topic)
            # The range is along the optical axis, which is tilted; its noise is 1 %.
            height = [m.pose.pose.position.z for m in messages(bag, '/camera/ground_truth/odometry')]
            ranges = [m.range for m in messages(bag, '/camera/range')]
            truth = [z / np.cos(np.radians(t)) for z, t in zip(height, tilts)]
            self.assertLess(np.max(np.abs(np.divide(ranges, truth) - 1)), 0.06)

    def test_an_option_that_is_none_is_refused(self):
        result = self.demo('--no-such-option')
        self.assertEqual(result.returncode, 2)
        self.assertIn('--no-such-option', result.stdout)


if __name__ == '__main__':
    unittest.main()
