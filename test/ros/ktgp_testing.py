"""Common code of the integration tests: images with a known motion, a camera, a recorder of topics."""

import os
import random
import socket
import subprocess
import sys
import threading
import time
import unittest
import xmlrpc.client

import cv2
import numpy as np
import rosbag
import rosgraph
import rospy
from diagnostic_msgs.msg import DiagnosticArray
from dynamic_reconfigure.client import Client
from ktgp_orb.msg import Correspondences, HomographyStamped, Match, MatchStatistics, TwoViewGeometry
from rosgraph_msgs.msg import Log as LogMessage
from sensor_msgs.msg import Image, PointCloud2
from std_srvs.srv import Trigger

sys.path.append(os.path.join(os.path.dirname(os.path.dirname(os.path.abspath(__file__))), 'tools'))
from tool_case import (FAR, NEAR, OVER_A_PLANE, FolderCase, corners_off, mapped, shift, tilted_plane,  # noqa: E402, F401
                       two_depths, write_tiff)

# s; limit for any expected message on a busy machine; less for mutation tests
TIMEOUT = float(os.environ.get('KTGP_ORB_TEST_TIMEOUT', '120'))


def texture(height=1200, width=1600, seed=1):
    """Grey picture with corners at several scales everywhere."""
    random = np.random.RandomState(seed)
    picture = np.zeros((height, width))
    for cell in (4, 8, 16, 32):
        blocks = random.rand(height // cell + 1, width // cell + 1)
        picture += np.kron(blocks, np.ones((cell, cell)))[:height, :width]
    return (picture / picture.max() * 255).astype(np.uint8)


_TEXTURE = texture()
OUTPUTS = {'correspondences': Correspondences, 'homography': HomographyStamped,
           'accumulated_homography': HomographyStamped, 'match': Match, 'statistics': MatchStatistics,
           'matches_image': Image, 'two_view': TwoViewGeometry, 'points': PointCloud2}  # of the matcher


def view(x, y, width=640, height=480):
    """The view of a camera moved by x, y pixels."""
    return np.ascontiguousarray(_TEXTURE[y:y + height, x:x + width])


def view_turned(degrees, focal, zoom=1.0, width=640, height=480):
    """The view of a camera before a wall, turned to the right; enlarged about its middle."""
    middle = (width - 1) / 2, (height - 1) / 2
    camera = np.array([[focal, 0, middle[0]], [0, focal, middle[1]], [0, 0, 1]], float)
    turn = cv2.Rodrigues(np.array([0, np.radians(-degrees), 0]))[0]
    from_wall = shift(middle[0] - _TEXTURE.shape[1] / 2, middle[1] - _TEXTURE.shape[0] / 2)
    warp = camera.dot(np.diag([zoom, zoom, 1])).dot(turn).dot(np.linalg.inv(camera)).dot(from_wall)
    return cv2.warpPerspective(_TEXTURE, warp, (width, height))


def view_of_hills(moved, relief, width=640, height=480):
    """The view of a camera that has moved to the right. The hills move in it by the share `relief` more than the level
    ground, the valleys by as much less."""
    y, x = np.mgrid[:height, :width].astype(np.float32)
    hill = np.sin((x + moved) / 50) * np.cos(y / 50)
    return cv2.remap(_TEXTURE, x + 100 + moved * (1 + relief * hill), y + 100, cv2.INTER_LINEAR)


def image_message(pixels, stamp, encoding='mono8', frame_id='camera'):
    message = Image()
    message.header.stamp = stamp
    message.header.frame_id = frame_id
    message.height, message.width = pixels.shape[:2]
    message.encoding = encoding
    message.step = int(pixels.nbytes / pixels.shape[0])
    message.data = pixels.tobytes()
    return message


def views(count, x=100):
    """Pictures of 320x240 of a camera that moves 5 px to the right per frame."""
    return [view(x + 5 * i, 100, 320, 240) for i in range(count)]


def write_bag(path, pictures, topic='/camera/image_raw', info=None, rate=30.0, stamps=None,
              convert=lambda image: image, **options):
    """A recording of pictures from 1000 s on, each as `convert` makes it from its message, with a camera_info for
    each: info, whose header changes. stamps: those of the headers, s, if not the time of arrival."""
    with rosbag.Bag(path, 'w', **options) as bag:
        for i, picture in enumerate(pictures):
            arrival = rospy.Time.from_sec(1000 + i / rate)
            image = image_message(picture, rospy.Time.from_sec(stamps[i]) if stamps else arrival)
            bag.write(topic, convert(image), arrival)
            if info:
                info.header = image.header
                bag.write(os.path.dirname(topic) + '/camera_info', info, arrival)
    return path


def messages_of(bag, topic):
    """All of a topic, in their order."""
    with rosbag.Bag(bag) as file:
        return [message for _, message, _ in file.read_messages(topic)]


def images_of(count):
    """As ktgp_bag begins its summary."""
    return '%d image%s of' % (count, '' if count == 1 else 's')


def fake_package(folder, package, program, then='exec sleep 1000'):
    """A package with a program that writes its arguments to the file $FAKE_OUTPUT and then waits."""
    os.makedirs(os.path.join(folder, 'lib', package))
    os.makedirs(os.path.join(folder, 'share', package))
    open(os.path.join(folder, '.catkin'), 'w').close()
    with open(os.path.join(folder, 'share', package, 'package.xml'), 'w') as file:
        file.write('<package format="2"><name>%s</name><version>1.0.0</version><description>x'
                   '</description><maintainer email="a@b.c">x</maintainer><license>BSD</license>'
                   '</package>' % package)
    path = os.path.join(folder, 'lib', package, program)
    with open(path, 'w') as file:
        file.write('#!/bin/sh\necho "$@" >"$FAKE_OUTPUT.new"\nmv "$FAKE_OUTPUT.new" "$FAKE_OUTPUT"\n'
                   '%s\n' % then)
    os.chmod(path, 0o755)


def wait_until(condition, what, timeout=TIMEOUT):
    """Waits for a condition of the live system, in wall time. `what`: text, or what gives it then."""
    end = time.time() + timeout
    while not condition():
        if time.time() > end or rospy.is_shutdown():
            raise AssertionError('timed out waiting until ' + (what() if callable(what) else what))
        time.sleep(0.01)


def free_port():
    """A port on which nothing listens. It is below those that the system gives to connections: between
    this check and the start of the master such a port could be taken by any program beside it."""
    while True:
        port = random.randrange(20000, 32000)
        with socket.socket() as probe:
            try:
                probe.bind(('', port))
                return port
            except OSError:
                pass


def own_master(environment=os.environ):
    """The process of a ROS master of the test's own, which the environment names from now on."""
    for _ in range(5):  # another program may take the port meanwhile
        environment['ROS_MASTER_URI'] = 'http://localhost:%d' % free_port()
        master = rosgraph.Master('/own_master', environment['ROS_MASTER_URI'])
        process = subprocess.Popen(['rosmaster', '--core', '-p', environment['ROS_MASTER_URI'].rsplit(':', 1)[1]],
                                   env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        wait_until(lambda: process.poll() is not None or master.is_online(), 'the master answers')
        if process.poll() is None and master.getPid() == process.pid:
            return process
        process.kill()
    raise AssertionError('no ROS master starts')


def virtual_display(size, log=subprocess.DEVNULL):
    """Starts an X server without a screen: its process and the name of its display."""
    read, write = os.pipe()
    process = subprocess.Popen(['Xvfb', '-displayfd', str(write), '-screen', '0', size], pass_fds=[write], stdout=log,
                               stderr=log)
    os.close(write)
    with os.fdopen(read) as numbers:
        return process, ':' + numbers.readline().strip()


def check_each(cases, check):
    """Runs a check for every case and lists the failures (rosunit does not show subtests)."""
    failures = []
    for case in cases:
        try:
            check(case)
        except AssertionError as error:
            failures.append('%s: %s' % (case, error))
    if failures:
        raise AssertionError('\n'.join(failures))


def warm_up(camera, recorder):
    """Sends frames until the recorder has a message: then every nodelet of the chain is connected.
    (The nodelets of a manager share their connections, so the connections do not tell.)"""
    def answered():
        camera.show(view(100, 100))
        time.sleep(0.1)
        return recorder.messages()
    wait_until(answered, recorder.topic + ' has a message')


def wait_for_matcher(camera, *recorders):
    """Waits until the matcher is connected to its camera and to the subscribers of its results."""
    camera.wait_for_subscriber()
    for recorder in recorders:
        wait_until(lambda recorder=recorder: recorder.publishers() == 1,
                   recorder.topic + ' is connected')


def translation(message):
    """Returns the translation of a message's homography in x and y, px."""
    return message.homography[2], message.homography[5]


def no_delay(publisher):
    """Returns whether the subscribers' connections have TCP_NODELAY, as each requested."""
    return {connection.socket.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY) != 0
            for connection in publisher.impl.connections}


def of_matcher(name, test=None):
    """Records one of its topics."""
    return Recorder('/camera/matcher/' + name, OUTPUTS[name], test)


class MatcherCase(unittest.TestCase):
    """With the camera of the live matcher, its parameters and services, and what it says."""
    topics = 'statistics',  # recorded, each in the attribute of its name

    @classmethod
    def setUpClass(cls):
        cls.client = Client('/camera/matcher', timeout=TIMEOUT)
        cls.diagnostics, cls.log = Diagnostics(), Log()
        for name in cls.topics:
            setattr(cls, name, of_matcher(name))
        cls.camera = Camera()
        wait_for_matcher(cls.camera, *(getattr(cls, name) for name in cls.topics))

    def configure(self, **parameters):
        """Sets parameters, and returns the values that the matcher has accepted."""
        return self.client.update_configuration(parameters)

    def call(self, service):
        answer = rospy.ServiceProxy('/camera/matcher/' + service, Trigger)()
        self.assertTrue(answer.success, answer.message)

    def send(self, pixels):
        """Statistics of an image."""
        return self.statistics.wait_for(self.camera.show(pixels))


class Memory:
    """The memory of a node's process, MB: what it holds now, and the most since begin()."""

    def __init__(self, node):
        uri = rosgraph.Master('/memory').lookupNode(node)
        self._process = '/proc/%d/' % xmlrpc.client.ServerProxy(uri).getPid('/memory')[2]

    def _read(self, name):
        with open(self._process + 'status') as status:
            return int(next(line for line in status if line.startswith(name)).split()[1]) / 1024.0

    def begin(self):
        with open(self._process + 'clear_refs', 'w') as file:
            file.write('5')

    def held(self):
        return self._read('VmRSS')

    def most(self):
        return self._read('VmHWM')


class Program:
    """A running program and what it says on both outputs."""

    def __init__(self, *command, **options):
        self.lines = []
        environment = dict(options.pop('env', os.environ), PYTHONUNBUFFERED='1',
                           ROSCONSOLE_STDOUT_LINE_BUFFERED='1')
        self.process = subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                                        universal_newlines=True, **options)
        self.reader = threading.Thread(target=self._read)
        self.reader.start()

    def _read(self):
        for line in self.process.stdout:
            self.lines.append(line)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.end()

    def output(self):
        return ''.join(self.lines)

    def wait(self):
        """Waits until it ends by itself: what it has said."""
        try:
            self.process.wait(TIMEOUT)
        except subprocess.TimeoutExpired:
            raise AssertionError('timed out waiting until it ends; so far: ' + self.output())
        self.reader.join(TIMEOUT)
        return self.output()

    def end(self):
        self.process.terminate()
        self.process.wait(30)
        self.reader.join()
        self.process.stdout.close()

    def says(self, *texts):
        """Waits until it has said all of them, or ends: whether it has."""
        def said():
            return all(text in self.output() for text in texts)
        wait_until(lambda: said() or self.process.poll() is not None, 'it says %s' % (texts,))
        if not said():
            self.reader.join(TIMEOUT)
        return said()


def node(kind, name, *arguments, **options):
    """One of the nodelets as a program of its own."""
    return Program('rosrun', 'nodelet', 'nodelet', 'standalone', 'ktgp_orb/' + kind, '__name:=' + name, *arguments,
                   **options)


class Repeated:
    """Does something again and again, first after `period` s of wall time, in a thread of its own until stop(), or
    until it fails: then `trouble` is why, and stop() raises it."""

    def __init__(self, period, act):
        self.period, self.count, self.trouble, self._act = period, 0, None, act
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self):
        try:
            while not self._end.wait(self.period):
                self._act()
                self.count += 1
        except Exception as error:
            self.trouble = error
            raise

    def stop(self):
        self._end.set()
        self._thread.join()
        if self.trouble:
            raise self.trouble


class Recorder:
    """Keeps every message of a topic; of a test that is given, until its end."""

    def __init__(self, topic, message_type, test=None):
        self._lock = threading.Lock()
        self._messages = []
        self.topic = topic
        self._subscriber = rospy.Subscriber(topic, message_type, self._store, queue_size=1000)
        if test:
            test.addCleanup(self.close)

    def _store(self, message):
        with self._lock:
            self._messages.append(message)

    def messages(self):
        with self._lock:
            return list(self._messages)

    def with_stamp(self, stamp):
        """The message whose header has this stamp, or None."""
        return next((m for m in self.messages() if m.header.stamp == stamp), None)

    def wait_for(self, stamp, timeout=TIMEOUT):
        wait_until(lambda: self.with_stamp(stamp), '%s has stamp %s' % (self.topic, stamp), timeout)
        return self.with_stamp(stamp)

    def publishers(self):
        """How many know this subscriber: on a busy machine that is a moment after the connection stands."""
        def knows(connection):
            try:
                publisher = xmlrpc.client.ServerProxy(connection.endpoint_id)
                connections = publisher.getBusInfo(rospy.get_name())[2]
            except OSError:
                return False  # it has ended
            return any(c[1] == rospy.get_name() and c[2] == 'o' and c[4] == self._subscriber.resolved_name
                       for c in connections)

        return sum(map(knows, list(self._subscriber.impl.connections)))

    def names_of_publishers(self):
        return {connection.callerid_pub for connection in self._subscriber.impl.connections}

    def close(self):
        self._subscriber.unregister()


class Diagnostics(Recorder):
    """Keeps the reports of all nodes."""

    def __init__(self, test=None):
        super().__init__('/diagnostics', DiagnosticArray, test)

    def of(self, task, since=0):
        """The reports of a task, known by the end of its name, after that many messages."""
        return [status for array in self.messages()[since:] for status in array.status if status.name.endswith(task)]

    def values(self, task):
        """Returns a dictionary of the values of each report of a task."""
        return [{value.key: value.value for value in status.values} for status in self.of(task)]

    def wait_for_words(self, words, meanwhile=lambda: None):
        """In the summary of a new report."""
        seen = len(self.messages())

        def said():
            meanwhile()
            return any(words in status.message for status in self.of('', seen))
        wait_until(said, 'diagnostics say "%s"' % words)


class Log(Recorder):
    """Keeps what all nodes say."""

    def __init__(self, test=None):
        super().__init__('/rosout', LogMessage, test)

    def with_words(self, *words):
        return [m for m in self.messages() if all(each in m.msg for each in words)]

    def wait_for_words(self, words):
        wait_until(lambda: self.with_words(words), 'the log says ' + words)


class Camera:
    """Publishes images one by one on /camera/image_raw, 33 ms of stamps apart."""

    def __init__(self, topic='/camera/image_raw'):
        self.publisher = rospy.Publisher(topic, Image, queue_size=5)
        self._stamp = rospy.Time(1000, 0)
        self._count = 0
        self._last = None

    def wait_for_subscriber(self):
        wait_until(lambda: self.publisher.get_num_connections() > 0, 'the matcher subscribes')

    def wait_for_no_subscriber(self):
        wait_until(lambda: self.publisher.get_num_connections() == 0, 'the matcher unsubscribes')

    def subscribers(self):
        return self.publisher.get_num_connections()

    def next_stamp(self):
        self._stamp += rospy.Duration(0.033)
        return self._stamp

    def last_stamp(self):
        return self._stamp

    def send(self, message):
        self.publisher.publish(message)
        return message.header.stamp

    def noisy(self, pixels):
        """As cameras take them: never the same twice, which would be no new frame."""
        if pixels.dtype != np.float32 and np.array_equal(pixels, self._last):
            pixels = pixels ^ 1
        self._last = pixels
        return pixels

    def show(self, pixels, encoding='mono8', frame_id='camera'):
        """Sends a picture with the next stamp."""
        pixels = self.noisy(pixels)
        return self.send(image_message(pixels, self.next_stamp(), encoding, frame_id))

    def send_view(self, encoding='mono8', convert=lambda grey: grey):
        """Sends the next view of a camera that moves 5 px right and 3 px down per frame."""
        self._count += 1
        step = self._count % 60
        return self.show(convert(view(100 + 5 * step, 100 + 3 * step)), encoding)
