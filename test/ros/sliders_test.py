"""scripts/sliders on a virtual display, with the parameters of the matcher and of the ground motion."""

import importlib.machinery
import os
import signal
import subprocess
import sys
import tempfile
import unittest

import rosgraph
import rospy
import yaml
from dynamic_reconfigure.server import Server
from ktgp_orb.cfg import GroundMotionConfig, KtgpConfig
from ktgp_testing import TIMEOUT, own_master, virtual_display, wait_until

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
sys.dont_write_bytecode = True


class SlidersTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.master = own_master()
        cls.display, os.environ['DISPLAY'] = virtual_display('900x800x24')
        rospy.init_node('sliders_test', disable_signals=True)
        cls.sliders = importlib.machinery.SourceFileLoader('sliders', os.path.join(ROOT, 'scripts/sliders')).load_module()

    @classmethod
    def tearDownClass(cls):
        for process in (cls.display, cls.master):
            process.terminate()
            process.wait()

    def open(self, config, namespace, refuse=lambda new: None):
        """The window, and the values that the server has. refuse: changes what it does not take."""
        values = {}
        server = Server(config, lambda new, _: refuse(new) or values.update(new) or new, namespace)
        window = self.sliders.Window('/sliders_test/' + namespace)
        self.addCleanup(window.quit)
        self.until(window, lambda: window.rows, 'the window shows the parameters')
        return window, values, server

    @staticmethod
    def type(window, name, text):
        window.rows[name].variable.set(text)
        window.rows[name].changed()

    def until(self, window, condition, what):
        def holds():
            window.update()
            return condition()
        wait_until(holds, what)

    def test_dragged_typed_and_chosen_values_arrive(self):
        window, values, server = self.open(KtgpConfig, 'matcher')
        self.assertEqual(list(window.rows)[:2], ['T_w', 'T_G'])
        self.assertEqual(set(window.rows), set(values) - {'groups'})
        window.rows['features'].slider.set(0.5)
        window.rows['T_w'].variable.set('0.7')
        window.rows['T_w'].changed()
        window.rows['reference_mode'].variable.set('keyframe')
        window.rows['reference_mode'].changed()
        window.rows['gms_scale'].variable.set(True)
        window.rows['gms_scale'].changed()
        wanted = {'features': 10050, 'T_w': 0.7, 'reference_mode': 'keyframe', 'gms_scale': True}
        self.until(window, lambda: wanted.items() <= values.items(), 'the server has the values')

        window.rows['T_w'].variable.set('much')
        window.rows['T_w'].changed()
        self.assertEqual(window.rows['T_w'].variable.get(), '0.7')
        self.assertEqual(window.status.get(), 'T_w: "much" is not a number; the value stays 0.7')

        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, 'tuned.yaml')
            self.sliders.filedialog.asksaveasfilename = lambda **_: path
            window.save()
            with open(path) as file:
                saved = yaml.safe_load(file)
        self.maxDiff = None
        self.assertEqual(saved, {name: value for name, value in values.items() if name != 'groups'})

        self.assertEqual(values['T_w'], 0.7)  # "much" is no number
        server.update_configuration({'T_G': 9.0})
        self.until(window, lambda: window.rows['T_G'].variable.get() == '9', 'a change elsewhere is shown')
        window.wanted.put(window.start)  # Reset
        self.until(window, lambda: (values['T_w'], values['T_G']) == (window.start['T_w'], 6.0), 'the server has its old values')

    def test_a_value_outside_the_range_is_set_to_its_end_with_a_message(self):
        window, values, _ = self.open(KtgpConfig, 'limits')
        window.rows['T_w'].variable.set('7')
        window.rows['T_w'].changed()
        self.assertEqual(window.status.get(), 'T_w: 7 is outside 0 to 1; it is set to 1')
        self.until(window, lambda: values['T_w'] == 1.0, 'the server has the limit')
        self.assertEqual(window.status.get(), 'T_w: 7 is outside 0 to 1; it is set to 1', 'the message stays')

    def test_what_the_node_refuses_is_said(self):
        window, values, _ = self.open(KtgpConfig, 'refusal', lambda new: new.update(roi=''))
        self.type(window, 'roi', 'abc')
        self.until(window, window.status.get, 'there is a message')
        self.assertEqual(window.status.get(), "refused: see the node's log: roi abc")
        self.until(window, lambda: window.rows['roi'].variable.get() == '', 'the value of the node is shown')
        self.type(window, 'T_w', '0.6')
        self.until(window, lambda: values['T_w'] == 0.6, 'the server has another value')
        self.assertEqual(window.status.get(), '')

    def test_numbers_that_are_not_finite_are_refused(self):
        window, values, _ = self.open(KtgpConfig, 'finite')
        before = window.rows['T_G'].variable.get()
        for text in ('nan', 'inf', '-inf'):
            self.type(window, 'T_G', text)
            self.assertEqual(window.status.get(), 'T_G: "%s" is not a number; the value stays %s' %
                             (text, window.rows['T_G'].shown))
            self.assertEqual(window.rows['T_G'].variable.get(), before)

    def test_leaving_a_field_does_not_round_its_value(self):
        window, values, server = self.open(KtgpConfig, 'digits')
        server.update_configuration({'T_w': 0.123456789})
        self.until(window, lambda: window.rows['T_w'].variable.get() == '0.123457', 'the value is shown')
        window.rows['T_w'].changed()  # as the event <FocusOut>
        self.assertEqual(window.rows['T_w'].shown, 0.123456789)
        self.assertTrue(window.wanted.empty() and window.wanted.unfinished_tasks == 0)
        self.assertEqual(values['T_w'], 0.123456789)

    def test_a_file_that_cannot_be_written_is_named(self):
        window, _, _ = self.open(KtgpConfig, 'file')
        self.sliders.filedialog.asksaveasfilename = lambda **_: '/no/such/tuned.yaml'
        window.save()
        self.assertEqual(window.status.get(), '/no/such/tuned.yaml cannot be written: No such file or directory')

    def test_reset_before_the_node_answers_does_nothing(self):
        window = self.sliders.Window('/sliders_test/not_there')
        self.addCleanup(window.quit)
        errors = []
        window.report_callback_exception = lambda *error: errors.append(error)
        bar, = [each for each in window.winfo_children() if isinstance(each, self.sliders.ttk.Frame)]
        bar.winfo_children()[0].invoke()
        window.update()
        self.assertEqual(errors, [])
        self.assertTrue(window.wanted.empty())

    def test_the_left_quarter_of_t_w_is_its_default(self):
        window, values, _ = self.open(KtgpConfig, 'drag')
        row = window.rows['T_w']
        for position, expected in ((0.5, 0.5), (0.05, 0.0), (0.6, 0.6), (0.24, 0.0)):
            row.dragged(position)
            self.until(window, lambda expected=expected: values['T_w'] == expected, 'T_w is %g' % expected)

    def test_the_description_is_inside_the_window(self):
        window, _, _ = self.open(KtgpConfig, 'help')
        window.rows['T_w'].slider.event_generate('<Enter>')
        self.until(window, lambda: window.help.get().startswith('T_w: Ratio threshold'), 'the description is shown')

    def test_ctrl_c_closes_the_window_without_a_traceback(self):
        server = Server(KtgpConfig, lambda new, _: new, 'ctrl_c')
        process = subprocess.Popen([os.path.join(ROOT, 'scripts/sliders'), '/sliders_test/ctrl_c'],
                                   stderr=subprocess.PIPE, universal_newlines=True)
        topic = '/sliders_test/ctrl_c/parameter_updates'
        wait_until(lambda: any(name == topic and any('sliders' in node and node != '/sliders_test' for node in nodes)
                               for name, nodes in rosgraph.Master('/sliders_test').getSystemState()[1]),
                   'the window follows the server')
        process.send_signal(signal.SIGINT)
        # On a busy machine dynamic_reconfigure may have written that it waits for the configuration.
        self.assertNotIn('Traceback', process.communicate(timeout=TIMEOUT)[1])
        self.assertEqual(process.returncode, 0)
        del server

    def test_a_wide_range_is_logarithmic(self):
        window, values, _ = self.open(GroundMotionConfig, 'ground_motion')
        row = window.rows['height']
        low, high = 0.001, 200.0
        for share in (0.25, 0.5, 0.75):
            row.slider.set(share)
            expected = low * (high / low) ** (share)
            self.until(window, lambda expected=expected: abs(values['height'] / expected - 1) < 1e-3,
                       'the server has the height')
            self.until(window, lambda share=share: abs(row.slider.get() - share) < 1e-3, 'the slider stays there')
