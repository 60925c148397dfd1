#!/usr/bin/python3
"""Five nodelets in one manager under floods of parameters, unloads and services: the process lives, works
afterwards and does not grow. Run by ctest -L long for ten minutes, with its own master; alone:

    test/long/flood_test.py [SECONDS]"""

import os
import random
import signal
import subprocess
import sys
import tempfile
import time
import unittest

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
sys.path.insert(0, os.path.join(ROOT, 'test/ros'))
os.environ['ROS_HOME'] = tempfile.mkdtemp()

import rosgraph  # noqa: E402
import rospy  # noqa: E402
from dynamic_reconfigure.msg import BoolParameter, Config, ConfigDescription, DoubleParameter, IntParameter, \
    StrParameter  # noqa: E402
from dynamic_reconfigure.srv import Reconfigure  # noqa: E402
from geometry_msgs.msg import PoseWithCovariance  # noqa: E402
from ktgp_orb.msg import HomographyStamped, Match, TargetDetections  # noqa: E402
from ktgp_orb.srv import DetectTargets, MatchPair, RemoveTarget, SaveMosaic, SetPose, SetTarget  # noqa: E402
from ktgp_testing import Memory, Recorder, Repeated, image_message, own_master, texture, view, wait_until  # noqa: E402
from nav_msgs.msg import Odometry  # noqa: E402
from rosgraph_msgs.msg import Log  # noqa: E402
from sensor_msgs.msg import CameraInfo, Image, Range  # noqa: E402
from std_srvs.srv import Trigger  # noqa: E402

SECONDS = float(os.environ.get('KTGP_ORB_FLOOD_SECONDS', '600'))
PERIOD = 0.1  # s, of the images; the other floods are about as fast
GROWTH = 40.0  # MB, of some hundred; what a nodelet lost at each loading would add up to more
SIZE = (320, 240)
KINDS = {'matcher': 'matcher', 'stabilizer': 'stabilizer', 'mosaic': 'mosaic',
         'ground_motion': 'GroundMotion', 'targets': 'Targets'}
TRIGGERS = ('matcher/reset', 'matcher/set_reference', 'matcher/pause', 'matcher/resume', 'mosaic/reset',
            'ground_motion/reset')
STARTED = []


def setUpModule():
    STARTED.append(own_master())
    # Beyond the ranges, clamped values and refusals are logged by the thousand.
    quiet = os.path.join(ROOT, 'test/ros/quiet.config')
    STARTED.append(subprocess.Popen(['rosrun', 'nodelet', 'nodelet', 'manager', '__name:=manager'],
                                    env=dict(os.environ, ROSCONSOLE_CONFIG_FILE=quiet), stdout=subprocess.DEVNULL,
                                    stderr=subprocess.STDOUT))
    rospy.init_node('flood', disable_signals=True)


def tearDownModule():
    rospy.signal_shutdown('done')
    for process in reversed(STARTED):
        process.terminate()
        process.wait(60)


def call(name, kind, *arguments):
    """The answer, or None: the nodelet is not loaded now."""
    try:
        return rospy.ServiceProxy('/camera/' + name, kind)(*arguments)
    except (rospy.ServiceException, rospy.ROSException):
        return None


class Loader:
    """Loads a nodelet by a program, which unloads it at its end: Debian has no Python module of the manager's
    services."""

    def __init__(self, name):
        if name == 'ground_motion':
            rospy.set_param('/camera/ground_motion/base_frame', '')  # there is no tf
        self.program = subprocess.Popen(
            ['rosrun', 'nodelet', 'nodelet', 'load', 'ktgp_orb/' + KINDS[name], '/manager', '--no-bond', '__name:=' + name,
             '__ns:=/camera', 'image:=image_raw', 'match:=matcher/match', 'homography:=matcher/homography'],
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

        def is_there():
            if self.program.poll() is not None:
                raise AssertionError(name + ' is not loaded')
            try:
                return rosgraph.Master('/flood').lookupService('/camera/%s/set_parameters' % name)
            except rosgraph.MasterException:
                return False
        wait_until(is_there, name + ' is loaded')

    def unload(self):
        self.program.send_signal(signal.SIGINT)
        self.program.wait(60)


class FloodTest(unittest.TestCase):
    def setUp(self):
        self.random = random.Random(1)
        self.stamp, self.step, self.jump = rospy.Time(1000), 0, 0.0
        self.publishers = {name: rospy.Publisher('/camera/' + name, kind, queue_size=2)
                           for name, kind in (('image_raw', Image), ('camera_info', CameraInfo), ('range', Range))}
        self.descriptions, self.loaded = {}, {}
        self.poster = texture(200, 260, seed=7)

    def send(self):
        self.step += 1
        self.stamp += rospy.Duration(0.033)
        step = min(self.step % 80, 80 - self.step % 80)
        image = image_message(view(100 + 4 * step, 100 + 2 * step, *SIZE), self.stamp)
        info = CameraInfo(header=image.header, width=SIZE[0], height=SIZE[1], distortion_model='plumb_bob',
                          D=[0.0] * 5, K=[250.0, 0, 159.5, 0, 250.0, 119.5, 0, 0, 1], R=[1.0, 0, 0, 0, 1, 0, 0, 0, 1],
                          P=[250.0, 0, 159.5, 0, 0, 250.0, 119.5, 0, 0, 0, 1, 0])
        self.publishers['camera_info'].publish(info)
        self.publishers['range'].publish(Range(header=image.header, min_range=0.1, max_range=20.0, range=2.0))
        self.publishers['image_raw'].publish(image)
        return self.stamp

    def describe(self, name):
        if name not in self.descriptions:
            self.descriptions[name] = rospy.wait_for_message('/camera/%s/parameter_descriptions' % name,
                                                             ConfigDescription, 30)
        return self.descriptions[name]

    def change_parameters(self):
        """One of a node, at random: inside its range, at its ends, or what is none."""
        name = self.random.choice(list(KINDS))
        described = self.describe(name)
        parameter = self.random.choice([p for group in described.groups for p in group.parameters])
        low, high = ({p.name: p.value for kind in ('doubles', 'ints') for p in getattr(config, kind)}.get(parameter.name)
                     for config in (described.min, described.max))
        config = Config()
        if parameter.type == 'bool':
            config.bools = [BoolParameter(parameter.name, self.random.random() < 0.5)]
        elif parameter.type == 'str':
            config.strs = [StrParameter(parameter.name, self.random.choice(['', 'nonsense', 'keyframe', 'range']))]
        else:
            share = self.random.choice((0.0, self.random.random() ** 3, 0.1, float('nan')))
            if parameter.type == 'double':
                config.doubles = [DoubleParameter(parameter.name, low + share * (high - low))]
            else:
                share = 0.1 if share != share else min(share, 0.3)  # of features: seconds are another test's
                config.ints = [IntParameter(parameter.name, int(low + share * (high - low)))]
        call(name + '/set_parameters', Reconfigure, config)

    def call_a_service(self):
        small = image_message(view(150, 150, *SIZE), rospy.Time(1))
        pose = PoseWithCovariance()
        pose.pose.orientation.w = self.random.choice((0.0, 1.0, 1.0))
        target = image_message(self.poster, rospy.Time(1))
        choice = self.random.randrange(8)
        if choice == 0:
            call('matcher/match_pair', MatchPair, small, self.random.choice((small, Image())))
        elif choice == 1:
            call('targets/add', SetTarget, 'poster', [target], 0.3, 'poster')
        elif choice == 2:
            call('targets/remove', RemoveTarget, 'poster')
        elif choice == 3:
            call('targets/detect', DetectTargets, self.random.choice((small, Image(width=9000, height=9000))),
                 CameraInfo())
        elif choice == 4:
            call('ground_motion/set_pose', SetPose, pose)
        elif choice == 5:
            call('mosaic/save', SaveMosaic, os.path.join(os.environ['ROS_HOME'], 'map.png'))
        else:
            call(self.random.choice(TRIGGERS), Trigger)

    def load_anew(self):
        name = self.random.choice(list(KINDS))
        self.loaded[name].unload()
        self.load(name)

    def load(self, name):
        if rospy.has_param('/camera/' + name):  # not where it was unloaded before it had set them
            rospy.delete_param('/camera/' + name)
        self.loaded[name] = Loader(name)

    def at_rest(self, memory):
        """MB of the manager without a nodelet."""
        for name in KINDS:
            self.loaded[name].unload()
        held = memory.held()
        self.load_all()
        return held

    def load_all(self):
        for name in KINDS:
            self.load(name)

    def test_five_nodelets_live_and_do_not_grow(self):
        self.load_all()
        self.addCleanup(lambda: [loader.program.kill() for loader in self.loaded.values()])
        for name in KINDS:
            self.describe(name)
        memory = Memory('/manager')
        results = {'matcher/match': Match, 'stabilizer/image': Image, 'mosaic/homography': HomographyStamped,
                   'ground_motion/odometry': Odometry, 'targets/detections': TargetDetections}
        counts = dict.fromkeys(results, 0)

        def count(name):
            return lambda _: counts.update({name: counts[name] + 1})
        subscribers = [rospy.Subscriber('/camera/' + name, kind, count(name)) for name, kind in results.items()]
        warm = max(10.0, 0.15 * SECONDS)
        rests, totals = [], {}
        for part in (warm, 0.5 * (SECONDS - warm), 0.5 * (SECONDS - warm)):
            floods = {'images': Repeated(PERIOD, self.send), 'parameters': Repeated(PERIOD, self.change_parameters),
                      'services': Repeated(PERIOD, self.call_a_service), 'loadings': Repeated(1.0, self.load_anew)}
            end = time.time() + part
            while time.time() < end and all(flood.trouble is None for flood in floods.values()):
                self.assertIsNone(STARTED[-1].poll(), 'the manager has died')
                time.sleep(0.5)
            for name, flood in floods.items():
                self.assertIsNone(flood.trouble, name)
                flood.stop()
                totals[name] = totals.get(name, 0) + flood.count
            rests.append(self.at_rest(memory))
            print('after %.0f s: %.0f MB at rest, %.0f MB at most; %s; received: %s' %
                  (part, rests[-1], memory.most(), totals, counts))
        self.assertLess(rests[2] - rests[0], GROWTH)
        # All works as on the first day.
        rospy.wait_for_service('/camera/targets/add', 60)
        self.assertTrue(call('targets/add', SetTarget, 'poster', [image_message(self.poster, rospy.Time(1))], 0.3,
                             '').success)
        before = dict(counts)

        def all_answer():
            self.send()
            rospy.rostime.wallsleep(0.05)
            return all(counts[name] > before[name] for name in counts)
        log = Recorder('/rosout', Log)
        try:
            wait_until(all_answer, 'every nodelet answers')
        except AssertionError:
            raise AssertionError('%s before, %s after; %s' % (before, counts, [m.msg for m in log.messages()][-20:]))
        for subscriber in subscribers:
            subscriber.unregister()


if __name__ == '__main__':
    if len(sys.argv) > 1:
        SECONDS = float(sys.argv.pop(1))
    unittest.main(verbosity=2)
