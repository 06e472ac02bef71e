"""Sentences of a Markdown page as a reader meets them, for the rule on their length."""

from __future__ import annotations

import re

FENCES = re.compile(r"^ *(```|~~~).*?^ *\1 *$", re.MULTILINE | re.DOTALL)
HIDDEN = re.compile(r"<!--.*?-->|<[^>]+>|^---\n.*?^---$", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"!?\[((?:[^\[\]]|\[[^\]]*\])*)\]\([^)]*\)")
BEGIN = re.compile(r"^(#+ |\s*[-*] |\s*\d+\. |\s*> )")
"""Begin of a block on a line: a heading, an item, a quotation."""
END = re.compile(r"(?<=[.!?])[*_)\"”]*\s+(?=[*_\[(\"“]*[A-Z0-9])")


def blocks(text: str) -> list[str]:
    """Return paragraphs, items, headings and cells of tables, each on one line, without code blocks."""
    text = HIDDEN.sub("", FENCES.sub("\n\n", text))
    made: list[str] = [""]
    for line in text.splitlines():
        if line.lstrip().startswith("|"):
            made += [cell.replace("\0", "|") for cell in line.replace("\\|", "\0").strip().strip("|").split("|")] + [""]
        elif not line.strip():
            made.append("")
        elif BEGIN.match(line):
            made.append(BEGIN.sub("", line))
        else:
            made[-1] += " " + line.strip()
    return [block.strip() for block in made if re.search(r"\w", block)]


def sentences(text: str) -> list[str]:
    """Return the sentences of a page: links as their text, code as one word."""
    plain = [LINK.sub(r"\1", re.sub(r"`[^`]*`", "Code", block)) for block in blocks(text)]
    return [sentence for block in plain for sentence in END.split(block)]


def long_sentences(text: str, most: int) -> list[str]:
    """Return the sentences of more than `most` words; a word has a letter or a digit."""
    return [line for line in sentences(text) if sum(bool(re.search(r"\w", word)) for word in line.split()) > most]
