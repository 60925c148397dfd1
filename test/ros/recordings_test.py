"""ktgp_bag with videos, images of a folder, and many recordings."""

import contextlib
import csv
import glob
import io
import os
import re
import shlex
import shutil
import signal
import struct
import time
import unittest

import cv2
import numpy as np
import rosbag
import rospy
from ktgp_testing import FolderCase, images_of, messages_of, view, views, write_bag, write_tiff

PROGRAM = os.environ['KTGP_ORB_BAG']
ROOT = os.path.realpath(os.path.join(os.path.dirname(os.path.abspath(__file__)), '../..'))
SIZE = 320, 240
FEW = ['--features', '300']


def pictures(count, x=100):
    return [cv2.cvtColor(view(x + 5 * i, 100 + 3 * (i % 2), *SIZE), cv2.COLOR_GRAY2BGR)
            for i in range(count)]


class RecordingCase(FolderCase):
    def write_bag(self, name, count=8, x=100):
        os.makedirs(os.path.dirname(self.path(name)), exist_ok=True)
        write_bag(self.path(name), views(count, x))

    def write_video(self, name, count=12, rate=25.0):
        writer = cv2.VideoWriter(self.path(name), cv2.CAP_FFMPEG,
                                 cv2.VideoWriter_fourcc(*'mp4v'), rate, SIZE)
        self.assertTrue(writer.isOpened())
        for picture in pictures(count):
            writer.write(picture)
        writer.release()

    def match(self, *arguments, **expected):
        return self.run_program(PROGRAM, *FEW, *arguments, **expected)

    def statistics(self, name):
        return messages_of(self.path(name), '/camera/matcher/statistics')

    def check_times(self, expected, tolerance=1e-6):
        times = [m.header.stamp.to_sec() for m in self.statistics('out.bag')]
        np.testing.assert_allclose(times, expected, atol=tolerance)

    def identity(self, name):
        """Changes if the file is written again; reading it changes nothing here, unlike in all of os.stat."""
        status = os.stat(self.path(name))
        return status.st_ino, status.st_size, status.st_mtime_ns

    def write_images(self, pattern, images):
        (self.folder / 'images').mkdir()
        for i, picture in enumerate(images):
            cv2.imwrite(self.path('images', pattern % i), picture)


class VideoTest(RecordingCase):
    def test_a_video_has_the_times_of_its_container(self):
        self.write_video('in.mp4')
        self.match('in.mp4', 'out.bag')
        messages = self.statistics('out.bag')
        self.assertEqual(messages[0].header.stamp, rospy.Time(0, 1))  # zero is no time for ROS
        self.check_times(np.arange(12) / 25.0)
        self.assertEqual([m.status for m in messages], [1] + 11 * [0])
        self.assertGreater(messages[5].inliers, 50)

    def film(self, name, *options, rate='30', seconds='2'):
        self.run_program('ffmpeg', '-v', 'error', '-f', 'lavfi', '-i', 'testsrc=size=320x240:rate=%s:duration=%s' %
                         (rate, seconds), *options, name)

    def probed(self, name):
        """The times of the images, from the first one on."""
        run = self.run_program('ffprobe', '-v', 'error', '-select_streams', 'v', '-show_entries',
                               'frame=best_effort_timestamp_time', '-of', 'csv=p=0', name)
        times = np.array([float(line.strip(',')) for line in run.stdout.split()])
        return times - times[0]

    @unittest.skipIf(shutil.which('ffprobe') is None, 'ffmpeg is not installed')
    def test_the_times_are_those_of_ffprobe(self):
        h264 = ['-c:v', 'libx264']  # with B-frames
        gap = ['-vf', "select='not(between(n,20,29))'", '-vsync', 'vfr']
        self.film('b.mp4', *h264)
        self.film('b.mkv', *h264)
        self.film('plain.mp4', *h264, '-bf', '0')
        self.film('three.mp4', *h264, seconds='0.1')
        self.film('two.mp4', *h264, rate='0.2', seconds='10')
        self.film('gap.mp4', *h264, *gap)
        self.film('late.mkv', *h264, '-output_ts_offset', '100000')
        self.film('late.ts', *h264, '-output_ts_offset', '10')
        # As of a recorder of the screen: 30/s, then 5/s.
        self.film('slower.mkv', *h264, '-vf', "select='lt(n,60)+not(mod(n,6))'", '-vsync', 'vfr', seconds='10')
        for name in ('b.mp4', 'b.mkv', 'plain.mp4', 'three.mp4', 'two.mp4', 'gap.mp4', 'late.mkv', 'late.ts',
                     'slower.mkv'):
            expected = self.probed(name)
            with self.subTest(name):
                self.match(name, 'out.bag', '--force', words=images_of(len(expected)))
                self.check_times(expected, 2e-3)
                late = int((expected > 0.99).sum())
                self.match(name, 'out.bag', '--force', '--start', '0.99', code=0 if late else 2,
                           words=images_of(late) if late else 'no readable image in the selected time')

    @unittest.skipIf(shutil.which('ffprobe') is None, 'ffmpeg is not installed')
    def test_a_video_that_begins_late_or_has_few_images_a_second_is_whole(self):
        self.film('in.mp4', '-c:v', 'libx264')
        self.run_program('ffmpeg', '-v', 'error', '-itsoffset', '5', '-i', 'in.mp4', '-c', 'copy', 'late.mkv')
        self.film('few.ts', '-c:v', 'libx264', '-bf', '0', '-vf', "select='not(mod(n,3))'", '-vsync', 'vfr')
        for name in ('late.mkv', 'few.ts'):
            run = self.match(name, 'out.bag', '--force', words=images_of(len(self.probed(name))))
            self.assertNotIn('damaged', run.stderr, name)

    @unittest.skipIf(shutil.which('ffprobe') is None, 'ffmpeg is not installed')
    def test_a_video_that_was_cut_off_is_called_so(self):
        self.film('in.mkv', '-c:v', 'libx264')
        self.damage('in.mkv', 0.5)
        run = self.match('in.mkv', 'out.bag', code=1, words='the video is damaged or cut off')
        self.assertNotIn('reindex', run.stderr)

    def test_a_video_that_was_cut_without_encoding_it_again_is_not_damaged(self):
        """An edit list hides the first 15 of 40 images, as after `ffmpeg -ss 0.6 -i in.mp4 -c copy`."""
        self.write_video('in.mp4', count=40)
        video = self.folder / 'in.mp4'
        content = bytearray(video.read_bytes())
        place = content.index(b'elst') + 12
        length, begin = struct.unpack('>ii', content[place:place + 8])
        ticks = struct.unpack('>i', content[content.index(b'mdhd') + 16:][:4])[0]
        content[place:place + 8] = struct.pack('>ii', length * 25 // 40, begin + ticks * 15 // 25)
        video.write_bytes(content)
        run = self.match('in.mp4', 'out.bag', words='25 images of')
        self.assertNotIn('damaged', run.stderr)
        # The same, with the second half of the images destroyed.
        cut = content.index(b'mdat') + 4
        size = struct.unpack('>i', content[cut - 8:cut - 4])[0] - 8
        content[cut + size // 2:cut + size] = bytes(size - size // 2)
        video.write_bytes(content)
        self.match('in.mp4', 'out.bag', '--force', code=1, words='the video is damaged or cut off')

    def test_the_rate_and_a_part_of_a_video(self):
        self.write_video('in.mp4')
        self.match('in.mp4', 'out.bag', '--rate', '10', '--start', '0.2', '--duration', '0.5')
        self.check_times(0.2 + np.arange(6) / 10.0)

    def test_the_steady_video_has_every_frame_at_the_videos_rate(self):
        self.write_video('in.mp4')
        self.match('in.mp4', 'out.bag', '--stabilize', 'steady.mp4', words='the path of the whole recording')
        steady = cv2.VideoCapture(self.path('steady.mp4'))
        self.assertEqual(steady.get(cv2.CAP_PROP_FRAME_COUNT), 12)
        self.assertAlmostEqual(steady.get(cv2.CAP_PROP_FPS), 25.0, places=3)

    def test_the_matches_are_drawn_as_a_video_and_summed_up(self):
        self.write_video('in.mp4')
        run = self.match('in.mp4', 'out.bag', '--draw', 'matches.mp4')
        self.assertRegex(run.stderr, r'\n11 homographies, median of [1-9]\d* inliers, \d+\.\d\d ms an image; '
                         r'without: 1 no_reference\n')
        video = cv2.VideoCapture(self.path('matches.mp4'))
        self.assertEqual(video.get(cv2.CAP_PROP_FRAME_COUNT), 12)
        video.set(cv2.CAP_PROP_POS_FRAMES, 5)
        picture = video.read()[1].astype(int)
        self.assertGreater((np.ptp(picture, axis=2) > 60).sum(), 100, 'strokes have colours')
        with rosbag.Bag(self.path('out.bag')) as bag:
            self.assertEqual(bag.get_message_count('/camera/matcher/matches_image'), 0)

    def test_images_of_a_folder_in_the_order_of_their_numbers(self):
        self.write_images('img%d.png', pictures(12))
        self.match('images/*.png', 'out.bag', '--rate', '5')
        self.check_times(np.arange(12) / 5.0)
        shifts = [m.homography[2] for m in messages_of(self.path('out.bag'), '/camera/matcher/homography')][1:]
        np.testing.assert_allclose(shifts, -5.0, atol=0.5)  # img2 comes before img10

    def test_times_as_names_are_in_their_order_and_an_odd_name_is_reported(self):
        """Decimals without the zeros at their ends, as Python's str(time.time()) has them."""
        times = [1700000000.05 + i / 30 + 1e-3 * (i % 3) for i in range(14)]
        names = ['%r.png' % round(t, 4 if i % 2 else 6) for i, t in enumerate(times)]
        self.assertGreater(len({len(name) for name in names}), 1)
        os.mkdir(self.path('images'))
        for name, picture in zip(names, pictures(14)):
            cv2.imwrite(self.path('images', name), picture)
        run = self.match('images/*', 'out.bag', words='13 homographies')
        self.assertNotIn('its name', run.stderr)
        shifts = [m.homography[2] for m in messages_of(self.path('out.bag'), '/camera/matcher/homography')][1:]
        np.testing.assert_allclose(shifts, -5.0, atol=0.5)
        cv2.imwrite(self.path('images', 'last of all.png'), pictures(15)[-1])
        self.match('images/*', 'out.bag', '--force', words="ktgp_bag: images/last of all.png: its name is not like the "
                   "others', which decide the order; it is image 15 of 15")

    def test_files_of_other_kinds_are_named_with_what_to_do(self):
        (self.folder / 'IMG_0001.HEIC').write_bytes(struct.pack('>I', 24) + b'ftypheic' + bytes(1000))
        (self.folder / 'a.mcap').write_bytes(b'\x89MCAP0\r\n' + bytes(1000))
        (self.folder / 'b.db3').write_bytes(b'SQLite format 3\0' + bytes(1000))
        (self.folder / 'c.bag.gz').write_bytes(b'\x1f\x8b' + bytes(1000))
        (self.folder / 'old.bag').write_bytes(b'#ROSBAG V1.2\n' + bytes(1000))
        os.makedirs(self.path('ros2'))
        self.write('ros2/metadata.yaml', 'rosbag2_bagfile_information: {}')
        os.makedirs(self.path('pictures'))
        for name, words in (('a.mcap', 'a.mcap is a recording of ROS 2; convert it to a bag with rosbags-convert'),
                            ('b.db3', 'ROS 2'), ('ros2', 'ros2: is a recording of ROS 2'),
                            ('pictures', "is a folder; expected a file, or a pattern of images: 'folder/*.png'"),
                            ('c.bag.gz', 'is packed with gzip; unpack it'),
                            ('old.bag', "is a bag of format 1; convert it with 'rosbag fix'"),
                            ('IMG_0001.HEIC', 'is a HEIC (HEIF) picture')):
            self.match(name, 'out.bag', code=2, words=words)
        self.match('IMG_*.HEIC', 'out.bag', code=2, words='cannot be read as an image: it is a HEIC (HEIF) picture')

    @unittest.skipIf(shutil.which('ffmpeg') is None, 'ffmpeg is not installed')
    def test_interlaced_video_has_the_mean_motion_of_its_fields(self):
        """The second field, 20 ms later, is moved by 3 px more."""
        way = np.cumsum([0] + [3, 2] * 12)  # px, of each field
        frames = []
        for i in range(12):
            frame, later = (view(100 + way[2 * i + field], 100, *SIZE).copy() for field in (0, 1))
            frame[1::2] = later[1::2]
            frames.append(cv2.cvtColor(frame, cv2.COLOR_GRAY2BGR))
        for i, frame in enumerate(frames):
            cv2.imwrite(self.path('f%d.png' % i), frame)
        self.run_program('ffmpeg', '-v', 'error', '-r', '25', '-i', 'f%d.png', '-vf', 'setfield=tff', '-c:v', 'ffv1',
                         '-flags', '+ildct+ilme', 'in.mkv')
        self.match('in.mkv', 'out.bag', words='11 homographies')
        shifts = [m.homography[2] for m in messages_of(self.path('out.bag'), '/camera/matcher/homography')][1:]
        np.testing.assert_allclose(shifts, -5.0, atol=0.5)

    def test_photographs_of_a_survey_are_placed_in_one_map(self):
        """2 s apart, with 63 % overlap, turned, made smaller first."""
        large = cv2.resize(view(0, 0, 640, 480), None, fx=6, fy=6, interpolation=cv2.INTER_CUBIC)
        side, step = 1400, 518

        def seen(i):
            turn = cv2.getRotationMatrix2D((side / 2 + step * i, 1440), 4.0 * i, 1.0)
            turn[:, 2] += (-step * i, -1440 + side / 2)
            return cv2.warpAffine(large, turn, (side, side))
        self.write_images('%d.jpg', map(seen, range(4)))
        self.match('images/*.jpg', 'out.bag', '--rate', '0.5', '--longest_side', '500', '--preset', 'photo',
                   '--mosaic', 'map.png', words=('3 homographies', '4 frames, 0 of them lost'))
        cv2.imwrite(self.path('strip.png'), np.zeros((2, 400), np.uint8))
        self.match('strip*.png', 'strip.bag', '--longest_side', '32',  # 32x1 px
                   words='1 image of /camera/image_raw matched')
        found = messages_of(self.path('out.bag'), '/camera/matcher/homography')[1].homography
        self.assertAlmostEqual(np.degrees(np.arctan2(found[3], found[0])), -4.0, delta=0.2)

    def test_the_camera_is_that_of_the_photographs_when_they_are_made_smaller(self):
        scene = [cv2.resize(picture, None, fx=4, fy=4, interpolation=cv2.INTER_CUBIC) for picture in pictures(3)]
        self.write_images('%d.png', scene)
        cv2.imwrite(self.path('poster.png'), view(110, 110, 220, 150))
        self.write('targets.yaml', '- {id: poster, image: poster.png, width: 0.22}\n')
        (self.folder / 'small').mkdir()
        for i, picture in enumerate(scene):  # 1280x960 px
            cv2.imwrite(self.path('small', '%d.png' % i), cv2.resize(picture, SIZE, interpolation=cv2.INTER_AREA))
        positions = []
        for images, options in (('images/*', ('1000,1004,647.5,487.5', '--longest_side', '320')),
                                ('small/*', ('250,251,161.5,121.5',))):
            self.match(images, 'out.bag', '--force', '--targets', 'targets.yaml', '--camera', *options)
            positions.append([(p.x, p.y, p.z) for message in messages_of(self.path('out.bag'), '/camera/targets/detections')
                              for p in [each.pose.pose.position for each in message.detections]])
        self.assertEqual(len(positions[1]), 3)
        np.testing.assert_allclose(positions[0], positions[1], rtol=1e-9)

    def test_pages_that_are_not_used_are_counted(self):
        (self.folder / 'images').mkdir()
        for i in range(4):
            write_tiff(self.path('images', '%d.tiff' % i), view(100 + 5 * i, 100, *SIZE), (0, 0) if i else (0,))
        text = self.match('images/*', 'out.bag', words=(
            'ktgp_bag: images/1.tiff: has 2 pages; only the first is used, as of 2 more files')).stderr
        self.assertEqual(text.count('pages'), 1)

    def test_a_quoted_pattern_may_begin_with_the_home_folder(self):
        self.write_images('%d.png', pictures(4))
        self.match('~/images/*.png', 'out.bag', env=dict(os.environ, HOME=str(self.folder)), words='4 images of')

    def test_why_images_have_no_reference_is_said(self):
        small, large = pictures(4), [cv2.resize(each, (400, 300)) for each in pictures(4)]
        self.write_images('%d.png', (each for pair in zip(small, large) for each in pair))
        self.match('images/*', 'out.bag', words='; without: 8 no_reference (first_frame: 1, size_changed: 7)')
        self.match('images/?.png', 'same.bag', '--longest_side', '320', words='; without: 1 no_reference\n')

    def test_a_video_in_a_pattern_is_told_from_pictures(self):
        self.write_images('%d.png', pictures(3))
        self.write_video('images/3.mp4')
        self.match('images/*', 'out.bag', code=1, words=(
            '3 images of /camera/image_raw matched, 1 refused',
            'images/3.mp4: cannot be read as an image: it is a video; ktgp_bag matches a video that is given alone'))

    def test_large_photographs_that_are_not_recognised_are_named_once(self):
        noise = np.random.RandomState(1)
        self.write_images('%d.png', (noise.randint(0, 256, (300, 2600), np.uint8) for _ in range(4)))
        hint = 'the images are 2600 px long; made 1000 to 2500 px long first, they may be recognised (--longest_side'
        self.assertEqual(self.match('images/*', 'out.bag', '--rate', '1').stderr.count(hint), 1)
        small = self.match('images/*', 'small.bag', '--rate', '1', '--longest_side', '1000', words='; without: ')
        self.assertNotIn('px long', small.stderr)

    def test_bad_image_does_not_stop_the_others(self):
        self.write_images('%d.png', pictures(4))
        self.write('images/2.png', 'no image')
        self.match('images/*', 'out.bag', code=1, words=('3 images of /camera/image_raw matched, 1 refused',
                                                         '1 image could not be used because: images/2.png: cannot be read'))

    def test_a_picture_without_its_end_is_refused_and_one_with_more_is_read(self):
        os.mkdir(self.path('images'))
        for i, ending in enumerate(('.png', '.jpg', '.png', '.jpg', '.jpg')):
            content = cv2.imencode(ending, pictures(5)[i],
                                   [cv2.IMWRITE_JPEG_PROGRESSIVE, int(i == 4)] if ending == '.jpg' else [])[1].tobytes()
            preview = b'\xff\xe1\x00\x06\xff\xd9\xff\xd9'  # a segment with an end of its own
            if ending == '.jpg':
                content = content[:2] + preview + content[2:]
            content = content + b'more' if i in (0, 1, 4) else content[:len(content) * 2 // 3]
            (self.folder / 'images' / ('%d%s' % (i, ending))).write_bytes(content)
        run = self.match('images/*', 'out.bag', '--csv', 'out.csv', code=1,
                         words=('3 images of /camera/image_raw matched, 2 refused',
                                'the first because: images/2.png: is damaged or cut off'))
        self.assertNotIn('libpng', run.stderr)
        self.assertNotIn('JPEG data', run.stderr)
        self.assertIn('images/3.jpg: is damaged or cut off', self.read('out.csv'))

    def test_unreadable_input_is_reported(self):
        self.write('text.mp4', 'no video')
        os.mkfifo(self.path('pipe.mp4'))
        self.write_bag('in.bag')
        run = self.match('text.mp4', 'out.bag', code=2)
        self.assertEqual(len(run.stderr.splitlines()), 1, run.stderr)  # ours alone, not OpenCV's and FFmpeg's
        for arguments, expected in (
                (['text.mp4'], 'neither a bag nor a video'), (['none.mp4'], 'is missing'),
                (['pipe.mp4'], 'not a regular file'), (['none*.png'], 'nor one that fits it'),
                (['in.bag', '--rate', '3'], 'a bag has the times of its images'),
                (['in.bag', '--longest_side', '500'], 'used only with a pattern of images')):
            self.match(arguments[0], 'out.bag', *arguments[1:], code=2, words=expected)
        self.write_video('in.mp4')
        for option, expected in ((['--topic', '/a'], 'there is no topic'),
                                 (['--rectify'], 'only a bag has')):
            self.match('in.mp4', 'out.bag', *option, code=2, words=expected)

    def test_the_table_goes_to_standard_output(self):
        self.write_bag('in.bag')
        run = self.match('in.bag', 'out.bag', '--csv', '-')
        rows = list(csv.DictReader(io.StringIO(run.stdout)))
        self.assertEqual([row['status'] for row in rows], ['no_reference'] + 7 * ['ok'])
        self.assertEqual(sorted(os.listdir(self.folder)), ['in.bag', 'out.bag'])


class ManyRecordingsTest(RecordingCase):
    """examples/fleet/one_recording.sh, by whatever runs commands in parallel."""
    ONE = os.path.join(ROOT, 'examples/fleet/one_recording.sh')
    OPTIONS = ['results', '--features', '300', '--csv', 'matched.csv', '--stabilize', 'steady.mp4']
    FILES = ['matched.bag', 'matched.csv', 'steady.mp4']
    environment = dict(os.environ, PATH=os.path.dirname(PROGRAM) + ':' + os.environ['PATH'])

    def start_all(self, *command):
        self.write('list', ''.join(name + '\n' for name in self.names))
        with open(self.path('list')) as file:
            return self.start(*command, self.ONE, '{}', *self.OPTIONS,
                              *(['::::', 'list'] if command[0] == 'parallel' else []), stdin=file, stdout=None,
                              env=dict(self.environment, HOME=self.folder), start_new_session=True)

    def finished(self):
        return [os.stat(self.path('results', name, 'matched.bag')).st_ino for name in self.names
                if os.path.exists(self.path('results', name, 'matched.bag'))]

    @staticmethod
    def running_in_session(session):
        running = []
        for path in glob.glob('/proc/[0-9]*/stat'):
            try:
                with open(path) as file:
                    state, _, _, its_session = file.read().rpartition(')')[2].split()[:4]
            except OSError:
                continue  # it has ended
            if int(its_session) == session and state != 'Z':
                running.append(int(path.split('/')[2]))
        return running

    def kill_session(self, run):
        """GNU parallel gives each job a process group of its own, but all are in one session."""
        while self.running_in_session(run.pid):
            for pid in self.running_in_session(run.pid):
                with contextlib.suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGKILL)
            time.sleep(0.01)
        run.communicate()

    def check_that_a_rerun_completes_what_was_killed(self, *command):
        self.names = ['robot%d/my run.bag' % i for i in range(4)]
        for i, name in enumerate(self.names):
            self.write_bag(name, x=100 + 20 * i)
        run = self.start_all(*command)
        while len(self.finished()) < 2 and run.poll() is None:
            time.sleep(0.01)
        self.kill_session(run)
        before = self.finished()
        run = self.start_all(*command)
        _, err = run.communicate(timeout=300)
        self.assertEqual(run.returncode, 0, err)
        self.assertEqual(err.count('matched.bag is finished'), len(before), err)
        self.assertLessEqual(set(before), set(self.finished()))
        for name in self.names:
            self.assertLessEqual(set(self.FILES), set(os.listdir(self.path('results', name))))
            with rosbag.Bag(self.path('results', name, 'matched.bag')) as bag:
                self.assertEqual(bag.get_message_count('/camera/matcher/homography'), 8)
            self.assertEqual(len(self.table(self.path('results', name, 'matched.csv'))), 8)

    def test_a_rerun_of_xargs_completes_what_was_killed(self):
        self.check_that_a_rerun_completes_what_was_killed('xargs', '-d', '\n', '-P', '2', '-I', '{}')

    @unittest.skipIf(shutil.which('parallel') is None, 'GNU parallel is not installed')
    def test_a_rerun_of_parallel_completes_what_was_killed(self):
        self.check_that_a_rerun_completes_what_was_killed('parallel', '--will-cite', '-q', '-j', '2')

    def test_a_task_of_slurm_processes_its_row_of_the_list(self):
        """As sbatch does it: the text of --wrap is a script of /bin/sh, which gets the number of its task."""
        with open(os.path.join(ROOT, 'doc/fleet.md')) as file:
            line, = re.findall('^    (sbatch .*)$', file.read(), re.M)
        words = shlex.split(line)
        script = words[words.index('--wrap') + 1]
        os.symlink(os.path.join(ROOT, 'examples'), self.path('examples'))
        names = ['robot1/my run.bag', "it's 2.bag", '$(touch evil).bag']
        self.write('list.txt', ''.join(name + '\n' for name in names))

        def run(task, **expected):
            return self.run_program('/bin/sh', '-c', script, **expected,
                                    env=dict(self.environment, SLURM_ARRAY_TASK_ID=str(task)))
        for i, name in enumerate(names):
            self.write_bag(name)
            for words in ('8 images of /camera/image_raw matched', 'matched.bag is finished'):
                run(i + 1, words=words)
            self.assertEqual(sorted(os.listdir(self.path('results', name))), ['matched.bag', 'matched.csv'])
            for later in names[i + 1:]:
                self.assertFalse(os.path.exists(self.path('results', later)), 'row %d' % (i + 1))
        self.assertFalse(os.path.exists(self.path('evil')))
        run(len(names) + 1, code=2, words='is there an empty row in the list?')  # --array is too long

    def test_strange_rows_harm_no_other_recording(self):
        self.write_bag('good.bag')
        self.names = ['.', '/', 'no.bag', 'good.bag', '$(touch evil)', '..']
        run = self.start_all('xargs', '-d', '\n', '-P', '2', '-I', '{}')
        _, err = run.communicate(timeout=300)
        self.assertEqual(run.returncode, 123, err)
        self.assertIn('no.bag: is missing', err)
        self.assertFalse(os.path.exists(self.path('evil')))
        self.assertEqual(sorted(os.listdir(self.path('results', 'good.bag'))), self.FILES)

    def one(self, *arguments, **expected):
        return self.run_program(self.ONE, *arguments, env=self.environment, **expected)

    def test_the_script_says_what_it_needs(self):
        for arguments, words in (([], 'expected RECORDING FOLDER'), (['in.bag'], 'expected RECORDING FOLDER'),
                                 (['', 'results'], 'is there an empty row in the list?'),
                                 (['\r', 'results'], 'is there an empty row in the list?'),
                                 (['in.bag', ''], 'the folder for the results is empty')):
            run = self.one(*arguments, code=2, words=words)
            self.assertEqual(len(run.stderr.splitlines()), 1, run.stderr)
        self.assertEqual(os.listdir(self.folder), [])

    def test_a_pattern_is_not_read_into_the_name_of_this_folder(self):
        for folder, count in (('day[1]', 4), ('day1', 6)):
            os.makedirs(self.path(folder, 'images'))
            for i, picture in enumerate(pictures(count)):
                cv2.imwrite(self.path(folder, 'images', '%d.png' % i), picture)
        self.one('images/*.png', 'results', *FEW, cwd=self.path('day[1]'), words='4 images of')
        self.one('../day1/images/*.png', 'results', *FEW, cwd=self.path('day[1]'), words='6 images of')

    def test_a_folder_that_cannot_be_made_has_the_exit_code_of_no_results(self):
        self.write('results', 'mine')
        self.one('in.bag', 'results', code=2, words='results')

    def test_the_end_of_the_script_is_that_of_its_program(self):
        self.write_bag('in.bag', count=400)
        run = self.start(self.ONE, 'in.bag', 'results', *FEW, env=self.environment)
        while not glob.glob(self.path('results/in.bag/*unfinished*')) and run.poll() is None:
            time.sleep(0.001)
        run.send_signal(signal.SIGTERM)
        _, err = run.communicate(timeout=300)
        self.assertEqual(run.returncode, 130, err)
        self.assertEqual(os.listdir(self.path('results/in.bag')), [])

    def test_a_list_of_windows_is_read(self):
        self.write_bag('in.bag')
        self.one('in.bag\r', 'results', '--features', '300')
        self.assertTrue(os.path.exists(self.path('results', 'in.bag', 'matched.bag')))

    def test_a_folder_is_not_finished(self):
        self.write_bag('in.bag')
        os.mkdir(self.path('out.bag'))
        self.match('--skip_finished', 'in.bag', 'out.bag', code=2, words='out.bag: is not a regular file')

    def test_a_recording_of_which_a_part_was_used_keeps_its_exit_code(self):
        self.write_images('%d.png', pictures(4))
        self.write('images/2.png', 'no image')
        command = '--skip_finished', 'images/*', 'out.bag', '--csv', 'out.csv', '--name', 'other'
        reason = '1 image could not be used because: images/2.png: cannot be read'
        self.match(*command, code=1, words=reason)
        before = self.identity('out.bag')
        for name in ('other', 'another'):
            run = self.match(*command[:-1], name, code=1, words=(
                'out.bag is finished, without a part of the recording: ' + reason))
            self.assertEqual(len(run.stderr.splitlines()), 1)
        self.assertEqual(self.identity('out.bag'), before)
        os.remove(self.path('images/2.png'))
        self.match(*command, '--force', code=1)  # OUT.bag exists
        os.remove(self.path('out.bag'))
        self.match(*command, '--force', words='3 images of')
        self.match(*command, words='out.bag is finished\n')

    def test_a_recording_that_was_cut_off_keeps_its_exit_code(self):
        self.write_bag('in.bag', count=40)
        self.damage('in.bag', 0.6)
        for _ in range(2):
            run = self.match('--skip_finished', 'in.bag', 'out.bag', code=1, words='damaged or cut off')
        self.assertIn('out.bag is finished, without a part', run.stderr)

    def test_a_recording_of_which_no_image_can_be_used_is_not_finished(self):
        os.mkdir(self.path('images'))
        self.write('images/1.png', 'no image')
        for _ in range(2):
            self.match('--skip_finished', 'images/*', 'out.bag', '--csv', 'out.csv', code=2, words=(
                '0 images of /camera/image_raw matched, 1 refused', 'no file is written\n',
                '1 image could not be used because: images/1.png: cannot be read'))
            self.assertEqual(os.listdir(self.folder), ['images'])

    def test_a_file_that_is_no_bag_is_not_finished(self):
        self.write_bag('in.bag')
        self.write('out.bag', 'mine')
        self.match('--skip_finished', 'in.bag', 'out.bag', code=2, words='out.bag: is not a whole bag')

    def test_an_interrupted_run_leaves_no_files(self):
        self.write_bag('in.bag', count=400)
        run = self.start(PROGRAM, *FEW, '--skip_finished', 'in.bag', 'out.bag', '--csv', 'out.csv')
        while not any('unfinished' in name for name in os.listdir(self.folder)) and run.poll() is None:
            time.sleep(0.001)
        run.send_signal(signal.SIGTERM)
        _, err = run.communicate(timeout=300)
        self.assertEqual(run.returncode, 130, err)
        self.assertEqual(os.listdir(self.folder), ['in.bag'])
