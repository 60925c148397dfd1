#!/usr/bin/python3
"""stabilization.py [--work FOLDER] [VIDEO ...]: the table of doc/measurements/stabilization.md.

Stabilises videos with ktgp_bag and with vidstab (ffmpeg's vidstabdetect and vidstabtransform) at the same crop,
and measures each result from its own pixels, with OpenCV's corners and optical flow:
  ITF     mean PSNR of neighbouring frames, dB, over pairs of one scene
  jitter  root mean square of the second difference of the corners' paths, px
Without VIDEO: $KTGP_ORB_DATA/sequences/patio.mp4, the demo with tremble, and three drawn ones.
Needs ffmpeg, and the programs in out/release."""

import argparse
import os
import subprocess

import cv2
import numpy as np

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
PROGRAMS = os.path.join(ROOT, 'out/release/devel/lib/ktgp_orb')
CROPS = (0.1, 0.2)
SIZE = 640, 480


def frames_of(path):
    video = cv2.VideoCapture(path)
    while True:
        there, frame = video.read()
        if not there:
            return
        yield frame


def motion(before, after):
    """The homography from frame to frame, or None at a cut."""
    points = cv2.goodFeaturesToTrack(before, 600, 0.01, 8)
    if points is None:
        return None
    moved, there, _ = cv2.calcOpticalFlowPyrLK(before, after, points, None, winSize=(21, 21), maxLevel=4)
    kept = there[:, 0] == 1
    if kept.sum() < 30:
        return None
    h, inside = cv2.findHomography(points[kept], moved[kept], cv2.RANSAC, 1.0)
    return h if h is not None and inside.mean() > 0.3 else None


def measure(path):
    psnr, squares = [], []
    before = previous_step = None
    for frame in frames_of(path):
        grey = cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY)
        h, w = grey.shape
        step = None if before is None else motion(before, grey)
        if step is not None:
            error = np.mean((grey.astype(float) - before) ** 2)
            psnr.append(10 * np.log10(255 ** 2 / max(error, 1e-9)))
            corners = np.float32([[[0, 0]], [[w, 0]], [[w, h]], [[0, h]]])
            step = cv2.perspectiveTransform(corners, step)[:, 0] - corners[:, 0]
            if previous_step is not None:
                squares.append(np.mean(np.sum((step - previous_step) ** 2, axis=1)))
        before, previous_step = grey, step
    return np.mean(psnr), np.sqrt(np.mean(squares))


# Videos with known shake, drawn from a picture

def draw(path, picture, homographies, cut=None):
    """cut: the frame from which on the picture is mirrored, another scene."""
    writer = cv2.VideoWriter(path, cv2.CAP_FFMPEG, cv2.VideoWriter_fourcc(*'mp4v'), 30.0, SIZE)
    noise = np.random.RandomState(5)
    for i, h in enumerate(homographies):
        scene = picture[:, ::-1] if cut is not None and i >= cut else picture
        frame = cv2.warpPerspective(scene, h, SIZE, flags=cv2.INTER_AREA, borderMode=cv2.BORDER_REFLECT)
        writer.write(np.clip(frame + noise.normal(0, 2, frame.shape), 0, 255).astype(np.uint8))
    writer.release()


def camera(picture, x, y, zoom, roll, tilt):
    """Picture to frame: a view that is centred on (x, y) of the picture."""
    c, s = zoom * np.cos(roll), zoom * np.sin(roll)
    to_centre = np.array([[1, 0, -x], [0, 1, -y], [0, 0, 1.0]])
    turn = np.array([[c, -s, 0], [s, c, 0], [tilt[0], tilt[1], 1.0]])
    back = np.array([[1, 0, SIZE[0] / 2], [0, 1, SIZE[1] / 2], [0, 0, 1.0]])
    return back @ turn @ to_centre


def smooth_noise(random, count, seconds):
    raw = random.normal(size=count + 400)
    kernel = np.exp(-0.5 * (np.arange(-150, 151) / (30 * seconds)) ** 2)
    out = np.convolve(raw, kernel, 'same')[200:200 + count]
    return out / out.std()


def drawn(kind, path):
    picture = texture()
    count, random = 300, np.random.RandomState(len(kind))
    t = np.arange(count) / 30.0
    h, w = picture.shape[:2]
    tremble = {'standing': 3.0, 'walking': 4.0, 'running': 10.0}[kind]
    # Hands shake at about 5 Hz; the body sways in seconds, and steps twice a second.
    x, y = (tremble * smooth_noise(random, count, 0.04) for _ in range(2))
    sway = 12 * smooth_noise(random, count, 0.7), 12 * smooth_noise(random, count, 0.7)
    steps = 0 if kind == 'standing' else 1.5 * tremble
    x, y = x + sway[0], y + sway[1] + steps * np.abs(np.sin(2 * np.pi * t))
    pan = 0 if kind == 'standing' else 70 * t
    roll = tremble * 0.0015 * smooth_noise(random, count, 0.1)
    tilt = 1e-6 * tremble * np.array([smooth_noise(random, count, 0.05) for _ in range(2)])
    zoom = 1 + (0.03 * t if kind == 'walking' else 0 * t)
    draw(path, picture, [camera(picture, w * 0.25 + pan[i] if kind != 'standing' else w / 2 + x[i],
                                h / 2 + y[i], zoom[i], roll[i], tilt[:, i])
                         @ np.array([[1, 0, -x[i] * (kind != 'standing')], [0, 1, 0], [0, 0, 1.0]])
                         for i in range(count)], cut=150 if kind == 'running' else None)


def texture():
    """A large scene: the picture of a town if there is one, else blots."""
    path = os.path.join(os.environ.get('KTGP_ORB_DATA', ''), 'oxford/boat/img1.pgm')
    picture = cv2.imread(path)
    if picture is None:
        random = np.random.RandomState(3)
        picture = cv2.resize(random.randint(0, 256, (120, 160, 3)).astype(np.uint8), (1600, 1200))
    return cv2.resize(picture, (1800, 1400), interpolation=cv2.INTER_CUBIC)


# The stabilisers

def call(*words, **options):
    subprocess.run([str(word) for word in words], check=True, stdout=subprocess.DEVNULL,
                   stderr=subprocess.DEVNULL, **options)


def vidstab(source, out, crop, smoothing, work):
    """Same crop: a zoom of 100 * (1 / (1 - 2 crop) - 1) percent, and no zoom of its own."""
    call('ffmpeg', '-y', '-i', source, '-vf', 'vidstabdetect=shakiness=10:accuracy=15:result=t.trf', '-f',
         'null', '-', cwd=work)
    zoom = 100 * (1 / (1 - 2 * crop) - 1)
    call('ffmpeg', '-y', '-i', source, '-vf',
         'vidstabtransform=input=t.trf:optzoom=0:zoom=%g:smoothing=%d:crop=black' % (zoom, smoothing),
         '-c:v', 'libx264', '-qp', '10', out, cwd=work)


def ktgp(source, out, crop, work, *options):
    call(os.path.join(PROGRAMS, 'ktgp_bag'), '--force', source, os.path.join(work, 'matched.bag'),
         '--stabilize', out, '--stabilizer_max_crop', crop, *options)


def methods(crop):
    yield 'vidstab, smoothing 10', lambda s, o, w: vidstab(s, o, crop, 10, w)
    yield 'vidstab, smoothing 30', lambda s, o, w: vidstab(s, o, crop, 30, w)
    for lag in (0, 30):
        yield 'lag %d' % lag, lambda s, o, w, lag=lag: ktgp(s, o, crop, w, '--stabilizer_lag', lag)
    yield 'whole recording', lambda s, o, w: ktgp(s, o, crop, w)


def default_videos(work):
    patio = os.path.join(os.environ.get('KTGP_ORB_DATA', ''), 'sequences/patio.mp4')
    if os.path.exists(patio):
        yield 'patio', patio
    bag, demo = os.path.join(work, 'demo.bag'), os.path.join(work, 'demo.mp4')
    if not os.path.exists(demo):
        call(os.path.join(PROGRAMS, 'make_demo_bag'), bag, '--shake', 4, '--force')
        bag_to_video(bag, demo)
    yield 'demo with tremble', demo
    for kind in ('standing', 'walking', 'running'):
        path = os.path.join(work, kind + '.mp4')
        if not os.path.exists(path):
            drawn(kind, path)
        yield 'drawn, ' + kind, path


def bag_to_video(bag, path):
    import rosbag
    writer = cv2.VideoWriter(path, cv2.CAP_FFMPEG, cv2.VideoWriter_fourcc(*'mp4v'), 30.0, SIZE)
    with rosbag.Bag(bag) as images:
        for _, message, _ in images.read_messages(topics=['/camera/image_raw']):
            writer.write(np.frombuffer(message.data, np.uint8).reshape(message.height, message.width, 3))
    writer.release()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument('--work', default=os.path.join(ROOT, 'build/stabilization'))
    parser.add_argument('videos', nargs='*')
    arguments = parser.parse_args()
    os.makedirs(arguments.work, exist_ok=True)
    videos = [(os.path.basename(v), os.path.abspath(v)) for v in arguments.videos]
    names = ['original'] + [name for name, _ in methods(0.1)]
    print('| video | crop | %s |' % ' | '.join(names))
    print('|---|---|%s' % ('---|' * len(names)))
    for name, source in videos or default_videos(arguments.work):
        original = '%.1f / %.2f' % measure(source)
        for crop in CROPS:
            cells = [original]
            for _, method in methods(crop):
                out = os.path.join(arguments.work, 'out.mp4')
                method(source, out, arguments.work)
                cells.append('%.1f / %.2f' % measure(out))
            print('| %s | %g | %s |' % (name, crop, ' | '.join(cells)), flush=True)


if __name__ == '__main__':
    main()
