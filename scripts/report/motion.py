"""Accuracy of the motion in metres on a recording with the truth in tf, as a table.

    scripts/evaluate [--built FOLDER] --motion BAG [--ground FRAME] [--base FRAME] [--above M ...] [--drift S ...]
                     [OPTIONS]

The recording has images, camera_info, the readings of height and tilt, and tf from FRAME ground to FRAME base
(for example from motion capture) at 50 Hz or more. OPTIONS are passed to ktgp_bag. Without --reference_mode,
--params and --preset it is called with the options that doc/motion.md recommends, as far as they are not given.
"""
import argparse
import csv
import os
import shlex
import subprocess
import sys
import tempfile

import numpy as np

WINDOW = 0.05  # s; a parabola through the samples within this time smooths the noise of the capture
PARTLY = 1  # exit code of ktgp_bag if it could use only a part of the data
BOUND = 16.266  # 99.9 % of chi square with three degrees of freedom


def rotation(vector):
    """Rotation matrices (n, 3, 3) from rotation vectors (n, 3), rad."""
    angle = np.linalg.norm(vector, axis=-1)[..., None, None]
    x, y, z = np.moveaxis(vector, -1, 0)
    zero = np.zeros_like(x)
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], -1).reshape(vector.shape[:-1] + (3, 3))
    return np.eye(3) + np.sinc(angle / np.pi) * cross + 0.5 * np.sinc(angle / (2 * np.pi)) ** 2 * cross @ cross


def vector_of(matrix):
    """The rotation vector, rad, of a rotation matrix; the angle must be below 180 degrees."""
    part = np.array([matrix[2, 1] - matrix[1, 2], matrix[0, 2] - matrix[2, 0], matrix[1, 0] - matrix[0, 1]]) / 2
    sine = np.linalg.norm(part)
    angle = np.arctan2(sine, (np.trace(matrix) - 1) / 2)
    return part * (angle / sine if sine > 1e-12 else 1.0)


def matrix_of(q):
    """The rotation matrix of a quaternion x, y, z, w."""
    x, y, z, w = q / np.linalg.norm(q)
    return np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                     [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                     [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]])


def refuse(text):
    """Ends with the exit code that all programs use for unusable input."""
    print(f'evaluate: {text}', file=sys.stderr)
    sys.exit(2)


def transforms_of(bag):
    """The transforms on /tf, in their order."""
    import rosbag
    try:
        with rosbag.Bag(bag) as recording:
            for _, message, _ in recording.read_messages(topics=['/tf']):
                yield from message.transforms
    except rosbag.ROSBagUnindexedException:
        refuse(f'{bag} is not complete: the index at its end is missing. Run  rosbag reindex {shlex.quote(bag)}')
    except OSError as error:
        refuse(f'{bag} cannot be read: {error.strerror}')
    except rosbag.ROSBagException as error:
        refuse(f'{bag} is damaged, or no recording: {error}')


class Truth:
    """The true pose of the base at any time."""

    def __init__(self, bag, ground, base):
        rows = []
        for each in transforms_of(bag):
            if (each.header.frame_id.lstrip('/'), each.child_frame_id.lstrip('/')) == (ground, base):
                t, q = each.transform.translation, each.transform.rotation
                rows.append([each.header.stamp.to_sec(), t.x, t.y, t.z, q.x, q.y, q.z, q.w])
        usable = [row for row in rows if np.isfinite(row).all() and np.any(row[4:])]
        if len(usable) < len(rows):
            print(f'evaluate: {len(rows) - len(usable)} of {len(rows)} transforms from {ground} to {base} are no poses '
                  '(not finite, or a quaternion of zeros) and are left out', file=sys.stderr)
        rows = usable
        if len(rows) < 10:
            refuse(f'{bag} has {len(rows)} transforms from {ground} to {base} on /tf; expected the true motion, see '
                   '--ground and --base')
        rows = np.array(sorted(rows))
        self.times, self.positions, self.quaternions = rows[:, 0], rows[:, 1:4], rows[:, 4:8]

    def at(self, time):
        """Position and axes of the base, or None if the truth has a gap at this time."""
        near = np.flatnonzero(np.abs(self.times - time) <= WINDOW)
        if len(near) < 4 or self.times[near[0]] > time or self.times[near[-1]] < time:
            return None
        middle = matrix_of(self.quaternions[near[len(near) // 2]])
        turns = [vector_of(middle.T @ matrix_of(q)) for q in self.quaternions[near]]
        values = np.hstack([self.positions[near], turns])
        fit = np.polynomial.polynomial.polyfit(self.times[near] - time, values, 2)[0]
        return fit[:3], middle @ rotation(fit[3:])


def twist_of(before, now, seconds):
    """The constant velocity, in the moving axes, that leads from one pose to the other: the logarithm of SE(3)."""
    turn = vector_of(before[1].T @ now[1])
    way = before[1].T @ (now[0] - before[0])
    angle = np.linalg.norm(turn)
    third = 1 / 12 if angle < 1e-3 else 1 / angle ** 2 - 0.5 / (angle * np.tan(angle / 2))
    bent = np.cross(turn, way)
    return (way - bent / 2 + third * np.cross(turn, bent)) / seconds


def covariance_of(row, names):
    """The covariance matrix in the columns of a table."""
    matrix = np.zeros((len(names), len(names)))
    for i, a in enumerate(names):
        matrix[i, i] = float(row['dev_' + a]) ** 2
        for j in range(i + 1, len(names)):
            matrix[i, j] = matrix[j, i] = float(row[f'cov_{a}_{names[j]}'])
    return matrix


def yaw_of(axes):
    return np.arctan2(axes[1, 0], axes[0, 0])


def drift(track, seconds):
    """Median error of the position after a time, as a share of the way; None if it cannot be measured."""
    shares = []
    step = max(1, len(track) // 200)
    for i in range(0, len(track), step):
        time, true, found = track[i]
        later = [each for each in track[i:] if each[0] - time <= seconds]
        if later[-1][0] - time < 0.9 * seconds:  # a gap, or the end
            continue
        way = sum(np.linalg.norm(b[1][0] - a[1][0]) for a, b in zip(later, later[1:]))
        turn = rotation(np.array([0.0, 0.0, yaw_of(found[1]) - yaw_of(true[1])]))
        error = later[-1][2][0] - found[0] - turn @ (later[-1][1][0] - true[0])
        shares.append(np.linalg.norm(error) / max(way, 1e-9))
    return np.median(shares) if shares else None


def measure(table, truth, above, windows):
    """A row of the report, for the frames in which the base is at least `above` metres above its lowest position."""
    lowest = truth.positions[:, 2].min()
    frames = 0
    errors, squares, speeds, track = [], [], [], []
    before = None
    for row in table:
        time = float(row['stamp'])
        pose = truth.at(time)
        previous, before = before, None if pose is None else (time, pose)
        if pose is None or previous is None or pose[0][2] < lowest + above:
            continue
        frames += 1
        if row['x']:
            axes = matrix_of(np.array([float(row[name]) for name in ('qx', 'qy', 'qz', 'qw')]))
            track.append((time, pose, (np.array([float(row[name]) for name in 'xyz']), axes)))
        if not row['vx']:
            continue
        wanted = twist_of(previous[1], pose, time - previous[0])
        error = np.array([float(row[name]) for name in ('vx', 'vy', 'vz')]) - wanted
        covariance = covariance_of(row, ('vx', 'vy', 'vz'))
        errors.append(np.linalg.norm(error))
        squares.append(error @ np.linalg.solve(covariance, error))
        speeds.append(np.linalg.norm(wanted))
    if not errors:
        return f'| {above:g} m | {frames} | 100 % | | | | | | |'
    rms = np.sqrt(np.mean(np.square(errors)))
    drifts = [drift(track, seconds) for seconds in windows]
    return (f'| {above:g} m | {frames} | {100 * (1 - len(errors) / frames):.1f} % '
            f'| {1e3 * rms:.1f} / {1e3 * np.median(errors):.1f} / {1e3 * np.max(errors):.0f} '
            f'| {100 * rms / np.sqrt(np.mean(np.square(speeds))):.1f} % '
            f'| {np.mean(squares):.1f} / {np.median(squares):.1f} | {100 * np.mean(np.less(squares, BOUND)):.1f} % '
            f'| {" / ".join("–" if d is None else f"{100 * d:.2f} %" for d in drifts)} |')


def with_defaults(options):
    """The options of ktgp_bag with those that doc/motion.md recommends. What the user gave counts: a default may not
    come after it, because the last one of two equal options wins, and an option overrides --params and --preset."""
    given = {option.split('=')[0] for option in options}
    added = []
    if not given & {'--reference_mode', '--params', '--preset'}:
        added += ['--reference_mode', 'previous']
        for name, value in (('--guided', 'true'), ('--gms_grid', '0')):
            added += [] if name in given else [name, value]
    if '--motion_normal_source' not in given:
        added += ['--motion_normal_source', 'imu']
    return options + added


def main():
    parser = argparse.ArgumentParser(prog='scripts/evaluate', description=__doc__.split('\n')[0],
                                     epilog='Other options go to ktgp_bag, such as --motion_gyro true.')
    parser.add_argument('--tools', required=True, help=argparse.SUPPRESS)
    parser.add_argument('--motion', required=True, metavar='BAG')
    parser.add_argument('--ground', default='ground', metavar='FRAME', help='frame whose z = 0 is the ground')
    parser.add_argument('--base', default='base_link', metavar='FRAME', help='frame of the velocity')
    parser.add_argument('--above', type=float, nargs='+', default=[0.1, 0.3], metavar='M',
                        help='a row of the table each: of the frames in which the base is this much above its lowest '
                        'place')
    parser.add_argument('--drift', type=float, nargs='+', default=[10.0, 30.0], metavar='S',
                        help='times after which the error of the position counts, as a share of the way')
    arguments, options = parser.parse_known_args()
    options = with_defaults(options)
    truth = Truth(arguments.motion, arguments.ground, arguments.base)
    with tempfile.TemporaryDirectory() as folder:
        table = os.path.join(folder, 'motion.csv')
        code = subprocess.run([os.path.join(arguments.tools, 'ktgp_bag'), arguments.motion,
                               os.path.join(folder, 'matched.bag'), '--motion', table,
                               '--motion_base_frame', arguments.base, *options], check=False,
                              stdout=sys.stderr).returncode
        if code not in (0, PARTLY) or not os.path.exists(table):
            refuse(f'ktgp_bag ended with exit code {code} on {arguments.motion}, without a table')
        with open(table, encoding='utf-8') as file:
            rows = list(csv.DictReader(file))
    times = ' / '.join(f'{seconds:g} s' for seconds in arguments.drift)
    print("| above | frames | without an answer | velocity error, RMS / median / worst, mm/s | of the speed | e'S⁻¹e, "
          f'mean / median (3 / 2.4) | within 99.9 % | drift after {times} |\n|---|---|---|---|---|---|---|---|')
    for above in arguments.above:
        print(measure(rows, truth, above, arguments.drift))
    if code == PARTLY:
        print('evaluate: ktgp_bag could not use all of the data (see its messages above); the table is of the rest',
              file=sys.stderr)
    return code


if __name__ == '__main__':
    sys.exit(main())
