"""Sphinx's settings for the site; `README.md` beside this file has the conventions for pages."""

from __future__ import annotations

import sys
from importlib.util import find_spec
from pathlib import Path

from numpydoc.xref import DEFAULT_LINKS
from sphinx.application import Sphinx

sys.path.insert(0, str(Path(__file__).parent))

project = "vemcvx"
project_copyright = "2026, the vemcvx authors, BSD 3-Clause License"
extensions = ["myst_nb", "numpydoc", "sphinx_copybutton", "sphinx_design"]
extensions += ["sphinx.ext.autodoc", "sphinx.ext.autosummary", "sphinx.ext.mathjax"]
exclude_patterns = ["README.md", "CONTRIBUTING.md", "CHANGELOG.md", "generator", "problems"]
nitpicky = True

html_theme = "furo"
html_title = "vemcvx"
html_static_path = ["_static"]
html_favicon = "_static/icon.svg"
html_css_files = ["site.css"]
html_js_files = ["formulas.js"]
html_copy_source = False
html_show_sphinx = False
mathjax_path = "mathjax/tex-svg-full.js"

myst_enable_extensions = ["amsmath", "attrs_block", "attrs_inline", "colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3
nb_execution_mode = "cache"
nb_execution_raise_on_error = True
nb_merge_streams = True
nb_output_stderr = "remove"  # removes, for example, the notice of `vemcvx.simulate` about few steps

autodoc_typehints = "none"
autodoc_inherit_docstrings = False  # the entry of a base class describes its methods
autodoc_member_order = "bysource"
autodoc_mock_imports = [] if find_spec("pytest") else ["pytest"]  # `vemcvx.testing` imports pytest
autosummary_generate = False
toc_object_entries_show_parents = "hide"
copybutton_prompt_text = r">>> |\.\.\. |\$ "
copybutton_prompt_is_regexp = True
numpydoc_show_class_members = False
numpydoc_use_plots = False
numpydoc_xref_param_type = True
numpydoc_xref_ignore = "all"


def setup(app: Sphinx) -> None:
    """Translate docstrings before numpydoc reads their sections."""
    from generator import docstrings, reference

    app.config.numpydoc_xref_aliases = {name: name for name in DEFAULT_LINKS} | reference.SHORT
    app.add_directive("entries", docstrings.Entries)
    app.connect("autodoc-process-docstring", docstrings.prepare, priority=400)
    app.connect("autodoc-process-bases", docstrings.keep_public_bases)
    app.connect("doctree-read", docstrings.describe_pictures)
