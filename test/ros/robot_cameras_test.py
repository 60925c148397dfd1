#!/usr/bin/python3
"""multi_camera.launch: each camera of the list has its own matcher, and none sees another's images."""

import sys
import unittest

import rospy
import rostest
from ktgp_orb.msg import MatchStatistics
from ktgp_testing import Camera, Recorder, image_message, view, wait_until


class CamerasTest(unittest.TestCase):
    def test_each_camera_is_matched_on_its_own(self):
        names = rospy.get_param('~cameras').split()
        statistics = [Recorder('/%s/matcher/statistics' % n, MatchStatistics) for n in names]
        cameras = [Camera('/%s/image_raw' % name) for name in names]
        for camera in cameras:
            camera.wait_for_subscriber()
        for recorder in statistics:
            wait_until(lambda recorder=recorder: recorder.publishers() == 1, 'it is connected')
        for frame in range(3):
            for i, (camera, recorder) in enumerate(zip(cameras, statistics)):
                stamp = rospy.Time(100 * (i + 1), 100000000 * frame)
                pixels = view(100 + 5 * frame, 100, 320, 240)
                camera.send(image_message(pixels, stamp))
                recorder.wait_for(stamp)
        for i, recorder in enumerate(statistics):
            messages = recorder.messages()
            self.assertEqual([m.header.stamp.secs for m in messages], 3 * [100 * (i + 1)])
            self.assertEqual([m.status for m in messages],
                             [MatchStatistics.STATUS_NO_REFERENCE, 0, 0])


if __name__ == '__main__':
    rospy.init_node('robot_cameras_test')
    rostest.rosrun('ktgp_orb', 'robot_cameras', CamerasTest, sys.argv)
