"""multi_camera.launch: each camera of the list has its own matcher, which gets only its images.
All cameras send at the same time, each with its own picture and motion."""

import unittest

import numpy as np
import rospy
from ktgp_orb.msg import Match, MatchStatus
from ktgp_testing import Camera, Recorder, image_message, mapped, texture, wait_until

FRAMES = 6
WIDTH, HEIGHT = 320, 240


class OwnCamera:
    """A camera with its own picture and its own direction of motion."""

    def __init__(self, name, number):
        self.name = name
        self.number = number
        self.picture = texture(HEIGHT + 200, WIDTH + 200, seed=10 + number)
        self.step = 3 + number, 9 - 2 * number  # px right and down from frame to frame
        self.matches = Recorder('/%s/matcher/match' % name, Match)
        self.camera = Camera('/%s/image_raw' % name)

    def stamp(self, frame):
        return rospy.Time(100 * (self.number + 1), 100000000 * frame)

    def send(self, frame):
        x, y = (100 + step * (frame - FRAMES // 2) for step in self.step)
        pixels = np.ascontiguousarray(self.picture[y:y + HEIGHT, x:x + WIDTH])
        self.camera.send(image_message(pixels, self.stamp(frame), frame_id=self.name))


class CamerasTest(unittest.TestCase):
    def test_each_camera_is_matched_to_its_own_motion_while_all_send(self):
        names = rospy.get_param('~cameras').split()
        cameras = [OwnCamera(name, i) for i, name in enumerate(names)]
        for camera in cameras:
            camera.camera.wait_for_subscriber()
            wait_until(lambda camera=camera: camera.matches.publishers() == 1, 'it is connected')
        for frame in range(FRAMES):
            for camera in cameras:
                camera.send(frame)
            for camera in cameras:  # only now: all of them were at work together
                camera.matches.wait_for(camera.stamp(frame))
        for camera in cameras:
            self.check(camera)

    def check(self, camera):
        matches = camera.matches.messages()
        self.assertEqual([m.header.stamp for m in matches],
                         [camera.stamp(frame) for frame in range(FRAMES)], camera.name)
        self.assertEqual({m.header.frame_id for m in matches}, {camera.name})
        self.assertEqual([m.statistics.status for m in matches],
                         [MatchStatus.STATUS_NO_REFERENCE] + (FRAMES - 1) * [0], camera.name)
        for frame, match in enumerate(matches[1:], 1):
            self.assertEqual(match.homography.reference_stamp, camera.stamp(frame - 1))
            middle = np.array([WIDTH / 2, HEIGHT / 2])
            np.testing.assert_allclose(mapped(match.homography.homography, [middle])[0], middle - camera.step,
                                       rtol=0, atol=0.3, err_msg=camera.name)
