"""Configuration of the Sphinx site; nothing in it needs the network."""

from __future__ import annotations

import os
import re
import sys
from pathlib import Path

from docutils import nodes
from sphinx.ext.autosummary import AutoLink, Autosummary, import_by_name

import fuzzykf

sys.path.append(str(Path(__file__).parent))  # of notebooks.py

project = "fuzzykf"
author = "The fuzzykf developers"
copyright = f"2026, {author}"
version = release = fuzzykf.__version__

extensions = [
    "myst_parser",
    "numpydoc",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.mathjax",
    "sphinx-mathjax-offline",  # equations are drawn without the network
    "sphinx_copybutton",
    "sphinx_gallery.gen_gallery",
    "notebooks",
]
notebook_pages = ["tutorials/*"]
exclude_patterns = [
    "_build",
    "gallery/*.ipynb",
    "gallery/*.py",
    "gallery/*.json",
    "gallery/*.zip",
    "paper/*",
]
templates_path = ["_templates"]
default_role = "autolink"  # `OFSRFilter` in a docstring is a link where there is something to link to

myst_enable_extensions = ["amsmath", "colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3

autosummary_generate = True
autosummary_context = {"aliases": {}}  # second names of classes: see `second_names`
autodoc_preserve_defaults = True  # np.float64 and functions by their names
autodoc_typehints = (
    "none"  # numpydoc's Parameters say it in words, with shapes and units
)
numpydoc_show_class_members = False  # the template of a class lists them
numpydoc_xref_param_type = False

sphinx_gallery_conf = {
    "examples_dirs": "../examples",
    "gallery_dirs": "gallery",
    # the data of one example are not part of the package: without them it is shown, but not run
    "filename_pattern": r"plot_"
    if "FUZZYKF_DATA" in os.environ
    else r"plot_(?!traffic)",
    "remove_config_comments": True,
    "show_memory": False,
    "write_computation_times": False,  # pages of no use to readers, with scripts from the network
    "abort_on_example_error": True,
}

html_theme = "furo"
html_baseurl = os.environ.get(
    "READTHEDOCS_CANONICAL_URL", ""
)  # where links of notebooks lead
html_title = f"fuzzykf {release}"
html_static_path = ["_static"]
html_css_files = ["wrap.css"]
copybutton_prompt_text = r">>> |\.\.\. |\$ "
copybutton_prompt_is_regexp = True
copybutton_line_continuation_character = "\\"


def escape_bars(app, what, name, obj, options, lines):
    """Keep |x| in docstrings an absolute value: the project has no substitutions to mistake it for."""
    for k, line in enumerate(lines):
        if not line.lstrip().startswith((">>>", "...")):
            parts = line.split("``")  # every second part is literal
            parts[::2] = [
                re.sub(r"\|([^|`]+)\|", r"\\|\1\\|", part) for part in parts[::2]
            ]
            lines[k] = "``".join(parts)


def public_homes():
    """Return where each public name is documented, by the name: that is where links lead."""
    homes, module = {}, ""
    for line in (
        (Path(__file__).parent / "reference/index.md").read_text("utf-8").splitlines()
    ):
        if line.startswith(".. currentmodule::"):
            module = line.split()[-1]
        elif re.fullmatch(r" {3}[A-Za-z]\w*", line):
            homes.setdefault(line.strip(), module)
    return homes


def second_names():
    """Return the public names of classes that have another one, by the name."""
    found = {}
    for name, module in public_homes().items():
        value = import_by_name(f"{module}.{name}")[1]
        if isinstance(value, type) and value.__name__ != name:
            found[name] = value.__name__
    return found


class Link(AutoLink):
    """`KalmanFilter.fit` links to its page from any module; what is not documented is set as code."""

    homes = public_homes()

    def run(self):
        head, _, member = self.text.partition(".")
        known = head in self.homes and (member or head[0].isupper())
        if known and not self.text.endswith(")"):
            shown = self.text
            self.text = f"{shown} <{self.homes[head]}.{shown}>"
            self.rawtext = f"`{self.text}`"
        objects, errors = super().run()
        return [
            nodes.literal(one.rawsource, one.astext())
            if isinstance(one, nodes.emphasis)
            else one
            for one in objects
        ], errors


def skip_tuple_fields(app, what, name, obj, skip, options):
    """Leave out what every named tuple has: the attributes are in the docstring of the class."""
    is_field = type(obj).__name__ == "_tuplegetter"
    is_of_tuple = getattr(obj, "__objclass__", None) is tuple
    return True if is_field or is_of_tuple else None


class Summary(Autosummary):
    """A table of the reference in which a second name of a class says so, instead of nothing."""

    def get_items(self, names):
        items = super().get_items(names)
        return [
            (
                name,
                signature,
                text or f"Another name of `{import_by_name(full)[1].__name__}`.",
                full,
            )
            for name, signature, text, full in items
        ]


def setup(app):
    """Connect after numpydoc, which has the default priority of 500."""
    app.config.autosummary_context["aliases"].update(second_names())
    app.add_directive("autosummary", Summary, override=True)
    app.add_role("autolink", Link(), override=True)
    app.connect("autodoc-skip-member", skip_tuple_fields)
    app.connect("autodoc-process-docstring", escape_bars, priority=600)
