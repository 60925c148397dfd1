"""Stabilizer and mosaic on a robot that is not ours: a homography topic of another name or type is named,
memory stays within its bound, and what is small is not held back."""

import unittest

import numpy as np
import rospy
from ktgp_orb.msg import HomographyStamped, MatchStatus
from ktgp_testing import Camera, Diagnostics, Log, Recorder, check_each, no_delay, view, wait_until
from sensor_msgs.msg import Image
from std_msgs.msg import String

KEPT = 7  # of 36 MB, in 256 MB
MANY = 16


class ConsumersTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.diagnostics = Diagnostics()
        cls.log = Log()
        # Messages before it listens are lost, and the consumers begin to wait when they have subscribers.
        wait_until(lambda: '/manager' in cls.log.names_of_publishers(), 'it hears the manager')
        cls.words = rospy.Publisher('/camera/words', String, queue_size=1)
        cls.homographies = rospy.Publisher('/large/matcher/homography', HomographyStamped,
                                           queue_size=100)
        cls.camera = Camera()
        cls.large = Camera('/large/image')
        cls.steady = [Recorder('%s/image' % name, Image) for name in (
            '/camera/stabilizer_of_a_name', '/camera/stabilizer_of_a_type', '/large/stabilizer')]
        cls.poses = [Recorder(name + '/homography', HomographyStamped) for name in (
            '/camera/mosaic_of_a_name', '/camera/mosaic_of_a_type', '/large/mosaic')]
        wait_until(lambda: all(r.publishers() for r in cls.steady + cls.poses), 'they run')
        for camera in (cls.camera, cls.large):
            camera.wait_for_subscriber()
        wait_until(lambda: cls.homographies.get_num_connections() == 1, 'the homography is connected')

    def reports(self, name):
        return self.diagnostics.of(name + ': input')

    def test_a_homography_topic_of_another_name_or_type_is_named(self):
        why = {'name': 'no node publishes /camera/nowhere: is the topic name right?',
               'type': '/camera/words is of type std_msgs/String; expected ktgp_orb/HomographyStamped'}

        def check(name):
            kind = name.rsplit('_', 1)[1]
            topic = '/camera/' + {'name': 'nowhere', 'type': 'words'}[kind]
            expected = 'no homography on %s: %s' % (topic, why[kind])

            def lasting():
                self.camera.send_view()
                reports = [r.message for r in self.reports(name)]
                if expected not in reports:
                    return False
                since = reports[reports.index(expected):]
                self.assertEqual(set(since), {expected})
                return len(since) > 11  # s; the master is asked again and again
            wait_until(lasting, 'diagnostics say for a while ' + expected)
            said = self.log.with_words('no homography on ' + topic, why[kind])
            self.assertEqual(len(said), 2, said)  # by the stabilizer, and by the mosaic
        check_each(['stabilizer_of_a_name', 'stabilizer_of_a_type', 'mosaic_of_a_name',
                    'mosaic_of_a_type'], check)
        right = rospy.Publisher('/camera/nowhere', HomographyStamped, queue_size=10)

        def works():
            right.publish(HomographyStamped(status=MatchStatus.STATUS_NO_MODEL))
            self.camera.send_view()
            return all(self.reports(name)[-1].message == 'images arrive'
                       for name in ('stabilizer_of_a_name', 'mosaic_of_a_name'))
        wait_until(works, 'nothing is said any more once they come')

    def send_small(self):
        """One colour image, 0.9 MB."""
        return self.large.show(np.dstack([view(100, 100)] * 3), 'rgb8')

    def send_large(self):
        """One colour image of 12 megapixels; not faster than it is sent."""
        stamp = self.large.show(np.zeros((3000, 4000, 3), np.uint8), 'rgb8')
        rospy.rostime.wallsleep(0.2)
        return stamp

    def counts(self, name):
        values = self.diagnostics.values(name + ': input')[-1]
        return np.array([int(values[key]) for key in ('images', 'dropped', 'dropped because of memory')])

    def test_images_that_wait_are_bounded_in_megabytes_and_counted(self):
        names = ('large/stabilizer', 'large/mosaic')
        wait_until(lambda: all(self.reports(name) for name in names), 'they report')
        before = {name: self.counts(name) for name in names}
        for _ in range(MANY):
            self.send_large()

        def check(name):
            def settled():
                images, dropped, forgotten = self.counts(name) - before[name]
                # The images that waited before are gone as well.
                return images == MANY and MANY - KEPT <= dropped + forgotten <= MANY
            wait_until(settled, 'all but %d of %d images are gone' % (KEPT, MANY))
            _, dropped, forgotten = self.counts(name) - before[name]
            print('%s: %d dropped, %d for memory' % (name, dropped, forgotten))
            self.assertGreater(forgotten, 0)
        check_each(names, check)

        def said():
            for name in names:
                stamp = self.send_large() - rospy.Duration(500.0)  # of an image that never comes
                self.homographies.publish(HomographyStamped(status=MatchStatus.STATUS_NO_MODEL))
                self.homographies.publish(self.homography(stamp, False))
            return all('dropped to save memory' in self.reports(name)[-1].message for name in names)
        wait_until(said, 'diagnostics say that memory is short')

    @staticmethod
    def homography(stamp, rectified):
        message = HomographyStamped(status=MatchStatus.STATUS_OK, rectified=rectified)
        message.header.stamp = message.reference_stamp = stamp
        message.homography = np.eye(3).flatten().tolist()
        return message

    def test_the_places_in_the_mosaic_are_of_the_pixels_of_the_homographies(self):
        for rectified in (True, False):
            stamp = self.send_small()
            self.homographies.publish(self.homography(stamp, rectified))
            self.assertEqual(self.poses[-1].wait_for(stamp).rectified, rectified)

    def test_small_messages_are_not_held_back(self):
        self.assertEqual(no_delay(self.homographies), {True})
        self.assertEqual(no_delay(self.large.publisher), {False}, 'else it shows nothing')
