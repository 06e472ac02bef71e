"""The nodes of a Webots PROTO or world, by where they stand: enough to change a field and leave the rest as it is.

Not a parser of the language: braces make nodes, the word before a brace is a node's type, and text within quotes,
comments and templates (`%< ... >%`) is passed over.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field

from stiction.formats.errors import StictionError

_TOKEN = re.compile(rb'#[^\n]*|"(?:\\.|[^"\\])*"|%<|[{}\[\]]|"|[^\s,{}\[\]"#%]+|%', re.DOTALL)


@dataclass
class Node:
    """A node: `HingeJointParameters { ... }`."""

    kind: str
    """Its type."""
    start: int
    """Offset after its `{` [bytes]."""
    parent: int | None
    """Index of the node that it is in."""
    words: list[tuple[str, int, int]] = field(default_factory=list)
    """Its own words and quoted strings, those of nodes within it apart: text, start and end [bytes]."""

    def value(self, name: str) -> tuple[str, int, int] | None:
        """Return the word after the field `name`; None where the node has no such field."""
        texts = [text for text, _, _ in self.words]
        at = texts.index(name) + 1 if name in texts else len(texts)
        return self.words[at] if at < len(texts) else None


def parse_nodes(data: bytes, where: str) -> list[Node]:
    """Return every node, in the order of their braces; `where` is named in messages.

    Raises `StictionError` for what is not UTF-8, and for quotes, braces or templates that do not close.
    """
    try:
        data.decode("utf-8")
    except UnicodeDecodeError as error:
        raise StictionError(f"{where}: not UTF-8 ({error.reason}); expected a PROTO or a world") from error
    nodes: list[Node] = []
    inside: list[int] = []
    word, at = "", 0
    while (found := _TOKEN.search(data, at)) is not None:
        at, token = found.end(), found[0]
        if token == b"%<":
            at = data.find(b">%", at) + 2
            if at == 1:
                raise StictionError(f"{where}: a template %< does not close; expected a PROTO or a world")
        elif token == b"{":
            nodes.append(Node(word, at, inside[-1] if inside else None))
            inside.append(len(nodes) - 1)
        elif token == b"}":
            if not inside:
                raise StictionError(f"{where}: a brace closes that never opened; expected a PROTO or a world")
            inside.pop()
        elif token == b'"':
            raise StictionError(f"{where}: a quote does not close; expected a PROTO or a world")
        elif token not in (b"[", b"]", b"%") and not token.startswith(b"#"):
            word = token.decode("utf-8")
            if inside:
                nodes[inside[-1]].words.append((word, found.start(), found.end()))
    if inside:
        raise StictionError(f"{where}: a brace does not close; expected a PROTO or a world")
    return nodes
