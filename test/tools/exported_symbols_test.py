"""The shared libraries export what include/ declares, and nothing else; they have a version."""

import glob
import os
import re
import subprocess
import unittest

INCLUDE = os.path.join(os.path.dirname(os.path.abspath(__file__)), '../../include/ktgp_orb/*.h')
LIBRARIES = [os.environ['KTGP_ORB_CORE_LIBRARY'], os.environ['KTGP_ORB_VIEWS_LIBRARY']]


def declared():
    """Classes and functions of the public headers, with their namespaces."""
    classes, functions = set(), set()
    for header in glob.glob(INCLUDE):
        with open(header) as file:
            text = file.read()
        namespaces = re.findall(r'^namespace ([\w:]+) \{', text, re.MULTILINE)
        if not namespaces:
            continue
        namespace = namespaces[-1]  # others only announce a class
        classes |= {'%s::%s' % (namespace, name)
                    for name in re.findall(r'^(?:class|struct) (\w+)\b[^;]*?\{', text, re.MULTILINE)}
        functions |= {'%s::%s' % (namespace, name)
                      for name in re.findall(r'^(?!inline|static)\w[\w:<>&* ]*? (\w+)\((?:[^{}]|\{\})*?\);', text,
                                             re.MULTILINE)}
    return classes, functions


def exported():
    names = set()
    for library in LIBRARIES:
        table = subprocess.check_output(['nm', '-DC', '--defined-only', library], universal_newlines=True)
        names |= {line.split(' ', 2)[2] for line in table.splitlines()}
    return names


class ExportedSymbols(unittest.TestCase):
    def test_only_public_names_are_exported(self):
        classes, functions = declared()
        public = re.compile('(?:%s)::(?!Impl\\b)|(?:%s)(?:\\[abi:cxx11\\])?\\(' %
                            ('|'.join(sorted(classes)), '|'.join(sorted(functions))))
        self.assertEqual([name for name in exported() if not public.match(name)], [])

    def test_every_public_function_is_exported(self):
        names = {re.split(r'[\[(]', name)[0] for name in exported()}
        self.assertGreater(len(names), 100)
        self.assertEqual(declared()[1] - names, set())

    def test_sonames(self):
        for library in LIBRARIES:
            header = subprocess.check_output(['objdump', '-p', library], universal_newlines=True)
            self.assertRegex(header, r'SONAME +libktgp_orb_(core|views)\.so\.1\n')
