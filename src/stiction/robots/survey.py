"""Survey of a robot's XML, before MuJoCo reads it.

A few lines of MJCF can request a billion bodies, a pipe that never begins, or a picture of gigabytes, and MuJoCo cannot
be interrupted. Anything that a tree of rigid bodies with hinges does not need is refused, and included files are
bounded.
"""

from __future__ import annotations

import re
from pathlib import Path
from xml.parsers import expat

from stiction.core.errors import RobotError
from stiction.core.files import read_bounded

MOST_BYTES = 2**24
"""Maximum size of an XML file [B]."""

MOST_FILES = 64
"""Maximum number of files of one robot, without meshes."""

MOST_ELEMENTS = 50_000
"""Maximum number of elements in all files together."""

DEEPEST = 200
"""Maximum depth of nested elements: a chain of links."""

LARGEST_COUNT = 10_000
"""Maximum of a number in `<size>`, which allocates as many objects."""

GENERATORS = {
    **dict.fromkeys(("replicate", "composite", "flexcomp", "flex", "skin"), "write out the bodies that it makes"),
    **dict.fromkeys(("attach", "model"), "put the other model's bodies into this file, or include it"),
    **dict.fromkeys(("plugin", "extension"), "a robot is described without code"),
    "hfield": "take the ground out of the robot's file",
}
"""Element that generates others -> the alternative."""


def survey(path: Path, content: bytes) -> list[tuple[Path, bytes]]:
    """Return the XML of a robot and of its included files; reject invalid XML, and XML that grows while it is read.

    Raises `RobotError`.
    """
    left, seen, elements = [(path, content)], {path.resolve()}, 0
    files = []
    while left:
        file, text = left.pop()
        files.append((file, text))
        count, included = _elements(file, text)
        elements += count
        if elements > MOST_ELEMENTS:
            raise RobotError(f"{path}: more than {MOST_ELEMENTS} elements; a robot has a few hundred")
        for name in included:
            # MuJoCo looks beside the first file; whatever it finds was looked at.
            for place in {path.parent / name, file.parent / name}:
                try:
                    if not place.exists() or place.resolve() in seen:
                        continue
                except OSError as error:
                    raise RobotError(f"{path}: includes {name[:60]!r}: {error.strerror}") from error
                seen.add(place.resolve())
                if len(seen) > MOST_FILES:
                    raise RobotError(f"{path}: includes more than {MOST_FILES} files")
                left.append((place, read_bounded(place, f"XML that {file.name} includes", RobotError, MOST_BYTES)))
    return files


def place_of(path: Path, message: str) -> str:
    """Return `; see robot.xml, line 3: <joint name='hip'>`, the element that an error of MuJoCo means, or its file.

    MuJoCo names an element, or words in it, but neither line nor file of included ones. The text is empty where
    elements of several files are possible.
    """
    match = re.search(r"Element (name )?'([^']*)'.*line (\d+)", message)
    text = message[: match.start()] if match else message
    words, malformed = set(re.findall(r"'([^']+)'", text)), re.search(r"bad format in attribute '([^']+)'", text)
    meant: list[tuple[str, str]] = []
    for file, content in survey(path, read_bounded(path, "a robot's XML", RobotError, MOST_BYTES)):
        for tag, attributes, line in _tags(content):
            if match and int(match[3]):
                fits = file == path and line == int(match[3]) and match[2] in (tag, attributes.get("name", match[2]))
            elif match and match[1] and match[2]:
                fits = attributes.get("name") == match[2]
            elif malformed:
                fits = (not match or match[2] == tag) and _is_no_numbers(attributes.get(malformed[1], "0"))
            else:
                fits = bool(words & {*attributes, *attributes.values()}) and (not match or match[2] in ("", tag))
            if fits:
                name = f" name={attributes['name'][:80]!r}" if "name" in attributes else ""
                meant.append((file.name, f", line {line}: <{tag}{name}>"))
    if len({name for name, _ in meant}) != 1:
        return ""
    return f"; see {meant[0][0]}{meant[0][1] if len(meant) == 1 else ''}"


def _is_no_numbers(text: str) -> bool:
    """Return whether an attribute has a word that is not a number."""
    try:
        return not [float(word) for word in text.split()]
    except ValueError:
        return True


def _tags(content: bytes) -> list[tuple[str, dict[str, str], int]]:
    """Return name, attributes and line of every element of a surveyed file."""
    tags: list[tuple[str, dict[str, str], int]] = []
    parser = expat.ParserCreate()
    parser.StartElementHandler = lambda tag, attributes: tags.append((tag, attributes, parser.CurrentLineNumber))
    parser.Parse(content, True)
    return tags


def _elements(path: Path, content: bytes) -> tuple[int, list[str]]:
    """Return the number of elements of one file, and the names of the files that it includes."""
    if b"<!ENTITY" in content or b"<!DOCTYPE" in content:
        raise RobotError(f"{path}: declares XML entities, which are not read; write them out")
    count, depth, urdf = 0, 0, False
    included: list[str] = []

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal count, depth, urdf
        urdf = tag == "robot" if count == 0 else urdf
        count, depth = count + 1, depth + 1
        if depth > DEEPEST:
            raise RobotError(f"{path}: more than {DEEPEST} elements in one another")
        if tag.startswith("xacro:"):
            raise RobotError(f"{path}: is written in xacro; expand it first: xacro FILE > robot.urdf")
        if tag == "size":
            # MuJoCo reads it in a URDF too, from the element <mujoco>.
            _check_sizes(path, attributes)
        if urdf:
            # Of what else is not URDF, such as a simulator's plugins, MuJoCo reads nothing.
            return
        if tag in GENERATORS:
            raise RobotError(f"{path}: <{tag}> is not supported; {GENERATORS[tag]}")
        if tag == "mesh" and "builtin" in attributes:
            raise RobotError(
                f"{path}: a mesh of the kind {attributes['builtin']!r} is not read; supply the mesh's file"
            )
        if tag == "include" and "file" in attributes:
            included.append(attributes["file"])

    def end(_: str) -> None:
        nonlocal depth
        depth -= 1

    parser = expat.ParserCreate()
    parser.StartElementHandler, parser.EndElementHandler = start, end
    try:
        parser.Parse(content, True)
    except expat.ExpatError as error:
        raise RobotError(f"{path}: is no XML: {error}") from error
    # An encoding that nobody knows is a LookupError, utf-7 and others with several bytes a letter are a ValueError.
    except (LookupError, ValueError) as error:
        raise RobotError(f"{path}: its encoding is not read: {error}; save it as UTF-8") from error
    return count, included


def _check_sizes(path: Path, attributes: dict[str, str]) -> None:
    """Reject sizes that only cost memory."""
    for name, text in attributes.items():
        if name in ("memory", "nstack"):
            continue
        try:
            small = int(text) <= LARGEST_COUNT
        except ValueError:
            small = True
        if not small:
            raise RobotError(f"{path}: <size {name}={text[:40]!r}>; expected at most {LARGEST_COUNT}")
