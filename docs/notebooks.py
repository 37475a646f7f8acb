"""Sphinx extension: the tutorials can be downloaded as notebooks.

A notebook has the listings of its page as cells, with what they print, and the text between them. It needs no
other file: pictures are inside, and links lead to the site, or are plain text where the site has no address.
"""

from __future__ import annotations

import base64
import json
import re
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

LISTING = re.compile(
    r"^```python\n(.*?)^```\n(?:\n```text\n(.*?)^```\n)?", re.MULTILINE | re.DOTALL
)
HEADING = re.compile(r"^#+ (.+)$", re.MULTILINE)
LINK = re.compile(r"(?<!!)\[([^]]*)\]\((?!https?:)([^)#\s]*)(#[^)\s]*)?\)")
PICTURE = re.compile(r"!\[([^]]*)\]\(([^)\s]+)\)")
IMAGE = re.compile(r"^```\{image\} (\S+)\n:alt: (.*)\n(?::.*\n)*```$", re.MULTILINE)
BUTTON = '\n<p class="notebook"><a href="{0}.ipynb" download="{0}.ipynb">Download as notebook</a></p>\n'


def markdown_cell(text: str, page: Path, root: Path, url: str) -> dict[str, Any]:
    """Make a cell of the text between two listings, in the Markdown that Jupyter knows."""

    def link(found: re.Match[str]) -> str:
        words, file, anchor = found[1], found[2], found[3] or ""
        target = (page.parent / file).resolve() if file else page
        if not words:  # the title of what it leads to
            titles = HEADING.findall(target.read_text(encoding="utf-8"))
            slugs = [
                "#" + re.sub(r"[^\w -]", "", title.lower()).replace(" ", "-")
                for title in titles
            ]
            title = titles[slugs.index(anchor) if anchor else 0]
            words = title if url else f"“{title}”"
        where = target.relative_to(root).with_suffix(".html").as_posix()
        return f"[{words}]({url.rstrip('/')}/{where}{anchor})" if url else words

    attachments = {}

    def picture(found: re.Match[str]) -> str:
        file = page.parent / found[2]
        attachments[file.name] = {
            "image/png": base64.b64encode(file.read_bytes()).decode()
        }
        return f"![{found[1]}](attachment:{file.name})"

    text = IMAGE.sub(r"![\2](\1)", text).replace("```{code-block} python", "```python")
    cell = {
        "cell_type": "markdown",
        "metadata": {},
        "source": PICTURE.sub(picture, LINK.sub(link, text)),
    }
    return cell | {"attachments": attachments} if attachments else cell


def notebook(page: Path, root: Path, url: str = "") -> dict[str, Any]:
    """Make the notebook of a page of the site at this address, whose sources are in `root`."""
    page, root = page.resolve(), root.resolve()
    cells: list[dict[str, Any]] = []
    parts = LISTING.split(
        page.read_text(encoding="utf-8")
    )  # text, then a listing, its output and text, ...
    for k in range(0, len(parts), 3):
        if k:
            code, printed = parts[k - 2].rstrip("\n"), parts[k - 1]
            output = (
                [{"output_type": "stream", "name": "stdout", "text": printed}]
                if printed
                else []
            )
            cell = {
                "cell_type": "code",
                "metadata": {},
                "source": code,
                "outputs": output,
            }
            cells.append(cell | {"execution_count": None})
        if text := parts[k].strip("\n"):
            cells.append(markdown_cell(text, page, root, url))
    for k, cell in enumerate(cells):
        cell["id"] = f"cell-{k}"
    kernel = {"name": "python3", "display_name": "Python 3", "language": "python"}
    return {
        "nbformat": 4,
        "nbformat_minor": 5,
        "metadata": {"kernelspec": kernel},
        "cells": cells,
    }


def offered(app: Any, name: str) -> bool:
    """Say whether a document has a notebook: it is among `notebook_pages`, and no table of contents."""
    listed = any(fnmatch(name, one) for one in app.config.notebook_pages)
    return listed and Path(name).name != "index" and app.builder.name == "html"


def add_button(app: Any, name: str, source: list[str]) -> None:
    """Put the link under the title of a page."""
    if offered(app, name):
        source[0] = source[0].replace("\n", "\n" + BUTTON.format(Path(name).name), 1)


def write_notebooks(app: Any, exception: Exception | None) -> None:
    """Write the notebooks beside the pages."""
    for name in sorted(app.env.found_docs) if exception is None else ():
        if offered(app, name):
            made = notebook(
                app.srcdir / f"{name}.md", app.srcdir, app.config.html_baseurl
            )
            (app.outdir / f"{name}.ipynb").write_text(
                json.dumps(made, indent=1) + "\n", encoding="utf-8"
            )


def setup(app: Any) -> dict[str, Any]:
    """Connect to the build."""
    app.add_config_value("notebook_pages", [], "env")
    app.connect("source-read", add_button)
    app.connect("build-finished", write_notebooks)
    return {"parallel_read_safe": True}
