"""XML as plain elements that know their line; entities and other things that no robot needs are refused."""

from __future__ import annotations

from dataclasses import dataclass, field
from xml.parsers import expat

DEEPEST = 50  # elements inside one another; those of a robot go seven deep


class XmlFault(ValueError):
    """What is wrong with a file, and in which line."""

    def __init__(self, sentence: str, line: int) -> None:
        super().__init__(sentence)
        self.sentence, self.line = sentence, line


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
    parser = expat.ParserCreate()
    outside = XmlElement("", {}, 1)
    stack = [outside]

    def begin(tag: str, attributes: dict[str, str]) -> None:
        if len(stack) > DEEPEST:
            raise XmlFault(f"holds elements inside one another, more than {DEEPEST} deep", parser.CurrentLineNumber)
        element = XmlElement(tag, attributes, parser.CurrentLineNumber)
        stack[-1].inside.append(element)
        stack.append(element)

    def end(_: str) -> None:
        stack.pop()

    def entity(*_: object) -> None:
        raise XmlFault("declares an entity, which no robot needs and gtmodel does not read", parser.CurrentLineNumber)

    parser.StartElementHandler, parser.EndElementHandler, parser.EntityDeclHandler = begin, end, entity
    try:
        parser.Parse(content, True)
    except expat.ExpatError as error:
        raise XmlFault(f"is no XML: {expat.ErrorString(error.code)}", error.lineno) from None
    return outside.inside[0]
