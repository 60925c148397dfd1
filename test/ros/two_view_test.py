"""A camera that moves past a scene with depth: its motion on ~two_view and the scene on ~points."""

import csv
import json
import os
import subprocess
import tempfile

import cv2
import numpy as np
import rosbag
import rospy
from ktgp_orb.msg import Correspondences, MatchStatus, TwoViewGeometry
from ktgp_testing import (FAR, NEAR, OVER_A_PLANE, Log, MatcherCase, tilted_plane, two_depths, view, wait_until,
                          write_bag)
from poster import K, information, pose_of
from sensor_msgs import point_cloud2
from sensor_msgs.msg import CameraInfo

DIRECTION = np.array([-0.95, 0.1, 0.2]) / np.linalg.norm([-0.95, 0.1, 0.2])
DISTANCE = 0.3
FIRST = view(100, 100)
NO_MOTION = 'there is no motion of the camera: no camera_info'
PLANE = tilted_plane(FIRST, K, 0.5)
SECOND = two_depths(FIRST, K, DISTANCE, DIRECTION)


class TwoViewTest(MatcherCase):
    topics = 'two_view', 'homography', 'correspondences', 'points'

    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.info = rospy.Publisher('/camera/camera_info', CameraInfo, queue_size=5, latch=True)

    def match(self):
        """The stamp of the second view, which is matched to the first."""
        for picture in (FIRST, SECOND):
            stamp = self.camera.show(picture)
            self.homography.wait_for(stamp)
        return stamp

    def test_1_the_default_publishes_neither(self):
        self.client.update_configuration({'geometry': 'homography'})
        self.match()
        stamp = self.match()
        self.correspondences.wait_for(stamp)
        self.assertEqual(self.two_view.messages(), [])
        self.assertEqual(self.points.messages(), [])

    def test_2_without_camera_info_it_is_the_fundamental_matrix(self):
        self.client.update_configuration({'geometry': 'auto', 'mutual': True, 'gms': False, 'T_w': 1.0})
        log = Log(self)
        self.match()
        found = self.two_view.wait_for(self.match())
        self.assertEqual(found.geometry, TwoViewGeometry.GEOMETRY_EPIPOLAR)
        self.assertFalse(found.has_pose)
        log.wait_for_words(NO_MOTION)
        self.match()
        self.assertEqual(len(log.with_words(NO_MOTION)), 1)
        self.assertAlmostEqual(np.linalg.norm(found.fundamental), 1.0, 6)
        self.assertEqual(self.points.messages(), [])
        self.diagnostics.wait_for_words(NO_MOTION, self.match)

    def test_3_camera_info_gives_the_motion_and_the_scene(self):
        self.info.publish(information())
        wait_until(lambda: self.two_view.wait_for(self.match()).has_pose, 'camera_info is in')
        stamp = self.match()
        found = self.two_view.wait_for(stamp)
        self.assertEqual(found.status, MatchStatus.STATUS_OK)
        self.assertEqual(found.geometry, TwoViewGeometry.GEOMETRY_EPIPOLAR)
        self.assertEqual(found.header.frame_id, 'camera')
        self.assertLess(found.reference_stamp, stamp)
        p, q = found.pose.pose.position, found.pose.pose.orientation
        self.assertGreater(np.dot([p.x, p.y, p.z], DIRECTION), 0.9995)
        self.assertGreater(abs(q.w), np.cos(0.5 * 0.002))
        self.assertTrue(np.isfinite(found.pose.covariance).all())
        self.assertGreater(found.parallax, 1.0)
        self.assertLess(found.log_false_alarms_epipolar, found.log_false_alarms_homography)

        # There is no homography, and the levels say what they belong to.
        homography = self.homography.wait_for(stamp)
        self.assertEqual(homography.status, MatchStatus.STATUS_MODEL_REJECTED)
        self.assertEqual(homography.reason, MatchStatus.REASON_NO_PLANE)
        self.assertEqual(list(homography.homography), [0.0] * 9)
        matches = self.correspondences.wait_for(stamp)
        self.assertEqual(matches.geometry, TwoViewGeometry.GEOMETRY_EPIPOLAR)
        level = np.frombuffer(matches.level, np.uint8)
        self.assertEqual((level == Correspondences.LEVEL_KTGP).sum(), found.inliers)

        # The diagnostics count the motions, not the homographies.
        seen = len(self.diagnostics.messages())

        def every_frame_has_a_motion():
            self.match()
            return any(value.key == 'share with geometry' and float(value.value) > 0.9
                       for status in self.diagnostics.of('', seen) for value in status.values)
        wait_until(every_frame_has_a_motion, 'the diagnostics say that nearly every frame has a geometry')

        cloud = self.points.wait_for(stamp)
        points = np.array(list(point_cloud2.read_points(cloud, ('x', 'y', 'z', 'deviation'))))
        self.assertEqual(cloud.header.frame_id, 'camera')
        self.assertGreater(len(points), 200)
        moved = DISTANCE * DIRECTION[2]  # of the planes, in the camera's frame
        depth = DISTANCE * points[:, 2]
        near = np.abs(depth - NEAR - moved) < 0.1 * NEAR
        far = np.abs(depth - FAR - moved) < 0.15 * FAR
        self.assertGreater(near.sum(), 100)
        self.assertGreater(far.sum(), 50)
        self.assertGreater((near | far).mean(), 0.95)
        self.assertTrue((points[:, 3] > 0).all())

    def test_5_a_recording_gives_the_same(self):
        with tempfile.TemporaryDirectory() as folder:
            bag, out, table = (os.path.join(folder, name) for name in ('in.bag', 'out.bag', 'out.csv'))
            write_bag(bag, (FIRST, SECOND), info=information(), rate=1.0)
            run = subprocess.run(['rosrun', 'ktgp_orb', 'ktgp_bag', bag, out, '--preset', 'slam', '--csv', table,
                                  '--calibration', 'rectified'], check=True, stderr=subprocess.PIPE, text=True)
            self.assertRegex(run.stderr, r'\n1 motion \(1 epipolar\), median parallax [0-9.]+ degrees, median of ')
            with rosbag.Bag(out) as file:
                topics = {topic.split('/')[-1]: message for topic, message, _ in file.read_messages()}
            with open(table) as file:
                rows = list(csv.DictReader(file))
        found = topics['two_view']
        self.assertEqual(found.geometry, TwoViewGeometry.GEOMETRY_EPIPOLAR)
        self.assertEqual(topics['points'].header.stamp, rospy.Time(1001))
        self.assertGreater(topics['points'].width, 200)
        self.assertEqual([row['geometry'] for row in rows], ['none', 'epipolar'])
        self.assertEqual([row['status'] for row in rows], ['no_reference', 'ok'])
        self.assertEqual(topics['statistics'].status, MatchStatus.STATUS_OK)
        self.assertEqual(topics['statistics'].geometry, TwoViewGeometry.GEOMETRY_EPIPOLAR)
        self.assertEqual(int(rows[1]['inliers']), found.inliers)
        self.assertEqual(rows[0]['tx'], '')
        translation = np.array([float(rows[1]['t' + name]) for name in 'xyz'])
        self.assertGreater(translation @ DIRECTION, 0.9995)
        covariance = np.reshape(found.pose.covariance, (6, 6))
        self.assertAlmostEqual(float(rows[1]['cov_tx_rz']), covariance[0, 5], delta=1e-6 * abs(covariance[0, 5]))
        self.assertEqual(rows[1]['doubt'], 'none')
        q = found.pose.pose.orientation
        self.assertEqual([float(rows[1]['q' + name]) for name in 'xyzw'], [q.x, q.y, q.z, q.w])
        self.assertAlmostEqual(float(rows[1]['parallax']), found.parallax, 6)

    def test_6_a_folder_of_images_and_a_video_have_the_camera_that_is_given(self):
        with tempfile.TemporaryDirectory() as folder:
            for name, image in (('1.png', FIRST), ('2.png', SECOND)):
                cv2.imwrite(os.path.join(folder, name), image)
            self.check_a_camera_that_is_given(folder, '*.png', 0.9995)
            video = cv2.VideoWriter(os.path.join(folder, 'in.avi'), cv2.VideoWriter_fourcc(*'MJPG'), 10.0, (640, 480))
            for image in (FIRST, SECOND):
                video.write(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR))
            video.release()
            self.check_a_camera_that_is_given(folder, 'in.avi', 0.999)

    def check_a_camera_that_is_given(self, folder, recording, least_cosine):
        out, table = os.path.join(folder, 'out.bag'), os.path.join(folder, 'out.csv')
        command = ['rosrun', 'ktgp_orb', 'ktgp_bag', os.path.join(folder, recording), out, '--csv', table, '--force']
        camera = '%g,%g,%g,%g' % (K[0, 0], K[1, 1], K[0, 2], K[1, 2])
        subprocess.run(command + ['--preset', 'slam', '--camera', camera], check=True)
        with open(table) as file:
            rows = list(csv.DictReader(file))
        self.assertEqual([row['geometry'] for row in rows], ['none', 'epipolar'])
        self.assertGreater(np.array([float(rows[1]['t' + name]) for name in 'xyz']) @ DIRECTION, least_cosine)
        for words, reason in ((['--camera', camera], '--camera has no effect'),
                              (['--preset', 'slam', '--camera', '1,1,0,0'], 'fx of the camera matrix is 1; expected')):
            run = subprocess.run(command + words, stderr=subprocess.PIPE, text=True)
            self.assertEqual(run.returncode, 2)
            self.assertIn(reason, run.stderr)

    def test_7_a_recording_of_a_plane_has_both_motions(self):
        with tempfile.TemporaryDirectory() as folder:
            bag, out, table = (os.path.join(folder, name) for name in ('in.bag', 'out.bag', 'out.csv'))
            write_bag(bag, (FIRST, PLANE), info=information(), rate=1.0)
            run = subprocess.run(['rosrun', 'ktgp_orb', 'ktgp_bag', bag, out, '--preset', 'slam', '--csv', table,
                                  '--calibration', 'rectified'], check=True, stderr=subprocess.PIPE, text=True)
            self.assertRegex(run.stderr, r'\n1 motion \(1 plane\), .*, 1 in doubt: two_motions_of_a_plane, ')
            with rosbag.Bag(out) as file:
                found = [message for topic, message, _ in file.read_messages() if topic.endswith('two_view')][-1]
            with open(table) as file:
                row = list(csv.DictReader(file))[1]
        self.assertEqual((row['geometry'], row['other_geometry']), ('plane', 'plane'))
        self.assertEqual(row['doubt'], 'two_motions_of_a_plane')
        # The rival has the rest.
        self.assertAlmostEqual(float(row['probability']), found.probability, 6)
        self.assertGreaterEqual(found.probability, 0.5, 'the likelier motion is the first')
        self.assertLess(found.probability, 1.0)
        self.assertEqual(found.other_geometry, TwoViewGeometry.GEOMETRY_PLANE)
        self.assertEqual(len(found.other_pose), 1)
        translations = [np.array([float(row[name + axis]) for axis in 'xyz']) for name in ('t', 'other_t')]
        self.assertLess(np.dot(*translations), 0.99)
        direction = OVER_A_PLANE / np.linalg.norm(OVER_A_PLANE)
        self.assertGreater(max(translation @ direction for translation in translations), 0.99)
        p, q = found.other_pose[0].pose.position, found.other_pose[0].pose.orientation
        np.testing.assert_allclose(translations[1], [p.x, p.y, p.z], rtol=1e-5, atol=1e-9)
        self.assertEqual([float(row['other_q' + name]) for name in 'xyzw'], [q.x, q.y, q.z, q.w])
        covariance = np.reshape(found.other_pose[0].covariance, (6, 6))
        self.assertGreater(np.diag(covariance).min(), 0.0)
        for i, first in enumerate(('tx', 'ty', 'tz', 'rx', 'ry', 'rz')):
            for k, second in list(enumerate(('tx', 'ty', 'tz', 'rx', 'ry', 'rz')))[i:]:
                self.assertAlmostEqual(float(row['other_cov_%s_%s' % (first, second)]), covariance[i, k],
                                       delta=1e-5 * abs(covariance[i, k]))

    def test_8_the_second_motion_of_a_plane_is_that_of_ktgp_match(self):
        """Not of ktgp_bag: its table is made of the messages."""
        self.client.update_configuration({'geometry': 'auto', 'mutual': True, 'gms': False, 'T_w': 1.0,
                                          'distribution': 'uniform', 'calibration': 'rectified'})
        self.info.publish(information())
        wait_until(lambda: self.two_view.wait_for(self.match()).has_pose, 'camera_info is in')
        # The motion before would be a guess, which ktgp_match does not have.
        self.call('reset')
        self.homography.wait_for(self.camera.show(FIRST))
        found = self.two_view.wait_for(self.camera.show(PLANE))
        with tempfile.TemporaryDirectory() as folder:
            files = [os.path.join(folder, name) for name in ('first.png', 'second.png', 'out.json')]
            cv2.imwrite(files[0], FIRST)
            cv2.imwrite(files[1], PLANE)
            subprocess.run(['rosrun', 'ktgp_orb', 'ktgp_match', *files[:2], '--preset', 'slam', '--features', '2000',
                            '--json', files[2], '--camera', '%g,%g,%g,%g' % (K[0, 0], K[1, 1], K[0, 2], K[1, 2])],
                           check=True, stdout=subprocess.DEVNULL)
            with open(files[2]) as file:
                expected = json.load(file)['two_view']
        self.assertEqual(expected['doubt'], 'two_motions_of_a_plane')
        self.assertEqual(found.doubt, TwoViewGeometry.DOUBT_TWO_MOTIONS_OF_A_PLANE)
        first, other = expected['pose'], expected['other_pose']
        self.assertEqual(other['geometry'], 'plane')
        self.assertEqual(found.other_geometry, TwoViewGeometry.GEOMETRY_PLANE)
        self.assertAlmostEqual(found.probability, expected['probability'], 9)
        self.assertAlmostEqual(1.0 - found.probability, other['probability'], 9)
        self.assertEqual(len(found.other_pose), 1)
        for pose, motion, covariance in ((found.pose, first, expected['pose_covariance']),
                                         (found.other_pose[0], other, other['covariance'])):
            rotation, position = pose_of(pose)
            np.testing.assert_allclose(position, motion['translation'], atol=1e-9)
            np.testing.assert_allclose(rotation, motion['rotation'], atol=1e-9)
            np.testing.assert_allclose(pose.covariance, np.ravel(covariance), rtol=1e-6, atol=1e-15)
        self.assertFalse(np.allclose(found.pose.covariance, found.other_pose[0].covariance), 'each has its own')

    def test_4_a_camera_info_that_cannot_be_used_is_said(self):
        self.info.publish(information(k=0 * K, p=0 * K))
        wait_until(lambda: not self.two_view.wait_for(self.match()).has_pose, 'the camera_info is in')
        self.diagnostics.wait_for_words('the camera is not calibrated', self.match)
        beside = K.copy()
        beside[0, 2] = 900.0
        self.info.publish(information(k=beside))
        self.diagnostics.wait_for_words('does it belong to another image size?', self.match)
        self.assertFalse(self.two_view.wait_for(self.match()).has_pose)
