"""Diagnostics: each problem is reported with its level, for the limits set by parameters."""

import itertools
import subprocess

import numpy as np
import rospy
from diagnostic_msgs.msg import DiagnosticStatus
from ktgp_testing import Log, MatcherCase, Repeated, image_message, of_matcher, views, wait_until

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR


class DiagnosticsTest(MatcherCase):
    def setUp(self):
        self.configure(max_latency=60.0)  # s
        self.encoding, self.picture, self.views = 'mono8', lambda pixels: pixels, itertools.cycle(views(60))
        self.ahead = rospy.Duration(0.0)
        self.traffic = Repeated(0.05, self.send_next)
        self.addCleanup(self.traffic.stop)

    def send_next(self):
        pixels = self.picture(next(self.views))
        self.camera.send(image_message(pixels, rospy.Time.now() + self.ahead, self.encoding))

    def wait_for(self, task, level, words):
        """Waits for a report from now on; its values by key."""
        seen = len(self.diagnostics.messages())

        def found():
            return [s for s in self.diagnostics.of(task, seen) if s.level == level and words in s.message]
        wait_until(found, '%s reports "%s" at level %d' % (task, words, ord(level)
                                                           if isinstance(level, bytes) else level))
        return {value.key: value.value for value in found()[0].values}

    def test_all_is_well(self):
        values = self.wait_for('input', OK, 'images arrive')
        self.assertEqual(values['topic'], '/camera/image_raw')
        self.wait_for('matcher', OK, 'homographies found')
        self.wait_for('latency', OK, 'results are on time')

    def test_latency(self):
        self.configure(max_latency=0.0005)
        self.wait_for('latency', ERROR, 'late')  # more than four times as much
        self.configure(max_latency=60.0)
        values = self.wait_for('latency', OK, 'on time')
        self.assertGreater(float(values['maximum (ms)']), 0.5)

    def test_a_camera_whose_clock_is_ahead(self):
        self.ahead = rospy.Duration(10.0)
        values = self.wait_for('latency', WARN, "image stamps are ahead of this computer's clock")
        self.assertLess(float(values['mean (ms)']), -100.0)
        self.ahead = rospy.Duration(-600.0)
        self.wait_for('latency', WARN, 'image stamps are of another clock')

    def test_drops(self):
        self.configure(features=20000)
        self.traffic.period = 0.001
        values = self.wait_for('input', WARN, 'dropped')
        self.assertGreater(int(values['dropped']), 0)
        self.assertGreater(float(values['rate (1/s)']), 20)
        self.configure(features=2000)

    def test_a_covered_camera_is_in_the_log_too(self):
        log = Log(self)
        self.picture = np.zeros_like
        self.wait_for('matcher', WARN, 'no homographies found: too_few_features')
        log.wait_for_words('no homographies found: too_few_features')

    def test_matcher(self):
        noise = np.random.RandomState(1)
        self.picture = lambda pixels: noise.randint(0, 256, pixels.shape, np.uint8)
        self.wait_for('matcher', WARN, 'few homographies')
        self.wait_for('matcher', WARN, 'no homographies')  # a robot in front of a wall is not an error
        self.picture = lambda pixels: noise.randint(0, 256, (60, 2600), np.uint8)
        self.wait_for('matcher', WARN, 'the images are 2600 px long; made 1000 to 2500 px long first')

    def test_a_camera_that_is_too_slow_for_the_reference(self):
        self.configure(max_reference_age=0.001)
        values = self.wait_for('matcher', WARN, 'in a row without a reference: gap (the previous frame is older than max_reference_age')
        self.assertEqual(values['last reason for no reference'], 'gap')
        self.configure(max_reference_age=1.0)
        self.wait_for('matcher', OK, 'homographies found')

    def test_fixed_mode_without_a_reference(self):
        self.configure(reference_mode='fixed')
        self.wait_for('matcher', WARN, 'in a row without a reference: not_set')
        self.configure(reference_mode='previous')
        self.wait_for('matcher', OK, 'homographies found')

    def test_refused_parameters_are_said_until_good_ones_come(self):
        self.configure(reference_image='/no/such/file.png')
        values = self.wait_for('matcher', WARN, 'parameters refused')
        self.assertIn('/no/such/file.png', values['refused parameters'])
        self.configure(reference_image='')
        self.assertEqual(self.wait_for('matcher', OK, '')['refused parameters'], '')

    def test_last_error(self):
        self.encoding = 'nonsense'
        values = self.wait_for('input', WARN, 'refused')
        self.assertIn("encoding 'nonsense'", values['last error'])
        self.wait_for('input', ERROR, 'every image is refused')
        self.encoding = 'mono8'
        values = self.wait_for('input', OK, 'images arrive')
        self.assertEqual(values['last error'], '', 'all is well again')

    def test_two_publishers_are_named(self):
        other = subprocess.Popen(['rostopic', 'pub', '/camera/image_raw', 'sensor_msgs/Image', '{}'],
                                 stdout=subprocess.DEVNULL)
        try:
            self.wait_for('input', WARN, '2 nodes publish /camera/image_raw (/robot_diagnostics')
            self.wait_for('input', WARN, '/rostopic_')
            self.wait_for('input', WARN, 'their images are mixed')
        finally:
            other.terminate()
            other.wait()
        self.wait_for('input', OK, 'images arrive')

    def test_two_publishers_of_the_calibration_are_named(self):
        self.configure(geometry='auto')
        self.addCleanup(self.configure, geometry='homography')
        commands = [['rostopic', 'pub', '-r', '10', '/camera/camera_info', 'sensor_msgs/CameraInfo', '{}']] * 2
        others = [subprocess.Popen(command, stdout=subprocess.DEVNULL) for command in commands]
        try:
            self.wait_for('input', WARN, '2 nodes publish /camera/camera_info (/rostopic_')
            self.wait_for('input', WARN, 'their camera_info messages are mixed')
        finally:
            for other in others:
                other.terminate()
                other.wait()
        self.wait_for('input', OK, 'images arrive')

    def test_silence(self):
        self.traffic.stop()
        self.wait_for('input', ERROR, 'no image on /camera/image_raw')

    def test_paused_and_idle_are_no_trouble(self):
        self.call('pause')
        self.wait_for('input', OK, 'paused')
        self.call('resume')
        self.statistics.close()
        self.wait_for('input', OK, 'idle')
        type(self).statistics = of_matcher('statistics')
        self.camera.wait_for_subscriber()
