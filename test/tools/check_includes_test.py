"""dev/check_includes: passes the repository and finds each kind of wrong include."""
import pathlib
import shutil

from tool_case import FolderCase

ROOT = pathlib.Path(__file__).resolve().parents[2]


class CheckIncludes(FolderCase):
    def setUp(self):
        super().setUp()
        for folder in ('src', 'research', 'include'):
            shutil.copytree(ROOT / folder, self.folder / folder)

    def check(self, root=None, **expected):
        self.run_program(ROOT / 'dev/check_includes', root or self.folder, **expected)

    def expect(self, included, where, words):
        """Checks that an include added to a file is found and named."""
        path = self.folder / where
        text = path.read_text()
        path.write_text('#include %s\n%s' % (included, text))
        self.check(code=1, prints=(included.strip('"<>'), words))
        path.write_text(text)

    def test_the_repository_is_in_order(self):
        self.check(ROOT)

    def test_nothing_includes_the_nodelet(self):
        for where in ('src/tools/ktgp_bag.cpp', 'research/demo/demo_report.cpp',
                      'research/evaluation/ktgp_evaluate.cpp', 'src/ros/configuration.cpp',
                      'src/matching/ktgp_matcher.cpp'):
            self.expect('"nodelet/parameters.h"', where, 'may not include nodelet')

    def test_the_core_knows_no_ros_and_nothing_above_it(self):
        core = 'src/matching/knn/matcher.cpp'
        self.expect('<ros/ros.h>', core, 'no ROS here')
        self.expect('<sensor_msgs/Image.h>', 'include/ktgp_orb/features.h', 'no ROS here')
        self.expect('<ktgp_orb/KtgpConfig.h>', 'src/sequence/sequence_matcher.cpp',
                    'no ROS here')
        self.expect('"ros/configuration.h"', core, 'may not include ros')
        self.expect('"ktgp_orb/ktgp_matcher.h"', core, 'matching/knn may not include matching')
        self.expect('<ktgp_orb/sequence_matcher.h>', 'src/matching/ktgp_matcher.cpp',
                    'matching may not include sequence')

    def test_the_stages_make_no_circle(self):
        (self.folder / 'src/matching/knn/a.h').write_text('#include "matching/gms/b.h"\n')
        (self.folder / 'src/matching/gms/b.h').write_text('')
        self.check()
        (self.folder / 'src/matching/gms/b.h').write_text('#include "matching/knn/a.h"\n')
        self.check(code=1, prints='matching/gms -> matching/knn -> matching/gms')

    def test_paths_are_given_from_src(self):
        self.expect('"frames.h"', 'src/sequence/sequence_matcher.cpp', 'no such file')

    def test_an_unknown_folder_is_named(self):
        (self.folder / 'src/elsewhere').mkdir()
        (self.folder / 'src/elsewhere/a.cpp').write_text('#include <vector>\n')
        self.check(code=1, prints='elsewhere')
