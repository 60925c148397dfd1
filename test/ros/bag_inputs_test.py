"""ktgp_bag handles inputs like the nodelet: compressed topics, max_rate, roi, lens."""

import copy
import csv
import os
import unittest

import cv2
import numpy as np
import rosbag
import rospy
from genpy.dynamic import generate_dynamic
from geometry_msgs.msg import TransformStamped
from ktgp_orb.msg import TwoViewGeometry
from ktgp_testing import (FolderCase, corners_off, image_message, messages_of, shift, texture, view, view_of_hills,
                          view_turned, views, write_bag)
from poster import information
from sensor_msgs.msg import CompressedImage, Image, Range
from tf2_msgs.msg import TFMessage

FRAMES = 12  # of a 30 Hz camera
SIZE = 320, 240
K = np.array([[250.0, 0.0, 160.0], [0.0, 250.0, 120.0], [0.0, 0.0, 1.0]])


def compressed(image):
    message = CompressedImage(header=image.header, format='mono8; png compressed ')
    pixels = np.frombuffer(image.data, np.uint8).reshape(image.height, image.width)
    message.data = cv2.imencode('.png', pixels)[1].tobytes()
    return message


def calibration(distortion=(-0.2, 0.0, 0.0, 0.0, 0.0), size=SIZE):
    return information(K, distortion, size=size)


class BagInputsTest(FolderCase):
    def write_bag(self, pictures=views(FRAMES), topic='/front/image', **how):
        return write_bag(self.path('in.bag'), pictures, topic, **how)

    def run_bag(self, path, *arguments, **expected):
        return self.run_program(os.environ['KTGP_ORB_BAG'], '--force', path, 'out.bag', *arguments, **expected).stderr

    def output(self, topic):
        return messages_of(self.path('out.bag'), '/front/matcher/' + topic)

    def test_a_pattern_without_quotes_is_named_with_the_number_of_its_images(self):
        names = ['seq/%d.png' % i for i in range(5)]
        run = self.run_bag(names[0], *names[1:], '--csv', 'out.csv', code=2,
                           words=('expected IN and OUT.bag, but 6 names came', "in quotes ('folder/*.png')"))
        self.assertNotIn('seq/3.png', run)

    def test_a_compressed_topic_gives_the_names_of_the_nodelet(self):
        self.run_bag(self.write_bag(topic='/front/image/compressed', convert=compressed))
        with rosbag.Bag(self.path('out.bag')) as bag:
            topics = bag.get_type_and_topic_info().topics
        self.assertEqual({name.rsplit('/', 1)[0] for name in topics}, {'/front/matcher'})
        self.assertEqual([m.status for m in self.output('statistics')], [1] + (FRAMES - 1) * [0])

    def test_a_topic_is_found_with_and_without_compressed(self):
        for topic, convert, given in (('/front/image/compressed', compressed, '/front/image'),
                                      ('/front/image', lambda image: image, '/front/image/compressed')):
            path = self.write_bag(topic=topic, convert=convert)
            self.run_bag(path, '--topic', given)
            self.assertEqual(len(self.output('statistics')), FRAMES)
        self.run_bag(path, '--topic', '/front/other', code=2,
                     words="has no image on '/front/other'; its image topics: /front/image")

    def test_several_image_topics_are_listed_with_the_option_that_chooses_one(self):
        path = self.write_bag()
        with rosbag.Bag(path, 'a') as bag:
            topic, message, time = next(iter(bag.read_messages()))
            bag.write('/rear/image', message, time)
        self.run_bag(path, code=2, words='its image topics: %s, /rear/image; choose one with --topic' % topic)

    def test_a_topic_is_written_with_and_without_its_slash(self):
        """As scripts do; rosbag play publishes both with it."""
        for topic in ('front/image', '/front/image', 'front//image'):
            with rosbag.Bag(self.path('in.bag'), 'w') as bag:
                for i, picture in enumerate(views(4)):
                    stamp = rospy.Time.from_sec(1000 + i / 30)
                    for name in (topic, 'rear/image'):
                        bag.write(name, image_message(picture, stamp), stamp)
            for given in ('front/image', '/front/image'):
                with self.subTest(topic=topic, given=given):
                    self.run_bag('in.bag', '--topic', given, words='4 images of /front/image matched')
                    self.assertEqual(len(self.output('statistics')), 4)
        self.run_bag('in.bag', code=2, words='its image topics: /front/image, /rear/image')

    def test_an_image_is_known_by_the_sum_of_its_definition(self):
        """A copy of sensor_msgs/Image in another package is what nodes take for one; what is not is named."""
        copy = generate_dynamic('my_msgs/Picture', Image._full_text)['my_msgs/Picture']
        other = generate_dynamic('my_msgs/OtherImage', 'uint8[] data')['my_msgs/OtherImage']
        self.assertEqual(copy._md5sum, Image._md5sum)

        def copied(image):
            return copy(image.header, image.height, image.width, image.encoding, image.is_bigendian, image.step,
                        image.data)

        self.run_bag(self.write_bag(convert=copied), words='%d images of /front/image matched' % FRAMES)
        self.run_bag(self.write_bag(convert=lambda image: other(b'abc')), code=2, words=(
            'its image topics: none', 'of types that are not read: /front/image (my_msgs/OtherImage)'))

    def test_images_without_a_stamp_have_the_times_of_their_arrival(self):
        for convert in (lambda image: image, compressed):
            bag = self.write_bag(topic='/front/image/compressed' if convert is compressed else '/front/image',
                                 convert=convert, stamps=[0] * FRAMES)
            text = self.run_bag(bag, '--stabilize', 'v.mp4', words='%d homographies' % (FRAMES - 1))
            self.assertRegex(text, '%d images of .* have the stamp zero; the times of their arrival' % FRAMES)
            self.assertEqual(cv2.VideoCapture(self.path('v.mp4')).get(cv2.CAP_PROP_FRAME_COUNT), FRAMES)
            times = [m.header.stamp.to_sec() for m in self.output('statistics')]
            np.testing.assert_allclose(times, 1000 + np.arange(FRAMES) / 30, atol=1e-6)

    def test_images_with_spare_bytes_are_used_by_all_outputs(self):
        def wide(image):
            grey = np.frombuffer(image.data, np.uint8).reshape(SIZE[::-1])
            return image_message(np.dstack([grey] * 3), image.header.stamp, 'bgr8')

        def spare(image):
            image = wide(image)
            image.data += bytes(64)
            return image

        def without_last_padding(image):
            image = wide(image)
            rows = np.frombuffer(image.data, np.uint8).reshape(SIZE[1], -1)
            image.step += 32
            image.data = np.pad(rows, ((0, 0), (0, 32)), mode='constant').tobytes()[:-32]
            return image

        for convert in (spare, without_last_padding):
            self.run_bag(self.write_bag(convert=convert), '--mosaic', 'map.png', '--stabilize', 'v.mp4', words=(
                'matched, 0 refused', '%d homographies' % (FRAMES - 1), '%d frames, 0 of them lost' % FRAMES))

    def test_different_images_may_have_one_stamp(self):
        stamps = [1000 + i / 30 for i in (0, 1, 2, 2, 3, 4, 4, 5, 6, 7, 8, 9)]
        self.run_bag(self.write_bag(stamps=stamps), '--stabilize', 'v.mp4', '--stabilizer_lag', '3')
        self.assertEqual(cv2.VideoCapture(self.path('v.mp4')).get(cv2.CAP_PROP_FRAME_COUNT), FRAMES)

    def test_videos_have_the_rate_of_the_bag(self):
        for rate in (10.0, 60.0):
            self.run_bag(self.write_bag(rate=rate), '--stabilize', 'v.mp4', '--draw', 'd.mp4')
            for name in ('v.mp4', 'd.mp4'):
                self.assertAlmostEqual(cv2.VideoCapture(self.path(name)).get(cv2.CAP_PROP_FPS), rate, delta=0.1)
        self.run_bag(self.path('in.bag'), '--draw', 'd.mp4', '--max_rate', '10')
        self.assertAlmostEqual(cv2.VideoCapture(self.path('d.mp4')).get(cv2.CAP_PROP_FPS), 10.0, delta=0.1)

    def test_the_given_camera_holds_if_the_first_image_is_damaged(self):
        def cut(image):
            message = compressed(image)
            if image.header.stamp.nsecs == 0:
                message.data = message.data[:len(message.data) // 2]
            return message

        cv2.imwrite(self.path('target.png'), view(110, 90, 200, 150))
        with open(self.path('targets.yaml'), 'w') as file:
            file.write('- {id: target, image: target.png, width: 0.2}\n')
        self.run_bag(self.write_bag(topic='/front/image/compressed', convert=cut), '--targets', 'targets.yaml',
                     '--camera', '500,500,160,120', code=1)
        detections = [detection for message in messages_of(self.path('out.bag'), '/front/targets/detections')
                      for detection in message.detections]
        self.assertEqual(len(detections), FRAMES - 1)
        for detection in detections:  # 0.2 m are 200 px
            self.assertAlmostEqual(detection.pose.pose.position.z, 0.5, delta=0.005)

    def test_a_recorded_time_of_zero_does_not_end_the_run(self):
        class Written(rospy.Time):
            def __bool__(self):  # rosbag takes the time of day for a time that is false
                return True

        with rosbag.Bag(self.path('in.bag'), 'w') as bag:
            for i, picture in enumerate(views(FRAMES)):
                bag.write('/front/image', image_message(picture, rospy.Time.from_sec(1000 + i / 30)), Written(0, i))
        self.run_bag('in.bag', words='%d homographies' % (FRAMES - 1))

    def test_the_output_bag_is_a_file(self):
        self.run_program(os.environ['KTGP_ORB_BAG'], self.write_bag(), '-', code=2, words='expected a file for OUT.bag')

    def test_the_calibration_may_come_late(self):
        """A driver that has none at first sends zeros."""
        with rosbag.Bag(self.path('in.bag'), 'w') as bag:
            for i, picture in enumerate(views(FRAMES)):
                stamp = rospy.Time.from_sec(1000 + i / 30)
                image, info = image_message(picture, stamp), calibration()
                info.K = 9 * [0.0] if i < 3 else info.K
                info.header = image.header
                bag.write('/front/camera_info', info, stamp)
                bag.write('/front/image', image, stamp)
        self.run_bag('in.bag', '--rectify')
        self.assertEqual({m.rectified for m in self.output('homography')}, {True})

    def test_matches_are_drawn_in_images_with_brightness_and_colours_apart(self):
        def planes(image):
            image.encoding, image.data = 'nv12', image.data + bytes([128]) * (len(image.data) // 2)
            return image

        def pairs(image):
            grey = np.frombuffer(image.data, np.uint8).reshape(SIZE[::-1])
            return image_message(np.dstack([grey, np.full_like(grey, 128)]), image.header.stamp, 'yuv422_yuy2')

        for convert in (planes, pairs):
            self.run_bag(self.write_bag(convert=convert), '--draw', 'd.mp4', '--overlay',
                         words='%d homographies' % (FRAMES - 1))
            self.assertEqual(cv2.VideoCapture(self.path('d.mp4')).get(cv2.CAP_PROP_FRAME_COUNT), FRAMES)
            self.assertEqual({m.encoding for m in self.output('matches_image')}, {'bgr8'})

    def test_a_calibration_that_changes_is_named(self):
        """As of a lens that zooms; before that, the driver had none."""
        for change in (1.0, 1.2):
            with rosbag.Bag(self.path('in.bag'), 'w') as bag:
                for i, picture in enumerate(views(FRAMES)):
                    stamp = rospy.Time.from_sec(1000 + i / 30)
                    image, info = image_message(picture, stamp), calibration()
                    info.header = image.header
                    if i == 0:
                        info.K = 9 * [0.0]
                    elif i > FRAMES / 2:
                        info.K = [change * info.K[0]] + info.K[1:]
                    bag.write('/front/camera_info', info, stamp)
                    bag.write('/front/image', image, stamp)
            words = 'the camera_info on /front/camera_info changes: fx, cx, cy are 250.0, 160.0, 120.0 px at first ' \
                    'and 300.0, 160.0, 120.0 px at the end'
            self.assertEqual(words in self.run_bag('in.bag', '--rectify'), change > 1.0)
            self.assertNotIn('changes', self.run_bag('in.bag'))

    def test_half_an_image_is_refused_as_a_file_is(self):
        def cut(image):
            message = compressed(image)
            message.data = cv2.imencode('.jpg', np.frombuffer(image.data, np.uint8).reshape(SIZE[::-1]))[1].tobytes()
            if image.header.stamp.nsecs == 0:
                message.data = message.data[:len(message.data) // 2]
            return message

        self.run_bag(self.write_bag(topic='/front/image/compressed', convert=cut), code=1, words=(
            '%d images of /front/image/compressed matched, 1 refused' % (FRAMES - 1),
            'is damaged or cut off: it has no end'))

    def test_compressed_depth_is_read_or_named(self):
        def depth(image, encoding='16UC1; compressedDepth png'):
            pixels = np.frombuffer(image.data, np.uint8).reshape(SIZE[::-1]).astype(np.uint16)
            message = CompressedImage(header=image.header, format=encoding)
            message.data = 12 * b'\0' + cv2.imencode('.png', 1000 + 10 * pixels)[1].tobytes()
            return message

        self.run_bag(self.write_bag(topic='/front/image/compressedDepth', convert=depth))
        self.assertEqual([m.status for m in self.output('statistics')], [1] + (FRAMES - 1) * [0])
        self.run_bag(self.write_bag(topic='/front/image/compressedDepth',
                                    convert=lambda image: depth(image, '32FC1; compressedDepth png')),
                     code=2, words='(format "32FC1; compressedDepth png") is depth in floats')

    def test_a_picture_that_is_small_only_when_packed_is_refused(self):
        bomb = cv2.imencode('.png', np.zeros((9000, 9000), np.uint8))[1].tobytes()
        self.run_bag(self.write_bag(views(2), topic='/front/image/compressed', convert=lambda image: CompressedImage(
            header=image.header, format='mono8; png compressed ', data=bomb)), code=2,
            words='has 81.0 megapixels; expected 64 at most')

    def test_seldom_images_are_named_with_the_parameter(self):
        """A survey with an image every two seconds."""
        text = self.run_bag(self.write_bag(rate=0.5), words=(
            '%d images have no reference: they come about 2 s after the image before, and max_reference_age is 1 s'
            % (FRAMES - 1), '--max_reference_age 4'))
        self.assertIn('0 homographies', text)
        text = self.run_bag(self.path('in.bag'), '--max_reference_age', '4', words='%d homographies' % (FRAMES - 1))
        self.assertNotIn('no reference:', text)

    def test_bursts_are_named_with_the_parameter(self):
        """Two images every two seconds: only each second image has a reference."""
        self.run_bag(self.write_bag(stamps=[2 * (i // 2) + .1 * (i % 2) for i in range(FRAMES)]), words=(
            '%d images have no reference: they come about 1.9 s after the image before' % ((FRAMES - 1) // 2),
            '--max_reference_age 4'))

    def test_a_mask_that_hides_all_or_nothing_is_named(self):
        bag = self.write_bag()
        cv2.imwrite(self.path('white.png'), np.full(SIZE[::-1], 255, np.uint8))
        self.run_bag(bag, '--mask_image', 'white.png',
                     words='mask_image white.png: it hides nothing: only black (0) and transparent pixels hide')
        cv2.imwrite(self.path('black.png'), np.zeros(SIZE[::-1], np.uint8))
        self.run_bag(bag, '--mask_image', 'black.png', code=2, words='mask_image black.png: hides the whole image')
        layer = np.full(SIZE[::-1] + (4,), 255, np.uint8)
        layer[:, :SIZE[0] // 2, 3] = 0
        cv2.imwrite(self.path('layer.png'), layer)
        self.assertNotIn('hides', self.run_bag(bag, '--mask_image', 'layer.png'))
        for message in self.output('correspondences')[1:]:
            self.assertGreater(min(message.target_x), SIZE[0] // 2 - 1)

    def test_a_mask_and_a_roi_that_leave_nothing_are_named(self):
        left = np.zeros(SIZE[::-1], np.uint8)
        left[:, :SIZE[0] // 2] = 255
        cv2.imwrite(self.path('left.png'), left)
        self.run_bag(self.write_bag(), '--mask_image', 'left.png', '--roi', '200 0 100 240', code=2,
                     words='because: the masks and the roi together hide the whole image')

    def test_max_rate_skips_and_counts(self):
        self.run_bag(self.write_bag(), '--max_rate', '10')
        statistics = self.output('statistics')
        frames = [round(30 * (m.header.stamp.to_sec() - 1000)) for m in statistics]
        self.assertEqual(frames, [0, 2, 5, 8, 11])
        self.assertEqual([m.skipped_frames for m in statistics], [0, 1, 3, 5, 7])

    def test_a_roi_keeps_to_its_part(self):
        bag = self.write_bag()
        self.run_bag(bag, '--roi', '0 0 160 240')
        for message in self.output('correspondences'):
            self.assertLess(max(message.target_x), 161)
        self.run_bag(bag, '--roi', '0 0 160', code=2, words="roi is '0 0 160'; expected x y width height")

    def test_a_16_bit_mask_hides_only_black(self):
        mask = np.zeros((SIZE[1], SIZE[0]), np.uint16)
        mask[:, 100:200] = 30000
        mask[:, 200:] = 1
        cv2.imwrite(self.path('mask.png'), mask)
        self.run_bag(self.write_bag(), '--mask_image', 'mask.png')
        for message in self.output('correspondences')[1:]:
            x = np.array(message.target_x)
            self.assertGreater(x.min(), 99)
            self.assertGreater((x < 190).sum(), 20, 'seen through 30000')
            self.assertGreater((x > 210).sum(), 20, 'seen through 1')

    def test_rectify_needs_camera_info(self):
        self.run_bag(self.write_bag(), '--rectify', code=2,
                     words="no camera_info on '/front/camera_info', which rectify needs")
        self.run_bag(self.write_bag(info=calibration()), '--rectify', '--topic', '/front/image')
        self.assertEqual({m.rectified for m in self.output('homography')}, {True})
        self.assertEqual([m.reason for m in self.output('statistics')], [1] + (FRAMES - 1) * [0])

    def test_a_map_of_rectified_homographies_has_rectified_pictures(self):
        distortion = np.array([-0.35, 0.1, 0.0, 0.0, 0.0])
        grid = np.stack(np.meshgrid(*map(np.arange, SIZE)), axis=-1).reshape(-1, 1, 2).astype(float)
        places = cv2.undistortPoints(grid, K, distortion, P=K).reshape(SIZE[1], SIZE[0], 2).astype(np.float32)
        scene = cv2.GaussianBlur(texture(), (0, 0), 1.5)
        seen = [cv2.remap(scene, places + np.float32([200 + 5 * i, 200]), None, cv2.INTER_LINEAR)
                for i in range(FRAMES)]
        self.run_bag(self.write_bag(seen, info=calibration(distortion)), '--topic', '/front/image', '--rectify',
                     '--mosaic', 'map.png')
        part = cv2.imread(self.path('map.png'))[60:180, 60:260, 0].astype(int)
        self.assertLess(np.abs(part - scene[260:380, 260:460]).mean(), 3)

    def test_the_reason_for_no_camera_motion_is_reported(self):
        for info, words in ((None, "no camera_info on '/front/camera_info', which geometry auto needs"),
                            (calibration(5 * [1e9]), 'the distortion of the lens cannot be undone'),
                            (calibration(size=(2 * SIZE[0], SIZE[1])), 'the camera_info is of 640x240 images')):
            text = self.run_bag(self.write_bag(info=info), '--preset', 'slam', '--topic', '/front/image', words=words)
            self.assertEqual(text.count('no motion of the camera, only the geometry: '), 1, text)

    def test_every_map_has_its_picture(self):
        other = texture(seed=7)
        before = [view(100 + 20 * i, 100, *SIZE) for i in range(6)]
        after = [other[100:340, 100 + 20 * i:420 + 20 * i] for i in range(20)]  # 2 s, longer than the patience
        bag = self.write_bag(before + after, rate=10.0)
        self.run_bag(bag, '--mosaic', 'map.png', words='map.png to map-2.png: 2 maps, each in a file')
        first, second = (cv2.imread(self.path(name)) for name in ('map.png', 'map-2.png'))
        self.assertAlmostEqual(first.shape[1], SIZE[0] + 100, delta=15)
        self.assertLess(np.abs(first[20:200, 20:300, 0].astype(int) -
                               view(120, 120, 280, 180)).mean(), 5)
        self.assertGreater(second.shape[1], SIZE[0] + 100)
        os.remove(self.path('map.png'))
        self.run_program(os.environ['KTGP_ORB_BAG'], bag, 'new.bag', '--mosaic', 'map.png', code=2,
                         words='map-2.png: exists')

    def test_maps_of_an_earlier_run_are_refused_or_named(self):
        bag = self.write_bag()
        for name in ('map-3.png', 'map-12.png', 'map-2026.png', 'map-x.png'):
            self.write(name, 'mine')
        before = sorted(os.listdir(self.folder))
        self.run_program(os.environ['KTGP_ORB_BAG'], bag, 'out.bag', '--mosaic', 'map.png', code=2,
                         words='map-3.png: exists; expected a new name, or --force')
        self.assertEqual(sorted(os.listdir(self.folder)), before)
        text = self.run_bag(bag, '--mosaic', 'map.png', words=('map-3.png: is of an earlier run',
                                                               'map-12.png: is of an earlier run'))
        self.assertEqual(text.count('is of an earlier run'), 2)
        self.assertEqual(self.read('map-3.png'), 'mine')

    def test_a_map_of_an_earlier_run_that_is_also_read_is_never_replaced(self):
        for i, picture in enumerate(views(4)):
            cv2.imwrite(self.path('map-%d.png' % (i + 3)), picture)
        self.run_bag('map-*.png', '--mosaic', 'map.png', code=2, words='map-3.png: is the input map-3.png')

    def test_the_mosaic_of_a_camera_that_only_turns_is_a_panorama(self):
        turns = [view_turned(angle, 250.0, 1.0, *SIZE) for angle in range(-36, 37, 2)]
        bag = self.write_bag(turns)
        self.run_bag(bag, '--mosaic', 'map.png', '--camera', '250,250,159.5,119.5', words='250 px, as given')
        self.run_bag(bag, '--mosaic', 'map.png', '--camera', '300,300,159.5,119.5',
                     words='as the homographies tell, which the given camera does not fit')
        self.run_bag(bag, '--mosaic', 'map.png', '--mosaic_poses', 'poses.csv', words=(
            '37 frames, 0 of them lost', 'the camera only turns: 13', 'degrees of the turn, on a cylinder',
            'focal length 250 px, as the homographies tell'))
        self.assertAlmostEqual(cv2.imread(self.path('map.png')).shape[1], 250 * np.radians(137), delta=6)
        with open(self.path('poses.csv')) as table:
            pose = np.array(table.read().split()[-1].split(',')[3:], float).reshape(3, 3)
        turn = np.linalg.inv(K).dot(pose).dot(K)  # of the first frame, with determinant 1
        self.assertAlmostEqual(np.degrees(np.arctan2(-turn[0, 2], turn[2, 2])), 72.0, delta=0.5)

    @unittest.skipUnless('KTGP_ORB_DATA' in os.environ, 'KTGP_ORB_DATA is not set: no photographs of a turn')
    def test_frames_lost_before_the_map_became_a_panorama_are_called_so(self):
        photographs = os.path.join(os.environ['KTGP_ORB_DATA'], 'two_view', 'pano_rotation_a', '*.jpg')
        self.run_bag(photographs, '--rate', '2', '--mosaic', 'map.png', words=(
            'degrees of the turn, on a cylinder', '3 frames lost before the turn was large enough for a cylinder'))

    def test_the_mosaic_says_why_it_shows_neither_a_plane_nor_a_panorama(self):
        near = [view_turned(0.0, 250.0, 0.25 * 1.06 ** i, *SIZE) for i in range(30)]
        self.run_bag(self.write_bag(near), '--mosaic', 'map.png', '--camera', '250,250,159.5,119.5', words=(
            'turned, tilted or moved too far for one plane', 'it does not only turn: the homographies are'))

    def test_things_that_stand_still_while_the_scene_moves_are_named(self):
        """Dirt on the lens, over a fifth of the image."""
        dirt, words = texture(seed=8), 'things stand still in the image while the scene moves'
        for is_dirty in (False, True):
            pictures = [view(100 + 12 * i, 100) for i in range(FRAMES)]
            for picture in pictures if is_dirty else ():
                for spot in ((slice(120, 280), slice(80, 270)), (slice(200, 360), slice(360, 550))):
                    picture[spot] = dirt[spot]
            text = self.run_bag(self.write_bag(pictures), words='%d homographies' % (FRAMES - 1))
            self.assertEqual(text.count(words + ': '), int(is_dirty), text)
            for message in self.output('homography')[1:]:
                self.assertLess(np.abs(corners_off(message.homography, shift(-12, 0))).max(), 1.0)

    def check_dirty(self, step, spots):
        """A picture of 320x240 that moves by `step` px a frame behind two spots that cover a fifth of it."""
        dirt, pictures = texture(seed=8), [view(100 + step * i, 100, *SIZE) for i in range(FRAMES)]
        for picture in pictures:
            for y, x in spots:
                picture[y:y + 80, x:x + 95] = dirt[y:y + 80, x:x + 95]
        text = self.run_bag(self.write_bag(pictures))
        self.assertIn('%d homographies' % (FRAMES - 1), text)
        off = [np.abs(corners_off(h.homography, shift(-step, 0), SIZE)).max() for h in self.output('homography')[1:]]
        self.assertLess(np.max(off), 1.0, '%s\n%s' % (np.round(off, 2), text))

    def test_a_scene_with_three_times_the_matches_of_dirt_moves(self):
        for step in (9, 10):
            with self.subTest(step=step):
                self.check_dirty(step, ((20, 20), (130, 190)))

    def test_a_scene_that_moves_by_less_than_two_thresholds_is_not_bent_by_dirt(self):
        for spots in (((20, 20), (130, 190)), ((60, 40), (100, 180)), ((80, 40), (80, 180))):
            with self.subTest(spots=spots):
                self.check_dirty(5, spots)

    def test_growth_that_cannot_run_is_named(self):
        apart = self.write_bag([view(x, 100, *SIZE) for x in (100, 600)])
        words = 'growth has no effect with reference_mode previous'
        self.run_bag(apart, '--preset', 'photo', words=words)
        self.assertNotIn(words, self.run_bag(apart, '--preset', 'photo', '--reference_mode', 'keyframe'))
        self.assertNotIn(words, self.run_bag(apart))
        self.assertNotIn(words, self.run_bag(self.write_bag(views(2)), '--preset', 'photo'))

    def test_the_table_has_the_time_of_every_stage(self):
        always = ['extraction', 'knn', 'tf', 'gms', 'prosac', 'total']
        for arguments, ran in (((), ['align']), (('--alignment=false',), []),
                               (('--preset', 'robust', '--reference_mode', 'keyframe'), ['growth', 'guided', 'align']),
                               (('--preset', 'slam', '--camera', '250,250,159.5,119.5'), ['align', 'two_view'])):
            with self.subTest(arguments=arguments):
                self.run_bag(self.write_bag(views(3)), '--csv', 'm.csv', *arguments)
                with open(self.path('m.csv')) as table:
                    row = list(csv.DictReader(table))[-1]
                times = {name[:-3]: float(time) for name, time in row.items() if name.endswith('_ms') and time}
                self.assertLessEqual(set(always + ran), set(times))
                self.assertLessEqual(sum(times.values()) - times['total'], 1.001 * times['total'])
                if not arguments:
                    self.assertEqual(set(always + ran), set(times))

    def test_the_mosaic_says_that_the_scene_is_no_plane(self):
        words = 'map.png: the scene is no plane: points are about '
        for relief in (0.0, 0.1):
            bag = self.write_bag([view_of_hills(4.0 * i, relief, *SIZE) for i in range(41)])
            text = self.run_bag(bag, '--mosaic', 'map.png', words='41 frames, 0 of them lost')
            self.assertEqual(words in text, relief > 0.0, text)

    def test_why_every_image_was_refused_is_said_with_a_video_too(self):
        def no_encoding(image):
            image.encoding = 100000 * 'x'
            return image

        bag = self.write_bag(views(3), convert=no_encoding)
        text = self.run_bag(bag, '--stabilize', 'v.mp4', '--mosaic', 'm.png', code=2, words=(
            "3 images could not be used, the first because: encoding '%s...' is not" % (64 * 'x'),
            'v.mp4: not written, since no image could be used', 'm.png: not written'))
        self.assertLess(len(text), 2000)
        self.assertEqual([n for n in os.listdir(self.folder) if n[0] in 'vm'], [])

    def test_a_recording_that_was_cut_off_says_that_its_losses_are_not_known(self):
        bag = self.write_bag()
        self.damage(bag, 0.25)
        self.run_bag(bag, code=1,
                     words='how many images are lost is not known, since the index at the end is missing')


class BagMotionInputsTest(FolderCase):
    """A camera 2 m above the ground at 1.2 m/s; what is beside its images has strange stamps and names."""
    SPEED, HEIGHT, COUNT = 1.2, 2.0, 40  # m/s, m, images: 5 px each

    @staticmethod
    def transform(child, seconds, parent='base_link'):
        placed = TransformStamped(child_frame_id=child)
        placed.header.stamp, placed.header.frame_id = rospy.Time.from_sec(seconds), parent
        placed.transform.rotation.x, placed.transform.rotation.y = np.sqrt(0.5), -np.sqrt(0.5)  # looks down
        return placed

    def range_at(self, seconds):
        message = Range(min_range=0.1, max_range=10.0, range=self.HEIGHT)
        message.header.stamp, message.header.frame_id = rospy.Time.from_sec(seconds), 'camera'
        return message

    def record(self, beside, stamp_of=lambda seconds: seconds, images=views(COUNT), rate=30,
               topic='camera/image_raw', convert=lambda image: image, info=calibration(5 * [0.0]),
               info_topic='camera/camera_info'):
        """The images with their camera_info, and `beside`: (arrival, topic, message)."""
        messages = list(beside)
        for i, picture in enumerate(images):
            arrival = 1000 + i / rate
            image = image_message(picture, rospy.Time.from_sec(stamp_of(arrival)))
            info = copy.copy(info)
            info.header = image.header
            messages += [(arrival, info_topic, info), (arrival, topic, convert(image))]
        with rosbag.Bag(self.path('in.bag'), 'w') as bag:
            for arrival, topic, message in sorted(messages, key=lambda each: each[0]):
                bag.write(topic, message, rospy.Time.from_sec(arrival))

    def check(self, *options, least=COUNT - 2, source=('--motion_height_source', 'parameter', '--motion_height', 2.0),
              **expected):
        run = self.run_program(os.environ['KTGP_ORB_BAG'], 'in.bag', 'out.bag', '--force', '--motion', 'm.csv',
                               *source, *options, code=None, **expected)
        speeds = [float(row['vx']) ** 2 + float(row['vy']) ** 2 for row in self.table('m.csv') if row['vx']]
        self.assertGreaterEqual(len(speeds), least, run.stderr)
        np.testing.assert_allclose(np.sqrt(speeds), self.SPEED, rtol=0.05)

    def mount(self, ahead=0.0, topic='/tf', kind=TFMessage):
        return [(1000 + k / 50, topic, kind([self.transform('camera', 1000 + k / 50 + ahead)]))
                for k in range(-50, 80)]

    def test_messages_dated_ahead_delay_no_others(self):
        other = [(1000 + k / 20, '/tf', TFMessage([self.transform('another', 1000.5 + k / 20, 'map')]))
                 for k in range(-20, 40)]
        self.record(self.mount() + other)
        self.check()
        once = [(999.0, '/tf', TFMessage([self.transform('another', 4600.0, 'map')]))]
        self.record(once + self.mount())
        self.check()
        self.record(self.mount(ahead=0.5))  # all of them
        self.check()
        ranges = [(1000 + k / 20, '/camera/range', self.range_at(1000 + k / 20 + (3600 if k == 1 else 0)))
                  for k in range(-5, 40)]
        self.record(self.mount() + ranges)
        self.check(source=('--motion_height_source', 'range'))
        back = [(1000.3, '/camera/range', self.range_at(100.0))]
        self.record(self.mount() + ranges + back)
        self.check(source=('--motion_height_source', 'range'))

    def test_a_transform_of_another_time_is_named_with_max_age(self):
        """The clock of the machine that publishes the mount is 30 s behind that of the camera."""
        self.record(self.mount(ahead=-30.0))
        run = self.run_program(os.environ['KTGP_ORB_BAG'], 'in.bag', 'out.bag', '--motion', 'm.csv',
                               '--motion_height_source', 'parameter', '--motion_height', 2.0, code=None, words=(
                                   'where the camera is in base_frame is not known',
                                   'tf has camera at other times, and not within max_age, 0.100 s, after the image'))
        self.assertEqual([row['vx'] for row in self.table('m.csv') if row['vx']], [], run.stderr)

    def test_an_image_dated_ahead_is_left_out_and_named(self):
        for ahead in (0.5, 3600.0):
            self.record(self.mount(), stamp_of=lambda seconds, ahead=ahead: seconds + ahead * (
                round(30 * (seconds - 1000)) == 20))
            self.check(least=self.COUNT - 3, words=(
                '1 image could not be used because: its header.stamp, %.6f, is %.3f s ahead of its time' % (
                    1000 + 20 / 30 + ahead, ahead), '%d homographies' % (self.COUNT - 2)))
            self.assertEqual([row['status'] for row in self.table('m.csv')[2:]], (self.COUNT - 3) * ['ok'])

    def test_rectified_images_have_the_calibration_of_rectified_ones(self):
        """P says 2 m, K and the distortion say something else."""
        other = np.array([[200.0, 0.0, 150.0], [0.0, 200.0, 110.0], [0.0, 0.0, 1.0]])
        info = information(other, (-0.3, 0.1, 0.0, 0.0, 0.0), size=SIZE, p=K)
        for topic in ('camera/image_rect', 'camera/image_rect_color/compressed', 'camera/image_mono_rect',
                      'camera/rectified/image/compressed'):
            with self.subTest(topic=topic):
                packed = compressed if topic.endswith('compressed') else lambda image: image
                where = os.path.dirname(topic.replace('/compressed', '')) + '/camera_info'
                self.record(self.mount(), topic=topic, convert=packed, info=info, info_topic=where)
                self.check()
                rectified = {m.rectified for m in messages_of(self.path('out.bag'),
                                                              '/%s/matcher/homography' % os.path.dirname(where))}
                self.assertEqual(rectified, {True})
        self.record(self.mount(), topic='camera/image_raw', info=info)
        run = self.run_program(os.environ['KTGP_ORB_BAG'], 'in.bag', 'out.bag', '--force', '--motion', 'm.csv', code=None)
        self.assertIn('the images have lens distortion', run.stderr)

    def test_slam_takes_the_calibration_of_rectified_images_from_p(self):
        """The camera turns by 2 degrees a frame; P has its focal length, K and the distortion do not fit."""
        turns = [view_turned(2 * i, K[0, 0], 1.0, *SIZE) for i in range(-3, 4)]
        other = np.array([[200.0, 0.0, 150.0], [0.0, 200.0, 110.0], [0.0, 0.0, 1.0]])
        for topic, is_right in (('camera/image_rect/compressed', True), ('camera/image_color/compressed', False)):
            self.record([], images=turns, topic=topic, convert=compressed,
                        info=information(other, (-0.3, 0.1, 0.0, 0.0, 0.0), size=SIZE, p=K))
            run = self.run_program(os.environ['KTGP_ORB_BAG'], 'in.bag', 'out.bag', '--force', '--preset', 'slam')
            self.assertNotIn('no motion of the camera', run.stderr)
            found = messages_of(self.path('out.bag'), '/camera/matcher/two_view')[1:]
            angles = [np.degrees(2 * np.arccos(abs(each.pose.pose.orientation.w))) for each in found]
            self.assertEqual(len(angles), len(turns) - 1)
            if is_right:
                self.assertGreater(min(np.diag(np.reshape(each.pose.covariance, (6, 6))).min() for each in found), 0.0)
                self.assertEqual({each.geometry for each in found}, {TwoViewGeometry.GEOMETRY_ROTATION})
                np.testing.assert_allclose(angles, 2.0, atol=0.03)
            else:
                self.assertGreater(np.abs(np.array(angles) - 2.0).min(), 0.1)

    def test_a_reference_by_another_camera_gives_no_motion(self):
        """Nobody knows the K of a drawn map."""
        self.record(self.mount())
        cv2.imwrite(self.path('map.png'), texture()[50:650, 50:750])
        run = self.run_program(os.environ['KTGP_ORB_BAG'], 'in.bag', 'out.bag', '--motion', 'm.csv',
                               '--motion_height_source', 'parameter', '--motion_height', 2.0, '--reference_mode',
                               'fixed', '--reference_image', 'map.png', code=None)
        self.assertIn('from a reference of 700x600 to images of 320x240; expected a reference by the same camera',
                      run.stderr)
        self.assertEqual([row['vx'] for row in self.table('m.csv') if row['vx']], [])

    def test_images_that_come_twice_count_once(self):
        """At 60/s, as a driver sends them that publishes each image with two stamps."""
        pictures = views(self.COUNT // 2 + 1)
        for first in (0, 1):
            images = [pictures[(i + first) // 2] for i in range(self.COUNT)]
            self.record(self.mount(), images=images, rate=60)
            self.check(least=self.COUNT // 2 - 3, words='images repeat the one before, and are no new frames')

    def test_tf_has_any_of_its_names(self):
        old = generate_dynamic('tf/tfMessage', TFMessage._full_text)['tf/tfMessage']
        self.record(self.mount(topic='tf', kind=old))
        self.check()
        self.record([(1000.5, 'tf_static', TFMessage([self.transform('camera', 1000.5)]))])  # late
        self.check()

    def test_after_a_clock_was_set_back_the_readings_are_those_of_the_new_time(self):
        """The second half has the stamps of the first; the camera is at half the height there by the ranges."""
        half = self.COUNT // 2
        set_back = half / 30

        def stamp_of(arrival):
            return arrival - (set_back + 10 if arrival >= 1000 + set_back - 1e-6 else 0)
        ranges = [(1000 + k / 20, '/camera/range', self.range_at(stamp_of(1000 + k / 20))) for k in range(0, 30)]
        for arrival, _, message in ranges:
            message.range = self.HEIGHT if arrival < 1000 + set_back - 1e-6 else self.HEIGHT / 2
        self.record(ranges + [(999.9, '/tf_static', TFMessage([self.transform('camera', 990.0)]))], stamp_of)
        self.run_program(os.environ['KTGP_ORB_BAG'], 'in.bag', 'out.bag', '--motion', 'm.csv',
                         '--motion_height_source', 'range', code=None)
        speeds = [np.hypot(float(row['vx']), float(row['vy'])) if row['vx'] else np.nan for row in self.table('m.csv')]
        np.testing.assert_allclose(np.nanmedian(speeds[:half]), self.SPEED, rtol=0.05)
        np.testing.assert_allclose(np.nanmedian(speeds[half + 5:]), self.SPEED / 2, rtol=0.05)
