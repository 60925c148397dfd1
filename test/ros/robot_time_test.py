"""Unusual stamps, as from faulty cameras and other clocks."""

import rospy
from ktgp_orb.msg import MatchStatus
from ktgp_testing import MatcherCase, check_each, image_message, view, wait_until

OK = MatchStatus.STATUS_OK
NO_REFERENCE = MatchStatus.STATUS_NO_REFERENCE
NONE, RESET = MatchStatus.REASON_NONE, MatchStatus.REASON_RESET
BACK, GAP = MatchStatus.REASON_STAMP_WENT_BACK, MatchStatus.REASON_GAP
LAST = 4294967295.0  # s, the largest stamp there is
# Stamps, and the reason why each frame has no reference, or NONE for one that is matched.
SEQUENCES = {
    'steady': ((10.0, RESET), (10.1, NONE), (10.2, NONE)),
    'repeated': ((20.0, RESET), (20.0, NONE), (20.0, NONE), (20.1, NONE)),
    'going back': ((30.0, RESET), (30.1, NONE), (29.9, BACK), (30.0, NONE)),
    'zero': ((0.0, RESET), (0.0, NONE), (0.0, NONE)),
    'zero in between': ((40.0, RESET), (40.1, NONE), (0.0, BACK), (40.2, GAP), (40.3, NONE)),
    'jumping ahead': ((50.0, RESET), (50.1, NONE), (52.0, GAP), (52.1, NONE)),
    'a century ahead and back': ((60.0, RESET), (LAST, GAP), (LAST, NONE), (60.1, BACK),
                                 (60.2, NONE)),
}


class TimeTest(MatcherCase):
    topics = 'statistics', 'homography'

    def test_each_sequence_of_stamps_has_its_reference(self):
        statistics, homography = self.statistics, self.homography

        def check(name):
            self.call('reset')
            for number, (seconds, reason) in enumerate(SEQUENCES[name]):
                count, homography_count = len(statistics.messages()), len(homography.messages())
                stamp = rospy.Time.from_sec(seconds)
                self.camera.send(image_message(view(100 + 5 * number, 100), stamp))
                wait_until(lambda: len(statistics.messages()) > count,
                           'frame %d of "%s" has statistics' % (number, name))
                message = statistics.messages()[-1]
                self.assertEqual(message.header.stamp, stamp)
                self.assertEqual(message.reason, reason, 'frame %d' % number)
                self.assertEqual(message.status, OK if reason == NONE else NO_REFERENCE)
                # Counted, since the frame before may have had the same stamp.
                wait_until(lambda: len(homography.messages()) > homography_count,
                           'frame %d of "%s" has a homography message' % (number, name))
                self.assertEqual(homography.messages()[-1].header.stamp, stamp)
                self.assertEqual(homography.messages()[-1].reason, reason)
        check_each(SEQUENCES, check)
