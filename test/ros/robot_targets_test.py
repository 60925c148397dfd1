#!/usr/bin/python3
"""Flat targets in renderings of a camera: found with the right pose, added, replaced and removed by services,
kept in a file, and refused with the reason."""

import os
import subprocess
import sys
import tempfile
import unittest

import cv2
import numpy as np
import rospy
import rostest
from diagnostic_msgs.msg import DiagnosticArray
from ktgp_orb.msg import MatchStatus, TargetDetections
from ktgp_orb.srv import DetectTargets, RemoveTarget, SetTarget
from ktgp_testing import Camera, Recorder, image_message, texture, wait_for_diagnostics, wait_until
from poster import BARREL, CHI_SQUARE, K, POSTER, information, pose_errors, rendered
from sensor_msgs.msg import CameraInfo, Image
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import MarkerArray

OTHER = texture(300, 400, seed=11)


def now():
    return rospy.Time(1)


class TargetsTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        cls.detections = Recorder('/camera/targets/detections', TargetDetections)
        cls.diagnostics = Recorder('/diagnostics', DiagnosticArray)
        cls.info = rospy.Publisher('/camera/camera_info', CameraInfo, queue_size=5, latch=True)
        cls.camera = Camera()
        cls.camera.wait_for_subscriber()
        for name, kind in (('add', SetTarget), ('replace', SetTarget), ('remove', RemoveTarget),
                           ('detect', DetectTargets)):
            rospy.wait_for_service('/camera/targets/' + name, 60)
            setattr(cls, name, rospy.ServiceProxy('/camera/targets/' + name, kind))

    @classmethod
    def tearDownClass(cls):
        cls.folder.cleanup()

    def setUp(self):
        answer = self.add('poster', [image_message(POSTER, now())], 1.0, 'poster')
        self.assertTrue(answer.success, answer.message)

    def tearDown(self):
        self.remove('poster')

    def send(self, picture):
        stamp = self.camera.next_stamp()
        self.camera.send(image_message(picture, stamp))
        return self.detections.wait_for(stamp)

    def send_until(self, picture, condition, what):
        answers = []

        def holds():
            answers.append(self.send(picture))
            return condition(answers[-1])
        wait_until(holds, what)
        return answers[-1]

    def test_pose_is_right_with_its_covariance(self):
        for distortion in ((0.0,) * 5, BARREL):
            picture = rendered(K, distortion)
            self.info.publish(information(distortion=distortion))
            message = self.send_until(
                picture, lambda m: m.detections and m.detections[0].has_pose
                and pose_errors(m.detections[0].pose)[0] < 0.004, 'the pose is right')
            detection, = message.detections
            self.assertEqual((detection.id, detection.instance, detection.status, detection.frame),
                             ('poster', 0, MatchStatus.STATUS_OK, 'poster'))
            self.assertEqual((message.known, message.no_pose), (1, ''))
            metres, degrees, deviations = pose_errors(detection.pose)
            print('%.2f mm, %.3f degrees, %.1f squared deviations'
                  % (1e3 * metres, degrees, deviations))
            self.assertLess(deviations, 2 * CHI_SQUARE)

    def test_tf_markers_and_picture(self):
        self.info.publish(information())
        transforms = Recorder('/tf', TFMessage)
        markers = Recorder('/camera/targets/markers', MarkerArray)
        pictures = Recorder('/camera/targets/image', Image)
        wait_until(lambda: transforms.publishers() and markers.publishers() and pictures.publishers(),
                   'all is connected')
        picture = rendered(K)

        def everything(message):
            return (message.detections and message.detections[0].has_pose and pictures.messages()
                    and any(len(m.markers) == 3 for m in markers.messages())
                    and any(t.child_frame_id == 'poster' for m in transforms.messages()
                            for t in m.transforms))
        message = self.send_until(picture, everything, 'all outputs come')
        overlay = pictures.messages()[-1]
        self.assertEqual((overlay.encoding, overlay.width, overlay.height), ('bgr8', 640, 480))
        self.assertEqual(message.header.frame_id, 'camera')
        for recorder in (transforms, markers, pictures):
            recorder.close()

    def test_says_why_there_is_no_pose(self):
        picture = rendered(K)
        self.info.publish(information(k=0 * K, p=0 * K))
        message = self.send_until(picture, lambda m: 'not calibrated' in m.no_pose, 'the reason comes')
        self.assertFalse(message.detections[0].has_pose)
        wait_for_diagnostics(
            self.diagnostics, 'a target has no pose: /camera/camera_info cannot be used: the camera is not',
            lambda: self.send(picture))
        self.info.publish(information())
        self.send_until(picture, lambda m: m.detections[0].has_pose, 'the pose comes')

    def test_detects_in_the_image_of_a_request(self):
        request = image_message(rendered(K), rospy.Time(7))
        answer = self.detect(request, information())
        self.assertTrue(answer.success, answer.message)
        detection, = answer.detections.detections
        self.assertLess(pose_errors(detection.pose)[0], 0.002)
        self.assertEqual(answer.detections.header.stamp, rospy.Time(7))
        answer = self.detect(request, CameraInfo())
        self.assertFalse(answer.detections.detections[0].has_pose)
        self.assertIn('no camera_info', answer.detections.no_pose)
        answer = self.detect(Image(), CameraInfo())
        self.assertFalse(answer.success)
        self.assertTrue(answer.message)

    def test_refuses_with_the_reason(self):
        def refused(words, service, *arguments):
            answer = service(*arguments)
            self.assertFalse(answer.success)
            self.assertIn(words, answer.message)
        poster, flat = image_message(POSTER, now()), image_message(0 * POSTER + 90, now())
        refused('exists already', self.add, 'poster', [poster], 0.0, '')
        refused('shows the same as target "poster"', self.add, 'copy', [poster], 0.0, '')
        refused('too little texture', self.add, 'flat', [flat], 0.0, '')
        refused('no image', self.add, 'none', [], 0.0, '')
        refused('no id', self.add, '', [image_message(OTHER, now())], 0.0, '')
        refused('does not exist', self.replace, 'unknown', [image_message(OTHER, now())], 0.0, '')
        refused('does not exist', self.remove, 'unknown')
        self.assertEqual(self.send(rendered(K)).known, 1)

    def test_replaces_and_removes(self):
        picture = rendered(K)
        self.assertTrue(self.send(picture).detections)
        answer = self.replace('poster', [image_message(OTHER, now())], 0.0, '')
        self.assertTrue(answer.success, answer.message)
        self.assertFalse(self.send(picture).detections)
        self.assertTrue(self.remove('poster').success)
        self.assertEqual(self.send(picture).known, 0)

    def test_survives_images_that_change(self):
        self.assertTrue(self.send(rendered(K)).detections)
        half = cv2.resize(rendered(K), (480, 360), interpolation=cv2.INTER_AREA)
        self.assertTrue(self.send(half).detections)
        broken = image_message(half, self.camera.next_stamp())
        broken.data = broken.data[:100]
        wait_for_diagnostics(self.diagnostics, 'images are refused', lambda: self.camera.send(broken))
        self.assertTrue(self.send(half).detections)

    def test_reads_a_folder_and_keeps_what_changes(self):
        posters = os.path.join(self.folder.name, 'posters')
        os.mkdir(posters)
        cv2.imwrite(os.path.join(posters, 'mine.png'), POSTER)
        with open(os.path.join(posters, 'broken.png'), 'w') as file:
            file.write('no image')
        rospy.set_param('/kept/targets', posters)
        rospy.set_param('/kept/file', os.path.join(self.folder.name, 'kept.yaml'))

        def ids():
            rospy.wait_for_service('/kept/detect', 60)
            answer = rospy.ServiceProxy('/kept/detect', DetectTargets)(
                image_message(rendered(K), now()), CameraInfo())
            return answer.detections.known, [d.id for d in answer.detections.detections]
        def knows(expected):
            wait_until(lambda: ids() == expected, 'it knows %s' % (expected,))
        for start in range(2):
            node = subprocess.Popen(['rosrun', 'nodelet', 'nodelet', 'standalone', 'ktgp_orb/Targets',
                                     '__name:=kept'])
            try:
                knows((1 + start, ['mine']))
                if start == 0:
                    wait_for_diagnostics(self.diagnostics, 'broken.png')
                    answer = rospy.ServiceProxy('/kept/add', SetTarget)(
                        'other', [image_message(OTHER, now())], 0.3, 'shelf')
                    self.assertTrue(answer.success, answer.message)
            finally:
                node.terminate()
                node.wait(30)
        with open(os.path.join(self.folder.name, 'kept.yaml')) as file:
            self.assertIn('width: 0.3', file.read())


if __name__ == '__main__':
    rospy.init_node('robot_targets_test')
    rostest.rosrun('ktgp_orb', 'robot_targets', TargetsTest, sys.argv)
