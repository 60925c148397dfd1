#!/usr/bin/python3
"""Age of the results when they are published, under load: a free-running camera of 640x480, one or eight
matchers in one nodelet manager, with and without a busy process on the other core.

Run in the environment of a build (source devel/setup.bash), on an idle machine:
    benchmark/latency.py [--seconds 60] [--rates 30 120] [--matchers 1 8] [--neighbours idle busy]
                         [--search-radius 0] [--lost-target]
With --lost-target the matchers look for a fixed reference that is never in view, with preset robust: each frame
goes through PROSAC in vain and then through the growth.
Prints a table: p50, p99 and largest latency from the image's stamp to the published statistics, and
the share of frames that were dropped for newer ones. Eight matchers all use the same camera.
"""
import argparse
import os
import sys
import tempfile
import time

import cv2
import numpy as np
import rospy
import yaml
from ktgp_orb.msg import MatchStatistics
from sensor_msgs.msg import Image

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '../test/ros'))
from ktgp_testing import Program, image_message, own_master, texture, view  # noqa: E402


def percentile(values, share):
    return float(np.percentile(values, share)) if values else float('nan')


class Run:
    """One row of the table."""

    def __init__(self, matchers, parameters):
        self._programs = [Program('rosrun', 'nodelet', 'nodelet', 'manager', '__name:=manager')]
        self._publisher = rospy.Publisher('/camera/image', Image, queue_size=1)
        self.latencies = []
        self.dropped = [0] * matchers
        self._counting = False
        self._subscribers = []
        for i in range(matchers):
            rospy.set_param('/matcher%d' % i, parameters)
            self._programs.append(Program('rosrun', 'nodelet', 'nodelet', 'load', 'ktgp_orb/matcher', '/manager',
                                          'image:=/camera/image', '__name:=matcher%d' % i))
            self._subscribers.append(rospy.Subscriber(
                '/matcher%d/statistics' % i, MatchStatistics, self._take, callback_args=i))
        self._seen = set()

    def _take(self, message, matcher):
        self._seen.add(matcher)
        if self._counting:
            self.latencies.append(message.latency_milliseconds)
            self.dropped[matcher] = message.dropped_frames

    def publish(self, rate, seconds, images):
        """Runs for `seconds`, or until every matcher has answered if that is None."""
        start = time.monotonic()
        count = 0
        while not rospy.is_shutdown():
            due = start + count / rate
            time.sleep(max(0.0, due - time.monotonic()))
            image = images[abs(count % (2 * len(images) - 2) - (len(images) - 1))]
            image.header.stamp = rospy.Time.now()
            self._publisher.publish(image)
            count += 1
            if seconds is None and len(self._seen) == len(self.dropped):
                return count
            if seconds is not None and time.monotonic() - start > seconds:
                return count
            if seconds is None and time.monotonic() - start > 120.0:
                raise RuntimeError('no statistics from %d matchers within 120 s'
                                   % (len(self.dropped) - len(self._seen)))

    def measure(self, rate, seconds, images):
        self.publish(rate, None, images)
        self.publish(rate, 2.0, images)  # buffers grow
        before = list(self.dropped)
        self._counting = True
        count = self.publish(rate, seconds, images)
        self._counting = False
        lost = sum(self.dropped) - sum(before)
        return lost / float(count * len(self.dropped))

    def stop(self):
        for subscriber in self._subscribers:
            subscriber.unregister()
        self._publisher.unregister()
        for program in reversed(self._programs):
            program.end()


def parameters_of(arguments, folder):
    """Returns the parameters of every matcher."""
    if not arguments.lost_target:
        return {'search_radius': arguments.search_radius}
    reference = os.path.join(folder, 'reference.png')
    cv2.imwrite(reference, texture(480, 640, seed=2))
    robust = os.path.join(os.path.dirname(os.path.abspath(__file__)), '../config/robust.yaml')
    with open(robust) as file:
        return dict(yaml.safe_load(file), reference_mode='fixed', reference_image=reference)


def measure_all(arguments, folder):
    parameters = parameters_of(arguments, folder)
    images = [image_message(view(4 * i, 2 * i), rospy.Time(1)) for i in range(60)]
    print('| camera | matchers | neighbour | p50 | p99 | max | frames | dropped |')
    print('|---|---|---|---:|---:|---:|---:|---:|')
    for rate in arguments.rates:
        for matchers in arguments.matchers:
            for name in arguments.neighbours:
                neighbour = Program('taskset', '-c', str(os.cpu_count() - 1), sys.executable, '-c',
                                    'while True: pass') if name == 'busy' else None
                run = Run(matchers, parameters)
                try:
                    dropped = run.measure(rate, arguments.seconds, images)
                finally:
                    run.stop()
                    if neighbour:
                        neighbour.end()
                print('| %g Hz | %d | %s | %.1f ms | %.1f ms | %.1f ms | %d | %.1f %% |' % (
                    rate, matchers, name, percentile(run.latencies, 50),
                    percentile(run.latencies, 99), max(run.latencies or [float('nan')]),
                    len(run.latencies), 100.0 * dropped), flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--seconds', type=float, default=60.0, help='of each row')
    parser.add_argument('--rates', type=float, nargs='+', default=[30.0, 120.0])
    parser.add_argument('--matchers', type=int, nargs='+', default=[1, 8])
    parser.add_argument('--neighbours', choices=['idle', 'busy'], nargs='+',
                        default=['idle', 'busy'])
    parser.add_argument('--search-radius', type=float, default=0.0)
    parser.add_argument('--lost-target', action='store_true')
    arguments = parser.parse_args()
    master = own_master()
    try:
        rospy.init_node('latency', disable_signals=True)
        with tempfile.TemporaryDirectory() as folder:
            measure_all(arguments, folder)
        rospy.signal_shutdown('done')
    finally:
        master.terminate()
        master.wait()


if __name__ == '__main__':
    main()
