"""Runs every command of README.md and doc/ in a clean clone, with small data.

Commands are the indented lines, and spans between backticks that begin like a command. Of each is said
how it is run here, or the reason why it is not. The clone has the build of this test in
out/release, as after scripts/test."""

import concurrent.futures
import os
import re
import shutil
import signal
import subprocess
import tempfile
import unittest

import cv2
from sensor_msgs.msg import CameraInfo

from ktgp_testing import TIMEOUT, fake_package, free_port, view, views, write_bag

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
BUILD = os.environ['KTGP_ORB_BUILD']
FIRST_WORDS = ('cmake', 'catkin', 'catkin_make', 'catkin_test_results', 'git', 'rosbag', 'rosdep', 'roslaunch',
               'rosparam', 'rosrun', 'rosservice', 'rostest', 'rostopic', 'source', 'sudo')


class Run:
    """How a command is run here: with other words, and more of them at the end; what does not end by itself until it
    prints `until`."""

    def __init__(self, *changes, add='', before='', until=None):
        self.changes, self.add, self.before, self.until = changes, add, before, until

    def of(self, command):
        for old, new in self.changes:
            assert old in command, (old, command)
            command = command.replace(old, new)
        return self.before + command + self.add


def in_a_folder_of_its_own(*inputs, makes, **how):
    """With copies of the inputs, since the documents write several results to the same file; it makes these files."""
    how['before'] = 'cd "$(mktemp -d -p .)" && %s && ' % ' && '.join('cp ../%s .' % name for name in inputs)
    return Run(add=''.join(' && test -s ' + name for name in makes), **how)


AS_WRITTEN = Run()
MATCHER = Run(until='matches images on /camera/image_raw')
CONSUMER = Run(until='takes images on /camera/image_raw')
RVIZ = Run(until='process[rviz')  # a stand-in for it: see setUpClass
MOTION = Run(until='takes matches on /camera/matcher/match')
SMALL = ' --features 300 --repeat 1'
OXFORD = ('oxford/leuven oxford/bikes oxford/boat', 'sets/leuven')
# The estimator of these methods needs OpenCV 4.6.
PEERS = ',SIFT,AKAZE,FLOW' if tuple(map(int, cv2.__version__.split('.')[:2])) >= (4, 6) else ''
TARGETS = "echo '- {id: place, image: first.png}' > targets.yaml && "
BUILT = ' --built out/release'  # the first option of scripts/evaluate
POSTERS = 'mkdir -p posters && cp first.png posters/ && '

RUN = {
    'scripts/bench --compare OLD.json NEW.json':
        Run(('OLD', 'old/benchmarks'), ('NEW', 'new/benchmarks')),
    'dev/check_includes': AS_WRITTEN,
    'examples/python/match_and_track.py first.png second.png --video my.mp4 --plot inliers.png': AS_WRITTEN,
    'scripts/evaluate':
        Run(add=BUILT + ' --data sets --output report --methods ORB,KTGP --repeat 1 --warp-pairs 1'),
    'scripts/evaluate --hpatches DIR': Run(('evaluate', 'evaluate' + BUILT), ('DIR', 'sets'), add=' --methods KTGP'),
    'scripts/evaluate --data DIR':
        Run(('evaluate', 'evaluate' + BUILT), ('DIR', 'sets'),
            add=' --methods KTGP --repeat 1 --warp-pairs 0 --output one_method'),
    'cmake -DKTGP_ORB_CORE_ONLY=ON': Run(add=' -S . -B build/core_only ${KTGP_ORB_CMAKE_OPTIONS:-}'),
    'roslaunch ktgp_orb matcher.launch namespace:=camera image:=image_raw preset:=video': MATCHER,
    'roslaunch ktgp_orb matcher.launch namespace:=usb_cam image:=image_raw preset:=video':
        Run(until='matches images on /usb_cam/image_raw'),
    'roslaunch ktgp_orb multi_camera.launch cameras:="front left right"':
        Run(until='matches images on /right/image_raw'),
    'roslaunch --ros-args ktgp_orb matcher.launch': AS_WRITTEN,
    'roslaunch ktgp_orb matcher.launch': MATCHER,
    'roslaunch ktgp_orb stabilizer.launch': CONSUMER,
    'roslaunch ktgp_orb mosaic.launch': CONSUMER,
    'roslaunch ktgp_orb matcher.launch image:=image_rect set:="{reference_mode: previous, guided: true, gms_grid: 0}"':
        Run(until='matches images on /camera/image_rect'),
    'roslaunch ktgp_orb ground_motion.launch set:="{height_source: parameter, height: 0.31}"': MOTION,
    'roslaunch ktgp_orb targets.launch targets:=posters': Run(before=POSTERS, until='known targets: 1'),
    'roslaunch ktgp_orb bag.launch bag:=my.bag topic:=/camera/image_raw':
        Run(until='process has finished cleanly'),
    'roslaunch ktgp_orb tune.launch bag:=my.bag topic:=/camera/image_raw': Run(until='rqt_plot is not installed'),
    'roslaunch ktgp_orb views.launch namespace:=camera': CONSUMER,
    'roslaunch ktgp_orb views.launch namespace:=usb_cam': Run(until='takes images on /usb_cam/image_raw'),
    'roslaunch ktgp_orb rviz.launch namespace:=camera': RVIZ,
    'roslaunch ktgp_orb rviz.launch namespace:=usb_cam': RVIZ,
    'roslaunch ktgp_orb ground_motion.launch': MOTION,
    'roslaunch ktgp_orb matcher.launch set:="{reference_mode: fixed, reference_image: $PWD/poster.png}"': MATCHER,
    'roslaunch ktgp_orb demo.launch bag:=flight.bag targets:=signs/targets.yaml rviz:=true':
        Run(until='known targets: 3'),
    'rosrun ktgp_orb camera_motion match:=/camera/matcher/match':
        Run(before='{ roscore -p ${ROS_MASTER_URI##*:} >/dev/null 2>&1 & } && ',
            until='waits for /camera/matcher/match; no node publishes it'),
    'rosrun ktgp_orb ktgp_bag my.bag matched.bag --targets targets.yaml':
        Run(('matched', 'with_targets'), before=TARGETS),
    'rosrun ktgp_orb ktgp_find photo.png posters --draw found.png': Run(before=POSTERS, add=' && test -s found.png'),
    'rosrun ktgp_orb ktgp_find photo.png targets.yaml --camera 500,500,320,240 --json found.json':
        Run(('500,500,320,240', '300,300,160,120'), before=TARGETS),
    'rosrun ktgp_orb ktgp_match first.png second.png --draw matches.png': AS_WRITTEN,
    'rosrun ktgp_orb ktgp_bag my.bag matched.bag --csv matched.csv --start 10 --duration 60': Run(('10', '0.1')),
    'rosrun ktgp_orb ktgp_bag my.bag matched.bag --csv matched.csv':
        in_a_folder_of_its_own('my.bag', makes=['matched.bag', 'matched.csv']),
    'rosrun ktgp_orb ktgp_bag my.mp4 matched.bag --csv -': in_a_folder_of_its_own('my.mp4', makes=['matched.bag']),
    "rosrun ktgp_orb ktgp_bag 'images/*.png' matched.bag --rate 10":
        Run(('images/*.png', 'sets/leuven/*.ppm'), ('matched', 'matched_images')),
    "rosrun ktgp_orb ktgp_bag 'flight/*.jpg' matched.bag --rate 0.5 --longest_side 1000 --preset photo "
    "--reference_mode keyframe --mosaic map.png":
        Run(('flight/*.jpg', 'sets/leuven/*.ppm'), ('matched', 'photographs'), ('1000', '300'), ('map', 'photographs')),
    "xargs -d '\\n' -P 4 -I {} examples/fleet/one_recording.sh {} results --csv matched.csv --threads 1 <list.txt":
        AS_WRITTEN,
    'rosrun ktgp_orb ktgp_bag my.bag matched.bag --stabilize steady.mp4 --mosaic map.png':
        in_a_folder_of_its_own('my.bag', makes=['matched.bag', 'steady.mp4', 'map.png']),
    'rosrun ktgp_orb make_demo_bag demo.bag': Run(add=' --seconds 0.3'),
    'rosrun ktgp_orb ktgp_bag demo.bag matched.bag --reference_mode keyframe --guided true --motion motion.csv '
    '--motion_base_frame= --motion_normal_source imu':
        in_a_folder_of_its_own('demo.bag', makes=['matched.bag', 'motion.csv']),
    'rosrun ktgp_orb make_demo_bag flight.bag --targets signs': Run(add=' --seconds 0.3'),
    'rosrun ktgp_orb ktgp_evaluate_bag demo.bag': AS_WRITTEN,
    'rosrun ktgp_orb ktgp_evaluate_bag demo.bag --preset robust': AS_WRITTEN,
    'rosrun ktgp_orb ktgp_evaluate --warps small,medium,large oxford/leuven oxford/bikes oxford/boat '
    '--methods KTGP,KTGP+ALIGN,MUTUAL,ROBUST,ROBUST-TEBLID,SIFT,AKAZE,FLOW':
        Run(OXFORD, (',SIFT,AKAZE,FLOW', PEERS), add=' --warp-pairs 2' + SMALL),
    'rosrun ktgp_orb ktgp_evaluate oxford/leuven oxford/bikes oxford/boat '
    '--methods KTGP,KTGP+ALIGN,ROBUST,ROBUST-TEBLID': Run(OXFORD, add=SMALL),
    'rosrun ktgp_orb ktgp_evaluate oxford/leuven oxford/bikes oxford/boat '
    '--methods ROBUST,ROBUST-TEBLID --alignment=false': Run(OXFORD, add=SMALL),
}
# Why the others are not run here. As in a shell, a{,b,c} is three of them.
NOT_RUN = {
    'a part of continuous integration, for minutes': [
        'dev/check', '{sudo ,}dev/check_platform bookworm',
        'scripts/test -L long -R long_soak', 'rostest test/ros/stream.test name:=lazy program:=lazy_test'],
    'takes minutes to hours': [
        'KTGP_ORB_DAMAGES=200000 test/ros_tests --file=hostile_bag_test', 'scripts/test -L long -R mosaic',
        'dev/check_arm64{, --fast, --rest, knn_matcher_test}',
        'benchmark/stabilization.py', 'test/long/flood_test.py SECONDS', 'dev/check_platform bullseye',
        'dev/check_workspace', 'dev/sanitize{, thread, address, thread full}', 'sudo dev/package {bookworm,trixie}',
        'dev/fuzz{, gms 600}', 'dev/nightly{, fuzz latency, --list}',
        'dev/mutate{, --refresh, --refresh 15 1, matching/gms}', 'scripts/evaluate --{targets FOLDER,motion BAG}',
        'scripts/test -L long{, -R {motion,faults,verdict,long_flood,long_pages,targets_soak}}',
        'KTGP_ORB_SOAK_FRAMES=1000000 scripts/test -L long -R long_soak',
        'rostest test/ros/program.test name:=robot_overload args:=--seconds=120',
        'ktgp_evaluate {homogr evd dogman notredame --longest-side 1200,--warps extreme --warp-pairs 480 IMAGES} '
        '--methods ROBUST-GROWTH\\,ROBUST\\,HARD\\,HARD-VIEWS\\,SIFT\\,AKAZE'],
    'builds the benchmark programs, which takes minutes; then a row takes seconds': [
        'scripts/bench{, --benchmark_filter=align, --benchmark_filter=preset, --avx2}',
        'build/bench/bin/targets_accuracy {recall 300 30 10 100 1000,following 1000 600 5000 0}'],
    'dev/check_workspace runs it, with options, in a workspace of its own': [
        'catkin_make{, run_tests, -j4 run_tests}', 'catkin build', 'catkin_test_results build/test_results'],
    'every command here runs after it': ['source {out/release/,}devel/setup.bash'],
    'dev/check runs it, where Doxygen is': ['cmake --build BUILD --target doc'],
    'this is such a clone': ['git clone <this repository> ktgp_orb && cd ktgp_orb'],
    'runs this test': ['scripts/test{, --full, -R robot_}'],
    'another test does: demo, sliders, recordings, ktgp_evaluate_test': [
        'scripts/demo', 'rosrun ktgp_orb sliders {NODE,/camera/matcher}',
        'parallel -q -j 4 --joblog jobs.log examples/fleet/one_recording.sh {} results --csv matched.csv --threads 1 '
        ':::: list.txt', 'rosrun ktgp_orb ktgp_evaluate --two-view kitti_2 --apart 1\\,3\\,6 --features 2000'],
    'a program of the reader; cmake_package builds it': ['rosrun print_motion print_motion'],
    'installs packages': [
        'rosdep install{, --from-paths src -i}', 'sudo apt install {./build/packages/bookworm/*.deb,rviz,ros-noetic-usb-cam}',
        'scripts/setup test', 'src/ktgp_orb/scripts/setup build'],
    'startup_test runs it': ['rostopic echo /usb_cam/matcher/homography'],
    "waits for images, or for a master that has it; ROS's own": [
        'rosparam {delete /use_sim_time,set use_sim_time false,dump tuned.yaml /camera/matcher}',
        'rosbag {reindex,filter}', 'rosrun dynamic_reconfigure dynparam set /camera/matcher T_w 0.7', 'rostopic echo -n 1 ~mask/encoding',
        'rostopic echo /{diagnostics,camera/targets/detections}'],
    'needs a camera, a recording, pictures with known cameras, an input of a fuzz target, or a cluster with Slurm': [
        'rosrun usb_cam usb_cam_node _video_device:=/dev/video0', 'dev/fuzz gms FILE',
        'scripts/evaluate --motion checkerboard.bag --drift 3 6 8',
        'rosrun ktgp_orb ktgp_evaluate --two-view FOLDER... --methods SLAM\\,SIFT+MAGSAC++ --features 2000',
        'rosrun ktgp_orb ktgp_evaluate --two-view fountain-P11 Herz-Jesus-P25 --apart 1\\,2 --descriptor teblid '
        '--features 3000 --fast_threshold 10',
        'sbatch --array=1-40 --requeue --wrap \'examples/fleet/one_recording.sh "$(sed -n ${SLURM_ARRAY_TASK_ID}p '
        'list.txt)" results --csv matched.csv\''],
}
# Named in the text, not written out.
ALSO = ['dev/update_documents --check', 'scripts/evaluate --help', 'scripts/bench --help',
        'scripts/setup --list debian build test rqt', 'scripts/setup --list noetic core',
        'scripts/bench --merge old raw.json', 'scripts/bench --merge new raw.json']


def expanded(text):
    """The commands that a text with braces is."""
    braces = re.search(r'\{([^{}]*?(?<!\\),[^{}]*)\}', text)
    if not braces:
        return [text.replace('\\,', ',')]
    return [command for each in re.split(r'(?<!\\),', braces.group(1))
            for command in expanded(text[:braces.start()] + each + text[braces.end():])]


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
        if word in FIRST_WORDS and len(span.split()) > 1 or re.match(r'(scripts|dev)/\w+$|\S+/scripts/setup$', word) or \
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
    info = CameraInfo(width=320, height=240, distortion_model='plumb_bob', D=[0.0] * 5,
                      K=[300, 0, 160, 0, 300, 120, 0, 0, 1])
    write_bag(path('my.bag'), views(6), info=info, rate=10.0)
    for name, x in (('first.png', 100), ('second.png', 110), ('photo.png', 110), ('poster.png', 100)):
        cv2.imwrite(path(name), view(x, 100, 320, 240))
    video = cv2.VideoWriter(path('my.mp4'), cv2.VideoWriter_fourcc(*'mp4v'), 30.0, (320, 240))
    for picture in views(4):
        video.write(cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR))
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
        cls.fakes = os.path.join(folder.name, 'fakes')
        fake_package(cls.fakes, 'rviz', 'rviz')

    def shell(self, command):
        """Starts a command in the clone, in a user's shell after source ...setup.bash."""
        environment = {name: value for name, value in os.environ.items()
                       if name not in ('DISPLAY', 'ROS_PACKAGE_PATH', 'CMAKE_PREFIX_PATH', 'PYTHONPATH',
                                       'LD_LIBRARY_PATH', 'ROS_MASTER_URI')}
        environment.update(FAKES=self.fakes, FAKE_OUTPUT=os.path.join(self.fakes, 'arguments'),
                           PATH='/usr/bin:' + os.environ['PATH'], ROS_HOSTNAME='localhost',
                           ROS_HOME=self.home, PWD=self.clone, PYTHONUNBUFFERED='1',
                           ROSCONSOLE_STDOUT_LINE_BUFFERED='1',
                           ROS_MASTER_URI='http://localhost:%d' % free_port())
        return subprocess.Popen(
            ['timeout', '--signal=INT', '--kill-after=60', str(int(TIMEOUT)), 'bash', '-c',
             'source out/release/devel/setup.bash && export CMAKE_PREFIX_PATH="$FAKES:$CMAKE_PREFIX_PATH" '
             'ROS_PACKAGE_PATH="$FAKES/share:$ROS_PACKAGE_PATH" && ' + command], cwd=self.clone,
            env=environment, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT, universal_newlines=True, start_new_session=True)

    def run_one(self, command, until=None):
        """The output of a command that failed; empty if it succeeded."""
        process = self.shell(command)
        if not until:
            output = process.communicate()[0]
            return '' if process.returncode == 0 else '%d: %s' % (process.returncode, output)
        output = ''
        for line in process.stdout:
            output += line
            if until in line:
                break
        os.killpg(process.pid, signal.SIGINT)
        output += process.communicate()[0]
        return '' if until in output else 'it does not say "%s": %s' % (until, output)

    def run_all(self, commands):
        """Each with what it says where it does not end, or None."""
        with concurrent.futures.ThreadPoolExecutor(4) as pool:
            results = pool.map(self.run_one, *zip(*commands))
            failed = {command: result for (command, _), result in zip(commands, results) if result}
        self.assertFalse(failed, '\n'.join('%s\n%s' % item for item in failed.items()))

    def test_every_command_of_the_documents_is_known(self):
        found = set()
        for path in documents():
            with open(path, encoding='utf-8') as file:
                found.update(commands_of(file.read()))
        known = set(RUN) | {command for texts in NOT_RUN.values() for text in texts for command in expanded(text)}
        self.assertEqual(sorted(found - known), [], 'say how each is run, or why not')
        self.assertEqual(sorted(known - found), [], 'no document has them any more')

    def test_every_command_works(self):
        commands = [(run.of(command), run.until) for command, run in RUN.items()] + [(also, None) for also in ALSO]
        first = [c for c in commands if 'make_demo_bag' in c[0] or 'raw.json' in c[0]]  # others need their results
        self.run_all(first)
        self.run_all([c for c in commands if c not in first])
        for name in ('report/index.html', 'one_method/report.md', 'matches.png', 'matched.csv',
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
