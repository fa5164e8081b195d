"""Sphinx configuration of the site; `make docs` builds it into build/site."""

import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent))

import gtmodel  # noqa: E402

project = "gtmodel"
author = "The gtmodel authors"
copyright = author
version = release = gtmodel.__version__
language = "en"

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "docs._ext.gtmodel_site",
]
exclude_patterns = ["_ext", "_made", "*.py", "**/*.ipynb", "**/jupyter_execute"]
html_theme = "furo"
html_title = "gtmodel"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_show_sphinx = False
html_last_updated_fmt = None
html_copy_source = False
html_math_renderer = "mathml"  # of gtmodel_site: no script, no network

myst_enable_extensions = ["dollarmath", "deflist", "colon_fence"]
myst_heading_anchors = 3
nb_custom_formats = {".py": ["jupytext.reads", {"fmt": "py:percent"}]}
nb_execution_mode = "cache"
nb_execution_cache_path = str(HERE.parent / "build" / "site" / "notebooks")
nb_execution_timeout = 300
nb_execution_raise_on_error = True
nb_merge_streams = True

autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_member_order = "bysource"
autodoc_preserve_defaults = False  # _ext/gtmodel_site.py does it
default_role = "code"
nitpicky = False
smartquotes = False  # x'' is a second derivative
suppress_warnings = ["myst.header"]
