"""Build of the compiled core; everything else is in pyproject.toml and setup.cfg.

This file exists because the headers of NumPy have to be found when the package is built.  The
core is optional: where it cannot be compiled, installation goes on and fuzzykf runs on NumPy.
"""

import os
import platform
import shutil
from pathlib import Path

import numpy
from setuptools import Extension, setup
from setuptools.command.build_ext import build_ext


class BuildOptional(build_ext):
    """Says once, and clearly, that the compiled core is missing; works on all processors."""

    def finalize_options(self):
        """Compile modules side by side unless told otherwise."""
        super().finalize_options()
        self.parallel = self.parallel or True

    def run(self):
        """Build what can be built."""
        print(  # pip shows it with -v
            f"fuzzykf: compiling {len(self.extensions)} modules for {platform.machine()}, which takes some "
            "minutes; where they cannot be compiled fuzzykf is installed all the same, and runs on NumPy",
            flush=True,
        )
        super().run()
        missing = [extension.name for extension in self.extensions if not self.built(extension)]
        if missing:
            for extension in self.extensions:  # a part of the core is none
                for library in self.places(extension):
                    library.unlink(missing_ok=True)
            self.warn(
                f"{', '.join(missing)} could not be compiled (see the messages above): fuzzykf is installed "
                "without the compiled core and runs on NumPy, many times slower (see fuzzykf.engine.info())"
            )

    def build_extensions(self):
        """Take Clang on Windows, where there is one: the core has vectors that MSVC does not know."""
        clang = shutil.which("clang-cl")
        if self.compiler.compiler_type == "msvc" and clang:
            self.compiler.initialize()
            self.compiler.cc = clang
            for extension in self.extensions:
                extension.extra_compile_args = ["/clang:-O3", "-Wno-unused-command-line-argument"]
        super().build_extensions()

    def build_extension(self, extension):
        """Say which module comes next."""
        print(f"fuzzykf: compiling {extension.name}", flush=True)
        super().build_extension(extension)

    def places(self, extension):
        """Where the library of an extension may be."""
        name = extension.name
        return Path(self.get_ext_fullpath(name)), Path(self.build_lib, self.get_ext_filename(name))

    def built(self, extension):
        """Whether the library of an extension has been made."""
        return any(library.exists() for library in self.places(extension))


PACKAGE = Path("fuzzykf")
CORE = PACKAGE / "engine" / "compiled"

#: What is vectorised by hand, with AVX2 or AVX-512, gains nothing from the rest of -O3, nor does what only
#: calls it; the portable version, which is all that other processors have, does.
IS_X86 = platform.machine().lower() in ("x86_64", "amd64")
BY_HAND = ["-O2", "-fpeel-loops", "-ftree-partial-pre"] if IS_X86 else ["-O3"]
CALLING = ["-O2"]
FLAGS = {
    **dict.fromkeys(["gaps", "kalman_series", "nodes", "tables"], BY_HAND),
    **dict.fromkeys(["arrays", "processor", "backward", "hidden_markov", "nodes_backward"], CALLING),
    **dict.fromkeys(["gap_backward", "gap_series", "series", "switching"], CALLING),
    **dict.fromkeys(["compiled_attributes", "compiled_stepper", "nodes_gradient"], CALLING),
}


def optimize(module):
    """Return the options of a module, unless CFLAGS in the environment says others, without symbols."""
    own = os.environ.get("CFLAGS", "")
    level = [] if "-O" in own else FLAGS.get(module, ["-O3"])
    return [*level, *([] if "-g" in own else ["-g0"])]


def extension(source):
    """Describe a module of the compiled core."""
    return Extension(
        ".".join(source.with_suffix("").parts),
        [str(source)],
        depends=sorted(str(header) for pattern in ("*.pxd", "*.h") for header in PACKAGE.rglob(pattern)),
        include_dirs=[str(CORE), numpy.get_include()],
        define_macros=[("NPY_NO_DEPRECATED_API", "NPY_1_7_API_VERSION")],
        extra_compile_args=[*optimize(source.stem), "-Wno-psabi"],
        optional=True,
    )


setup(
    cmdclass={"build_ext": BuildOptional},
    ext_modules=[extension(source) for source in sorted(PACKAGE.rglob("*.pyx"))],
)
