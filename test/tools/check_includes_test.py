"""dev/check_includes: passes the repository and finds each kind of wrong include."""
import pathlib
import shutil
import subprocess
import tempfile
import unittest

ROOT = pathlib.Path(__file__).resolve().parents[2]


def check(root):
    return subprocess.run([str(ROOT / 'dev/check_includes'), str(root)],
                          stdout=subprocess.PIPE, universal_newlines=True)


class CheckIncludes(unittest.TestCase):
    def setUp(self):
        self.root = pathlib.Path(tempfile.mkdtemp())
        self.addCleanup(shutil.rmtree, self.root)
        for folder in ('src', 'include'):
            shutil.copytree(ROOT / folder, self.root / folder)

    def expect(self, included, where, words):
        """Checks that an include added to a file is found and named."""
        path = self.root / where
        text = path.read_text()
        path.write_text('#include %s\n%s' % (included, text))
        answer = check(self.root)
        path.write_text(text)
        self.assertEqual(answer.returncode, 1, '%s in %s' % (included, where))
        self.assertIn(included.strip('"<>'), answer.stdout)
        self.assertIn(words, answer.stdout)

    def test_the_repository_is_in_order(self):
        answer = check(ROOT)
        self.assertEqual(answer.returncode, 0, answer.stdout)

    def test_nothing_includes_the_nodelet(self):
        for where in ('src/tools/ktgp_bag.cpp', 'src/demo/demo_report.cpp',
                      'src/evaluation/ktgp_evaluate.cpp', 'src/messages/configuration.cpp',
                      'src/core/ktgp_matcher.cpp'):
            self.expect('"nodelet/parameters.h"', where, 'may not include nodelet')

    def test_the_core_knows_no_ros_and_nothing_above_it(self):
        core = 'src/core/knn/matcher.cpp'
        self.expect('<ros/ros.h>', core, 'no ROS here')
        self.expect('<sensor_msgs/Image.h>', 'include/ktgp_orb/features.h', 'no ROS here')
        self.expect('<ktgp_orb/KtgpConfig.h>', 'src/core/sequence/sequence_matcher.cpp',
                    'no ROS here')
        self.expect('"messages/configuration.h"', core, 'may not include messages')
        self.expect('"ktgp_orb/ktgp_matcher.h"', core, 'core/knn may not include core')
        self.expect('<ktgp_orb/sequence_matcher.h>', 'src/core/ktgp_matcher.cpp',
                    'core may not include core/sequence')

    def test_the_stages_make_no_circle(self):
        (self.root / 'src/core/knn/a.h').write_text('#include "core/gms/b.h"\n')
        (self.root / 'src/core/gms/b.h').write_text('')
        self.assertEqual(check(self.root).returncode, 0)
        (self.root / 'src/core/gms/b.h').write_text('#include "core/knn/a.h"\n')
        answer = check(self.root)
        self.assertEqual(answer.returncode, 1)
        self.assertIn('core/gms -> core/knn -> core/gms', answer.stdout)

    def test_paths_are_given_from_src(self):
        self.expect('"frame_pool.h"', 'src/core/sequence/sequence_matcher.cpp', 'no such file')

    def test_an_unknown_folder_is_named(self):
        (self.root / 'src/elsewhere').mkdir()
        (self.root / 'src/elsewhere/a.cpp').write_text('#include <vector>\n')
        answer = check(self.root)
        self.assertEqual(answer.returncode, 1)
        self.assertIn('elsewhere', answer.stdout)


if __name__ == '__main__':
    unittest.main()
