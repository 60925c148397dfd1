"""A bag with --clock, paused and resumed: no false alarm, and matching continues."""

import unittest

import rospy
from diagnostic_msgs.msg import DiagnosticStatus
from ktgp_orb.msg import MatchStatistics, MatchStatus
from ktgp_testing import Diagnostics, Log, Recorder, wait_until
from std_srvs.srv import SetBool

SECONDS = 7  # of pause, in reports of the diagnostics: one comes each second; a warning after five


class PausedBagTest(unittest.TestCase):
    def test_pause_and_resume(self):
        statistics = Recorder('/camera/matcher/statistics', MatchStatistics)
        diagnostics = Diagnostics()
        log = Log()
        wait_until(lambda: len(statistics.messages()) > 3, 'the bag plays')
        rospy.wait_for_service('/player/pause_playback')
        pause = rospy.ServiceProxy('/player/pause_playback', SetBool)
        self.assertTrue(pause(True).success)
        wait_until(lambda: sum('the clock stands' in s.message for s in diagnostics.of('input')) >= SECONDS,
                   'the diagnostics have seen the clock stand for %d s' % SECONDS)
        paused = statistics.messages()
        self.assertTrue(pause(False).success)
        wait_until(lambda: len(statistics.messages()) > len(paused) + 5, 'the matching goes on')
        resumed = statistics.messages()[len(paused) + 2:]
        self.assertTrue(any(s.status == MatchStatus.STATUS_OK for s in resumed))
        for s in resumed:
            self.assertLess(s.latency_milliseconds, 5000)
        self.assertEqual([s.message for s in diagnostics.of('input') if s.level == DiagnosticStatus.ERROR], [])
        self.assertEqual(log.with_words('no image on'), [])
