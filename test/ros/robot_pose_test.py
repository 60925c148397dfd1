"""The pose of a flat target in renderings with every kind of calibration: accurate to 2 mm at 1.3 m,
or refused with the reason; and the messages when there is no pose."""

import os

import cv2
import numpy as np
import rospy
from ktgp_orb.msg import MatchStatus
from ktgp_testing import TIMEOUT, Camera, Recorder, check_each, image_message, no_delay, wait_until
from poster import (BARREL, BINNED, CHI_SQUARE, FISHEYE, K, REFUSED, ROI, SENSOR, WIDE_P, TargetsCase,
                    information, pose_errors, rendered)
from sensor_msgs.msg import CameraInfo
from tf2_msgs.msg import TFMessage

# picture, camera_info, kind of the image
RIGHT = {
    'pinhole': (lambda: rendered(K), information(), 'by_name'),
    'K counts for raw images, not P': (lambda: rendered(K), information(p=np.diag((3.0, 3.0, 1.0)) @ K), 'by_name'),
    'K counts for raw images without P': (lambda: rendered(K), information(p=0 * K), 'by_name'),
    'distortion': (lambda: rendered(K, BARREL), information(distortion=BARREL), 'by_name'),
    'distortion, another P': (lambda: rendered(K, BARREL),
                              information(distortion=BARREL, p=WIDE_P), 'by_name'),
    'rectified image': (lambda: rendered(WIDE_P), information(distortion=BARREL, p=WIDE_P),
                        'rectified'),
    'fisheye': (lambda: rendered(K, FISHEYE, 'equidistant'),
                information(distortion=FISHEYE, model='equidistant'), 'by_name'),
    'binning': (lambda: rendered(K), information(**BINNED), 'by_name'),
    'binning, distortion': (lambda: rendered(K, BARREL),
                            information(distortion=BARREL, **BINNED), 'by_name'),
    'roi': (lambda: rendered(K), information(SENSOR, **ROI), 'by_name'),
    'roi, distortion': (lambda: rendered(K, BARREL), information(SENSOR, BARREL, **ROI), 'by_name'),
    'roi, rectified image': (lambda: rendered(K), information(SENSOR, BARREL, **ROI), 'rectified'),
}


class PoseTest(TargetsCase):
    def setUp(self):
        super().setUp()
        self.client.update_configuration({'calibration': 'by_name'})

    def send(self, picture, info):
        """The poster in the image, sent with its camera_info; and why it has no pose."""
        stamp = self.camera.next_stamp()
        info.header.stamp = stamp
        self.info.publish(info)
        self.camera.send(image_message(self.camera.noisy(picture), stamp))
        message = self.detections.wait_for(stamp)
        poster, = message.detections
        self.assertEqual((poster.id, poster.instance, poster.status, poster.frame, message.known, poster.has_pose),
                         ('poster', 0, MatchStatus.STATUS_OK, 'poster', 1, message.no_pose == ''))
        return poster, message.no_pose

    def check_pose(self, picture, info):
        """Once the camera_info is in, every pose is right."""
        last = []

        def errors():
            poster, _ = self.send(picture, info)
            last.append(pose_errors(poster.pose) if poster.has_pose else None)
            return last[-1]

        try:
            wait_until(lambda: errors() and last[-1][0] < 0.002, 'the pose is right', min(TIMEOUT, 15.0))
        except AssertionError:
            raise AssertionError('pose off by %s (m, degrees, squared deviations)' % (last[-1],))
        metres, degrees, deviations = errors()
        print('%.2f mm, %.2f degrees, %.1f squared deviations' % (1e3 * metres, degrees, deviations),
              end='')
        self.assertLess(metres, 0.002)
        self.assertLess(degrees, 0.5)
        self.assertLess(deviations, CHI_SQUARE, 'the claimed covariance is too small')
        self.assertEqual(no_delay(self.info), {True})

    def test_pose_is_right_for_every_calibration(self):
        def check(name):
            picture, info, kind = RIGHT[name]
            self.client.update_configuration({'calibration': kind})
            self.check_pose(picture(), info)
            print('  ' + name)
        check_each(RIGHT, check)

    def test_unusable_input_is_refused_with_the_reason(self):
        picture = rendered(K)

        def check(name):
            info, words = REFUSED[name]
            before = len(self.log.with_words(words))

            def refused():
                poster, reason = self.send(picture, info)
                return not poster.has_pose and words in reason
            wait_until(refused, 'no pose comes')
            self.diagnostics.wait_for_words(words, lambda: self.send(picture, info))
            wait_until(lambda: len(self.log.with_words(words)) > before, 'the log says ' + words)
            self.assertFalse(self.send(picture, info)[0].has_pose)
        check_each(REFUSED, check)

    def test_a_target_with_a_frame_is_searched_without_subscribers(self):
        camera = Camera('/poster/image_raw')
        info = rospy.Publisher('/poster/camera_info', CameraInfo, queue_size=5, latch=True)
        transforms = Recorder('/tf', TFMessage, self)
        camera.wait_for_subscriber()
        picture = cv2.imread(os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', '..',
                                          'doc', 'mosaic.jpg'), cv2.IMREAD_GRAYSCALE)
        # The first subscriber: without camera_info there is no pose, with a message.
        wait_until(lambda: camera.show(picture) and
                   self.log.with_words('no camera_info on /poster/camera_info'), 'the log says what misses')
        self.diagnostics.wait_for_words('no camera_info on /poster/camera_info')
        info.publish(information(size=(picture.shape[1], picture.shape[0])))
        wait_until(lambda: camera.show(picture) and
                   [t for m in transforms.messages() for t in m.transforms
                    if t.child_frame_id == 'poster'], 'the transform is broadcast')
        self.assertEqual(len(self.log.with_words('no camera_info on /poster/camera_info')), 1)
