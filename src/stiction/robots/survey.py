"""What a robot's XML would make MuJoCo read and build, looked at before MuJoCo sees it.

A few lines of MJCF can ask for a billion bodies, a pipe that never begins, or a picture of gigabytes, and nothing ends
MuJoCo once it has begun. What a tree of rigid bodies with hinges does not need is refused, what it includes is bounded.
"""

from __future__ import annotations

import re
from pathlib import Path
from xml.parsers import expat

from stiction.core.errors import RobotError
from stiction.core.files import read_bounded

MOST_BYTES = 2**24
"""Size of the largest XML that is read."""

MOST_FILES = 64
"""Files of one robot, meshes apart."""

MOST_ELEMENTS = 50_000
"""Elements of all files together."""

DEEPEST = 200
"""Elements in one another: a chain of links."""

LARGEST_COUNT = 10_000
"""Of a number in `<size>`, which allocates so many for each thing."""

MAKERS = {
    **dict.fromkeys(("replicate", "composite", "flexcomp", "flex", "skin"), "write out the bodies that it makes"),
    **dict.fromkeys(("attach", "model"), "put the other model's bodies into this file, or include it"),
    **dict.fromkeys(("plugin", "extension"), "a robot is described without code"),
    "hfield": "take the ground out of the robot's file",
}
"""Element that makes more than it says -> what to do instead."""


def survey(path: Path, content: bytes) -> list[tuple[Path, bytes]]:
    """Return the XML of a robot with what it includes; refuse what is none or could grow while it is read.

    Raises `RobotError`.
    """
    left, seen, elements = [(path, content)], {path.resolve()}, 0
    files = []
    while left:
        file, text = left.pop()
        files.append((file, text))
        found, included = _elements(file, text)
        elements += found
        if elements > MOST_ELEMENTS:
            raise RobotError(f"{path}: more than {MOST_ELEMENTS} elements; a robot has some hundred")
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

    MuJoCo names an element, or words in it; of what is included it says neither line nor file. Nothing is returned
    where elements of several files may be meant.
    """
    said = re.search(r"Element (name )?'([^']*)'.*line (\d+)", message)
    text = message[: said.start()] if said else message
    words, malformed = set(re.findall(r"'([^']+)'", text)), re.search(r"bad format in attribute '([^']+)'", text)
    meant: list[tuple[str, str]] = []
    for file, content in survey(path, read_bounded(path, "a robot's XML", RobotError, MOST_BYTES)):
        for tag, attributes, line in _tags(content):
            if said and int(said[3]):
                fits = file == path and line == int(said[3]) and said[2] in (tag, attributes.get("name", said[2]))
            elif said and said[1] and said[2]:
                fits = attributes.get("name") == said[2]
            elif malformed:
                fits = (not said or said[2] == tag) and _is_no_numbers(attributes.get(malformed[1], "0"))
            else:
                fits = bool(words & {*attributes, *attributes.values()}) and (not said or said[2] in ("", tag))
            if fits:
                name = f" name={attributes['name'][:80]!r}" if "name" in attributes else ""
                meant.append((file.name, f", line {line}: <{tag}{name}>"))
    if len({name for name, _ in meant}) != 1:
        return ""
    return f"; see {meant[0][0]}{meant[0][1] if len(meant) == 1 else ''}"


def _is_no_numbers(text: str) -> bool:
    """Return whether an attribute has a word that is no number."""
    try:
        return not [float(word) for word in text.split()]
    except ValueError:
        return True


def _tags(content: bytes) -> list[tuple[str, dict[str, str], int]]:
    """Return name, attributes and line of every element of a file that was surveyed."""
    found: list[tuple[str, dict[str, str], int]] = []
    parser = expat.ParserCreate()
    parser.StartElementHandler = lambda tag, attributes: found.append((tag, attributes, parser.CurrentLineNumber))
    parser.Parse(content, True)
    return found


def _elements(path: Path, content: bytes) -> tuple[int, list[str]]:
    """Return how many elements one file has, and the names that it includes."""
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
        if tag in MAKERS:
            raise RobotError(f"{path}: <{tag}> is not read; {MAKERS[tag]}")
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
    """Refuse sizes that only memory is needed for."""
    for name, text in attributes.items():
        if name in ("memory", "nstack"):
            continue
        try:
            small = int(text) <= LARGEST_COUNT
        except ValueError:
            small = True
        if not small:
            raise RobotError(f"{path}: <size {name}={text[:40]!r}>; expected at most {LARGEST_COUNT}")
