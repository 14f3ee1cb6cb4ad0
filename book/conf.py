"""Settings of Sphinx for the book; `book/build.py` lays out its sources."""

from __future__ import annotations

from lanes import __version__

project = "Advanced Lane Finding"
release = __version__
author = "the project's contributors"
copyright = "the project's contributors, MIT licence"
language = "en"

extensions = [
    "myst_nb",
    "numpydoc",
    "sphinx.ext.autodoc",
    "sphinx.ext.mathjax",
    "sphinx.ext.viewcode",
    "sphinx_copybutton",
]
source_suffix = {".md": "myst-nb", ".ipynb": "myst-nb", ".rst": "restructuredtext"}
default_role = "obj"

# The course is shown as committed; `make run` executes it.
nb_execution_mode = "off"
myst_enable_extensions = ["amsmath", "colon_fence", "dollarmath"]
myst_heading_anchors = 3

# names that a package imports from its modules are documented there
autodoc_default_options = {
    "members": True,
    "member-order": "bysource",
    "ignore-module-all": True,
}
autodoc_typehints = "none"
add_module_names = False
numpydoc_show_class_members = False

# A copy of MathJax, so that the book needs no network. Its SVG output needs no fonts.
mathjax_path = "tex-svg.js"

html_theme = "pydata_sphinx_theme"
html_title = project
html_static_path = ["_build/static"]
html_extra_path = ["_build/extra"]
# follows the colour scheme of the system
html_context = {"default_mode": "auto"}
html_css_files = ["book.css"]
html_show_sourcelink = False
html_theme_options = {
    "logo": {"text": project},
    "navbar_align": "left",
    "footer_start": ["copyright"],
    "footer_end": ["sphinx-version"],
    "show_toc_level": 2,
}
copybutton_exclude = ".linenos, .gp"
