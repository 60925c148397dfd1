"""A disk of half a megabyte: the programs report that it is full and leave no file."""
import os
import pathlib
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


if __name__ == '__main__':
    unittest.main()
