#!/usr/bin/python3
"""Matches two images, plots the inliers, and follows the camera through a video. Needs OpenCV and matplotlib."""

import argparse

import cv2
import ktgp_orb_core as ktgp
import numpy as np
from matplotlib import pyplot


def read(path):
    image = cv2.imread(path)
    if image is None:
        raise SystemExit('%s is not an image that OpenCV can read' % path)
    return image


def match(first, second):
    found = ktgp.match(first, second)
    print('%s: %s, %d inliers, found by %s' % (found.status, found.geometry, found.inlier_count, found.found_by))
    for stage in found.stages:
        print('  %(name)-8s %(input)5d -> %(output)5d  %(milliseconds)6.2f ms' % stage)
    if found.status == 'ok':
        print('homography, first to second image:\n%s' % np.array2string(found.homography, precision=6))
    return found


def plot(first, second, found, path):
    inliers = found.levels >= 3
    figure, axes = pyplot.subplots(1, 2, figsize=(12, 5))
    for axis, image, points in ((axes[0], first, found.reference_points), (axes[1], second, found.target_points)):
        axis.imshow(cv2.cvtColor(image, cv2.COLOR_BGR2RGB))
        axis.scatter(*points[inliers].T, c=np.arange(inliers.sum()), cmap='hsv', s=6)
        axis.set_axis_off()
    figure.suptitle('%d inliers, each with its colour' % inliers.sum())
    figure.savefig(path, dpi=100)


def track(path):
    """Prints where the centre of the first frame is in each frame of a video."""
    video = cv2.VideoCapture(path)
    rate = video.get(cv2.CAP_PROP_FPS) or 30.0
    # With 'keyframe', the errors of `accumulated` add up only from keyframe to keyframe, with 'previous' from frame to
    # frame.
    sequence = ktgp.Sequence(reference_mode='keyframe')
    count = 0
    while True:
        there, image = video.read()
        if not there:
            break
        found = sequence.match(image, count / rate)
        if found.accumulated is None:
            print('frame %d: %s' % (count, found.status if found.no_reference == 'none' else found.no_reference))
        else:
            height, width = image.shape[:2]
            centre = cv2.perspectiveTransform(np.array([[[width / 2, height / 2]]]), found.accumulated)[0, 0]
            print('frame %d: %.1f %.1f' % (count, *centre))
        count += 1
    if count == 0:
        raise SystemExit('%s is not a video that OpenCV can read' % path)


parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument('first')
parser.add_argument('second')
parser.add_argument('--plot', metavar='FILE', help='write a picture of the inliers')
parser.add_argument('--video', metavar='FILE', help='follow the camera through this video')
arguments = parser.parse_args()
pair = read(arguments.first), read(arguments.second)
result = match(*pair)
if arguments.plot:
    plot(*pair, result, arguments.plot)
if arguments.video:
    track(arguments.video)
