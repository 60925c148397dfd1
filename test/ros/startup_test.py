"""Messages at start: wrong topic, wrong parameter, misspelt parameter."""

import os
import re
import time

import cv2
import numpy as np
import rospy
from ktgp_orb.msg import MatchStatistics, MatchStatus
from ktgp_testing import Camera, FolderCase, Log, Program, Recorder, view, wait_until
from sensor_msgs.msg import CompressedImage
from std_msgs.msg import Header

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))


def output_of_node(*parameters, until, look=lambda: None, after=()):
    """Runs a second matcher until it has printed all of `until` and, after `look`, of `after`; returns its
    output."""
    return output_of_launch('matcher.launch', 'namespace:=other', *parameters, until=until,
                            namespaces=['/other'], look=look, after=after)


def output_of_launch(*arguments, until, namespaces, look=lambda: None, after=(), package=('ktgp_orb',)):
    """Reads the messages from the output: on /rosout, those before the subscription is connected
    are lost."""
    launch = Program('roslaunch', *package, *arguments)
    try:
        for texts, then in ((until, look), (after, lambda: None)):
            if not launch.says(*texts):
                raise AssertionError('expected %s:\n%s' % (texts, launch.output()))
            then()
    finally:
        launch.end()
        for namespace in namespaces:
            rospy.delete_param(namespace)  # else the next one has these parameters too
    return launch.output()


class StartupTest(FolderCase):
    def test_a_wrong_topic_is_named_after_five_seconds(self):
        log = Log()
        Recorder('/camera/matcher/statistics', MatchStatistics)
        wait_until(lambda: any(m.level == m.WARN for m in log.with_words('no image on /camera/no_such_topic')),
                   'the topic is named in a warning')

    def test_a_topic_without_publisher_is_named_also_while_idle(self):
        # Its results have no subscriber, so it subscribes to nothing: it asks the master.
        output_of_node('image:=nothing_here',
                       until=('no node publishes /other/nothing_here: is the topic name right?',))

    def test_compressed_images_on_the_wrong_topic_are_named_with_the_way_out(self):
        topics = ('/left/picture', '/right/picture/compressed')
        publishers = [rospy.Publisher(topic, CompressedImage, queue_size=1) for topic in topics]
        output_of_launch('multi_camera.launch', 'cameras:=left right', 'image:=picture', until=(
            '/left/picture is of type sensor_msgs/CompressedImage; expected sensor_msgs/Image, or '
            'the topic without its last part and that as image_transport',
            'no node publishes /right/picture: is the topic name right? There is '
            '/right/picture/compressed, for image_transport compressed'), namespaces=['/left', '/right'])
        for publisher in publishers:
            publisher.unregister()

    def test_compressed_images_are_matched_with_and_without_the_suffix(self):
        camera = rospy.Publisher('/other/picture/compressed', CompressedImage, queue_size=1)
        answers = Recorder('/other/matcher/statistics', MatchStatistics)

        def send(data, stamp):
            camera.publish(CompressedImage(header=Header(stamp=stamp), format='jpeg', data=data))

        bomb = cv2.imencode('.png', np.zeros((9000, 9000), np.uint8))[1].tobytes()
        refused = {b'no image': 'compressed image (format "jpeg") is no JPEG, PNG, TIFF, WebP or BMP',
                   bomb: 'compressed image (format "jpeg") has 81.0 megapixels; expected 64 at most'}

        def match_two_images(then):
            number = len(answers.messages())

            def matched():
                stamp = rospy.Time.now()
                send(cv2.imencode('.jpg', view(100, 100))[1].tobytes(), stamp)
                time.sleep(0.1)
                return any(m.status == MatchStatus.STATUS_OK for m in answers.messages()[number:])
            wait_until(matched, 'compressed images are matched')
            send(then, rospy.Time.now())

        ways = ('image:=picture', 'transport:=compressed'), ('image:=picture/compressed',)
        for arguments, (data, words) in zip(ways, refused.items()):
            # The first line is on standard output, which is written at the end.
            output = output_of_node(*arguments, until=('started with pid',), look=lambda: match_two_images(data),
                                    after=(words,))
            self.assertIn('matches images on /other/picture', output)
        camera.unregister()

    def test_rostopic_prints_the_homography_as_readme_does(self):
        with open(os.path.join(ROOT, 'README.md'), encoding='utf-8') as file:
            text = file.read()
        launch, = re.findall(r'^    roslaunch ktgp_orb (matcher.launch namespace:=usb_cam .*)$', text, re.M)
        echo, = re.findall(r'^    (rostopic echo /usb_cam/\S+)$', text, re.M)
        block, = re.findall(r'^```\n(status: .*?)^```', text, re.M | re.S)
        expected = [re.sub(r'(\[)?-?[\d.].*', r'\1', line) for line in block.splitlines()]  # without the numbers
        camera = Camera('/usb_cam/image_raw')

        def echo_two_images():
            with Program(*echo.split()) as printed:
                def said():
                    camera.send_view()
                    time.sleep(0.1)
                    return 'status: 0\n' in printed.output()
                wait_until(said, 'rostopic echo prints a homography')
                wait_until(lambda: '---' in printed.output().split('status: 0\n')[1], 'it is printed to its end')
            message = 'status: 0\n' + printed.output().split('status: 0\n')[1].split('---')[0]
            begins = [line for line in message.splitlines() if line.startswith(tuple(expected))]
            self.assertEqual(len(begins), len(expected), message)
            for line, begin in zip(begins, expected):
                self.assertTrue(line.startswith(begin), message)
        output_of_launch(*launch.split(), until=('started with pid',), namespaces=['/usb_cam'], look=echo_two_images)

    def test_a_missing_transport_names_its_package(self):
        output_of_node('transport:=no_such_transport',
                       until=("image transport 'no_such_transport' is not installed",
                              'no_such_transport_image_transport'))

    def test_a_parameter_that_cannot_be_used_is_named_with_the_reason(self):
        words = {
            'ratio_treshold: 0.7': 'ratio_treshold is not known',
            'T_w: 1.5': 'T_w is 1.5; expected a number in [0, 1]',
            'reference_mode: nearest': 'reference_mode is nearest; expected previous',
            'T_w: "0.7"': "T_w is the text '0.7'; expected a number: without quotes",
            'T_w: 7e-1': "T_w is the text '7e-1'; expected a number: without quotes, and as 0.7",
            'features: 1500.0': 'features is 1500.0, a number with a point; expected a whole number: '
                                'write 1500',
            'features: 1500.5': 'features is 1500.5; expected a whole number'}

        # All in one launch: its start takes longer than that of a matcher.
        matcher = ('<include file="$(find ktgp_orb)/launch/matcher.launch"><arg name="namespace" value="wrong_%d"/>'
                   '<arg name="%s" value="%s"/></include>')
        matchers, expected = [], []
        for i, line in enumerate(words):
            self.write('%d.yaml' % i, line + '\n')
            matchers.append(matcher % (i, 'params', self.path('%d.yaml' % i)))
            expected.append('/wrong_%d/matcher/%s' % (i, words[line]))
            if 'treshold' not in line:
                expected.append('[wrong_%d/matcher-%d] process has died' % (i, i + 1))
        # An argument of the launch file.
        i = len(words)
        matchers.append(matcher % (i, 'features', 0))
        expected += ['/wrong_%d/matcher/features is 0; expected a whole number in [100, 20000]' % i,
                     '[wrong_%d/matcher-%d] process has died' % (i, i + 1)]
        self.write('wrong.launch', '<launch>%s</launch>' % ''.join(matchers))
        output_of_launch(self.path('wrong.launch'), until=expected,
                         namespaces=['/wrong_%d' % j for j in range(i + 1)], package=())
