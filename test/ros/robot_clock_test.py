"""Simulated time without a clock, a clock that stands, and a stabilizer with a wrong topic and a
misspelt parameter: the values and messages."""

import unittest

import rospy
from diagnostic_msgs.msg import DiagnosticStatus
from ktgp_orb.msg import MatchStatistics
from ktgp_testing import Camera, Diagnostics, Log, Recorder, node, wait_for_matcher, wait_until
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Image

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR


class ClockTest(unittest.TestCase):
    def test_each_trouble_is_said(self):
        diagnostics = Diagnostics()
        log = Log()
        camera = Camera()
        statistics = Recorder('/camera/matcher/statistics', MatchStatistics)
        wait_for_matcher(camera, statistics)
        steady = Recorder('/camera/stabilizer/image', Image)
        wait_until(steady.publishers, 'the stabilizer runs')

        def says(task, level, words, send=True):
            seen = len(diagnostics.messages())

            def said():
                if send:
                    camera.send_view()
                return [s for s in diagnostics.of(task, seen) if s.level == level and words in s.message]
            wait_until(said, '%s says "%s"' % (task, words))

        # No clock at all.
        says('latency', WARN, '/clock has no publisher')
        says('matcher: matcher', OK, 'homographies found')
        self.assertEqual({m.latency_milliseconds for m in statistics.messages()}, {0.0})
        # Nothing arrives on the topic of the stabilizer.
        says('stabilizer: input', ERROR, 'no homography on /camera/matcher/nowhere')
        words = ('no homography on /camera/matcher/nowhere for 5 s (0 publishers): no node publishes '
                 '/camera/matcher/nowhere: is the topic name right?')
        log.wait_for_words(words)
        # A clock that started and then stands: no problem.
        clock = rospy.Publisher('/clock', Clock, queue_size=1, latch=True)
        clock.publish(Clock(rospy.Time(1000)))
        says('matcher: input', OK, 'the clock stands', send=False)
        says('stabilizer: input', OK, 'the clock stands', send=False)

    def test_unknown_parameters_are_named(self):
        for kind in ('matcher', 'stabilizer', 'mosaic'):
            with node(kind, 'misspelt_' + kind, '_T_w_:=1.0') as misspelt:
                hint = '; did you mean T_w?' if kind == 'matcher' else ''
                self.assertTrue(misspelt.says('parameter /misspelt_%s/T_w_ is not known to this node and has no '
                                              'effect%s' % (kind, hint)),
                                misspelt.output())

    def test_parameters_one_level_too_deep_are_named_and_those_of_plugins_are_not(self):
        rospy.set_param('/nested', {'matcher': {'T_w': 0.7, 'other': 1}, 'T_w_': 1.0,
                                    'matches_image': {'compressed': {'format': 'png', 'jpeg_quality': 90}}})
        with node('matcher', 'nested') as nested:
            self.assertTrue(nested.says('/nested/T_w_ is not known', 'parameter /nested/matcher/T_w has no effect on '
                                        'this node; expected /nested/T_w'), nested.output())
            self.assertTrue(nested.says('matches images on'), nested.output())
        for words in ('jpeg_quality', '/format', 'other'):
            self.assertNotIn(words, nested.output())
