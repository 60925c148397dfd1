"""A bag through the live matcher, frame by frame: every message is there, consistent and true.

Parameters: ~bag, ~topic, ~truth_topic (homographies from frame to frame; may be empty) and
~segment_topic (names of the parts of the demo bag; may be empty). Each frame is sent after the
statistics of the previous one, so that none is dropped on a busy machine.
"""

import numpy as np
import rosbag
import rospy
from ktgp_orb.msg import Correspondences, MatchStatus
from ktgp_testing import MatcherCase, corners_off, mapped

STAGES = ['knn', 'tf', 'gms', 'prosac', 'align']


class BagTest(MatcherCase):
    topics = 'statistics', 'correspondences', 'homography'

    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        path, topic = rospy.get_param('~bag'), rospy.get_param('~topic', '/camera/image_raw')
        cls.truth, cls.segments, cls.headers = {}, {}, []
        topics = {topic, rospy.get_param('~truth_topic', ''), rospy.get_param('~segment_topic', '')}
        with rosbag.Bag(path) as bag:
            for name, message, time in bag.read_messages(topics=sorted(topics - {''})):
                if name == topic:
                    cls.size = (message.width, message.height)
                    cls.headers.append(message.header)
                    cls.statistics.wait_for(cls.camera.send(message))
                elif name == rospy.get_param('~truth_topic', ''):
                    cls.truth[message.header.stamp] = message
                else:
                    cls.segments[time] = message.data
        last = cls.headers[-1].stamp
        cls.correspondences.wait_for(last)
        cls.homography.wait_for(last)

    def pairs(self):
        """Headers of each frame and of the previous one."""
        return list(zip(self.headers[1:], self.headers))

    def test_every_frame_has_every_message_with_its_header(self):
        self.assertGreater(len(self.headers), 10)
        statistics = self.statistics.messages()
        self.assertEqual([m.header.stamp for m in statistics], [h.stamp for h in self.headers])
        self.assertEqual(statistics[0].status, MatchStatus.STATUS_NO_REFERENCE)
        self.assertEqual(statistics[0].reason, MatchStatus.REASON_FIRST_FRAME)
        self.assertEqual([(s.name, s.output) for s in statistics[0].stages],
                         [(name, 0) for name in STAGES])
        self.assertEqual(statistics[-1].dropped_frames + statistics[-1].lost_frames, 0)
        self.assertEqual(len(self.correspondences.messages()), len(self.headers) - 1)
        self.assertEqual(len(self.homography.messages()), len(self.headers))
        for header, before in self.pairs():
            for recorder in (self.statistics, self.correspondences, self.homography):
                message = recorder.with_stamp(header.stamp)
                self.assertEqual(message.header.frame_id, header.frame_id)
                self.assertEqual(message.reference_stamp, before.stamp)

    def test_statistics_are_consistent(self):
        for m in self.statistics.messages()[1:]:
            self.assertEqual([stage.name for stage in m.stages], STAGES)
            self.assertEqual(m.stages[0].input, m.target_features)
            for stage, following in zip(m.stages, m.stages[1:]):
                self.assertEqual(stage.output, following.input)
                self.assertLessEqual(following.output, following.input)
            self.assertEqual([m.kt, m.ktg], [stage.output for stage in m.stages[1:3]])
            self.assertLessEqual(m.inliers, m.ktg)  # no guided matching here
            self.assertAlmostEqual(m.retention, m.stages[1].output / m.stages[1].input)
            parts = m.extraction_milliseconds + sum(stage.milliseconds for stage in m.stages)
            self.assertAlmostEqual(m.total_milliseconds, parts, places=6)
            self.assertEqual(m.reference_features, self.before(m).target_features)

    def before(self, statistics):
        return self.statistics.with_stamp(statistics.reference_stamp)

    def test_correspondences_agree_with_statistics_and_homography(self):
        for m in self.correspondences.messages():
            statistics = self.statistics.with_stamp(m.header.stamp)
            homography = self.homography.with_stamp(m.header.stamp)
            levels = np.frombuffer(m.level, np.uint8)
            for level, stage in ((Correspondences.LEVEL_KT, 1), (Correspondences.LEVEL_KTG, 2)):
                self.assertEqual((levels >= level).sum(), statistics.stages[stage].output)
            arrays = (m.reference_x, m.reference_y, m.target_x, m.target_y, m.distance, m.ratio,
                      m.reference_index, m.target_index, m.track)
            self.assertEqual({len(array) for array in arrays}, {len(levels)})
            self.assertEqual((m.image_width, m.image_height), self.size)
            if len(levels):
                self.assertLess(max(m.ratio), 0.66)
                self.assertLess(max(m.target_index), statistics.target_features)
                self.assertLess(max(m.reference_index), statistics.reference_features)
            self.assertEqual(homography.status, statistics.status)
            if homography.status != MatchStatus.STATUS_OK:
                continue
            # The final matches are those within 3 px of the published homography.
            reference = np.column_stack([m.reference_x, m.reference_y]).astype(float)
            target = np.column_stack([m.target_x, m.target_y]).astype(float)
            errors = np.linalg.norm(mapped(homography.homography, reference) - target, axis=1)
            clear = np.abs(errors - 3.0) > 1e-6
            survived = levels >= Correspondences.LEVEL_KTG
            np.testing.assert_array_equal((levels == Correspondences.LEVEL_KTGP)[clear & survived],
                                          (errors < 3.0)[clear & survived])
            self.assertEqual(homography.inliers, (levels == Correspondences.LEVEL_KTGP).sum())
            final = errors[levels == Correspondences.LEVEL_KTGP]
            self.assertAlmostEqual(homography.reprojection_rmse, np.sqrt((final ** 2).mean()),
                                   places=4)

    def test_most_frames_find_their_homography(self):
        ok = [m.status == MatchStatus.STATUS_OK for m in self.statistics.messages()[1:]]
        self.assertGreaterEqual(np.mean(ok), 0.9)

    def test_homographies_are_within_a_pixel_of_the_truth(self):
        if not self.truth:
            return  # a real recording has none
        errors = []
        for header, _ in self.pairs():
            if self.segment(header.stamp) != 'clean':
                continue
            message = self.homography.with_stamp(header.stamp)
            truth = self.truth[header.stamp]
            self.assertEqual(truth.reference_stamp, message.reference_stamp)
            found = message.status == MatchStatus.STATUS_OK
            errors.append(np.linalg.norm(corners_off(message.homography, truth.homography, self.size), axis=1).max()
                          if found else np.inf)
        self.assertGreater(len(errors), 30)
        share = np.mean(np.array(errors) < 1.0)
        print('corner error on %d clean frames: median %.3f px, %.1f %% below 1 px'
              % (len(errors), np.median(errors), 100 * share))
        self.assertGreaterEqual(share, 0.95)

    def segment(self, stamp):
        return self.segments.get(stamp, 'clean')
