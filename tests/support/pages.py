"""A report read as a browser reads it: its texts, pictures and panels, and what is wrong with it."""

from __future__ import annotations

import json
import re
from collections import Counter
from dataclasses import dataclass
from html.parser import HTMLParser
from typing import Any
from xml.etree import ElementTree

LARGEST = 2_000_000  # bytes
SVG = "{http://www.w3.org/2000/svg}"


@dataclass(frozen=True)
class Drawn:
    """A picture of a page: its SVG element and its panels."""

    svg: ElementTree.Element
    panels: list[dict[str, Any]]


def drawn_in(page: str) -> list[Drawn]:
    """All pictures of a page; fails if an SVG is not well formed."""
    figures = re.findall(r"<figure>(<svg.*?</svg>).*?<script type=\"application/json\">(.*?)</script>", page, re.DOTALL)
    return [Drawn(ElementTree.fromstring(svg), json.loads(data)) for svg, data in figures]


class _Read(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.texts: list[tuple[str, str]] = []
        self.ids: Counter[str] = Counter()
        self.asked: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.open.append(tag)
        for name, value in attrs:
            if name == "id":
                self.ids[value or ""] += 1
            if name.endswith(("href", "src")) and not (value or "").startswith(("#", "data:")):
                self.asked.append(value or "")

    def handle_endtag(self, tag: str) -> None:
        while self.open and self.open.pop() != tag:
            pass

    def handle_data(self, data: str) -> None:
        if data.strip():
            self.texts.append((self.open[-1] if self.open else "", data.strip()))


def read(page: str) -> _Read:
    reader = _Read()
    reader.feed(page)
    return reader


def faults_of(page: str) -> list[str]:
    """What a reader of the page would miss or be disturbed by."""
    seen = read(page)
    faults = [f"{name} is asked of a network" for name in seen.asked]
    faults += [f"the id {name} stands {n} times" for name, n in seen.ids.items() if n > 1]
    cells = [text for tag, text in seen.texts if tag == "td"]
    faults += [f"a cell holds {text}" for text in cells if {"nan", "None", "inf", "-inf"} & set(text.split(", "))]
    faults += ["the page is too large"] if len(page.encode()) > LARGEST else []
    for k, drawn in enumerate(drawn_in(page)):
        if not [*drawn.svg.iter(f"{SVG}path"), *drawn.svg.iter(f"{SVG}image")]:
            faults.append(f"picture {k} draws nothing")
    return faults
