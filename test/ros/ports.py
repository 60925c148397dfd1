"""Ports of the machine for a test's own ROS master."""

import random
import socket


def free_port():
    """A port on which nothing listens. It is below those that the system gives to connections: between
    this check and the start of the master such a port could be taken by any program beside it."""
    while True:
        port = random.randrange(20000, 32000)
        with socket.socket() as probe:
            try:
                probe.bind(('', port))
                return port
            except OSError:
                pass
