"""Renderings of a poster by cameras with every kind of calibration, the errors of its pose, and the nodelet that
finds it."""

import unittest

import cv2
import numpy as np
import rospy
from dynamic_reconfigure.client import Client
from ktgp_orb.msg import TargetDetections
from ktgp_orb.srv import DetectTargets, RemoveTarget, SetTarget
from ktgp_testing import TIMEOUT, Camera, Diagnostics, Log, Recorder, image_message, texture, wait_until
from sensor_msgs.msg import CameraInfo

WIDTH = 1.0  # m, of the poster
# How many squared deviations, by the covariance that comes with it, a pose may be off.
CHI_SQUARE = 22.46  # of six numbers, 99.9 %
POSTER = texture(300, 400, seed=3)
ROTATION = cv2.Rodrigues(np.array([0.25, -0.2, 0.1]))[0]
POSITION = np.array([0.05, -0.04, 1.3])
K = np.array([[500.0, 0, 320.0], [0, 500.0, 240.0], [0, 0, 1]])
BARREL = (-0.3, 0.1, 0.001, -0.0005, 0.0)


def rays_of(k, distortion, model, size):
    """Returns the ray of each pixel of a raw image, with z = 1."""
    x, y = np.meshgrid(np.arange(size[0], dtype=float), np.arange(size[1], dtype=float))
    points = np.stack([x.ravel(), y.ravel()], 1)[:, None]
    if model == 'equidistant':
        return cv2.fisheye.undistortPoints(points, k, np.array(distortion, float)).reshape(-1, 2)
    until = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-9)
    return cv2.undistortPointsIter(points, k, np.array(distortion, float), np.eye(3), np.eye(3),
                                   until).reshape(-1, 2)


def rendered(k, distortion=(0.0,) * 5, model='plumb_bob', size=(640, 480), rotation=ROTATION,
             position=POSITION):
    """The camera's view of the poster; each pixel is the mean of nine points. `rotation` and `position`: one, or
    an array of one for each row, as a rolling shutter sees it."""
    fine = 3
    wide = np.diag([fine, fine, 1.0]) @ k
    wide[:2, 2] += (fine - 1) / 2  # the middle of the first pixel is the middle of its nine points
    rays = rays_of(wide, distortion, model, (size[0] * fine, size[1] * fine))
    # The plane of the poster: z = 0 in its own frame.
    plane = np.linalg.inv(np.stack([rotation[..., 0], rotation[..., 1], position], axis=-1))
    if plane.ndim == 3:
        plane = np.repeat(plane, fine, axis=0)
    rays = np.column_stack([rays, np.ones(len(rays))]).reshape(size[1] * fine, size[0] * fine, 3)
    on_poster = rays @ np.swapaxes(plane, -1, -2)
    metre = POSTER.shape[1] / WIDTH
    maps = [(on_poster[..., i] / on_poster[..., 2] * metre + (POSTER.shape[1 - i] - 1) / 2).astype(np.float32)
            for i in (0, 1)]
    picture = cv2.remap(cv2.GaussianBlur(POSTER, (0, 0), 0.6), maps[0], maps[1], cv2.INTER_LINEAR,
                        borderMode=cv2.BORDER_CONSTANT, borderValue=90)
    return cv2.resize(picture, size, interpolation=cv2.INTER_AREA)


def information(k=K, distortion=(0.0,) * 5, model='plumb_bob', size=(640, 480), p=None, r=None,
                binning=0, roi=None):
    info = CameraInfo(width=size[0], height=size[1], distortion_model=model)
    info.D, info.K = list(distortion), k.flatten().tolist()
    info.R = (np.eye(3) if r is None else r).flatten().tolist()
    info.P = np.column_stack([k if p is None else p, np.zeros(3)]).flatten().tolist()
    info.binning_x = info.binning_y = binning
    if roi:
        info.roi.x_offset, info.roi.y_offset, info.roi.width, info.roi.height = roi
    return info


def pose_of(message):
    """Returns the rotation matrix and the position of a PoseWithCovariance."""
    p, q = message.pose.position, message.pose.orientation
    x, y, z, w = q.x, q.y, q.z, q.w
    return np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                     [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                     [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]]), np.array([p.x, p.y, p.z])


def pose_errors(message, rotation=ROTATION, position=POSITION):
    """Returns the error of a PoseWithCovariance in m, in degrees, and squared in units of its covariance."""
    found, place = pose_of(message)
    # As the covariance has it: moved, and turned about the axes of the camera.
    moved = place - position
    turned = cv2.Rodrigues(found @ rotation.T)[0].ravel()
    error = np.concatenate([moved, turned])
    covariance = np.reshape(message.covariance, (6, 6))
    return (np.linalg.norm(moved), np.degrees(np.linalg.norm(turned)),
            error @ np.linalg.solve(covariance, error))


class TargetsCase(unittest.TestCase):
    """With the camera of the live nodelet of targets, its services, what it says, and the poster as its target."""

    @classmethod
    def setUpClass(cls):
        cls.detections = Recorder('/camera/targets/detections', TargetDetections)
        cls.diagnostics, cls.log = Diagnostics(), Log()
        cls.info = rospy.Publisher('/camera/camera_info', CameraInfo, queue_size=5, latch=True)
        cls.camera = Camera()
        cls.camera.wait_for_subscriber()
        wait_until(cls.detections.publishers, 'it runs')
        cls.client = Client('/camera/targets', timeout=TIMEOUT)
        for name, kind in (('add', SetTarget), ('replace', SetTarget), ('remove', RemoveTarget),
                           ('detect', DetectTargets)):
            rospy.wait_for_service('/camera/targets/' + name, TIMEOUT)
            setattr(cls, name, rospy.ServiceProxy('/camera/targets/' + name, kind))

    def setUp(self):
        self.succeed(self.add, 'poster', [image_message(POSTER, rospy.Time(1))], WIDTH, 'poster')
        self.addCleanup(self.remove, 'poster')

    def succeed(self, service, *arguments):
        answer = service(*arguments)
        self.assertTrue(answer.success, answer.message)
        return answer


SENSOR = K + np.array([[0, 0, 300.0], [0, 0, 200.0], [0, 0, 0]])  # K of the part at 300, 200
BINNED = {'k': np.diag([2.0, 2.0, 1.0]) @ K, 'size': (1280, 960), 'binning': 2}
ROI = {'size': (1280, 960), 'roi': (300, 200, 640, 480)}
WIDE_P = np.array([[420.0, 0, 330.0], [0, 420.0, 235.0], [0, 0, 1]])
FISHEYE = (0.05, -0.01, 0.002, 0.0)
NAN = np.full((3, 3), np.nan)
# camera_info, what is said of it
REFUSED = {
    'another size': (information(size=(1280, 960)), 'of 1280x960 images'),
    'no size': (information(size=(0, 0)), 'has no image size'),
    'NaN in K': (information(k=K * NAN, p=K), 'K of the camera_info has a number that is not'),
    'NaN in R': (information(r=NAN), 'R of the camera_info has a number that is not'),
    'NaN in P': (information(p=NAN), 'P of the camera_info has a number that is not'),
    'not calibrated': (information(k=0 * K, p=0 * K), 'the camera is not calibrated'),
    'unknown model': (information(distortion=BARREL, model='mei'), "distortion_model is 'mei'"),
}
