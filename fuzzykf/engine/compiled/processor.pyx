# cython: language_level=3
"""The instruction set in use: the best one that this processor can run, unless another is chosen."""

cdef extern from "src/processor.h" nogil:
    int fk_levels() noexcept
    const char *fk_level_name(int) noexcept

level = fk_levels() - 1


def instructions():
    """Name of the set of instructions in use."""
    return fk_level_name(level).decode()


def available_instructions():
    """Names of the sets that this processor can run, the best one last."""
    return tuple(fk_level_name(k).decode() for k in range(fk_levels()))


def use_instructions(str name):
    """Choose another set, for tests and measurements; it holds for the whole process."""
    global level
    names = available_instructions()
    if name not in names:
        raise ValueError(f"name: got {name!r}, expected one of {names}")
    level = names.index(name)
