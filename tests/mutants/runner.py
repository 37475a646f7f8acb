"""A private copy of the package, with one mutant in it at a time, and the tests that judge it."""

from __future__ import annotations

import compileall
import importlib
import json
import os
import py_compile
import re
import resource
import shutil
import signal
import subprocess
import sys
import sysconfig
import time
import traceback
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

__all__ = ["Copy", "Verdict"]

#: Tests that take longer than this on the unchanged package are left out.
SLOW = 0.4

#: What every run imports, and no mutant changes: loaded once, before a process forks for each mutant.
SHARED = (
    "numpy",
    "scipy.linalg",
    "scipy.optimize",
    "scipy.signal",
    "scipy.special",
    "scipy.stats",
    "hypothesis.extra.numpy",
    "hypothesis.strategies",
    "pytest",
    "xdist.plugin",
    "pytest_benchmark.plugin",
    "filterpy.kalman",
    "pandas",
)


@dataclass
class Verdict:
    """What tests said: ``killed``, ``survived`` or ``timeout``; by which test, after how long."""

    outcome: str
    by: str = ""
    seconds: float = 0.0


class _Plugin:
    """Leaves out slow tests, lets hypothesis stop at the first example, and notes what failed and how long.

    Where it is not known yet which tests are slow, they are ended when their time is over.
    """

    def __init__(self, note: Path, slow: set[str] | None) -> None:
        self.note, self.slow, self.limited = note, slow or set(), slow is None
        self.failed: list[str] = []
        self.times: dict[str, float] = {}

    def pytest_collection(self) -> None:
        from hypothesis import Phase, settings

        settings.register_profile("mutants", derandomize=True, phases=(Phase.explicit, Phase.generate))
        settings.load_profile("mutants")

    def pytest_collection_modifyitems(self, items: list[Any]) -> None:
        items[:] = [item for item in items if item.nodeid not in self.slow]

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_call(self, item: Any) -> Any:
        if not self.limited:
            return (yield)
        late: list[str] = []

        def end(*_: Any) -> None:
            late.append(item.nodeid)
            pytest.skip("slow")

        signal.signal(signal.SIGALRM, end)
        signal.setitimer(signal.ITIMER_REAL, SLOW)
        try:
            return (yield)
        except BaseException:
            if late:  # whatever came of it on the way out
                pytest.skip("slow")
            raise
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0.0)

    def pytest_collectreport(self, report: Any) -> None:
        self.look(report)

    def pytest_runtest_logreport(self, report: Any) -> None:
        if self.limited and report.skipped and "slow" in str(report.longrepr):
            self.slow.add(report.nodeid)
        self.times[report.nodeid] = self.times.get(report.nodeid, 0.0) + report.duration
        self.look(report)

    def look(self, report: Any) -> None:
        if report.failed:
            self.failed.append(report.nodeid)

    def pytest_sessionfinish(self) -> None:
        self.note.write_text(
            json.dumps({"failed": self.failed, "times": self.times, "slow": list(self.slow)})
        )


class Copy:
    """A copy of package and tests in a folder of its own."""

    def __init__(self, root: Path, folder: Path) -> None:
        self.folder = folder
        leave = shutil.ignore_patterns("__pycache__", "benchmarks", ".hypothesis", "baseline")
        for name in ("fuzzykf", "tests"):
            shutil.copytree(root / name, folder / name, ignore=leave)
        shutil.copy(root / "pyproject.toml", folder)
        self._without_eights()
        # a mutant has the size of its original, and may have its time: compiled code goes by content
        mode = py_compile.PycInvalidationMode.CHECKED_HASH
        compileall.compile_dir(folder / "fuzzykf", quiet=1, invalidation_mode=mode)
        for name in SHARED:
            importlib.import_module(name)

    # ------------------------------------------------------------------ sources

    def read(self, file: str) -> bytes:
        """Return the text of a file as it is now."""
        return (self.folder / file).read_bytes()

    def write(self, file: str, text: bytes) -> None:
        """Change a file."""
        (self.folder / file).write_bytes(text)

    # ------------------------------------------------------------------ translation units

    def _without_eights(self) -> None:
        """Leave out the arithmetic on vectors of eight: it takes long to compile, few processors have it."""
        file = "fuzzykf/engine/compiled/src/engines.h"
        text = self.read(file).replace(b"FK_VERSION(v4)", b"FK_VERSION(v3)")
        block = rb'#define FK_NAME\(name\) name##_v4\n.*\n.*\n#include "bodies.h"\n'
        self.write(file, re.sub(block, b"", text))

    def library(self, unit: str) -> Path:
        """Where the library made of a .pyx is."""
        return (self.folder / unit).with_suffix(sysconfig.get_config_var("EXT_SUFFIX"))

    def build(self, unit: str, again: bool = False) -> bool:
        """Compile one .pyx as setup.py does, but quickly; ``again`` if the .pyx itself has changed."""
        import numpy

        c = (self.folder / unit).with_suffix(".c")
        if again or not c.exists():
            command = [sys.executable, "-m", "cython", unit]
            if subprocess.run(command, cwd=self.folder, capture_output=True, check=False).returncode:
                return False
        include = ["fuzzykf/engine/compiled", numpy.get_include(), sysconfig.get_path("include")]
        command = [
            *sysconfig.get_config_var("CC").split(),
            *(
                "-shared",
                "-fPIC",
                "-DNDEBUG",
                "-fwrapv",
                "-O1",
                "-w",
                "-DNPY_NO_DEPRECATED_API=NPY_1_7_API_VERSION",
            ),
            *(f"-I{path}" for path in include),
            *("-o", str(self.library(unit)), str(c)),
        ]
        return not subprocess.run(command, cwd=self.folder, capture_output=True, check=False).returncode

    # ------------------------------------------------------------------ tests

    def baseline(self, tests: tuple[str, ...], engine: str) -> tuple[set[str], float]:
        """Run the tests on the unchanged package: which are slow, and how long the others take."""
        verdict, said = self._run(tests, engine, None, 900.0)
        if verdict.outcome != "survived":
            log = (self.folder / "log").read_text(errors="replace")[-3000:]
            raise SystemExit(f"{log}\nthe unchanged package fails ({engine}): {verdict.by}")
        slow = set(said["slow"])
        return slow, sum(seconds for name, seconds in said["times"].items() if name not in slow)

    def judge(self, tests: tuple[str, ...], engine: str, slow: set[str], timeout: float) -> Verdict:
        """Run the tests up to the first that fails."""
        return self._run(tests, engine, slow, timeout)[0]

    def _run(
        self, tests: tuple[str, ...], engine: str, slow: set[str] | None, timeout: float
    ) -> tuple[Verdict, dict[str, Any]]:
        note = self.folder / "note.json"
        note.unlink(missing_ok=True)
        begin = time.perf_counter()
        child = os.fork()
        if not child:
            self._child(tests, engine, _Plugin(note, slow))
        status = None
        while status is None and time.perf_counter() - begin < timeout:
            done, code = os.waitpid(child, os.WNOHANG)
            status = code if done else None
            if status is None:
                time.sleep(0.02)
        seconds = time.perf_counter() - begin
        if status is None:
            os.killpg(child, signal.SIGKILL)
            os.waitpid(child, 0)
            return Verdict("timeout", "", seconds), {}
        said = json.loads(note.read_text()) if note.exists() else {"failed": []}
        if os.waitstatus_to_exitcode(status) == 0:
            return Verdict("survived", "", seconds), said
        return Verdict("killed", (said["failed"] or ["crash"])[0], seconds), said

    def _child(self, tests: tuple[str, ...], engine: str, plugin: _Plugin) -> None:
        """Run pytest in this process, which has forked, and end it."""
        code = 99
        try:
            os.setsid()
            resource.setrlimit(resource.RLIMIT_AS, (8 << 30, 8 << 30))
            log = os.open(self.folder / "log", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
            for stream in (1, 2):
                os.dup2(log, stream)
            os.chdir(self.folder)
            os.environ.update(
                FUZZYKF_ENGINE=engine,
                PYTHONPATH=str(self.folder),
                PYTHONDONTWRITEBYTECODE="1",
                MPLBACKEND="agg",
            )
            sys.dont_write_bytecode = not plugin.limited
            sys.path.insert(0, str(self.folder))
            import fuzzykf

            if Path(fuzzykf.__file__).parent != self.folder / "fuzzykf":
                raise SystemExit(f"not the copy: {fuzzykf.__file__}")
            options = [
                "-W",
                "ignore::pytest.PytestAssertRewriteWarning",
                "-x",
                "-q",
                "-n0",
                "-p",
                "no:cacheprovider",
                "--tb=line",
            ]
            code = int(pytest.main([*options, *tests], plugins=[plugin]))
        except BaseException:
            traceback.print_exc()
        finally:
            os._exit(code)
