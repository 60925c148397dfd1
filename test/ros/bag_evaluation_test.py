"""ktgp_evaluate_bag, and ktgp_bag's motion in metres, on the demo bag, which contains the truth."""

import contextlib
import math
import os
import re
import shutil
import unittest

import numpy as np
import rosbag
import rospy
from geometry_msgs.msg import TransformStamped
from ktgp_testing import FolderCase, messages_of
from tf2_msgs.msg import TFMessage

TOOL, BAG = os.environ['KTGP_ORB_EVALUATE'], os.environ['KTGP_ORB_DEMO_BAG']
ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.realpath(__file__))))
REAL = os.path.join(os.environ.get('KTGP_ORB_DATA', ''), 'motion/checkerboard.bag')
BY_IMU = ('--motion_normal_source', 'imu', '--motion_base_frame=')


class BagEvaluationTest(FolderCase):
    def motion(self, bag, *options, **expected):
        """Returns the messages of ktgp_bag and its table."""
        run = self.run_program(os.path.join(os.path.dirname(TOOL), 'ktgp_bag'), bag, 'matched.bag', '--motion',
                               'motion.csv', '--force', *options, **expected)
        return run.stdout + run.stderr, self.table('motion.csv') if os.path.exists(self.path('motion.csv')) else []

    @contextlib.contextmanager
    def changed_bag(self, seconds=100):
        """The messages of the first seconds of the demo bag, each after its time since the beginning; and a bag to
        write, changed.bag."""
        with rosbag.Bag(BAG) as bag, rosbag.Bag(self.path('changed.bag'), 'w') as changed:
            begin = bag.get_start_time()
            end = rospy.Time.from_sec(begin + seconds)
            messages = bag.read_messages(end_time=end)
            yield ((t.to_sec() - begin, topic, message, t) for topic, message, t in messages), changed

    def test_every_frame_is_matched_close_to_the_truth(self):
        self.run_program(TOOL, BAG, '--json', 'out.json')
        sequence = self.json()['sequence']
        self.assertEqual(len(sequence['frames']), 300)
        errors = sorted(frame['corner_error'] for frame in sequence['frames']
                        if frame.get('corner_error') is not None)
        self.assertGreater(len(errors), 290)
        self.assertLess(errors[len(errors) // 2], 0.5)
        self.assertLess(errors[int(0.95 * len(errors))], 1.5)

    def test_motion_in_metres_is_close_to_the_truth(self):
        _, rows = self.motion(BAG, '--reference_mode', 'keyframe', *BY_IMU)
        truth = {}
        for message in messages_of(BAG, '/camera/ground_truth/odometry'):
            v = message.twist.twist.linear
            truth['%d.%09d' % (message.header.stamp.secs, message.header.stamp.nsecs)] = \
                math.sqrt(v.x ** 2 + v.y ** 2 + v.z ** 2)
        rows = [row for row in rows if row['vx']]
        self.assertGreater(len(rows), 270)
        # The velocity of a row is that between two frames, half a frame older than the truth.
        errors = sorted(abs(math.sqrt(sum(float(row[name]) ** 2 for name in ("vx", "vy", "vz"))) /
                            truth[row['stamp']] - 1) for row in rows)
        self.assertLess(errors[len(errors) // 2], 0.02)
        self.assertLess(errors[int(0.95 * len(errors))], 0.1)

    def said_about_imu(self, late, degrees, scale=1.0):
        """Returns the messages of ktgp_bag if the stamps of the Imu are late by so many seconds, if tf has it turned by
        that angle about the optical axis, and if its angular velocity is multiplied by the scale."""
        with self.changed_bag() as (messages, rig):
            first = True
            for _, topic, message, stamp in messages:
                if topic == '/camera/imu':
                    place = TransformStamped()
                    place.header.frame_id, place.child_frame_id = message.header.frame_id, 'imu'
                    place.transform.rotation.z = math.sin(math.radians(degrees) / 2)
                    place.transform.rotation.w = math.cos(math.radians(degrees) / 2)
                    if first:
                        rig.write('/tf_static', TFMessage([place]), stamp)
                    first = False
                    message.header.stamp += rospy.Duration(late)
                    message.header.frame_id = 'imu'
                    for axis in 'xyz':
                        setattr(message.angular_velocity, axis, scale * getattr(message.angular_velocity, axis))
                rig.write(topic, message, stamp)
        return self.motion('changed.bag', '--reference_mode', 'keyframe', '--motion_gyro', 'true', *BY_IMU)[0]

    def test_an_imu_with_late_stamps_in_another_place_than_tf_says_is_named(self):
        said = self.said_about_imu(0.04, 2.0)
        late = re.search(r"the Imu's stamps seem ([0-9.]+) \+- ([0-9.]+) ms late", said)
        self.assertTrue(late, said)
        self.assertAlmostEqual(float(late.group(1)), 40, delta=4 * float(late.group(2)))
        # The base's z points to the camera.
        turned = re.search(r'the Imu seems to be mounted ([0-9.]+) \+- ([0-9.]+) degrees off about z', said)
        self.assertTrue(turned, said)
        self.assertAlmostEqual(float(turned.group(1)), 2.0, delta=4 * float(turned.group(2)))

    def test_a_wrong_scale_of_the_gyroscope_is_named_and_nothing_else(self):
        said = self.said_about_imu(0.0, 0.0, scale=1.05)
        scale = re.search(r"the scale of the Imu's angular velocity seems ([0-9.]+) \+- ([0-9.]+) % too large", said)
        self.assertTrue(scale, said)
        self.assertAlmostEqual(float(scale.group(1)), 5.0, delta=4 * float(scale.group(2)))
        self.assertEqual(len(re.findall('seems?', said)), 1, said)

    def test_a_correctly_mounted_imu_has_no_warning(self):
        said = self.said_about_imu(0.0, 0.0)
        self.assertIn('the Imu, as the pictures show it: mounted', said)
        self.assertNotIn('seem', said)

    def test_a_recording_that_was_cut_off_has_the_motion_up_to_there(self):
        shutil.copy(BAG, self.path('cut.bag'))
        self.damage('cut.bag', 0.1)  # and without its index
        _, rows = self.motion('cut.bag', *BY_IMU, code=1, words='the index at the end is missing')
        self.assertGreater(sum(bool(row['vx']) for row in rows), 15)

    def test_no_motion_at_all_is_no_success_and_every_row_says_why(self):
        said, rows = self.motion(BAG, '--duration', '0.3', '--motion_base_frame', 'no_frame', code=1,
                                 words='motion of 0 of 10 frames')
        self.assertRegex(said, '10 frames without: .*no_frame')
        self.assertEqual({row['status'] for row in rows}, {'refused'})
        self.assertTrue(all('no_frame' in row['reason'] for row in rows))

    def test_problems_are_counted_by_their_kind_and_readings_that_contradict_are_said(self):
        with self.changed_bag(3.5) as (messages, changed):
            for seconds, topic, message, stamp in messages:
                if topic == '/camera/range':
                    if 0.2 < seconds < 1.6:
                        continue
                    if 2.0 < seconds < 3.0 and int(10 * seconds) % 2:
                        message.range *= 0.5  # what passes below
                changed.write(topic, message, stamp)
        said, _ = self.motion('changed.bag', *BY_IMU)
        self.assertRegex(said, '[0-9]+ frames without: no height: the nearest range on /camera/range is [0-9.]+ s away')
        self.assertEqual(len(re.findall('frames without: no height: the nearest range', said)), 1, said)
        self.assertRegex(said, '[0-9]+ frames with motion, but not by all readings: height: .*contradicts')

    def test_after_a_second_without_a_height_there_is_no_motion(self):
        with self.changed_bag(3.5) as (messages, gap):
            for seconds, topic, message, stamp in messages:
                if not (topic == '/camera/range' and 0.5 < seconds < 2.5):
                    gap.write(topic, message, stamp)
        _, rows = self.motion('changed.bag', *BY_IMU)
        for row in rows:
            row['s'] = float(row['stamp']) - float(rows[0]['stamp'])
        old = [row for row in rows if 1.6 < row['s'] < 2.4]
        self.assertGreater(len(old), 20)
        self.assertEqual({(row['status'], row['x'], row['vx']) for row in old}, {('no_height', '', '')})
        self.assertTrue(all('range' in row['reason'] for row in old))
        others = [row for row in rows if 0.1 < row['s'] < 1.4 or row['s'] > 2.6]
        self.assertEqual({row['status'] for row in others}, {'ok'})
        self.assertTrue(all(row['vx'] for row in others))

    def test_a_topic_of_another_type_is_named(self):
        for options, words in ((['--motion_range', '/camera/imu'],
                                '/camera/imu is of type sensor_msgs/Imu; expected sensor_msgs/Range'),
                               (['--motion_gyro', 'true', '--motion_imu', '/camera/range'],
                                '/camera/range is of type sensor_msgs/Range; expected sensor_msgs/Imu')):
            self.motion(BAG, *options, code=2, words=words)

    def test_a_topic_without_the_truth_is_said(self):
        for topic in '/typo', '/camera/imu':
            self.run_program(TOOL, BAG, '--truth-topic', topic, '--topic', '/camera/image_raw', code=1,
                             words=' between two successive images of /camera/image_raw on ' + topic)

    def test_a_missing_bag_is_named(self):
        self.run_program(TOOL, 'no_such.bag', code=2, words='no_such.bag')


@unittest.skipUnless(os.path.exists(REAL), 'KTGP_ORB_DATA is not set: this test needs its motion/checkerboard.bag')
class RealMotionTest(FolderCase):
    """A camera with a rolling shutter in the hand, against motion capture."""

    def table(self, *options, words=()):
        """Its rows: in flight, and above 0.3 m; the numbers of each cell. words: what ktgp_bag says."""
        run = self.run_program('/usr/bin/python3', '-B', os.path.join(ROOT, 'scripts/report/motion.py'), '--tools',
                               os.path.dirname(TOOL), '--motion', REAL, '--drift', '3', '8', *options, words=words)
        print(run.stdout)
        rows = run.stdout.splitlines()[2:]
        self.assertEqual(len(rows), 2)
        return [[[float(word) for word in re.findall('[0-9.]+', cell)] for cell in line.split('|')[2:-1]]
                for line in rows]

    def write_turned_bag(self):
        """The recording, as a driver gives it that turns the images of a camera that is mounted upside down."""
        with rosbag.Bag(REAL) as bag, rosbag.Bag(self.path('turned.bag'), 'w') as turned:
            for topic, message, stamp in bag.read_messages():
                if topic == '/camera/image_rect':
                    message.data = message.data[::-1]  # one byte for each pixel
                elif topic == '/camera/camera_info':
                    P = list(message.P)
                    P[2], P[6] = message.width - 1 - P[2], message.height - 1 - P[6]
                    message.P = P
                elif topic == '/tf_static':
                    for place in message.transforms:
                        if place.child_frame_id == 'camera':
                            q = place.transform.rotation
                            q.x, q.y, q.z, q.w = q.y, -q.x, q.w, -q.z  # by 180 degrees about the optical axis
                turned.write(topic, message, stamp)

    def velocities(self, bag, readout_time):
        self.run_program(os.path.join(os.path.dirname(TOOL), 'ktgp_bag'), bag, 'matched.bag', '--force', '--start', '3',
                         '--duration', '2', '--motion', 'motion.csv', '--motion_readout_time=%g' % readout_time,
                         '--reference_mode', 'previous', '--guided', 'true', '--gms_grid', '0', code=None)
        return {row['stamp']: np.array([float(row[name]) for name in ('vx', 'vy', 'vz')])
                for row in FolderCase.table(self, 'motion.csv') if row['vx']}

    def test_a_readout_time_below_0_gives_the_velocities_of_images_that_are_turned_by_180_degrees(self):
        self.write_turned_bag()
        expected = self.velocities(REAL, 0.0155)
        self.assertGreater(len(expected), 100)
        off = {}
        for readout_time in (-0.0155, 0.0155):
            found = self.velocities('turned.bag', readout_time)
            errors = [np.sum((found[stamp] - expected[stamp]) ** 2) for stamp in expected if stamp in found]
            self.assertGreater(len(errors), 100)
            off[readout_time] = 1000 * np.sqrt(np.mean(errors))
        print('differs by %.1f mm/s, with the wrong sign by %.1f mm/s' % (off[-0.0155], off[0.0155]))
        self.assertLess(off[-0.0155], 20.0)
        self.assertGreater(off[0.0155], 2 * off[-0.0155], 'the sign matters')

    def check(self, *options, least_within, most_error=45.0, words=()):
        for cells, least_frames, most_lost in zip(self.table(*options, words=words), (500, 400), (7.0, 3.0)):
            frames, lost, error, _, squares, within, drift = cells
            self.assertGreater(frames[0], least_frames)
            self.assertLess(lost[0], most_lost)
            self.assertLess(error[0], most_error)  # mm/s, root mean square
            self.assertLess(squares[0], 8.0)
            self.assertGreater(within[0], least_within)
            self.assertLess(max(drift), 1.0)  # % of the way

    def test_velocity_as_recommended(self):
        self.check(least_within=96.0)

    def test_no_preset_is_off_by_a_period_of_the_ground(self):
        for preset in ('robust', 'video'):
            error = self.table('--preset', preset)[0][2]
            self.assertLess(error[2], 1000.0, preset)  # mm/s; a period in one frame is 6000

    def test_velocity_from_keyframes(self):
        self.check('--reference_mode', 'keyframe', '--guided', 'true', least_within=97.5)

    def test_velocity_from_keyframes_without_the_grid(self):
        self.check('--reference_mode', 'keyframe', '--guided', 'true', '--gms_grid', '0', least_within=96.5,
                   most_error=52.0)

    def test_velocity_from_keyframes_with_the_angular_velocity_of_the_capture(self):
        """This angular velocity is off by 2 degrees/s for tenths of a second. With the wrong sign the velocity would be
        off by 180 mm/s."""
        self.check('--reference_mode', 'keyframe', '--guided', 'true', '--motion_gyro', 'true', least_within=87.0,
                   most_error=90.0, words=', and its angular velocity')
