"""pytest plugin: put fuzzykf's classes and functions in the place of filterpy's.

It is loaded into the subprocess that runs filterpy's own tests, before they are collected.
"""

import numpy as np
import pytest


def pytest_configure(config):
    import filterpy.kalman

    import fuzzykf.kalman

    for name in fuzzykf.kalman.__all__:
        setattr(filterpy.kalman, name, getattr(fuzzykf.kalman, name))


def pytest_collection_finish(session):
    """A test module that still held one of filterpy's own would prove nothing."""
    import fuzzykf.kalman

    for module in {item.module for item in session.items}:
        for name in fuzzykf.kalman.__all__:
            if getattr(module, name, None) not in (None, getattr(fuzzykf.kalman, name)):
                pytest.exit(f"{module.__name__}.{name} is not fuzzykf's", returncode=9)


def pytest_runtest_setup(item):
    np.random.seed(20)  # noqa: NPY002 - filterpy's tests draw from the global generator
