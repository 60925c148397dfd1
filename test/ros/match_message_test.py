#!/usr/bin/python3
"""The one message with everything holds what the three topics carry, frame by frame."""

import sys
import unittest

import numpy as np
import rospy
import rostest
from ktgp_orb.msg import Correspondences, HomographyStamped, Match, MatchStatistics
from ktgp_testing import Camera, Recorder, image_message


class MatchMessageTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.parts = {
            'correspondences': Recorder('/camera/matcher/correspondences', Correspondences),
            'homography': Recorder('/camera/matcher/homography', HomographyStamped),
            'statistics': Recorder('/camera/matcher/statistics', MatchStatistics)}
        cls.matches = Recorder('/camera/matcher/match', Match)
        cls.camera = Camera()
        cls.camera.wait_for_subscriber()

    def assert_same(self, part, message):
        part.header.seq = message.header.seq  # each publisher counts its own
        self.assertEqual(part, message)

    def test_holds_what_the_topics_carry(self):
        self.matches.wait_for(self.camera.send_view())
        for _ in range(3):
            stamp = self.camera.send_view()
            match = self.matches.wait_for(stamp)
            self.assertEqual(match.statistics.status, MatchStatistics.STATUS_OK)
            self.assertGreater(len(match.correspondences.reference_x), 200)
            for name, recorder in self.parts.items():
                self.assert_same(getattr(match, name), recorder.wait_for(stamp))

    def test_a_frame_without_a_homography_is_said_too(self):
        self.matches.wait_for(self.camera.send_view())
        flat = image_message(np.full((480, 640), 100, np.uint8), self.camera.next_stamp())
        match = self.matches.wait_for(self.camera.send(flat))
        self.assertEqual(match.homography.status, HomographyStamped.STATUS_TOO_FEW_FEATURES)
        self.assertEqual(match.statistics.status, MatchStatistics.STATUS_TOO_FEW_FEATURES)
        self.assertEqual(list(match.homography.homography), [0.0] * 9)
        self.assertEqual(len(match.correspondences.reference_x), 0)

    def test_a_frame_without_a_reference_is_said_too(self):
        small = image_message(np.full((240, 320), 100, np.uint8), self.camera.next_stamp())
        match = self.matches.wait_for(self.camera.send(small))
        self.assertEqual(match.homography.status, HomographyStamped.STATUS_NO_REFERENCE)
        self.assertEqual(match.statistics.status, MatchStatistics.STATUS_NO_REFERENCE)
        self.assertEqual(match.correspondences.header.stamp, match.header.stamp)


if __name__ == '__main__':
    rospy.init_node('match_message_test')
    rostest.rosrun('ktgp_orb', 'match_message', MatchMessageTest, sys.argv)
