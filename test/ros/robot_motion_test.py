"""Velocity and odometry of a camera that is moved over a picture of the ground: right in metres with every
source of height and normal, or refused with the reason."""

import itertools
import subprocess
import tempfile
import unittest

import numpy as np
import rosbag
import rosgraph
import rospy
from dynamic_reconfigure.client import Client
from geometry_msgs.msg import PoseWithCovariance, TransformStamped, TwistWithCovarianceStamped
from ktgp_orb.msg import Match, MatchStatus
from ktgp_orb.srv import SetPose
from ktgp_testing import TIMEOUT, Camera, Diagnostics, Log, Recorder, image_message, node, view, wait_until
from nav_msgs.msg import Odometry
from poster import information
from sensor_msgs.msg import CameraInfo, Imu, Range
from std_srvs.srv import Trigger
from tf2_msgs.msg import TFMessage

FOCAL = 500.0  # px
HEIGHT = 2.0  # m; a pixel is 4 mm on the ground
METRE = FOCAL / HEIGHT
PERIOD = 0.033  # s
STEP = (3, 1)  # px a frame: to the right and down; a vehicle can turn round so fast from one frame to the next
LEVER = (0.3, 0.1, -0.05)  # of the camera in base_link
STILL = (0.0, 0.0, 0.0, 1.0)  # no rotation
NAMES = ('ground_motion', 'by_tf', 'by_parameter', 'by_motion')


def calibration(stamp, width=640):
    info = information(np.array([[FOCAL, 0, 319.5], [0, FOCAL, 239.5], [0, 0, 1]]), size=(width, 480))
    info.header.stamp, info.header.frame_id = stamp, 'camera'
    return info


def transform(parent, child, translation, stamp, rotation=(1.0, 0.0, 0.0, 0.0)):
    """Rotation: x, y, z, w; without one: half a turn about x, so that the camera looks down."""
    message = TransformStamped(child_frame_id=child)
    message.header.stamp, message.header.frame_id = stamp, parent
    t, r = message.transform.translation, message.transform.rotation
    t.x, t.y, t.z = translation
    r.x, r.y, r.z, r.w = rotation
    return message


class MotionTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.camera = Camera()
        cls.infos = rospy.Publisher('/camera/camera_info', CameraInfo, queue_size=5)
        cls.ranges = rospy.Publisher('/camera/range', Range, queue_size=5)
        cls.imus = rospy.Publisher('/camera/imu', Imu, queue_size=5)
        cls.tf = rospy.Publisher('/tf', TFMessage, queue_size=50)
        cls.static = rospy.Publisher('/tf_static', TFMessage, queue_size=5, latch=True)
        cls.static.publish(TFMessage([
            transform('base_link', 'camera', LEVER, rospy.Time()),
            transform('base_link', 'imu', (0, 0, 0), rospy.Time(), STILL)]))
        cls.log = Log()
        cls.diagnostics = Diagnostics()
        cls.odometry = {name: Recorder('/camera/%s/odometry' % name, Odometry) for name in NAMES}
        cls.twists = {name: Recorder('/camera/%s/twist' % name, TwistWithCovarianceStamped)
                      for name in NAMES}
        cls.sent = Recorder('/tf', TFMessage)
        for publisher in (cls.infos, cls.ranges, cls.imus, cls.tf):
            wait_until(lambda publisher=publisher: publisher.get_num_connections() > 0,
                       publisher.name + ' is subscribed')
        cls.place = 0
        cls.frames = 0

        def answered():
            cls.send()
            rospy.sleep(0.1)
            return all(r.messages() for r in cls.twists.values())
        wait_until(answered, 'every one has a twist')

    @classmethod
    def send(cls, height=HEIGHT, width=640, imu=True, late=0.0, stamp=None, blank=False, sensor='camera',
             turn=0.0, still=False):
        """One frame of the ground, with its readings before it. still: the picture of the frame before."""
        stamp = stamp or cls.camera.next_stamp()
        height = next(height) if isinstance(height, itertools.cycle) else height
        cls.infos.publish(calibration(stamp, width))
        if height is not None:
            reading = Range(min_range=0.1, max_range=20.0, range=height)
            reading.header.stamp, reading.header.frame_id = stamp - rospy.Duration(late), sensor
            cls.ranges.publish(reading)
        if imu:
            message = Imu()
            message.header.stamp, message.header.frame_id = stamp, 'imu'
            message.orientation.w = 1.0
            message.angular_velocity.z = turn
            message.angular_velocity_covariance = np.diag([np.radians(0.001) ** 2] * 3).flatten().tolist()
            cls.imus.publish(message)
        below = (0, 0, LEVER[2] - HEIGHT)  # a child of the base, which has odom as its parent
        cls.tf.publish(TFMessage([transform('base_link', 'ground', below, stamp, STILL)]))
        cls.frames += 0 if still else 1
        step = cls.frames % 60
        step = min(step, 60 - step)  # there and back
        pixels = view(100 + STEP[0] * step, 100 + STEP[1] * step)
        if blank:
            pixels = np.full_like(pixels, 90)
        cls.camera.send(image_message(pixels, stamp))
        return stamp

    def twist_after(self, name, frames=4, **options):
        """The first twist after this number of frames. Frames go on until it is there: a busy machine drops
        some, and then the next ones may need more frames to agree with the readings again."""
        for _ in range(frames):
            stamp = self.send(**options)
            rospy.sleep(0.05)

        def later():
            return [m for m in self.twists[name].messages() if m.header.stamp >= stamp]

        def found():
            if not later():
                self.send(**options)
                rospy.sleep(0.05)
            return later()
        wait_until(found, '%s has a twist' % name)
        return later()[0]

    def said(self, words, name='ground_motion'):
        wait_until(lambda: any(words in m.msg for m in self.log.messages() if name in m.name or 'manager' in m.name),
                   'the log says: ' + words)

    def diagnosed(self, words, name='ground_motion', **options):
        """In the diagnostics, while frames go on. name: of a ground motion, or of any task."""
        task = name if ': ' in name else name + ': motion'

        def found():
            self.send(**options)
            rospy.sleep(0.05)
            return any(words in s.message for s in self.diagnostics.of(task, -8))
        wait_until(found, lambda: '%s says: %s; its last report is %s' % (name, words, self.diagnostics.of(task)[-1:]))

    def test_1_velocity_is_in_metres_from_every_source(self):
        for name in NAMES:
            message = self.twist_after(name)
            limit = 0.05 if name == 'by_motion' else 0.02  # its normal is less certain
            v, w = message.twist.twist.linear, message.twist.twist.angular
            speed = np.hypot(v.x, v.y)
            expected = np.hypot(*STEP) / METRE / PERIOD
            self.assertLess(abs(speed - expected), limit, name)
            self.assertLess(abs(v.z), limit, name)
            # The picture moves right and down under the camera: its x is forward, its y to the right.
            self.assertLess(abs(abs(v.x) - STEP[0] / METRE / PERIOD), limit, name)
            self.assertLess(v.x * v.y, 0.0, name)
            self.assertLess(abs(w.x) + abs(w.y) + abs(w.z), limit, name)
            frame = 'camera_level' if name == 'by_parameter' else 'base_link'
            self.assertEqual(message.header.frame_id, frame)
            covariance = np.array(message.twist.covariance).reshape(6, 6)
            self.assertTrue(np.all(np.linalg.eigvalsh(covariance) > 0.0))
            odometry = self.odometry[name].wait_for(message.header.stamp)
            self.assertEqual((odometry.header.frame_id, odometry.child_frame_id), ('odom', frame))
            base = 0.0 if name == 'by_parameter' else LEVER[2]
            self.assertLess(abs(odometry.pose.pose.position.z - (HEIGHT - base)), 0.05, name)

    def test_2_tf_is_sent_only_where_publish_tf_is_set(self):
        stamp = self.twist_after('ground_motion').header.stamp

        def sent():
            return [t for m in self.sent.messages() for t in m.transforms
                    if t.header.stamp == stamp and t.child_frame_id == 'base_link']
        wait_until(sent, 'tf has odom -> base_link')
        self.assertEqual(len(sent()), 1)
        pose = self.odometry['ground_motion'].wait_for(stamp).pose.pose.position
        self.assertAlmostEqual(sent()[0].transform.translation.x, pose.x)

    def test_3_services(self):
        reset = rospy.ServiceProxy('/camera/ground_motion/reset', Trigger)
        set_pose = rospy.ServiceProxy('/camera/ground_motion/set_pose', SetPose)
        self.assertTrue(reset().success)
        stamp = self.send()
        odometry = self.odometry['ground_motion'].wait_for(stamp).pose.pose.position
        self.assertLess(abs(odometry.x) + abs(odometry.y), 0.01)
        pose = PoseWithCovariance()
        self.assertIn('quaternion', set_pose(pose).message)
        pose.pose.orientation.w = 1.0
        pose.pose.position.x = 50.0
        self.assertTrue(set_pose(pose).success)
        stamp = self.send()
        odometry = self.odometry['ground_motion'].wait_for(stamp).pose.pose.position
        self.assertLess(abs(odometry.x - 50.0) + abs(odometry.y), 0.01)

    def test_3_too_large_numbers_are_named(self):
        set_pose = rospy.ServiceProxy('/camera/ground_motion/set_pose', SetPose)
        pose = PoseWithCovariance()
        pose.pose.orientation.w = 1.0
        pose.covariance = [1.7e308 if i in (0, 7, 35) else 0.0 for i in range(36)]  # x, y, yaw
        self.twist_after('ground_motion')
        self.assertTrue(set_pose(pose).success)
        self.twist_after('ground_motion', 14)
        self.said('nothing is published: numbers too large to compute with: the odometry begins anew')

    def test_4_bad_heights_are_named(self):
        self.twist_after('ground_motion')
        for height, words in ((0.0, 'is 0.000000 m; expected a number above 0'),
                              (float('nan'), 'is nan m'), (50.0, 'is 50.000000 m'),
                              # More than some in a row would be believed.
                              (itertools.cycle((3.0, HEIGHT)), 'contradicts the homography')):
            self.diagnosed(words, height=height)
            self.twist_after('ground_motion', 14)
        self.diagnosed('does not point to the ground; a range sensor looks along the x axis of its frame, base_link',
                       sensor='base_link')
        self.diagnosed('away from the image; expected at most max_age', late=0.5)
        for _ in range(40):  # more than `patience`
            self.send(late=0.5)
            rospy.sleep(0.02)
        self.said('nothing is published: no height')
        count = len(self.twists['ground_motion'].messages())
        for _ in range(5):
            stamp = self.send(late=0.5)
        self.twists['by_tf'].wait_for(stamp)
        self.assertEqual(len(self.twists['ground_motion'].messages()), count)
        self.twist_after('ground_motion')  # and it goes on

    def test_5_a_missing_normal_is_named(self):
        self.diagnosed('nothing is published: no normal: the nearest Imu', imu=False)
        self.twist_after('ground_motion')

    def test_5_a_missing_gyro_and_a_height_used_before_are_named(self):
        self.diagnosed('no angular velocity on /camera/imu', 'by_motion', imu=False)
        self.diagnosed('nothing is published: no height: no new reading yet', 'by_motion', height=None)
        self.twist_after('by_motion')

    def test_5_unknown_choices_are_refused(self):
        client = Client('/camera/by_parameter', timeout=TIMEOUT)
        # ROS's client itself makes imu of IMU.
        for name, value, usual in (('height_source', 'laser', 'parameter'), ('normal_source', 'gyro', 'imu'),
                                   ('calibration', '', 'by_name')):
            self.assertEqual(client.update_configuration({name: value})[name], usual)
            self.diagnosed('parameters refused: parameter %s is %s; expected' % (name, value or 'empty'),
                           'by_parameter')
        client.update_configuration({'max_age': 0.1})
        with node('GroundMotion', 'refused', '_height_source:=laser') as refused:
            self.assertIn('/refused/height_source is laser; expected range or tf_height or parameter', refused.wait())

    def test_5_a_camera_that_looks_away_from_the_ground_is_named(self):
        """By tf it looks up: the velocity would have the wrong sign."""
        client = Client('/camera/by_parameter', timeout=TIMEOUT)
        self.addCleanup(client.update_configuration, {'base_frame': '', 'normal_source': 'imu'})
        client.update_configuration({'base_frame': 'camera', 'normal_source': 'down'})
        self.diagnosed('nothing is published: the camera looks away from the ground', 'by_parameter')
        self.twist_after('by_tf')
        last = self.camera.last_stamp()
        stamp = self.send()
        self.twists['by_tf'].wait_for(stamp)
        self.assertFalse([m for m in self.twists['by_parameter'].messages() if m.header.stamp > last])

    def test_6_a_calibration_of_another_size_is_refused(self):
        for name in NAMES:
            self.diagnosed('the camera_info is of 1280x480 images', name, width=1280)
        self.twist_after('ground_motion')

    def test_7_a_second_without_homography_grows_the_covariance(self):
        self.twist_after('ground_motion')
        before = self.odometry['ground_motion'].messages()[-1]
        for _ in range(30):
            self.send(blank=True)
            rospy.sleep(0.02)
        self.twist_after('ground_motion')
        after = self.odometry['ground_motion'].messages()[-1]
        self.assertGreater(after.pose.covariance[0], before.pose.covariance[0] + 0.1)
        self.said('the odometry goes on after')

    def test_7_a_simulated_camera_that_stands_still_has_a_velocity_of_zero(self):
        """Its images have no noise, so that each is that of the frame before."""
        self.twist_after('ground_motion')
        twists = self.twists['ground_motion']
        before, log = len(twists.messages()), len(self.log.messages())
        twist = self.twist_after('ground_motion', 60, still=True).twist
        self.assertGreater(len(twists.messages()) - before, 40)
        speed = np.hypot(twist.twist.linear.x, twist.twist.linear.y)
        self.assertLess(speed, 0.01)
        self.assertLess(np.sqrt(twist.covariance[0]), 0.05)
        said = [m.msg for m in self.log.messages()[log:]]
        self.assertFalse([words for words in said if 'repeat' in words or 'nothing is published' in words])

    def test_7_images_that_come_twice_are_half_as_many(self):
        """A driver that sends each of them with two stamps."""
        self.twist_after('ground_motion')
        start = None
        for i in range(60):
            stamp = self.send(still=i % 2 == 1)
            start = start or stamp
            rospy.sleep(0.05)
        self.diagnosed('images repeat', 'matcher: matcher', still=True)
        twists = [m for m in self.twists['ground_motion'].messages() if start < m.header.stamp <= stamp]
        self.assertGreater(len(twists), 15)
        speeds = [np.hypot(m.twist.twist.linear.x, m.twist.twist.linear.y) for m in twists[5:]]
        self.assertAlmostEqual(np.median(speeds), np.hypot(*STEP) / METRE / PERIOD / 2, delta=0.02)

    def test_8_a_mount_on_tf_that_comes_after_its_image_is_waited_for(self):
        """A gimbal, whose transforms are half as many as the images."""
        topics = ['%s:=/camera/%s' % (name, name if name != 'match' else 'matcher/match')
                  for name in ('camera_info', 'match')]
        with node('GroundMotion', 'by_gimbal', 'image:=/camera/image_raw', *topics, '_height_source:=parameter',
                  '_height:=%s' % HEIGHT, '_base_frame:=gimbal', '_normal_source:=down', '_max_age:=1.0') as gimbal:
            twists = Recorder('/by_gimbal/twist', TwistWithCovarianceStamped, self)
            wait_until(twists.publishers, 'it runs')

            def send(pairs):
                for _ in range(pairs):
                    self.send()
                    rospy.sleep(0.05)
                    stamp = self.send()
                    rospy.sleep(0.05)
                    self.tf.publish(TFMessage([transform('camera', 'gimbal', (0, 0, 0), stamp)]))
            wait_until(lambda: send(1) or twists.messages(), lambda: 'a twist comes: ' + gimbal.output())
            before = len(twists.messages())
            send(30)
            wait_until(lambda: len(twists.messages()) - before >= 50, lambda: 'nearly all come: ' + gimbal.output())

    def test_8_a_hundred_matches_wait_for_their_readings(self):
        """SECURITY.md: with one more, the oldest is processed without them."""
        with node('GroundMotion', 'by_nothing', 'match:=/by_nothing/match', 'camera_info:=/by_nothing/camera_info',
                  '_max_age:=10.0') as alone:
            twists = Recorder('/by_nothing/twist', TwistWithCovarianceStamped, self)
            matches = rospy.Publisher('/by_nothing/match', Match, queue_size=200)
            wait_until(lambda: twists.publishers() and matches.get_num_connections() > 0,
                       lambda: 'it runs: ' + alone.output())

            def send(i):
                match = Match()
                match.header.stamp = rospy.Time(1000, 1000 * i)
                matches.publish(match)

            def total(part, name):
                reports = self.diagnostics.values('by_nothing: ' + part)
                return int(reports[-1].get(name, 0)) if reports else 0
            for i in range(100):
                send(i)
            wait_until(lambda: total('input', 'matches') == 100, lambda: 'all arrive: ' + alone.output())
            seen = len(self.diagnostics.messages())
            wait_until(lambda: self.diagnostics.of('by_nothing: motion', seen), 'a report after them')
            self.assertEqual(total('motion', 'frames done'), 0)
            send(100)
            wait_until(lambda: total('motion', 'frames done'), lambda: 'one is processed: ' + alone.output())
            self.assertEqual(total('motion', 'frames done'), 1, 'all of them would be processed after max_age')
            matches.unregister()

    def test_8_a_start_is_no_warning(self):
        with node('GroundMotion', 'by_start', 'match:=/by_start/match', 'camera_info:=/camera/camera_info',
                  '_height_source:=parameter', '_height:=1.0', '_normal_source:=down', '_base_frame:=') as alone:
            twists = Recorder('/by_start/twist', TwistWithCovarianceStamped, self)  # without one it hears nothing
            wait_until(twists.publishers, alone.output)
            matches = rospy.Publisher('/by_start/match', Match, queue_size=10)
            wait_until(matches.get_num_connections, lambda: 'it runs: ' + alone.output())

            def says(status, reason, words):
                match = Match()
                match.header.stamp, match.header.frame_id = rospy.Time(1000, 1000 * status), 'camera'
                match.homography.header = match.header
                match.homography.status, match.homography.reason = status, reason
                match.homography.image_width, match.homography.image_height = 640, 480
                self.infos.publish(calibration(match.header.stamp))
                matches.publish(match)
                wait_until(lambda: any(words in s.message for s in self.diagnostics.of('by_start: motion')),
                           lambda: words + alone.output())
            says(MatchStatus.STATUS_NO_REFERENCE, MatchStatus.REASON_FIRST_FRAME, 'the first frame has no reference')
            says(MatchStatus.STATUS_NO_MODEL, MatchStatus.REASON_NONE, 'the matcher found no homography')
            self.assertTrue(alone.says('the matcher found no homography'))
            self.assertNotIn('the first frame', alone.output())
            matches.unregister()

    def test_8_a_mount_that_was_sent_once_before_anybody_subscribed_is_known(self):
        """As by rosbag play, which does not latch the /tf_static of most bags."""
        topics = ['%s:=/camera/%s' % (name, name if name != 'match' else 'matcher/match')
                  for name in ('camera_info', 'match')]
        with tempfile.TemporaryDirectory() as folder, \
                node('GroundMotion', 'by_bag', 'image:=/camera/image_raw', *topics, '_height_source:=parameter',
                     '_height:=%s' % HEIGHT, '_base_frame:=mount', '_normal_source:=down') as by_bag:
            with rosbag.Bag(folder + '/mount.bag', 'w') as bag:
                bag.write('/tf_static', TFMessage([transform('camera', 'mount', (0, 0, 0), rospy.Time())]),
                          rospy.Time(1.0))
            master = rosgraph.Master('/robot_motion_test')
            wait_until(lambda: '/by_bag' in dict(master.getSystemState()[1]).get('/tf_static', []), by_bag.output)
            for _ in range(3):  # in case that a subscriber connects late
                subprocess.check_call(['rosbag', 'play', '--quiet', '--wait-for-subscribers', folder + '/mount.bag'])
            twists = Recorder('/by_bag/twist', TwistWithCovarianceStamped, self)
            wait_until(lambda: self.send() and (rospy.sleep(0.05) or twists.messages()), by_bag.output)

    def test_8_a_problem_that_comes_and_goes_is_logged_once(self):
        words = 'the matcher found no homography'
        before = len(self.log.with_words(words))
        for _ in range(6):
            self.twist_after('ground_motion')
            self.send(blank=True)
        self.twist_after('ground_motion')
        self.log.wait_for_words(words)
        self.assertLessEqual(len(self.log.with_words(words)) - before, len(NAMES), 'each node says it once')

    def test_8_a_clock_that_jumps_restarts(self):
        self.twist_after('ground_motion')
        last = self.camera.last_stamp()
        self.camera._stamp -= rospy.Duration(200.0)
        self.send()
        self.said('the stamp went back: the frame is left out')

        def newest():
            self.send()
            rospy.sleep(0.05)
            return self.odometry['ground_motion'].messages()[-1]
        wait_until(lambda: newest().header.stamp < last, 'the odometry begins anew')
        self.assertLess(abs(newest().pose.pose.position.x), 2.0)
        self.camera._stamp += rospy.Duration(1000.0)
        self.twist_after('ground_motion', 14)

    def test_8_a_gyro_that_contradicts_the_picture_does_not_turn_the_camera(self):
        # The picture does not turn; a gyro that says otherwise is weighed down.
        for rate in (0.3, -0.3):
            self.twist_after('by_motion')
            seen = self.twist_after('by_motion', 3, turn=rate).twist.twist.angular.z
            self.assertLess(abs(seen), 0.1)

    def test_8_a_gyro_that_drifts_is_named(self):
        """By a node of its own: the others average the bias over the minutes in which it was zero."""
        topics = ['%s:=/camera/%s' % (name, name if name != 'match' else 'matcher/match')
                  for name in ('camera_info', 'match', 'imu')]
        with node('GroundMotion', 'by_drift', 'image:=/camera/image_raw', *topics, '_height_source:=parameter',
                  '_height:=%s' % HEIGHT, '_normal_source:=motion', '_gyro:=true', '_max_age:=10.0'):
            twists = Recorder('/by_drift/twist', TwistWithCovarianceStamped, self)
            wait_until(twists.publishers, 'it runs')
            self.diagnosed("the Imu's angular velocity seems 1.5", 'by_drift', turn=np.radians(1.5))

    def test_9_without_subscribers_it_hears_only_tf(self):
        for recorders in (self.odometry, self.twists):
            recorders['by_tf'].close()
        wait_until(lambda: any('idle' in s.message for s in self.diagnostics.of('by_tf: motion', -8)),
                   'by_tf is idle')

        def heard():
            subscribers = rosgraph.Master('/robot_motion_test').getSystemState()[1]
            return sorted(topic for topic, nodes in subscribers if '/camera/by_tf' in nodes)
        wait_until(lambda: heard() == ['/tf', '/tf_static'], lambda: 'it hears only tf: %s' % heard())
