#!/usr/bin/python3
"""The pose of a flat target for a camera that looks at it straight and moves sideways."""

import sys
import unittest

import numpy as np
import rospy
import rostest
from dynamic_reconfigure.client import Client
from geometry_msgs.msg import PolygonStamped, PoseWithCovarianceStamped
from ktgp_orb.msg import MatchStatistics
from ktgp_testing import TIMEOUT, Camera, Recorder, image_message, view, wait_until
from sensor_msgs.msg import CameraInfo
from std_srvs.srv import Trigger
from tf2_msgs.msg import TFMessage

METRE = 0.64 / 640  # m a px of the reference
FOCAL = 500.0  # px


class TargetTest(unittest.TestCase):
    def test_outline_pose_and_transform(self):
        camera = Camera()
        info = rospy.Publisher('/camera/camera_info', CameraInfo, queue_size=10, latch=True)
        outlines = Recorder('/camera/matcher/target_outline', PolygonStamped)
        poses = Recorder('/camera/matcher/target_pose', PoseWithCovarianceStamped)
        transforms = Recorder('/tf', TFMessage)
        wait_until(lambda: outlines.publishers() and poses.publishers() and
                   transforms.publishers(), 'it runs')
        camera.wait_for_subscriber()
        calibration = CameraInfo(width=640, height=480)
        # P belongs to the rectified image, which is not used here: K counts.
        calibration.K = [FOCAL, 0, 319.5, 0, FOCAL, 239.5, 0, 0, 1]
        calibration.P = [3 * FOCAL, 0, 100, 0, 0, 3 * FOCAL, 100, 0, 0, 0, 1, 0]
        info.publish(calibration)

        rospy.wait_for_service('/camera/matcher/set_reference', 120.0)
        self.assertTrue(rospy.ServiceProxy('/camera/matcher/set_reference', Trigger)().success)
        reference = camera.send(image_message(view(400, 300), camera.next_stamp()))
        self.assertEqual(len(outlines.wait_for(reference).polygon.points), 4)

        def pose_of(x, y):
            """Sends until the calibration is in."""
            while True:
                stamp = camera.send(image_message(view(x, y), camera.next_stamp()))
                outlines.wait_for(stamp)
                if poses.messages():
                    return stamp, poses.wait_for(stamp)

        stamp, message = pose_of(430, 280)
        corners = [(p.x, p.y) for p in outlines.wait_for(stamp).polygon.points]
        np.testing.assert_allclose(corners, [(-30, 20), (609, 20), (609, 499), (-30, 499)],
                                   atol=0.3)
        position = message.pose.pose.position
        np.testing.assert_allclose([position.x, position.y, position.z],
                                   [-30 * METRE, 20 * METRE, FOCAL * METRE], atol=0.003)
        self.assertGreater(abs(message.pose.pose.orientation.w), 0.9999)
        covariance = np.array(message.pose.covariance).reshape(6, 6)
        self.assertGreater(np.linalg.eigvalsh(covariance).min(), 0.0)
        self.assertLess(np.sqrt(covariance.diagonal().max()), 0.01)

        def transform():
            for tf in transforms.messages():
                for one in tf.transforms:
                    if one.header.stamp == stamp:
                        return one
        wait_until(transform, 'the transform is broadcast')
        self.assertEqual(transform().header.frame_id, 'camera')
        self.assertEqual(transform().child_frame_id, 'target')
        self.assertEqual(transform().transform.translation, type(transform().transform.translation)(
            position.x, position.y, position.z))

        # Without P, K: a lens of twice the focal length sees the same from twice as far.
        calibration.K = [2 * FOCAL, 0, 319.5, 0, 2 * FOCAL, 239.5, 0, 0, 1]
        calibration.P = [0.0] * 12
        info.publish(calibration)
        wait_until(lambda: abs(pose_of(430, 280)[1].pose.pose.position.z -
                               2 * FOCAL * METRE) < 0.006, 'K counts where P is zero')

        lost = camera.send(image_message(np.full((480, 640), 90, np.uint8), camera.next_stamp()))
        self.assertEqual(len(outlines.wait_for(lost).polygon.points), 0)

        # A reference that changes with every frame is not a target.
        statistics = Recorder('/camera/matcher/statistics', MatchStatistics)
        wait_until(statistics.publishers, 'the statistics are connected')
        Client('/camera/matcher', timeout=TIMEOUT).update_configuration(
            {'reference_mode': 'previous'})
        stamps = []

        def reference_is_the_frame_before():
            stamps.append(camera.send(image_message(view(430, 280), camera.next_stamp())))
            return statistics.wait_for(stamps[-1]).reference_stamp in stamps
        for _ in range(3):
            wait_until(reference_is_the_frame_before, 'the mode is previous')
        self.assertIsNone(outlines.with_stamp(stamps[-2]))


if __name__ == '__main__':
    rospy.init_node('target_test')
    rostest.rosrun('ktgp_orb', 'target_test', TargetTest, sys.argv)
