"""A disk of half a megabyte: the programs report that it is full and leave no file."""
import os
import pathlib
import shutil
import subprocess
import tempfile
import unittest

TOOLS = pathlib.Path(os.environ['KTGP_ORB_TOOLS'])


class FullDisk(unittest.TestCase):
    def setUp(self):
        self.disk = tempfile.mkdtemp()
        self.addCleanup(os.rmdir, self.disk)
        mounted = subprocess.run(['mount', '-t', 'tmpfs', '-o', 'size=512k', 'tmpfs', self.disk],
                                 stderr=subprocess.PIPE, check=False)
        if mounted.returncode != 0:
            self.skipTest('a tmpfs cannot be mounted here')
        self.addCleanup(subprocess.check_call, ['umount', self.disk])

    def check(self, tool, *arguments):
        done = subprocess.run([str(TOOLS / tool), *arguments], stdout=subprocess.PIPE,
                              stderr=subprocess.STDOUT, check=False)
        self.assertEqual(done.returncode, 2, done.stdout)
        self.assertEqual(os.listdir(self.disk), [], done.stdout)

    def test_the_demo_bag_does_not_fit(self):
        self.check('make_demo_bag', '--seconds', '5', os.path.join(self.disk, 'out.bag'))

    def test_the_matched_bag_does_not_fit(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        bag = os.path.join(folder.name, 'in.bag')
        subprocess.check_call([str(TOOLS / 'make_demo_bag'), '--seconds', '1', bag],
                              stderr=subprocess.DEVNULL)
        self.check('ktgp_bag', bag, os.path.join(self.disk, 'out.bag'))

    def test_a_batch_stops_and_names_what_is_missing(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        names = [os.path.join(folder.name, '%d.bag' % i) for i in range(5)]
        for name, seconds in zip(names, ('0.2', '0.2', '3', '0.2', '0.2')):
            subprocess.check_call([str(TOOLS / 'make_demo_bag'), '--seconds', seconds, name],
                                  stderr=subprocess.DEVNULL)
        with open(os.path.join(folder.name, 'list'), 'w') as file:
            file.write('\n'.join(names))
        command = [str(TOOLS / 'ktgp_bag'), '--batch', file.name, os.path.join(self.disk, 'out'), '--jobs',
                   '1', '--features', '300', '--csv', 'matched.csv']
        self.addCleanup(shutil.rmtree, os.path.join(self.disk, 'out'), ignore_errors=True)
        for extra in ([], ['--stabilize', 'steady.mp4']):
            done = subprocess.run(command + extra, stderr=subprocess.PIPE, universal_newlines=True, check=False)
            self.assertEqual(done.returncode, 2, done.stderr)
            self.assertIn('No space left on device; 3 recordings are missing, the first is row 3, %s' % names[2],
                          done.stderr)
            self.assertIn('5 recordings: 2 done', done.stderr)
            left = [name for _, _, files in os.walk(self.disk) for name in files]
            self.assertEqual(sorted(set(left) - {'summary.csv'}), sorted(
                {'matched.bag', 'matched.csv', 'manifest.json'} | ({'steady.mp4'} if extra else set())))


if __name__ == '__main__':
    unittest.main()
