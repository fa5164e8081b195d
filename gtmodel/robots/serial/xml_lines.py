"""XML as plain elements that know their line; entities and other things that no robot needs are refused."""

from __future__ import annotations

from dataclasses import dataclass, field

from ...results.read_bounds import XmlFault, walk_xml


@dataclass
class XmlElement:
    """A tag with its attributes, what stands inside and the line where it begins."""

    tag: str
    attributes: dict[str, str]
    line: int
    inside: list[XmlElement] = field(default_factory=list)

    def all(self, tag: str) -> list[XmlElement]:
        """Elements of that tag directly inside."""
        return [e for e in self.inside if e.tag == tag]

    def one(self, tag: str) -> XmlElement | None:
        """The element of that tag, or None. Raises XmlFault where there are several."""
        several = self.all(tag)
        if len(several) > 1:
            raise XmlFault(f"<{self.tag}> holds {len(several)} <{tag}>; expected one", several[1].line)
        return several[0] if several else None


def parsed(content: bytes) -> XmlElement:
    """The outermost element. Raises XmlFault for what is no XML, and for declared entities."""
    outside = XmlElement("", {}, 1)
    stack = [outside]

    def begin(tag: str, attributes: dict[str, str], line: int) -> None:
        element = XmlElement(tag, attributes, line)
        stack[-1].inside.append(element)
        stack.append(element)

    def end() -> None:
        stack.pop()

    walk_xml(content, begin, end)
    return outside.inside[0]
