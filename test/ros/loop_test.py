#!/usr/bin/python3
"""rosbag play --loop: at every start of the bag the reference is forgotten, and matching resumes."""

import sys
import unittest

import rospy
import rostest
from ktgp_orb.msg import MatchStatistics, MatchStatus
from ktgp_testing import Recorder, wait_until


class LoopTest(unittest.TestCase):
    def test_each_round_starts_without_a_reference(self):
        statistics = Recorder('/camera/matcher/statistics', MatchStatistics)

        def starts():
            messages = statistics.messages()
            return [i for i in range(1, len(messages))
                    if messages[i].header.stamp < messages[i - 1].header.stamp]
        wait_until(lambda: len(starts()) >= 3 and len(statistics.messages()) > starts()[2] + 1,
                   'the bag has been played three times', timeout=120)
        messages = statistics.messages()
        for i in starts()[:3]:
            self.assertEqual(messages[i].status, MatchStatus.STATUS_NO_REFERENCE)
            self.assertEqual(messages[i + 1].reference_stamp, messages[i].header.stamp)
            self.assertEqual(messages[i + 1].status, MatchStatus.STATUS_OK)


if __name__ == '__main__':
    rospy.init_node('loop_test')
    rostest.rosrun('ktgp_orb', 'loop', LoopTest, sys.argv)
