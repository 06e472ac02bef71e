"""What the documents promise: verbs that exist, links that lead somewhere, versions that agree, a lock that fits."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from stiction.cli.main import VERBS

CHECKOUT = Path(__file__).parents[2]
PROJECT = tomllib.loads((CHECKOUT / "pyproject.toml").read_text())["project"]
DOCUMENTS = sorted([*CHECKOUT.glob("*.md"), *CHECKOUT.glob("docs/*.md")])


def locked(file: str = "requirements.lock") -> dict[str, Requirement]:
    """Return name -> requirement of a lock file: each name==version, a marker perhaps, hashes on further lines."""
    entries = (CHECKOUT / file).read_text().replace(" \\\n    --hash=", " --hash=").splitlines()
    one = r"([A-Za-z0-9._-]+==[0-9][0-9a-z.]*(; [^-]+?)?)( --hash=sha256:[0-9a-f]{64})+"
    wrong = [line[:80] for line in entries if not re.fullmatch(one, line)]
    assert not wrong, f"not name==version with hashes: {wrong}"
    requirements = [Requirement(line.partition(" --hash=")[0]) for line in entries]
    return {requirement.name.lower().replace("_", "-"): requirement for requirement in requirements}


def test_the_lock_fits_the_requirements_and_holds_no_cuda() -> None:
    """If this failed, a fresh install would differ from what was tested, or download gigabytes that nobody uses."""
    lines, theirs = locked(), locked("mjlab.lock")
    # mjlab has a lock of its own; packages of online services are installed by their users alone.
    apart = ("mjlab", "wandb", "trackio")
    extras = {name: texts for name, texts in PROJECT["optional-dependencies"].items() if name not in apart}
    for text in (*PROJECT["dependencies"], *PROJECT["optional-dependencies"]["mjlab"]):
        assert Requirement(text).specifier.contains(str(theirs[Requirement(text).name].specifier).removeprefix("=="))
    for text in sum(extras.values(), PROJECT["dependencies"]):
        requirement = Requirement(text)
        if requirement.name != "stiction":
            line = lines[requirement.name]
            version = str(line.specifier).removeprefix("==")
            assert requirement.specifier.contains(version), f"{text}, but {version} is locked"
            assert str(line.marker) == str(requirement.marker), f"{text}, but the lock has {line}"
    assert not [name for name in (*lines, *theirs) if name.startswith(("nvidia", "cuda", "triton"))]


@pytest.mark.parametrize("page", ["mjlab", "isaaclab", "playground", "arm"])
def test_a_reader_finds_the_page_of_a_trainer(page: str) -> None:
    """Before the first heading of README, and in the site's navigation."""
    assert f"](docs/{page}.md)" in (CHECKOUT / "README.md").read_text().partition("\n## ")[0]
    assert f"- docs/{page}.md\n" in (CHECKOUT / "mkdocs.yml").read_text()


def test_every_requirement_has_both_bounds() -> None:
    """If this failed, a release of somebody else's could break an installation overnight."""
    for text in sum(PROJECT["optional-dependencies"].values(), PROJECT["dependencies"]):
        operators = {specifier.operator for specifier in Requirement(text).specifier}
        assert operators in ({">=", "<"}, {"=="}) or text.startswith("stiction["), text


def test_the_citation_names_the_version() -> None:
    """If this failed, a paper would cite a version that it did not use."""
    assert f"\nversion: {PROJECT['version']}\n" in (CHECKOUT / "CITATION.cff").read_text()


def anchors_of(page: Path) -> set[str]:
    """Return the anchors of a page's headings, which a repository's pages and the site must agree on."""
    text = re.sub(r"^ *```.*?^ *```$", "", page.read_text(), flags=re.MULTILINE | re.DOTALL)
    words = [re.sub(r"[^\w\- ]", "", line.lower()) for line in re.findall(r"^#+ +(.*)$", text, re.MULTILINE)]
    return {line.strip().replace(" ", "-") for line in words if "  " not in line.strip()}


@pytest.mark.parametrize("document", DOCUMENTS, ids=[path.name for path in DOCUMENTS])
def test_links_between_documents_lead_somewhere(document: Path) -> None:
    """If this failed, a reader would click into nothing, or land on top of a page; a % in a heading has two anchors."""
    for link in re.findall(r"\]\(([^)\s]+)\)", document.read_text()):
        file, _, anchor = link.partition("#")
        page = document.parent / file if file else document
        assert "://" in link or page.exists(), f"{document.name} links to {link}"
        assert "://" in link or not anchor or anchor in anchors_of(page), f"{document.name} links to {link}"


def test_the_readme_is_one_page() -> None:
    """It once had 4,268 words: nobody who only wants to try something reads so far."""
    assert len((CHECKOUT / "README.md").read_text().split()) <= 950


def test_the_list_of_verbs_is_whole() -> None:
    """If this failed, a stranger would not find out what the program can do."""
    listed = re.findall(r"^\| `stiction ([\w-]+)`", (CHECKOUT / "docs/verbs.md").read_text(), re.MULTILINE)
    assert listed == list(VERBS)


def test_every_result_is_in_the_index_and_every_link_leads_somewhere() -> None:
    """If this failed, a result would be there that nobody finds, or the index would lead into nothing."""
    folder = CHECKOUT / "results"
    links = re.findall(r"\]\(([^)]+)\)", (folder / "README.md").read_text())
    assert not [link for link in links if not (folder / link).exists()]
    assert {link.partition("/")[0] for link in links} == {path.name for path in folder.iterdir() if path.is_dir()}
