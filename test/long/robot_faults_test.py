#!/usr/bin/python3
"""The nodelet under faults that take long or affect the machine: a killed process, a master that hangs for
ten seconds, clocks that jump, a viewer that never reads. Run by ctest -L long, with its own master."""

import itertools
import os
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import time
import unittest
import xmlrpc.client

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
sys.path.insert(0, os.path.join(ROOT, 'test/ros'))
os.environ['ROS_HOME'] = tempfile.mkdtemp()
MASTER = None

import rosgraph  # noqa: E402
import rospy  # noqa: E402
from ktgp_orb.msg import MatchStatistics, MatchStatus  # noqa: E402
from ktgp_testing import Recorder, Repeated, image_message, own_master, view, wait_until  # noqa: E402
from rosgraph_msgs.msg import Clock  # noqa: E402
from sensor_msgs.msg import Image  # noqa: E402

CAMERA = '/camera/image_raw'
STATISTICS = '/camera/matcher/statistics'


def setUpModule():
    global MASTER
    MASTER = own_master()
    unittest.addModuleCleanup(MASTER.terminate)
    rospy.init_node('robot_faults', disable_signals=True)
    unittest.addModuleCleanup(rospy.signal_shutdown, 'done')


class FaultTest(unittest.TestCase):
    def matching(self, *arguments, environment=None, now=rospy.Time.now, size=(320, 240)):
        """The statistics of a nodelet that matches 20 images per second, with stamps from `now`."""
        process = subprocess.Popen(['roslaunch', 'ktgp_orb', 'matcher.launch', 'features:=500'] +
                                   list(arguments), env=dict(os.environ, **(environment or {})))
        self.addCleanup(process.wait)
        self.addCleanup(process.terminate)
        recorder = Recorder(STATISTICS, MatchStatistics)
        self.addCleanup(recorder.close)
        camera = rospy.Publisher(CAMERA, Image, queue_size=2)
        self.addCleanup(camera.unregister)
        places = itertools.cycle((100 + 4 * step, 100 + 2 * step) for step in range(40))
        self.addCleanup(Repeated(0.05, lambda: camera.publish(image_message(view(*next(places), *size), now()))).stop)
        self.check_ok(recorder, 'it matches')
        return recorder

    def wait_for_more(self, recorder, count, what):
        wanted = len(recorder.messages()) + count
        wait_until(lambda: len(recorder.messages()) >= wanted, what)
        return recorder.messages()[-count:]

    def check_ok(self, recorder, what):
        """Ten frames later nearly all are matched again."""
        self.wait_for_more(recorder, 3, what)
        messages = self.wait_for_more(recorder, 10, what)
        ok = sum(m.status == MatchStatus.STATUS_OK for m in messages)
        self.assertGreaterEqual(ok, 8, what + ': %d of 10 ok' % ok)

    @staticmethod
    def pid_of(node):
        uri = rosgraph.Master('/test').lookupNode(node)
        return xmlrpc.client.ServerProxy(uri).getPid('/test')[2]

    def test_a_killed_process_is_started_again_under_load(self):
        recorder = self.matching('respawn:=true')
        for round_number in range(5):
            pid = self.pid_of('/camera/matcher')
            os.kill(pid, signal.SIGKILL)

            def is_back():
                try:
                    return self.pid_of('/camera/matcher') != pid
                except (rosgraph.MasterException, OSError):
                    return False
            wait_until(is_back, 'it is started again')
            self.check_ok(recorder, 'it matches after kill %d' % (round_number + 1))

    def test_a_master_that_is_gone_for_ten_seconds(self):
        recorder = self.matching()
        MASTER.send_signal(signal.SIGSTOP)
        try:
            end = time.time() + 10
            before = len(recorder.messages())
            while time.time() < end:
                time.sleep(0.1)
            self.assertGreater(len(recorder.messages()), before + 20, 'it goes on without a master')
        finally:
            MASTER.send_signal(signal.SIGCONT)
        self.check_ok(recorder, 'it matches with the master back')
        late = Recorder(STATISTICS, MatchStatistics)
        self.check_ok(late, 'who comes later is served')
        late.close()

    def test_the_wall_clock_jumps_an_hour_both_ways(self):
        with tempfile.NamedTemporaryFile() as ahead:
            def set_clock(seconds):
                ahead.seek(0)
                ahead.write(struct.pack('d', seconds))
                ahead.flush()
            set_clock(0.0)
            recorder = self.matching(environment={'LD_PRELOAD': os.environ['KTGP_ORB_FAULTS'],
                                                  'KTGP_ORB_CLOCK': ahead.name})
            for seconds in (3600.0, 0.0, -3600.0, 0.0):
                set_clock(seconds)
                self.check_ok(recorder, 'it matches with its clock ahead by %d s' % seconds)

    def test_the_clock_of_a_simulation_jumps_an_hour_both_ways(self):
        rospy.set_param('/use_sim_time', True)
        self.addCleanup(rospy.delete_param, '/use_sim_time')
        clock = rospy.Publisher('/clock', Clock, queue_size=1)
        self.addCleanup(clock.unregister)
        state = {'now': 10000.0}

        def tick():
            state['now'] += 0.01
            clock.publish(Clock(rospy.Time.from_sec(state['now'])))
        self.addCleanup(Repeated(0.01, tick).stop)
        recorder = self.matching(now=lambda: rospy.Time.from_sec(state['now']))
        for jump in (3600.0, -3600.0, -3600.0, 3600.0):
            state['now'] += jump
            self.check_ok(recorder, 'it matches after a jump of %d s' % jump)

    def test_a_viewer_that_never_reads_slows_no_data(self):
        recorder = self.matching(size=(640, 480))

        def rate():
            begin, before = time.time(), len(recorder.messages())
            self.wait_for_more(recorder, 60, 'it matches on')
            return (len(recorder.messages()) - before) / (time.time() - begin)
        alone = rate()
        viewer = self.connect('/camera/matcher/matches_image')
        self.addCleanup(viewer.close)
        self.wait_for_more(recorder, 60, 'the window of the viewer fills')
        beside = rate()
        print('statistics: %.1f a second alone, %.1f beside a viewer that never reads' % (alone, beside))
        self.assertGreater(beside, 0.5 * alone)
        self.check_ok(recorder, 'it matches beside the viewer')

    @staticmethod
    def connect(topic):
        """Subscribes with TCPROS, and then never reads."""
        publishers = dict(rosgraph.Master('/viewer').getSystemState()[0])[topic]
        uri = rosgraph.Master('/viewer').lookupNode(publishers[0])
        _, _, answer = xmlrpc.client.ServerProxy(uri).requestTopic('/viewer', topic, [['TCPROS']])
        connection = socket.create_connection((answer[1], answer[2]))
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        fields = ['callerid=/viewer', 'topic=' + topic, 'type=sensor_msgs/Image', 'md5sum=*']
        header = b''.join(struct.pack('<I', len(f)) + f.encode() for f in fields)
        connection.sendall(struct.pack('<I', len(header)) + header)
        return connection


if __name__ == '__main__':
    unittest.main(verbosity=2)
