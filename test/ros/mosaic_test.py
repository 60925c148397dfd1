"""Compares the mosaic with the picture that the camera is moved over."""

import itertools
import os
import tempfile
import unittest

import cv2
import numpy as np
import rospy
from dynamic_reconfigure.client import Client
from ktgp_orb.msg import HomographyStamped, MatchStatus
from ktgp_orb.srv import SaveMosaic
from ktgp_testing import (TIMEOUT, Camera, Diagnostics, Recorder, corners_off, shift, texture, view, view_of_hills,
                          view_turned, wait_until, warm_up)
from sensor_msgs.msg import Image
from std_srvs.srv import Trigger

START = (100, 100)


def rms_error(message, x, y):
    """Returns the RMS error of the frame's corners in the map, whose first frame was at START; px."""
    found = np.linalg.inv(np.reshape(message.homography, (3, 3)))
    return np.sqrt(np.mean(np.sum(corners_off(found, shift(x - START[0], y - START[1])) ** 2, axis=1)))


class MosaicTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.camera = Camera()
        rospy.wait_for_service('/camera/mosaic/save', 120.0)
        cls.save = rospy.ServiceProxy('/camera/mosaic/save', SaveMosaic)
        cls.reset = rospy.ServiceProxy('/camera/mosaic/reset', Trigger)

    def setUp(self):
        self.poses = Recorder('/camera/mosaic/homography', HomographyStamped, self)
        wait_until(self.poses.publishers, 'it runs')
        warm_up(self.camera, self.poses)

    def send(self, x, y):
        return self.poses.wait_for(self.camera.show(view(x, y)))

    def begin(self):
        self.assertTrue(self.reset().success)
        first = self.send(*START)
        self.assertEqual(first.status, MatchStatus.STATUS_OK)
        return first

    def test_mosaic_equals_the_scene(self):
        pictures = Recorder('/camera/mosaic/mosaic', Image, self)
        wait_until(pictures.publishers, 'the mosaic is connected')
        first = self.begin()
        for i in range(1, 25):
            message = self.send(START[0] + 20 * i, START[1] + 10 * i)
            self.assertEqual(message.status, MatchStatus.STATUS_OK)
            self.assertEqual(message.reference_stamp, first.header.stamp)
        self.assertLess(rms_error(message, START[0] + 480, START[1] + 240), 0.3)
        wait_until(pictures.messages, 'a picture is published')
        self.assertEqual(pictures.messages()[0].encoding, 'bgr8')

        with tempfile.TemporaryDirectory() as folder:
            file = os.path.join(folder, 'map.png')
            response = self.save(file)
            self.assertTrue(response.success, response.message)
            saved = cv2.imread(file, cv2.IMREAD_UNCHANGED)
            self.assertEqual(os.listdir(folder), ['map.png'])
        self.assertEqual(saved.shape, (response.height, response.width, 4))
        self.assertLess(abs(response.width - 1120), 6)
        self.assertLess(abs(response.height - 720), 6)
        height, width = min(saved.shape[0], 718), min(saved.shape[1], 1118)
        truth = texture()[START[1]:START[1] + height, START[0]:START[0] + width].astype(int)
        seen = cv2.erode(saved[:height, :width, 3], np.ones((9, 9))) > 0
        difference = np.abs(saved[:height, :width, 1].astype(int) - truth)[seen]
        self.assertGreater(seen.mean(), 0.5)
        self.assertLess(difference.mean(), 12.0)

    def test_unusable_files_are_refused(self):
        self.begin()
        for file in ('', 'map.png', '/tmp/map.jpg', '/no/such/folder/map.png'):
            response = self.save(file)
            self.assertFalse(response.success)
            self.assertTrue(response.message)

    def test_nothing_is_subscribed_without_subscribers_where_it_is_lazy(self):
        client = Client('/camera/mosaic', timeout=TIMEOUT)
        client.update_configuration({'lazy': True})
        self.addCleanup(client.update_configuration, {'lazy': False})
        self.begin()
        self.poses.close()
        self.camera.wait_for_no_subscriber()
        self.assertTrue(self.reset().success)

        def reason():
            return self.save('/tmp/never.png').message
        wait_until(lambda: 'lazy is on, and no output has a subscriber' in reason(), '~save says why')

    def test_the_map_grows_without_subscribers(self):
        self.begin()
        stamp = self.send(START[0] + 60, START[1]).header.stamp
        self.poses.close()  # no subscriber any more
        pictures = Recorder('/camera/mosaic/mosaic', Image, self)
        # No image comes meanwhile; the last picture that was published is of an older map.
        pictures.wait_for(stamp)
        # Also for who looks at the header of the connection alone, rosbag for example.
        self.assertEqual(pictures.messages()[-1]._connection_header['latching'], '1')

    def test_a_camera_that_only_turns_gives_a_panorama(self):
        diagnostics = Diagnostics(self)
        self.begin()
        self.assertTrue(self.reset().success)
        for angle in range(-30, 31, 3):
            message = self.poses.wait_for(self.camera.show(view_turned(angle, 600.0)))
            self.assertEqual(message.status, MatchStatus.STATUS_OK, angle)
        wait_until(lambda: any('a cylinder' in values.get('drawn on', '') for values in diagnostics.values('frames')),
                   'the diagnostics say what it is drawn on')

    def test_what_neither_plane_nor_panorama_shows_is_explained(self):
        diagnostics = Diagnostics(self)
        self.begin()
        self.assertTrue(self.reset().success)
        for i in range(29):
            message = self.poses.wait_for(self.camera.show(view_turned(0.0, 600.0, 0.45 * 1.06 ** i)))
        self.assertNotEqual(message.status, MatchStatus.STATUS_OK)
        # The reason holds until a new map begins, so the camera goes on moving to and fro.
        scales = itertools.cycle(0.45 * 1.06 ** i for i in [*range(28, 0, -1), *range(28)])
        diagnostics.wait_for_words('it does not only turn: the homographies are',
                                   lambda: self.camera.show(view_turned(0.0, 600.0, next(scales))))

    def test_a_scene_that_is_no_plane_is_said(self):
        diagnostics = Diagnostics(self)
        self.begin()
        self.assertTrue(self.reset().success)
        steps = itertools.cycle([*range(60), *range(60, 0, -1)])  # to and fro
        diagnostics.wait_for_words('the scene is no plane: points are about ',
                                   lambda: self.poses.wait_for(self.camera.show(view_of_hills(4.0 * next(steps), 0.1))))

    def test_text_in_place_of_numbers_is_refused(self):
        client = Client('/camera/mosaic', timeout=TIMEOUT)
        diagnostics = Diagnostics(self)
        answer = client.update_configuration({'max_megapixels': float('nan')})
        self.assertEqual(answer['max_megapixels'], 64.0)
        wait_until(lambda: [s for s in diagnostics.of('mosaic: frames') if 'max_megapixels is nan' in s.message],
                   'diagnostics say what is refused')
        client.update_configuration({'max_megapixels': 64.0})
        self.begin()  # and it goes on
