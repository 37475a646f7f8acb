"""The notebook of a tutorial is its page: the same code, the same output, no other file needed."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path
from types import SimpleNamespace

import pytest

DOCS = Path(__file__).parents[1] / "docs"
FENCE = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
LISTING = re.compile(r"^```.+?^```$", re.MULTILINE | re.DOTALL)  # run or shown
TUTORIALS = sorted(page for page in (DOCS / "tutorials").glob("*.md") if page.stem != "index")

spec = importlib.util.spec_from_file_location("notebooks", DOCS / "notebooks.py")
notebooks = importlib.util.module_from_spec(spec)
spec.loader.exec_module(notebooks)


def cells(page: Path, kind: str, url: str = "") -> list[dict]:
    return [cell for cell in notebooks.notebook(page, DOCS, url)["cells"] if cell["cell_type"] == kind]


@pytest.mark.parametrize("page", TUTORIALS, ids=lambda page: page.stem)
def test_a_notebook_has_the_code_of_its_page_and_what_it_prints(page) -> None:
    listings = FENCE.findall(page.read_text(encoding="utf-8"))
    found = cells(page, "code")
    assert len(found) > 0
    assert [cell["source"] + "\n" for cell in found] == [text for kind, text in listings if kind == "python"]
    printed = [output["text"] for cell in found for output in cell["outputs"]]
    assert printed == [text for kind, text in listings if kind == "text"]


@pytest.mark.parametrize("page", TUTORIALS, ids=lambda page: page.stem)
def test_a_notebook_has_the_text_of_its_page(page) -> None:
    text = "\n".join(cell["source"] for cell in cells(page, "markdown"))
    there = re.findall(r"^#.*$", LISTING.sub("", page.read_text(encoding="utf-8")), re.MULTILINE)
    assert re.findall(r"^#.*$", LISTING.sub("", text), re.MULTILINE) == there
    assert "```{" not in text


@pytest.mark.parametrize("page", TUTORIALS, ids=lambda page: page.stem)
def test_a_notebook_needs_no_other_file(page) -> None:
    for cell in cells(page, "markdown"):
        targets = re.findall(r"\]\(([^)]*)\)", cell["source"])
        pictures = {one.removeprefix("attachment:") for one in targets if one.startswith("attachment:")}
        assert pictures == set(cell.get("attachments", {}))
        assert all(one.startswith(("attachment:", "https://")) for one in targets)


def test_links_lead_to_the_site_or_are_plain_text(tmp_path) -> None:
    (tmp_path / "howto").mkdir()
    (tmp_path / "howto" / "laws.md").write_text("# Laws\n\n## One, of *many*\n", encoding="utf-8")
    page = tmp_path / "page.md"
    page.write_text(
        "# A page\n\n[](howto/laws.md), [](howto/laws.md#one-of-many), [here](#a-page), [x](https://x.org)\n",
        encoding="utf-8",
    )
    (plain,) = notebooks.notebook(page, tmp_path)["cells"]
    assert plain["source"] == "# A page\n\n“Laws”, “One, of *many*”, here, [x](https://x.org)"
    (linked,) = notebooks.notebook(page, tmp_path, "https://site.org/en/")["cells"]
    assert linked["source"] == (
        "# A page\n\n[Laws](https://site.org/en/howto/laws.html), "
        "[One, of *many*](https://site.org/en/howto/laws.html#one-of-many), "
        "[here](https://site.org/en/page.html#a-page), [x](https://x.org)"
    )


@pytest.mark.parametrize(
    ("name", "builder", "offered"),
    [
        ("tutorials/first_filter", "html", True),
        ("tutorials/index", "html", False),
        ("howto/fit", "html", False),
        ("tutorials/first_filter", "latex", False),  # there is nothing beside its pages
    ],
)
def test_the_link_stands_under_the_title_of_tutorials(name, builder, offered) -> None:
    app = SimpleNamespace(
        builder=SimpleNamespace(name=builder), config=SimpleNamespace(notebook_pages=["tutorials/*"])
    )
    source = ["# Title\n\nText.\n"]
    notebooks.add_button(app, name, source)
    title, *rest = source[0].split("\n")
    assert title == "# Title"
    file = f"{Path(name).name}.ipynb"
    assert (f'href="{file}" download="{file}"' in "".join(rest)) == offered
    assert source[0].endswith("\n\nText.\n")
