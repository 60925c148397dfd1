"""ktgp_bag handles inputs like the nodelet: compressed topics, max_rate, roi, lens."""

import os

import cv2
import numpy as np
import rosbag
from ktgp_testing import FolderCase, messages_of, texture, view, views, write_bag
from poster import information
from sensor_msgs.msg import CompressedImage

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

    def test_a_mask_of_16_bits_hides_what_is_black_alone(self):
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

    def test_why_there_is_no_motion_of_the_camera_is_said(self):
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

    def test_why_every_image_was_refused_is_said_with_a_video_too(self):
        def no_encoding(image):
            image.encoding = 100000 * 'x'
            return image

        bag = self.write_bag(views(3), convert=no_encoding)
        text = self.run_bag(bag, '--stabilize', 'v.mp4', '--mosaic', 'm.png', code=1, words=(
            "3 images could not be used, the first because: encoding '%s...' is not" % (64 * 'x'),
            'v.mp4: not written, since no image could be used', 'm.png: not written'))
        self.assertLess(len(text), 2000)
        self.assertEqual([n for n in os.listdir(self.folder) if n[0] in 'vm'], [])

    def test_a_recording_that_was_cut_off_says_that_its_losses_are_not_known(self):
        bag = self.write_bag()
        self.damage(bag, 0.25)
        self.run_bag(bag, code=1,
                     words='how many images are lost is not known, since the index at the end is missing')
