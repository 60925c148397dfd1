#!/usr/bin/python3
"""Stamps as bad cameras and other clocks send them."""

import sys
import unittest

import rospy
import rostest
from ktgp_orb.msg import MatchStatistics
from ktgp_testing import Camera, Recorder, check_each, image_message, view, wait_until
from std_srvs.srv import Trigger

OK = MatchStatistics.STATUS_OK
NO_REFERENCE = MatchStatistics.STATUS_NO_REFERENCE
LAST = 4294967295.0  # s, the largest stamp there is
# Stamps, and the status that each frame must have.
SEQUENCES = {
    'steady': ((10.0, NO_REFERENCE), (10.1, OK), (10.2, OK)),
    'repeated': ((20.0, NO_REFERENCE), (20.0, OK), (20.0, OK), (20.1, OK)),
    'going back': ((30.0, NO_REFERENCE), (30.1, OK), (29.9, NO_REFERENCE), (30.0, OK)),
    'zero': ((0.0, NO_REFERENCE), (0.0, OK), (0.0, OK)),
    'zero in between': ((40.0, NO_REFERENCE), (40.1, OK), (0.0, NO_REFERENCE),
                        (40.2, NO_REFERENCE), (40.3, OK)),
    'jumping ahead': ((50.0, NO_REFERENCE), (50.1, OK), (52.0, NO_REFERENCE), (52.1, OK)),
    'a century ahead and back': ((60.0, NO_REFERENCE), (LAST, NO_REFERENCE), (LAST, OK),
                                 (60.1, NO_REFERENCE), (60.2, OK)),
}


class TimeTest(unittest.TestCase):
    def test_each_sequence_of_stamps_has_its_reference(self):
        camera = Camera()
        statistics = Recorder('/camera/matcher/statistics', MatchStatistics)
        camera.wait_for_subscriber()
        wait_until(lambda: statistics.publishers() == 1, 'the statistics are connected')
        reset = rospy.ServiceProxy('/camera/matcher/reset', Trigger)

        def check(name):
            reset()
            for number, (seconds, status) in enumerate(SEQUENCES[name]):
                count = len(statistics.messages())
                stamp = rospy.Time.from_sec(seconds)
                camera.send(image_message(view(100 + 5 * number, 100), stamp))
                wait_until(lambda: len(statistics.messages()) > count,
                           'frame %d of "%s" has statistics' % (number, name))
                message = statistics.messages()[-1]
                self.assertEqual(message.header.stamp, stamp)
                self.assertEqual(message.status, status, 'frame %d' % number)
        check_each(SEQUENCES, check)


if __name__ == '__main__':
    rospy.init_node('robot_time_test')
    rostest.rosrun('ktgp_orb', 'robot_time', TimeTest, sys.argv)
