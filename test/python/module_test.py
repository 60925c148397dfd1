"""The Python module ktgp_orb_core: the bits of the C++ programs, NumPy arrays in and out, bad input, threads."""

import ast
import concurrent.futures
import gc
import json
import math
import os
import pickle
import re
import signal
import subprocess
import sys
import tempfile
import threading
import time
import unittest

import cv2
import ktgp_orb_core as ktgp
import numpy as np

sys.path.append(os.path.join(os.path.dirname(os.path.dirname(os.path.abspath(__file__))), 'tools'))
from tool_case import OVER_A_PLANE, corners_off, mapped, tilted_plane, two_depths  # noqa: E402

TOOLS = os.environ['KTGP_ORB_TOOLS']
BOAT = os.path.join(os.environ.get('KTGP_ORB_DATA', ''), 'oxford/boat')
CUBE = os.path.join(os.environ.get('KTGP_ORB_DATA', ''), 'targets_real/cube')
PHOTOGRAPHS = '/usr/share/doc/opencv-doc/examples/data/'
TURN = np.array([[0.999, 0.03, 4.0], [-0.03, 0.999, 9.0], [1e-5, 0.0, 1.0]])


def picture(seed=1, shape=(480, 640)):
    noise = np.random.RandomState(seed).rand(*shape).astype(np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), 2)
    return cv2.normalize(smooth, None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)


def moved(image):
    return cv2.warpPerspective(image, TURN, image.shape[1::-1])


def by_program(reference, target, *options):
    """Returns the JSON that ktgp_match writes about two pictures."""
    with tempfile.TemporaryDirectory() as folder:
        files = [os.path.join(folder, name) for name in ('a.png', 'b.png', 'out.json')]
        cv2.imwrite(files[0], reference)
        cv2.imwrite(files[1], target)
        subprocess.run([os.path.join(TOOLS, 'ktgp_match'), *files[:2], '--json', files[2], *options], check=True,
                       stdout=subprocess.DEVNULL)
        with open(files[2]) as file:
            return json.load(file)


class ModuleTest(unittest.TestCase):
    def setUp(self):
        self.reference = picture()
        self.target = moved(self.reference)

    def same(self, first, second):
        self.assertEqual(first.status, second.status)
        for name in ('homography', 'covariance', 'levels', 'reference_points', 'target_points'):
            np.testing.assert_array_equal(getattr(first, name), getattr(second, name))

    def test_a_scene_with_depth_gives_the_motion(self):
        K = np.array([[520.0, 0, 319.5], [0, 520.0, 239.5], [0, 0, 1]])
        rotation = cv2.Rodrigues(np.array([0.005, 0.03, 0.01]))[0]
        direction = np.array([-0.9, 0.1, 0.3]) / np.linalg.norm([-0.9, 0.1, 0.3])
        target = two_depths(self.reference, K, 0.3, direction, rotation)
        found = ktgp.match(self.reference, target, preset='slam', K=K)
        self.assertEqual(found.geometry, 'epipolar')
        self.assertEqual((found.status, found.found_by, found.doubt), ('ok', 'two_view', 'none'))
        self.assertGreater(found.probability, 0.9)
        self.assertIsNone(found.other_motion)
        self.assertLess(found.log_false_alarms_epipolar, found.log_false_alarms_homography)
        self.assertEqual(found.points.shape, (len(found.point_matches), 3))
        left = found.reference_points[found.point_matches][:, 0] < 250
        self.assertAlmostEqual(np.median(0.3 * found.points[left, 2]), 2.0, delta=0.05)
        self.assertTrue((found.point_deviations > 0).all())
        self.assertTrue((found.levels[found.point_matches] == 3).all())
        self.assertIn('epipolar', repr(found))
        self.assertEqual(found.rotation.shape, (3, 3))
        self.assertLess(np.linalg.norm(cv2.Rodrigues(found.rotation @ rotation.T)[0]), 0.002)
        self.assertAlmostEqual(np.linalg.norm(found.translation), 1.0, 9)
        self.assertGreater(found.translation @ direction, 0.9995)
        self.assertEqual(found.pose_covariance.shape, (6, 6))
        self.assertTrue(np.isfinite(found.pose_covariance).all())
        self.assertGreater(found.parallax, 1.0)
        self.assertEqual((found.levels == 3).sum(), found.inlier_count)
        again = pickle.loads(pickle.dumps(found))
        np.testing.assert_array_equal(again.translation, found.translation)
        np.testing.assert_array_equal(again.points, found.points)
        self.assertEqual(again.probability, found.probability)
        self.assertEqual(again.geometry, 'epipolar')
        for number, options in ((4000, {}), (1000, {'features': 1000})):
            whole = ktgp.match(self.reference, target, preset='slam', K=K, **options)
            features = ktgp.Extractor(preset='slam', features=number)
            parts = [features.extract(image) for image in (self.reference, target)]
            by_parts = ktgp.Matcher(preset='slam').match(*parts, K=K)
            self.assertEqual(by_parts.geometry, 'epipolar')
            self.assertEqual(len(whole.levels), len(by_parts.levels))
            np.testing.assert_array_equal(whole.translation, by_parts.translation)

        blind = ktgp.match(self.reference, target, preset='slam')
        self.assertEqual(blind.geometry, 'epipolar')
        self.assertIsNone(blind.rotation)
        self.assertIsNone(blind.pose_covariance)
        self.assertAlmostEqual(np.linalg.norm(blind.fundamental), 1.0, 9)
        plane = ktgp.match(self.reference, self.target)
        self.assertEqual(plane.geometry, 'plane')
        self.assertIsNone(plane.rotation)

    @unittest.skipUnless(os.path.exists(PHOTOGRAPHS), 'needs the photographs of the package opencv-doc')
    def test_a_mirrored_photograph_has_no_motion_and_no_geometry(self):
        """Flipped either way. The mirror image of something symmetric, such as a face, looks like the same thing turned:
        its keypoints turn together, too. Only rubberwhale has such a thing, a wheel, with few of its precise pairs."""
        for name in ('home.jpg', 'fruits.jpg', 'building.jpg', 'messi5.jpg', 'leuvenA.jpg', 'graf1.png', 'aloeL.jpg',
                     'rubberwhale1.png', 'basketball1.png', 'stuff.jpg'):
            picture = cv2.imread(PHOTOGRAPHS + name, cv2.IMREAD_GRAYSCALE)
            self.assertIsNotNone(picture, name)
            scale = min(1.0, 800 / max(picture.shape))
            picture = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
            height, width = picture.shape
            K = np.array([[0.9 * width, 0, width / 2], [0, 0.9 * width, height / 2], [0, 0, 1]])
            for flip in (0, 1):
                mirrored = np.ascontiguousarray(cv2.flip(picture, flip))
                found = ktgp.match(picture, mirrored, preset='slam', K=K)
                self.assertIsNone(found.rotation, (name, flip, found.doubt))
                for preset in ('slam', 'robust'):
                    blind = ktgp.match(picture, mirrored, preset=preset)  # without K
                    self.assertNotEqual(blind.status, 'ok', (name, flip, preset))
                    self.assertEqual((blind.geometry, blind.fundamental), ('none', None), (name, flip, preset))
                    self.assertFalse(blind.homography.any(), (name, flip, preset))

    def test_a_plane_has_both_motions(self):
        K = np.array([[520.0, 0, 319.5], [0, 520.0, 239.5], [0, 0, 1]])
        direction = OVER_A_PLANE / np.linalg.norm(OVER_A_PLANE)
        for tilt in (-0.5, 0.3, 0.5):
            target = tilted_plane(self.reference, K, tilt)
            found = ktgp.match(self.reference, target, 'slam', K=K)
            self.assertEqual((found.status, found.geometry), ('ok', 'plane'))
            self.assertGreater(np.abs(found.homography).max(), 0)
            other = found.other_motion
            self.assertIsNotNone(other, tilt)
            self.assertGreater(max(found.translation @ direction, other.translation @ direction), 0.99)
            self.assertLess(found.translation @ other.translation, 0.99)
            self.assertEqual((found.doubt, other.geometry), ('two_motions_of_a_plane', 'plane'))
            self.assertLess(found.probability, 1.0)
            self.assertGreaterEqual(found.probability, 0.5, 'the likelier motion is the first')
            view = by_program(self.reference, target, '--preset', 'slam', '--camera', '520,520,319.5,239.5')['two_view']
            self.assertEqual(found.probability, view['probability'])
            self.assertAlmostEqual(found.probability + view['other_pose']['probability'], 1.0, 9)
            self.assertEqual(other.covariance.shape, (6, 6))
            self.assertGreater(np.diag(other.covariance).min(), 0.0)
            again = pickle.loads(pickle.dumps(found)).other_motion
            np.testing.assert_array_equal(again.rotation, other.rotation)

    def test_the_default_finds_what_ktgp_match_finds(self):
        tilt = np.float32([[0.25, -0.3, 240], [0.12, 0.75, 20], [0, 0, 1]])
        tilted = cv2.warpPerspective(self.reference, tilt, self.reference.shape[::-1], flags=cv2.INTER_AREA)
        found = ktgp.match(self.reference, tilted)
        self.assertEqual(found.status, 'ok')
        self.assertLess(np.abs(corners_off(found.homography, tilt)).max(), 3.0)
        self.assertEqual(found.homography.tolist(), by_program(self.reference, tilted)['homography'])

    @unittest.skipUnless(os.path.isdir(BOAT), 'KTGP_ORB_DATA is not set: this test needs its folder oxford/boat')
    def test_the_default_finds_a_boat_from_near_and_far(self):
        first, fifth = (cv2.imread(os.path.join(BOAT, name), cv2.IMREAD_GRAYSCALE) for name in ('img1.pgm', 'img5.pgm'))
        found = ktgp.match(first, fifth)
        self.assertEqual(found.status, 'ok')
        truth = np.loadtxt(os.path.join(BOAT, 'H1to5p'))
        self.assertLess(np.linalg.norm(corners_off(found.homography, truth, first.shape[::-1]), axis=1).mean(), 5.0)

    def test_the_result_has_the_bits_of_the_program(self):
        for preset, options in (('ktgp', {}), ('robust', {}), ('teblid', {'features': 700}),
                                ('ktgp', {'gms_rotation': True, 'T_w': 0.8})):
            words = ['--%s=%s' % (name, 'true' if value is True else value) for name, value in options.items()]
            expected = by_program(self.reference, self.target, '--preset', preset, *words)
            found = ktgp.match(self.reference, self.target, preset, **options)
            self.assertEqual(found.homography.ravel().tolist(), np.array(expected['homography']).ravel().tolist())
            counts = [stage['output'] for stage in expected['stages']]
            self.assertEqual([stage['output'] for stage in found.stages][:4], counts)

    def test_the_homography_is_the_true_one(self):
        found = ktgp.match(self.reference, self.target)
        self.assertEqual((found.status, found.found_by), ('ok', 'prosac'))
        self.assertLess(np.abs(corners_off(found.homography, TURN)).max(), 0.05)
        self.assertEqual((found.levels >= 3).sum(), found.inlier_count)
        self.assertEqual(found.covariance.shape, (8, 8))
        inlier = found.levels >= 3
        predicted = cv2.perspectiveTransform(found.reference_points[inlier][None], found.homography)[0]
        errors = np.linalg.norm(predicted - found.target_points[inlier], axis=1)
        self.assertLess(errors.max(), 3.0)
        self.assertAlmostEqual(np.sqrt((errors ** 2).mean()), found.rmse, 9)

    def test_one_call_is_extractor_and_matcher(self):
        extractor, matcher = ktgp.Extractor(), ktgp.Matcher()
        reference, target = extractor.extract(self.reference), extractor.extract(self.target)
        self.same(matcher.match(reference, target), ktgp.match(self.reference, self.target, 'ktgp'))
        self.assertEqual(len(reference), len(reference.keypoints))
        self.assertEqual(reference.image_size, (640, 480))

    def test_any_layout_in_memory_gives_the_same(self):
        expected = ktgp.match(self.reference, self.target)
        wide = np.zeros((480, 700), np.uint8)
        wide[:, 30:670] = self.reference
        turned = np.ascontiguousarray(self.reference[:, ::-1])[:, ::-1]
        for layout in (wide[:, 30:670], turned, np.asfortranarray(self.reference),
                       cv2.cvtColor(self.reference, cv2.COLOR_GRAY2BGR)):
            self.same(ktgp.match(layout, self.target), expected)
        grid = np.zeros((480, 640, 2), np.uint8)
        grid[:, :, 1] = self.reference
        self.same(ktgp.match(grid[:, :, 1], self.target), expected)

    def test_pictures_of_16_bits_and_in_colour_are_as_the_programs_take_them(self):
        wide = (self.reference.astype(np.uint16) * 12 + 300)
        for name, image, kind in (
                ('16-bit grey', wide, cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH),
                ('alpha', cv2.cvtColor(self.reference, cv2.COLOR_GRAY2BGRA), cv2.IMREAD_UNCHANGED),
                ('colour', cv2.merge([self.reference // 2, self.reference, self.reference // 3]), cv2.IMREAD_UNCHANGED),
                ('16-bit colour', cv2.merge([wide, wide, wide]), cv2.IMREAD_UNCHANGED)):
            read = cv2.imdecode(cv2.imencode('.png', image)[1], kind)
            self.assertEqual((read.dtype, read.shape), (image.dtype, image.shape))
            expected = np.array(by_program(image, self.target, '--preset', 'ktgp')['homography'])
            found = ktgp.match(read, self.target, 'ktgp')
            self.assertLess(np.abs(corners_off(found.homography, expected)).max(), 0.02 if 'colour' in name else 1e-9,
                            name)
        self.same(ktgp.match(np.ascontiguousarray(wide[:, ::-1])[:, ::-1], self.target), ktgp.match(wide, self.target))
        odd_rows = np.ndarray((480, 640), np.uint16, bytearray(480 * 1281), strides=(1281, 2))
        odd_rows[:] = wide
        self.same(ktgp.match(odd_rows, self.target), ktgp.match(wide, self.target))
        mosaic, sequence = ktgp.Mosaic(), ktgp.Sequence()
        self.assertEqual(mosaic.add(cv2.merge([wide, wide, wide]), sequence.match(wide, 1.0)), 'new_map')
        self.assertEqual(mosaic.image[100, 100, 0], round(wide[100, 100] / 257))
        with self.assertRaisesRegex(ValueError, 'image is 320x240, and the frame 640x480; expected the image'):
            mosaic.add(wide[::2, ::2], sequence.match(wide, 2.0))

    def test_masked_pixels_have_no_keypoints(self):
        mask = np.zeros((480, 640), np.uint8)
        mask[:, 320:] = 1
        features = ktgp.Extractor().extract(self.reference, mask)
        self.assertGreater(len(features), 100)
        self.assertGreaterEqual(features.keypoints[:, 0].min(), 319)

    def test_masks_that_hide_all_or_nothing_are_named(self):
        for value, words in ((0, 'hides the whole image'), (1, 'hides nothing')):
            with self.assertWarnsRegex(UserWarning, words):
                ktgp.Extractor().extract(self.reference, np.full((480, 640), value, np.uint8))

    def test_masked_arrays_are_refused_unless_they_hide_nothing(self):
        """NumPy would drop their masks."""
        hidden = np.zeros(self.reference.shape, bool)
        masked = np.ma.masked_array(self.reference, hidden)
        self.same(ktgp.match(masked, self.target), ktgp.match(self.reference, self.target))
        self.same(ktgp.match(np.ma.masked_array(self.reference), self.target), ktgp.match(self.reference, self.target))
        hidden[:, :100] = True
        masked = np.ma.masked_array(self.reference, hidden)
        features = ktgp.Extractor().extract(self.reference)
        targets, mosaic = ktgp.Targets(), ktgp.Mosaic()
        frame = ktgp.Sequence().match(self.reference, 1.0)
        for use, name in ((lambda: ktgp.match(masked, self.target), 'reference'),
                          (lambda: ktgp.match(self.target, masked), 'target'),
                          (lambda: ktgp.Extractor().extract(masked), 'image'),
                          (lambda: ktgp.Extractor().extract(self.reference, masked), 'mask'),
                          (lambda: ktgp.Sequence().match(masked, 1.0), 'image'),
                          (lambda: ktgp.Sequence(reference_mode='fixed').set_reference(masked), 'image'),
                          (lambda: targets.add('poster', masked), 'image'),
                          (lambda: targets.add('poster', [self.reference, masked]), 'image'),
                          (lambda: targets.find(masked), 'image'),
                          (lambda: mosaic.add(masked, frame), 'image'),
                          (lambda: ktgp.Features(np.ma.masked_array(features.keypoints, features.keypoints > 0),
                                                 features.descriptors, features.image_size), 'keypoints')):
            with self.assertRaisesRegex(ValueError, name + ' is a masked array with hidden values; expected its .data'):
                use()

        self.assertEqual(targets.ids, [])
        self.assertEqual(mosaic.add(self.reference, frame), 'new_map')
        with self.assertRaises(TypeError):  # it takes no image
            ktgp.Stabilizer().add(masked)

    def test_a_camera_matrix_of_which_a_part_is_hidden_or_missing_is_refused(self):
        K = np.array([[520.0, 0, 319.5], [0, 520.0, 239.5], [0, 0, 1]])
        extract, targets = ktgp.Extractor('slam').extract, ktgp.Targets()
        targets.add('poster', self.reference, width=0.8)
        found, = targets.find(self.target)
        features = extract(self.reference), extract(self.target)
        frame = ktgp.Sequence().match(self.reference, 1.0)
        uses = (('K', lambda k: ktgp.match(self.reference, self.target, 'slam', K=k)),
                ('target_K', lambda k: ktgp.match(self.reference, self.target, 'slam', K=K, target_K=k)),
                ('K', lambda k: ktgp.Matcher('slam').match(*features, K=k)),
                ('target_K', lambda k: ktgp.Matcher('slam').match(*features, K=K, target_K=k)),
                ('K', lambda k: targets.find(self.target, K=k)),
                ('camera', lambda k: ktgp.TargetPoses(0.0).find(found, k, (640, 480))),
                ('camera', lambda k: ktgp.GroundMotion().add(frame, k, height=(2.0, 0.01))))
        for name, use in uses:
            for good in (K, np.ma.masked_array(K), np.ma.masked_array(K, np.zeros((3, 3), bool)), K.tolist()):
                use(good)
            for bad, words in ((np.ma.masked_equal(K, 319.5),
                                ' is a masked array with hidden values; expected all of its numbers'),
                               (K[:2], r' is no matrix of numbers; expected an array of the shape \(3, 3\)'),
                               ('K.txt', r' is no matrix of numbers; expected')):
                with self.assertRaisesRegex(ValueError, '^' + name + words):
                    use(bad)
        self.assertIsNone(ktgp.match(self.reference, self.target, 'slam', K=None).rotation)

    def test_a_place_or_a_turn_of_which_a_part_is_hidden_or_missing_is_refused(self):
        K = np.array([[520.0, 0, 319.5], [0, 520.0, 239.5], [0, 0, 1]])
        frame = ktgp.Sequence().match(self.reference, 1.0)

        def add(**given):
            return ktgp.GroundMotion().add(frame, K, height=(2.0, 0.01), **given)
        uses = (('down[0]', 'vector', '(3,)', np.array([0, 0, 1.0]), lambda a: add(down=(a, 0.01))),
                ('turn[0]', 'matrix', '(3, 3)', np.eye(3), lambda a: add(turn=(a, 1e-4))),
                ('camera_to_base', 'matrix', '(4, 4)', np.eye(4), ktgp.GroundMotion))
        for name, kind, shape, numbers, use in uses:
            for good in (numbers, np.ma.masked_array(numbers), np.ma.masked_array(numbers, numbers > 2),
                         numbers.tolist()):
                use(good)
            for bad, words in ((np.ma.masked_equal(numbers, 1.0),
                                'is a masked array with hidden values; expected all of its numbers'),
                               (numbers[:2], f'is no {kind} of numbers; expected an array of the shape {shape}'),
                               ('R.txt', f'is no {kind} of numbers; expected')):
                with self.assertRaisesRegex(ValueError, '^' + re.escape(f'{name} {words}')):
                    use(bad)

    def test_a_place_or_a_turn_that_is_none_is_refused(self):
        K = np.array([[520.0, 0, 319.5], [0, 520.0, 239.5], [0, 0, 1]])
        frame = ktgp.Sequence().match(self.reference, 1.0)
        mirror = np.diag([1.0, 1, -1, 1])
        place = np.eye(4)
        place[:3, 3] = 0.1, 0.0, -0.05
        ktgp.GroundMotion(place)
        words = '^camera_to_base is not a rotation and a finite translation'
        with self.assertRaisesRegex(ValueError, words + '$'):
            ktgp.GroundMotion(mirror)
        projective = np.eye(4)
        projective[3, 3] = 2.0
        for bad in (place.T, projective, np.vstack([place[:3], 4 * [np.nan]])):
            with self.assertRaisesRegex(ValueError, words + ': its last row is not 0, 0, 0, 1; is it transposed\\?$'):
                ktgp.GroundMotion(bad)
        with self.assertRaisesRegex(ValueError, 'the rotation is not a rotation matrix'):
            ktgp.GroundMotion().add(frame, K, height=(2.0, 0.01), turn=(mirror[:3, :3], 1e-4))

    def test_pixels_hidden_by_alpha_have_no_keypoints(self):
        shown = np.full(self.reference.shape, 255, np.uint8)
        shown[:, 320:] = 0
        features = ktgp.Extractor().extract(np.dstack([self.reference] * 3 + [shown]))
        self.assertGreater(len(features.keypoints), 100)
        self.assertLess(np.mean(features.keypoints[:, 0] > 330), 0.02)
        zero = np.dstack([self.reference] * 3 + [0 * shown])  # as some drivers leave it
        self.assertGreater(np.mean(ktgp.Extractor().extract(zero).keypoints[:, 0] > 330), 0.3)

    def test_keypoints_to_opencv_and_back(self):
        extractor, matcher = ktgp.Extractor(), ktgp.Matcher(alignment=False)
        found = [extractor.extract(image) for image in (self.reference, self.target)]
        for form in (lambda f: f.to_cv(), lambda f: f.keypoints):
            again = [ktgp.Features(form(f), f.descriptors, f.image_size) for f in found]
            self.same(matcher.match(*again), matcher.match(*found))
        reference = cv2.ORB_create(2000).detectAndCompute(self.reference, None)
        self.assertEqual(len(ktgp.Features(*reference, (640, 480))), len(reference[0]))

    def test_arrays_outlive_the_result_and_cannot_be_written(self):
        found = ktgp.match(self.reference, self.target)
        points, copy = found.reference_points, found.reference_points.copy()
        descriptors = ktgp.Extractor().extract(self.reference).descriptors
        del found
        gc.collect()
        ktgp.match(self.target, self.reference)
        np.testing.assert_array_equal(points, copy)
        np.testing.assert_array_equal(descriptors, ktgp.Extractor().extract(self.reference).descriptors)
        for array in (points, descriptors):
            with self.assertRaises(ValueError):
                array[0] = 0

    def test_an_extractor_does_not_change_held_results(self):
        extractor = ktgp.Extractor()
        held = extractor.extract(self.reference)
        rows = extractor.extract(self.reference).descriptors  # without its Features
        for _ in range(6):
            extractor.extract(self.target)
        expected = ktgp.Extractor().extract(self.reference)
        np.testing.assert_array_equal(held.keypoints, expected.keypoints)
        for descriptors in (held.descriptors, rows):
            np.testing.assert_array_equal(descriptors, expected.descriptors)

    def test_threads_may_share_objects(self):
        extractor, matcher = ktgp.Extractor(), ktgp.Matcher()
        images = [self.reference] + [moved(picture(seed)) for seed in range(1, 4)]

        def run(i):
            reference = extractor.extract(images[0])
            return matcher.match(reference, extractor.extract(images[i % 4]))
        expected = [run(i) for i in range(4)]
        with concurrent.futures.ThreadPoolExecutor(4) as pool:
            for i, found in enumerate(pool.map(run, range(16))):
                self.same(found, expected[i % 4])

    def test_a_sequence_multiplies_its_homographies(self):
        frames = [self.reference, self.target, moved(self.target)]
        sequence = ktgp.Sequence()
        found = [sequence.match(frame, i / 30) for i, frame in enumerate(frames)]
        self.assertEqual([f.no_reference for f in found], ['first_frame', 'none', 'none'])
        self.assertIsNone(found[0].accumulated)
        points = ((100, 100), (500, 100), (100, 400), (500, 400))
        self.assertLess(np.abs(mapped(found[2].accumulated, points) - mapped(TURN @ TURN, points)).max(), 0.1)
        final = [f.levels >= 3 for f in found]
        before = dict(zip(found[1].target_indices[final[1]], found[1].tracks[final[1]]))
        go_on = [before[reference] == track for reference, track in
                 zip(found[2].reference_indices[final[2]], found[2].tracks[final[2]]) if reference in before]
        self.assertGreater(np.mean(go_on), 0.9)  # of several matches of one keypoint, one goes on
        self.assertGreater(len(set(found[1].tracks[final[1]]) & set(found[2].tracks[final[2]])), 300)
        self.assertEqual(len(set(found[2].tracks[final[2]])), final[2].sum())
        self.assertEqual(sequence.match(frames[0], 100.0).no_reference, 'gap')
        sequence.restart()
        fixed = ktgp.Sequence(reference_mode='fixed', preset='robust')
        self.assertEqual(fixed.match(frames[0], 0.0).no_reference, 'not_set')
        fixed.set_reference(frames[0])
        for time, frame in ((1.0, frames[1]), (50.0, frames[2])):
            self.assertEqual(fixed.match(frame, time).status, 'ok')
        with self.assertRaisesRegex(ValueError, "set_reference has no effect; expected reference_mode=\"fixed\""):
            sequence.set_reference(frames[0])

    def test_consumers_tell_a_fixed_reference_from_the_frames(self):
        def shown(x, y):
            return np.ascontiguousarray(self.reference[100 + y:400 + y, 100 + x:500 + x])

        sequence = ktgp.Sequence('robust', reference_mode='fixed')
        mosaic, stabilizer = ktgp.Mosaic(keyframes=False), ktgp.Stabilizer(lag=0)
        frames = 0
        for reference in ((0, 0), (40, 30), (-20, 10)):
            sequence.set_reference(shown(*reference))
            for i in range(3):
                x, y = 2 * frames, frames
                image = shown(x, y)
                frame = sequence.match(image, 0.04 * frames)
                frames += 1
                self.assertEqual(frame.status, 'ok')
                self.assertLess(frame.reference_seconds, 0.0)
                mosaic.add(image, frame)
                steady, = stabilizer.add(frame)
                self.assertEqual(steady.starts_anew, i == 0, reference)
                # The path to the map ends where the reference changes.
                self.assertEqual(mosaic.pose is None, reference != (0, 0), reference)
                if mosaic.pose is not None:
                    self.assertLess(np.abs(mapped(mosaic.pose, ((200, 150),)) - (200 - x, 150 - y)).max(), 1.0)

    def test_a_fixed_reference_is_seen_from_anywhere_unless_a_preset_is_set(self):
        tilt = np.float32([[0.25, -0.3, 200], [0.12, 0.75, 10], [0, 0, 1]])
        tilted = cv2.warpPerspective(self.reference, tilt, self.reference.shape[1::-1], flags=cv2.INTER_AREA)
        for preset, is_found in (({}, True), ({'preset': 'ktgp'}, False)):
            fixed = ktgp.Sequence(reference_mode='fixed', **preset)
            fixed.set_reference(self.reference)
            self.assertEqual(fixed.match(tilted, 1.0).status == 'ok', is_found, preset)
        self.assertIn('seen from anywhere', ktgp.Sequence.__init__.__doc__)

    def test_images_without_features_have_a_status(self):
        for image in (np.zeros((480, 640), np.uint8), np.zeros((3, 3), np.uint8)):
            self.assertEqual(ktgp.match(image, self.target).status, 'too_few_features')

    def test_bad_input_is_named(self):
        extract, grey = ktgp.Extractor().extract, self.reference
        descriptors = np.zeros((3, 32), np.uint8)
        teblid = ktgp.Extractor('teblid').extract(grey)

        def at(x, y):
            keypoints = np.zeros((3, 6), np.float32)
            keypoints[1, :2] = x, y
            return keypoints
        cases = (
            (lambda: ktgp.match(grey.astype(np.float32), grey), 'reference has the type float32; expected uint8 or '
             'uint16'),
            (lambda: ktgp.match(grey, grey.astype(np.int8)), 'target has the type int8; expected uint8 or uint16'),
            (lambda: ktgp.match(grey, grey[0]), 'target has the shape (640,)'),
            (lambda: extract(np.zeros((4, 4, 5), np.uint8)), 'shape (4, 4, 5); expected (height, width)'),
            (lambda: extract('a.png'), "image is <class 'str'>; expected a NumPy array"),
            (lambda: extract(None), 'expected a NumPy array'),
            (lambda: extract(grey, np.zeros((3, 3), np.uint8)), 'mask'),
            (lambda: ktgp.match(grey, grey, 'best'), 'preset is best; expected ktgp, photo, robust, slam, teblid, video'),
            (lambda: ktgp.match(grey, grey, K=np.eye(3)), 'expected preset="slam"'),
            (lambda: ktgp.match(grey, moved(grey), 'slam', K=np.zeros((3, 3))), 'upper triangular'),
            (lambda: ktgp.match(grey, moved(grey), 'slam', K=np.diag([900.0, 900.0, 1.0]), target_K=np.full((3, 3), np.nan)),
             'the K of the target camera'),
            (lambda: ktgp.match(grey, moved(grey), 'slam', K=np.eye(3)), 'a focal length in'),
            (lambda: ktgp.match(grey, moved(grey)[:400], 'slam', K=np.array([[520, 0, 320], [0, 520, 240], [0, 0, 1.0]])),
             'so they cannot share a K'),
            (lambda: ktgp.match(grey, grey, T_w=2.0), 'T_w is 2; expected a number in'),
            (lambda: ktgp.match(grey, grey, T_w='x'), 'T_w is'),
            (lambda: ktgp.match(grey, grey, features=1.5), 'features is 1.5'),
            (lambda: ktgp.match(grey, grey, t_w=0.7), 't_w is not a parameter of this object; did you mean T_w?; '
             'expected one of these (doc/parameters.md describes them): T_w, T_G, features, '),
            (lambda: ktgp.match(grey, grey, lazy=True), 'lazy is not a parameter of this object; expected one of'),
            (lambda: ktgp.Sequence(reference_moed='fixed'), 'did you mean reference_mode?'),
            (lambda: ktgp.Matcher(reference_mode='fixed'), 'reference_mode is not a parameter'),
            (lambda: ktgp.Sequence(reference_mode='last'), 'reference_mode is last'),
            (lambda: ktgp.Sequence().match(grey, float('nan')), ''),
            (lambda: ktgp.match(np.zeros((0, 0), np.uint8), grey), 'reference is empty'),
            (lambda: ktgp.match(grey, grey, None), 'preset is None; expected ktgp, '),
            (lambda: ktgp.Features(at(float('nan'), 1), descriptors, (9, 9)), 'keypoint 1 is at (nan, 1'),
            (lambda: ktgp.Features(at(1, 1e30), descriptors, (9, 9)), 'a position in the image of 9x9 px'),
            (lambda: ktgp.Features(at(1, 9), descriptors, (9, 9)), 'keypoint 1'),
            (lambda: ktgp.Features([1], descriptors, (9, 9)), 'not a cv2.KeyPoint'),
            (lambda: ktgp.Features(np.zeros((3, 2)), descriptors, (9, 9)), 'expected (N, 6)'),
            (lambda: ktgp.Features(np.zeros((2, 6)), descriptors, (9, 9)), 'features'),
            (lambda: ktgp.Features(np.zeros((3, 6)), descriptors, (9, 9), 'sift'), 'expected orb or teblid'),
            (lambda: ktgp.Matcher().match(extract(grey), teblid), 'descriptor'))
        for call, words in cases:
            with self.assertRaises(ValueError) as raised:
                call()
            self.assertIn(words, str(raised.exception))
        with self.assertRaises(TypeError):
            ktgp.Matcher().match(grey, grey)

    def test_scalars_of_numpy_are_numbers(self):
        given = ktgp.match(self.reference, self.target, T_w=np.float64(0.8), gms_rotation=np.bool_(True),
                           features=np.int64(700))
        self.same(given, ktgp.match(self.reference, self.target, T_w=0.8, gms_rotation=True, features=700))

    def test_copies_by_pickle_are_the_same(self):
        extractor, matcher = ktgp.Extractor(features=700), ktgp.Matcher(preset='robust')
        features = [extractor.extract(image) for image in (self.reference, self.target)]
        expected = matcher.match(*features)
        self.assertEqual(expected.status, 'ok')
        copies = pickle.loads(pickle.dumps([extractor, matcher, features, expected]))
        self.same(copies[3], expected)
        self.assertEqual(copies[3].stages, expected.stages)
        self.same(copies[1].match(*copies[2]), expected)  # with the alignment, so with the images
        np.testing.assert_array_equal(copies[0].extract(self.reference).keypoints, features[0].keypoints)
        sequence = ktgp.Sequence(reference_mode='keyframe')
        frame = [sequence.match(image, i) for i, image in enumerate((self.reference, self.target))][1]
        copy = pickle.loads(pickle.dumps(frame))
        self.same(copy, frame)
        self.assertEqual(copy.no_reference, 'none')
        np.testing.assert_array_equal(copy.accumulated, frame.accumulated)
        again = pickle.loads(pickle.dumps(sequence))
        self.assertEqual(again.match(self.reference, 5.0).no_reference, 'first_frame')

    def frames(self, count, large=picture(5, (900, 1200))):
        """A camera that moves by (12, 5) px a frame over a large picture."""
        return [np.ascontiguousarray(large[100 + 5 * i:580 + 5 * i, 100 + 12 * i:740 + 12 * i]) for i in range(count)]

    def test_targets_are_found_where_they_are(self):
        targets = ktgp.Targets(max_instances=3)
        poster = picture(9, (300, 400))
        targets.add('poster', poster, width=0.8)
        targets.add('other', [picture(10, (300, 400)), picture(11, (300, 400))])
        self.assertEqual(targets.ids, ['poster', 'other'])
        scene = cv2.warpPerspective(poster, TURN @ np.diag([0.8, 0.8, 1]), (640, 480))
        found, = targets.find(scene)
        self.assertEqual((found.id, found.instance, found.status, found.width), ('poster', 0, 'ok', 0.8))
        expected = mapped(TURN @ np.diag([0.8, 0.8, 1]), [[0, 0], [399, 0], [399, 299], [0, 299]])
        np.testing.assert_allclose(found.corners, expected, atol=0.5)
        self.assertTrue(targets.remove('poster'))
        self.assertFalse(targets.remove('poster'))
        self.assertEqual(targets.find(scene), [])
        with self.assertRaisesRegex(ValueError, 'too little texture'):
            targets.add('grey', np.full((300, 400), 99, np.uint8))

    @unittest.skipUnless(os.path.exists(CUBE + '.mp4'), 'KTGP_ORB_DATA is not set: this test needs its targets_real')
    def test_no_wrong_pose_of_a_small_face_in_a_real_video_is_certain(self):
        """A face with sides of 35 to 85 px. Its two poses are 90 degrees or more apart; the labels, good to 1.5 px,
        tell which is right."""
        camera = np.array([[547.7, 0, 338.7], [0, 542.1, 234.5], [0, 0, 1]])  # of the video's author
        width = 0.084  # m
        with open(os.path.join(os.path.dirname(CUBE), 'labels.json')) as file:
            labels = json.load(file)['cube.png cube.mp4']['frames']
        face = cv2.imread(CUBE + '.png', cv2.IMREAD_GRAYSCALE)
        half = 0.5 * width * np.array([1.0, face.shape[0] / face.shape[1], 0.0])
        corners = half * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
        targets = ktgp.Targets()
        targets.add('face', face, width=width)
        video, labelled, first, certain = cv2.VideoCapture(CUBE + '.mp4'), 0, 0, 0
        for i in range(max(map(int, labels)) + 1):
            found = targets.find(cv2.cvtColor(video.read()[1], cv2.COLOR_BGR2GRAY), K=camera)
            if str(i) not in labels:
                continue
            _, turns, shifts, off = cv2.solvePnPGeneric(corners, np.array(labels[str(i)])[:, None], camera, None,
                                                        flags=cv2.SOLVEPNP_IPPE)
            if off.min() > 1.5:
                continue  # the label of frame 52 is beside the face
            labelled += 1
            best = off.argmin()
            for k, pose in enumerate(found[0].poses if found else []):
                turned = np.linalg.norm(cv2.Rodrigues(pose.matrix[:3, :3].T @ cv2.Rodrigues(turns[best])[0])[0])
                is_right = turned < math.radians(3.0) and \
                    np.linalg.norm(pose.matrix[:3, 3] - shifts[best].ravel()) < 0.03
                self.assertTrue(is_right or pose.share < 0.9, (i, k, pose.share, math.degrees(turned)))
                first += is_right and k == 0
                certain += is_right and pose.share >= 0.9
        self.assertEqual(labelled, 20)
        self.assertGreaterEqual(first, 19)
        self.assertGreaterEqual(certain, 12)

    def test_a_target_has_its_pose_through_the_lens(self):
        camera = np.array([[520.0, 0, 320], [0, 520, 240], [0, 0, 1]])
        distortion = [-0.25, 0.08, 0.001, -0.0005]
        turn = cv2.Rodrigues(np.array([0.3, -0.25, 0.1]))[0]
        shift = np.array([0.02, -0.03, 0.9])
        metre = 0.6 / 400  # a pixel of the poster
        to_target = np.array([[metre, 0, -metre * 199.5], [0, metre, -metre * 149.5], [0, 0, 1]])
        poster = picture(9, (300, 400))
        straight = camera @ np.column_stack([turn[:, :2], shift]) @ to_target
        grid = np.stack(np.meshgrid(np.arange(640.0), np.arange(480.0)), axis=-1).reshape(-1, 1, 2)
        seen = cv2.undistortPoints(grid, camera, np.array(distortion), P=camera).reshape(-1, 2)
        on_poster = mapped(np.linalg.inv(straight), seen).astype(np.float32).reshape(480, 640, 2)
        scene = cv2.remap(poster, on_poster[..., 0], on_poster[..., 1], cv2.INTER_LINEAR)
        targets = ktgp.Targets()
        targets.add('poster', poster, width=0.6)
        found, = targets.find(scene)

        def error(distortion):
            pose, covariance, share = ktgp.TargetPoses(0.0).find(found, camera, (640, 480), distortion)[0]
            self.assertGreater(np.linalg.eigvalsh(covariance).min(), 0.0)
            self.assertGreater(share, 0.5)
            return np.linalg.norm(pose[:3, 3] - shift)
        self.assertLess(error(distortion), 0.003)
        self.assertGreater(error([]), 2 * error(distortion))
        with self.assertRaisesRegex(ValueError, 'coefficients'):
            ktgp.TargetPoses().find(found, camera, (640, 480), [0.1])
        self.assertEqual(error(np.array(distortion)), error(tuple(distortion)))
        for bad, words in ((np.array([distortion]), r'distortion has the shape \(1, 4\); expected \(N,\)'),
                           (['k1'], 'distortion is no vector of numbers'),
                           (np.ma.masked_equal(distortion, 0.08), 'distortion is a masked array with hidden values')):
            with self.assertRaisesRegex(ValueError, '^' + words):
                ktgp.TargetPoses().find(found, camera, (640, 480), bad)
        for words, k, size, seconds in (('fx of camera is 1', np.eye(3), (640, 480), 0.0),
                                        ('principal point at 320, 240, outside', camera, (300, 200), 0.0),
                                        ('size is 0, 0', camera, (0, 0), 0.0),
                                        ('seconds is nan', camera, (640, 480), np.nan)):
            with self.assertRaisesRegex(ValueError, words):
                ktgp.TargetPoses().find(found, k, size, seconds=seconds)
        with self.assertRaisesRegex(ValueError, 'seconds is missing; expected the time of the image'):
            ktgp.TargetPoses(0.02).find(found, camera, (640, 480))
        for readout in (-5.0, -0.5, 0.5, np.inf, np.nan):
            with self.assertRaisesRegex(ValueError, 'readout_time is'):
                ktgp.TargetPoses(readout)

    def test_a_target_says_that_it_looks_like_itself_in_another_pose(self):
        targets = ktgp.Targets()
        self.assertEqual(targets.add('poster', picture(9, (300, 400))), '')
        half = picture(12, (150, 240))
        card = np.vstack([half, half[::-1, ::-1]])
        self.assertEqual(targets.add('card', card), 'turned by 180 degrees')
        scene = cv2.warpPerspective(card, TURN, (640, 480))
        self.assertEqual({found.ambiguity for found in targets.find(scene)}, {'turned by 180 degrees'})

    def test_a_mosaic_grows_and_the_stabilizer_holds_still(self):
        sequence, mosaic, stabilizer = ktgp.Sequence('video'), ktgp.Mosaic(), ktgp.Stabilizer(lag=5)
        images = self.frames(20)
        steady = []
        for i, image in enumerate(images):
            frame = sequence.match(image, 10 + i / 30)
            self.assertAlmostEqual(frame.seconds, 10 + i / 30, 6)
            self.assertIn(mosaic.add(image, frame), ('new_map', 'drawn', 'seen'))
            steady += stabilizer.add(frame)
        steady += stabilizer.flush()
        self.assertEqual([round(30 * (f.seconds - 10)) for f in steady], list(range(20)))
        self.assertEqual([f.starts_anew for f in steady], [True] + 19 * [False])
        self.assertEqual(mosaic.image.shape[2], 4)
        self.assertAlmostEqual(mosaic.image.shape[1], 640 + 19 * 12, delta=16)
        np.testing.assert_allclose(mosaic.pose / mosaic.pose[2, 2], [[1, 0, -19 * 12], [0, 1, -19 * 5], [0, 0, 1]],
                                   atol=0.5)
        with self.assertRaises(ValueError):
            ktgp.Mosaic(max_megapixels=0)

    def test_the_area_of_a_mosaic_tells_where_its_image_is_in_the_map(self):
        """A camera that moves left and up, so that the image begins left of and above the first frame."""
        sequence, mosaic = ktgp.Sequence('video'), ktgp.Mosaic()
        self.assertEqual(mosaic.area, (0, 0, 0, 0))
        images = self.frames(20)[::-1]
        for i, image in enumerate(images):
            mosaic.add(image, sequence.match(image, i / 30))
        x, y, width, height = mosaic.area  # read first: it has the newest frame, too
        seen = mosaic.image
        self.assertEqual((height, width), seen.shape[:2])
        self.assertAlmostEqual(x, -19 * 12, delta=2)
        self.assertAlmostEqual(y, -19 * 5, delta=2)
        to_image = mosaic.pose @ np.array([[1, 0, x], [0, 1, y], [0, 0, 1]])
        last = cv2.warpPerspective(seen[..., 0], to_image, (640, 480))
        off = np.abs(last[20:-20, 20:-20].astype(int) - images[-1][20:-20, 20:-20])
        self.assertLess(off.mean(), 4)

    def test_seconds_are_rounded_to_nanoseconds(self):
        sequence, stabilizer = ktgp.Sequence(), ktgp.Stabilizer(lag=0)
        image = picture(2, (60, 80))
        for i in range(1, 40):
            frame = sequence.match(np.roll(image, i, axis=1), i / 30)
            self.assertEqual(frame.seconds, round(i / 30, 9))
            self.assertEqual([steady.seconds for steady in stabilizer.add(frame)], [frame.seconds])

    def test_a_repeated_image_is_no_frame_of_the_stabilizer(self):
        """Of a driver that gives every image twice."""
        sequence, stabilizer = ktgp.Sequence('video'), ktgp.Stabilizer(lag=2)
        steady, seconds, repeated = [], [], 0
        for i, image in enumerate(each for each in self.frames(8) for _ in range(2)):
            frame = sequence.match(image, i / 60)
            repeated += frame.repeated
            if frame.repeated:
                self.assertEqual(stabilizer.add(frame), [])
            else:
                seconds.append(frame.seconds)
                steady += stabilizer.add(frame)
        steady += stabilizer.flush()
        self.assertEqual(repeated, 8)
        self.assertEqual([each.seconds for each in steady], seconds)
        self.assertEqual([each.starts_anew for each in steady], [True] + 7 * [False])

    def test_motion_in_metres(self):
        sequence = ktgp.Sequence('video', reference_mode='keyframe')
        motion = ktgp.GroundMotion()
        camera = np.array([[500, 0, 319.5], [0, 500, 239.5], [0, 0, 1.0]])
        for i, image in enumerate(self.frames(20)):
            found = motion.add(sequence.match(image, i / 30), camera, height=(2.0, 0.01),
                               down=(np.array([0, 0, 1.0]), 0.01))
        self.assertEqual(found.status, 'ok')
        # 12 px a frame at 500 px focal length, 2 m above: along x of the camera.
        np.testing.assert_allclose(found.twist[:3], np.array([12, 5, 0]) * 30 * 2 / 500, atol=0.03)
        self.assertAlmostEqual(found.pose[2, 3], 2.0, delta=0.03)
        self.assertEqual(found.twist_covariance.shape, (6, 6))
        with self.assertRaises(ValueError):
            motion.add(sequence.match(image, 9.0), camera, height=(-1.0, 0.01))
        with self.assertRaisesRegex(ValueError, 'of_imu is True, but down is missing; expected the direction to the '
                                                'ground that the Imu has measured'):
            motion.add(sequence.match(image, 9.5), camera, height=(2.0, 0.01), of_imu=True)

    def test_motion_needs_a_reference_by_the_same_camera(self):
        """Nobody knows the K of a drawn map; it has another size."""
        large = picture(5, (900, 1200))
        image = np.ascontiguousarray(large[150:630, 150:790])
        camera = np.array([[500, 0, 319.5], [0, 500, 239.5], [0, 0, 1.0]])
        words = ('from a reference of 700x600 to an image of 640x480; expected a reference by the same camera: for a '
                 'map, use Targets')

        def move(width, height):
            sequence = ktgp.Sequence('robust', reference_mode='fixed')
            sequence.set_reference(np.ascontiguousarray(large[140:140 + height, 140:140 + width]))
            frame = sequence.match(image, 1.0)
            self.assertEqual(frame.status, 'ok')
            ktgp.GroundMotion().add(frame, camera, height=(2.0, 0.01), down=(np.array([0, 0, 1.0]), 0.01))
        move(640, 480)
        with self.assertRaisesRegex(ValueError, words):
            move(700, 600)

    def test_an_imu_whose_stamps_are_late(self):
        def angle(seconds):
            return 0.3 * math.sin(2 * seconds)

        sequence = ktgp.Sequence('video', reference_mode='keyframe')
        motion = ktgp.GroundMotion()
        camera = np.array([[500, 0, 319.5], [0, 500, 239.5], [0, 0, 1.0]])
        large = picture(5, (900, 1200))
        for i in range(300):
            seconds = i / 30
            turn = cv2.getRotationMatrix2D((600, 450), math.degrees(angle(seconds)), 1)
            image = np.ascontiguousarray(cv2.warpAffine(large, turn, (1200, 900))[210:690, 280:920])
            step = angle(seconds - 0.03) - angle(seconds - 0.03 - 1 / 30)
            said = np.array([[math.cos(step), -math.sin(step), 0], [math.sin(step), math.cos(step), 0], [0, 0, 1]])
            found = motion.add(sequence.match(image, seconds), camera, height=(2.0, 0.01),
                               down=(np.array([0, 0, 1.0]), 0.01), turn=(said, 1e-4) if i else None, of_imu=True)
        self.assertAlmostEqual(found.imu.delay, 0.03, delta=0.003)
        self.assertLess(found.imu.delay_deviation, 0.003)
        self.assertIn("the Imu's stamps seem ", found.imu.trouble)
        self.assertIn('ms late', str(found.imu))

    def test_the_version_is_that_of_the_programs(self):
        version = subprocess.check_output([os.path.join(TOOLS, 'ktgp_match'), '--version'], universal_newlines=True)
        self.assertEqual(version.split()[-1], ktgp.__version__)

    def test_a_daemon_thread_does_not_end_the_process(self):
        program = '''
import numpy as np, sys, threading
import ktgp_orb_core as ktgp
image = np.kron(np.random.RandomState(0).randint(0, 255, (60, 80)), np.ones((8, 8))).astype(np.uint8)
began = threading.Event()
def loop():
    while True:
        began.set()
        ktgp.match(image, image, preset='photo')
threading.Thread(target=loop, daemon=True).start()
began.wait()
'''
        for _ in range(3):
            run = subprocess.run([sys.executable, '-c', program], stderr=subprocess.PIPE,
                                 universal_newlines=True)
            self.assertEqual((run.returncode, run.stderr), (0, ''))

    def test_an_object_in_use_at_a_fork_is_refused_in_the_child_and_others_work(self):
        busy, idle = ktgp.Extractor(features=2000), ktgp.Extractor(features=300)
        large = picture(shape=(3000, 4000))
        expected = idle.extract(self.reference).keypoints
        for _ in range(3):
            started = threading.Event()

            def work():
                started.set()
                busy.extract(large)
            thread = threading.Thread(target=work)
            thread.start()
            started.wait()
            time.sleep(0)  # the thread goes on, into the extraction
            child = os.fork()
            if child == 0:
                signal.alarm(60)
                try:
                    same = np.array_equal(idle.extract(self.reference).keypoints, expected)
                    busy.extract(self.reference)  # if it was not in use yet
                    os._exit(0 if same else 3)
                except RuntimeError as error:
                    os._exit(0 if same and 'expected an object made after the fork' in str(error) else 4)
            self.assertEqual(os.waitpid(child, 0)[1], 0)
            thread.join()

    def test_a_sub_interpreter_is_refused(self):
        program = ('import _xxsubinterpreters as interpreters\n'
                   'interpreters.run_string(interpreters.create(), "import ktgp_orb_core")')
        run = subprocess.run([sys.executable, '-c', program], stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                             timeout=60, universal_newlines=True, check=False)
        if 'No module named' in run.stdout:
            self.skipTest('this Python has no sub-interpreters')
        self.assertIn('works in the main interpreter alone', run.stdout)

    def test_the_stubs_name_all_there_is(self):
        with open(os.path.join(os.path.dirname(ktgp.__file__), 'ktgp_orb_core.pyi')) as file:
            tree = ast.parse(file.read())
        classes = {node.name: node for node in tree.body if isinstance(node, ast.ClassDef)}
        functions = {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
        public = {name for name in dir(ktgp) if not name.startswith('_')}
        self.assertEqual(public, set(classes) | functions)
        for name, node in classes.items():
            stubs = {each.name for each in node.body if not each.name.startswith('_')}
            own = {each for each in vars(getattr(ktgp, name)) if not each.startswith('_')}
            self.assertEqual(own, stubs, name)
