"""The Python of README.md and doc/*.md, run as printed, block after block, with drawn pictures."""

import contextlib
import glob
import io
import os
import re
import shutil
import subprocess
import sys

import cv2
import numpy as np
from ktgp_orb.msg import HomographyStamped, MatchStatus

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
        x, y = np.round(names['features'].keypoints[:, :2]).astype(int).T
        self.assertGreater(len(x), 100)
        self.assertGreaterEqual(names['first'][y, x].min(), 50, 'hidden pixels have no keypoints')
        self.assertEqual(len(names['target'].poses), 1)
        self.assertGreater(names['mosaic'].image.shape[1], 640)

    def test_the_message_in_readme_has_the_fields_of_the_topic(self):
        with open(os.path.join(ROOT, 'README.md'), encoding='utf-8') as file:
            lines, = [block.splitlines() for block in re.findall(r'^```\n(.*?)^```', file.read(), re.M | re.S)
                      if 'homography:' in block]
        fields = HomographyStamped.__slots__
        printed = [line.split(':')[0] for line in lines]
        self.assertEqual(printed, [field for field in fields if field in printed], 'the topic has this order')
        values = {line.split(':')[0]: line.split(':')[1].split('#') for line in lines}
        self.assertEqual(int(values['status'][0]), getattr(MatchStatus, values['status'][1].strip()))
        H = [float(number) for number in re.findall(r'[-+.e\d]+', values['homography'][0])]
        self.assertEqual((len(H), H[8]), (len(HomographyStamped().homography), 1.0))
        self.assertLessEqual({'inliers', 'reprojection_rmse', 'covariance'}, set(printed))

    def tool(self, name, *arguments):
        subprocess.run([os.path.join(os.environ['KTGP_ORB_TOOLS'], name), '--force', *arguments], check=True,
                       stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    def test_formats_names_every_field_and_column(self):
        cv2.imwrite('depth.png', self.names['second'])
        os.mkdir('posters')
        shutil.copy('first.png', 'posters')
        self.write('H.txt', '1 0 -20\n0 1 0\n0 0 1\n')
        camera = ['--camera', '520,520,319.5,239.5']
        self.tool('ktgp_match', 'first.png', 'second.png', '--ground-truth', 'H.txt', '--json', 'h.json',
                  '--csv', 'h.csv')
        self.tool('ktgp_match', 'first.png', 'depth.png', '--preset', 'slam', *camera, '--json', 'e.json',
                  '--csv', 'e.csv')
        self.tool('ktgp_find', 'second.png', 'posters', *camera, '--json', 'f.json')
        self.tool('ktgp_bag', '[fd]*.png', 'out.bag', '--preset', 'slam', *camera, '--csv', 'b.csv')
        with open(os.path.join(ROOT, 'doc', 'formats.md'), encoding='utf-8') as file:
            text = file.read()
        named = set(re.findall(r'[\w…]+', ' '.join(re.findall(r'`([^`\n]+)`', text))))
        begins = tuple(name[:-1] for name in named if name.endswith('…'))
        ranges = re.findall(r'`(\w+)`,? …,? `(\w+)`', text)

        def keys(value):
            if isinstance(value, dict):
                for key, each in value.items():
                    yield key
                    if key != 'options':
                        yield from keys(each)
            elif isinstance(value, list):
                for each in value:
                    yield from keys(each)
        unnamed = {key for name in ('h', 'e', 'f') for key in keys(self.json(name + '.json'))} - named
        for name in ('h', 'e', 'b'):
            with open(name + '.csv', encoding='utf-8') as file:
                columns = file.readline().strip().split(',')
            between = {column for first, last in ranges if first in columns
                       for column in columns[columns.index(first):columns.index(last) + 1]}
            unnamed |= {column for column in set(columns) - named - between if not column.startswith(begins)}
        self.assertEqual(unnamed, set(), 'doc/formats.md does not name them')

    def test_the_covariance_in_json_is_a_matrix(self):
        C = self.run_page('doc/formats.md')['C']
        self.assertEqual(C.shape, (8, 8))
        self.assertGreater(np.linalg.eigvalsh(C).min(), 0.0)
