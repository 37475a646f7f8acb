"""A process that is forked while another thread is at work here goes on."""

from __future__ import annotations

import os
import sys
import textwrap
import threading
import time
import warnings

import pytest

from fuzzykf import registry
from fuzzykf.immutable import cached_property

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork")


def run_in_child(work, seconds=20.0):
    """Fork, do the work there, and return whether it came to an end."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # Python 3.12: of threads and forks
        child = os.fork()
    if child == 0:
        try:
            work()
        finally:
            os._exit(0)
    deadline = time.monotonic() + seconds
    while os.waitpid(child, os.WNOHANG)[0] == 0:
        if time.monotonic() > deadline:
            os.kill(child, 9)
            os.waitpid(child, 0)
            return False
        time.sleep(0.005)
    return True


def test_while_a_property_is_computed():
    begun, go_on = threading.Event(), threading.Event()

    class Thing:
        def __init__(self, waits):
            self.waits = waits

        @cached_property
        def value(self):
            if self.waits:
                begun.set()
                go_on.wait()
            return 3

    thread = threading.Thread(target=lambda: Thing(True).value)
    thread.start()
    begun.wait()
    done = run_in_child(lambda: Thing(False).value)
    go_on.set()
    thread.join()
    assert done


def test_while_a_module_is_imported_late(tmp_path, monkeypatch):
    (tmp_path / "slow_to_import.py").write_text(
        textwrap.dedent(
            """
            import time
            begun = True
            time.sleep(0.5)
            class Thing:
                pass
            """
        )
    )
    monkeypatch.syspath_prepend(tmp_path)
    things = registry.Registry({"thing": "slow_to_import:Thing"})
    thread = threading.Thread(target=lambda: things["thing"])
    thread.start()
    while not hasattr(sys.modules.get("slow_to_import"), "begun"):
        time.sleep(0.001)
    done = run_in_child(lambda: things["thing"])
    thread.join()
    assert done
    assert not any(registry._IMPORTING.values())
    del sys.modules["slow_to_import"]


def test_an_import_may_fork(tmp_path, monkeypatch):
    (tmp_path / "forks.py").write_text(
        textwrap.dedent(
            """
            import os
            child = os.fork()
            if child == 0:
                os._exit(0)
            os.waitpid(child, 0)
            Thing = int
            """
        )
    )
    monkeypatch.syspath_prepend(tmp_path)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        assert registry.Registry({"thing": "forks:Thing"})["thing"] is int
    del sys.modules["forks"]


def test_threads_find_the_same_classes():
    things = registry.Registry({"fraction": "fractions:Fraction"})
    found = []
    threads = [threading.Thread(target=lambda: found.append(things["fraction"])) for _ in range(8)]
    for one in threads:
        one.start()
    for one in threads:
        one.join()
    assert len(set(found)) == 1
    assert len(found) == 8
