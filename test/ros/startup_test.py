#!/usr/bin/python3
"""What a user is told at start: wrong topic, wrong parameter, misspelt parameter."""

import subprocess
import sys
import unittest

import rospy
import rostest
from ktgp_orb.msg import MatchStatistics
from ktgp_testing import Recorder, check_each, wait_until
from rosgraph_msgs.msg import Log


def start_node(*parameters):
    """Runs a second matcher until it ends, or for a few seconds; its exit code and what it said."""
    process = subprocess.Popen(
        ['roslaunch', 'ktgp_orb', 'matcher.launch', 'namespace:=other'] + list(parameters),
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, universal_newlines=True)
    try:
        return process.communicate(timeout=20)[0]
    except subprocess.TimeoutExpired:
        process.terminate()
        return process.communicate()[0]


class StartupTest(unittest.TestCase):
    def test_a_wrong_topic_is_named_after_five_seconds(self):
        log = Recorder('/rosout', Log)
        Recorder('/camera/matcher/statistics', MatchStatistics)

        def warning():
            return any(m.level == Log.WARN and 'no image on /camera/no_such_topic' in m.msg
                       for m in log.messages())
        wait_until(warning, 'the topic is named in a warning')

    def test_a_threshold_out_of_range_is_refused_with_its_range(self):
        words = {
            'T_w:=1.5': '/other/matcher/T_w is 1.5; expected a value in [0.01, 1]',
            'T_G:=-1.0': '/other/matcher/T_G is -1; expected a value in [0, 20]',
            'features:=0': '/other/matcher/features is 0; expected a value in [1, 100000]',
            'reference_mode:=nearest': "reference_mode is 'nearest'; expected previous"}

        def check(parameter):
            output = start_node(parameter)
            self.assertIn(words[parameter], output)
            self.assertIn('process has died', output)
        check_each(words, check)

    def test_a_missing_transport_names_its_package(self):
        output = start_node('transport:=no_such_transport')
        self.assertIn("image transport 'no_such_transport' is not installed", output)
        self.assertIn('no_such_transport_image_transport', output)

    def test_a_misspelt_parameter_is_named(self):
        log = Recorder('/rosout', Log)
        rospy.set_param('/other/matcher/ratio_treshold', 0.7)
        process = subprocess.Popen(['roslaunch', 'ktgp_orb', 'matcher.launch', 'namespace:=other'])
        try:
            wait_until(lambda: any('/other/matcher/ratio_treshold is not known' in m.msg
                                   for m in log.messages()), 'the parameter is named')
        finally:
            process.terminate()
            process.wait()
            rospy.delete_param('/other/matcher/ratio_treshold')


if __name__ == '__main__':
    rospy.init_node('startup_test')
    rostest.rosrun('ktgp_orb', 'startup', StartupTest, sys.argv)
