"""scripts/demo with an existing build, on a short flight: it ends by itself and writes all its files."""

import os
import re
import subprocess

import cv2
import numpy as np
from ktgp_orb.msg import MatchStatus
from ktgp_testing import TIMEOUT, FolderCase, messages_of

PACKAGE = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
BUILD = os.environ['KTGP_ORB_BUILD']
PROGRAMS = os.path.join(BUILD, 'devel', 'lib', 'ktgp_orb')
FRAMES = 60
REAL_VIDEO = '/usr/share/doc/opencv-doc/examples/data/vtest.avi'


def frames_of(path):
    video = cv2.VideoCapture(path)
    count = 0
    while video.read()[0]:
        count += 1
    return count


def is_inside(target):
    corners = np.reshape(target.corners, (4, 2))
    return (corners >= 0).all() and (corners < (640, 480)).all()


def corners_off(a, b):
    """Root mean square over the corners, px."""
    return np.sqrt(np.mean(np.sum(np.reshape(np.subtract(a.corners, b.corners), (4, 2)) ** 2, axis=1)))


class DemoTest(FolderCase):
    prefix = 'ktgp_orb it\'s "'
    timeout = 5 * TIMEOUT

    def demo(self, *arguments, **expected):
        environment = dict(os.environ)
        environment.pop('DISPLAY', None)
        return self.run_program(os.path.join(PACKAGE, 'scripts', 'demo'), '--built', BUILD, *arguments,
                                stderr=subprocess.STDOUT, env=environment, **expected)

    def test_videos_have_every_frame_and_the_counts_add_up(self):
        """At four times the speed a busy machine drops frames: the summary says so, and the videos have them.
        A matched.bag of the user is left alone."""
        os.mkdir(self.path('out'))
        self.write('out/matched.bag', 'of the user')
        result = self.demo('--seconds', FRAMES // 30, '--rate', '4', self.path('out'))
        real = ['real.csv', 'real.mp4'] if os.path.exists(REAL_VIDEO) else []
        self.assertEqual(sorted(os.listdir(self.path('out'))),
                         sorted(['demo.bag', 'demo_targets', 'ktgp_bag.log', 'matched.bag', 'matches.mp4', 'mosaic.csv',
                                 'mosaic.png', 'report.log', 'roslaunch.log', 'stabilized.mp4', 'stages.png',
                                 'summary.txt'] + real))
        self.assertEqual(self.read('out/matched.bag'), 'of the user')
        for name in ('matches.mp4', 'stabilized.mp4'):
            self.assertEqual(frames_of(self.path('out', name)), FRAMES, name)
        summary = self.read('out/summary.txt')
        for line in summary.splitlines():
            self.assertIn(line, result.stdout)
        in_bag, parts = re.search(r'frames in the bag (\d+) = (.*)', summary).groups()
        self.assertEqual(int(in_bag), FRAMES)
        self.assertEqual(sum(int(part) for part in re.findall(r' (\d+)(?: \+|$)', parts)), FRAMES, parts)
        processed = int(re.search(r'processed by the matcher (\d+)', summary).group(1))
        self.assertGreater(processed, 0)
        self.assertRegex(summary, r'frames processed +%d ' % processed)
        self.assertIn('%d images of' % FRAMES, summary)
        mosaic = cv2.imread(self.path('out', 'mosaic.png'), cv2.IMREAD_UNCHANGED)
        self.assertEqual(mosaic.shape[2], 4)
        self.assertGreater((mosaic[:, :, 3] > 0).sum(), 1.1 * 640 * 480, 'more than one frame')
        error = float(re.search(r'off by ([0-9.]+) px', summary).group(1))
        self.assertLess(error, 2.0, summary)
        drift = re.search(r'motion +drift ([\d.]+) % of', summary)
        self.assertTrue(drift, summary)
        if processed == FRAMES:  # across lost frames the path is only predicted; bag_evaluation has the bound
            self.assertLess(float(drift.group(1)), 2.0, 'noise on the range and the Imu')
        if real:
            self.assertEqual(frames_of(self.path('out', 'real.mp4')), 101, '0 to 10 s at 10 images/s, both ends')
            error = float(re.search(r'corner error, median ([0-9.]+) px', summary).group(1))
            self.assertLess(error, 0.5, 'the camera stands still')

    def test_the_targets_of_the_demo_are_where_the_truth_says(self):
        flight, out = self.path('flight.bag'), self.path('out.bag')
        self.run_program(os.path.join(PROGRAMS, 'make_demo_bag'), '--seconds', 7, '--targets', 'places', flight)
        self.assertEqual(sorted(os.listdir(self.path('places'))),
                         ['harbour.png', 'market.png', 'north.png', 'targets.yaml'])
        self.run_program(os.path.join(PROGRAMS, 'ktgp_bag'), flight, out, '--targets', 'places/targets.yaml')
        shown, errors, far, numbers = {}, {}, [], {}
        for found, truth in zip(messages_of(out, '/camera/targets/detections'),
                                messages_of(flight, '/camera/ground_truth/targets')):
            self.assertEqual(found.header.stamp, truth.header.stamp)
            for place in truth.detections:
                if is_inside(place):
                    shown[place.id, place.instance] = shown.get((place.id, place.instance), 0) + 1
            for target in found.detections:
                place = min((p for p in truth.detections if p.id == target.id),
                            key=lambda p: corners_off(target, p))
                if target.uncertain:
                    self.assertFalse(is_inside(place), 'only a part is in view')
                    continue
                self.assertEqual((target.status, target.has_pose), (MatchStatus.STATUS_OK, True))
                name = place.id, place.instance
                numbers.setdefault(name, set()).add(target.instance)
                if is_inside(place):
                    errors.setdefault(name, []).append(corners_off(target, place))
                    self.check_pose(target.pose.pose, place.pose.pose)
                else:  # corners outside the image are less certain
                    far.append(corners_off(target, place))
        print('shown', shown, 'found', {name: len(e) for name, e in errors.items()})
        everything = [error for each in errors.values() for error in each]
        print('corners off by %.2f px (median), %.2f px; partly in view %.2f, %.2f px' %
              (np.median(everything), np.max(everything), np.median(far), np.max(far)))
        self.assertEqual(set(shown), {('north', 0), ('north', 1), ('harbour', 0), ('market', 0)})
        self.assertGreaterEqual(len(everything), 0.97 * sum(shown.values()))
        for name, count in shown.items():
            self.assertGreater(count, 20)
            self.assertGreaterEqual(len(errors[name]), 0.9 * count, name)
        self.assertLess(np.median(everything), 0.15)
        self.assertLess(np.max(everything), 1.0)
        self.assertLess(np.max(far), 15.0, 'no wrong id')
        self.assertEqual({name: len(of) for name, of in numbers.items()}, {name: 1 for name in shown})
        self.assertNotEqual(numbers['north', 0], numbers['north', 1])

    def check_pose(self, found, truth):
        """Measured: off by 0.2 % of the distance and 0.6 degrees at most."""
        a, b = [np.array([p.position.x, p.position.y, p.position.z]) for p in (found, truth)]
        q, r = [np.array([p.orientation.x, p.orientation.y, p.orientation.z, p.orientation.w])
                for p in (found, truth)]
        self.assertLess(np.linalg.norm(a - b), 0.005 * b[2])
        self.assertLess(np.degrees(2 * np.arccos(min(1.0, abs(q @ r)))), 1.5)

    def test_the_flight_tilts_as_asked(self):
        for degrees in (0, 15):
            bag = self.path('%d.bag' % degrees)
            self.run_program(os.path.join(PROGRAMS, 'make_demo_bag'), '--seconds', 2, '--tilt', degrees, bag)
            for topic, noise in (('ground_truth/odometry', 0.1), ('imu', 2.5)):
                readings = messages_of(bag, '/camera/' + topic)
                self.assertEqual(len(readings), FRAMES)
                turns = [m.pose.pose.orientation if topic != 'imu' else m.orientation for m in readings]
                # The optical axis of the camera is the z axis of the Imu, and -z of the odometry.
                tilts = [np.degrees(np.arccos(min(1.0, abs(1 - 2 * (q.x ** 2 + q.y ** 2))))) for q in turns]
                self.assertLess(np.max(tilts), degrees * np.hypot(1, 0.8) + noise, topic)
                self.assertGreaterEqual(np.max(tilts), 0.5 * degrees, topic)
            # The range is along the optical axis, which is tilted; its noise is 1 %.
            height = [m.pose.pose.position.z for m in messages_of(bag, '/camera/ground_truth/odometry')]
            ranges = [m.range for m in messages_of(bag, '/camera/range')]
            truth = [z / np.cos(np.radians(t)) for z, t in zip(height, tilts)]
            self.assertLess(np.max(np.abs(np.divide(ranges, truth) - 1)), 0.06)

    def test_unknown_option_is_refused(self):
        self.demo('--no-such-option', code=2, prints='--no-such-option')


class BuildTest(FolderCase):
    def test_a_failed_build_is_shown_on_a_terminal_and_in_a_file(self):
        self.write('CMakeLists.txt', 'cmake_minimum_required(VERSION 3.10)\nproject(broken NONE)\n'
                                     'add_custom_target(broken COMMAND no_such_program)\n')
        script = ('set -euo pipefail; source "%s/scripts/environment"; cmake -S . -B build; '
                  'build build broken; echo it is built' % PACKAGE)
        for command in (['bash', '-c', script], ['script', '-qec', script, '/dev/null']):
            result = self.run_program(*command, code=1, stdin=subprocess.DEVNULL, stderr=subprocess.STDOUT,
                                      env=dict(os.environ, SHELL='/bin/bash'))
            self.assertRegex(result.stdout, 'no_such_program.*not found|No such file', command[0])
            self.assertNotIn('it is built', result.stdout)
