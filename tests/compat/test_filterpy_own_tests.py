"""filterpy's own tests pass with fuzzykf's classes in the place of filterpy's.

They come with filterpy's source distribution only, which is fetched once into the cache of
pytest (or given through FUZZYKF_FILTERPY_SDIST, the path of the archive).
"""

import os
import subprocess
import sys
import tarfile
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest

import fuzzykf

pytest.importorskip("filterpy")
pytest.importorskip("matplotlib")  # filterpy's tests import it

VERSION = "2.0.0"
ARCHIVE = f"filterpy-{VERSION}.tar.gz"

#: filterpy's test files that use KalmanFilter, ExtendedKalmanFilter, IMMEstimator or the functions.
FILES = [
    "common/tests/test_helpers.py",
    "kalman/tests/test_ekf.py",
    "kalman/tests/test_fls.py",
    "kalman/tests/test_imm.py",
    "kalman/tests/test_information.py",
    "kalman/tests/test_kf.py",
    "kalman/tests/test_mmae.py",
    "kalman/tests/test_rts.py",
    "kalman/tests/test_sensor_fusion.py",
    "kalman/tests/test_sqrtkf.py",
    "kalman/tests/test_ukf.py",
]

#: Tests that are left out: they take half of the time, and nothing of fuzzykf takes part in them.
LEFT_OUT = [
    "common/tests/test_helpers.py::test_outer_product",  # a loop over a million outer products
    "common/tests/test_helpers.py::test_inv_diagonal",  # ten thousand inverses by filterpy's helper
    "kalman/tests/test_ukf.py::test_circle",  # an unscented filter alone
    "kalman/tests/test_ukf.py::test_fixed_lag",  # this too
    "kalman/tests/test_ukf.py::test_rts",  # and these
    "kalman/tests/test_ukf.py::test_radar",
]

#: Tests that may fail, "file::test" and why: only faults of filterpy that fuzzykf does not
#: inherit, or faults of the test itself, may ever stand here.  There are none.
EXPECTED_FAILURES: dict[str, str] = {}


def fetch(cache: Path) -> Path:
    """Return the archive, from the environment, the cache or the package index."""
    if given := os.environ.get("FUZZYKF_FILTERPY_SDIST"):
        return Path(given)
    if not (cache / ARCHIVE).exists():
        command = [sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", "--no-binary", ":all:"]
        command += ["--retries", "1", "--timeout", "20"]
        run = subprocess.run(
            [*command, f"filterpy=={VERSION}", "--dest", str(cache)],
            capture_output=True,
            text=True,
            check=False,
        )
        if run.returncode != 0:
            reason = (run.stderr.strip().splitlines() or ["no message"])[-1]
            pytest.skip(
                f"the source distribution of filterpy {VERSION} cannot be fetched ({reason}); "
                f"set FUZZYKF_FILTERPY_SDIST to the path of {ARCHIVE} to run filterpy's own tests"
            )
    return cache / ARCHIVE


@pytest.fixture(scope="session")
def outcome(pytestconfig, tmp_path_factory):
    """Run all files in one subprocess; map each file to its tests and whether they passed."""
    if getattr(pytestconfig, "cache", None) is not None:
        cache = pytestconfig.cache.mkdir("filterpy-sdist")
    else:
        cache = tmp_path_factory.mktemp("filterpy-sdist")
    root = tmp_path_factory.mktemp("filterpy")
    with tarfile.open(fetch(Path(cache))) as archive:
        archive.extractall(root, filter="data")
    root = root / f"filterpy-{VERSION}"
    (root / "pytest.ini").write_text("[pytest]\n")
    report = root / "report.xml"
    environment = os.environ | {
        "MPLBACKEND": "Agg",
        "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1",  # their tests need none, and loading takes seconds
        # the fuzzykf of this run, wherever it is imported from
        "PYTHONPATH": os.pathsep.join(
            map(str, [root, Path(__file__).parent, Path(fuzzykf.__file__).parents[1]])
        ),
    }
    run = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "fuzzykf_in_filterpy", "-p", "no:cacheprovider"]
        + ["--assert=plain", "-c", "pytest.ini", f"--junitxml={report}", "-o", "junit_family=xunit1"]
        + [f"--deselect=filterpy/{name}" for name in LEFT_OUT]
        + [f"filterpy/{name}" for name in FILES],
        cwd=root,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode in (0, 1), run.stdout + run.stderr
    results: dict[str, dict[str, str]] = {name: {} for name in FILES}
    for case in ElementTree.parse(report).iter("testcase"):
        failure = next((child for child in case if child.tag in ("failure", "error")), None)
        name = case.get("file", "").removeprefix("filterpy/")
        results[name][case.get("name", "")] = "" if failure is None else (failure.text or "failed")
    return results


@pytest.mark.parametrize("name", FILES)
def test_filterpys_tests_pass_with_fuzzykfs_classes(name, outcome):
    assert outcome[name], "no test was run"
    unexpected = {
        test: why for test, why in outcome[name].items() if why and f"{name}::{test}" not in EXPECTED_FAILURES
    }
    assert not unexpected, "\n\n".join(f"{test}:\n{why}" for test, why in unexpected.items())


def test_every_expected_failure_still_fails(outcome):
    # an entry that has become superfluous has to be removed
    for key in EXPECTED_FAILURES:
        name, test = key.split("::")
        assert outcome[name][test], f"{key} passes by now"
