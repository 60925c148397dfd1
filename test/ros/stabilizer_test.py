"""The stabilizer with a camera of known shake."""

import unittest

import cv2
import numpy as np
import rospy
from dynamic_reconfigure.client import Client
from ktgp_orb.msg import HomographyStamped, MatchStatus
from ktgp_testing import TIMEOUT, Camera, Diagnostics, Recorder, view, wait_until, warm_up
from sensor_msgs.msg import Image
from std_msgs.msg import Header

FRAMES = 70


def pixels(message):
    channels = 3 if message.encoding == 'rgb8' else 1
    return np.frombuffer(message.data, np.uint8).reshape(message.height, message.width, channels)


def motions(pictures):
    """Shift from each picture to the next, px."""
    grey = [np.float32(picture[40:-40, 40:-40, 0]) for picture in pictures]
    window = cv2.createHanningWindow(grey[0].shape[::-1], cv2.CV_32F)
    return np.array([cv2.phaseCorrelate(a, b, window)[0] for a, b in zip(grey, grey[1:])])


def shake(shifts):
    return np.mean(np.sum(np.diff(shifts, axis=0) ** 2, axis=1))


class StabilizerTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.camera = Camera()

    def setUp(self):
        self.images = Recorder('/camera/stabilizer/image', Image, self)
        self.warps = Recorder('/camera/stabilizer/warp', HomographyStamped, self)
        self.diagnostics = Diagnostics(self)
        wait_until(lambda: self.images.publishers() and self.warps.publishers(), 'it runs')
        warm_up(self.camera, self.images)
        # A connection that counts may be that of the test before, on its way out.
        warm_up(self.camera, self.warps)

    def send(self, picture, encoding='mono8'):
        """Sends an image and returns the steady image."""
        return self.images.wait_for(self.camera.show(picture, encoding))

    def test_shake_goes_and_the_picture_stays(self):
        random = np.random.RandomState(1)
        jitter = np.rint(random.normal(0.0, 3.0, (FRAMES, 2))).astype(int)
        positions = [(200 + 4 * i + jitter[i][0], 200 + 2 * i + jitter[i][1])
                     for i in range(FRAMES)]
        given, steady = [], []
        for x, y in positions:
            given.append(view(x, y)[:, :, np.newaxis])
            steady.append(pixels(self.send(view(x, y))))
        skip = 40  # frames, 1.3 s: the jump from the picture before is forgotten
        before, after = motions(given[skip:]), motions(steady[skip:])
        zoom = 1.25
        self.assertGreater(shake(before), 20.0)
        self.assertLess(shake(after) / zoom ** 2, 0.15 * shake(before))
        # The camera's own motion is still there, zoomed.
        np.testing.assert_allclose(after.mean(0), zoom * np.array([-4.0, -2.0]), atol=1.5)
        # And it shows the scene: sharp, not black.
        self.assertGreater(steady[-1].std(), 0.6 * given[-1].std())

    def test_header_and_encoding_are_the_inputs(self):
        picture = np.dstack([view(300, 300)] * 3)
        message = self.send(picture, 'rgb8')
        self.assertEqual(message.encoding, 'rgb8')
        self.assertEqual((message.width, message.height, message.step), (640, 480, 1920))
        self.assertEqual(message.header.frame_id, 'camera')

    def counts(self):
        """Homographies that the stabilizer counted, and how many of these were found."""
        # While it waits for its first images it has nothing to count.
        return [(int(v['homographies']), int(v['homographies found']))
                for v in self.diagnostics.values('stabilizer: frames') if 'homographies' in v]

    def test_homographies_are_counted_by_whether_they_were_found(self):
        for grey in (90, 100, 110):  # the same picture again would be no new frame
            self.send(np.full((480, 640), grey, np.uint8))
        wait_until(self.counts, 'the stabilizer reports')
        before = self.counts()[-1][1]
        for i in range(20):
            self.send(view(300 + 4 * i, 300))
        # The first is matched to the flat image.
        wait_until(lambda: self.counts()[-1][1] >= before + 19, '19 homographies are found')
        had, found = self.counts()[-1]
        self.assertGreaterEqual(had - found, 3)

    def test_the_warp_leads_from_the_image_to_the_steady_one(self):
        for i in range(5):
            given = view(300 + 6 * i, 300 + (-1) ** i)
            steady = self.send(given)
        warp = self.warps.wait_for(steady.header.stamp)
        self.assertEqual(warp.status, MatchStatus.STATUS_OK)
        self.assertEqual(warp.reference_stamp, steady.header.stamp)
        self.assertFalse(warp.rectified)
        h = np.reshape(warp.homography, (3, 3))
        again = cv2.warpPerspective(given, h, (640, 480), borderMode=cv2.BORDER_REPLICATE)
        difference = np.abs(again.astype(int) - pixels(steady)[:, :, 0])
        self.assertLess(difference.mean(), 1.0)
        self.assertGreater(np.abs(h - np.eye(3)).max(), 1.0, 'else it shows nothing')

    def test_an_image_without_pixels_is_counted_and_breaks_no_path(self):
        def refused():
            return int(self.diagnostics.values('stabilizer: input')[-1].get('refused', 0))

        for i in range(5):
            self.send(view(300 + 4 * i, 300))
        wait_until(self.counts, 'the stabilizer reports')
        restarts, before = self.diagnostics.values('stabilizer: frames')[-1]['restarts'], refused()
        self.camera.send(Image(header=Header(stamp=self.camera.next_stamp()), encoding='mono8'))
        self.send(view(324, 300))
        wait_until(lambda: refused() > before, 'the image without pixels is counted')
        self.assertEqual(self.diagnostics.values('stabilizer: frames')[-1]['restarts'], restarts)

    def test_no_camera_info_that_is_not_that_of_the_image(self):
        names = {name for name, _ in rospy.get_published_topics('/camera/stabilizer')}
        self.assertIn('/camera/stabilizer/image', names)
        self.assertNotIn('/camera/stabilizer/camera_info', names)

    def test_waits_for_as_many_later_frames_as_asked(self):
        client = Client('/camera/stabilizer', timeout=TIMEOUT)
        homographies = Recorder('/camera/matcher/homography', HomographyStamped, self)
        wait_until(homographies.publishers, 'the homography is connected')
        self.addCleanup(client.update_configuration, {'lag': 0})
        client.update_configuration({'lag': 3})
        wait_until(self.counts, 'the stabilizer reports')
        before = self.counts()[-1][0]
        stamps = []
        for i in range(8):
            stamps.append(self.camera.show(view(300 + 4 * i, 300)))
            homographies.wait_for(stamps[-1])
        self.images.wait_for(stamps[4])
        wait_until(lambda: self.counts()[-1][0] >= before + 8, 'all homographies are in')
        self.assertEqual(max(image.header.stamp for image in self.images.messages()), stamps[4])

    def test_goes_on_after_frames_without_homography(self):
        self.send(view(300, 300))
        self.send(view(304, 300))
        wait_until(self.restarts, 'the stabilizer reports')
        before = self.restarts()[-1]
        self.send(np.full((480, 640), 90, np.uint8))
        wait_until(lambda: self.restarts()[-1] > before, 'it restarts')
        self.send(view(308, 300))
        self.send(np.full((240, 320), 90, np.uint8))
        self.assertEqual(self.send(view(312, 300)).width, 640)

    def test_goes_on_after_a_homography_whose_image_never_comes(self):
        alone = rospy.Publisher('/camera/matcher/homography', HomographyStamped, queue_size=10)
        self.addCleanup(alone.unregister)
        wait_until(alone.get_num_connections, 'the homography is connected')
        self.send(view(300, 300))
        wait_until(self.counts, 'the stabilizer reports')
        before = self.counts()[-1][0]
        homography = HomographyStamped()
        homography.header.stamp = self.camera.next_stamp()
        alone.publish(homography)
        wait_until(lambda: self.counts()[-1][0] > before, 'it is counted')
        self.send(view(304, 300))

    def restarts(self):
        return [int(v['restarts']) for v in self.diagnostics.values('stabilizer: frames') if 'restarts' in v]

    def sleeps(self):
        return 'no subscriber' in self.diagnostics.of('stabilizer: frames')[-1].message

    def test_starts_anew_after_a_time_without_subscriber(self):
        # The matcher goes on, and so has a homography to the frame from before.
        Recorder('/camera/matcher/homography', HomographyStamped, self)
        self.send(view(300, 300))
        wait_until(self.restarts, 'the stabilizer reports')
        before = self.restarts()[-1]
        self.images.close()
        self.warps.close()
        wait_until(self.sleeps, 'the stabilizer sleeps')
        self.images = Recorder('/camera/stabilizer/image', Image, self)
        wait_until(self.images.publishers, 'the image is connected')
        wait_until(lambda: not self.sleeps(), 'the stabilizer is awake')
        warm_up(self.camera, self.images)
        wait_until(lambda: self.restarts()[-1] > before, 'it restarts')

    def test_nothing_is_subscribed_without_subscribers(self):
        self.images.close()
        self.warps.close()
        self.camera.wait_for_no_subscriber()
        for topic, kind in (('image', Image), ('warp', HomographyStamped)):
            alone = Recorder('/camera/stabilizer/' + topic, kind)
            self.camera.wait_for_subscriber()
            alone.close()
            self.camera.wait_for_no_subscriber()
