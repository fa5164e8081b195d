"""Files of a study that are made when they are written: a report costs as much as its pictures."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any


class MadeFiles(Mapping[str, str]):
    """Contents by file name, each from a function that is called when it is asked for."""

    def __init__(self, makers: Mapping[str, Callable[[], str]]) -> None:
        self.makers = dict(makers)

    def __getitem__(self, name: str) -> str:
        return self.makers[name]()

    def __iter__(self) -> Iterator[str]:
        return iter(self.makers)

    def __len__(self) -> int:
        return len(self.makers)

    def with_(self, name: str, maker: Callable[[], str], *, behind: str) -> MadeFiles:
        """The same with one file more, behind another one."""
        place = list(self.makers).index(behind) + 1
        pairs = list(self.makers.items())
        return MadeFiles(dict([*pairs[:place], (name, maker), *pairs[place:]]))


def made(files: Mapping[str, Any]) -> MadeFiles:
    """Any files as such: those that are there are given when they are asked for."""
    if isinstance(files, MadeFiles):
        return files
    return MadeFiles({name: partial(str, content) for name, content in files.items()})
