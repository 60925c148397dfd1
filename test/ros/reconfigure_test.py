#!/usr/bin/python3
"""T_w and T_G change the number of matches in the right direction, while images arrive."""

import statistics
import sys
import threading
import unittest

import rospy
import rostest
from dynamic_reconfigure.client import Client
from ktgp_orb.cfg import KtgpConfig
from ktgp_orb.msg import MatchStatistics, MatchStatus
from ktgp_testing import TIMEOUT, Camera, Recorder, wait_until


class ReconfigureTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.client = Client('/camera/matcher', timeout=TIMEOUT)
        cls.statistics = Recorder('/camera/matcher/statistics', MatchStatistics)
        cls.camera = Camera()
        cls.camera.wait_for_subscriber()
        cls.traffic = True
        cls.thread = threading.Thread(target=cls.send_images)
        cls.thread.start()

    @classmethod
    def tearDownClass(cls):
        cls.traffic = False
        cls.thread.join()

    @classmethod
    def send_images(cls):
        while cls.traffic and not rospy.is_shutdown():
            cls.camera.send_view()
            rospy.rostime.wallsleep(0.03)

    def tearDown(self):
        self.client.update_configuration({'descriptor': 'orb', 'T_w': 0.0, 'T_G': 6.0})

    def usual_outputs(self, **parameters):
        """Median output of each stage over ten frames that were sent after the change: at one frame of sixty the
        camera jumps back."""
        self.client.update_configuration(parameters)
        changed = self.camera.last_stamp()

        def frames():
            return [m for m in self.statistics.messages()
                    if m.header.stamp > changed and m.status == MatchStatus.STATUS_OK]
        wait_until(lambda: len(frames()) >= 10, 'ten frames with %s' % parameters)
        return {stage: statistics.median(m.stages[i].output for m in frames())
                for i, stage in enumerate(('knn', 'tf', 'gms', 'prosac'))}

    def test_a_higher_ratio_threshold_lets_more_through(self):
        outputs = [self.usual_outputs(T_w=value)['tf'] for value in (0.4, 0.6, 0.8, 1.0)]
        self.assertEqual(outputs, sorted(outputs))
        self.assertLess(outputs[0], 0.9 * outputs[3])

    def test_a_higher_motion_threshold_lets_less_through(self):
        outputs = [self.usual_outputs(T_w=0.8, T_G=value)['gms'] for value in (0.0, 6.0, 20.0)]
        self.assertEqual(outputs, sorted(outputs, reverse=True))
        self.assertGreater(outputs[0], outputs[2])

    def test_fewer_features_mean_fewer_candidates(self):
        few = self.usual_outputs(features=200)['knn']
        many = self.usual_outputs(features=2000)['knn']
        self.assertLessEqual(few, 200)
        self.assertLessEqual(many, 2000)
        self.assertGreater(many, 4 * few)

    def test_the_ratio_threshold_is_the_descriptors_unless_it_is_set(self):
        for descriptor, its, another in (('orb', 0.66, 0.8), ('teblid', 0.8, 0.66)):
            usual, chosen, other = [self.usual_outputs(descriptor=descriptor, T_w=value)['tf']
                                    for value in (0.0, its, another)]
            self.assertLess(abs(usual - chosen), 0.5 * abs(usual - other), descriptor)

    def test_out_of_range_values_are_clamped(self):
        result = self.client.update_configuration({'T_w': 7.0, 'T_G': -3.0})
        self.assertEqual(result['T_w'], 1.0)
        self.assertEqual(result['T_G'], 0.0)

    def test_what_no_clamp_catches_is_refused(self):
        for name, default in KtgpConfig.defaults.items():
            if isinstance(default, float):
                result = self.client.update_configuration({name: float('nan')})
                self.assertEqual(result[name], default, name)
        result = self.client.update_configuration({'reference_mode': 'no such mode'})
        self.assertEqual(result['reference_mode'], 'previous')

    def test_the_thresholds_stand_first(self):
        names = [parameter['name'] for parameter in self.client.get_parameter_descriptions()]
        self.assertEqual(names[:2], ['T_w', 'T_G'])


if __name__ == '__main__':
    rospy.init_node('reconfigure_test')
    rostest.rosrun('ktgp_orb', 'reconfigure', ReconfigureTest, sys.argv)
