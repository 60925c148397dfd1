#!/usr/bin/python3
"""Messages at start: wrong topic, wrong parameter, misspelt parameter."""

import os
import subprocess
import sys
import tempfile
import threading
import time
import unittest

import cv2
import rospy
import rostest
from ktgp_orb.msg import MatchStatistics, MatchStatus
from ktgp_testing import Recorder, check_each, view, wait_until
from rosgraph_msgs.msg import Log
from sensor_msgs.msg import CompressedImage
from std_msgs.msg import Header


def output_of_node(*parameters, until, look=lambda: None, after=()):
    """Runs a second matcher until it has printed all of `until` and, after `look`, of `after`; returns its
    output."""
    return output_of_launch('matcher.launch', 'namespace:=other', *parameters, until=until,
                            namespaces=['/other'], look=look, after=after)


def output_of_launch(*arguments, until, namespaces, look=lambda: None, after=()):
    """Reads the messages from the output: on /rosout, those before the subscription is connected
    are lost."""
    process = subprocess.Popen(
        ['roslaunch', 'ktgp_orb'] + list(arguments),
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, universal_newlines=True,
        env=dict(os.environ, PYTHONUNBUFFERED='1'))
    lines = []

    def read():
        for line in process.stdout:
            lines.append(line)
    reader = threading.Thread(target=read)
    reader.start()

    def has_said(words):
        wait_until(lambda: not reader.is_alive() or all(word in ''.join(lines) for word in words),
                   'the second matcher ends or says %s' % (words,))
    try:
        has_said(until)
        look()
        has_said(after)
    finally:
        process.terminate()
        process.wait()
        reader.join()
        process.stdout.close()
        for namespace in namespaces:
            rospy.delete_param(namespace)  # else the next one has these parameters too
    return ''.join(lines)


class StartupTest(unittest.TestCase):
    def test_a_wrong_topic_is_named_after_five_seconds(self):
        log = Recorder('/rosout', Log)
        Recorder('/camera/matcher/statistics', MatchStatistics)

        def warning():
            return any(m.level == Log.WARN and 'no image on /camera/no_such_topic' in m.msg
                       for m in log.messages())
        wait_until(warning, 'the topic is named in a warning')

    def test_a_topic_without_publisher_is_named_also_while_idle(self):
        # Its results have no subscriber, so it subscribes to nothing: it asks the master.
        expected = 'no node publishes /other/nothing_here: is the topic name right?'
        self.assertIn(expected, output_of_node('image:=nothing_here', until=(expected,)))

    def test_compressed_images_on_the_wrong_topic_are_named_with_the_way_out(self):
        topics = ('/left/picture', '/right/picture/compressed')
        publishers = [rospy.Publisher(topic, CompressedImage, queue_size=1) for topic in topics]
        expected = (
            '/left/picture is of type sensor_msgs/CompressedImage; expected sensor_msgs/Image, or '
            'the topic without its last part and that as image_transport',
            'no node publishes /right/picture: is the topic name right? There is '
            '/right/picture/compressed, for image_transport compressed')
        output = output_of_launch('multi_camera.launch', 'cameras:=left right', 'image:=picture',
                                  until=expected, namespaces=['/left', '/right'])
        for text in expected:
            self.assertIn(text, output)
        for publisher in publishers:
            publisher.unregister()

    def test_compressed_images_are_matched_with_and_without_the_suffix(self):
        camera = rospy.Publisher('/other/picture/compressed', CompressedImage, queue_size=1)
        answers = Recorder('/other/matcher/statistics', MatchStatistics)

        def send(data, stamp):
            camera.publish(CompressedImage(header=Header(stamp=stamp), format='jpeg', data=data))

        def match_two_images():
            number = len(answers.messages())

            def matched():
                stamp = rospy.Time.now()
                send(cv2.imencode('.jpg', view(100, 100))[1].tobytes(), stamp)
                time.sleep(0.1)
                return any(m.status == MatchStatus.STATUS_OK for m in answers.messages()[number:])
            wait_until(matched, 'compressed images are matched')
            send(b'no image', rospy.Time.now())

        expected = ('matches images on /other/picture',
                    "compressed (jpeg), which cannot be decoded' is not an image to match")
        for arguments in (('image:=picture', 'transport:=compressed'), ('image:=picture/compressed',)):
            # The first line is on standard output, which is written at the end.
            output = output_of_node(*arguments, until=('started with pid',), look=match_two_images,
                                    after=expected[1:])
            for text in expected:
                self.assertIn(text, output)
        camera.unregister()

    def test_a_threshold_out_of_range_is_refused_with_its_range(self):
        words = {
            'T_w:=1.5': '/other/matcher/T_w is 1.5; expected a number in [0, 1]',
            'T_G:=-1.0': '/other/matcher/T_G is -1; expected a number in [0, 40]',
            'features:=0': '/other/matcher/features is 0; expected a whole number in [100, 20000]',
            'set:={reference_mode: nearest}': "reference_mode is nearest; expected previous",
            'set:={gms_columns: 10}': '/other/matcher/gms_columns is of an earlier version: set gms_grid'}

        def check(parameter):
            expected = (words[parameter], 'process has died')
            output = output_of_node(parameter, until=expected)
            for text in expected:
                self.assertIn(text, output)
        check_each(words, check)

    def test_a_missing_transport_names_its_package(self):
        expected = ("image transport 'no_such_transport' is not installed",
                    'no_such_transport_image_transport')
        output = output_of_node('transport:=no_such_transport', until=expected)
        for text in expected:
            self.assertIn(text, output)

    def test_a_misspelt_parameter_is_named(self):
        with tempfile.NamedTemporaryFile('w', suffix='.yaml') as file:
            file.write('ratio_treshold: 0.7\n')
            file.flush()
            expected = '/other/matcher/ratio_treshold is not known'
            self.assertIn(expected, output_of_node('params:=' + file.name, until=(expected,)))

    def test_what_is_no_number_or_no_whole_number_is_called_so(self):
        words = {
            'T_w: "0.7"': "T_w is the text '0.7'; expected a number: without quotes",
            'T_w: 7e-1': "T_w is the text '7e-1'; expected a number without quotes, and without an exponent",
            'features: 1500.0': 'features is 1500.0, a number with a point; expected a whole number: '
                                'write 1500',
            'features: 1500.5': 'features is 1500.5; expected a whole number',
            'T_w: 7e-1': "T_w is the text '7e-1'; expected a number: without quotes, and as 0.7"}

        def check(line):
            with tempfile.NamedTemporaryFile('w', suffix='.yaml') as file:
                file.write(line + '\n')
                file.flush()
                expected = ('/other/matcher/' + words[line], 'process has died')
                output = output_of_node('params:=' + file.name, until=expected)
                for text in expected:
                    self.assertIn(text, output)
        check_each(words, check)


if __name__ == '__main__':
    rospy.init_node('startup_test')
    rostest.rosrun('ktgp_orb', 'startup', StartupTest, sys.argv)
