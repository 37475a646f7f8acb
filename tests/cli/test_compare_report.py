"""``fuzzykf compare --report`` writes a page that draws in a browser, from one file, without a network."""

from __future__ import annotations

import csv
import json
import re
import shlex
import shutil
from html import unescape

import numpy as np
import pytest
from typer.testing import CliRunner

from fuzzykf.cli.app import app
from fuzzykf.comparison import run

pytest.importorskip("plotly", reason="the extra [report] is not installed")

#: A name of a column that would end a script, and run one, on a careless page.
NAME = "</script><script>document.title='broken'</script><img src=x onerror=\"document.title='broken'\">"


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    """Ten days of hours: a load that follows the temperature, differently by day and by night."""
    rng = np.random.default_rng(0)
    hour = np.arange(240)
    day = np.clip(1.5 * np.sin(2 * np.pi * (hour - 9) / 24), -1, 1)
    temperature = np.convolve(rng.normal(size=244), np.ones(5), "valid") + 15 + 3 * day
    load = (1.0 + 0.5 * day) * (temperature - 15) + 10 + 2 * day + 0.3 * rng.normal(size=240)
    time = np.datetime64("2014-01-06T00:00", "m") + hour * np.timedelta64(60, "m")
    path = tmp_path_factory.mktemp("report") / "data.csv"
    with path.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows(
            [["time", NAME, "temperature"], *zip(time, load, temperature, strict=True)]
        )
    return path


@pytest.fixture(autouse=True, scope="module")
def _without_the_long_ones():
    quick = tuple(name for name in run.RIVALS if name not in ("hard2-filter", "pool-inputs", "boosting"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(run, "RIVALS", quick)
        yield


def compare(data, *arguments: object):
    options = [
        "--folds",
        2,
        "--state",
        NAME,
        "--obs",
        "temperature",
        "--switch",
        "clock",
        "--out",
        data.parent / "out",
    ]
    command = ["compare", data, *options, *arguments]
    return CliRunner().invoke(app, list(map(str, command)), env={"COLUMNS": "200"})


@pytest.fixture(scope="module")
def report(data):
    path = data.parent / "pages" / "report.html"  # a folder that the command makes
    result = compare(data, "--report", path, "--seed", 3, "--also", "hard1")
    assert result.exit_code == 0, result.output
    assert f"Wrote {path}" in result.output
    return path


def test_the_page_has_the_settings_and_the_numbers_of_the_table(report) -> None:
    page = report.read_text(encoding="utf-8")
    for setting in (
        "240: 120 for training, 120 for testing",
        "2, trained again before each fold, on all earlier rows",
        "seed 3",
        "not subtracted",
        "5 between 0 and 1",
    ):
        assert setting in page
    with (report.parents[1] / "out" / "comparison.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 2 + len(run.RIVALS)  # the fuzzy filter, its rivals, and hard1
    for row in rows:
        assert f"{float(row['rmse']):.4g}</td>" in page


def test_the_command_on_the_page_repeats_the_comparison(report, tmp_path) -> None:
    found = re.search(r"<dt>command</dt><dd>(.*?)</dd>", report.read_text(encoding="utf-8"), re.DOTALL)
    program, *command = shlex.split(unescape(found[1]))
    assert program == "fuzzykf"
    result = CliRunner().invoke(app, [*command, "--out", str(tmp_path / "again")])
    assert result.exit_code == 0, result.output
    tables = []
    for folder in (report.parents[1] / "out", tmp_path / "again"):
        with (folder / "comparison.csv").open(encoding="utf-8", newline="") as file:
            tables.append([{**row, "microseconds_per_step": ""} for row in csv.DictReader(file)])
    assert tables[0] == tables[1]


def test_a_page_that_cannot_be_written_is_refused_before_any_work(data) -> None:
    before = data.read_bytes()
    for path, message in (
        (data, "--report: "),
        (data / "report.html", "expected a folder, found a file"),
        (data.parent, "expected a file, found a folder"),
    ):
        result = compare(data, "--report", path)
        assert result.exit_code == 1
        assert message in result.output
    assert data.read_bytes() == before


def test_without_plotly_it_names_the_extra_and_writes_nothing(data, tmp_path, monkeypatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "plotly.offline", None)
    result = compare(data, "--report", tmp_path / "report.html", "--out", tmp_path / "out")
    assert result.exit_code == 1
    assert "pip install 'fuzzykf[report]'" in result.output
    assert list(tmp_path.iterdir()) == []


# ------------------------------------------------------------------ in a browser


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    """Chromium without a window, in a profile of its own."""
    webdriver = pytest.importorskip("selenium.webdriver", reason="selenium is not installed")
    chromium, driver = shutil.which("chromium"), shutil.which("chromedriver")
    if chromium is None or driver is None:
        pytest.skip("chromium and chromedriver are not installed: the report is not opened in a browser")
    options = webdriver.ChromeOptions()
    options.binary_location = chromium
    for argument in (
        "--headless",
        "--no-sandbox",  # which root cannot have
        "--disable-gpu",
        "--disable-quic",
        "--disable-dev-shm-usage",
        "--no-first-run",
        "--disable-background-networking",
        "--disable-component-update",
        "--disable-sync",
        "--window-size=1280,900",
        f"--user-data-dir={tmp_path_factory.mktemp('chromium')}",
    ):
        options.add_argument(argument)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    browser = webdriver.Chrome(options=options, service=webdriver.ChromeService(driver))
    yield browser
    browser.quit()


def requests(browser) -> list[str]:
    """Addresses that were asked for since the last call."""
    events = [json.loads(entry["message"])["message"] for entry in browser.get_log("performance")]
    return [e["params"]["request"]["url"] for e in events if e["method"] == "Network.requestWillBeSent"]


def drawn(browser) -> int:
    """Count the traces in the picture that have a path to be seen."""
    return browser.execute_script(
        """return [...document.querySelectorAll("#picture .scatterlayer .trace")].filter((trace) =>
        [...trace.querySelectorAll("path")].some((path) => path.getAttribute("d").length > 100)).length"""
    )


def test_the_page_draws_without_errors_and_without_a_network(browser, report) -> None:
    browser.get("about:blank")
    requests(browser), browser.get_log("browser")  # forget what the browser did by itself
    browser.get(report.as_uri())
    assert browser.title == f"data.csv: {NAME}"
    assert [address for address in requests(browser) if not address.startswith("data:")] == [report.as_uri()]
    assert browser.find_element("css selector", "h1").text == f"data.csv: {NAME}"

    # What is drawn at first: the measured state, three methods at most, and what can be switched on.
    boxes = browser.find_elements("css selector", "input[data-traces]")
    # measured, the fuzzy filter, its rivals, hard1, and the rule of the clock
    assert len(boxes) == 4 + len(run.RIVALS)
    traces = [json.loads(box.get_attribute("data-traces")) for box in boxes]
    at_first = sum(len(new) for box, new in zip(boxes, traces, strict=True) if box.is_selected())
    assert drawn(browser) == at_first > 0
    hidden = next(k for k, box in enumerate(boxes) if not box.is_selected())
    boxes[hidden].send_keys(" ")  # the keyboard will do
    assert drawn(browser) == at_first + len(traces[hidden])
    boxes[hidden].click()
    assert drawn(browser) == at_first

    # The buttons move in time.
    def window() -> list[str]:
        return browser.execute_script("return document.getElementById('picture').layout.xaxis.range")

    browser.find_element("css selector", "button[data-move=all]").click()
    assert window() == ["2014-01-11T00:00:00", "2014-01-15T23:00:00"]  # the second half

    # On a phone nothing sticks out, and the figures stay readable.
    phone = {"width": 360, "height": 740, "deviceScaleFactor": 2, "mobile": True}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", phone)
    browser.get(report.as_uri())
    assert browser.execute_script("return document.documentElement.scrollWidth") == 360
    assert drawn(browser) > 0
    assert browser.get_log("browser") == []
