"""python_match.py DEMO.bag: the installed module matches two images of the bag like ktgp_match."""
import json
import subprocess
import sys

import ktgp_orb_core
import numpy as np
import rosbag

images = []
with rosbag.Bag(sys.argv[1]) as bag:
    for _, message, _ in bag.read_messages('/camera/image_raw'):
        channels = 3 if message.encoding in ('bgr8', 'rgb8') else 1
        image = np.frombuffer(message.data, np.uint8).reshape(message.height, message.width, channels)
        images.append(np.ascontiguousarray(image[:, :, 0]))
        if len(images) == 2:
            break
for name, image in zip(('a.pgm', 'b.pgm'), images):
    with open(name, 'wb') as file:
        file.write(b'P5\n%d %d\n255\n' % image.shape[::-1] + image.tobytes())
program = json.loads(subprocess.check_output(['ktgp_match', 'a.pgm', 'b.pgm', '--preset', 'robust', '--json', '-']))
module = ktgp_orb_core.match(*images, preset='robust')
expected = np.array(program['homography']).reshape(3, 3)
assert module.status == 'ok', module
assert (np.asarray(module.homography) == expected).all(), (module.homography, expected)
print('  Python: %d inliers, the homography of ktgp_match' % module.inlier_count)
