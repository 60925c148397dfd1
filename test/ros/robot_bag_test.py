"""ktgp_bag: its output equals the nodelet's; damaged bags and Ctrl-C lose no intact data."""

import glob
import io
import os
import pty
import shutil
import signal
import subprocess
import time

import cv2
import rosbag
import rospy
from ktgp_orb.msg import Correspondences, HomographyStamped, MatchStatistics
from ktgp_testing import FolderCase, Recorder, images_of, messages_of, wait_until, write_bag
from sensor_msgs.msg import Image

TOPICS = {'correspondences': Correspondences, 'homography': HomographyStamped,
          'accumulated_homography': HomographyStamped, 'statistics': MatchStatistics,
          'matches_image': Image}
MODES = ('previous', 'keyframe', 'fixed')
IMAGES = '/camera/image_raw'
FRAMES = 60  # of the video


def without_times(message, panel=0):
    """The bytes of a message, its measured times and its publisher's counter set to zero. panel: the first row of
    an image's panel."""
    message.header.seq = 0
    if hasattr(message, 'latency_milliseconds'):
        message.latency_milliseconds = 0
        message.extraction_milliseconds = 0
        message.total_milliseconds = 0
        for stage in message.stages:
            stage.milliseconds = 0
    if hasattr(message, 'encoding'):
        rows = [message.data[i * message.step:(i + 1) * message.step]
                for i in range(message.height)]
        # The panel shows measured times, and is as wide as they are long.
        del rows[panel:panel + max(90, message.height * 7 // 25 + 2)]
        message.data = b''.join(rows)
    if getattr(message, 'track', None):
        # The nodelet's numbers go on across its restarts.
        least = min(message.track)
        message.track = [number - least for number in message.track]
    buffer = io.BytesIO()
    message.serialize(buffer)
    return buffer.getvalue()


class BagTest(FolderCase):
    def setUp(self):
        super().setUp()
        self.data = rospy.get_param('~data')
        self.tum = os.path.join(self.data, 'bags/tum_fr2desk_raw.bag')
        self.patio = self.path('patio.bag')
        self.write_video(self.patio)

    def write_video(self, path, compression=rosbag.Compression.NONE):
        """The first frames of the video as a bag with 30 images a second."""
        video = cv2.VideoCapture(os.path.join(self.data, 'sequences/patio.mp4'))
        write_bag(path, (cv2.cvtColor(video.read()[1], cv2.COLOR_BGR2GRAY) for _ in range(FRAMES)),
                  compression=compression)

    def match(self, bag, *arguments, topic=IMAGES, **expected):
        """Runs ktgp_bag, which writes out.bag, and returns its messages."""
        run = self.run_program('rosrun', 'ktgp_orb', 'ktgp_bag', '--force', bag, 'out.bag', '--topic', topic,
                               *arguments, **expected)
        return run.stdout + run.stderr

    def output(self, name='statistics'):
        return messages_of(self.path('out.bag'), '/camera/matcher/' + name)

    # The nodelet's output

    def run_nodelet(self, mode, images, reference_image):
        """Messages of all topics of a nodelet that gets the images one at a time."""
        nodelet = subprocess.Popen(
            ['roslaunch', 'ktgp_orb', 'matcher.launch', 'manager:=/manager', 'namespace:=' + mode,
             'image:=' + IMAGES,
             "set:={reference_mode: %s, reference_image: '%s'}" % (mode, reference_image)])
        recorders = {name: Recorder('/%s/matcher/%s' % (mode, name), kind)
                     for name, kind in TOPICS.items()}
        camera = rospy.Publisher(IMAGES, Image, queue_size=5)
        try:
            wait_until(lambda: camera.get_num_connections() == 1, 'the matcher subscribes')
            for recorder in recorders.values():
                wait_until(lambda r=recorder: r.publishers() == 1, recorder.topic + ' is there')
            for number, image in enumerate(images):
                camera.publish(image)
                recorders['statistics'].wait_for(image.header.stamp)
                recorders['matches_image'].wait_for(image.header.stamp)
        finally:
            nodelet.terminate()
            nodelet.wait()
        wait_until(lambda: camera.get_num_connections() == 0, 'the matcher is gone')
        camera.unregister()
        result = {name: recorder.messages() for name, recorder in recorders.items()}
        for recorder in recorders.values():
            recorder.close()
        return result

    def check_equal(self, mode, bag, images, reference_image=''):
        expected = self.run_nodelet(mode, images, reference_image)
        reference = ['--reference_image', reference_image] if reference_image else []
        self.match(bag, '--reference_mode', mode, '--overlay', '--threads', '3', *reference)
        self.assertEqual(len(expected['statistics']), len(images))
        panel = len(cv2.imread(reference_image)) if reference_image else 0  # below a smaller reference
        for name in TOPICS:
            got = self.output(name)
            self.assertEqual(len(got), len(expected[name]), '%s, %s' % (mode, name))
            for a, b in zip(got, expected[name]):
                self.assertEqual(without_times(a, panel), without_times(b, panel),
                                 '%s, %s at %s' % (mode, name, a.header.stamp))

    def test_the_output_equals_the_nodelets_on_a_video(self):
        images = messages_of(self.patio, IMAGES)
        target = self.path('target.png')
        pixels = cv2.VideoCapture(os.path.join(self.data, 'sequences/patio.mp4')).read()[1]
        cv2.imwrite(target, pixels[100:400, 150:500])
        for mode in MODES:
            self.check_equal(mode, self.patio, images, target if mode == 'fixed' else '')

    def test_the_output_equals_the_nodelets_on_a_colour_bag(self):
        self.check_equal('previous', self.tum, messages_of(self.tum, IMAGES))

    # Other bags

    def test_threads_change_nothing(self):
        def messages(threads):
            self.match(self.patio, '--threads', threads)
            return {topic: [without_times(m) for m in self.output(topic)]
                    for topic in ('correspondences', 'homography', 'accumulated_homography', 'statistics')}
        expected = messages(1)
        self.assertEqual(messages(2), expected)
        self.assertEqual(messages(7), expected)

    def test_the_messages_keep_their_times_and_the_table_has_a_line_for_each(self):
        def times(path, topic):
            with rosbag.Bag(path) as bag:
                return [(m.header.stamp, t) for _, m, t in bag.read_messages(topic)]
        self.match(self.tum, '--csv', 'out.csv')
        self.assertEqual(times(self.path('out.bag'), '/camera/matcher/statistics'), times(self.tum, IMAGES))
        lines, statistics = self.table(), self.output()
        self.assertEqual(len(lines), len(statistics))
        for line, message in zip(lines, statistics):
            self.assertNotIn(None, line)
            self.assertEqual(line['stamp'], '%d.%09d' % (message.header.stamp.secs,
                                                         message.header.stamp.nsecs))
            self.assertEqual(int(line['target_features']), message.target_features)
            self.assertEqual(line['found_by'], ('none', 'prosac', 'growth')[message.found_by])
            self.assertEqual(line['descriptor'], message.descriptor)
            self.assertEqual(message.descriptor, 'orb')
            self.assertEqual([int(line[s.name]) for s in message.stages[:4]],
                             [s.output for s in message.stages[:4]])

    def test_every_image_topic_of_real_recordings(self):
        for path in sorted(glob.glob(os.path.join(self.data, 'bags/*.bag'))):
            with rosbag.Bag(path) as bag:
                topics = {name: info for name, info in bag.get_type_and_topic_info()[1].items()
                          if info.msg_type in ('sensor_msgs/Image', 'sensor_msgs/CompressedImage')}
            for topic, info in topics.items():
                self.match(path, '--csv', 'out.csv', topic=topic,
                           words='%s %s' % (images_of(info.message_count), topic))
                self.assertEqual(len(self.table()), info.message_count)

    # Damage

    def check_damaged(self, bag, words, least, most):
        """Only the intact frames are matched, and exactly as in the intact bag."""
        self.match(self.patio)
        expected = self.output()
        self.match(bag, code=1, words=(words, 'rosbag reindex'))
        got = self.output()
        self.assertTrue(least <= len(got) <= most, '%d of %d frames' % (len(got), FRAMES))
        for a, b in zip(got, expected):
            self.assertEqual(without_times(a), without_times(b))

    def test_a_bag_cut_off_keeps_the_frames_before(self):
        for share in (0.1, 0.55, 0.9):
            shutil.copy(self.patio, self.path('cut.bag'))
            self.damage('cut.bag', share)
            self.check_damaged('cut.bag', 'damaged or cut off at byte', int(share * FRAMES) - 2,
                               int(share * FRAMES) + 1)

    def test_a_compressed_bag_cut_off_keeps_the_whole_chunks_before(self):
        for compression in (rosbag.Compression.BZ2, rosbag.Compression.LZ4):
            bag = self.path('compressed.bag')
            self.write_video(bag, compression)
            self.damage(bag, 0.6)
            self.check_damaged(bag, 'damaged or cut off at byte', 0.5 * FRAMES, 0.65 * FRAMES)

    def test_a_bag_without_index_is_read_to_its_end(self):
        content = bytearray((self.folder / 'patio.bag').read_bytes())
        start = content.find(b'index_pos=') + len(b'index_pos=')
        content[start:start + 8] = bytes(8)
        (self.folder / 'unindexed.bag').write_bytes(content)
        self.check_damaged('unindexed.bag', 'no index', FRAMES, FRAMES)

    def test_files_without_bag_or_topic_are_named(self):
        cases = ((self.tum, '/no/such/topic', 'its image topics: /camera/image_raw'),
                 (__file__, '/camera/image_raw', 'is not a bag, so there is no topic to choose'),
                 ('/no/such.bag', '/camera/image_raw', 'is missing'))
        for bag, topic, words in cases:
            self.match(bag, topic=topic, code=2, words=words)

    def test_a_parameter_out_of_range_is_refused(self):
        self.match(self.tum, '--T_w', '1.5', code=2, words='T_w')

    # Terminal

    def test_ctrl_c_leaves_a_valid_bag(self):
        program = self.run_program('catkin_find', '--first-only', '--libexec', 'ktgp_orb', 'ktgp_bag').stdout.strip()
        terminal, other_end = pty.openpty()
        process = self.start(program, self.patio, 'out.bag', '--topic', IMAGES, '--threads', '1', '--gms_rotation',
                             'true', stdout=other_end, stderr=other_end)
        os.close(other_end)
        shown = b''
        while b'] 10/' not in shown:
            shown += os.read(terminal, 1000)
        process.send_signal(signal.SIGINT)
        end = time.time() + 30
        while process.poll() is None and time.time() < end:
            try:
                shown += os.read(terminal, 1000)
            except OSError:  # the other end is closed
                break
        self.assertEqual(process.wait(), 130)
        self.assertIn(b'interrupted', shown)
        statistics = self.output()  # rosbag refuses a bag without an index
        self.assertTrue(10 <= len(statistics) < FRAMES, len(statistics))

    def test_no_progress_bar_without_a_terminal(self):
        said = self.match(self.tum)
        self.assertNotIn('\r', said)
        self.assertNotIn('#', said)
