#!/usr/bin/python3
"""Camera and matcher on two machines, simulated by two network namespaces: the link is cut for ten
seconds and restored, and the matching resumes by itself. Skipped with the reason if network
namespaces are not available.

robot_network_test.py [camera | listener]: the parts that run inside the namespaces.
"""

import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
import unittest

CUT_SECONDS = 10
ADDRESSES = {'camera': '10.213.77.1', 'matcher': '10.213.77.2'}
MASTER = 'http://%s:11311' % ADDRESSES['camera']
LAUNCH = '''<launch>
  <machine name="robot" address="localhost"/>
  <include file="$(find ktgp_orb)/launch/matcher.launch">
    <arg name="machine" value="robot"/>
  </include>
</launch>
'''


def ip(*arguments):
    subprocess.check_call(['ip'] + list(arguments))


def namespace(side):
    return 'ktgp_%d_%s' % (os.getpid(), side)


def interface(side):
    return 'kt%d%s' % (os.getpid() % 100000, side[0])


def skip_reason():
    """Why network namespaces cannot be used here, or None; tries what the test needs."""
    if shutil.which('ip') is None:
        return 'network namespaces need the program ip (iproute2)'
    try:
        network = Network()
    except subprocess.CalledProcessError as error:
        return 'no network namespaces here: "%s" is refused%s' % (
            ' '.join(error.cmd), '' if os.geteuid() == 0 else ' (not root)')
    try:
        for side in ADDRESSES:
            if network.run(side, 'true').wait() != 0:
                return 'no network namespaces here: "ip netns exec" is refused'
    finally:
        network.close()
    return None


class Network:
    """Two namespaces joined by a cable."""

    def __init__(self):
        try:
            self.build()
        except subprocess.CalledProcessError:
            self.close()
            raise

    def build(self):
        for side in ADDRESSES:
            ip('netns', 'add', namespace(side))
        ip('link', 'add', interface('camera'), 'type', 'veth', 'peer', 'name', interface('matcher'))
        for side, address in ADDRESSES.items():
            ip('link', 'set', interface(side), 'netns', namespace(side))
            self.inside(side, 'address', 'add', address + '/24', 'dev', interface(side))
            self.inside(side, 'link', 'set', 'lo', 'up')
            self.connect(side)

    @staticmethod
    def inside(side, *arguments):
        ip('-netns', namespace(side), *arguments)

    def connect(self, side='camera', state='up'):
        self.inside(side, 'link', 'set', interface(side), state)

    def run(self, side, *command, **options):
        environment = dict(os.environ, ROS_MASTER_URI=MASTER, ROS_IP=ADDRESSES[side])
        environment.pop('ROS_HOSTNAME', None)
        return subprocess.Popen(['ip', 'netns', 'exec', namespace(side)] + list(command),
                                env=environment, start_new_session=True, **options)

    def close(self):
        for side in ADDRESSES:
            subprocess.call(['ip', 'netns', 'delete', namespace(side)], stderr=subprocess.DEVNULL)


def run_camera():
    import rospy
    from ktgp_testing import image_message, view
    from sensor_msgs.msg import Image
    rospy.init_node('camera')
    publisher = rospy.Publisher('/camera/image_raw', Image, queue_size=1)
    rate = rospy.Rate(10)
    step = 0
    while not rospy.is_shutdown():
        step = (step + 1) % 60
        publisher.publish(image_message(view(100 + 5 * step, 100), rospy.Time.now()))
        rate.sleep()


def run_listener():
    import rospy
    from ktgp_orb.msg import MatchStatistics
    rospy.init_node('listener')
    rospy.Subscriber('/camera/matcher/statistics', MatchStatistics,
                     lambda m: print('result', m.header.stamp.to_sec(), m.status, flush=True))
    rospy.spin()


class NetworkTest(unittest.TestCase):
    def setUp(self):
        self.network = Network()
        self.processes = []
        self.results = []  # (stamp, status) of each statistics message
        self.folder = tempfile.mkdtemp()

    def tearDown(self):
        for process in reversed(self.processes):
            os.killpg(process.pid, signal.SIGINT)
        for process in self.processes:
            try:
                process.wait(10)
            except subprocess.TimeoutExpired:
                os.killpg(process.pid, signal.SIGKILL)
                process.wait()
        self.network.close()
        shutil.rmtree(self.folder)

    def start(self, side, *command, **options):
        self.processes.append(self.network.run(side, *command, **options))
        return self.processes[-1]

    def listen(self, pipe):
        for line in pipe:
            words = line.split()
            if words[0] == 'result':  # rospy prints too
                self.results.append((float(words[1]), int(words[2])))

    def wait_until(self, condition, what, timeout=180):
        end = time.time() + timeout
        while not condition():
            self.assertLess(time.time(), end, 'timed out waiting until ' + what)
            time.sleep(0.05)

    def ok_since(self, start):
        return sum(status == 0 and stamp > start for stamp, status in self.results)

    def test_matching_resumes_after_the_link_was_cut(self):
        launch = os.path.join(self.folder, 'robot.launch')
        with open(launch, 'w') as file:
            file.write(LAUNCH)
        self.start('camera', 'roscore', '-p', '11311')
        self.start('camera', sys.executable, __file__, 'camera')
        self.start('matcher', 'roslaunch', '--wait', launch)
        listener = self.start('matcher', sys.executable, __file__, 'listener',
                              stdout=subprocess.PIPE, universal_newlines=True)
        threading.Thread(target=self.listen, args=(listener.stdout,), daemon=True).start()
        self.wait_until(lambda: self.ok_since(0) > 10, 'the matcher matches')

        self.network.connect(state='down')
        cut = time.time()
        self.wait_until(lambda: time.time() > cut + CUT_SECONDS, 'the cut is over')  # its length
        during = self.ok_since(cut + 1)
        self.network.connect()
        restored = time.time()
        self.wait_until(lambda: self.ok_since(restored) > 10, 'the matching resumes')
        print('%d results during the cut; resumed %.1f s after it' %
              (during, time.time() - restored))
        self.assertEqual(during, 0, 'the link was not cut')
        self.assertEqual([p.poll() for p in self.processes], 4 * [None], 'a process has ended')


if __name__ == '__main__':
    sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
    {'camera': run_camera, 'listener': run_listener}[sys.argv[1]]()
