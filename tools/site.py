"""Hook of MkDocs that describes this repository: `make docs`.

The site has the documents where they are in the repository, so that a link leads to the same place there and here:
what mkdocs.yml names, every page of docs/, and every file that one of them links to, whatever it is. docs/index.md is
the front page of the site, README that of the repository. A link to a folder becomes text. The footer names the
version; search leaves out the pages of `extra.unsearched`. Formulas are drawn as SVG when the site is built, so that no
page loads a program to show them.
"""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]

LINK = re.compile(r"(!?)\[((?:[^\[\]]|\[[^\]]*\])*)\]\(([^)\s#]*)(#[^)\s]*)?\)")
"""A link or image of Markdown: `!`, text, file, anchor."""

FENCES = re.compile(r"^(```|~~~).*?^\1", re.MULTILINE | re.DOTALL)
"""A fenced block, in which nothing is a link."""

MATH = re.compile(r"^```math\n(.*?)\n```$", re.MULTILINE | re.DOTALL)
"""A formula, in the form that GitHub shows too."""

LARGEST = 8_000_000
"""Bytes of a file that comes along because a page links to it."""

PLACES = {"docs/index.md": "index.html", "README.md": "readme/index.html"}
"""Page -> its place in the site, where that is not its place in the repository."""


def linked_files(page: Path) -> list[Path]:
    """Return the files of the repository to which a page links; those that are missing are left for MkDocs to tell."""
    text = FENCES.sub("", page.read_text(encoding="utf-8"))
    targets = [page.parent / file for _, _, file, _ in LINK.findall(text) if file and "://" not in file]
    files = [target.resolve() for target in targets if target.is_file()]
    return [file for file in files if file.is_relative_to(ROOT) and file.stat().st_size <= LARGEST]


def site_files(start: list[Path]) -> list[Path]:
    """Return the pages of a site and what they link to, in the order of discovery."""
    files: dict[Path, None] = dict.fromkeys(start)
    for page in (waiting := list(start)):
        if page.suffix == ".md":
            new = [file for file in linked_files(page) if file not in files]
            files |= dict.fromkeys(new)
            waiting += [file for file in new if file not in waiting]
    return list(files)


def formula(source: str) -> str:
    """Return a formula of mathtext, the part of TeX that matplotlib knows, as SVG in the colour of the text."""
    from matplotlib.path import Path as Outline
    from matplotlib.textpath import TextPath

    outline = TextPath((0, 0), f"${source.strip()}$", size=17)
    letters = {Outline.MOVETO: "M", Outline.LINETO: "L", Outline.CURVE3: "Q", Outline.CURVE4: "C"}
    drawn = []
    for points, code in outline.iter_segments(simplify=False, curves=True):
        if code == Outline.CLOSEPOLY:
            drawn.append("Z")
        else:
            numbers = [f"{-x if k % 2 else x:.2f}" for k, x in enumerate(points)]
            drawn.append(letters[code] + " ".join(numbers))
    box = outline.get_extents()
    left, top, width, height = box.x0 - 1, -box.y1 - 1, box.width + 2, box.height + 2
    label = source.strip().replace("&", "&amp;").replace('"', "&quot;").replace("<", "&lt;")
    sized = f'viewBox="{left:.2f} {top:.2f} {width:.2f} {height:.2f}" style="width:{width / 16:.2f}em"'
    path = f'<path d="{"".join(drawn)}"/>'
    return f'<p class="formula"><svg role="img" aria-label="{label}" {sized} fill="currentColor">{path}</svg></p>'


def on_config(config: Any) -> Any:
    """Name the version in the footer, and put pages of docs/ that the navigation lacks at its end."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    config.copyright = f"stiction {project['version']}, {project['license']}"
    named = set(re.findall(r"[\w./-]+\.md", str(config.nav)))
    others = [page for page in sorted(ROOT.glob("docs/*.md")) if page.relative_to(ROOT).as_posix() not in named]
    if others:
        config.nav.append({"More": [page.relative_to(ROOT).as_posix() for page in others]})
    return config


def on_files(files: Any, config: Any) -> Any:
    """Replace the pages of `docs_dir` by those of the repository, under the paths that they have there."""
    from mkdocs.structure.files import File

    for file in [one for one in files if one.src_dir == config.docs_dir]:
        files.remove(file)
    named = [ROOT / name for name in re.findall(r"[\w./-]+\.md", str(config.nav))]
    start = [*(page for page in named if page.is_file()), *sorted(ROOT.glob("docs/*.css"))]
    for path in site_files(list(dict.fromkeys(start))):
        file = File.generated(config, path.relative_to(ROOT).as_posix(), abs_src_path=str(path))
        file.dest_uri = PLACES.get(file.src_uri, file.dest_uri)
        files.append(file)
    return files


def on_page_markdown(markdown: str, page: Any, config: Any, files: Any) -> str:
    """Draw formulas; make text of badges, and of links to folders and to files that are too large for the site."""
    here = Path(page.file.abs_src_path).parent
    if page.file.src_uri in config.extra["unsearched"]:
        page.meta["search"] = {"exclude": True}

    def kept(link: re.Match[str]) -> str:
        if link[1] and "://" in link[3]:
            return link[2]
        target = here / link[3]
        away = target.is_dir() or (target.is_file() and target.stat().st_size > LARGEST)
        return link[2] if link[3] and "://" not in link[3] and away else link[0]

    drawn = MATH.sub(lambda block: formula(block[1]), markdown)
    parts, last = [], 0
    for block in FENCES.finditer(drawn):
        parts += [LINK.sub(kept, drawn[last : block.start()]), block[0]]
        last = block.end()
    return "".join([*parts, LINK.sub(kept, drawn[last:])])


def on_post_page(output: str, page: Any, config: Any) -> str:
    """Keep the theme from asking the repository's host for stars and releases: a page loads nothing from the net."""
    return output.replace(' data-md-component="source"', "")
