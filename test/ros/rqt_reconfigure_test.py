"""The real rqt_reconfigure with live nodelets: every group is shown in the order of use, and the
matcher computes with the values that are dragged, chosen and typed there.

KTGP_ORB_RQT names the folder of its sources (ROS 1 branches of rqt_reconfigure, rqt, qt_gui_core,
python_qt_binding and rqt_console). Photographs are left in ROS_HOME."""

import json
import os
import subprocess
import tempfile
import unittest

import rospy
from ktgp_orb.cfg import KtgpConfig
from ktgp_orb.msg import Match
from ktgp_testing import Camera, Recorder, view, virtual_display, wait_until

SOURCES = ('rqt_reconfigure', 'rqt/rqt_gui', 'rqt/rqt_gui_py', 'qt_gui_core/qt_gui',
           'qt_gui_core/qt_gui_py_common', 'python_qt_binding', 'rqt_console', 'rqt/rqt_py_common')


class Client:
    """rqt_reconfigure on a virtual display."""

    def __init__(self, home):
        rqt = os.environ['KTGP_ORB_RQT']
        self.log = open(os.path.join(home, 'rqt.log'), 'w+')
        self.display, display = virtual_display('1400x2600x24', self.log)
        environment = dict(
            os.environ, DISPLAY=display, QT_QPA_PLATFORM='xcb', XDG_CONFIG_HOME=home, HOME=home,
            PYTHONPATH=':'.join([os.path.join(rqt, s, 'src') for s in SOURCES] +
                                [os.environ.get('PYTHONPATH', '')]),
            ROS_PACKAGE_PATH=rqt + ':' + os.environ.get('ROS_PACKAGE_PATH', ''))
        script = os.path.join(os.path.dirname(os.path.abspath(__file__)), 'rqt_client.py')
        self.process = subprocess.Popen(
            ['/usr/bin/python3', '-B', script], env=environment, stdin=subprocess.PIPE,
            stdout=subprocess.PIPE, stderr=self.log, universal_newlines=True)

    def do(self, *command):
        self.process.stdin.write(json.dumps(command) + '\n')
        self.process.stdin.flush()
        for line in self.process.stdout:
            if not line.startswith('{'):
                continue  # what rqt itself prints
            answer = json.loads(line)
            if 'error' in answer:
                raise AssertionError('%s: %s' % (command, answer['error']))
            return answer['answer']
        self.log.seek(0)
        raise AssertionError('rqt_reconfigure ended: ' + self.log.read())

    def close(self):
        self.process.stdin.close()
        self.process.stdout.close()
        self.process.wait(30)
        self.display.terminate()
        self.display.wait()
        self.log.close()


class RqtReconfigureTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.camera = Camera()
        cls.matches = Recorder('/camera/matcher/match', Match)
        cls.camera.wait_for_subscriber()
        for node in ('matcher', 'stabilizer', 'mosaic'):
            rospy.wait_for_service('/camera/%s/set_parameters' % node, 120.0)
        cls.home = os.environ.get('ROS_HOME') or tempfile.mkdtemp()
        cls.client = Client(cls.home)
        cls.addClassCleanup(cls.client.close)

    def photograph(self, name):
        path = os.path.join(self.home, name + '.png')
        self.client.do('photograph', path)
        self.assertGreater(os.path.getsize(path), 10000)

    def match(self):
        """The result for the same two images with the current values of the node."""
        for shift in (0, 10):
            message = self.matches.wait_for(self.camera.show(view(100 + shift, 100)))
        return message

    def test_values_of_the_window_reach_the_matcher(self):
        do = self.client.do
        do('select', '/camera/matcher')
        wanted = [g['name'] for g in sorted(KtgpConfig.config_description['groups'],
                                            key=lambda g: g['id'])]
        self.assertEqual([g for g in do('groups') if g in wanted], wanted, 'the order of use')
        self.photograph('matcher')
        before = self.match()

        self.assertAlmostEqual(do('slide', 'T_w', 0.5), 0.5, delta=0.005)
        # A drag passes other values on its way.
        ratio = self.value('T_w', lambda value: abs(value - 0.5) < 0.005)
        sharp = self.match()
        self.assertEqual(sharp.statistics.kt, sum(r < ratio for r in before.correspondences.ratio))

        self.assertAlmostEqual(do('slide', 'T_G', 20.0), 20.0)
        self.value('T_G', lambda value: value == 20.0)
        strict = self.match()
        self.assertEqual(strict.statistics.kt, sharp.statistics.kt)
        self.assertLess(strict.statistics.ktg, sharp.statistics.ktg)

        do('choose', 'descriptor', 'teblid')
        self.value('descriptor', lambda value: value == 'teblid')
        self.assertEqual(self.match().statistics.descriptor, 'teblid')

        do('type', 'roi', '0 0 320 480')
        self.value('roi', lambda value: value == '0 0 320 480')
        self.assertLess(max(self.match().correspondences.target_x), 321)
        self.photograph('matcher changed')

        for node, name, value in (('stabilizer', 'lag', 4), ('mosaic', 'picture_size', 1500)):
            do('select', '/camera/' + node)
            do('slide', name, value)
            wait_until(lambda: rospy.get_param('/camera/%s/%s' % (node, name)) == value,
                       '%s is %s' % (name, value))
        self.photograph('all')

    def value(self, name, condition):
        """The value of the parameter after the node accepted it."""
        wait_until(lambda: condition(rospy.get_param('/camera/matcher/' + name)),
                   name + ' has arrived')
        return rospy.get_param('/camera/matcher/' + name)
