"""compare.py OFFLINE.bag NODELET.bag: homographies of the same two frames have the same bytes."""
import io
import sys

import rosbag


def homographies(path):
    found = {}
    with rosbag.Bag(path) as bag:
        for _, message, _ in bag.read_messages('/camera/matcher/homography'):
            message.header.seq = 0
            data = io.BytesIO()
            message.serialize(data)
            found[message.header.stamp, message.reference_stamp] = data.getvalue()
    return found


offline, nodelet = homographies(sys.argv[1]), homographies(sys.argv[2])
common = set(offline) & set(nodelet)
different = sum(offline[key] != nodelet[key] for key in common)
print('  nodelet and ktgp_bag: %d of %d frames in both, %d differ' % (len(common), len(offline), different))
sys.exit(different > 0 or len(common) < 0.8 * len(offline))
