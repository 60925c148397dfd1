"""Every launch file loads, every argument is described, every parameter of the matcher exists."""

import glob
import os
import subprocess
import sys
import tempfile
import unittest
import xml.etree.ElementTree as xml
from unittest import mock

import roslaunch
import yaml
from ktgp_testing import check_each
from roslaunch.config import ROSLaunchConfig
from ktgp_orb.cfg import KtgpConfig

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', '..', 'cfg'))
import ktgp_table  # noqa: E402

PACKAGE = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
FILES = sorted(os.listdir(os.path.join(PACKAGE, 'launch')))
ARGUMENTS = {'T_w', 'T_G', 'features'}  # parameters that have an argument of their own
STATIC_PARAMETERS = {'image_transport', 'queue_size'}


def flow(values):
    """YAML in one line, as the argument set takes it."""
    return yaml.safe_dump(values, default_flow_style=True, width=1e9).strip()


def path_of(name):
    return os.path.join(PACKAGE, 'launch', name)


def arguments_of(name):
    """The arguments of a launch file: name, default and doc."""
    return {element.get('name'): element for element in xml.parse(path_of(name)).getroot().iterfind('arg')}


class ParameterTablesTest(unittest.TestCase):
    def test_names_that_rqt_cannot_show_are_refused(self):
        def rows(*names):
            return [('GROUP' if name.startswith('group ') else 'BOOL', name.split()[-1], [])
                    for name in ('group method',) + names]
        ktgp_table.check(rows('T_w', 'group a', 'x', 'group b', 'y'))
        for names, words in ((('group gms', 'gms'), 'parameter gms is called like a group'),
                             (('Guided', 'group guided'), 'group guided is called like a parameter'),
                             (('group a', 'group A'), 'group A is called like a group'),
                             (('group state', 'x'), 'a word of dynamic_reconfigure'),
                             (('group orb', 'x', 'group diagnostics'), 'by the order of their names')):
            with self.assertRaisesRegex(ValueError, words):
                ktgp_table.check(rows(*names))

    def test_names_of_the_package_can_be_shown(self):
        for table in ('table.def', 'stabilizer.def', 'mosaic.def', 'ground_motion.def',
                      'targets.def'):
            ktgp_table.check(ktgp_table.rows(table))


class LaunchFilesTest(unittest.TestCase):
    def setUp(self):
        self.bag = tempfile.NamedTemporaryFile(suffix='.bag')
        self.addCleanup(self.bag.close)

    def load(self, name, *arguments):
        """Returns the configuration that roslaunch reads, with a bag if the file needs one. It does not read the file
        of the roscore: this starts two programs for the versions of ROS, most of the time of these tests."""
        if 'bag' in arguments_of(name):
            arguments += 'bag:=' + self.bag.name,
        config = ROSLaunchConfig()
        roslaunch.xmlloader.XmlLoader().load(path_of(name), config, argv=list(arguments), verbose=False)
        return config

    def test_there_are_launch_files(self):
        self.assertLessEqual({'matcher.launch', 'bag.launch', 'tune.launch', 'demo.launch'}, set(FILES))

    def test_every_file_passes_roslaunch(self):
        def check(name):
            config = self.load(name)
            self.assertEqual(config.config_errors, [])
            self.assertTrue(config.nodes)
        check_each(FILES, check)

    def test_every_program_exists(self):
        for name in FILES:
            for node in self.load(name).nodes:
                if node.package != 'rviz':  # is optional
                    machine = node.machine or roslaunch.core.local_machine()
                    roslaunch.node_args.create_local_process_args(node, machine)  # raises if missing

    def test_every_argument_is_described(self):
        for name in FILES:
            for argument, element in arguments_of(name).items():
                self.assertTrue(element.get('doc'), '%s: %s' % (name, argument))

    def parameters_of(self, name, *arguments):
        """Returns the parameters of the matcher that a launch file sets, by their names."""
        return {key.rsplit('/', 1)[1]: param.value for key, param in self.load(name, *arguments).params.items()
                if '/matcher/' in key}

    def test_every_parameter_reaches_the_matcher_and_none_is_set_unasked(self):
        values = {}
        for name, default in KtgpConfig.defaults.items():
            if isinstance(default, bool):
                values[name] = not default
            elif isinstance(default, str):
                values[name] = '/some ' + name
            else:
                values[name] = default + 1
        given = ['%s:=%s' % (name, values[name]) for name in ARGUMENTS]
        rest = {name: value for name, value in values.items() if name not in ARGUMENTS}
        for launch in ('matcher.launch', 'bag.launch', 'tune.launch', 'multi_camera.launch'):
            got = self.parameters_of(launch, 'set:=' + flow(rest), *given)
            self.assertEqual({name: got.get(name) for name in values}, values, launch)
            self.assertLessEqual(set(self.parameters_of(launch)), STATIC_PARAMETERS, launch)
            self.assertLessEqual(set(got), set(values) | STATIC_PARAMETERS, launch)

    def test_an_unknown_preset_is_refused_with_the_names_of_all(self):
        names = sorted(name[:-5] for name in os.listdir(os.path.join(PACKAGE, 'config')) if name.endswith('.yaml'))
        for name in names:
            self.load('matcher.launch', 'preset:=' + name)
        with self.assertRaisesRegex(Exception, 'vdeo: the presets are ' + ', '.join(names)):
            self.load('matcher.launch', 'preset:=vdeo')

    def test_targets_are_looked_for_where_they_are_given(self):
        def parameters(launch, *arguments):
            return {key: param.value for key, param in self.load(launch, *arguments).params.items()
                    if key.startswith('/camera/targets/')}
        for launch in ('demo.launch', 'views.launch'):
            self.assertEqual(parameters(launch), {})
        self.assertEqual(parameters('targets.launch')['/camera/targets/targets'], '')
        for launch in ('demo.launch', 'views.launch', 'targets.launch'):
            for name in ('/a/l"i\\s t\'.yaml', '/12'):
                self.assertEqual(parameters(launch, 'targets:=' + name)['/camera/targets/targets'], name)
            with mock.patch.dict(os.environ, PWD='/elsewhere'):
                for name in ('b.yaml', 'l"i\\s t\'$HOME.yaml'):
                    self.assertEqual(parameters(launch, 'targets:=' + name)['/camera/targets/targets'],
                                     os.path.join(os.getcwd(), name))

    def test_every_other_argument_of_the_matcher_reaches_it_through_each_file(self):
        given = {'namespace': 'front', 'name': 'eyes', 'transport': 'compressed', 'queue_size': '7',
                 'machine': 'arm', 'respawn': 'true', 'required': 'true', 'manager': '/mine'}
        there = set(arguments_of('matcher.launch')) - ARGUMENTS
        self.assertEqual(there, set(given) | {'image', 'preset', 'params', 'set'},
                         'a new argument needs its place in this test')
        # bag.launch and tune.launch play to one process here, and end with it; one of several
        # cameras must not end the launch, and their namespaces are their names.
        here = {'machine', 'respawn', 'required', 'manager'}
        not_taken = {'matcher.launch': {'required'}, 'bag.launch': here, 'tune.launch': here,
                     'multi_camera.launch': {'namespace', 'required'}}
        for name, without in not_taken.items():
            values = {key: value for key, value in given.items() if key not in without}
            if 'respawn' in arguments_of(name) and arguments_of(name)['respawn'].get('default') == 'true':
                values['respawn'] = 'false'
            self.check_reaches(name, values)
        self.check_reaches('matcher.launch', {'required': 'true'})  # never together with respawn

    def check_reaches(self, name, values):
        arguments = ['%s:=%s' % item for item in values.items()]
        arguments.append('%s:=/a/picture' % ('topic' if 'topic' in arguments_of(name) else 'image'))
        spaces = [values.get('namespace', 'camera')]
        if 'cameras' in arguments_of(name):
            spaces = ['left', 'right']
            arguments.append('cameras:=left right')
        config = self.load(name, *arguments)
        for space in spaces:
            path = '/%s/%s' % (space, values.get('name', 'matcher'))
            node = next(n for n in config.nodes if n.namespace + n.name == path)
            self.assertIn(['image', '/a/picture'], node.remap_args, name)
            self.assertEqual(config.params[path + '/image_transport'].value,
                             values.get('transport', 'raw'), name)
            self.assertEqual(config.params[path + '/queue_size'].value,
                             int(values.get('queue_size', 1)), name)
            self.assertEqual(node.respawn, values.get('respawn') == 'true', name)
            self.assertEqual(node.required, values.get('required') == 'true' or
                             name in ('bag.launch', 'tune.launch'), name)
            if 'machine' in values:
                self.assertEqual(node.machine_name, 'arm', name)
            if 'manager' in values:
                self.assertEqual((node.package, node.args),
                                 ('nodelet', 'load ktgp_orb/matcher /mine'), name)

    def test_results_are_in_the_namespace_of_the_topic(self):
        for name in ('bag.launch', 'tune.launch'):
            for topic, matcher in (('/cam/image_raw', '/cam/matcher'), ('/cam/image_raw/compressed', '/cam/matcher'),
                                   ('/robot/front/image', '/robot/front/matcher'), ('/image_raw', '/camera/matcher'),
                                   ('cam/image_raw', '/cam/matcher')):
                config = self.load(name, 'topic:=' + topic)
                self.assertIn(matcher, [n.namespace + n.name for n in config.nodes], name)
                rviz = next(n for n in config.nodes if n.name == 'rviz')
                self.assertIn(['/camera/matcher/matches_image', matcher.lstrip('/') + '/matches_image'],
                              rviz.remap_args)
                image = '/' + topic.replace('/compressed', '').lstrip('/')
                self.assertIn(['/camera/image_raw', image], rviz.remap_args)

    def test_views_of_a_live_camera(self):
        config = self.load('views.launch', 'namespace:=usb_cam', 'targets:=/posters')
        self.assertEqual({n.namespace + n.name for n in config.nodes},
                         {'/usb_cam/stabilizer', '/usb_cam/mosaic', '/usb_cam/targets', '/rviz'})
        rviz = next(n for n in config.nodes if n.name == 'rviz')
        self.assertIn(['/camera/mosaic/mosaic', '/usb_cam/mosaic/mosaic'], rviz.remap_args)

    def test_arguments_reach_the_player(self):
        given = {'topic': '/a/picture', 'transport': 'theora', 'all': True, 'rate': 0.5, 'start': 2.0,
                 'delay': 3.0, 'loop': True, 'record': "it's out.bag"}
        for name in ('bag.launch', 'tune.launch'):
            known = {key: value for key, value in given.items() if key in arguments_of(name)}
            # Tuning always loops, and records nothing.
            self.assertEqual(set(given) - set(known),
                             {'loop', 'record'} if name == 'tune.launch' else set())
            config = self.load(name, *('%s:=%s' % (key, str(value).lower() if value is True else value)
                                       for key, value in known.items()))
            got = {key: config.params['/player/' + key].value for key in known}
            self.assertEqual(got, known, name)
            self.assertEqual(config.params['/player/bag'].value, self.bag.name)
            self.assertEqual(config.params['/player/matcher'].value, 'a/matcher')
            self.assertIs(config.params['/player/loop'].value, True)

    def test_several_cameras_share_the_options_of_their_manager(self):
        config = self.load('multi_camera.launch', 'cameras:=a,b,c', 'manager:=/boss', 'manager_threads:=5',
                           'machine:=arm')
        managers = [n for n in config.nodes if n.name == 'boss']
        self.assertEqual([(n.args, n.machine_name, n.respawn) for n in managers],
                         [('manager', 'arm', True)])
        self.assertEqual(config.params['/boss/num_worker_threads'].value, 5)
        self.assertEqual(sorted(n.namespace for n in config.nodes if n.name == 'matcher'),
                         ['/a/', '/b/', '/c/'])
        none = self.load('multi_camera.launch', 'start_manager:=false')
        self.assertEqual([n.name for n in none.nodes], ['matcher'])

    def test_arguments_count_before_the_file_and_the_file_before_the_preset(self):
        with tempfile.NamedTemporaryFile('w', suffix='.yaml', dir='.') as file:
            file.write('T_w: 0.71\nmutual: false\nlevels: 5\n')
            file.flush()
            for launch in ('matcher.launch', 'bag.launch', 'tune.launch', 'multi_camera.launch'):
                for path in (file.name, os.path.basename(file.name)):
                    got = self.parameters_of(launch, 'preset:=robust', 'params:=' + path,
                                             'set:={levels: 6}')
                    self.assertIs(got['guided'], True, launch)
                    self.assertIs(got['mutual'], False, launch)
                    self.assertEqual(got['T_w'], 0.71, launch)
                    self.assertEqual(got['levels'], 6, launch)

    def test_parameters_of_the_consumers_reach_them(self):
        for name, values in (('stabilizer', {'lag': 7}), ('mosaic', {'max_megapixels': 0.5, 'lazy': True})):
            config = self.load(name + '.launch', 'set:=' + flow(values))
            got = {key: config.params['/camera/%s/%s' % (name, key)].value for key in values}
            self.assertEqual(got, values)

    def test_presets_hold_parameters_within_their_ranges(self):
        for path in glob.glob(os.path.join(PACKAGE, 'config', '*.yaml')):
            with open(path) as file:
                for name, value in yaml.safe_load(file).items():
                    self.assertIn(name, KtgpConfig.defaults, path)
                    self.assertEqual(type(value), type(KtgpConfig.defaults[name]), name)
                    if not isinstance(value, (str, bool)):
                        self.assertLessEqual(KtgpConfig.min[name], value)
                        self.assertLessEqual(value, KtgpConfig.max[name])

    def test_values_of_an_earlier_launch_do_not_linger(self):
        self.assertEqual(self.load('matcher.launch').clear_params, ['/camera/matcher/'])

    def test_no_launch_file_publishes_transforms(self):
        for name in FILES:
            for node in self.load(name).nodes:
                self.assertNotIn('transform', node.type, name)

    def test_a_missing_bag_is_named(self):
        for name in ('bag.launch', 'tune.launch'):
            result = subprocess.run(
                ['roslaunch', path_of(name), 'bag:=/no/such/file.bag'],
                stdout=subprocess.PIPE, stderr=subprocess.STDOUT, universal_newlines=True)
            self.assertNotEqual(result.returncode, 0)
            self.assertIn('/no/such/file.bag', result.stdout)
