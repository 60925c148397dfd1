"""Each parameter of the table changes what a program does, is refused, or is named as without effect."""
import unittest

from output_files_test import OutputCase, RecordingCase
from tool_case import TOOLS, without_times


class ParametersOfPairs(OutputCase):
    def test_of_ktgp_evaluate(self):
        self.check_each_parameter_of_pairs("ktgp_evaluate", "pairs.txt", "--methods", "KTGP+ALIGN", same={
            "threads", "gms_rotation", "gms_scale", "fast_adaptive"})  # the views are neither turned, nearer nor dark


class ParametersOfRecordings(RecordingCase):
    @unittest.skipUnless((TOOLS / "ktgp_evaluate_bag").exists(), "built without the research programs")
    def test_of_ktgp_evaluate_bag(self):
        self.check_each_parameter_of_pairs("ktgp_evaluate_bag", self.bag, same={
            "threads", "gms_rotation", "fast_adaptive"})  # the camera does not turn, and sees enough
        self.write("fixed.yaml", "reference_mode: fixed\n")
        self.refused("ktgp_evaluate_bag", self.bag, "--params", "fixed.yaml", words="reference_mode is fixed, but each")

    def test_of_ktgp_bag(self):
        def result(_):
            run = self.run_tool("ktgp_bag", self.bag, "out.bag", "--force", "--csv", "out.csv", "--params", "one.yaml",
                                code=None)
            return run, without_times(self.table()) if run.returncode != 2 else None
        self.check_each_parameter(result, same={
            "threads", "calibration",  # only the messages say that the images are rectified
            "gms_rotation", "fast_adaptive",  # the camera does not turn, and sees enough
            "stretch"})  # there is no image of 16 bits


if __name__ == "__main__":
    unittest.main()
