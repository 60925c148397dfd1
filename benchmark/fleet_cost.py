#!/usr/bin/python3
"""fleet_cost.py PROGRAMS: the cost table of doc/fleet.md, from recordings of the demo (640x480): frames a
second of a core's time, with 1 to all cores busy, and core hours for 10 000 h of video at 30 images a second. The
time is that of the processor, so that other programs disturb little."""
import os
import resource
import subprocess
import sys
import tempfile

PROGRAMS = os.path.abspath(sys.argv[1])
ONE = os.path.abspath(os.path.dirname(__file__) + '/../examples/fleet/one_recording.sh')
RECORDINGS, SECONDS = 4, 2
VARIANTS = (('KTGP', ['--preset', 'ktgp']), ('robust', ['--preset', 'robust']),
            ('KTGP, stabilised', ['--preset', 'ktgp', '--stabilize', 'steady.mp4']),
            ('KTGP, mosaic', ['--preset', 'ktgp', '--mosaic', 'map.png']),
            ('KTGP, both', ['--preset', 'ktgp', '--stabilize', 'steady.mp4', '--mosaic', 'map.png']))


def processor_seconds():
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def main():
    counts = range(1, (os.cpu_count() or 1) + 1)
    with tempfile.TemporaryDirectory() as folder:
        for i in range(RECORDINGS):
            subprocess.run([PROGRAMS + '/make_demo_bag', '%s/%d.bag' % (folder, i), '--seconds', str(SECONDS),
                            '--shake', '2'], check=True, stderr=subprocess.DEVNULL)
        print('| | %s | core hours for 10 000 h |' % ' | '.join(
            'frames/s per core, %d core%s busy' % (n, 's' if n > 1 else '') for n in counts))
        print('|---|%s---:|' % ('---:|' * len(counts)))
        for name, options in VARIANTS:
            speeds = []
            for n in counts:
                start = processor_seconds()
                subprocess.run(['taskset', '-c', '0-%d' % (n - 1), 'xargs', '-P', str(n), '-I', '{}', ONE,
                                '{}.bag', name + str(n), '--threads', '1'] + options, check=True, cwd=folder,
                               env=dict(os.environ, PATH=PROGRAMS + ':' + os.environ['PATH']),
                               input=''.join('%d\n' % i for i in range(RECORDINGS)).encode(),
                               stderr=subprocess.DEVNULL)
                speeds.append(RECORDINGS * SECONDS * 30 / (processor_seconds() - start))
            print('| %s | %s | %.0f |' % (name, ' | '.join('%.0f' % s for s in speeds), 10000 * 30 / speeds[-1]),
                  flush=True)


if __name__ == '__main__':
    main()
