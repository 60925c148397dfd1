"""demo_report beside a stand-in for the matcher: it counts every frame, however fast they come, and the frames that were
dropped or lost."""

import os
import re
import subprocess

import cv2
import numpy as np
import rosbag
import rospy
from ktgp_orb.msg import Correspondences, HomographyStamped, Match, MatchStatistics, MatchStatus, StageStatistics
from ktgp_testing import TIMEOUT, FolderCase, own_master, wait_until
from nav_msgs.msg import Odometry
from std_msgs.msg import String

FRAMES = 300
DROPPED = set(range(100, 140, 3)) | {299}  # in bursts, and the last one
PHOTOGRAPH = '/usr/share/doc/opencv-doc/examples/data/graf1.png'


def stamp(frame):
    return rospy.Time(1600000000) + rospy.Duration(frame / 30.0)


class DemoReportTest(FolderCase):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.master = own_master()
        rospy.init_node('demo_report_test', disable_signals=True)

    @classmethod
    def tearDownClass(cls):
        cls.master.terminate()
        cls.master.wait()
        super().tearDownClass()

    def write_flight(self, path):
        """The truth of a camera that stands still, without images."""
        with rosbag.Bag(path, 'w') as bag:
            for frame in range(FRAMES):
                bag.write('/camera/segment', String('clean' if frame < 200 else 'blur'), stamp(frame))
                truth = HomographyStamped(reference_stamp=stamp(frame - 1), status=MatchStatus.STATUS_OK,
                                          homography=np.eye(3).ravel())
                truth.header.stamp = stamp(frame)
                bag.write('/camera/ground_truth/homography', truth, stamp(frame))
                odometry = Odometry()
                odometry.header.stamp = stamp(frame)
                bag.write('/camera/ground_truth/odometry', odometry, stamp(frame))

    def match_of(self, frame, dropped):
        statistics = MatchStatistics(reference_stamp=stamp(frame - 1), status=MatchStatus.STATUS_OK,
                                     dropped_frames=dropped, stages=[StageStatistics(name=name) for name in
                                                                     ('knn', 'tf', 'gms', 'prosac')])
        statistics.header.stamp = stamp(frame)
        homography = HomographyStamped(header=statistics.header, reference_stamp=stamp(frame - 1),
                                       status=MatchStatus.STATUS_OK, homography=np.eye(3).ravel())
        places = np.arange(2000, dtype=np.float32)
        pairs = Correspondences(header=statistics.header, reference_x=places, reference_y=places, target_x=places,
                                target_y=places, level=bytes([3] * len(places)))
        return Match(header=statistics.header, statistics=statistics, homography=homography, correspondences=pairs)

    def test_every_frame_is_counted(self):
        flight = self.path('flight.bag')
        self.write_flight(flight)
        publishers = [rospy.Publisher('/camera/matcher/' + name, kind, queue_size=FRAMES)
                      for name, kind in (('statistics', MatchStatistics), ('match', Match))]
        report = subprocess.Popen([os.environ['KTGP_ORB_DEMO_REPORT'], '--live', flight, self.path('out')],
                                  stdout=subprocess.PIPE, stderr=subprocess.STDOUT, universal_newlines=True)
        self.addCleanup(report.kill)
        wait_until(lambda: all(p.get_num_connections() == 1 for p in publishers), 'the report listens')
        dropped = 0
        for frame in range(FRAMES):  # as fast as they can be sent
            if frame in DROPPED:
                dropped += 1
                continue
            match = self.match_of(frame, dropped)
            publishers[0].publish(match.statistics)
            publishers[1].publish(match)
        output = report.communicate(timeout=TIMEOUT)[0]
        self.assertEqual(report.returncode, 0, output)
        processed = FRAMES - len(DROPPED)
        # The last frame was dropped after the last message, so only the bag tells that it is missing.
        self.assertIn('frames in the bag %d = processed by the matcher %d + dropped, since newer ones had arrived, %d + '
                      'lost on the way to the matcher 1\n' % (FRAMES, processed, len(DROPPED) - 1), output)
        self.assertRegex(output, r'frames processed +%d +200 +\d+|frames processed +%d ' % (processed, processed))
        self.assertRegex(output, r'corner error p50 / p95, px +0\.00 / 0\.00')
        self.assertEqual(int(re.search(r'homographies found +(\d+)', output).group(1)), processed)
        if os.path.exists(PHOTOGRAPH):
            self.check_stages(cv2.imread(self.path('out', 'stages.png')).astype(int))

    def check_stages(self, picture):
        """Wrong matches are red: many of the nearest neighbours are, few are left after PROSAC."""
        red = (picture[:, :, 2] > picture[:, :, 0] + 100) & (picture[:, :, 2] > picture[:, :, 1] + 60)
        rows, columns = np.array(red.shape) // 2
        self.assertGreater(red[:rows, :columns].sum(), 1000)
        self.assertLess(red[rows:, columns:].sum(), 0.2 * red[:rows, :columns].sum())
