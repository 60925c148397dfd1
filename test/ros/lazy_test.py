"""The input is subscribed exactly while an output has a subscriber."""

import unittest

import numpy as np
import rospy
from dynamic_reconfigure.client import Client
from ktgp_orb.msg import MatchStatus
from ktgp_testing import OUTPUTS, TIMEOUT, Camera, check_each, of_matcher, wait_until

RECORDERS = []  # all that were subscribed in a test


def coloured(picture):
    """Number of coloured pixels."""
    pixels = np.frombuffer(picture.data, np.uint8).reshape(-1, 3).astype(int)
    return np.count_nonzero(pixels.max(1) - pixels.min(1) > 60)


def subscribe(output):
    """A recorder that is connected, so that it misses nothing."""
    recorder = of_matcher(output)
    RECORDERS.append(recorder)
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

    def tearDown(self):
        """Closes what a failed test has left open."""
        for recorder in RECORDERS:
            recorder.close()
        RECORDERS.clear()
        self.camera.wait_for_no_subscriber()

    def test_each_output_subscribes_the_input(self):
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

    def test_without_laziness_every_frame_is_matched(self):
        client = Client('/camera/matcher', timeout=TIMEOUT)
        client.update_configuration({'lazy': False})
        self.camera.wait_for_subscriber()
        for _ in range(3):
            self.camera.send_view()  # no subscriber
        recorder = subscribe('statistics')
        # The matcher may not know this subscriber yet: what it sends until then is lost.
        statistics = self.send_until_answered(recorder)
        if statistics.dropped_frames == 0:
            last = statistics.header.stamp - rospy.Duration(0.033)
            self.assertEqual(statistics.reference_stamp, last, 'the chain has no gap')
        self.assertEqual(statistics.status, MatchStatus.STATUS_OK)
        recorder.close()
        client.update_configuration({'lazy': True})
        self.camera.wait_for_no_subscriber()

    def test_the_last_subscriber_to_leave_ends_the_reference(self):
        recorder = subscribe('statistics')
        self.camera.wait_for_subscriber()
        recorder.wait_for(self.camera.send_view())
        self.assertEqual(recorder.wait_for(self.camera.send_view()).status,
                         MatchStatus.STATUS_OK)
        recorder.close()
        self.camera.wait_for_no_subscriber()
        recorder = subscribe('statistics')
        self.camera.wait_for_subscriber()
        self.assertEqual(recorder.wait_for(self.camera.send_view()).status,
                         MatchStatus.STATUS_NO_REFERENCE)
        recorder.close()
        self.camera.wait_for_no_subscriber()

    def test_the_overlay_shows_the_motion_on_the_frame(self):
        recorder = subscribe('matches_image')
        self.camera.wait_for_subscriber()
        self.send_until_answered(recorder)
        picture = recorder.wait_for(self.camera.send_view())  # there is a reference now
        recorder.close()
        self.camera.wait_for_no_subscriber()
        self.assertEqual((picture.width, picture.height, picture.encoding), (640, 480, 'bgr8'))
        self.assertGreater(coloured(picture), 1000, 'no strokes')
