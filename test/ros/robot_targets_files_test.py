"""The targets' node and its files: a disk that is full, folders that cannot be used, a start with many targets; and
two robots that look for the same targets."""

import os
import resource

import cv2
import rospy
from ktgp_orb.msg import TargetDetections
from ktgp_orb.srv import DetectTargets, RemoveTarget, SetTarget
from ktgp_testing import (Camera, Diagnostics, FolderCase, Recorder, image_message, node, texture,
                          wait_until)
from poster import K, POSITION, POSTER, information, rendered
from sensor_msgs.msg import CameraInfo
from tf2_msgs.msg import TFMessage

LIMIT = 65536  # bytes of a file
SMALL, LARGE, OTHER = texture(150, 200, seed=21), texture(1200, 1600, seed=22), texture(300, 400, seed=11)
SERVICES = {'add': SetTarget, 'replace': SetTarget, 'remove': RemoveTarget, 'detect': DetectTargets}


def limit_files():
    """As on a full disk, a write beyond this limit fails. The signal SIGXFSZ, which would end the node, has no effect:
    callbacks run in threads of ros::AsyncSpinner, where all signals are blocked."""
    resource.setrlimit(resource.RLIMIT_FSIZE, (LIMIT, LIMIT))


def targets_node(name, before=None, **parameters):
    for key, value in parameters.items():
        rospy.set_param(name + '/' + key, value)
    namespace, _, own = name.rpartition('/')
    return node('Targets', own, '__ns:=' + (namespace or '/'), 'image:=image_raw', preexec_fn=before)


def call(name, service, *arguments):
    rospy.wait_for_service(name + '/' + service, 60)
    return rospy.ServiceProxy(name + '/' + service, SERVICES[service])(*arguments)


def image(picture):
    return image_message(picture, rospy.Time(1))


class TargetsFilesTest(FolderCase):
    def said_at_start(self, name, file):
        """Returns the messages of a node that ends at once, since it cannot keep this list."""
        with targets_node(name, file=file) as program:
            return program.wait()

    def succeed(self, *request):
        answer = call(*request)
        self.assertTrue(answer.success, answer.message)

    def contents(self):
        """Returns the contents of all files, by their names."""
        return {str(file.relative_to(self.folder)): file.read_bytes() for file in self.folder.rglob('*')
                if file.is_file()}

    def test_a_full_disk_changes_nothing(self):
        kept = self.path('kept.yaml')
        # So long that the list does not fit, either, once the test adds the second one.
        long_frame = 'x' * (LIMIT - 2000)
        cv2.imwrite(self.path('first.png'), POSTER)
        cv2.imwrite(self.path('other.png'), SMALL)
        self.write(kept, '- {id: first, image: first.png}\n- {id: other, image: other.png}\n')

        def state():
            answer = call('/full', 'detect', image(rendered(K)), CameraInfo()).detections
            return answer.known, [d.id for d in answer.detections]

        def refused(words, *arguments):
            before = self.contents()
            answer = call('/full', *arguments)
            self.assertFalse(answer.success)
            self.assertIn(words, answer.message)
            self.assertIn('File too large', answer.message)
            self.assertEqual(before, self.contents())
        with targets_node('/full', limit_files, file=kept):
            wait_until(lambda: state() == (2, ['first']), 'both are read')
            refused('.png: cannot be written', 'add', 'large', [image(texture(150, 200, seed=25)), image(LARGE)], 0.0, '')
            refused('.png: cannot be written', 'replace', 'first', [image(LARGE)], 0.0, '')
            refused('cannot be written', 'add', 'long', [image(texture(150, 200, seed=23))], 0.0, 2 * long_frame)
            self.assertEqual(state(), (2, ['first']))
            self.succeed('/full', 'replace', 'other', [image(texture(150, 200, seed=24))], 0.0, 'shelf')
            self.assertIn('frame: shelf', self.read(kept))
        # A list that is too long already: nothing can be removed, either.
        self.write(kept, '- {id: other, image: other.png, frame: %s}\n- {id: first, image: first.png}\n' %
                   (2 * long_frame))
        with targets_node('/full', limit_files, file=kept):
            # The one with the long frame is refused, and stays in the list.
            wait_until(lambda: state() == (1, ['first']), 'both are read')
            refused('cannot be written', 'remove', 'first')
            self.assertEqual(state(), (1, ['first']))

    def test_reads_a_folder_and_keeps_what_changes(self):
        posters, kept, images = (self.path(name) for name in ('posters', 'kept.yaml', 'kept.yaml_images'))
        os.mkdir(posters)
        cv2.imwrite(self.path('posters', 'mine.png'), POSTER)
        self.write('posters/broken.png', 'no image')
        diagnostics = Diagnostics(self)
        other, third = image(OTHER), image(texture(300, 400, seed=12))

        def found():
            answer = call('/kept', 'detect', image(rendered(K)), CameraInfo())
            return answer.detections.known, [d.id for d in answer.detections.detections]
        for start in range(2):
            with targets_node('/kept', targets=posters, file=kept) as program:
                wait_until(lambda: found() == (1 + start, ['mine']), 'it knows mine')
                self.assertTrue(program.says('it stays in ' + kept), program.output())
                # One that is refused stays in the list: its image may come back.
                diagnostics.wait_for_words('broken.png')
                if start == 0:
                    self.succeed('/kept', 'add', 'other', [other], 0.3, 'shelf')
                    self.assertIn('width: 0.3', self.read(kept))
                    self.assertEqual(len(os.listdir(images)), 1)
                self.assertIn('id: broken', self.read(kept))
                self.assertIn('id: mine', self.read(kept))
                if start == 1:
                    # Images that are not used any more are deleted, but not those of the user.
                    self.succeed('/kept', 'replace', 'other', [third, other], 0.4, '')
                    self.assertEqual(len(os.listdir(images)), 2)
                    for name in ('other', 'mine', 'broken'):
                        self.succeed('/kept', 'remove', name)
                        self.assertNotIn('id: ' + name, self.read(kept))
                    # The diagnostics no longer name a problem that is solved.
                    seen = len(diagnostics.messages())
                    wait_until(lambda: any('broken.png' not in s.message
                                           for s in diagnostics.of('kept: targets', seen)),
                               'no target is refused any more')
                    self.assertEqual(os.listdir(images), [])
                    self.assertEqual(sorted(os.listdir(posters)), ['broken.png', 'mine.png'])
                    self.succeed('/kept', 'add', 'broken', [third], 0.0, '')
        self.assertEqual(self.read(kept).count('id: broken'), 1)

    def test_an_image_of_two_targets_stays_until_both_are_removed(self):
        kept, images = self.path('kept.yaml'), self.path('kept.yaml_images')
        os.mkdir(images)
        cv2.imwrite(self.path('kept.yaml_images', '0.png'), POSTER)
        # The second one is refused, since one of its images is missing.
        self.write(kept, '- {id: first, image: kept.yaml_images/0.png}\n'
                   '- {id: second, images: [kept.yaml_images/0.png, missing.png]}\n')
        with targets_node('/shared', file=kept) as program:
            self.assertTrue(program.says('it stays in ' + kept), program.output())
            self.succeed('/shared', 'remove', 'second')
            self.assertEqual(os.listdir(images), ['0.png'])
            self.succeed('/shared', 'remove', 'first')
            self.assertEqual(os.listdir(images), [])

    def test_creates_the_folder_of_the_list_or_says_why_not(self):
        with targets_node('/new', file=self.path('a', 'b', 'kept.yaml')):
            self.succeed('/new', 'add', 'first', [image(POSTER)], 0.0, '')
            answer = call('/new', 'add', 'flat', [image(0 * POSTER + 90)], 0.0, '')
            self.assertIn('too little texture', answer.message)
            self.assertEqual(sorted(self.contents()), ['a/b/kept.yaml', 'a/b/kept.yaml_images/0.png'])
        self.write('file', '')
        said = self.said_at_start('/none', self.path('file', 'kept.yaml'))
        self.assertIn(self.path('file', 'kept.yaml') + ': cannot be written', said)
        self.assertIn('Not a directory', said)

    def test_a_file_belongs_to_one_node_and_an_empty_one_counts_as_none(self):
        kept = self.path('kept.yaml')
        self.write(kept, '')  # as after a power cut
        cv2.imwrite(self.path('poster.png'), POSTER)
        self.write('targets.yaml', '- {image: poster.png}\n')
        self.write('victim', 'mine')
        for name in ('kept.yaml.unfinished', 'kept.unfinished0.yaml'):
            os.symlink('victim', self.path(name))
        with targets_node('/owner', file=kept, targets=self.path('targets.yaml')):
            self.succeed('/owner', 'add', 'small', [image(SMALL)], 0.0, '')
            self.assertIn(kept + ': is in use by another node', self.said_at_start('/second', kept))
            answer = call('/owner', 'detect', image(rendered(K)), CameraInfo()).detections
            self.assertEqual((answer.known, [d.id for d in answer.detections]), (2, ['poster']))
        self.assertEqual(self.read('victim'), 'mine')
        # As left by SIGKILL: of an image, and of one that was not yet in the list.
        left = ['7.unfinished0.png', '8.png']
        for name in left + ['mine.png']:
            cv2.imwrite(self.path('kept.yaml_images', name), SMALL)
        with targets_node('/owner', file=kept):  # free again
            wait_until(lambda: call('/owner', 'detect', image(rendered(K)), CameraInfo()).detections.known == 2,
                       'both are kept')
        images = os.listdir(self.path('kept.yaml_images'))
        self.assertIn('mine.png', images)
        self.assertFalse(set(left) & set(images), images)

    def test_a_link_is_the_list_that_it_leads_to(self):
        """Two nodes that know one list by two names would lose each other's targets."""
        kept = os.path.join(os.path.realpath(self.folder), 'kept.yaml')
        cv2.imwrite(self.path('poster.png'), POSTER)
        self.write(kept, '- {image: poster.png}\n')
        os.symlink('kept.yaml', self.path('link.yaml'))
        with targets_node('/linked', file=self.path('link.yaml')):
            self.succeed('/linked', 'add', 'small', [image(SMALL)], 0.0, '')
            self.assertIn(kept + ': is in use by another node', self.said_at_start('/second', kept))
        self.assertTrue(os.path.islink(self.path('link.yaml')))
        self.assertIn('id: small', self.read(kept))
        self.assertEqual(sorted(os.listdir(self.folder)), ['kept.yaml', 'kept.yaml_images', 'link.yaml', 'poster.png'])

    def test_a_text_that_is_no_list_is_refused(self):
        os.mkdir(self.path('folder.yaml'))
        os.symlink('missing.yaml', self.path('link.yaml'))
        for name, words in ((self.path('folder.yaml'), ': is a folder'), ('/dev/null', ': is no regular file'),
                            (self.path('link.yaml'), ': is a link to a file that is missing')):
            self.assertIn(name + words, self.said_at_start('/refused', name))
        self.assertEqual(sorted(os.listdir(self.folder)), ['folder.yaml', 'link.yaml'])
        self.assertFalse(os.path.exists('/dev/null_images'))

    def test_says_where_a_relative_list_is(self):
        with targets_node('/relative', lambda: os.chdir(self.folder), file='kept.yaml') as program:
            expected = 'keeps targets in ' + os.path.join(os.path.realpath(self.folder), 'kept.yaml')
            self.assertTrue(program.says(expected), program.output())

    def test_answers_frames_and_services_while_it_reads_many_targets(self):
        count = 150
        os.mkdir(self.path('posters'))
        for i in range(count):
            cv2.imwrite(self.path('posters', '%03d.pgm' % i), texture(150, 200, seed=100 + i))
        detections = Recorder('/many/camera/targets/detections', TargetDetections, self)
        camera = Camera('/many/camera/image_raw')
        known = []
        picture = rendered(K)
        with targets_node('/many/camera/targets', targets=self.path('posters'), file=self.path('kept.yaml')):
            camera.wait_for_subscriber()
            # The last one is not read yet.
            answer = call('/many/camera/targets', 'add', '149', [image(POSTER)], 0.0, '')
            self.assertIn('exists already', answer.message)
            self.succeed('/many/camera/targets', 'replace', '149', [image(POSTER)], 1.0, '')
            self.succeed('/many/camera/targets', 'remove', '148')

            def all_known():
                message = detections.wait_for(camera.show(picture))
                known.append(message.known)
                self.assertEqual([d.id for d in message.detections], ['149'])
                return message.known >= count - 1
            wait_until(all_known, 'all are known')
        between = sum(1 < one < count - 1 for one in known)
        print('%d frames were answered before all targets were known' % between)
        self.assertGreater(between, 0)
        self.assertEqual(known, sorted(known))
        self.assertEqual(known[-1], count - 1)

    def test_two_robots_look_for_the_same_targets(self):
        """The second one gets every sixth image only: the poster moves by 46 px from one to the next."""
        cv2.imwrite(self.path('poster.png'), POSTER)
        self.write('targets.yaml', '- {id: poster, image: poster.png, width: 1.0, frame: poster}\n')
        robots = ('/one/camera', '/two/camera')
        cameras = {robot: Camera(robot + '/image_raw') for robot in robots}
        infos = {robot: rospy.Publisher(robot + '/camera_info', CameraInfo, queue_size=1, latch=True)
                 for robot in robots}
        detections = {robot: Recorder(robot + '/targets/detections', TargetDetections, self) for robot in robots}
        transforms = Recorder('/tf', TFMessage, self)
        with targets_node('/one/camera/targets', targets=self.path('targets.yaml')), \
                targets_node('/two/camera/targets', targets=self.path('targets.yaml'), frame_prefix='/two/'):
            for robot in robots:
                infos[robot].publish(information())
                cameras[robot].wait_for_subscriber()

            def show(robot, step):
                picture = rendered(K, position=POSITION + (-0.3 + 0.02 * step, 0.0, 0.0))
                return detections[robot].wait_for(cameras[robot].show(picture))

            for robot, frame in zip(robots, ('poster', 'two/poster')):
                wait_until(lambda robot=robot: [d for d in show(robot, 0).detections if d.has_pose], 'it has a pose')
                detection, = show(robot, 0).detections
                self.assertEqual(detection.frame, frame)
            for robot, stride in zip(robots, (1, 6)):
                ages = []
                for step in range(5):
                    detection, = show(robot, stride * step).detections
                    self.assertEqual(detection.instance, 0)
                    ages.append(detection.age)
                self.assertEqual(ages, list(range(ages[0], ages[0] + 5)))
            wait_until(lambda: {t.child_frame_id for m in transforms.messages() for t in m.transforms} ==
                       {'poster', 'two/poster'}, 'each robot sends its own frame')
