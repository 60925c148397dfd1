"""ktgp_bag --targets: a poster in a recording, against the truth and against ktgp_find; what is refused."""

import os

import cv2
import numpy as np
import rosbag
import rospy
from ktgp_orb.msg import MatchStatus
from ktgp_testing import FolderCase, image_message, messages_of, texture, write_bag
from poster import CHI_SQUARE, K, POSITION, POSTER, information, pose_errors, rendered
from sensor_msgs.msg import CompressedImage

POSITIONS = [POSITION + (0.02 * i, 0.01 * i, 0.05 * i) for i in range(5)]
FRAMES = [rendered(K, position=position) for position in POSITIONS]
DETECTIONS = '/camera/targets/detections'
LIST = '- {id: mine, image: poster.png, width: 1.0, frame: mine}\n- {image: other.png}\n'


class BagTargetsTest(FolderCase):
    def setUp(self):
        super().setUp()
        cv2.imwrite(self.path('poster.png'), POSTER)
        cv2.imwrite(self.path('other.png'), texture(300, 400, seed=11))
        self.write('targets.yaml', LIST)

    def write_bag(self, frames=FRAMES, info=information(), stamps=None):
        write_bag(self.path('in.bag'), frames, info=info, stamps=stamps)

    def run_bag(self, *arguments, recording='in.bag', **expected):
        self.run_program(os.environ['KTGP_ORB_BAG'], recording, 'out.bag', '--targets', 'targets.yaml', *arguments,
                         **expected)

    def detections(self, topic=DETECTIONS, bag='out.bag'):
        return messages_of(self.path(bag), topic)

    def test_finds_the_poster_in_every_image(self):
        self.write_bag()
        self.run_bag(words='targets.yaml: 5 detections in 5 of 5 images, 5 of them with a pose; known targets: 2\n')
        messages = self.detections()
        self.assertEqual(len(messages), len(FRAMES))
        for i, (message, position) in enumerate(zip(messages, POSITIONS)):
            self.assertEqual(message.header.stamp, rospy.Time.from_sec(1000 + i / 30.0))
            self.assertEqual((message.known, message.frames_for_all, message.no_pose), (2, 1, ''))
            found, = message.detections
            self.assertEqual((found.id, found.instance, found.status, found.frame, found.age),
                             ('mine', 0, MatchStatus.STATUS_OK, 'mine', i + 1))
            metres, degrees, deviations = pose_errors(found.pose, position=position)
            print('%.2f mm, %.3f degrees, %.1f squared deviations' % (1e3 * metres, degrees, deviations))
            self.assertLess(metres, 0.002)
            self.assertLess(degrees, 0.1)
            self.assertLess(deviations, CHI_SQUARE)

    def test_counts_no_detection_that_is_rejected(self):
        self.write_bag()
        twin = np.hstack([POSTER[:, :130], texture(300, 270, seed=12)])  # a third of it is that of the poster
        cv2.imwrite(self.path('twin.png'), twin)
        self.write('targets.yaml', LIST + '- {id: twin, image: twin.png, width: 1.0}\n')
        self.run_bag(words='targets.yaml: 5 detections in 5 of 5 images, 5 of them with a pose; known targets: 3\n')
        rejected = [d for m in self.detections() for d in m.detections if d.status != MatchStatus.STATUS_OK]
        self.assertGreater(len(rejected), 0)
        self.assertEqual({d.id for d in rejected}, {'twin'})

    def test_images_without_a_target_count_and_a_loop_begins_anew(self):
        blank = np.full_like(FRAMES[0], 90)
        self.write_bag([FRAMES[0], FRAMES[1], FRAMES[0], blank], stamps=(1000.0, 1000.1, 900.0, 900.1))
        self.run_bag(words='3 detections in 3 of 4 images, 3 of them with a pose')
        self.assertEqual([[d.age for d in m.detections] for m in self.detections()], [[1], [2], [1], []])

    def test_takes_the_calibration_of_the_images(self):
        self.write_bag(info=information(k=np.diag([1.2, 1.2, 1.0]) @ K, p=K))
        for kind, is_right in (('raw', False), ('rectified', True)):
            self.run_bag('--calibration', kind, '--force')
            metres = pose_errors(self.detections()[0].detections[0].pose, position=POSITIONS[0])[0]
            self.assertEqual(metres < 0.002, is_right, kind)

    def test_rectified_images_are_known_in_every_transport(self):
        def compressed(image):
            pixels = np.frombuffer(image.data, np.uint8).reshape(image.height, image.width)
            return CompressedImage(header=image.header, format='mono8; png compressed ',
                                   data=cv2.imencode('.png', pixels)[1].tobytes())

        info = information(k=np.diag([1.2, 1.2, 1.0]) @ K, p=K, distortion=(-0.3, 0.1, 0.0, 0.0, 0.0))
        for topic, convert in (('/camera/image_rect', lambda image: image),
                               ('/camera/image_rect_color/compressed', compressed)):
            with rosbag.Bag(self.path('in.bag'), 'w') as bag:
                for i, frame in enumerate(FRAMES):
                    stamp = rospy.Time.from_sec(1000 + i / 30)
                    image = image_message(frame, stamp)
                    info.header = image.header
                    bag.write('/camera/camera_info', info, stamp)
                    bag.write(topic, convert(image), stamp)
            self.run_bag('--force')
            metres = pose_errors(self.detections()[0].detections[0].pose, position=POSITIONS[0])[0]
            self.assertLess(metres, 0.002, topic)

    def test_has_the_bits_of_ktgp_find(self):
        self.write_bag()
        self.run_bag('--name', '/mine')
        cv2.imwrite(self.path('frame.png'), FRAMES[0])
        self.run_program(os.environ['KTGP_ORB_FIND'], 'frame.png', 'targets.yaml', '--json', 'found.json')
        expected, = self.json('found.json')['detections']
        found, = self.detections('/mine/detections')[0].detections
        self.assertEqual(list(found.homography), list(np.ravel(expected['homography'])))
        self.assertEqual(list(found.corners), list(np.ravel(expected['corners'])))
        self.assertEqual(list(found.corner_covariances), list(np.ravel(expected['corner_covariances'])))
        self.assertEqual((found.inliers, found.log_false_alarms),
                         (expected['inliers'], expected['log_false_alarms']))

    def test_says_why_there_is_no_pose(self):
        self.write_bag(info=None)
        self.run_bag(words=('0 of them with a pose',
                            'first reason for no pose: no camera_info on /camera/camera_info'))
        for message in self.detections():
            self.assertEqual(message.no_pose, 'no camera_info on /camera/camera_info')
            self.assertFalse(message.detections[0].has_pose)

    def test_says_that_a_target_has_no_width(self):
        self.write_bag()
        self.write('targets.yaml', '- {id: mine, image: poster.png}\n')
        self.run_bag(words='0 of them with a pose; known targets: 1; first reason for no pose: the width of mine is '
                     'not known')
        for message in self.detections():
            self.assertEqual(message.no_pose, 'the width of mine is not known')

    def test_images_in_files_have_no_calibration(self):
        for i, picture in enumerate(FRAMES):
            cv2.imwrite(self.path('frame%d.png' % i), picture)
        self.run_bag(recording='frame*.png', words=('5 detections in 5 of 5 images, 0 of them with a pose',
                                                    'first reason for no pose: no camera_info'))

    def test_a_bad_target_is_named_and_the_others_are_found(self):
        self.write_bag()
        self.write('broken.png', 'no image')
        self.write('targets.yaml', LIST + '- {image: broken.png}\n')
        self.run_bag(words=('broken.png', 'known targets: 2, refused: 1'))
        self.assertEqual([d.id for m in self.detections() for d in m.detections], len(FRAMES) * ['mine'])

    def refused(self, words, *arguments):
        self.run_bag(*arguments, code=2, words=words)
        self.assertFalse(os.path.exists(self.path('out.bag')))

    def test_refuses_with_the_reason(self):
        self.write_bag()
        self.refused('is the file of --csv and --targets', '--csv', 'targets.yaml', '--force')
        self.refused('is the input', '--csv', 'poster.png', '--force')
        self.write('targets.yaml', '- {image: missing.png}\n')
        self.refused('holds no target that can be used')
        self.write('targets.yaml', 'no list')
        self.refused('targets.yaml: is no list of targets')
        os.remove(self.path('targets.yaml'))
        self.refused('targets.yaml: is missing')
        self.write('targets.yaml', LIST)
        self.write('out.bag', 'mine')
        self.run_bag(code=2, words='--force')
        self.assertEqual(self.read('out.bag'), 'mine')
