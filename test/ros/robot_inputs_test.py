"""Settings for the images: mask, region of interest, lens, rate, a reference from a topic; and things
that must not block the matcher."""

import os
import signal
import tempfile
import threading

import cv2
import numpy as np
import poster
import rosgraph
import rospy
from dynamic_reconfigure.msg import Config, DoubleParameter
from dynamic_reconfigure.srv import Reconfigure
from ktgp_orb.msg import MatchStatistics, MatchStatus
from ktgp_testing import (TIMEOUT, Diagnostics, MatcherCase, Memory, Recorder, check_each, corners_off, image_message,
                          no_delay, node, shift, texture, translation, view, wait_until)
from sensor_msgs.msg import CameraInfo, CompressedImage, Image
from std_msgs.msg import Header
from std_srvs.srv import Trigger

DEFAULTS = {'reference_mode': 'previous', 'reference_image': '', 'mask_image': '', 'roi': '',
            'rectify': False, 'max_rate': 0.0, 'gms_scale': False, 'max_reference_age': 1.0}
OK = MatchStatus.STATUS_OK
WIDTH, HEIGHT = 640, 480
STEP = 8  # px that the camera moves right from frame to frame
TEXT = texture(seed=2)[:HEIGHT, :400]  # burned into the left of every image
MIDDLE = 520  # px, of what the text leaves


MASK = np.zeros((HEIGHT, WIDTH), np.uint16)  # black over the text, then 30000, then 1
MASK[:, TEXT.shape[1]:MIDDLE] = 30000
MASK[:, MIDDLE:] = 1
LENS = (-0.25, 0.0, 0.0, 0.0, 0.0)
WORLD = texture()


class InputsTest(MatcherCase):
    topics = 'statistics', 'homography', 'correspondences'

    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.mask = rospy.Publisher('/camera/matcher/mask', Image, queue_size=1, latch=True)
        cls.reference = rospy.Publisher('/camera/matcher/reference', Image, queue_size=1)
        cls.info = rospy.Publisher('/camera/camera_info', CameraInfo, queue_size=5)
        for publisher in (cls.mask, cls.reference):
            wait_until(lambda publisher=publisher: publisher.get_num_connections() == 1,
                       'the matcher listens to ' + publisher.name)

    def setUp(self):
        self.client.update_configuration(DEFAULTS)
        self.call('reset')
        self.position = 100

    def move(self):
        """The camera, back to the left at the edge of the picture."""
        self.position = 100 + (self.position - 100 + STEP) % 480

    def send_view(self, text=False):
        """Sends the next view, with text that does not move on request, and returns its statistics."""
        self.move()
        pixels = view(self.position, 100, WIDTH, HEIGHT)
        if text:
            pixels[:, :TEXT.shape[1]] = TEXT
        return self.send(pixels)

    def send_until_changed(self, before, send=None):
        """Sends images until one is processed with a newer configuration."""
        send = send or self.send_view
        for _ in range(1000):
            statistics = send()
            if statistics.configuration > before:
                return statistics
        raise AssertionError('the configuration is still number %d' % before)

    def shift_of_two_views(self):
        """Sends two views with text that does not move, and returns the shift of the second one, px."""
        self.send_view(text=True)
        statistics = self.send_view(text=True)
        self.assertEqual(statistics.status, OK)
        return translation(self.homography.wait_for(statistics.header.stamp))[0]

    def check_masked(self):
        self.assertAlmostEqual(self.shift_of_two_views(), -STEP, delta=0.5)
        matches = self.correspondences.wait_for(self.camera.last_stamp())
        self.assertGreater(min(matches.target_x), TEXT.shape[1] - 1)
        self.assertGreater(min(matches.reference_x), TEXT.shape[1] - 1)
        x = np.array(matches.target_x)
        self.assertGreater((x < MIDDLE - 10).sum(), 20, 'seen through 30000')
        self.assertGreater((x > MIDDLE + 10).sum(), 20, 'seen through 1')

    def test_burned_in_text_is_a_false_plane_unless_masked(self):
        self.assertAlmostEqual(self.shift_of_two_views(), 0.0, delta=0.5,
                               msg='else the test shows nothing')
        before = self.send_view().configuration
        self.mask.publish(image_message((255 * (MASK > 0)).astype(np.uint8), rospy.Time(1)))
        self.send_until_changed(before)
        self.check_masked()
        before = self.send_view().configuration
        self.mask.publish(Image())  # no mask any more
        self.send_until_changed(before)
        self.assertAlmostEqual(self.shift_of_two_views(), 0.0, delta=0.5)
        with tempfile.NamedTemporaryFile(suffix='.png') as file:
            cv2.imwrite(file.name, MASK)
            self.client.update_configuration({'mask_image': file.name})
            self.check_masked()
        self.client.update_configuration({'mask_image': '', 'roi': '400 0 240 480'})
        self.check_masked()

    def test_a_mask_that_hides_nothing_is_named(self):
        self.addCleanup(self.mask.publish, Image())
        self.mask.publish(image_message(np.full((HEIGHT, WIDTH), 255, np.uint8), rospy.Time(1)))
        self.diagnostics.wait_for_words('hides nothing: only black (0) and transparent pixels hide')

    def test_a_mask_that_hides_all_is_refused(self):
        self.addCleanup(self.mask.publish, Image())
        self.mask.publish(image_message(np.zeros((HEIGHT, WIDTH), np.uint8), rospy.Time(1)))
        self.log.wait_for_words('the mask on /camera/matcher/mask is refused, the old one stays: it hides the whole image')

    def test_a_mask_of_another_size_is_reported(self):
        refused = self.send_view().refused_frames
        with tempfile.NamedTemporaryFile(suffix='.png') as file:
            cv2.imwrite(file.name, np.full((100, 200), 255, np.uint8))
            self.client.update_configuration({'mask_image': file.name})
            self.camera.send_view()
            self.wait_for_diagnostics('mask_image is 200x100; expected 640x480 like the image')
        self.client.update_configuration({'mask_image': ''})
        self.assertEqual(self.send_view().refused_frames, refused + 1)

    def test_bad_roi_is_refused(self):
        for roi in ('1 2 3', '0 0 -1 5', 'all'):
            answer = self.client.update_configuration({'roi': roi})
            self.assertEqual(answer['roi'], '')

    def wait_for_diagnostics(self, words):
        def said():
            return any(words in status.message or any(words in v.value for v in status.values)
                       for status in self.diagnostics.of(''))
        wait_until(said, 'diagnostics say "%s"' % words)

    def test_frames_beyond_max_rate_are_skipped_evenly_and_counted(self):
        self.client.update_configuration({'max_rate': 10.0})
        first = before = self.send_view()  # of a 30 Hz camera; the first begins the slots
        for i in range(8):
            stamps = [self.camera.show(view(100 + STEP * i, 100)) for _ in range(3)]
            # The middle one is the first of its slot of 0.1 s.
            statistics = self.statistics.wait_for(stamps[1])
            self.assertEqual(statistics.reference_stamp, before.header.stamp)
            self.assertEqual(statistics.dropped_frames, before.dropped_frames)
            # The first of each triple, and the last but perhaps of this one.
            self.assertIn(statistics.skipped_frames - first.skipped_frames, (2 * i + 1, 2 * i + 2))
            before = statistics
        sent = {m.header.stamp for m in self.statistics.messages()}
        self.assertNotIn(stamps[0], sent)
        self.client.update_configuration({'max_rate': 0.0})
        # The very last one may arrive after the change.
        self.assertIn(self.send_view().skipped_frames - first.skipped_frames, (15, 16))

    def send_distorted(self):
        """The next view through a lens, with its camera_info."""
        stamp = self.camera.next_stamp()
        self.move()
        info = poster.information(distortion=LENS)
        info.header.stamp = stamp
        self.info.publish(info)
        return self.statistics.wait_for(
            self.camera.send(image_message(distorted(self.position, 200), stamp)))

    def corner_error(self, homography):
        """Mean over the corners, px, from a shift by one step."""
        return np.linalg.norm(corners_off(homography.homography, shift(-STEP, 0)), axis=1).mean()

    def test_rectify_gives_points_without_distortion(self):
        self.position = 300
        self.send_distorted()
        raw = self.homography.wait_for(self.send_distorted().header.stamp)
        self.assertFalse(raw.rectified)
        self.client.update_configuration({'rectify': True})
        # camera_info comes with the image, before or after it: a raw frame may come first.
        for _ in range(1000):
            statistics = self.send_distorted()
            homography = self.homography.wait_for(statistics.header.stamp)
            if homography.rectified:
                break
        self.assertTrue(homography.rectified)
        self.assertEqual(no_delay(self.info), {True})
        self.assertEqual(statistics.reason, MatchStatus.REASON_LENS_CHANGED)
        for _ in range(3):
            statistics = self.send_distorted()
            self.assertEqual(statistics.status, OK)
            self.assertEqual(statistics.alignment_status, MatchStatistics.ALIGNMENT_NO_IMAGES)
            homography = self.homography.wait_for(statistics.header.stamp)
            self.assertTrue(homography.rectified)
            self.assertTrue(self.correspondences.wait_for(statistics.header.stamp).rectified)
            self.assertLess(self.corner_error(homography), 0.5)
        self.assertGreater(self.corner_error(raw), 1.0, 'else the test shows nothing')
        self.client.update_configuration({'rectify': False})
        statistics = self.send_distorted()
        self.assertEqual(statistics.reason, MatchStatus.REASON_LENS_CHANGED)
        self.assertFalse(self.homography.wait_for(statistics.header.stamp).rectified)

    def test_rectify_without_a_calibration_of_this_size_warns_and_stays_raw(self):
        self.client.update_configuration({'rectify': True})
        statistics = self.send(view(100, 100, 320, 240))
        self.assertFalse(self.homography.wait_for(statistics.header.stamp).rectified)
        self.wait_for_diagnostics('rectify is on, but points are in raw pixels: no camera_info')

    def test_rectify_says_what_is_wrong_with_a_calibration(self):
        self.client.update_configuration({'rectify': True})

        def check(name):
            info, words = poster.REFUSED[name]

            def send():
                info.header.stamp = self.camera.next_stamp()
                self.info.publish(info)
                self.move()
                stamp = self.camera.send(image_message(view(self.position, 100), info.header.stamp))
                return self.homography.wait_for(stamp).rectified
            self.diagnostics.wait_for_words(words, send)
            self.assertFalse(send())
        check_each(poster.REFUSED, check)

    def test_rectifying_twice_is_refused(self):
        answer = self.client.update_configuration({'calibration': 'rectified', 'rectify': True})
        self.addCleanup(self.client.update_configuration, {'calibration': 'by_name'})
        self.assertFalse(answer['rectify'])

    def test_a_reference_from_a_topic(self):
        self.client.update_configuration({'reference_mode': 'fixed', 'gms_scale': True})
        self.assertEqual(self.send(view(200, 150)).reason, MatchStatus.REASON_NOT_SET)
        before = self.send(view(200, 150)).configuration
        self.reference.publish(image_message(view(300, 200, 320, 240), rospy.Time(7)))
        self.send_until_changed(before, lambda: self.send(view(200, 150)))
        statistics = self.send(view(200, 150))
        self.assertEqual((statistics.status, statistics.reference_stamp), (OK, rospy.Time(7)))
        for measured, true in zip(translation(self.homography.wait_for(
                statistics.header.stamp)), (100, 50)):
            self.assertAlmostEqual(measured, true, delta=1.5)
        # One of no use is refused; the old one stays, also over a reset.
        self.reference.publish(image_message(np.zeros((9, 9), np.float32), rospy.Time(8), '32FC1'))
        self.log.wait_for_words('the reference on /camera/matcher/reference is refused')
        self.call('reset')
        self.assertEqual(self.send(view(200, 150)).reference_stamp, rospy.Time(7))
        before = self.send(view(200, 150)).configuration
        self.reference.publish(Image())  # none any more
        last = self.send_until_changed(before, lambda: self.send(view(200, 150)))
        self.assertEqual(last.reason, MatchStatus.REASON_NOT_SET)

    def test_a_reference_or_mask_of_too_many_pixels_is_refused(self):
        huge = Image(width=9000, height=8000, encoding='mono8', step=9000)
        for publisher, what in ((self.reference, 'the reference'), (self.mask, 'the mask')):
            publisher.publish(huge)
            self.log.wait_for_words('%s on %s is refused, the old one stays: it is 9000x8000 (72 megapixels); expected '
                                    '64 at most' % (what, publisher.name))
        self.mask.publish(Image())
        with tempfile.NamedTemporaryFile(suffix='.png') as file:
            cv2.imwrite(file.name, np.zeros((8000, 9000), np.uint8))
            self.client.update_configuration({'reference_image': file.name})
            self.wait_for_diagnostics('9000x8000 (72 megapixels); expected 64 at most')
            self.client.update_configuration({'reference_image': ''})

    def test_a_packed_image_of_too_many_pixels_is_refused_before_it_is_decoded(self):
        """81 megapixels of one grey, packed in 80 kB."""
        camera = rospy.Publisher('/packed/image_raw/compressed', CompressedImage, queue_size=5)
        answers, reports = Recorder('/packed/matcher/statistics', MatchStatistics, self), Diagnostics(self)

        def send(pixels):
            message = CompressedImage(header=Header(stamp=rospy.Time.now()), format='png')
            message.data = cv2.imencode('.png', pixels)[1].tobytes()
            camera.publish(message)
            return message.header.stamp

        def answer():
            self.move()
            return answers.wait_for(send(view(self.position, 100)))
        with node('matcher', 'matcher', '__ns:=/packed', 'image:=image_raw/compressed'):
            wait_until(lambda: camera.get_num_connections() and answers.publishers(), 'the matcher is connected')
            answer()
            self.assertEqual(answer().refused_frames, 0)
            memory = Memory('/packed/matcher')
            memory.begin()
            before = memory.held()
            huge, seen = send(np.full((9000, 9000), 77, np.uint8)), len(reports.messages())
            reports.wait_for_words('refused: compressed image (format "png") has 81.0 megapixels; expected 64 at most')
            self.assertLess(memory.most() - before, 40, 'MB; decoded, it has 81')
            self.assertEqual(answer().refused_frames, 1)
            self.assertEqual(answer().status, OK)
            self.assertIsNone(answers.with_stamp(huge))
            said = [status for status in reports.of('input', seen) if 'megapixels' in status.message]
            self.assertTrue(said[0].name.startswith('packed/matcher'), said[0].name)
        camera.unregister()

    def test_images_flow_while_a_large_reference_is_prepared(self):
        """Its features and its views take seconds; hardly an image in a row waits for them."""
        wanted = {'reference_mode': 'fixed', 'growth': True, 'views': 13}
        before = self.client.get_configuration()
        self.addCleanup(self.client.update_configuration, {name: before[name] for name in wanted})
        self.client.update_configuration(wanted)
        reports = Diagnostics(self)

        def state(since):
            values = [{v.key: v.value for v in status.values} for status in reports.of(': matcher', since)]
            return values[-1].get('views of the reference', '') if values else ''
        for number, (height, width) in enumerate(((200, 12000), (3000, 4000))):
            stamp = rospy.Time(50 + number)
            answers, sent, used = len(self.statistics.messages()), [], None
            self.reference.publish(image_message(texture(height, width, seed=number + 5), stamp))
            while used is None or state(used) != 'ready':
                self.move()
                sent.append(self.camera.show(view(self.position, 100, WIDTH, HEIGHT)))
                rospy.rostime.wallsleep(0.05)
                newest = self.statistics.messages()[-1] if self.statistics.messages() else None
                if used is None and newest is not None and newest.reference_stamp == stamp:
                    used = len(reports.messages())
                self.assertLess(len(sent), 20 * TIMEOUT)
            answered = {m.header.stamp for m in self.statistics.messages()[answers:]}
            runs = ''.join('x' if each in answered else '.' for each in sent).split('x')
            print('%dx%d: %d of %d images matched meanwhile, at most %d in a row were not'
                  % (width, height, len(answered), len(sent), max(map(len, runs))))
            self.assertLess(max(map(len, runs)), max(6, 0.2 * len(sent)))
        self.reference.publish(Image())

    def test_a_pipe_as_an_image_file_does_not_block(self):
        path = os.path.join(tempfile.mkdtemp(), 'pipe')
        os.mkfifo(path)
        answers = []
        caller = threading.Thread(target=lambda: answers.append(self.client.update_configuration(
            {'reference_image': path})), daemon=True)
        caller.start()
        self.call('reset')
        caller.join(TIMEOUT)
        self.assertFalse(caller.is_alive(), 'the pipe is waited for')
        self.assertEqual(answers[0]['reference_image'], '')
        self.wait_for_diagnostics('is not a regular file')

    def test_a_frozen_master_holds_up_neither_reset_nor_images(self):
        reset = rospy.ServiceProxy('/camera/matcher/reset', Trigger, persistent=True)
        change = rospy.ServiceProxy('/camera/matcher/set_parameters', Reconfigure, persistent=True)
        reset()
        change(Config())
        self.send_view()
        master = rosgraph.Master('/robot_inputs_test').getPid()
        os.kill(master, signal.SIGSTOP)
        try:
            # Writes every parameter to the master, which does not answer.
            config = Config(doubles=[DoubleParameter('max_reference_age', 2.0)])
            caller = threading.Thread(target=change, args=(config,), daemon=True)
            caller.start()
            for _ in range(30):  # over several periods of the diagnostics, which do wait
                self.assertTrue(reset().success)
                self.assertEqual(self.send_view().reason, MatchStatus.REASON_RESET)
                rospy.rostime.wallsleep(0.1)
            self.assertTrue(caller.is_alive(), 'else the test shows nothing')
        finally:
            os.kill(master, signal.SIGCONT)
        caller.join(TIMEOUT)
        self.assertFalse(caller.is_alive())


IDEAL = poster.K[:2, :2] @ poster.rays_of(poster.K, LENS, 'plumb_bob', (WIDTH, HEIGHT)).T + poster.K[:2, 2:]


def distorted(x, y):
    """The view of a camera moved by x, y through its lens."""
    columns, rows = ((ideal + start).reshape(HEIGHT, WIDTH).astype(np.float32)
                     for ideal, start in zip(IDEAL, (x, y)))
    return cv2.remap(WORLD, columns, rows, cv2.INTER_LINEAR)
