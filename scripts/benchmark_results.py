"""Reads the results of scripts/bench: one file per machine, one row per benchmark."""
import json
import re

# The rows of the table of speeds: text, benchmark, the counter with the time and its unit in ms, the
# counter with the ratio to the peer, the peer. {simd} stands for the instruction set of the machine.
ROWS = [
    ('ORB, 640×480, 2000 features: cv::ORB\'s own keypoints and descriptors',
     'extract/ranked/width:640/height:480/features:2000/threads:1', 'ms', 1.0, 'times_cvORB',
     'cv::ORB'),
    ('exact two nearest neighbours, 2000 × 2000', 'knn/{simd}/n:2000/threads:1', 'ns_per_pair', 4.0,
     'times_BFMatcher', 'cv::BFMatcher'),
    ('the same, AVX2', 'knn/AVX2/n:2000/threads:1', 'ns_per_pair', 4.0, 'times_BFMatcher',
     'cv::BFMatcher'),
    ('mutual nearest neighbours, both directions in one pass', 'knn/{simd}/mutual/n:2000/threads:1',
     'ns_per_pair', 4.0, 'times_one_way', 'one direction'),
    ('`search_radius` 48, 2000 features, 640×480', 'knn/{simd}/near/n:2000/width:640/radius:48',
     'ms', 1.0, 'times_whole', 'the whole image'),
    ('`search_radius` 48, 20 000 features, 1920×1080',
     'knn/{simd}/near/n:20000/width:1920/radius:48', 'ms', 1.0, 'times_whole', 'the whole image'),
    ('GMS, 1000 matches, plain', 'sparse/matches:1000/mode:0', None, 1.0,
     'dense/matches:1000/mode:0', 'a dense implementation'),
    ('GMS with rotation and scale', 'sparse/matches:1000/mode:3', None, 1.0,
     'dense/matches:1000/mode:3', 'a dense implementation'),
    ('homography, 1000 pairs, 50 % inliers', 'ProsacHomography/N:1000/inliers:50%/good', None, 1e-3,
     'USAC_MAGSAC/N:1000/inliers:50%/good', 'USAC_MAGSAC'),
    ('whole frame, 2000 features, GMS and alignment included',
     'frame/rotation_and_scale:0/radius:0/threads:1', 'ms', 1.0, 'times_OpenCV',
     'OpenCV\'s parts without GMS'),
    ('the same with `search_radius` 48', 'frame/rotation_and_scale:0/radius:48/threads:1', 'ms',
     1.0, 'times_OpenCV', 'OpenCV\'s parts without GMS'),
    ('whole frame with GMS\'s rotation and scale', 'frame/rotation_and_scale:1/radius:0/threads:1',
     'ms', 1.0, 'times_OpenCV', 'OpenCV\'s parts without GMS'),
]
MAIN_ROWS = [ROWS[i] for i in (0, 1, 4, 6, 8, 9, 10)]  # those that the README shows


def readme_filter():
    """A regular expression for Google Benchmark: the benchmarks of the table and their peers."""
    names = []
    for _, name, _, _, peer, _ in ROWS:
        names += [name] + ([peer] if '/' in peer else [])
    return '^(%s)(/.*)?$' % '|'.join(name.replace('{simd}', '[A-Za-z0-9_]+') for name in names)


def read(path):
    """{'machine': ..., 'instruction_set': ..., 'rows': {name: {...}}}"""
    with open(path) as file:
        results = json.load(file)
    results['rows'] = {plain(row['name']): row for row in results['rows']}
    return results


def plain(name):
    """Without what Google Benchmark adds for how it was run."""
    return re.sub(r'/(real_time|process_time|iterations:\d+|repeats:\d+)', '', name)


def value(row, counter):
    return row['counters'].get(counter) if counter else row['median']


def shown(number):
    return '%.3g' % number if number < 100 else '%.0f' % number


def table(all_results, rows):
    """Markdown; a machine has two columns."""
    head = '| one thread, medians |'
    line = '|---|'
    for results in all_results:
        head += ' %s | times as fast as |' % results['machine']
        line += '---:|---|'
    lines = [head, line]
    for text, name, counter, unit, peer, peer_name in rows:
        cells = [cells_of(results, name, counter, unit, peer, peer_name) for results in all_results]
        if any(cell != ' | |' for cell in cells):
            lines.append('| %s |%s' % (text, ''.join(cells)))
    return '\n'.join(lines)


def cells_of(results, name, counter, unit, peer, peer_name):
    rows = results['rows']
    row = rows.get(name.replace('{simd}', results['instruction_set']))
    if row is None or value(row, counter) is None:
        return ' | |'
    milliseconds = value(row, counter) * unit
    if '/' in peer:
        ratio = rows[peer]['median'] / row['median'] if peer in rows else None
    else:
        ratio = row['counters'].get(peer)
        if peer == 'times_one_way' and ratio:
            ratio = 1.0 / ratio
    beside = '%s: %s' % (peer_name, shown(ratio)) if ratio else ''
    return ' %s ms | %s |' % (shown(milliseconds), beside)
