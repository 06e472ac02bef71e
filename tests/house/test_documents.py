"""Documents: existing verbs, working links, consistent versions, a matching lock."""

from __future__ import annotations

import re
import runpy
import tomllib
from pathlib import Path

import pytest
import yaml
from packaging.requirements import Requirement

import stiction
from plain_sentences import blocks, long_sentences
from stiction.cli.deploy import DeployCfg
from stiction.cli.main import VERBS
from stiction.core.flags import entries

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
    """Locked versions satisfy the requirements with equal markers; neither lock has CUDA packages."""
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


@pytest.mark.parametrize(
    "place", ["trainers.md#mjlab", "trainers.md#isaac-lab", "trainers.md#playground", "arm.md", "symptoms.md"]
)
def test_a_reader_finds_the_page_of_a_trainer(place: str) -> None:
    """Before the first heading of README, on the landing page, and in the site's navigation."""
    assert f"](docs/{place})" in (CHECKOUT / "README.md").read_text().partition("\n## ")[0]
    assert f"]({place})" in (CHECKOUT / "docs/index.md").read_text()
    assert f"- docs/{place.partition('#')[0]}\n" in (CHECKOUT / "mkdocs.yml").read_text()


def test_every_requirement_has_both_bounds() -> None:
    """Every requirement has a lower and an upper bound, or an exact version."""
    for text in sum(PROJECT["optional-dependencies"].values(), PROJECT["dependencies"]):
        operators = {specifier.operator for specifier in Requirement(text).specifier}
        assert operators in ({">=", "<"}, {"=="}) or text.startswith("stiction["), text


def test_the_citation_the_changelog_and_the_badges_name_the_version() -> None:
    """A paper would cite a version that it did not use, and a badge would say what is not so."""
    version, readme = PROJECT["version"], (CHECKOUT / "README.md").read_text()
    assert f"\nversion: {version}\n" in (CHECKOUT / "CITATION.cff").read_text()
    assert f"\n## [{version}] - " in (CHECKOUT / "CHANGELOG.md").read_text()
    assert f"![version {version}](https://img.shields.io/badge/version-{version}-blue)" in readme
    pythons = re.findall(r"Python :: (3\.\d+)", " ".join(PROJECT["classifiers"]))
    assert f"![Python {pythons[0]} to {pythons[-1]}]" in readme and f"![licence {PROJECT['license']}]" in readme


def test_the_owners_account_is_one_word_that_the_list_for_the_release_names() -> None:
    """A placeholder that the list forgets would be released; half of them set would lead into nothing."""
    urls = [*PROJECT["urls"].values(), yaml.safe_load((CHECKOUT / "mkdocs.yml").read_text())["repo_url"]]
    owners = {re.findall(r"github\.com/([\w-]+)/|//([\w-]+)\.github\.io/", url)[0] for url in urls}
    named = {name for pair in owners for name in pair if name}
    assert len(named) == 1
    steps = (CHECKOUT / "CONTRIBUTING.md").read_text().partition("## Before the first release")[2]
    assert len(re.findall(r"^\d\. ", steps, re.MULTILINE)) == 5
    waiting = "SECURITY-CONTACT" in (CHECKOUT / "SECURITY.md").read_text()
    assert (named != {"OWNER"} or "`OWNER`" in steps) and (not waiting or "`SECURITY-CONTACT`" in steps)


def anchors_of(page: Path) -> set[str]:
    """Return the anchors of a page's headings, which a repository's pages and the site must agree on."""
    text = re.sub(r"^ *```.*?^ *```$", "", page.read_text(), flags=re.MULTILINE | re.DOTALL)
    words = [re.sub(r"[^\w\- ]", "", line.lower()) for line in re.findall(r"^#+ +(.*)$", text, re.MULTILINE)]
    return {line.strip().replace(" ", "-") for line in words if "  " not in line.strip()}


@pytest.mark.parametrize("document", DOCUMENTS, ids=[path.name for path in DOCUMENTS])
def test_links_between_documents_lead_somewhere(document: Path) -> None:
    """Every link between documents leads to an existing file and heading."""
    for link in re.findall(r"\]\(([^)\s]+)\)", document.read_text()):
        file, _, anchor = link.partition("#")
        page = document.parent / file if file else document
        assert "://" in link or page.exists(), f"{document.name} links to {link}"
        assert "://" in link or not anchor or anchor in anchors_of(page), f"{document.name} links to {link}"


def words(*pages: Path) -> int:
    """Return the words of pages, code and signs among them."""
    return sum(len(page.read_text().split()) for page in pages)


def test_the_documents_are_short() -> None:
    """Nobody who only wants to try something reads further; a page that grows takes from another."""
    assert words(CHECKOUT / "README.md") <= 700
    assert words(CHECKOUT / "CHANGELOG.md") <= 700
    assert words(*CHECKOUT.glob("docs/*.md")) <= 14_000


LONGER = {"ARCHITECTURE.md": 5, "SECURITY.md": 13, "viewer.md": 5}
"""Page -> longer sentences that it has: ways through modules, promises with their tests, a page not written anew."""


@pytest.mark.parametrize("document", DOCUMENTS, ids=[path.name for path in DOCUMENTS])
def test_no_sentence_has_more_than_35_words(document: Path) -> None:
    """Holds for those to whom English is a second language."""
    long = long_sentences(document.read_text(), 35)
    assert len(long) <= LONGER.get(document.name, 0), long


def test_sentences_are_counted_as_a_reader_meets_them() -> None:
    """A cell, an item and a heading end a sentence; code is one word, a link is its text, a block is none."""
    text = "# A b\n\nOne `two three`. [Four five](six seven) `x`\n* Seven\n| a | b c |\n```\nnot this\n```\n"
    assert blocks(text) == ["A b", "One `two three`. [Four five](six seven) `x`", "Seven", "a", "b c"]
    assert long_sentences(text, 2) == ["Four five Code"] and long_sentences("One, two - three.", 2) == [
        "One, two - three."
    ]


@pytest.mark.parametrize("page", sorted(CHECKOUT.glob("docs/*.md")), ids=lambda page: page.name)
def test_a_page_begins_with_an_answer_and_shows_a_picture(page: Path) -> None:
    """A title, then a sentence that says what the page is for; prose alone is not read."""
    text = re.sub(r"<!--.*?-->", "", page.read_text(), flags=re.DOTALL).lstrip()
    title, _, body = text.partition("\n\n")
    assert re.fullmatch(r"# .+", title) and re.match(r"[\w*`].*\w.*[.?:]", body), page.name
    assert re.search(r"!\[[^\]]+\]\([^)]+\.(svg|png|webp|jpg)\)", text), page.name


def test_the_figures_are_what_the_script_draws(tmp_path: Path) -> None:
    """A figure that was changed by hand, or whose rows have changed since, would not be true."""
    pytest.importorskip("stiction_experiments", reason="the experiments are needed to count the seeds of a figure")
    script = runpy.run_path(str(CHECKOUT / "tools/figures.py"))
    drawn = {f"{name}.svg": draw() for name, draw in script["FIGURES"].items()}
    assert drawn == {path.name: path.read_text() for path in (CHECKOUT / "docs/figures").iterdir()}
    shown = "".join(page.read_text() for page in DOCUMENTS)
    assert not [name for name in drawn if f"figures/{name})" not in shown]


def test_a_slow_joint_rests_within_its_dead_band() -> None:
    """By hand: a target goes to 1 and back to 0, the joint follows 0.25 behind it and rests in between."""
    play = runpy.run_path(str(CHECKOUT / "tools/figures.py"))["play"]
    assert play([0.0, 0.2, 0.5, 1.0, 0.6, 0.0], 0.25) == [0.0, 0.0, 0.25, 0.75, 0.75, 0.25]


def test_the_list_of_verbs_is_whole() -> None:
    """docs/verbs.md lists every verb, in the order of `VERBS`."""
    listed = re.findall(r"^\| `stiction ([\w-]+)`", (CHECKOUT / "docs/verbs.md").read_text(), re.MULTILINE)
    assert sorted(listed) == sorted(VERBS)


def test_the_options_of_the_safety_page_exist() -> None:
    """Each flag and each setting that docs/safety.md names is one of `stiction deploy`."""
    quoted = re.findall(r"`([^`]*)`", (CHECKOUT / "docs/safety.md").read_text())
    names = re.findall(r"--(?:set [\w.-]+|[\w.-]+)", "\n".join(word for word in quoted if "verify" not in word))
    assert len(names) > 10 and set(names) <= {entry.typed for entry in entries(DeployCfg)}


def test_the_reference_has_every_public_name() -> None:
    """A name of `import stiction` whose signature is nowhere is found by nobody."""
    page = (CHECKOUT / "docs/api.md").read_text()
    for name, module in stiction.PUBLIC.items():
        (members,) = re.findall(
            rf"^::: stiction\.{re.escape(module)}\n    options:\n      members: \[(.*)\]", page, re.MULTILINE
        )
        assert name in members.split(", "), name


def test_every_result_is_in_the_index_and_every_link_leads_somewhere() -> None:
    """Links of results/README.md exist and cover every folder of results."""
    folder = CHECKOUT / "results"
    links = re.findall(r"\]\(([^)]+)\)", (folder / "README.md").read_text())
    assert not [link for link in links if not (folder / link).exists()]
    assert {link.partition("/")[0] for link in links} == {path.name for path in folder.iterdir() if path.is_dir()}
