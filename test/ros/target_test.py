#!/usr/bin/python3
"""A flat target in front of a camera that looks at it straight and moves sideways: corners, pose and transform."""

import unittest

import numpy as np
import rospy
from ktgp_orb.msg import TargetDetections
from ktgp_orb.srv import SetTarget
from ktgp_testing import Camera, Diagnostics, Recorder, image_message, run_as_node, view, wait_until
from sensor_msgs.msg import CameraInfo
from tf2_msgs.msg import TFMessage

METRE = 0.64 / 640  # m a px of the target
FOCAL = 500.0  # px


class TargetTest(unittest.TestCase):
    def test_corners_pose_and_transform(self):
        camera = Camera()
        info = rospy.Publisher('/camera/camera_info', CameraInfo, queue_size=10, latch=True)
        detections = Recorder('/camera/targets/detections', TargetDetections)
        transforms = Recorder('/tf', TFMessage)
        diagnostics = Diagnostics()
        wait_until(lambda: detections.publishers() and transforms.publishers(), 'it runs')
        camera.wait_for_subscriber()
        calibration = CameraInfo(width=640, height=480)
        calibration.K = [FOCAL, 0, 319.5, 0, FOCAL, 239.5, 0, 0, 1]
        info.publish(calibration)

        def target(service, width):
            rospy.wait_for_service('/camera/targets/' + service, 120.0)
            answer = rospy.ServiceProxy('/camera/targets/' + service, SetTarget)(
                'board', [image_message(view(400, 300), rospy.Time(1))], width, 'target')
            self.assertTrue(answer.success, answer.message)

        def send(picture):
            return detections.wait_for(camera.show(picture))

        # A frame for tf is of no use without a width.
        target('add', 0.0)
        message = send(view(430, 280))
        self.assertFalse(message.detections[0].has_pose)
        self.assertEqual(message.no_pose, 'the width of board, which has the frame target, is not known')
        diagnostics.wait_for_words('a target has no pose: the width of board', lambda: send(view(430, 280)))
        target('replace', 0.64)

        def board():
            """Sends until the calibration is in."""
            while True:
                message = send(view(430, 280))
                if message.detections[0].has_pose:
                    return message.header.stamp, message.detections[0]

        stamp, found = board()
        np.testing.assert_allclose(found.corners, [-30, 20, 609, 20, 609, 499, -30, 499], atol=0.3)
        position = found.pose.pose.position
        np.testing.assert_allclose([position.x, position.y, position.z],
                                   [-30 * METRE, 20 * METRE, FOCAL * METRE], atol=0.003)
        self.assertGreater(abs(found.pose.pose.orientation.w), 0.9999)
        covariance = np.array(found.pose.covariance).reshape(6, 6)
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

        self.assertFalse(send(np.full((480, 640), 90, np.uint8)).detections)


if __name__ == '__main__':
    run_as_node(TargetTest)
