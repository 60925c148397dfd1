#!/usr/bin/python3
"""Starts the real rqt_reconfigure and operates it with mouse and keyboard. Commands on the standard
input are JSON lists, one per line; the answer is a JSON line:

    ["select", NODE]          click the node in the tree
    ["groups"]                titles of the groups shown, from top to bottom
    ["slide", NAME, VALUE]    click into the slider and drag it; the answer is the value it stands at
    ["choose", NAME, VALUE]   of an enumeration
    ["type", NAME, TEXT]
    ["photograph", FILE]
"""

import json
import queue
import sys
import threading
import traceback

from PyQt5.QtCore import QModelIndex, Qt, QTimer
from PyQt5.QtTest import QTest
from PyQt5.QtWidgets import QApplication, QGroupBox, QMainWindow, QTreeView
from rqt_gui.main import Main

commands = queue.Queue()


def wait_until(condition, seconds=60):
    for _ in range(seconds * 100):
        found = condition()
        if found:
            return found
        QTest.qWait(10)
    raise AssertionError('timed out')


def widgets(kind, name=None):
    return [w for w in QApplication.allWidgets()
            if isinstance(w, kind) and w.isVisible() and (name is None or w.objectName() == name)]


def editor(name):
    """Returns the widget in which rqt shows a parameter."""
    def find():
        return [w for w in QApplication.allWidgets()
                if getattr(w, 'param_name', None) == name and hasattr(w, '_updater') and
                not hasattr(w, 'editor_widgets') and w.isVisible()]
    return wait_until(find)[0]


def show(widget):
    area = widget
    while area and not hasattr(area, 'ensureWidgetVisible'):
        area = area.parentWidget()
    area.ensureWidgetVisible(widget)
    QTest.qWait(10)


def select(node):
    view = wait_until(lambda: widgets(QTreeView, '_node_selector_view'))[0]
    view.expandAll()
    index = QModelIndex()
    for part in node.strip('/').split('/'):
        model = view.model()
        index = next(model.index(row, 0, index) for row in range(model.rowCount(index))
                     if model.index(row, 0, index).data() == part)
    view.scrollTo(index)
    QTest.mouseClick(view.viewport(), Qt.LeftButton, pos=view.visualRect(index).center())
    wait_until(lambda: [w for w in QApplication.allWidgets()
                        if getattr(w, '_toplevel_treenode_name', None) == node and w.isVisible()])
    QTest.qWait(100)


def groups():
    boxes = sorted(widgets(QGroupBox), key=lambda box: box.mapToGlobal(box.rect().topLeft()).y())
    return [box.title() for box in boxes if box.title()]


def slide(name, value):
    found = editor(name)
    show(found)
    slider = found._slider_horizontal
    double = hasattr(found, '_get_value_slider')
    slider.setFocus()
    goal = found._get_value_slider(value) if double else int(value)
    step = Qt.Key_Right if goal > slider.value() else Qt.Key_Left
    while slider.value() != goal:
        QTest.keyClick(slider, step)
    return found._get_value_textfield() if double else slider.value()


def choose(name, value):
    found = editor(name)
    show(found)
    box = found._combobox
    texts = [box.itemText(i) for i in range(box.count())]
    goal = next(i for i, text in enumerate(texts) if text.startswith(value))
    box.setFocus()
    while box.currentIndex() != goal:
        QTest.keyClick(box, Qt.Key_Down if goal > box.currentIndex() else Qt.Key_Up)
    return texts


def type_text(name, text):
    line = editor(name)._paramval_lineedit
    show(line)
    QTest.mouseClick(line, Qt.LeftButton)
    line.selectAll()
    QTest.keyClicks(line, text)
    QTest.keyClick(line, Qt.Key_Return)


def photograph(path):
    window = widgets(QMainWindow)[0]
    window.resize(1300, 2500)
    QTest.qWait(200)
    return window.grab().save(path)


ACTIONS = {'select': select, 'groups': groups, 'slide': slide, 'choose': choose, 'type': type_text,
           'photograph': photograph}


def work():
    try:
        name, *arguments = commands.get_nowait()
    except queue.Empty:
        QTimer.singleShot(20, work)
        return
    if name == 'end':
        QApplication.quit()
        return
    try:
        answer = {'answer': ACTIONS[name](*arguments)}
    except BaseException:  # whatever it is, the test shows it
        answer = {'error': traceback.format_exc()}
    print(json.dumps(answer), flush=True)
    QTimer.singleShot(0, work)


def read():
    for line in sys.stdin:
        commands.put(json.loads(line))
    commands.put(['end'])


class Client(Main):
    def create_application(self, argv):
        app = super().create_application(argv)
        QTimer.singleShot(0, work)
        threading.Thread(target=read, daemon=True).start()
        return app


def fail(*error):
    """An exception in a slot of the client; rqt would only print it and show an empty page."""
    traceback.print_exception(*error)
    print(json.dumps({'error': ''.join(traceback.format_exception(*error))}), flush=True)


if __name__ == '__main__':
    sys.excepthook = fail
    threading.excepthook = lambda error: fail(error.exc_type, error.exc_value, error.exc_traceback)
    sys.exit(Client(filename='rqt_reconfigure').main(
        sys.argv[:1] + ['--clear-config'], standalone='rqt_reconfigure'))
