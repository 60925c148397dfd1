#!/usr/bin/python3
"""The Python module ktgp_orb_core: the bits of the C++ programs, NumPy arrays in and out, bad input, threads."""

import ast
import concurrent.futures
import gc
import json
import os
import subprocess
import tempfile
import unittest

import cv2
import ktgp_orb_core as ktgp
import numpy as np

TOOLS = os.environ['KTGP_ORB_TOOLS']
TURN = np.array([[0.999, 0.03, 4.0], [-0.03, 0.999, 9.0], [1e-5, 0.0, 1.0]])


def picture(seed=1, shape=(480, 640)):
    noise = np.random.RandomState(seed).rand(*shape).astype(np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), 2)
    return cv2.normalize(smooth, None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)


def moved(image):
    return cv2.warpPerspective(image, TURN, image.shape[1::-1])


class ModuleTest(unittest.TestCase):
    def setUp(self):
        self.reference = picture()
        self.target = moved(self.reference)

    def same(self, first, second):
        self.assertEqual(first.status, second.status)
        for name in ('homography', 'covariance', 'levels', 'reference_points', 'target_points'):
            np.testing.assert_array_equal(getattr(first, name), getattr(second, name))

    def test_the_result_has_the_bits_of_the_program(self):
        with tempfile.TemporaryDirectory() as folder:
            names = [os.path.join(folder, name) for name in ('a.png', 'b.png', 'out.json')]
            cv2.imwrite(names[0], self.reference)
            cv2.imwrite(names[1], self.target)
            for preset, options in (('ktgp', {}), ('robust', {}), ('teblid', {'features': 700}),
                                    ('ktgp', {'gms_rotation': True, 'T_w': 0.8})):
                words = ['--%s=%s' % (name, 'true' if value is True else value) for name, value in options.items()]
                subprocess.run([os.path.join(TOOLS, 'ktgp_match'), names[0], names[1], '--json', names[2], '--force',
                                '--preset', preset] + words, check=True, stdout=subprocess.DEVNULL)
                with open(names[2]) as file:
                    expected = json.load(file)
                found = ktgp.match(self.reference, self.target, preset, **options)
                self.assertEqual(found.homography.ravel().tolist(),
                                 np.array(expected['homography']).ravel().tolist())
                counts = [stage['output'] for stage in expected['stages']]
                self.assertEqual([stage['output'] for stage in found.stages][:4], counts)

    def test_the_homography_is_the_true_one(self):
        found = ktgp.match(self.reference, self.target)
        self.assertEqual((found.status, found.found_by), ('ok', 'prosac'))
        corners = np.array([[[0, 0], [639, 0], [0, 479], [639, 479]]], float)
        error = cv2.perspectiveTransform(corners, found.homography) - cv2.perspectiveTransform(corners, TURN)
        self.assertLess(np.abs(error).max(), 0.05)
        self.assertEqual((found.levels >= 3).sum(), found.inlier_count)
        self.assertEqual(found.covariance.shape, (8, 8))
        inlier = found.levels >= 3
        predicted = cv2.perspectiveTransform(found.reference_points[inlier][None], found.homography)[0]
        errors = np.linalg.norm(predicted - found.target_points[inlier], axis=1)
        self.assertLess(errors.max(), 3.0)
        self.assertAlmostEqual(np.sqrt((errors ** 2).mean()), found.rmse, 9)

    def test_a_fifth_of_a_pixel_is_measured(self):
        fine = cv2.resize(picture(2, (540, 700)), (3500, 2700), interpolation=cv2.INTER_CUBIC)
        for shift in range(0, 11, 2):
            small = [cv2.resize(fine[20:2420, x:x + 3200], (640, 480), interpolation=cv2.INTER_AREA)
                     for x in (100, 100 - shift)]
            for preset in ('ktgp', 'video', 'robust', 'teblid'):
                found = ktgp.match(*small, preset)
                self.assertEqual(found.status, 'ok')
                error = found.homography[:2, 2] - (shift / 5.0, 0.0)
                self.assertLess(np.abs(error).max(), 0.03, (preset, shift))
                spread = found.covariance[np.ix_((2, 5), (2, 5))]
                self.assertLess(error @ np.linalg.solve(spread, error), 13.8, (preset, shift))

    def test_one_call_is_extractor_and_matcher(self):
        extractor, matcher = ktgp.Extractor(), ktgp.Matcher()
        reference, target = extractor.extract(self.reference), extractor.extract(self.target)
        self.same(matcher.match(reference, target), ktgp.match(self.reference, self.target))
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

    def test_masked_pixels_have_no_keypoints(self):
        mask = np.zeros((480, 640), np.uint8)
        mask[:, 320:] = 1
        features = ktgp.Extractor().extract(self.reference, mask)
        self.assertGreater(len(features), 100)
        self.assertGreaterEqual(features.keypoints[:, 0].min(), 319)

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

    def test_an_extractor_changes_nothing_that_is_held(self):
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
        corners = np.array([[[100, 100], [500, 100], [100, 400], [500, 400]]], float)
        error = cv2.perspectiveTransform(corners, found[2].accumulated) - \
            cv2.perspectiveTransform(corners, TURN @ TURN)
        self.assertLess(np.abs(error).max(), 0.1)
        self.assertEqual(sequence.match(frames[0], 100.0).no_reference, 'gap')
        sequence.restart()
        fixed = ktgp.Sequence(reference_mode='fixed', preset='robust')
        self.assertEqual(fixed.match(frames[0], 0.0).no_reference, 'not_set')
        fixed.set_reference(frames[0])
        for time, frame in ((1.0, frames[1]), (50.0, frames[2])):
            self.assertEqual(fixed.match(frame, time).status, 'ok')

    def test_images_without_features_have_a_status(self):
        for image in (np.zeros((0, 0), np.uint8), np.zeros((480, 640), np.uint8), np.zeros((3, 3), np.uint8)):
            self.assertEqual(ktgp.match(image, self.target).status, 'too_few_features')

    def test_bad_input_is_named(self):
        extract, grey = ktgp.Extractor().extract, self.reference
        descriptors = np.zeros((3, 32), np.uint8)
        teblid = ktgp.Extractor('teblid').extract(grey)
        cases = (
            (lambda: ktgp.match(grey.astype(np.float32), grey), 'reference has the type float32; expected uint8'),
            (lambda: ktgp.match(grey, grey.astype(np.int8)), 'target has the type int8; expected uint8'),
            (lambda: ktgp.match(grey, grey[0]), 'target has the shape (640,)'),
            (lambda: extract(np.zeros((4, 4, 4), np.uint8)), 'shape (4, 4, 4); expected (height, width)'),
            (lambda: extract('a.png'), "image is <class 'str'>; expected a NumPy array"),
            (lambda: extract(None), 'expected a NumPy array'),
            (lambda: extract(grey, np.zeros((3, 3), np.uint8)), 'mask'),
            (lambda: ktgp.match(grey, grey, 'best'), 'preset is best; expected ktgp, robust'),
            (lambda: ktgp.match(grey, grey, T_w=2.0), 'T_w is 2.0; expected a number in'),
            (lambda: ktgp.match(grey, grey, T_w='x'), 'T_w is'),
            (lambda: ktgp.match(grey, grey, features=1.5), 'features is 1.5'),
            (lambda: ktgp.match(grey, grey, lazy=True), 'lazy is not a parameter of this object'),
            (lambda: ktgp.Matcher(reference_mode='fixed'), 'reference_mode is not a parameter'),
            (lambda: ktgp.Sequence(reference_mode='last'), 'reference_mode is last'),
            (lambda: ktgp.Sequence().match(grey, float('nan')), ''),
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


if __name__ == '__main__':
    unittest.main()
