"""The Python of README.md and doc/*.md, run as printed, block after block, with drawn pictures."""

import contextlib
import glob
import io
import os
import re
import subprocess
import sys

import cv2
import numpy as np

sys.path.append(os.path.join(os.path.dirname(os.path.dirname(os.path.abspath(__file__))), 'tools'))
from tool_case import FolderCase, two_depths  # noqa: E402

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
K = np.array([[520.0, 0, 319.5], [0, 520.0, 239.5], [0, 0, 1]])


def blocks_of(path):
    with open(path, encoding='utf-8') as file:
        return re.findall(r'^```python\n(.*?)^```', file.read(), re.M | re.S)


def world():
    noise = np.random.RandomState(1).rand(600, 900).astype(np.float32)
    return cv2.normalize(cv2.GaussianBlur(noise, (0, 0), 2), None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)


class RecipesTest(FolderCase):
    def setUp(self):
        super().setUp()
        self.addCleanup(os.chdir, os.getcwd())
        os.chdir(self.folder)
        pictures = [world()[20:500, 10 + 4 * i:650 + 4 * i].copy() for i in range(12)]
        cv2.imwrite('first.png', pictures[0])
        cv2.imwrite('second.png', pictures[5])
        subprocess.run([os.path.join(os.environ['KTGP_ORB_TOOLS'], 'ktgp_match'), 'first.png', 'second.png',
                        '--json', 'out.json'], check=True, stdout=subprocess.DEVNULL)
        direction = np.array([-0.9, 0.1, 0.3]) / np.linalg.norm([-0.9, 0.1, 0.3])
        self.names = {
            'K': K, 'first': pictures[0], 'second': two_depths(pictures[0], K, 0.3, direction),
            'poster': pictures[0], 'images': pictures[1:4], 'door_image': pictures[0][100:400, 200:500],
            'frames': [(i / 30, picture) for i, picture in enumerate(pictures)]}

    def run_page(self, name):
        """The names that its blocks leave."""
        for block in blocks_of(os.path.join(ROOT, name)):
            with contextlib.redirect_stdout(io.StringIO()):
                exec(compile(block, name, 'exec'), self.names)
        return self.names

    def test_every_page_with_python_is_run(self):
        pages = [os.path.relpath(path, ROOT) for path in
                 [os.path.join(ROOT, 'README.md')] + glob.glob(os.path.join(ROOT, 'doc', '**', '*.md'), recursive=True)
                 if blocks_of(path)]
        self.assertEqual(sorted(pages), ['doc/formats.md', 'doc/python.md'])

    def test_the_page_of_the_module(self):
        names = self.run_page('doc/python.md')
        self.assertEqual(names['found'].status, 'ok')
        self.assertEqual(names['moved'].status, 'ok')
        self.assertEqual(names['target'].id, 'door')
        self.assertEqual(len(names['target'].poses), 1)
        self.assertGreater(names['mosaic'].image.shape[1], 640)

    def test_the_covariance_in_json_is_a_matrix(self):
        C = self.run_page('doc/formats.md')['C']
        self.assertEqual(C.shape, (8, 8))
        self.assertGreater(np.linalg.eigvalsh(C).min(), 0.0)
