#!/usr/bin/python3
"""Runs the test case of a module of this folder in a node of its name: run_test.py MODULE, as rostest calls it."""

import importlib
import sys
import unittest

import rospy
import rostest

name = sys.argv[1]
case, = (each for each in vars(importlib.import_module(name)).values()
         if isinstance(each, type) and issubclass(each, unittest.TestCase) and each.__module__ == name)
rospy.init_node(name)
rostest.rosrun('ktgp_orb', name, case, sys.argv)
