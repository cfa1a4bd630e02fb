r"""Sphinx's settings for the site: `python docs/build.py DIR` builds it.

Conventions for pages
---------------------
Sources are MyST Markdown in this folder: `index.md`, `learn/`, `howto/`, `theory/`, and pages beside them. The builder
copies them beside what it writes from lessons, problem files and docstrings: `learn/index`, `learn/lesson_*`,
`gallery/` and `reference/` are in no folder of the repository. A page that is added is named in the toctree of
its `index.md`.

- One `#` heading a page, then `##`, then `###`; none is skipped.
- Formulas: `$u$` within a line, `$$ ... $$ (label)` on lines of their own, referred to by `` {eq}`label` ``.
- References: `` {py:class}`vemcvx.Elasticity` ``, `` {py:func}`vemcvx.simulate` ``,
  `` {py:meth}`vemcvx.History.write` ``, `` {py:attr}`...` ``; in short `` {py:func}`~vemcvx.simulate` ``. Modules are
  `vemcvx.meshes`, `vemcvx.plots`, `vemcvx.estimate.measures` (not `vemcvx.measures`). A name that does
  not exist fails the build.
- Pages: `[words](../howto/resume.md)`, lessons `../learn/lesson_3.ipynb` (and `lesson_3_solutions.ipynb`), problem
  files `../gallery/hertz_contact.md`; headings by `[words](page.md#the-heading-as-an-anchor)`.
- Files of the repository by their path alone: `` `vemcvx/program/certificate.py` ``.
- Pictures: `![what one sees](/pictures/feng_han_huang.png)`, from `problems/pictures`. Words are required.
- Live pages: `<iframe class="live" loading="lazy" title="..." src="_static/live/feng_han_huang.html"></iframe>`, or
  `frictional_hysteresis.html`, from the folder of the page.
- Python that is run: blocks `` ```{code-cell} `` in a page that begins with
  ``---\nfile_format: mystnb\nkernelspec:\n  name: python3\n---``; `:tags: [hide-input]` folds what only draws. Cells
  run in an empty folder of their own. An error fails the build. A figure of ours says in words what it shows, which
  is its text for those who cannot see it; let it be the last line of a cell.
- Commands that are run: blocks `` ```console `` whose lines begin with `$ `; `tests/whole/test_site.py` runs them, page
  by page, in a folder with `problems` and the files of the page (`` ```{code-block} python ``, `:caption: name.py`).
- Text that stands elsewhere is included, not repeated: `` ```{include} /CHANGELOG.md `` (README.md, CONTRIBUTING.md,
  LICENSE, CITATION.cff are there); `:start-after: <!-- measured: begin -->` and `:end-before:` take a part.
- Cards, grids, tabs: sphinx-design, `::::{grid} 1 1 3 3`. Answers that unfold: `:::{dropdown} Answer`.
"""

from __future__ import annotations

import sys
from pathlib import Path

from sphinx.application import Sphinx

sys.path.insert(0, str(Path(__file__).parent))

project = "vemcvx"
author = "The vemcvx authors"
extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "numpydoc",
    "sphinx.ext.mathjax",
    "sphinx_design",
    "sphinx_copybutton",
]
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
nb_execution_raise_on_error = True
nb_execution_timeout = 300
nb_merge_streams = True
nb_execution_in_temp = True
nb_output_stderr = "remove"  # notices of the log, such as that of `vemcvx.simulate` about few steps

autodoc_typehints = "none"
autodoc_inherit_docstrings = False  # what a base class says of a method stands there, once
autodoc_member_order = "bysource"
numpydoc_show_class_members = False
numpydoc_use_plots = False


def setup(app: Sphinx) -> None:
    """Docstrings are read as they are meant, before numpydoc reads their sections."""
    from generator import docstrings

    app.connect("autodoc-process-docstring", docstrings.prepared, priority=400)
    app.connect("autodoc-process-bases", docstrings.public_bases)
    app.connect("doctree-read", docstrings.pictures_in_words)
