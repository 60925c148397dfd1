#!/usr/bin/python3
"""Runs every command of README.md and doc/ in a clean clone, with small data.

Commands are the indented lines, and spans between backticks that begin like a command. Each one has a row
in COMMANDS: how it is run here, or the reason why it is not. The clone has the build of this test in
out/release, as after scripts/test."""

import concurrent.futures
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import unittest

import cv2
import rosbag
import rospy
from sensor_msgs.msg import CameraInfo

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from ktgp_testing import TIMEOUT, image_message, view
from ports import free_port

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
BUILD = os.environ['KTGP_ORB_BUILD']
FIRST_WORDS = ('cmake', 'catkin', 'catkin_make', 'catkin_test_results', 'git', 'rosbag', 'roslaunch',
               'rosparam', 'rosrun', 'rosservice', 'rostest', 'rostopic', 'source', 'sudo')


class Skipped(str):
    """Why a command is not run here."""


class Until(str):
    """A command that does not end by itself; it is ended when it prints `text`."""

    def __new__(cls, command, text):
        made = super().__new__(cls, command)
        made.text = text
        return made


IN_CI = Skipped('a part of continuous integration, for minutes')
TOO_LONG = Skipped('takes minutes to hours')
BENCHMARKS = Skipped('builds the benchmark programs, which takes minutes; then a row takes seconds')
WORKSPACE = Skipped('dev/check_workspace runs it in a workspace of its own, in CI')
SOURCED = Skipped('every command here runs after it')
WINDOW = Skipped('opens rviz; the test "launch_run" runs it with a stand-in')
MATCHER = 'matches images on /camera/image_raw'
SMALL = ' --features 300 --repeat 1'
# The estimator of these methods needs OpenCV 4.6.
PEERS = ',SIFT,AKAZE,FLOW' if tuple(map(int, cv2.__version__.split('.')[:2])) >= (4, 6) else ''

COMMANDS = {
    'git clone <this repository> ktgp_orb && cd ktgp_orb': Skipped('this is such a clone'),
    'scripts/demo': Skipped('the test "demo" runs it'),
    'scripts/test': Skipped('runs this test'),
    'scripts/test -R robot_': Skipped('runs tests of which this is one'),
    'scripts/bench': BENCHMARKS,
    'scripts/bench --benchmark_filter=align': BENCHMARKS,
    'scripts/bench --compare OLD.json NEW.json':
        'scripts/bench --compare old/benchmarks.json new/benchmarks.json',
    'scripts/bench --benchmark_filter=preset': BENCHMARKS,
    'KTGP_ORB_DAMAGES=200000 test/core/hostile_bag_test': TOO_LONG,
    'rosbag reindex': Skipped('for a damaged bag; rosbag\'s own'),
    'rosparam delete /use_sim_time': Skipped('for a master that has it; rosparam\'s own'),
    'dev/check': IN_CI,
    'dev/check_arm64': TOO_LONG,
    'dev/check_arm64 --fast': TOO_LONG,
    'dev/check_arm64 knn_matcher_test': TOO_LONG,
    'dev/check_includes': 'dev/check_includes',
    'test/long/stabilization.py': TOO_LONG,
    'examples/python/match_and_track.py first.png second.png --video my.mp4 --plot inliers.png':
        'examples/python/match_and_track.py first.png second.png --video my.mp4 --plot inliers.png',
    'scripts/test -L long -R motion': TOO_LONG,
    'dev/check_platform bullseye': TOO_LONG,
    'dev/check_platform bookworm': IN_CI,
    'dev/check_workspace': IN_CI,
    'sudo dev/check_platform bookworm': IN_CI,
    'sudo dev/package bookworm': TOO_LONG,
    'sudo dev/package trixie': TOO_LONG,
    'sudo apt install ./build/packages/bookworm/*.deb': Skipped('dev/package does it in a bare root'),
    'scripts/evaluate':
        'scripts/evaluate --built out/release --data sets --output report --methods ORB,KTGP '
        '--repeat 1 --warp-pairs 1',
    'scripts/evaluate --hpatches DIR':
        'scripts/evaluate --built out/release --hpatches sets --methods KTGP',
    'scripts/evaluate --data DIR':
        'scripts/evaluate --built out/release --data sets --methods KTGP --repeat 1 --warp-pairs 0 '
        '--output one_method',
    'dev/fuzz': TOO_LONG,
    'dev/fuzz gms 600': TOO_LONG,
    'dev/fuzz gms FILE': Skipped('needs an input that a fuzz target has found'),
    'dev/mutate': TOO_LONG,
    'dev/mutate --refresh': TOO_LONG,
    'dev/mutate --refresh 15 1': TOO_LONG,
    'scripts/evaluate --targets FOLDER': TOO_LONG,
    'scripts/evaluate --motion BAG': TOO_LONG,
    'scripts/setup test': Skipped('installs the packages of the tests'),
    'dev/mutate core/gms': TOO_LONG,
    'dev/sanitize': IN_CI,
    'dev/sanitize thread': IN_CI,
    'dev/sanitize address': IN_CI,
    'dev/sanitize thread full': TOO_LONG,
    'scripts/test -L long': TOO_LONG,
    'scripts/test -L long -R latency': TOO_LONG,
    'scripts/test -L long -R lost_target': TOO_LONG,
    'scripts/test -L long -R faults': TOO_LONG,
    'scripts/test -L long -R verdict': TOO_LONG,
    'scripts/test -L long -R targets': TOO_LONG,
    'scripts/test -L long -R long_flood': TOO_LONG,
    'test/long/flood_test.py SECONDS': TOO_LONG,
    'scripts/test -L long -R long_soak': IN_CI,
    'KTGP_ORB_SOAK_FRAMES=1000000 scripts/test -L long -R long_soak': TOO_LONG,
    'scripts/test -L long -R targets_soak': TOO_LONG,
    'dev/nightly': TOO_LONG,
    'ktgp_evaluate homogr evd dogman notredame --longest-side 1200 --methods '
    'ROBUST-GROWTH,ROBUST,HARD,HARD-VIEWS,SIFT,AKAZE': TOO_LONG,
    'ktgp_evaluate --warps extreme --warp-pairs 480 IMAGES --methods '
    'ROBUST-GROWTH,ROBUST,HARD,HARD-VIEWS,SIFT,AKAZE': TOO_LONG,
    'rostopic echo /usb_cam/matcher/homography': Skipped('waits for images; rostopic\'s own'),
    'sudo apt install rviz': Skipped('installs a package'),
    'sudo apt install ros-noetic-usb-cam': Skipped('Ubuntu\'s package of the driver'),
    'rosrun usb_cam usb_cam_node _video_device:=/dev/video0': Skipped('needs a camera'),
    'rosparam set use_sim_time false': Skipped('for a master that has it; rosparam\'s own'),
    'rostopic echo -n 1 ~mask/encoding': Skipped('waits for a mask; rostopic\'s own'),
    'rostopic echo /diagnostics': Skipped('waits for diagnostics; rostopic\'s own'),
    'source out/release/devel/setup.bash': SOURCED,
    'source devel/setup.bash': SOURCED,
    'catkin_make': WORKSPACE,
    'catkin build': Skipped('as catkin_make; Debian has no catkin_tools'),
    'catkin_make run_tests': WORKSPACE,
    'catkin_make -j4 run_tests': WORKSPACE,
    'catkin_test_results build/test_results': WORKSPACE,
    'rostest test/ros/robot_overload.test seconds:=120': TOO_LONG,
    'scripts/evaluate --motion checkerboard.bag --drift 3 6 8':
        Skipped('needs a recording with its truth in tf'),
    'cmake -DKTGP_ORB_CORE_ONLY=ON':
        'cmake -DKTGP_ORB_CORE_ONLY=ON -S . -B build/core_only ${KTGP_ORB_CMAKE_OPTIONS:-}',
    'roslaunch ktgp_orb matcher.launch namespace:=camera image:=image_raw preset:=video':
        Until('roslaunch ktgp_orb matcher.launch namespace:=camera image:=image_raw preset:=video', MATCHER),
    'roslaunch ktgp_orb matcher.launch namespace:=usb_cam image:=image_raw preset:=video':
        Until('roslaunch ktgp_orb matcher.launch namespace:=usb_cam image:=image_raw preset:=video',
              'matches images on /usb_cam/image_raw'),
    'roslaunch ktgp_orb multi_camera.launch cameras:="front left right"':
        Until('roslaunch ktgp_orb multi_camera.launch cameras:="front left right"',
              'matches images on /right/image_raw'),
    'roslaunch --ros-args ktgp_orb matcher.launch': 'roslaunch --ros-args ktgp_orb matcher.launch',
    'roslaunch ktgp_orb matcher.launch': Until('roslaunch ktgp_orb matcher.launch', MATCHER),
    'roslaunch ktgp_orb stabilizer.launch':
        Until('roslaunch ktgp_orb stabilizer.launch', 'takes images on /camera/image_raw'),
    'roslaunch ktgp_orb mosaic.launch':
        Until('roslaunch ktgp_orb mosaic.launch', 'takes images on /camera/image_raw'),
    'roslaunch ktgp_orb matcher.launch set:="{reference_mode: previous, guided: true, gms_grid: 0}"':
        Until('roslaunch ktgp_orb matcher.launch '
              'set:="{reference_mode: previous, guided: true, gms_grid: 0}"', MATCHER),
    'roslaunch ktgp_orb ground_motion.launch set:="{height_source: parameter, height: 0.31}"':
        Until('roslaunch ktgp_orb ground_motion.launch set:="{height_source: parameter, height: 0.31}"',
              'takes matches on /camera/matcher/match'),
    'roslaunch ktgp_orb targets.launch targets:="$PWD/posters"':
        Until('mkdir -p posters && cp first.png posters/ && roslaunch ktgp_orb targets.launch '
              'targets:="$PWD/posters"', 'known targets: 1'),
    'rostopic echo /camera/targets/detections': Skipped('waits for images; rostopic\'s own'),
    'roslaunch ktgp_orb bag.launch bag:=my.bag topic:=/camera/image_raw':
        'roslaunch ktgp_orb bag.launch bag:=my.bag topic:=/camera/image_raw rviz:=false delay:=1',
    'roslaunch ktgp_orb tune.launch bag:=my.bag topic:=/camera/image_raw':
        Until('roslaunch ktgp_orb tune.launch bag:=my.bag topic:=/camera/image_raw rviz:=false',
              'rqt_plot is not installed'),
    'rosrun ktgp_orb sliders NODE': Skipped('opens a window; the test "sliders" does'),
    'roslaunch ktgp_orb rviz.launch namespace:=camera': WINDOW,
    'roslaunch ktgp_orb rviz.launch namespace:=usb_cam': WINDOW,
    'roslaunch ktgp_orb views.launch namespace:=camera':
        Until('roslaunch ktgp_orb views.launch namespace:=camera rviz:=false', 'takes images on /camera/image_raw'),
    'roslaunch ktgp_orb views.launch namespace:=usb_cam':
        Until('roslaunch ktgp_orb views.launch namespace:=usb_cam rviz:=false', 'takes images on /usb_cam/image_raw'),
    'roslaunch ktgp_orb ground_motion.launch':
        Until('roslaunch ktgp_orb ground_motion.launch', 'takes matches on /camera/matcher/match'),
    'roslaunch ktgp_orb matcher.launch set:="{reference_mode: fixed, reference_image: $PWD/poster.png}"':
        Until('roslaunch ktgp_orb matcher.launch set:="{reference_mode: fixed, '
              'reference_image: $PWD/poster.png}"', MATCHER),
    'roslaunch ktgp_orb demo.launch bag:=flight.bag targets:=signs/targets.yaml rviz:=true':
        Until('roslaunch ktgp_orb demo.launch bag:=flight.bag targets:=signs/targets.yaml', 'known targets: 3'),
    'rosrun ktgp_orb camera_motion match:=/camera/matcher/match':
        Until('{ roscore -p ${ROS_MASTER_URI##*:} >/dev/null 2>&1 & } && '
              'rosrun ktgp_orb camera_motion match:=/camera/matcher/match',
              'waits for /camera/matcher/match; no node publishes it'),

    'rosrun ktgp_orb ktgp_bag my.bag matched.bag --targets targets.yaml':
        "echo '- {id: place, image: first.png}' > targets.yaml && "
        'rosrun ktgp_orb ktgp_bag my.bag with_targets.bag --targets targets.yaml',
    'rosrun ktgp_orb ktgp_find photo.png posters':
        'mkdir -p posters && cp first.png posters/ && rosrun ktgp_orb ktgp_find second.png posters',
    'rosrun ktgp_orb ktgp_find photo.png targets.yaml --draw found.png --json found.json':
        "echo '- {id: place, image: first.png}' > targets.yaml && "
        'rosrun ktgp_orb ktgp_find second.png targets.yaml --draw found.png --json found.json',
    'rosrun ktgp_orb ktgp_match first.png second.png --draw matches.png':
        'rosrun ktgp_orb ktgp_match first.png second.png --draw matches.png',
    'rosrun ktgp_orb ktgp_evaluate --two-view kitti_2 --apart 1,3,6':
        Skipped('needs a recording with known cameras; the test of ktgp_evaluate has one'),
    'rosrun ktgp_orb ktgp_evaluate --two-view fountain-P11 Herz-Jesus-P25 --apart 1,2 --descriptor teblid '
    '--features 3000 --fast_threshold 10':
        Skipped('needs pictures with known cameras'),
    'rosrun ktgp_orb ktgp_bag my.bag matched.bag --csv matched.csv --start 10 --duration 60':
        'rosrun ktgp_orb ktgp_bag my.bag matched.bag --csv matched.csv --start 0.1 --duration 60',
    'rosrun ktgp_orb ktgp_bag my.bag matched.bag --csv matched.csv':
        'rosrun ktgp_orb ktgp_bag my.bag with_table.bag --csv with_table.csv',
    'rosrun ktgp_orb ktgp_bag my.mp4 matched.bag --csv -':
        'rosrun ktgp_orb ktgp_bag my.mp4 matched_video.bag --csv -',
    "rosrun ktgp_orb ktgp_bag 'images/*.png' matched.bag --rate 10":
        "rosrun ktgp_orb ktgp_bag 'sets/leuven/*.ppm' matched_images.bag --rate 10",
    "rosrun ktgp_orb ktgp_bag 'flight/*.jpg' matched.bag --rate 0.5 --longest_side 1000 --preset photo "
    "--mosaic map.png":
        "rosrun ktgp_orb ktgp_bag 'sets/leuven/*.ppm' photographs.bag --rate 0.5 --longest_side 300 --preset photo "
        "--mosaic photographs.png",
    "xargs -d '\\n' -P 4 -I {} examples/fleet/one_recording.sh {} results --csv matched.csv --threads 1 <list.txt":
        "xargs -d '\\n' -P 4 -I {} examples/fleet/one_recording.sh {} results --csv matched.csv --threads 1 <list.txt",
    'parallel -q -j 4 --joblog jobs.log examples/fleet/one_recording.sh {} results --csv matched.csv --threads 1 '
    ':::: list.txt': Skipped('needs GNU parallel; the test "recordings" runs it where it is installed'),
    'sbatch --array=1-40 --requeue --wrap \'examples/fleet/one_recording.sh "$(sed -n ${SLURM_ARRAY_TASK_ID}p list.txt)" '
    "results --csv matched.csv'": Skipped('needs a cluster with Slurm'),
    'rosrun ktgp_orb ktgp_bag my.bag matched.bag --stabilize steady.mp4 --mosaic map.png':
        'rosrun ktgp_orb ktgp_bag my.bag with_views.bag --stabilize steady.mp4 --mosaic map.png',
    'rosrun ktgp_orb make_demo_bag demo.bag':
        'rosrun ktgp_orb make_demo_bag demo.bag --seconds 0.3',
    'rosrun ktgp_orb ktgp_bag demo.bag matched.bag --reference_mode keyframe --guided true --motion motion.csv '
    '--motion_base_frame= --motion_normal_source imu':
        'rosrun ktgp_orb ktgp_bag demo.bag with_motion.bag --reference_mode keyframe --guided true '
        '--motion motion.csv --motion_base_frame= --motion_normal_source imu',
    'rosrun ktgp_orb make_demo_bag flight.bag --targets signs':
        'rosrun ktgp_orb make_demo_bag flight.bag --targets signs --seconds 0.3',
    'rosrun ktgp_orb ktgp_evaluate_bag demo.bag': 'rosrun ktgp_orb ktgp_evaluate_bag demo.bag',
    'rosrun ktgp_orb ktgp_evaluate_bag demo.bag --preset robust':
        'rosrun ktgp_orb ktgp_evaluate_bag demo.bag --preset robust',
    'rosrun ktgp_orb ktgp_evaluate --warps small,medium,large oxford/leuven oxford/bikes oxford/boat '
    '--methods KTGP,KTGP+ALIGN,MUTUAL,ROBUST,ROBUST-TEBLID,SIFT,AKAZE,FLOW':
        'rosrun ktgp_orb ktgp_evaluate --warps small,medium,large sets/leuven --warp-pairs 2 '
        '--methods KTGP,KTGP+ALIGN,MUTUAL,ROBUST,ROBUST-TEBLID' + PEERS + SMALL,
    'rosrun ktgp_orb ktgp_evaluate oxford/leuven oxford/bikes oxford/boat '
    '--methods KTGP,KTGP+ALIGN,ROBUST,ROBUST-TEBLID':
        'rosrun ktgp_orb ktgp_evaluate sets/leuven --methods KTGP,KTGP+ALIGN,ROBUST,ROBUST-TEBLID' +
        SMALL,
    'rosrun ktgp_orb ktgp_evaluate oxford/leuven oxford/bikes oxford/boat '
    '--methods ROBUST,ROBUST-TEBLID --alignment=false':
        'rosrun ktgp_orb ktgp_evaluate sets/leuven --methods ROBUST,ROBUST-TEBLID '
        '--alignment=false' + SMALL,
}
# Named in the text, not written out.
ALSO = ['dev/update_documents --check', 'scripts/evaluate --help', 'scripts/bench --help',
        'scripts/setup --list debian build test rqt', 'scripts/setup --list noetic core',
        'scripts/bench --merge old raw.json', 'scripts/bench --merge new raw.json']
# Others need these results.
FIRST = [command for command in COMMANDS.values() if 'make_demo_bag' in command] + [
    command for command in ALSO if 'raw.json' in command]


def commands_of(text):
    """The commands of a Markdown text, without comments, long lines joined."""
    text = re.sub(r'^```.*?^```', '', text, flags=re.M | re.S)
    found = []
    lines = iter(text.split('\n'))
    for line in lines:
        if not line.startswith('    ') or line.strip().startswith('<'):
            continue
        while line.endswith('\\'):
            line = line[:-1].rstrip() + ' ' + next(lines).strip()
        found.append(re.sub(r'\s+#.*', '', line).strip())
    for span in re.findall(r'`([^`\n]+)`', text):
        word = span.split()[0]
        if word in FIRST_WORDS and len(span.split()) > 1 or re.match(r'(scripts|dev)/\w+$', word) or \
                span == 'catkin_make':
            found.append(span)
    helpers = ('scripts/environment', 'scripts/setup', 'dev/update_documents')
    return [command for command in found if command and command not in helpers]


def documents():
    yield os.path.join(ROOT, 'README.md')
    for folder, _, names in os.walk(os.path.join(ROOT, 'doc')):
        for name in sorted(names):
            if name.endswith('.md'):
                yield os.path.join(folder, name)


def copy_sources(to):
    """Copies the files of a clone, and those not yet committed."""
    if os.path.exists(os.path.join(ROOT, '.git')):
        names = subprocess.check_output(
            ['git', '-c', 'safe.directory=*', 'ls-files', '-z', '--cached', '--others',
             '--exclude-standard'], cwd=ROOT, universal_newlines=True).split('\0')
    else:
        names = [os.path.relpath(os.path.join(folder, name), ROOT)
                 for folder, _, files in os.walk(ROOT) for name in files]
    for name in names:
        source = os.path.join(ROOT, name)
        if os.path.isfile(source):
            os.makedirs(os.path.dirname(os.path.join(to, name)), exist_ok=True)
            shutil.copy2(source, os.path.join(to, name))


def copy_build(to, clone):
    """Makes the devel space of this build that of the clone."""
    os.makedirs(to)
    devel = os.path.join(to, 'devel')
    subprocess.run(['cp', '-rs', os.path.join(BUILD, 'devel'), devel], check=True)
    with open(os.path.join(BUILD, 'devel', '.catkin')) as file:
        places = file.read().split(';')
    os.remove(os.path.join(devel, '.catkin'))
    with open(os.path.join(devel, '.catkin'), 'w') as file:
        file.write(';'.join(clone if ROOT == place or ROOT.startswith(place + '/') else place
                            for place in places))


def write_inputs(folder):
    def path(*names):
        return os.path.join(folder, *names)
    with rosbag.Bag(path('my.bag'), 'w') as bag:
        for i in range(6):
            stamp = rospy.Time.from_sec(1000 + 0.1 * i)
            image = image_message(view(100 + 5 * i, 100, 320, 240), stamp)
            bag.write('/camera/image_raw', image, stamp)
            info = CameraInfo(header=image.header, width=320, height=240, distortion_model='plumb_bob',
                              D=[0.0] * 5)
            info.K = [300, 0, 160, 0, 300, 120, 0, 0, 1]
            bag.write('/camera/camera_info', info, stamp)
    for name, x in (('first.png', 100), ('second.png', 110), ('poster.png', 100)):
        cv2.imwrite(path(name), view(x, 100, 320, 240))
    video = cv2.VideoWriter(path('my.mp4'), cv2.VideoWriter_fourcc(*'mp4v'), 30.0, (320, 240))
    for i in range(4):
        video.write(cv2.cvtColor(view(100 + 5 * i, 100, 320, 240), cv2.COLOR_GRAY2BGR))
    video.release()
    with open(path('list.txt'), 'w') as file:
        file.write('my.bag\n')
    for name in ('leuven', 'bikes'):
        os.makedirs(path('sets', name))
        for k in range(1, 7):
            cv2.imwrite(path('sets', name, 'img%d.ppm' % k), cv2.cvtColor(
                view(100 + 5 * k, 100, 320, 240), cv2.COLOR_GRAY2BGR))
            with open(path('sets', name, 'H1to%dp' % k), 'w') as file:
                file.write('1 0 %d\n0 1 0\n0 0 1\n' % (5 - 5 * k))
    os.mkdir(path('old'))
    os.mkdir(path('new'))
    with open(path('raw.json'), 'w') as file:
        file.write('{"context": {"date": "2026-01-01"}, "benchmarks": [' + ', '.join(
            '{"name": "knn/2000", "run_name": "knn/2000", "run_type": "iteration", "real_time": %s, '
            '"cpu_time": 1.0, "time_unit": "ms", "iterations": 1}' % time for time in (1.0, 1.01)) + ']}')


class CommandsTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory(prefix='ktgp_orb ')
        cls.addClassCleanup(folder.cleanup)
        cls.clone = os.path.join(folder.name, 'ktgp_orb')
        copy_sources(cls.clone)
        copy_build(os.path.join(cls.clone, 'out', 'release'), cls.clone)
        write_inputs(cls.clone)
        cls.home = os.path.join(folder.name, 'home')

    def shell(self, command):
        """Starts a command in the clone, in a user's shell after source ...setup.bash."""
        environment = {name: value for name, value in os.environ.items()
                       if name not in ('DISPLAY', 'ROS_PACKAGE_PATH', 'CMAKE_PREFIX_PATH', 'PYTHONPATH',
                                       'LD_LIBRARY_PATH', 'ROS_MASTER_URI')}
        environment.update(PATH='/usr/bin:' + os.environ['PATH'], ROS_HOSTNAME='localhost',
                           ROS_HOME=self.home, PWD=self.clone, PYTHONUNBUFFERED='1',
                           ROSCONSOLE_STDOUT_LINE_BUFFERED='1',
                           ROS_MASTER_URI='http://localhost:%d' % free_port())
        return subprocess.Popen(
            ['timeout', '--signal=INT', '--kill-after=60', str(int(TIMEOUT)), 'bash', '-c',
             'source out/release/devel/setup.bash && ' + command], cwd=self.clone,
            env=environment, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT, universal_newlines=True, start_new_session=True)

    def run_one(self, command):
        """The output of a command that failed; empty if it succeeded."""
        process = self.shell(command)
        if not isinstance(command, Until):
            output = process.communicate()[0]
            return '' if process.returncode == 0 else '%d: %s' % (process.returncode, output)
        output = ''
        for line in process.stdout:
            output += line
            if command.text in line:
                break
        os.killpg(process.pid, signal.SIGINT)
        output += process.communicate()[0]
        return '' if command.text in output else 'it does not say "%s": %s' % (command.text, output)

    def run_all(self, commands):
        with concurrent.futures.ThreadPoolExecutor(4) as pool:
            results = dict(zip(commands, pool.map(self.run_one, commands)))
        failed = {c: r for c, r in results.items() if r}
        self.assertFalse(failed, '\n'.join('%s\n%s' % item for item in failed.items()))

    def test_every_command_of_the_documents_is_known(self):
        found = set()
        for path in documents():
            with open(path, encoding='utf-8') as file:
                found.update(commands_of(file.read()))
        self.assertEqual(sorted(found - set(COMMANDS)), [], 'say how each is run, or why not')
        self.assertEqual(sorted(set(COMMANDS) - found), [], 'no document has them any more')

    def test_every_command_works(self):
        commands = [c for c in COMMANDS.values() if not isinstance(c, Skipped)] + ALSO
        self.run_all(FIRST)
        self.run_all([c for c in commands if c not in FIRST])
        for name in ('report/index.html', 'one_method/report.md', 'matches.png', 'matched.csv', 'map.png',
                     'new/benchmarks.md'):
            self.assertTrue(os.path.exists(os.path.join(self.clone, name)), name)
        with open(os.path.join(self.clone, 'one_method', 'report.md')) as file:
            self.assertIn('not measured: ORB, KT, KTG', file.read())
        self.check_the_folder_of_the_programs()

    def check_the_folder_of_the_programs(self):
        """scripts/evaluate expects both programs in one folder."""
        folder = os.path.join(self.clone, 'build', 'core_only')
        links = [os.path.join(root, 'link.txt') for root, _, files in os.walk(folder)
                 if 'link.txt' in files]
        folders = set()
        for link in links:
            program = os.path.basename(os.path.dirname(link)).split('.')[0]
            if program in ('ktgp_match', 'ktgp_evaluate'):
                with open(link) as file:
                    output = re.search(r' -o (\S+)', file.read()).group(1)
                start = os.path.dirname(os.path.dirname(os.path.dirname(link)))
                folders.add(os.path.dirname(os.path.normpath(os.path.join(start, output))))
        self.assertEqual(folders, {os.path.join(folder, 'bin')})

    def test_rosrun_finds_one_program_after_every_script(self):
        program = os.path.join(BUILD, 'devel', 'lib', 'ktgp_orb', 'ktgp_match')
        scripts = [os.path.join(self.clone, folder, name) for folder in ('scripts', 'dev')
                   for name in sorted(os.listdir(os.path.join(self.clone, folder)))]
        for script in filter(os.path.isfile, scripts):
            with open(script, encoding='utf-8') as file:
                folders = re.findall(r"(?:\$root/|ROOT, '|ROOT / .|folder=)((?:out|build)/[\w$]+)", file.read())
            for folder in folders:
                if folder == 'out/release':
                    continue
                place = os.path.join(self.clone, folder.replace('$kind', 'thread'), 'bin')
                os.makedirs(place, exist_ok=True)
                shutil.copy2(program, place)
        self.assertGreater(len(os.listdir(os.path.join(self.clone, 'build'))), 5)
        self.assertEqual(self.run_one('rosrun ktgp_orb ktgp_match --version | grep ^ktgp_orb'), '')


if __name__ == '__main__':
    unittest.main()
