"""What scripts that start programs have in common: they wait for states, and need ports that are free."""

import socket
import time


def wait(what, condition, seconds, look=0.05, ignoring=()):
    """The first true answer of a condition; errors of the kinds `ignoring` are no answer."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        try:
            answer = condition()
        except ignoring:
            answer = None
        if answer:
            return answer
        time.sleep(look)
    raise AssertionError(f"{what}: not within {seconds} s")


def free_port():
    with socket.socket() as bound:
        bound.bind(("127.0.0.1", 0))
        return bound.getsockname()[1]
