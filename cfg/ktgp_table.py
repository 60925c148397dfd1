"""Generates dynamic_reconfigure's parameters from a table in src/parameters; units are in brackets at the
end of the descriptions.

dev/update_documents writes the tables in README.md and doc from the result."""

import json
import os
import re

from dynamic_reconfigure.parameter_generator_catkin import (ParameterGenerator, bool_t, double_t,
                                                            int_t, str_t)

TABLES = os.path.join(os.path.dirname(os.path.dirname(os.path.abspath(__file__))), 'src',
                      'parameters')


def rows(table):
    """(kind, name, arguments) of each row of the table."""
    with open(os.path.join(TABLES, table), encoding='utf-8') as file:
        for line in file:
            row = re.match(r'KTGP_(\w+)\((\w+)(?:, (.*"))?(?:, [\w., ]+)?\)$', line.strip())
            if row:
                kind, name, arguments = row.groups()
                yield kind, name, json.loads('[%s]' % (arguments or ''))


# Names that rqt_reconfigure keeps in the same dictionary as the groups.
RESERVED = {'default', 'groups', 'id', 'name', 'parameters', 'parent', 'state', 'type'}


def check(table_rows):
    """Raises ValueError for names with which rqt_reconfigure cannot show the parameters."""
    groups, taken = [], {}
    for kind, name, _ in table_rows:
        if kind == 'GROUP':
            groups.append(name)
        what = 'group' if kind == 'GROUP' else 'parameter'
        other = 'word of dynamic_reconfigure' if name.lower() in RESERVED else taken.get(name.lower())
        if other:
            raise ValueError('the %s %s is called like a %s; rqt_reconfigure looks for both in one '
                             'dictionary, ignoring case, and would show neither' % (what, name, other))
        taken[name.lower()] = what
    shown = groups[1:]  # the first group stands above the others
    if shown != sorted(shown):
        raise ValueError('rqt_reconfigure shows groups by the order of their names, %s, which is not '
                         'that of the table, %s' % (', '.join(sorted(shown)), ', '.join(shown)))


def choices(gen, text, name, taken):
    """An enumeration from "value: what it means; value: what it means". All constants of a table need names of
    their own; `taken` has those so far."""
    entries = [entry.strip().split(': ', 1) for entry in text.split(';')]
    constants = []
    for value, meaning in entries:
        constant = '%s_%s' % (name, value) if value in taken else value
        taken.add(constant)
        constants.append(gen.const(constant, str_t, value, meaning))
    return gen.enum(constants, 'Choices')


def generate(table, name):
    check(rows(table))
    gen = ParameterGenerator()
    group = gen
    taken = set()
    for kind, parameter, arguments in rows(table):
        if kind == 'GROUP':
            group = gen if parameter == 'method' else gen.add_group(parameter)
        elif kind in ('INT', 'DOUBLE'):
            default, low, high, unit, text = arguments
            group.add(parameter, int_t if kind == 'INT' else double_t, 0,
                      '%s [%s]' % (text, unit) if unit else text, default, low, high)
        elif kind == 'BOOL':
            group.add(parameter, bool_t, 0, arguments[1], arguments[0])
        elif kind == 'STRING':
            group.add(parameter, str_t, 0, arguments[1], arguments[0])
        elif kind == 'CHOICE':
            group.add(parameter, str_t, 0, arguments[1], arguments[0],
                      edit_method=choices(gen, arguments[2], parameter, taken))
    return gen.generate('ktgp_orb', 'ktgp_orb', name)
