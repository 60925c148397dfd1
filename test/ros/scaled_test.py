"""The matcher has images of half the size, to save time, and the stabilizer the full ones: with the same stamps; and
a driver that leaves the stamps zero."""

import unittest

import cv2
import numpy as np
import rospy
from dynamic_reconfigure.client import Client
from ktgp_orb.msg import HomographyStamped
from ktgp_testing import Camera, Diagnostics, Recorder, image_message, mapped, view, wait_until

FRAMES = 90


class ScaledTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.camera, cls.small = Camera(), Camera('/camera/small/image_raw')
        cls.warps = Recorder('/camera/stabilizer/warp', HomographyStamped)
        cls.diagnostics = Diagnostics()
        wait_until(cls.warps.publishers, 'it runs')
        for camera in (cls.camera, cls.small):
            camera.wait_for_subscriber()
        cls.random = np.random.RandomState(1)

    def send(self, shape=(320, 240), stamp=None):
        """A view that shakes, and how far it is moved, px."""
        shift = self.random.randint(-14, 15, 2)
        pixels = view(300 + shift[0], 200 + shift[1])
        stamp = self.camera.next_stamp() if stamp is None else stamp
        self.camera.send(image_message(pixels, stamp))
        self.small.send(image_message(cv2.resize(pixels, shape, interpolation=cv2.INTER_AREA), stamp))
        return stamp, shift

    def test_homographies_of_smaller_images_are_scaled(self):
        wait_until(lambda: self.send() and rospy.sleep(0.05) or self.warps.messages(), 'a warp comes')
        given, steady = [], []
        middle = np.array((320.0, 240.0))
        for _ in range(FRAMES):
            stamp, shift = self.send()
            warp = self.warps.wait_for(stamp).homography
            # A point of the scene moves against the camera.
            given.append(middle - shift)
            steady.append(mapped(warp, [middle - shift])[0])

        def shake(places):
            return np.sqrt(np.mean(np.sum(np.diff(places[30:], 2, axis=0) ** 2, axis=1)))
        print('shake %.1f px before, %.1f px after' % (shake(given), shake(steady)))
        self.assertGreater(shake(given), 15.0)
        self.assertLess(shake(steady), 0.15 * shake(given))

    def test_homographies_of_another_shape_are_refused(self):
        self.diagnostics.wait_for_words('cannot be scaled', lambda: self.send((320, 320)) and rospy.sleep(0.05))

    def test_homographies_of_another_kind_of_pixels_are_refused(self):
        matcher = Client('/camera/matcher', timeout=30)
        matcher.update_configuration({'calibration': 'rectified'})
        self.diagnostics.wait_for_words('are of rectified images, and do not fit the raw ones on /camera/image_raw',
                                        lambda: self.send() and rospy.sleep(0.05))
        matcher.update_configuration({'calibration': 'by_name'})

    def test_stamps_of_zero_are_named(self):
        self.diagnostics.wait_for_words('have stamps of zero', lambda: self.send(stamp=rospy.Time()) and
                                        rospy.sleep(0.05))
