"""Each kind of image encoding is matched; others are refused with a message, and counted."""

import numpy as np
from ktgp_orb.msg import MatchStatus
from ktgp_testing import MatcherCase, check_each, corners_off, image_message, shift, view, wait_until

# One of each kind; image_conversion_test has all.
ENCODINGS = {
    'mono8': lambda grey: grey,
    'bgr8': lambda grey: np.dstack([grey, grey, grey]),
    'bayer_grbg8': lambda grey: grey,
    'yuv422': lambda grey: np.dstack([np.full_like(grey, 128), grey]),
    '16UC1': lambda grey: grey.astype(np.uint16) * 16,  # twelve bits
}


class EncodingsTest(MatcherCase):
    topics = 'statistics', 'homography'

    def send_and_wait(self, encoding='mono8', convert=lambda grey: grey):
        return self.statistics.wait_for(self.camera.send_view(encoding, convert))

    def assert_translation(self, stamp):
        message = self.homography.wait_for(stamp)
        self.assertEqual(message.status, MatchStatus.STATUS_OK)
        # The scene moves against the camera.
        errors = np.linalg.norm(corners_off(message.homography, shift(-5, -3)), axis=1)
        self.assertLess(errors.max(), 1.0, 'corner errors %s px' % errors)

    def check_motion(self, encoding):
        convert = ENCODINGS[encoding]
        first = self.send_and_wait(encoding, convert)
        self.assertEqual(first.status, MatchStatus.STATUS_NO_REFERENCE,
                         'a change of encoding must reset the reference')
        second = self.send_and_wait(encoding, convert)
        self.assertEqual(second.status, MatchStatus.STATUS_OK)
        self.assertEqual(second.reference_stamp, first.header.stamp)
        self.assert_translation(second.header.stamp)

    def test_each_kind_of_encoding_gives_the_true_motion(self):
        check_each(sorted(ENCODINGS), self.check_motion)

    def test_a_change_of_size_resets_the_reference(self):
        self.send_and_wait()
        self.assertEqual(self.send(view(100, 100, 320, 240)).status, MatchStatus.STATUS_NO_REFERENCE)

    def refused(self, change, expected_words):
        """Sends a broken image; it must be refused with a reason, and the next good one must work."""
        before = self.send_and_wait()
        broken = image_message(view(100, 100), self.camera.next_stamp())
        change(broken)
        self.camera.send(broken)
        # The image may wait in the slot: send the next one only after it was counted.
        wait_until(lambda: self.refused_count() > before.refused_frames, 'the image is counted')
        after = self.send_and_wait()
        self.assertEqual(after.refused_frames, before.refused_frames + 1)
        self.assertEqual(after.status, MatchStatus.STATUS_OK)
        self.assertEqual(after.reference_stamp, before.header.stamp)
        self.assertIsNone(self.statistics.with_stamp(broken.header.stamp))
        wait_until(lambda: expected_words in self.diagnostics.values('input')[-1].get('last error', ''),
                   'diagnostics say ' + expected_words)

    def refused_count(self):
        """As the last report has it."""
        return int(([{}] + self.diagnostics.values('input'))[-1].get('refused', -1))

    def test_refused_images(self):
        def wrong_step(image):
            image.step = 100

        def depth(image):
            image.encoding = '32FC1'

        words = {wrong_step: 'step is 100; expected at least 640',
                 depth: "encoding '32FC1'"}
        check_each(words, lambda change: self.refused(change, words[change]))
        errors = [m for m in self.log.with_words('is refused') if m.level == m.ERROR]
        self.assertGreaterEqual(len(errors), 1)
        self.assertIn('/camera/image_raw', errors[0].msg)

    def test_the_error_is_throttled(self):
        """Every five seconds, however long this takes on a busy machine."""
        count = self.send_and_wait().refused_frames

        def refused():
            broken = image_message(view(100, 100), self.camera.next_stamp())
            broken.step = 1
            self.camera.send(broken)
            return self.refused_count() > count + 50
        wait_until(refused, 'refused images are counted')
        self.send_and_wait()
        said = [m.header.stamp.to_sec() for m in self.log.with_words('is refused')]
        self.assertGreaterEqual(len(said), 1)
        self.assertTrue((np.diff(said) > 4.5).all(), said)
