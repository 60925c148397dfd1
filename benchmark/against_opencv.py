#!/usr/bin/python3
"""against_opencv.py [--pairs N]: the table at the top of README.md. Compares the package with the steps of OpenCV's
tutorial (ORB, BFMatcher with a ratio test, findHomography with RANSAC, at least ten inliers) and with the steps of
find_object_2d (its default parameters, not its program) on photographs of Debian's opencv-doc, or of the folder
KTGP_ORB_PHOTOS. Each photograph is warped by a drawn homography, so the truth is exact; light, blur and noise are
added. One thread. Same seed, same pairs.

Rows: the time of a pair of 640x480 px with 2000 features, with find_object_2d's steps 500; the corner error of pairs as
in a video; the pairs from another view found within 3 px; pictures of different things for which a homography is given;
and the share of corners within the 99 % ellipse of the stated covariance. The time counts the features of both images.
find_object_2d computes the features of its objects once, when it loads them."""

import argparse
import os
import time

import cv2
import ktgp_orb_core as ktgp
import numpy as np

FOLDER = os.environ.get('KTGP_ORB_PHOTOS', '/usr/share/doc/opencv-doc/examples/data')
SIZE = np.array([640, 480])
CORNERS = np.array([[0, 0], [639, 0], [639, 479], [0, 479]], float)
FEATURES = 2000


def photographs():
    """Pictures of 960x720, so that a moved camera sees more than the middle; those with detail only, and one of each
    scene: names of one scene begin alike."""
    scenes = set()
    for name in sorted(os.listdir(FOLDER)):
        image = cv2.imread(os.path.join(FOLDER, name), cv2.IMREAD_GRAYSCALE) if name[-4:] in ('.jpg', '.png') else None
        if image is None or min(image.shape) < 380:
            continue
        image = cv2.resize(image, (960, 720), interpolation=cv2.INTER_AREA)
        if name[:4] not in scenes and len(cv2.ORB_create(FEATURES).detect(image)) > 1500:
            scenes.add(name[:4])
            yield image


def mapped(homography, points):
    return cv2.perspectiveTransform(np.asarray(points, float)[None], homography)[0]


def drawn_pair(image, kind, random):
    """Reference, target and the true homography: `video`, small motions; `view`, another place, light and lens."""
    wide = kind == 'view'
    turn = np.radians(random.uniform(-40, 40) if wide else random.uniform(-3, 3))
    zoom = np.exp(random.uniform(-0.5, 0.5) if wide else random.uniform(-0.03, 0.03))
    tilt = random.uniform(-6e-4, 6e-4, 2) if wide else random.uniform(-2e-5, 2e-5, 2)
    shift = random.uniform(-60, 60, 2) if wide else random.uniform(-15, 15, 2)
    to_middle = np.array([[1, 0, -319.5], [0, 1, -239.5], [0, 0, 1]])
    cosine, sine = zoom * np.cos(turn), zoom * np.sin(turn)
    move = np.array([[cosine, -sine, shift[0]], [sine, cosine, shift[1]], [tilt[0], tilt[1], 1]])
    truth = np.linalg.inv(to_middle) @ move @ to_middle
    crop = np.array([[1, 0, -160], [0, 1, -120], [0, 0, 1.0]])
    reference = image[120:600, 160:800]
    target = cv2.warpPerspective(image, truth @ crop, tuple(SIZE.tolist()), flags=cv2.INTER_AREA).astype(float)
    if wide:
        target = cv2.GaussianBlur(target, (0, 0), random.uniform(0.3, 1.5))
        target = 255 * (target / 255) ** np.exp(random.uniform(-0.5, 0.5)) * random.uniform(0.7, 1.3)
    noise = 6 if wide else 3
    noisy = [np.clip(picture + random.normal(0, noise, picture.shape), 0, 255).astype(np.uint8)
             for picture in (reference, target)]
    return noisy[0], noisy[1], truth / truth[2, 2]


def neighbours(queries, features):
    """The nearest two features of each query."""
    if queries is None or features is None:
        return []
    return [m for m in cv2.BFMatcher(cv2.NORM_HAMMING).knnMatch(queries, features, k=2) if len(m) == 2]


def fitted(points, found):
    """The homography of RANSAC with a bound of 3 px, if at least ten matches agree with it. OpenCV's 2000 draws and
    confidence of 0.995 are find_object_2d's defaults, too."""
    if len(points) < 10:
        return None
    homography, inliers = cv2.findHomography(np.float32(points), np.float32(found), cv2.RANSAC, 3.0)
    return homography if homography is not None and inliers.sum() >= 10 else None


def by_opencv(reference, target):
    orb = cv2.ORB_create(FEATURES)
    (a, features_a), (b, features_b) = (orb.detectAndCompute(image, None) for image in (reference, target))
    good = [m for m, n in neighbours(features_a, features_b) if m.distance < 0.75 * n.distance]
    return fitted([a[m.queryIdx].pt for m in good], [b[m.trainIdx].pt for m in good]), None


def by_find_object_2d(reference, target):
    """The steps of find_object_2d, with one object, the reference, and one scene, the target. The parameters are its
    defaults with an OpenCV that lacks the non-free SURF, such as the one of Debian or Ubuntu: 500 ORB features. It
    looks up each feature of the scene among the features of the object."""
    orb = cv2.ORB_create(500, fastThreshold=10)
    (a, features_a), (b, features_b) = (orb.detectAndCompute(image, None) for image in (reference, target))
    good = [m for m, n in neighbours(features_b, features_a) if m.distance <= 0.8 * n.distance]
    homography = fitted([a[m.trainIdx].pt for m in good], [b[m.queryIdx].pt for m in good])
    return (None if homography is None or leaves_scene(homography) else homography), None


def leaves_scene(homography):
    """Whether find_object_2d rejects the homography because a corner of the object lies more than the size of the scene
    outside of it. Where y does, the program still compares x, with the height. A corner behind the camera (w <= 0)
    becomes a very large number in Qt, which fails the same comparison."""
    width, height = SIZE
    x, y, w = homography @ np.array([[0, 0, 1], [width, 0, 1], [width, height, 1], [0, height, 1]]).T
    behind, w = w <= 0, np.where(w == 0, 1, w)
    x, y = x / w, y / w
    return np.any(behind | (x < -width) | (x > 2 * width) | ((y < -height) & (x < -height)) |
                  ((y > 2 * height) & (x > 2 * height)))


def by_package(preset):
    def match(reference, target):
        # The presets have their own number of features; `ktgp` has 2000.
        found = ktgp.match(reference, target, preset=preset)
        return (found.homography, found.covariance) if str(found.status) in ('ok', 'Status.ok') else (None, None)
    return match


def within_bound(homography, covariance, truth):
    """For each corner, whether its error is within the 99 % ellipse of J C J'."""
    for corner, true in zip(CORNERS, mapped(truth, CORNERS)):
        x, y = corner
        u, v, w = homography @ (x, y, 1)
        j = np.zeros((2, 8))
        j[0, :3] = j[1, 3:6] = np.array([x, y, 1]) / w
        j[:, 6:] = -np.outer((u / w, v / w), (x, y)) / w
        error = np.array((u / w, v / w)) - true
        yield error @ np.linalg.solve(j @ covariance @ j.T, error) < 9.21


def measured(match, pairs):
    """Corner errors (infinite: nothing found), corners within the bound, and ms."""
    errors, bounds, times = [], [], []
    for reference, target, truth in pairs:
        start = time.process_time()
        homography, covariance = match(reference, target)
        times.append(1000 * (time.process_time() - start))
        errors.append(np.inf if homography is None else
                      np.mean(np.linalg.norm(mapped(homography, CORNERS) - mapped(truth, CORNERS), axis=1)))
        if covariance is not None:
            bounds += within_bound(homography, covariance, truth)
    return np.array(errors), np.array(bounds), np.array(times)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--pairs', type=int, default=200, help='of each kind')
    number = parser.parse_args().pairs
    cv2.setNumThreads(1)
    cv2.setRNGSeed(1)
    random = np.random.default_rng(1)
    images = list(photographs())
    sets = {kind: [drawn_pair(images[i % len(images)], kind, random) for i in range(number)]
            for kind in ('video', 'view')}
    others = [(drawn_pair(images[i % len(images)], 'view', random)[0],
               drawn_pair(images[(i + len(images) // 2) % len(images)], 'view', random)[1], np.eye(3))
              for i in range(number)]
    fast, thorough = by_package('ktgp'), by_package('photo')
    columns = [[measured(match, pairs) for match, pairs in zip(matches, (sets['video'], sets['view'], others))]
               for matches in ((fast, thorough, thorough), [by_opencv] * 3, [by_find_object_2d] * 3)]

    def percent(flags):
        return '%.1f %%' % (100 * np.mean(flags))

    def stated(column):
        bounds = np.concatenate((column[0][1], column[1][1]))
        return percent(bounds) if len(bounds) else 'none stated'
    rows = [('time of a pair, one thread, ms (median)', lambda c: '%.1f' % np.median(c[0][2])),
            ('frames of a video: corner error, px (median)', lambda c: '%.3f' % np.median(c[0][0])),
            ('frames of a video: corners within 0.5 px', lambda c: percent(c[0][0] < 0.5)),
            ('other view, light and blur: corners within 3 px', lambda c: percent(c[1][0] < 3)),
            ('different pictures: a homography is given', lambda c: percent(np.isfinite(c[2][0]))),
            ('true corner within the stated 99 % bound', stated)]
    print('%d photographs, %d pairs of each kind' % (len(images), number))
    print('| | ktgp_orb | ORB, BFMatcher, findHomography | steps of find_object_2d |\n|---|---:|---:|---:|')
    for name, figure in rows:
        print('| %s | %s |' % (name, ' | '.join(figure(column) for column in columns)))


if __name__ == '__main__':
    main()
