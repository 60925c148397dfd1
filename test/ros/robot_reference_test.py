"""Reference modes and services: the reference of each frame, also with unusual stamps, as from faulty cameras and other
clocks; and growth from a reference that stays."""

import os
import tempfile
import time

import cv2
import numpy as np
import rospy
from ktgp_orb.msg import MatchStatistics, MatchStatus
from ktgp_orb.srv import MatchPair
from ktgp_testing import (Diagnostics, MatcherCase, check_each, image_message, mapped, of_matcher, texture, translation,
                          view, wait_until)
from sensor_msgs.msg import Image

DEFAULTS = {'reference_mode': 'previous', 'reference_image': '',
            'max_reference_age': 1.0, 'gms_scale': False, 'roi': ''}
OK = MatchStatus.STATUS_OK
NO_REFERENCE = MatchStatus.STATUS_NO_REFERENCE
PAN = 20  # px that the camera moves right from frame to frame
WIDTH, HEIGHT = 640, 480
NONE, RESET = MatchStatus.REASON_NONE, MatchStatus.REASON_RESET
BACK, GAP = MatchStatus.REASON_STAMP_WENT_BACK, MatchStatus.REASON_GAP
LAST = 4294967295.0  # s, the largest stamp there is
# Stamps, and the reason why each frame has no reference, or NONE for one that is matched.
SEQUENCES = {
    'steady': ((10.0, RESET), (10.1, NONE), (10.2, NONE)),
    'repeated': ((20.0, RESET), (20.0, NONE), (20.0, NONE), (20.1, NONE)),
    'going back': ((30.0, RESET), (30.1, NONE), (29.9, BACK), (30.0, NONE)),
    'zero': ((0.0, RESET), (0.0, NONE), (0.0, NONE)),
    'zero in between': ((40.0, RESET), (40.1, NONE), (0.0, BACK), (40.2, NONE), (40.3, NONE)),
    'jumping ahead': ((50.0, RESET), (50.1, NONE), (52.0, GAP), (52.1, NONE)),
    'a century ahead and back': ((60.0, RESET), (LAST, GAP), (LAST, NONE), (60.1, BACK),
                                 (60.2, NONE)),
}
ROBUST = {'mutual': True, 'T_w': 1.0, 'gms': False, 'growth': True, 'guided': True}
SIDE = 150  # px of the part that both pictures of a hard pair show
TURN = cv2.getRotationMatrix2D((320, 240), 35, 1.0)  # of it, about the middle of both


def hard_pair():
    """A picture, and another one that shows a small part of it, turned."""
    reference, target = texture(HEIGHT, WIDTH, seed=21), texture(HEIGHT, WIDTH, seed=22)
    part = np.zeros_like(reference)
    part[240 - SIDE // 2:240 + SIDE // 2, 320 - SIDE // 2:320 + SIDE // 2] = 255
    turned = cv2.warpAffine(reference, TURN, (WIDTH, HEIGHT))
    shown = cv2.warpAffine(part, TURN, (WIDTH, HEIGHT), flags=cv2.INTER_NEAREST) > 0
    target[shown] = turned[shown]
    return reference, target


HARD = hard_pair()


class ReferenceTest(MatcherCase):
    topics = 'statistics', 'homography', 'accumulated_homography', 'correspondences'

    def setUp(self):
        self.client.update_configuration(DEFAULTS)
        self.call('reset')

    def send(self, x, y=100):
        """Statistics of a frame that shows the picture from x, y."""
        return super().send(view(x, y))

    def images_arrived(self):
        """As the matcher's next report has it; the one after it, since the first may be on its way."""
        reports = Diagnostics(self)
        wait_until(lambda: len(reports.of(': input')) > 1, 'the matcher reports')
        return int(reports.values(': input')[-1]['images'])

    def pan(self, frames):
        return [self.send(100 + PAN * i) for i in range(frames)]

    def check_translation(self, message, x, y):
        for measured, true in zip(translation(message), (x, y)):
            self.assertAlmostEqual(measured, true, delta=1.5)

    def test_a_keyframe_stays_until_the_overlap_is_too_small(self):
        self.client.update_configuration({'reference_mode': 'keyframe'})
        limit = int(0.5 * WIDTH / PAN)  # frames until it covers half: 1 - 20 * frames / 640 >= 0.5
        statistics = self.pan(2 * limit + 2)
        stamps = [s.header.stamp for s in statistics]
        references = [stamps.index(s.reference_stamp) for s in statistics[1:]]
        lasted = references.count(0)
        self.assertIn(lasted, (limit - 1, limit))  # the limit itself is met to the last bit
        self.assertIn(references[lasted], (lasted - 1, lasted))
        for i, (s, reference) in enumerate(zip(statistics[1:], references), 1):
            before = references[i - 2] if i > 1 else None
            self.assertEqual(s.reference_changed, reference != before, 'frame %d' % i)
            homography = self.homography.wait_for(stamps[i])
            self.assertEqual(homography.reference_stamp, s.reference_stamp)
            self.check_translation(homography, -PAN * (i - reference), 0)

    def drift(self, mode):
        """Error of the centre of the first frame after a pan over half the frame, px."""
        self.client.update_configuration({'reference_mode': mode})
        self.call('reset')
        statistics = self.pan(16)
        self.assertIsNone(self.accumulated_homography.with_stamp(statistics[0].header.stamp))
        for i, s in enumerate(statistics[1:], 1):
            accumulated = self.accumulated_homography.wait_for(s.header.stamp)
            self.assertEqual(accumulated.reference_stamp, statistics[0].header.stamp)
            middle = np.array((WIDTH / 2, HEIGHT / 2))
            error = np.linalg.norm(mapped(accumulated.homography, [middle])[0] - middle + (PAN * i, 0))
            self.assertLess(error, 0.5 * i, '%s, frame %d' % (mode, i))
        return error

    def test_the_accumulated_homography_goes_back_to_the_first_frame(self):
        keyframe, previous = self.drift('keyframe'), self.drift('previous')
        print('drift after 15 frames: keyframe %.3f px, previous %.3f px' % (keyframe, previous))
        # Each step of whole pixels is exact to 1e-4 px, so there is next to nothing to add up.
        self.assertLess(keyframe, 0.01)
        self.assertLess(previous, 0.01)

    def test_the_mode_changes_at_run_time(self):
        first = self.pan(2)[0].header.stamp
        self.client.update_configuration({'reference_mode': 'keyframe'})
        key = self.send(140)
        self.assertEqual(key.status, NO_REFERENCE)
        self.assertGreater(key.header.stamp, first)
        for x in (160, 180, 200):
            self.assertEqual(self.send(x).reference_stamp, key.header.stamp)
        self.client.update_configuration({'reference_mode': 'previous'})
        before = self.send(220)
        self.assertEqual(self.send(240).reference_stamp, before.header.stamp)

    def test_set_reference_fixes_the_next_frame_until_reset(self):
        self.client.update_configuration({'reference_mode': 'fixed'})
        self.assertEqual(self.send(100).status, NO_REFERENCE)
        self.call('set_reference')
        fixed = self.send(200)
        self.assertEqual(fixed.reference_stamp, fixed.header.stamp)
        for x in (260, 180, 220):
            s = self.send(x)
            self.assertEqual((s.status, s.reference_stamp), (OK, fixed.header.stamp))
            self.check_translation(self.homography.wait_for(s.header.stamp), 200 - x, 0)
        self.call('reset')
        self.assertEqual(self.send(200).status, NO_REFERENCE)
        self.call('set_reference')
        self.call('reset')  # takes the wish back, too
        self.assertEqual(self.send(200).status, NO_REFERENCE)

    def test_set_reference_waits_for_a_usable_frame(self):
        self.client.update_configuration({'reference_mode': 'fixed'})
        before = self.send(150)
        self.assertEqual(before.reason, MatchStatus.REASON_NOT_SET)
        self.call('set_reference')
        self.camera.show(np.zeros((HEIGHT, WIDTH), np.float32), '32FC1')
        # The depth image may be replaced by the next one before it is looked at, or before it arrives.
        fixed = self.send(200)
        self.assertEqual(fixed.refused_frames - before.refused_frames +
                         fixed.dropped_frames - before.dropped_frames +
                         fixed.lost_frames - before.lost_frames, 1)
        self.assertEqual((fixed.status, fixed.reference_stamp), (OK, fixed.header.stamp))
        after = self.send(220)
        self.assertEqual(after.reference_stamp, fixed.header.stamp)
        self.check_translation(self.homography.wait_for(after.header.stamp), -20, 0)
        self.assertEqual(after.refused_frames, fixed.refused_frames)

    def test_an_image_file_of_another_size_is_a_target(self):
        path = os.path.join(tempfile.mkdtemp(), 'target.png')
        cv2.imwrite(path, view(300, 200, 320, 240))
        # Half the size: half the cell size of GMS's grid, which is a scale to it.
        self.client.update_configuration({'reference_mode': 'fixed', 'reference_image': path,
                                          'gms_scale': True})
        s = self.send(200, 150)
        self.assertEqual(s.status, OK)
        self.assertLess(s.reference_stamp, rospy.Time(0, 1000))
        # Point (0, 0) of the target is at (300, 200) of the picture.
        self.check_translation(self.homography.wait_for(s.header.stamp), 100, 50)
        matches = self.correspondences.wait_for(s.header.stamp)
        self.assertEqual((matches.reference_width, matches.reference_height), (320, 240))
        self.assertEqual((matches.image_width, matches.image_height), (WIDTH, HEIGHT))
        self.assertLess(max(matches.reference_x), 320)
        self.call('set_reference')
        fixed = self.send(220, 150)
        self.assertEqual(fixed.reference_stamp, fixed.header.stamp)
        self.call('reset')  # back to the file
        self.assertEqual(self.send(210, 150).reference_stamp, s.reference_stamp)

    def test_a_missing_image_file_is_refused(self):
        answer = self.client.update_configuration({'reference_image': '/no/such/image.png'})
        self.assertEqual(answer['reference_image'], '')

    def test_an_image_file_that_changes_is_read_again(self):
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, 'changing.png')
            cv2.imwrite(path, texture(HEIGHT, WIDTH, seed=9))
            self.client.update_configuration({'reference_mode': 'fixed', 'reference_image': path})
            self.assertNotEqual(self.send(200).status, OK)
            cv2.imwrite(path, view(210, 100))
            wait_until(lambda: self.send(200).status == OK, 'the file is read again')
            first = self.send(200).reference_stamp
            cv2.imwrite(path, view(220, 110))
            self.call('reset')
            wait_until(lambda: self.send(200).reference_stamp != first, 'another picture, another stamp')
            cv2.imwrite(path, texture(HEIGHT, WIDTH, seed=9))
            self.call('reset')
            wait_until(lambda: self.send(200).status != OK, '~reset reads it again')
            self.client.update_configuration(DEFAULTS)

    def test_a_file_that_changes_does_not_replace_the_reference_of_a_request(self):
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, 'changing.png')
            cv2.imwrite(path, view(210, 100))
            self.client.update_configuration({'reference_mode': 'fixed', 'reference_image': path})
            self.call('set_reference')
            fixed = self.send(200)
            self.assertEqual(fixed.reference_stamp, fixed.header.stamp)
            cv2.imwrite(path, texture(HEIGHT, WIDTH, seed=9))
            seen = len(self.diagnostics.messages())  # one a second, as the file is looked at
            wait_until(lambda: len(self.diagnostics.of(': input', seen)) > 4, 'the file was looked at')
            again = self.send(220)
            self.assertEqual((again.status, again.reference_stamp), (OK, fixed.header.stamp))
            self.call('reset')
            wait_until(lambda: self.send(200).status != OK, 'then the file counts')
            self.client.update_configuration(DEFAULTS)

    def test_the_request_for_a_reference_outlives_the_subscribers(self):
        self.client.update_configuration({'reference_mode': 'fixed'})
        self.send(180)
        self.call('set_reference')
        for name in self.topics:
            getattr(self, name).close()
        self.camera.wait_for_no_subscriber()
        for name in self.topics:
            setattr(type(self), name, of_matcher(name))
        self.camera.wait_for_subscriber()
        fixed = self.send(200)
        self.assertEqual(fixed.reference_stamp, fixed.header.stamp)

    def test_pause_and_resume(self):
        before = self.pan(2)[-1]
        self.call('pause')
        arrived = self.images_arrived()
        unseen = self.camera.show(view(140, 100))
        wait_until(lambda: self.images_arrived() == arrived + 1, 'it arrives while paused')
        # An image sent after `unseen` has gone through shows that `unseen` was ignored.
        self.call('resume')
        after = self.send(160)
        self.assertIsNone(self.statistics.with_stamp(unseen))
        self.assertEqual((after.status, after.reference_stamp), (OK, before.header.stamp))

    def test_match_pair_leaves_the_stream_alone(self):
        match = rospy.ServiceProxy('/camera/matcher/match_pair', MatchPair)
        self.client.update_configuration({'roi': '0 0 300 480'})  # the camera's, not the pair's
        before = self.pan(2)[-1]
        reference = image_message(view(400, 300), rospy.Time(5))
        target = image_message(view(410, 320), rospy.Time(6))
        answer = match(reference, target)
        self.assertTrue(answer.success, answer.message)
        self.assertEqual(answer.statistics.status, OK)
        self.assertEqual(answer.homography.reference_stamp, rospy.Time(5))
        self.assertEqual(answer.homography.header.stamp, rospy.Time(6))
        self.check_translation(answer.homography, -10, -20)
        self.assertGreater(max(answer.correspondences.reference_x), 400)
        self.assertEqual(len(answer.correspondences.level), answer.statistics.stages[1].output)
        self.assertEqual(self.send(140).reference_stamp, before.header.stamp)

    def test_match_pair_refuses_what_is_larger_than_asked_for(self):
        match = rospy.ServiceProxy('/camera/matcher/match_pair', MatchPair)
        good = image_message(view(400, 300), rospy.Time(5))
        large = Image(width=9000, height=8000, encoding='mono8', step=9000)
        for pair, name in (((good, large), 'target'), ((large, good), 'reference')):
            answer = match(*pair)
            self.assertFalse(answer.success)
            self.assertEqual(answer.message, name + ' is 9000x8000 (72 megapixels); expected 64 at most')

    def test_diagnostics_go_on_while_a_pair_is_matched(self):
        """While the matcher works for seconds on a pair, it reports once a second."""
        reports = Diagnostics(self)
        wait_until(reports.messages, 'the matcher reports')
        large = image_message(np.tile(view(0, 0, 1600, 1200), (5, 5)), rospy.Time(5))
        self.client.update_configuration({'features': 20000, 'gms_rotation': True})
        self.addCleanup(self.client.update_configuration,
                        {'features': 2000, 'gms_rotation': False})
        before, start = len(reports.messages()), time.time()
        rospy.ServiceProxy('/camera/matcher/match_pair', MatchPair)(large, large)
        seconds, count = time.time() - start, len(reports.messages()) - before
        print('%d reports in %.1f s' % (count, seconds))
        self.assertGreaterEqual(count, 0.5 * seconds - 1)

    def test_match_pair_says_what_is_wrong_with_an_image(self):
        match = rospy.ServiceProxy('/camera/matcher/match_pair', MatchPair)
        good = image_message(view(400, 300), rospy.Time(5))
        bad = image_message(view(400, 300), rospy.Time(6), 'magenta')
        for pair, which in (((good, bad), 'target'), ((bad, good), 'reference')):
            answer = match(*pair)
            self.assertFalse(answer.success)
            self.assertEqual(answer.statistics.status, NO_REFERENCE, 'not OK, which is zero')
            self.assertEqual(answer.homography.status, NO_REFERENCE)
            self.assertIn("%s: encoding 'magenta'" % which, answer.message)

    def test_each_sequence_of_stamps_has_its_reference(self):
        def check(name):
            self.call('reset')
            for number, (seconds, reason) in enumerate(SEQUENCES[name]):
                # Counted, since the frame before may have had the same stamp.
                counts = {topic: len(topic.messages()) for topic in (self.statistics, self.homography)}
                stamp = rospy.Time.from_sec(seconds)
                self.camera.send(image_message(view(100 + 5 * number, 100), stamp))
                for topic, count in counts.items():
                    def answers(topic=topic, count=count):
                        return topic.messages()[count:]
                    wait_until(answers, 'frame %d of "%s" is on %s' % (number, name, topic.topic))
                    self.assertEqual([(m.header.stamp, m.reason, m.status) for m in answers()],
                                     [(stamp, reason, OK if reason == NONE else NO_REFERENCE)], 'frame %d' % number)
        check_each(SEQUENCES, check)

    def start_robust(self, **parameters):
        """With a fixed reference, the next picture is that."""
        before = self.client.get_configuration()
        self.addCleanup(self.configure, **{name: before[name] for name in ROBUST})
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

    def test_growth_finds_a_fixed_reference_where_little_of_it_is_seen(self):
        self.start_robust(reference_mode='fixed')
        super().send(HARD[0])
        statistics = super().send(HARD[1])
        self.check_grown(statistics, self.homography.wait_for(statistics.header.stamp))
        easy = super().send(HARD[0])
        self.assertEqual((easy.found_by, easy.growth_seeds), (MatchStatistics.FOUND_BY_PROSAC, 0))

    def test_growth_needs_the_parameter_and_is_never_used_for_the_previous_frame(self):
        for parameters in ({'reference_mode': 'fixed', 'growth': False}, {'reference_mode': 'previous'}):
            self.start_robust(**parameters)
            super().send(HARD[0])
            statistics = super().send(HARD[1])
            self.assertNotEqual(statistics.status, OK)
            self.assertEqual((statistics.found_by, statistics.growth_seeds), (MatchStatistics.FOUND_BY_NONE, 0))
            self.assertNotIn('growth', [s.name for s in statistics.stages])

    def test_match_pair_grows(self):
        self.start_robust(reference_mode='previous')
        match = rospy.ServiceProxy('/camera/matcher/match_pair', MatchPair)
        answer = match(*(image_message(picture, rospy.Time(5 + i)) for i, picture in enumerate(HARD)))
        self.assertTrue(answer.success, answer.message)
        self.check_grown(answer.statistics, answer.homography)
