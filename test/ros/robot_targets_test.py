"""Flat targets in renderings of a camera: found with the right pose, added, replaced and removed by services, and
refused with the reason."""

import threading

import cv2
import numpy as np
import rospy
from ktgp_orb.msg import TargetDetections
from ktgp_testing import Memory, Recorder, image_message, texture, wait_until
from poster import CHI_SQUARE, K, POSITION, POSTER, ROTATION, TargetsCase, information, pose_errors, rendered
from sensor_msgs.msg import CameraInfo, Image
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import MarkerArray

OTHER = texture(300, 400, seed=11)


READOUT, ROWS = 0.02, 480  # s, of a rolling shutter
VELOCITY, TURN = np.array([0.3, 0.3, 0.27]), np.radians([20.0, 20.0, -10.0])  # of the poster, per s


def pose_at(seconds):
    return cv2.Rodrigues(TURN * seconds)[0] @ ROTATION, POSITION + VELOCITY * seconds


def view_at(seconds):
    """By a rolling shutter."""
    poses = [pose_at(seconds + READOUT * (row / ROWS - 0.5)) for row in range(ROWS)]
    return rendered(K, rotation=np.array([r for r, _ in poses]), position=np.array([p for _, p in poses]))


def now():
    return rospy.Time(1)


def transforms_at(stamp, transforms):
    return [t for m in transforms.messages() for t in m.transforms if t.header.stamp == stamp]


class TargetsTest(TargetsCase):
    def send(self, picture):
        return self.detections.wait_for(self.camera.show(picture))

    def send_until(self, picture, condition, what):
        answers = []

        def holds():
            answers.append(self.send(picture))
            return condition(answers[-1])
        wait_until(holds, what)
        return answers[-1]

    def test_pose_before_a_rolling_shutter_is_that_of_the_middle_row(self):
        """A camera at 0.5 m/s and 30 degrees/s, whose rows are read in 20 ms."""
        self.info.publish(information())
        self.addCleanup(self.client.update_configuration, {'readout_time': -1.0})
        self.send_until(rendered(K), lambda m: m.detections and m.detections[0].has_pose, 'the calibration is there')
        views = [0.033 * i for i in range(6)]
        pictures = [view_at(seconds) for seconds in views]
        errors = {}

        def measure(name, time, images, turn):
            self.client.update_configuration({'readout_time': time})
            poses = [self.send(image).detections[0].pose for image in images]
            errors[name] = [pose_errors(pose, *(turn @ part for part in pose_at(seconds)))
                            for pose, seconds in list(zip(poses, views))[2:]]
            print('readout_time %s: %s' % (name, errors[name]))
        for time in (0.0, -1.0, READOUT):
            measure(time, time, pictures, np.eye(3))
        # By a driver that turns the images by 180 degrees about the principal point: the last row comes first.
        turned = [np.roll(picture[::-1, ::-1], 1, (0, 1)) for picture in pictures]
        measure('turned', -READOUT, turned, np.diag([-1.0, -1.0, 1.0]))
        for name in (-1.0, READOUT, 'turned'):
            for (bent, bent_degrees, _), (metres, degrees, deviations) in zip(errors[0.0], errors[name]):
                self.assertLess(metres, 0.25 * bent)
                self.assertLess(degrees, 0.25 * bent_degrees)
                self.assertLess(deviations, 2 * CHI_SQUARE)

    def test_images_that_come_twice_have_one_answer(self):
        """By two stamps for one picture, the target would stand still or have twice its speed."""
        self.info.publish(information())
        self.addCleanup(self.client.update_configuration, {'readout_time': -1.0})
        self.client.update_configuration({'readout_time': READOUT})
        again = []
        for i in range(8):
            picture = view_at(0.066 * i)
            poster, = self.send(picture).detections
            metres, _, deviations = pose_errors(poster.pose, *pose_at(0.066 * i))
            again.append(self.camera.send(image_message(picture, self.camera.next_stamp())))
            if i > 2:
                self.assertLess(metres, 0.002)
                self.assertLess(deviations, 2 * CHI_SQUARE)
        self.send(view_at(0.55))
        self.assertFalse([stamp for stamp in again if self.detections.with_stamp(stamp)])

    def test_tf_markers_and_picture(self):
        self.info.publish(information())
        transforms = Recorder('/tf', TFMessage, self)
        markers = Recorder('/camera/targets/markers', MarkerArray, self)
        pictures = Recorder('/camera/targets/image', Image, self)
        wait_until(lambda: transforms.publishers() and markers.publishers() and pictures.publishers(),
                   'all is connected')
        picture = rendered(K)

        def everything(message):
            return (message.detections and message.detections[0].has_pose and pictures.messages()
                    and any(len(m.markers) == 3 for m in markers.messages())
                    and any(t.child_frame_id == 'poster' for m in transforms.messages()
                            for t in m.transforms))
        message = self.send_until(picture, everything, 'all outputs come')
        overlay = pictures.messages()[-1]
        self.assertEqual((overlay.encoding, overlay.width, overlay.height), ('bgr8', 640, 480))
        self.assertEqual(message.header.frame_id, 'camera')
        pose = message.detections[0].pose.pose
        wait_until(lambda: transforms_at(message.header.stamp, transforms), 'its transform comes')
        transform, = transforms_at(message.header.stamp, transforms)
        self.assertEqual((transform.header.frame_id, transform.transform.rotation), ('camera', pose.orientation))
        for axis in 'xyz':
            self.assertEqual(getattr(transform.transform.translation, axis), getattr(pose.position, axis))

    def test_tf_gets_only_frames_that_it_can_use(self):
        self.info.publish(information())
        self.succeed(self.replace, 'poster', [image_message(POSTER, now())], 1.0, '/poster')  # as poster
        two = np.hstack([rendered(K, position=(x, -0.04, 2.6))[:, columns]
                         for x, columns in ((-0.7, slice(320)), (0.7, slice(320, 640)))])
        transforms = Recorder('/tf', TFMessage, self)
        wait_until(transforms.publishers, 'tf is connected')

        def sent(picture, frame_id):
            """The detections in it, and the transforms of its time."""
            stamp = self.camera.show(picture, frame_id=frame_id)
            message = self.detections.wait_for(stamp)
            return message, [(t.header.frame_id, t.child_frame_id) for t in transforms_at(stamp, transforms)]

        def until(picture, frame_id, expected):
            answers = []

            def holds():
                answers.append(sent(picture, frame_id))
                return sorted(answers[-1][1]) == expected
            wait_until(holds, 'tf has %s of %s' % (expected, frame_id))
            return answers[-1][0]
        message = until(two, '/camera', [('camera', 'poster'), ('camera', 'poster_1')])
        self.assertEqual([d.frame for d in message.detections], ['poster', 'poster'])
        # The camera's own frame is that of instance 1.
        message = until(two, 'poster_1', [('poster_1', 'poster')])
        self.assertEqual([d.has_pose for d in message.detections], [1, 0])
        self.assertIn("the frame of instance 1 of poster, poster_1, is the camera's", message.no_pose)
        # Without a frame_id.
        self.diagnostics.wait_for_words('the images have no frame_id, so poster is not sent to tf',
                                        lambda: sent(two, ''))
        message, frames = sent(two, '')
        self.assertEqual(([d.has_pose for d in message.detections], message.no_pose, frames), ([1, 1], '', []))

    def test_says_why_there_is_no_pose(self):
        picture = rendered(K)
        self.info.publish(information(k=0 * K, p=0 * K))
        message = self.send_until(picture, lambda m: 'not calibrated' in m.no_pose, 'the reason comes')
        self.assertFalse(message.detections[0].has_pose)
        self.diagnostics.wait_for_words(
            'a target has no pose: /camera/camera_info cannot be used: the camera is not',
            lambda: self.send(picture))
        self.info.publish(information())
        self.send_until(picture, lambda m: m.detections[0].has_pose, 'the pose comes')
        # A frame for tf is of no use without a width.
        self.succeed(self.replace, 'poster', [image_message(POSTER, now())], 0.0, 'poster')
        message = self.send(picture)
        self.assertFalse(message.detections[0].has_pose)
        self.assertEqual(message.no_pose, 'the width of poster, which has the frame poster, is not known')
        self.diagnostics.wait_for_words('a target has no pose: the width of poster', lambda: self.send(picture))
        # Without a frame, too, nobody may want a pose: a reason, but no warning.
        self.succeed(self.replace, 'poster', [image_message(POSTER, now())], 0.0, '')
        message = self.send(picture)
        self.assertFalse(message.detections[0].has_pose)
        self.assertEqual(message.no_pose, 'the width of poster is not known')
        seen = len(self.diagnostics.messages())
        wait_until(lambda: self.send(picture) and self.diagnostics.of('targets', seen), 'a report comes')
        self.assertEqual([s.message for s in self.diagnostics.of('targets', seen) if 'pose' in s.message], [])

    def test_detects_in_the_image_of_a_request(self):
        request = image_message(rendered(K), rospy.Time(7))
        answer = self.succeed(self.detect, request, information())
        detection, = answer.detections.detections
        self.assertLess(pose_errors(detection.pose)[0], 0.002)
        self.assertEqual(answer.detections.header.stamp, rospy.Time(7))
        answer = self.detect(request, CameraInfo())
        self.assertFalse(answer.detections.detections[0].has_pose)
        self.assertIn('no camera_info', answer.detections.no_pose)
        answer = self.detect(Image(), CameraInfo())
        self.assertFalse(answer.success)
        self.assertTrue(answer.message)

    def test_refuses_with_the_reason(self):
        def refused(words, service, *arguments):
            answer = service(*arguments)
            self.assertFalse(answer.success)
            self.assertIn(words, answer.message)
        poster = image_message(POSTER, now())
        refused('shows the same as target "poster"', self.add, 'copy', [poster], 0.0, '')
        refused('does not exist', self.replace, 'unknown', [image_message(OTHER, now())], 0.0, '')
        refused('does not exist', self.remove, 'unknown')
        self.assertEqual(self.send(rendered(K)).known, 1)

    def test_replaces_and_removes(self):
        picture = rendered(K)
        self.assertTrue(self.send(picture).detections)
        self.succeed(self.replace, 'poster', [image_message(OTHER, now())], 0.0, '')
        self.assertFalse(self.send(picture).detections)
        self.assertTrue(self.remove('poster').success)
        self.assertEqual(self.send(picture).known, 0)

    def test_images_flow_while_services_work(self):
        """Between two requests on images of 36 megapixels. One request, of four, is all that they wait for."""
        large = image_message(np.tile(POSTER, (20, 15))[:6000, :6000], now())
        picture = rendered(K)
        self.send(picture)
        calls = []

        def requests():
            for _ in range(2):
                calls.append(self.detect(large, CameraInfo()).message)
                calls.append(self.add('large', [large], 0.0, '').message)
                self.remove('large')
        thread = threading.Thread(target=requests)
        before, stamps = len(self.detections.messages()), []
        thread.start()
        while thread.is_alive():
            stamps.append(self.camera.show(picture))
            rospy.rostime.wallsleep(0.05)
        thread.join()
        answered = {m.header.stamp for m in self.detections.messages()[before:]}
        runs = ''.join('x' if stamp in answered else '.' for stamp in stamps).split('x')
        print('%d of %d images were searched meanwhile, at most %d in a row were not'
              % (len(answered), len(stamps), max(map(len, runs))))
        self.assertEqual(len(calls), 4)
        self.assertLess(max(map(len, runs)), 0.4 * len(stamps))

    def test_requests_that_are_too_large_are_refused(self):
        huge = Image(width=9000, height=8000, encoding='mono8', step=9000)
        for answer in (self.detect(huge, CameraInfo()), self.add('huge', [huge], 0.0, '')):
            self.assertFalse(answer.success)
            self.assertIn('is 9000x8000 (72 megapixels); expected 64 at most', answer.message)
        answer = self.add('many', [Image(width=8000, height=5000)] * 2, 0.0, '')
        self.assertIn('the images of the target are 2 with 80 megapixels; expected 64 images with 64 megapixels at '
                      'most', answer.message)
        answer = self.add(300 * 'x', [image_message(OTHER, now())], 0.0, '')
        self.assertIn('the id has 300 bytes; expected at most 256', answer.message)

    def test_a_request_gives_its_memory_back(self):
        """SECURITY.md: 30 bytes for each of its pixels at most, and next to nothing stays."""
        memory = Memory('/manager')
        large = image_message(np.tile(POSTER, (20, 15))[:6000, :6000], now())
        for name, request in (('detect', lambda: self.detect(large, CameraInfo())),
                              ('add', lambda: self.add('large', [large], 0.0, ''))):
            memory.begin()
            before = memory.held()
            for _ in range(2):
                answer = request()
                self.remove('large')
            self.send(rendered(K))
            most, rest = memory.most() - before, memory.held() - before
            print('%s: %.0f MB at most, %.0f MB stay: %s' % (name, most, rest, answer.message))
            self.assertLess(most, 30 * 36)
            self.assertLess(rest, 36)

    def test_ids_do_not_forge_lines_of_the_log(self):
        wait_until(lambda: '/manager' in self.log.names_of_publishers(), 'it hears the manager')
        answer = self.remove('door\n[FATAL] battery \x1b[31mempty')
        self.assertIn('target "door\\x0a[FATAL] battery \\x1b[31mempty" does not exist', answer.message)
        self.log.wait_for_words('battery')
        for message in self.log.messages():
            self.assertNotIn('\n[FATAL]', message.msg)
            self.assertNotIn('\x1b', message.msg)

    def test_survives_images_that_change(self):
        self.assertTrue(self.send(rendered(K)).detections)
        half = cv2.resize(rendered(K), (480, 360), interpolation=cv2.INTER_AREA)
        self.assertTrue(self.send(half).detections)
        broken = image_message(half, self.camera.next_stamp())
        broken.data = broken.data[:100]
        self.diagnostics.wait_for_words('refused: data has', lambda: self.camera.send(broken))
        self.assertTrue(self.send(half).detections)

    def test_forgets_what_it_followed_when_no_subscriber_is_left(self):
        self.succeed(self.replace, 'poster', [image_message(POSTER, now())], 1.0, '')  # without a frame for tf
        self.info.publish(information())
        picture = rendered(K)
        self.send_until(picture, lambda m: m.detections and m.detections[0].age > 2 and m.detections[0].has_pose,
                        'it is followed')
        self.detections.close()
        self.info.unregister()
        cls = type(self)
        try:
            self.camera.wait_for_no_subscriber()
        finally:
            cls.detections = Recorder('/camera/targets/detections', TargetDetections)
            cls.info = rospy.Publisher('/camera/camera_info', CameraInfo, queue_size=5, latch=True)
        self.camera.wait_for_subscriber()
        message = self.send(picture)
        self.assertEqual((message.detections[0].age, message.no_pose), (1, 'no camera_info on /camera/camera_info'))
