#!/usr/bin/python3
"""The input is subscribed exactly while some output has a subscriber."""

import sys
import unittest

import rospy
import rostest
from ktgp_orb.msg import Correspondences, HomographyStamped, MatchStatistics
from ktgp_testing import Camera, Recorder, check_each, wait_until
from sensor_msgs.msg import Image

OUTPUTS = {
    'correspondences': Correspondences,
    'homography': HomographyStamped,
    'accumulated_homography': HomographyStamped,
    'statistics': MatchStatistics,
    'matches_image': Image,
}


def subscribe(output):
    """A recorder that is connected: it misses nothing from now on."""
    recorder = Recorder('/camera/matcher/' + output, OUTPUTS[output])
    wait_until(lambda: recorder.publishers() > 0, output + ' is connected')
    return recorder


class LazyTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.camera = Camera()
        # Wait until the matcher is up: it subscribes for the first recorder.
        recorder = subscribe('statistics')
        cls.camera.wait_for_subscriber()
        recorder.close()
        cls.camera.wait_for_no_subscriber()

    def test_each_output_alone_subscribes_the_input(self):
        def check(output):
            self.assertEqual(self.camera.subscribers(), 0)
            recorder = subscribe(output)
            self.camera.wait_for_subscriber()
            recorder.close()
            self.camera.wait_for_no_subscriber()
        check_each(OUTPUTS, check)

    def test_two_outputs_closed_in_either_order(self):
        def check(order):
            early, late = subscribe(order[0]), subscribe(order[1])
            self.camera.wait_for_subscriber()
            early.close()
            self.send_until_answered(late)
            self.wait_for_messages(late)
            late.close()
            self.camera.wait_for_no_subscriber()
        check_each((('matches_image', 'statistics'), ('statistics', 'matches_image'),
                    ('correspondences', 'homography'), ('homography', 'correspondences')), check)

    def send_until_answered(self, recorder):
        """The first image only becomes the reference, and one that follows too soon replaces it."""
        before = len(recorder.messages())
        for _ in range(60):
            stamp = self.camera.send_view()
            try:
                wait_until(lambda: len(recorder.messages()) > before, '', timeout=0.5)
            except AssertionError:
                continue
            return recorder.wait_for(stamp)
        raise AssertionError('no answer on %s' % recorder.topic)

    def wait_for_messages(self, recorder):
        """The remaining output gets a message for every image."""
        for _ in range(5):
            stamp = self.camera.send_view()
            recorder.wait_for(stamp)

    def test_the_last_to_go_takes_the_reference_along(self):
        recorder = subscribe('statistics')
        self.camera.wait_for_subscriber()
        recorder.wait_for(self.camera.send_view())
        self.assertEqual(recorder.wait_for(self.camera.send_view()).status,
                         MatchStatistics.STATUS_OK)
        recorder.close()
        self.camera.wait_for_no_subscriber()
        recorder = subscribe('statistics')
        self.camera.wait_for_subscriber()
        self.assertEqual(recorder.wait_for(self.camera.send_view()).status,
                         MatchStatistics.STATUS_NO_REFERENCE)
        recorder.close()
        self.camera.wait_for_no_subscriber()

    def test_the_overlay_is_a_picture_of_both_frames(self):
        recorder = subscribe('matches_image')
        self.camera.wait_for_subscriber()
        picture = self.send_until_answered(recorder)
        self.assertEqual((picture.width, picture.height, picture.encoding), (1280, 480, 'bgr8'))
        pixels = [tuple(picture.data[i:i + 3]) for i in range(0, len(picture.data), 3)]
        self.assertGreater(pixels.count((0, 255, 255)), 1000, 'no yellow lines')
        recorder.close()
        self.camera.wait_for_no_subscriber()


if __name__ == '__main__':
    rospy.init_node('lazy_test')
    rostest.rosrun('ktgp_orb', 'lazy', LazyTest, sys.argv)
