"""T_w changes the number of matches in the right direction, while images arrive."""

import statistics

from ktgp_orb.cfg import KtgpConfig
from ktgp_orb.msg import MatchStatus
from ktgp_testing import MatcherCase, Repeated, wait_until


class ReconfigureTest(MatcherCase):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.addClassCleanup(Repeated(0.03, cls.camera.send_view).stop)

    def tearDown(self):
        self.client.update_configuration({'T_w': 0.0, 'T_G': 6.0})

    def usual_output(self, threshold):
        """Median of the ratio test's output over ten frames that were sent after the change: at one frame of sixty
        the camera jumps back."""
        self.client.update_configuration({'T_w': threshold})
        changed = self.camera.last_stamp()

        def frames():
            return [m for m in self.statistics.messages()
                    if m.header.stamp > changed and m.status == MatchStatus.STATUS_OK]
        wait_until(lambda: len(frames()) >= 10, 'ten frames with T_w %s' % threshold)
        return statistics.median(m.stages[1].output for m in frames())

    def test_a_higher_ratio_threshold_lets_more_through(self):
        outputs = [self.usual_output(value) for value in (0.4, 0.6, 0.8, 1.0)]
        self.assertEqual(outputs, sorted(outputs))
        self.assertLess(outputs[0], 0.9 * outputs[3])

    def test_out_of_range_values_are_clamped(self):
        result = self.client.update_configuration({'T_w': 7.0, 'T_G': -3.0})
        self.assertEqual(result['T_w'], 1.0)
        self.assertEqual(result['T_G'], 0.0)

    def test_values_that_cannot_be_clamped_are_refused(self):
        for name, default in KtgpConfig.defaults.items():
            if isinstance(default, float):
                result = self.client.update_configuration({name: float('nan')})
                self.assertEqual(result[name], default, name)
        result = self.client.update_configuration({'reference_mode': 'no such mode'})
        self.assertEqual(result['reference_mode'], 'previous')

    def test_the_thresholds_stand_first(self):
        names = [parameter['name'] for parameter in self.client.get_parameter_descriptions()]
        self.assertEqual(names[:2], ['T_w', 'T_G'])
