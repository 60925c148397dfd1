"""The combined message equals the messages of the three topics, for every frame."""

import os
import re
import subprocess

import numpy as np
import rosgraph
import rospy
from ktgp_orb.msg import MatchStatus
from ktgp_testing import MatcherCase, wait_until


class MatchMessageTest(MatcherCase):
    topics = 'correspondences', 'homography', 'statistics', 'match'

    def test_match_equals_the_single_topics(self):
        self.match.wait_for(self.camera.send_view())
        for _ in range(3):
            sent = rospy.get_time()
            stamp = self.camera.send_view()
            match = self.match.wait_for(stamp)
            ready = stamp.to_sec() + 1e-3 * match.statistics.latency_milliseconds
            self.assertTrue(sent <= ready <= rospy.get_time(), 'sent %f, ready %f' % (sent, ready))
            self.assertEqual(match.statistics.status, MatchStatus.STATUS_OK)
            self.assertGreater(len(match.correspondences.reference_x), 200)
            for name in ('correspondences', 'homography', 'statistics'):
                part = getattr(match, name)
                message = getattr(self, name).wait_for(stamp)
                part.header.seq = message.header.seq  # each publisher counts its own
                self.assertEqual(part, message)

    def test_the_example_in_python_says_the_motion(self):
        script = os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', '..', 'scripts',
                              'camera_motion')
        subscribers = self.matches_connections()
        example = subprocess.Popen(
            ['/usr/bin/python3', script, 'match:=/camera/matcher/match', '_frames:=4'],
            stdout=subprocess.PIPE, universal_newlines=True)
        try:
            wait_until(lambda: self.matches_connections() > subscribers, 'the example listens')
            self.match.wait_for(self.camera.send_view())
            for _ in range(1000):  # until it has seen four
                self.match.wait_for(self.camera.send_view())
                if example.poll() is not None:
                    break
            lines = example.communicate()[0].splitlines()
        finally:
            example.kill()
            example.wait()
        self.assertEqual(len(lines), 5, lines)
        shifts = [re.search(r'shift (\S+) (\S+) px, turn (\S+) deg, scale (\S+), (\d+) inliers', line)
                  for line in lines[1:4]]
        for shift in shifts:
            x, y, turn, scale, inliers = (float(number) for number in shift.groups())
            self.assertAlmostEqual(x, -5, delta=0.3)
            self.assertAlmostEqual(y, -3, delta=0.3)
            self.assertAlmostEqual(turn, 0, delta=0.2)
            self.assertAlmostEqual(scale, 1, delta=0.01)
            self.assertGreater(inliers, 100)
        self.assertRegex(lines[4], r'^[34] of 4 frames have a homography$')

    @staticmethod
    def matches_connections():
        """Subscribers of ~match."""
        state = rosgraph.Master('/match_message_test').getSystemState()[1]
        return len(dict(state).get('/camera/matcher/match', []))

    def test_a_frame_without_a_homography_or_a_reference_is_said_too(self):
        self.match.wait_for(self.camera.send_view())
        for size, status in (((480, 640), MatchStatus.STATUS_TOO_FEW_FEATURES),
                             ((240, 320), MatchStatus.STATUS_NO_REFERENCE)):
            match = self.match.wait_for(self.camera.show(np.full(size, 100, np.uint8)))
            self.assertEqual((match.homography.status, match.statistics.status), (status, status))
            self.assertEqual(list(match.homography.homography), [0.0] * 9)
            self.assertEqual(len(match.correspondences.reference_x), 0)
            self.assertEqual(match.correspondences.header.stamp, match.header.stamp)
