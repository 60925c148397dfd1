#!/usr/bin/python3
"""ktgp_bag with videos, images of a folder, and many recordings at once."""

import csv
import ctypes
import filecmp
import io
import json
import os
import signal
import subprocess
import sys
import unittest

import cv2
import numpy as np
import rosbag
import rospy

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from ktgp_testing import FolderCase, image_message, view

PROGRAM = os.environ['KTGP_ORB_BAG']
SIZE = 320, 240
FEW = ['--features', '300']
LIBC = ctypes.CDLL(None)


def pictures(count, x=100):
    return [cv2.cvtColor(view(x + 5 * i, 100 + 3 * (i % 2), *SIZE), cv2.COLOR_GRAY2BGR)
            for i in range(count)]


class RecordingCase(FolderCase):
    def write_bag(self, name, count=8, x=100):
        os.makedirs(os.path.dirname(self.path(name)), exist_ok=True)
        with rosbag.Bag(self.path(name), 'w') as bag:
            for i in range(count):
                stamp = rospy.Time.from_sec(1000 + i / 30.0)
                bag.write('/camera/image_raw', image_message(view(x + 5 * i, 100, *SIZE), stamp),
                          stamp)

    def write_video(self, name, count=12, rate=25.0):
        writer = cv2.VideoWriter(self.path(name), cv2.CAP_FFMPEG,
                                 cv2.VideoWriter_fourcc(*'mp4v'), rate, SIZE)
        self.assertTrue(writer.isOpened())
        for picture in pictures(count):
            writer.write(picture)
        writer.release()

    def start(self, *arguments, **options):
        return subprocess.Popen([PROGRAM] + FEW + list(arguments), cwd=self.folder,
                                stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                                universal_newlines=True, **options)

    def run_program(self, *arguments, **options):
        run = self.start(*arguments, **options)
        run.out, run.err = run.communicate(timeout=300)
        return run

    def statistics(self, name):
        with rosbag.Bag(self.path(name)) as bag:
            return [m for _, m, _ in bag.read_messages(topics=['/camera/matcher/statistics'])]


class VideoTest(RecordingCase):
    def test_a_video_has_the_times_of_its_container(self):
        self.write_video('in.mp4')
        run = self.run_program('in.mp4', 'out.bag')
        self.assertEqual(run.returncode, 0, run.err)
        messages = self.statistics('out.bag')
        self.assertEqual(messages[0].header.stamp, rospy.Time(0, 1))  # zero is no time for ROS
        np.testing.assert_allclose([m.header.stamp.to_sec() for m in messages],
                                   np.arange(12) / 25.0, atol=1e-6)
        self.assertEqual([m.status for m in messages], [1] + 11 * [0])
        self.assertGreater(messages[5].inliers, 50)

    def test_the_rate_and_a_part_of_a_video(self):
        self.write_video('in.mp4')
        run = self.run_program('in.mp4', 'out.bag', '--rate', '10', '--start', '0.2', '--duration', '0.5')
        self.assertEqual(run.returncode, 0, run.err)
        np.testing.assert_allclose([m.header.stamp.to_sec() for m in self.statistics('out.bag')],
                                   0.2 + np.arange(6) / 10.0, atol=1e-6)

    def test_the_steady_video_has_every_frame_at_the_videos_rate(self):
        self.write_video('in.mp4')
        run = self.run_program('in.mp4', 'out.bag', '--stabilize', 'steady.mp4')
        self.assertEqual(run.returncode, 0, run.err)
        self.assertIn('the path of the whole recording', run.err)
        steady = cv2.VideoCapture(self.path('steady.mp4'))
        self.assertEqual(steady.get(cv2.CAP_PROP_FRAME_COUNT), 12)
        self.assertAlmostEqual(steady.get(cv2.CAP_PROP_FPS), 25.0, places=3)

    def test_images_of_a_folder_in_the_order_of_their_numbers(self):
        os.mkdir(self.path('images'))
        for i, picture in enumerate(pictures(12)):
            cv2.imwrite(self.path('images', 'img%d.png' % i), picture)
        run = self.run_program('images/*.png', 'out.bag', '--rate', '5')
        self.assertEqual(run.returncode, 0, run.err)
        messages = self.statistics('out.bag')
        np.testing.assert_allclose([m.header.stamp.to_sec() for m in messages], np.arange(12) / 5.0,
                                   atol=1e-6)
        with rosbag.Bag(self.path('out.bag')) as bag:
            shifts = [m.homography[2] for _, m, _ in
                      bag.read_messages(topics=['/camera/matcher/homography'])][1:]
        np.testing.assert_allclose(shifts, -5.0, atol=0.5)  # img2 comes before img10

    def test_an_image_that_is_none_is_refused_alone(self):
        os.mkdir(self.path('images'))
        for i, picture in enumerate(pictures(4)):
            cv2.imwrite(self.path('images', '%d.png' % i), picture)
        with open(self.path('images', '2.png'), 'w') as file:
            file.write('no image')
        run = self.run_program('images/*', 'out.bag')
        self.assertEqual(run.returncode, 1, run.err)
        self.assertIn('3 images of /camera/image_raw matched, 1 refused', run.err)

    def test_what_cannot_be_read_is_said(self):
        with open(self.path('text.mp4'), 'w') as file:
            file.write('no video')
        os.mkfifo(self.path('pipe.mp4'))
        self.write_bag('in.bag')
        for arguments, expected in (
                (['text.mp4'], 'neither a bag nor a video'), (['none.mp4'], 'is missing'),
                (['pipe.mp4'], 'not a regular file'), (['none*.png'], 'nor one that fits it'),
                (['in.bag', '--rate', '3'], 'a bag has the times of its images')):
            run = self.run_program(arguments[0], 'out.bag', *arguments[1:])
            self.assertEqual(run.returncode, 2, run.err)
            self.assertIn(expected, run.err)
        self.write_video('in.mp4')
        for option, expected in ((['--topic', '/a'], 'there is no topic'),
                                 (['--rectify'], 'only a bag has')):
            run = self.run_program('in.mp4', 'out.bag', *option)
            self.assertEqual(run.returncode, 2, run.err)
            self.assertIn(expected, run.err)

    def test_the_table_goes_to_standard_output(self):
        self.write_bag('in.bag')
        run = self.run_program('in.bag', 'out.bag', '--csv', '-')
        self.assertEqual(run.returncode, 0, run.err)
        rows = list(csv.DictReader(io.StringIO(run.out)))
        self.assertEqual([row['status'] for row in rows], ['no_reference'] + 7 * ['ok'])
        self.assertEqual(sorted(os.listdir(self.folder)), ['in.bag', 'out.bag'])


def obey_permissions():
    """Root may read what is locked; after this and exec it may not (prctl: PR_CAPBSET_DROP of
    CAP_DAC_OVERRIDE and CAP_DAC_READ_SEARCH)."""
    for capability in (1, 2):
        LIBC.prctl(24, capability, 0, 0, 0)


class BatchTest(RecordingCase):
    OPTIONS = ['--csv', 'matched.csv', '--stabilize', 'steady.mp4']

    def write_list(self, rows):
        with open(self.path('list'), 'w') as file:
            file.write(''.join(row + '\n' for row in rows))

    def batch(self, folder, *arguments, **options):
        return self.run_program('--batch', 'list', folder, *(self.OPTIONS + list(arguments)), **options)

    def summary(self, folder):
        with open(self.path(folder, 'summary.csv'), newline='') as file:
            return list(csv.DictReader(file))

    def files(self, folder):
        return sorted(os.path.relpath(os.path.join(where, name), self.path(folder))
                      for where, _, names in os.walk(self.path(folder)) for name in names)

    def assert_same(self, one, other):
        self.assertEqual(self.files(one), self.files(other))
        _, different, errors = filecmp.cmpfiles(self.path(one), self.path(other), self.files(one),
                                                shallow=False)
        self.assertEqual((different, errors), ([], []))

    def write_recordings(self, count):
        names = ['robot%d/run.bag' % i for i in range(count)]
        for i, name in enumerate(names):
            self.write_bag(name, x=100 + 20 * i)
        self.write_list(names)
        return names

    def test_the_results_are_the_same_whatever_the_number_of_jobs(self):
        names = self.write_recordings(4)
        self.write_video('in.mp4')
        self.write_list(names + ['in.mp4'])
        for folder, arguments in (('one', ['--jobs', '1', '--threads', '1']),
                                  ('many', ['--jobs', '5', '--threads', '2'])):
            run = self.batch(folder, *arguments)
            self.assertEqual(run.returncode, 0, run.err)
        self.assert_same('one', 'many')
        self.assertEqual(self.files('one'), sorted(
            [os.path.join(name, file) for name in names + ['in.mp4']
             for file in ('manifest.json', 'matched.bag', 'matched.csv', 'steady.mp4')] +
            ['summary.csv']))
        self.assertEqual([(row['recording'], row['status'], row['images'], row['found'])
                          for row in self.summary('one')],
                         [(name, 'done', '8', '7') for name in names] + [('in.mp4', 'done', '12', '11')])

    def test_parts_give_the_same_and_a_last_run_sums_up(self):
        self.write_recordings(5)
        for part in ('1/2', '2/2'):
            run = self.batch('parts', '--part', part)
            self.assertEqual(run.returncode, 0, run.err)
        self.assertNotIn('summary.csv', self.files('parts'))
        self.assertIn('5 were finished before', self.batch('parts').err)
        self.batch('whole')
        self.assert_same('parts', 'whole')
        for part in ('0/2', '3/2', 'x', '1/2/3', '-1/2'):
            self.assertEqual(self.batch('parts', '--part=' + part).returncode, 2, part)

    def test_finished_ones_are_skipped_until_something_changes(self):
        names = self.write_recordings(3)
        self.batch('out')

        def made(folder='out'):
            return [os.stat(self.path(folder, name)).st_ino for name in names]
        before = made()
        self.assertIn('3 were finished before', self.batch('out').err)
        self.assertEqual(made(), before)
        self.write_bag(names[1], count=9)
        self.assertIn('2 were finished before', self.batch('out').err)
        after = made()
        self.assertEqual([a == b for a, b in zip(before, after)], [True, False, True])
        self.assertIn('0 were finished before', self.batch('out', '--T_w', '0.7').err)
        with open(self.path('out', names[0], 'manifest.json')) as file:
            manifest = json.load(file)
        self.assertEqual(manifest['input_size'], os.path.getsize(self.path(names[0])))
        manifest['program'] = 'ktgp_orb 0.0.1'
        with open(self.path('out', names[0], 'manifest.json'), 'w') as file:
            json.dump(manifest, file)
        self.assertIn('2 were finished before', self.batch('out', '--T_w', '0.7').err)

    def test_a_folder_that_is_no_result_is_left_alone(self):
        names = self.write_recordings(1)
        os.makedirs(self.path('out', names[0]))
        with open(self.path('out', names[0], 'mine'), 'w') as file:
            file.write('mine')
        run = self.batch('out')
        self.assertEqual(run.returncode, 1)
        self.assertIn('is not the result of a batch', run.err)
        self.assertEqual(self.files('out'), [os.path.join(names[0], 'mine'), 'summary.csv'])

    def test_each_of_500_bad_inputs_has_its_line(self):
        self.write_bag('good.bag', count=3)
        with open(self.path('good.bag'), 'rb') as file:
            content = file.read()
        rows = []
        for i in range(125):
            for kind, data in (('damaged', content[:len(content) // 2 + i]), ('empty', b''),
                               ('locked', content)):
                rows.append('%s%d.bag' % (kind, i))
                with open(self.path(rows[-1]), 'wb') as file:
                    file.write(data)
                if kind == 'locked':
                    os.chmod(self.path(rows[-1]), 0)
            rows.append('damaged%d.bag' % i)  # a duplicate
        self.write_list(rows + ['good.bag'])
        options = {'preexec_fn': obey_permissions} if os.getuid() == 0 else {}
        run = self.run_program('--batch', 'list', 'out', **options)
        self.assertEqual(run.returncode, 1, run.err[-2000:])
        found = self.summary('out')
        self.assertEqual([row['recording'] for row in found], rows + ['good.bag'])
        self.assertEqual(found[-1]['status'], 'done')
        for i, row in enumerate(found[:-1]):
            status, code, reason = [('incomplete', '1', 'lost'), ('failed', '2', 'not a bag'),
                                    ('failed', '2', 'cannot be opened'),
                                    ('failed', '2', 'is the recording of row %d' % (i - 2))][i % 4]
            self.assertEqual((row['status'], row['exit_code']), (status, code), row)
            self.assertIn(reason, row['reason'])
            self.assertIn('row %d: %s: exit code %s: ' % (i + 1, row['recording'], code), run.err)

    def test_a_killed_batch_loses_only_the_recordings_at_work(self):
        names = self.write_recordings(6)
        self.batch('expected')
        finished = 0
        while finished < len(names) - 1:
            run = self.start('--batch', 'list', 'out', *self.OPTIONS, '--jobs', '2',
                             preexec_fn=os.setsid)
            wanted = finished + 1
            while run.poll() is None and self.finished('out', names) < wanted:
                pass
            os.killpg(run.pid, signal.SIGKILL)
            run.communicate()
            # Whatever has its name is whole.
            now = self.finished('out', names)
            self.assertGreaterEqual(now, wanted)
            for name in names:
                for file in (self.files('expected/' + name) if os.path.exists(self.path('out', name)) else ()):
                    self.assertTrue(filecmp.cmp(self.path('expected', name, file),
                                                self.path('out', name, file), shallow=False))
            finished = now
        run = self.batch('out')
        self.assertEqual(run.returncode, 0, run.err)
        self.assertIn('%d were finished before' % finished, run.err)
        self.assert_same('out', 'expected')

    def finished(self, folder, names):
        return sum(os.path.exists(self.path(folder, name)) for name in names)

    def test_a_worker_that_is_killed_is_listed_and_the_others_go_on(self):
        names = self.write_recordings(3)
        self.write_bag(names[0], count=400)
        run = self.start('--batch', 'list', 'out', '--jobs', '1')
        children = '/proc/%d/task/%d/children' % (run.pid, run.pid)
        worker = ''
        while not worker and run.poll() is None:
            with open(children) as file:
                worker = file.read().split(' ')[0]
        os.kill(int(worker), signal.SIGKILL)
        _, err = run.communicate(timeout=300)
        self.assertEqual(run.returncode, 1, err)
        self.assertEqual([(row['status'], row['exit_code'], row['reason']) for row in self.summary('out')],
                         [('failed', '137', 'ended by signal 9')] + 2 * [('done', '0', '')])

    def test_ctrl_c_leaves_only_whole_results(self):
        names = self.write_recordings(6)
        run = self.start('--batch', 'list', 'out', '--jobs', '1')
        while run.poll() is None and self.finished('out', names) < 1:
            pass
        run.send_signal(signal.SIGTERM)
        _, err = run.communicate(timeout=300)
        self.assertIn(run.returncode, (0, 130), err)
        self.assertFalse(os.path.exists(self.path('out', '.unfinished')), err)
        self.assertEqual(self.batch('out').returncode, 0)

    def test_names_that_do_not_belong_into_a_folder_are_refused(self):
        self.write_recordings(1)
        for option in (['--csv', '-'], ['--mosaic', '/tmp/map.png']):
            run = self.run_program('--batch', 'list', 'out', *option)
            self.assertEqual(run.returncode, 2, run.err)
            self.assertIn('in a batch, expected a name', run.err)
        run = self.run_program('--batch', 'list')
        self.assertIn('needs one name, that of the output folder', run.err)
        run = self.run_program('--batch', 'none', 'out')
        self.assertEqual(run.returncode, 2)
        self.assertIn('none: cannot be opened', run.err)


if __name__ == '__main__':
    unittest.main()
