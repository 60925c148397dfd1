"""Runs the launch files, each with its own master: bag.launch plays the right topics and reports
problems, tune.launch and rviz.launch start their programs, and a killed manager is restarted."""

import contextlib
import faulthandler
import importlib.machinery
import importlib.util
import os
import re
import signal
import socket
import subprocess
import sys
import tempfile
from unittest import mock
from xmlrpc.client import ServerProxy

import cv2
import rosbag
import rosgraph
import rospy
from geometry_msgs.msg import TransformStamped
from ktgp_orb.msg import HomographyStamped, MatchStatistics, MatchStatus
from ktgp_testing import (TIMEOUT, FolderCase, Program, fake_package, free_port, image_message, messages_of, own_master,
                          view, wait_until)
from sensor_msgs.msg import CameraInfo
from tf2_msgs.msg import TFMessage

PACKAGE = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
FRAMES = 12
sys.dont_write_bytecode = True  # a test imports scripts/play_bag
FIRST = 1500000000.0  # s, of the recording
STALE = '/camera/matcher/homography'  # a result of the time of the recording


def setUpModule():
    socket.setdefaulttimeout(TIMEOUT)
    faulthandler.dump_traceback_later(900, exit=True)  # says where, should it wait forever


def write_bag(path):
    with rosbag.Bag(path, 'w') as bag:
        for i in range(FRAMES):
            stamp = rospy.Time.from_sec(FIRST + 0.1 * i)
            bag.write('/camera/image_raw',
                      image_message(view(100 + 5 * i, 100, 320, 240), stamp), stamp)
            info = CameraInfo()
            info.header.stamp = stamp
            bag.write('/camera/camera_info', info, stamp)
            stale = HomographyStamped()
            stale.header.frame_id = 'stale'
            bag.write(STALE, stale, stamp)
            bag.write('/tf', TFMessage([TransformStamped()]), stamp)


class Master:
    """A separate ROS master, to query the running nodes."""

    def __init__(self):
        self.environment = dict(os.environ, ROS_HOSTNAME='localhost', PYTHONUNBUFFERED='1')
        self.process = own_master(self.environment)
        self.handle = rosgraph.Master('/launch_run_test', self.environment['ROS_MASTER_URI'])
        self.handle.setParam('/run_id', 'launch_run_test')  # what roslaunch expects of a roscore

    def listeners(self, topic):
        return dict(self.handle.getSystemState()[1]).get(topic, [])

    def close(self):
        self.process.terminate()
        self.process.wait()


def kill_nodes(master):
    """Kills the nodes of this master (a URI), and returns its commands."""
    commands = []
    for process in filter(str.isdigit, os.listdir('/proc')):
        try:
            with open('/proc/%s/environ' % process) as file:
                if 'ROS_MASTER_URI=%s\0' % master not in file.read():
                    continue
            with open('/proc/%s/cmdline' % process) as file:
                command = file.read().replace('\0', ' ')
            if '__name:=' in command:
                commands.append(command)
                os.kill(int(process), signal.SIGKILL)
        except (OSError, UnicodeDecodeError):
            pass  # it has ended
    return commands


class Launch(Program):
    """A running roslaunch."""

    def __init__(self, master, *arguments, cwd=None, without=None, package=('ktgp_orb',),
                 **environment):
        self.environment = dict(master.environment, **dict({'PWD': cwd or os.getcwd()}, **environment))
        self.environment.pop(without, None)
        super().__init__('roslaunch', *package, *arguments, cwd=cwd, env=self.environment)

    def stop(self):
        """Ctrl-C. If it comes while roslaunch starts a node, roslaunch can wait forever, or end without
        that node; then what is left is killed."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)
        try:
            self.process.wait(TIMEOUT)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
            print('roslaunch did not end after Ctrl-C; it said: ' + self.output(), file=sys.stderr)
        self.reader.join(TIMEOUT)
        if self.reader.is_alive():
            nodes = kill_nodes(self.environment['ROS_MASTER_URI'])
            print('roslaunch left nodes behind: %s' % nodes, file=sys.stderr)
            self.reader.join()
        self.process.stdout.close()


class LaunchRunTest(FolderCase):
    prefix = 'ktgp_orb it\'s "'

    def setUp(self):
        super().setUp()
        self.bag = self.path("it's.bag")
        write_bag(self.bag)
        self.master = Master()
        self.addCleanup(self.master.close)

    def launch(self, *arguments, **environment):
        return self.launch_at(self.master, *arguments, cwd=self.path(), **environment)

    def launch_at(self, master, *arguments, **environment):
        launch = Launch(master, *arguments, **environment)
        self.addCleanup(launch.stop)
        return launch

    def check_sim_time(self, expected=None):
        """It is restored shortly after the launch has ended."""
        def value():
            try:
                return self.master.handle.getParam('/use_sim_time')
            except rosgraph.MasterException:
                return None
        wait_until(lambda: value() is expected,
                          '/use_sim_time is %s again, what it was; else the next run has another one' %
                          expected, timeout=15)

    def test_use_sim_time_is_put_back_however_the_launch_ends(self):
        no_display = self.with_fake('rviz', 'rviz', then='exit 1')
        self.launch('bag.launch', 'bag:=' + self.bag, **no_display).wait()
        self.check_sim_time()
        # True: a simulation runs.
        for file, before in (('demo.launch', None), ('demo.launch', False), ('bag.launch', True)):
            if before is not None:
                self.master.handle.setParam('/use_sim_time', before)
            launch = self.launch(file, 'bag:=' + self.bag, 'rviz:=false')
            # As early as possible, before its first node.
            wait_until(lambda: self.sim_time_is_set() or launch.process.poll() is not None,
                              'it is set')
            if before:
                self.assertTrue(launch.says('process[player'), launch.output())
            launch.stop()
            self.check_sim_time(before)

    def check_that_a_second_is_refused(self, first, master):
        self.assertTrue(first.says('process[player'), first.output())
        for file in ('bag.launch', 'demo.launch'):
            second = self.launch_at(master, file, 'bag:=' + self.bag, 'rviz:=false', cwd=self.path())
            output = second.wait()
            self.assertIn('process %d on ' % first.process.pid, output)
            self.assertIn('plays a bag on this master already', output)
            self.assertNotIn('process[', output)
            self.assertNotEqual(second.process.returncode, 0)
        self.assertIsNone(first.process.poll(), first.output())
        self.assertNotIn('process has died', first.output())

    def test_a_second_bag_on_one_master_is_refused_and_the_first_plays_on(self):
        first = self.launch('bag.launch', 'bag:=' + self.bag, 'rviz:=false', 'loop:=true', 'delay:=100')
        self.check_that_a_second_is_refused(first, self.master)
        self.assertTrue(self.sim_time_is_set())
        first.stop()
        # At once: the first has not yet put anything back.
        third = self.launch('bag.launch', 'bag:=' + self.bag, 'rviz:=false', 'delay:=1')
        self.assertIn('nothing subscribes to its results', third.wait())
        self.check_sim_time()

    def test_a_second_bag_is_refused_on_a_master_that_the_first_has_started(self):
        class OwnMaster:
            environment = dict(self.master.environment,
                               ROS_MASTER_URI='http://localhost:%d' % free_port())
        first = self.launch_at(OwnMaster, 'bag.launch', 'bag:=' + self.bag, 'rviz:=false', 'loop:=true',
                               'delay:=100', cwd=self.path())
        self.check_that_a_second_is_refused(first, OwnMaster)

    def test_the_mark_of_a_launch_that_has_ended_elsewhere_counts_only_while_a_clock_runs(self):
        """Elsewhere: on another host, or in a container that has this host's name."""
        master = self.master.handle
        for host, old in (('elsewhere', ['not set']), (socket.gethostname() + ', pid:[1]', [False]),
                          (socket.gethostname(), [])):
            master.setParam('/ktgp_orb_plays_a_bag', [host, os.getpid(), 'its start'] + old)
            master.setParam('/use_sim_time', bool(old))
            launch = self.launch('bag.launch', 'bag:=' + self.bag, 'rviz:=false', 'delay:=0')
            self.assertIn('process[player', launch.wait(), host)
            self.check_sim_time(False if old != ['not set'] else None)
            wait_until(lambda: not master.hasParam('/ktgp_orb_plays_a_bag'), 'its mark is removed')
        master.setParam('/ktgp_orb_plays_a_bag', ['elsewhere', 1, 'its start', False])
        master.registerPublisher('/clock', 'rosgraph_msgs/Clock', 'http://localhost:1')
        output = self.launch('demo.launch', 'bag:=' + self.bag).wait()
        self.assertIn('process 1 on elsewhere plays a bag on this master already', output)
        self.assertIn('If it has ended: rosparam delete /ktgp_orb_plays_a_bag', output)

    def test_one_process_can_launch_two_bags_one_after_the_other(self):
        self.run_program('/usr/bin/python3', '-c', """if True:
            import roslaunch, sys
            roslaunch.configure_logging('two')
            for _ in range(2):
                files = [(sys.argv[1], ['bag:=' + sys.argv[2], 'rviz:=false', 'delay:=0'])]
                parent = roslaunch.parent.ROSLaunchParent('launch_run_test', files)
                parent.start()
                parent.spin()""", os.path.join(PACKAGE, 'launch/bag.launch'), self.bag, env=self.master.environment)
        self.check_sim_time()

    def test_the_port_of_a_launch_is_seen_however_it_is_written(self):
        script = os.path.join(PACKAGE, 'scripts/keep_sim_time')
        keep = importlib.machinery.SourceFileLoader('keep_sim_time', script).load_module()
        for words, port in ((['-p', '11399'], '11399'), (['-p11399'], '11399'), (['--port', '11399'], '11399'),
                            (['--port=11399'], '11399'), (['-pick', 'a-p1'], None)):
            launch = subprocess.Popen([sys.executable, '-c', 'input(1)', *words, 'bag.launch'], stdin=subprocess.PIPE,
                                      stdout=subprocess.PIPE)
            try:
                self.assertEqual(launch.stdout.read(1), b'1')  # it runs, so /proc has its words
                expected = 'http://localhost:' + port if port else rosgraph.get_master_uri()
                self.assertEqual(keep.master_of(launch.pid), expected, words)
            finally:
                launch.communicate(b'\n')

    def test_camera_motion_refuses_a_number_of_frames_that_is_none(self):
        for value in ('abc', '-1', '2.5', 'True'):
            self.run_program('/usr/bin/python3', os.path.join(PACKAGE, 'scripts/camera_motion'), '_frames:=' + value,
                             env=self.master.environment, code=2,
                             words='_frames is %s; expected a whole number of at least 0' % value)

    def sim_time_is_set(self):
        handle = self.master.handle
        return handle.hasParam('/use_sim_time') and handle.getParam('/use_sim_time')

    def test_unplayable_bags_are_reported_before_playing(self):
        self.write('rec2.bag', '')
        cases = {'_bag:=' + self.path(): 'is no file; expected a bag',
                 '_rate:=0': 'rate is 0; expected a number above 0',
                 '_rate:=-1': 'rate is -1; expected a number above 0',
                 '_start:=1000': 'start is 1000 s; the bag ends after 1.1 s',
                 '_start:=-1': 'start is -1; expected a number of at least 0',
                 '_record:=rec2': 'rec2.bag exists; nothing is overwritten',
                 '_record:=missing/x.bag': 'there is no folder'}
        for argument, words in cases.items():
            self.master.handle.setParam('/play_bag', {'bag': self.bag, 'folder': self.path(),
                                                      'matcher': '/camera/matcher', 'delay': 0.1})
            run = self.run_program('/usr/bin/python3', os.path.join(PACKAGE, 'scripts', 'play_bag'), argument,
                                   env=self.master.environment, stderr=subprocess.STDOUT, code=2, prints=words)
            self.assertNotIn('Traceback', run.stdout)
        self.assertEqual(os.path.getsize(self.path('rec2.bag')), 0)
        output = self.launch('bag.launch', 'bag:=' + self.bag, 'queue_size:=abc').wait()
        self.assertIn('abc', output)
        self.assertNotIn('process[', output)

    def test_relative_names_are_those_of_the_current_directory_and_not_of_pwd(self):
        """A program that starts roslaunch elsewhere, or a service, has PWD of its own or none."""
        os.mkdir(self.path('other'))
        self.write('few.yaml', 'features: 300')
        for name, environment in (('one', {'PWD': self.path('other')}), ('two', {'without': 'PWD'})):
            launch = self.launch('bag.launch', "bag:=it's.bag", 'rviz:=false', 'delay:=1', 'record:=' + name,
                                 'params:=few.yaml', **environment)
            output = launch.wait()
            self.assertTrue(messages_of(self.path(name + '.bag'), '/camera/matcher/matches_image'), output)
            self.assertEqual(self.master.handle.getParam('/camera/matcher/features'), 300)

    def test_a_bag_is_played_in_any_namespace_and_with_names_that_have_no_slash(self):
        with rosbag.Bag(self.bag) as bag, rosbag.Bag(self.path('plain.bag'), 'w') as plain:
            for _, message, stamp in bag.read_messages(['/camera/image_raw']):
                plain.write('camera/image_raw', message, stamp)
        for i, (matcher, bag, arguments, environment) in enumerate((
                ('/front/matcher', self.bag, ['namespace:=/front'], {}),
                ('/robot/camera/matcher', self.bag, [], {'ROS_NAMESPACE': 'robot'}),
                ('/camera/matcher', 'plain.bag', ['topic:=camera/image_raw'], {}),
                ('/camera/matcher', 'plain.bag', [], {}))):
            launch = self.launch('bag.launch', 'bag:=' + bag, 'rviz:=false', 'record:=%d.bag' % i, *arguments,
                                 **environment)
            output = launch.wait()
            self.assertTrue(messages_of(self.path('%d.bag' % i), matcher + '/statistics'), output)

    def test_a_bag_is_played_and_its_results_recorded(self):
        cv2.imwrite(self.path('target.png'), view(100, 100, 320, 240))
        launch = self.launch('bag.launch', "bag:=it's.bag", 'record:=out.bag', 'rviz:=false', 'delay:=0',
                             "set:={reference_mode: fixed, guided: true, reference_image: '%s'}" %
                             self.path('target.png').replace("'", "''"))
        output = launch.wait()
        with rosbag.Bag(self.path('out.bag')) as bag:
            messages = list(bag.read_messages())
        by_topic = {}
        for topic, message, _ in messages:
            by_topic.setdefault(topic, []).append(message)
        statistics = by_topic['/camera/matcher/statistics']
        stamps = [round(m.header.stamp.to_sec() - FIRST, 3) for m in statistics]
        # A busy machine may drop frames between, but not the first or the last one.
        self.assertEqual((stamps[0], stamps[-1]), (0.0, round(0.1 * (FRAMES - 1), 3)), output)
        self.assertEqual(len(stamps) + statistics[-1].dropped_frames +
                         statistics[-1].lost_frames, FRAMES)
        self.assertEqual({m.status for m in statistics}, {MatchStatus.STATUS_OK})
        for match in by_topic['/camera/matcher/match']:
            shift = (match.header.stamp.to_sec() - FIRST) / 0.1 * 5  # from the given image
            self.assertAlmostEqual(match.homography.homography[2], -shift, delta=1.0)
        self.assertNotIn('does not receive', output)  # although delay is 0
        # Only the images of the bag itself were played.
        self.assertNotIn('stale', {m.header.frame_id for m in by_topic[STALE]})
        lost = 'record: there are no results of'
        self.assertEqual(lost in output, len(stamps) < FRAMES, output)
        self.check_sim_time()
        again = self.launch('bag.launch', "bag:=it's.bag", 'record:=out.bag', 'rviz:=false')
        self.assertIn('out.bag exists; nothing is overwritten', again.wait())

    def test_the_launch_waits_until_the_recording_is_closed(self):
        """A large bag is closed and renamed long after the recorder was told to end."""
        launch = self.launch('bag.launch', 'bag:=' + self.bag, 'record:=slow.bag', 'rviz:=false',
                             LD_PRELOAD=os.environ['KTGP_ORB_FAULTS'], KTGP_ORB_RENAME_AFTER='3')
        self.assertNotIn('has written no', launch.wait())
        with rosbag.Bag(self.path('slow.bag')) as bag:
            self.assertGreater(bag.get_message_count('/camera/matcher/statistics'), 0)

    @staticmethod
    def play_bag():
        """The script as a module."""
        loader = importlib.machinery.SourceFileLoader('play_bag', os.path.join(PACKAGE, 'scripts', 'play_bag'))
        play_bag = importlib.util.module_from_spec(importlib.util.spec_from_loader('play_bag', loader))
        loader.exec_module(play_bag)
        return play_bag

    def test_a_disk_that_is_nearly_full_is_refused_before_playing(self):
        play_bag = self.play_bag()
        for free in (2 ** 30 - 1, 2 ** 30):
            with mock.patch('shutil.disk_usage', return_value=mock.Mock(free=free)), contextlib.ExitStack() as stack:
                if free < 2 ** 30:
                    stack.enter_context(self.assertRaisesRegex(play_bag.Unusable, 'record: 1.07 GB are free in'))
                play_bag.Player.recording(mock.Mock(path=lambda _: self.path('new.bag')))

    def test_the_player_ends_with_its_bag_however_it_is_killed(self):
        def shut_down(node):
            node.shutdown('/launch_run_test', 'by rosnode kill')

        def kill(node):
            os.kill(node.getPid('/launch_run_test')[2], signal.SIGKILL)
        for end in (shut_down, kill):
            launch = self.launch('bag.launch', 'bag:=' + self.bag, 'rviz:=false', 'loop:=true', 'delay:=0')
            wait_until(lambda: '/clock' in dict(self.master.handle.getSystemState()[0]), launch.output)
            end(ServerProxy(self.master.handle.lookupNode('/player')))
            launch.wait()
            wait_until(lambda: '/clock' not in dict(self.master.handle.getSystemState()[0]),
                       lambda: 'rosbag ends: ' + launch.output(), timeout=15)

    def test_images_without_results_are_counted(self):
        play_bag = self.play_bag()
        with rosbag.Bag(self.path('lossy.bag'), 'w') as bag:
            for dropped, lost in ((0, 0), (2, 0), (2, 1)):
                bag.write('/left/matcher/statistics', MatchStatistics(dropped_frames=dropped, lost_frames=lost))
            bag.write('/right/matcher/statistics', MatchStatistics(dropped_frames=9))
        self.assertEqual(play_bag.frames_without_results(self.path('lossy.bag'), '/left/matcher'), 3)
        self.assertEqual(play_bag.frames_without_results(self.path('lossy.bag'), '/other/matcher'), 0)
        self.assertIn('with rate:=0.25,', play_bag.advice_on_losses(0.5, 'none'))
        self.assertNotIn('decompress', play_bag.advice_on_losses(0.5, 'none'))
        self.assertTrue(play_bag.advice_on_losses(1.0, 'bz2').startswith('decompress the bag with rosbag decompress'))

    def test_a_wrong_topic_is_reported_with_the_existing_ones(self):
        launch = self.launch('bag.launch', 'bag:=' + self.bag, 'topic:=/other/image', 'rviz:=false')
        self.assertIn('the bag has no /other/image; its image topics: /camera/image_raw', launch.wait())
        self.check_sim_time()

    def test_results_without_subscriber_are_said(self):
        launch = self.launch('bag.launch', 'bag:=' + self.bag, 'rviz:=false', 'delay:=8', 'loop:=true')
        self.assertTrue(launch.says('nothing subscribes to its results'), launch.output())
        self.assertNotIn('no node publishes', launch.output())  # before the bag plays
        self.check_outputs_are_documented()
        launch.stop()
        self.check_sim_time()

    def check_outputs_are_documented(self):
        prefix = '/camera/matcher/'
        # Services come after the topics.
        wait_until(lambda: self.has_service(prefix + 'reset'), 'the matcher has advertised everything')
        types = dict(self.master.handle.getTopicTypes())
        published = {name[len(prefix):]: types[name]
                     for name, _ in self.master.handle.getSystemState()[0]
                     if name.startswith(prefix) and name.count('/') == 3 and '/parameter_' not in name}
        with open(os.path.join(PACKAGE, 'doc', 'topics.md')) as file:
            topics = file.read().split('\n## Topics\n')[1].split('\n## ')[0]
        documented = dict(re.findall(r'^\| `~(\w+)`(?:, tf)? \| (\w+/\w+) \|', topics, re.M))
        self.assertEqual(published, documented)

    def test_a_matcher_that_dies_at_the_start_ends_the_launch(self):
        launch = self.launch('bag.launch', 'bag:=' + self.bag, 'rviz:=false', 'T_w:=1.5', 'loop:=true',
                             'delay:=100')
        self.assertIn('T_w is 1.5; expected a number in [0, 1]', launch.wait())

    def with_fake(self, package, program, **behaviour):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        fake_package(folder.name, package, program, **behaviour)
        return {'CMAKE_PREFIX_PATH': folder.name + ':' + os.environ['CMAKE_PREFIX_PATH'],
                'ROS_PACKAGE_PATH': os.path.join(folder.name, 'share') + ':' +
                os.environ['ROS_PACKAGE_PATH'],
                'FAKE_OUTPUT': os.path.join(folder.name, 'arguments')}

    def arguments_of(self, fake):
        wait_until(lambda: os.path.exists(fake['FAKE_OUTPUT']), 'the program is started')
        with open(fake['FAKE_OUTPUT']) as file:
            return file.read()

    def test_rviz_gets_its_topics(self):
        fake = self.with_fake('rviz', 'rviz')
        self.launch('rviz.launch', 'image:=/left/image', 'overlay:=/left/matcher/matches_image',
                    **fake)
        arguments = self.arguments_of(fake)
        self.assertIn('/camera/image_raw:=/left/image', arguments)
        self.assertIn('/camera/matcher/matches_image:=/left/matcher/matches_image', arguments)
        path = re.search(r'-d (\S+)', arguments).group(1)
        self.assertTrue(os.path.isfile(path), path)

    def test_tune_plays_in_a_loop_with_rviz_and_says_what_is_missing(self):
        fake = self.with_fake('rviz', 'rviz')
        launch = self.launch('tune.launch', 'bag:=' + self.bag, 'namespace:=left', 'delay:=1', DISPLAY='', **fake)
        self.assertIn('/camera/matcher/matches_image:=left/matcher/matches_image', self.arguments_of(fake))
        self.assertTrue(launch.says('rqt_plot is not installed'), launch.output())
        self.assertTrue(launch.says('the sliders need a display'), launch.output())
        listener = subprocess.Popen(
            ['/usr/bin/python3', os.path.join(PACKAGE, 'scripts', 'camera_motion'),
             'match:=/left/matcher/match', '_frames:=%d' % (FRAMES + 5)], env=self.master.environment,
            stdout=subprocess.PIPE, universal_newlines=True)
        # More frames than the bag has: it was repeated.
        output, _ = listener.communicate(timeout=TIMEOUT)
        self.assertIn('reason %d' % MatchStatus.REASON_STAMP_WENT_BACK, output)

    def wait_for_matchers(self, launches, *cameras):
        """Waits until the matchers of all cameras answer; no manager may be started twice."""
        for camera in cameras:
            wait_until(lambda camera=camera: self.has_service(camera + '/matcher/reset'),
                              camera + ' has its matcher')
        output = ''.join(launch.output() for launch in launches)
        self.assertNotIn('process has died', output)
        self.assertNotIn('new node registered with same name', output)

    def has_service(self, name):
        try:
            return bool(self.master.handle.lookupService(name))
        except rosgraph.MasterException:
            return False

    def test_two_robots_in_two_groups_have_a_manager_each(self):
        self.write('robots.launch', '<launch>' + ''.join(
            '<group ns="%s"><include file="%s/launch/multi_camera.launch">'
            '<arg name="cameras" value="front side/rear"/></include></group>' % (robot, PACKAGE)
            for robot in ('one', 'two')) + '</launch>')
        launch = self.launch_at(self.master, self.path('robots.launch'), package=())
        self.wait_for_matchers([launch], '/one/front', '/one/side/rear', '/two/front',
                               '/two/side/rear')
        for robot in ('one', 'two'):
            self.assertTrue(self.master.handle.lookupNode('/%s/front/matcher_manager' % robot))

    def test_two_launches_on_one_master_have_a_manager_each(self):
        launches = [self.launch('multi_camera.launch', 'cameras:=' + side)
                    for side in ('left', 'right')]
        self.wait_for_matchers(launches, '/left', '/right')

    def test_a_killed_manager_comes_back_with_its_matchers(self):
        launch = self.launch('multi_camera.launch', 'cameras:=left right')
        wait_until(self.pid_of_manager, lambda: 'the matchers are there; ' + launch.output())
        pid = self.pid_of_manager()
        os.kill(pid, signal.SIGKILL)
        wait_until(lambda: self.pid_of_manager() not in (None, pid),
                   lambda: 'they come back; ' + launch.output())
        self.assertIsNone(launch.process.poll(), launch.output())

    def pid_of_manager(self):
        """The manager with the services of the matchers of both cameras, or None."""
        try:
            for side in ('left', 'right'):
                host, port = self.master.handle.lookupService(
                    '/%s/matcher/reset' % side).replace('rosrpc://', '').split(':')
                socket.create_connection((host, int(port)), TIMEOUT).close()
            node = ServerProxy(self.master.handle.lookupNode('/left/matcher_manager'))
            return node.getPid('/launch_run_test')[2]
        except (rosgraph.MasterException, OSError):
            return None
