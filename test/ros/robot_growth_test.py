"""Growth in the matcher: for a fixed reference and ~match_pair, never for the frame before."""

import cv2
import numpy as np
import rospy
from ktgp_orb.msg import MatchStatistics, MatchStatus
from ktgp_orb.srv import MatchPair
from ktgp_testing import MatcherCase, image_message, mapped

ROBUST = {'mutual': True, 'T_w': 1.0, 'gms': False, 'growth': True, 'guided': True}
OK = MatchStatus.STATUS_OK
SIZE = (640, 480)
SIDE = 150  # px of the part that both pictures show: one match in fifteen is right
TURN = cv2.getRotationMatrix2D((320, 240), 35, 1.0)  # of it, about the middle of both


def scene(seed):
    """Rectangles; no two scenes show the same."""
    random = np.random.RandomState(seed)
    picture = np.full(SIZE[::-1], 128, np.uint8)
    for _ in range(900):
        x, y = int(random.randint(-20, SIZE[0])), int(random.randint(-20, SIZE[1]))
        width, height = (int(v) for v in random.randint(4, 25, 2))
        cv2.rectangle(picture, (x, y), (x + width, y + height), int(random.randint(0, 256)), -1)
    return cv2.GaussianBlur(picture, (0, 0), 0.8)


def hard_pair():
    """A picture, and another one that shows a small part of it, turned."""
    reference, target = scene(1), scene(2)
    part = np.zeros_like(reference)
    part[240 - SIDE // 2:240 + SIDE // 2, 320 - SIDE // 2:320 + SIDE // 2] = 255
    turned = cv2.warpAffine(reference, TURN, SIZE)
    shown = cv2.warpAffine(part, TURN, SIZE, flags=cv2.INTER_NEAREST) > 0
    target[shown] = turned[shown]
    return reference, target


class GrowthTest(MatcherCase):
    topics = 'statistics', 'homography'

    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.reference, cls.target = hard_pair()

    def start(self, **parameters):
        """With a fixed reference, the next picture is that."""
        self.configure(**dict(ROBUST, **parameters))
        self.call('reset')
        if parameters['reference_mode'] == 'fixed':
            self.call('set_reference')

    def check_grown(self, statistics, homography):
        self.assertEqual((statistics.status, statistics.found_by),
                         (OK, MatchStatistics.FOUND_BY_GROWTH))
        self.assertGreater(statistics.growth_seeds, 0)
        stage = next(s for s in statistics.stages if s.name == 'growth')
        self.assertGreater(stage.output, 12)
        self.assertGreater(stage.milliseconds, 0)
        self.assertGreaterEqual(statistics.total_milliseconds,
                                sum(s.milliseconds for s in statistics.stages))
        corners = ((270, 190), (370, 190), (370, 290), (270, 290))
        np.testing.assert_allclose(mapped(homography.homography, corners), [TURN @ (*c, 1) for c in corners], atol=2)

    def test_a_fixed_reference_is_found_where_little_of_it_is_seen(self):
        self.start(reference_mode='fixed')
        self.send(self.reference)
        statistics = self.send(self.target)
        self.check_grown(statistics, self.homography.wait_for(statistics.header.stamp))
        easy = self.send(self.reference)
        self.assertEqual((easy.found_by, easy.growth_seeds), (MatchStatistics.FOUND_BY_PROSAC, 0))

    def test_not_without_the_parameter_and_never_for_the_frame_before(self):
        for parameters in ({'reference_mode': 'fixed', 'growth': False}, {'reference_mode': 'previous'}):
            self.start(**parameters)
            self.send(self.reference)
            statistics = self.send(self.target)
            self.assertNotEqual(statistics.status, OK)
            self.assertEqual((statistics.found_by, statistics.growth_seeds), (MatchStatistics.FOUND_BY_NONE, 0))
            self.assertNotIn('growth', [s.name for s in statistics.stages])

    def test_match_pair(self):
        self.start(reference_mode='previous')
        match = rospy.ServiceProxy('/camera/matcher/match_pair', MatchPair)
        answer = match(image_message(self.reference, rospy.Time(5)),
                       image_message(self.target, rospy.Time(6)))
        self.assertTrue(answer.success, answer.message)
        self.check_grown(answer.statistics, answer.homography)
