"""Links of pages lead to files of the clone, where a forge follows them; on the site they lead to its pages.

../../notebooks/NAME.ipynb            a notebook
../../gtmodel/LIBRARY/__init__.py     the reference of a library; ../../gtmodel the list of them
../../problems/models/NAME.py         the file itself, which Sphinx would take for a page
"""

from __future__ import annotations

import re


def up(page: str) -> str:
    """The way from a page, "kinds/compliance", to the folder of the clone."""
    return "../" * (page.count("/") + 1)


def on_the_site(page: str, text: str) -> str:
    """A page with its links to notebooks, packages and modules leading to what the site makes of them.

    page: its name without the ending, "kinds/compliance"
    """
    clone = up(page)
    pages = clone.removeprefix("../")  # they stand in docs, one folder below the clone

    def reference(link: re.Match[str]) -> str:
        library = link[1].removesuffix("/__init__").replace("/", ".")
        return f"]({pages}reference/{library})"

    text = text.replace(f"]({clone}gtmodel)", f"]({pages}reference/index)")
    text = re.sub(rf"\]\({re.escape(clone)}notebooks/(\w+)\.ipynb\)", rf"]({pages}notebooks/\1)", text)
    text = re.sub(rf"\[([^\]]+)\]\(({re.escape(clone)}problems/[\w/]+\.py)\)", r"{download}`\1 <\2>`", text)
    return re.sub(rf"\]\({re.escape(clone)}(gtmodel/[\w/]+)\.py\)", reference, text)
