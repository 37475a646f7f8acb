"""The page of a comparison says what the comparison says, whatever characters the names hold."""

from __future__ import annotations

import base64
import json
import re
import sys
from html import unescape
from html.parser import HTMLParser

import numpy as np
import pytest

from fuzzykf.comparison import Restoration, Task, score
from fuzzykf.comparison.report import check_installed, report_page
from fuzzykf.comparison.report_picture import MAX_STEPS, draw
from fuzzykf.comparison.wording import about_choices, about_intervals, about_task, cells
from fuzzykf.errors import MissingDependencyError

pytest.importorskip("jinja2", reason="the extra [report] is not installed")
pytest.importorskip("plotly", reason="the extra [report] is not installed")

NASTY = "</script><script>document.title = 'broken'</script><b>&\"'"


def make_comparison(n=400, *, timed=True, switch=None):
    """Two methods of known errors, the second with a switch, a choice and a note."""
    rng = np.random.default_rng(0)
    state = rng.normal(size=n)
    n_train = n // 2
    truth = state[n_train:]
    time = np.datetime64("2024-01-01T00:00", "m") + np.arange(n) * np.timedelta64(60, "m")
    task = Task(
        state=state,
        observation=state + 1.0,
        n_train=n_train,
        time=time if timed else None,
        switch=switch,
        switch_source="by hand",
    )
    m = len(truth)
    good = Restoration(
        name="OFSRFilter",
        mean=truth + 0.1 * rng.normal(size=m),
        std=np.full(m, 0.1),
        log_likelihood=np.full(m, -1.25),
        microseconds=0.25,
        switch=rng.uniform(size=m),
        description=f"law {NASTY}",
        notes=("mind <this>",),
    )
    bad = Restoration(name=f"other {NASTY}", mean=0.0 * truth, std=np.ones(m), microseconds=20.0)
    return score(task, (good, bad), np.random.default_rng(1), n_resamples=200)


def values_of(trace) -> np.ndarray:
    return np.frombuffer(base64.b64decode(trace["y"]["bdata"]), dtype=trace["y"]["dtype"])


@pytest.fixture(scope="module")
def page() -> str:
    settings = {"data": NASTY, "seed": "0"}
    return report_page(make_comparison(), title=NASTY, state_label=NASTY, unit="<kW>", settings=settings)


def text_of(page: str) -> str:
    """What a reader sees: the body without scripts and tags."""
    body = re.sub(r"<script.*?</script>|<style.*?</style>", "", page[page.index("<body") :], flags=re.DOTALL)
    return " ".join(unescape(re.sub(r"<[^>]*>", " ", body)).split())


def test_it_says_what_the_terminal_says(page) -> None:
    comparison, text = make_comparison(), text_of(page)
    sentences = [
        comparison.verdict("<kW>"),
        about_task(comparison, "<kW>"),
        about_intervals(comparison),
        *about_choices(comparison),
        *(cell for s in comparison.scores for cell in cells(s)),
        *(s.name for s in comparison.scores),
    ]
    for sentence in sentences:
        assert " ".join(sentence.split()) in text
    assert text.count("lowest RMSE") == 2  # in the verdict, and beside the method


class Elements(HTMLParser):
    """All elements of a page with their attributes, read as a browser reads them."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.found: list[tuple[str, dict[str, str | None]]] = []
        self.feed(page)

    def handle_starttag(self, tag, attrs) -> None:
        self.found.append((tag, dict(attrs)))


def test_names_cannot_break_out_of_the_page_and_nothing_is_loaded(page) -> None:
    found = Elements(page).found
    tags = [tag for tag, _ in found]
    assert tags.count("script") == 5  # plotly, three of data, and that of the page
    assert not {"b", "img", "iframe", "object"} & set(tags)
    addresses = [value for _, attrs in found for key, value in attrs.items() if key in ("src", "href")]
    assert addresses == ["data:,"]
    policy = next(attrs["content"] for _, attrs in found if attrs.get("http-equiv"))
    assert policy.startswith("default-src 'none';")


def test_an_uncertain_lead_is_said_to_be_one() -> None:
    doubt = "the best two might change places"
    clear = make_comparison()
    assert clear.is_certain
    assert doubt not in text_of(report_page(clear))
    # Errors of opposite sign: two methods that are equally good on every stretch.
    truth, std = clear.task.state[200:], np.ones(200)
    above, below = (
        Restoration(name=name, mean=truth + shift, std=std, microseconds=1.0)
        for name, shift in (("above", 0.5), ("below", -0.5))
    )
    level = score(clear.task, (above, below), np.random.default_rng(1))
    assert not level.is_certain
    assert doubt in text_of(report_page(level))


def test_the_picture_holds_the_series_that_were_restored() -> None:
    comparison = make_comparison()
    picture = draw(comparison, state_label="load", unit="kW")
    figure = json.loads(picture.figure)
    measured, fuzzy, other = picture.layers
    assert [layer.name for layer in picture.layers] == [
        "measured",
        *(r.name for r in comparison.restorations),
    ]
    good = comparison.restorations[0]
    expected = {
        0: comparison.task.state[200:],
        1: good.mean - 1.6448536 * good.std,
        2: good.mean + 1.6448536 * good.std,
        3: good.mean,
        4: good.switch,
    }
    assert measured.traces == [0]
    assert fuzzy.traces == [1, 2, 3, 4]
    assert other.traces == [5, 6, 7]
    for k, series in expected.items():
        np.testing.assert_allclose(values_of(figure["data"][k]), series, rtol=1e-6, atol=1e-6)
    assert figure["data"][4]["yaxis"] == "y2"
    x = json.loads(picture.x)
    assert (x[0], x[-1], len(x)) == ("2024-01-09T08:00", "2024-01-17T15:00", 200)
    assert figure["layout"]["yaxis"]["title"]["text"] == "load (kW)"


def test_rows_count_where_there_are_no_times_and_the_rule_of_the_switch_is_drawn() -> None:
    picture = draw(make_comparison(timed=False, switch=np.linspace(0, 1, 400)), state_label="load", unit="")
    assert json.loads(picture.x)[:2] == [200, 201]
    assert "switch of the rule" in picture.layers[-1].name
    rule = json.loads(picture.figure)["data"][picture.layers[-1].traces[0]]
    np.testing.assert_allclose(values_of(rule), np.linspace(0, 1, 400)[200:], rtol=1e-6)


def test_of_very_long_series_the_middle_is_drawn_and_the_page_says_so() -> None:
    comparison = make_comparison(2 * (MAX_STEPS + 1000), timed=False)
    picture = draw(comparison, state_label="load", unit="")
    assert json.loads(picture.x)[0] == MAX_STEPS + 1000 + 500
    assert picture.n_steps == MAX_STEPS
    assert "20,000 steps from the middle of the 21,000 test rows" in text_of(report_page(comparison))


@pytest.mark.parametrize("package", ["jinja2", "plotly.offline"])
def test_without_a_package_the_extra_is_named(package, monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(MissingDependencyError, match=r"pip install 'fuzzykf\[report\]'"):
        check_installed()
