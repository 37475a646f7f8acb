"""The loops that the paper of the fuzzy estimator prints, compiled as the package is; for comparison only."""

from __future__ import annotations

import ctypes
import subprocess
import sysconfig
import tempfile
from functools import cache
from pathlib import Path

import numpy as np

SOURCE = Path(__file__).with_name("literal_loops.c")

#: What setup.py adds to the flags of the interpreter.
FLAGS = ("-O3", "-Wno-psabi")


class Grid(ctypes.Structure):
    """A regular grid of two states, and the values of a scalar noise."""

    _fields_ = [
        *((name, ctypes.c_int) for name in ("n1", "n2", "n_noise")),
        *((name, ctypes.c_double) for name in ("low1", "step1", "low2", "step2", "low_w", "step_w")),
    ]

    @classmethod
    def over(cls, points, domain, noise):
        """Grid of ``points`` squared nodes over a domain, with equidistant values of the noise."""
        (a, b), (c, d) = domain
        return cls(
            points, points, noise.size, a, (b - a) / (points - 1), c, (d - c) / (points - 1), noise[0],
            noise[1] - noise[0],
        )  # fmt: skip


@cache
def library():
    """Compile the loops; None without a compiler."""
    compiler, flags = sysconfig.get_config_var("CC"), sysconfig.get_config_var("CFLAGS")
    if not compiler:
        return None
    folder = tempfile.TemporaryDirectory()
    target = Path(folder.name, "literal.so")
    command = [*compiler.split(), *flags.split(), *FLAGS, "-fPIC", "-shared", SOURCE, "-o", target, "-lm"]
    try:
        subprocess.run(command, check=True, capture_output=True)
    except (OSError, subprocess.CalledProcessError):
        return None
    loaded = ctypes.CDLL(str(target))
    loaded.folder = folder  # kept as long as the library
    return loaded


def _address(array):
    assert array.dtype == np.float64
    assert array.flags.c_contiguous
    return array.ctypes.data_as(ctypes.c_void_p)


def propagate(model, grid, mu, noise, parameter):
    """Membership (n1, n2) after one step of "linear" or "rocket", for memberships ``noise`` of the noise."""
    out = np.empty_like(mu)
    getattr(library(), f"propagate_{model}")(
        ctypes.byref(grid), _address(mu), _address(noise), _address(out), ctypes.c_double(parameter)
    )
    return out


def update_position(grid, mu, noise, z):
    """Condition, in place, on a measurement of the first state."""
    library().update_position(ctypes.byref(grid), _address(mu), _address(noise), ctypes.c_double(z))


def center_of_gravity(grid, mu):
    """Centre of gravity (2,)."""
    center = np.empty(2)
    library().center_of_gravity(ctypes.byref(grid), _address(mu), _address(center))
    return center
