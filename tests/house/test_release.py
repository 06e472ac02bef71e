"""Releases: complete distributions, a workflow that trusts no tag, a site that needs no network."""

from __future__ import annotations

import ast
import importlib.util
import re
import subprocess
import sys
import tarfile
import tomllib
from html.parser import HTMLParser
from pathlib import Path

import pytest
import yaml

CHECKOUT = Path(__file__).parents[2]


def script(name: str):
    """Return a module of tools/, which is no package."""
    spec = importlib.util.spec_from_file_location(f"script_{name}", CHECKOUT / "tools" / f"{name}.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


SCRIPTS = sorted(str(path.relative_to(CHECKOUT)) for path in CHECKOUT.glob("tools/*.py"))


@pytest.mark.parametrize("name", SCRIPTS)
def test_no_script_takes_its_words_unchecked(name: str) -> None:
    """`dist.py --help` built a wheel into a folder of that name; without words others ended in an IndexError."""
    tree = ast.parse((CHECKOUT / name).read_text())
    indexed = [node for node in ast.walk(tree) if isinstance(node, ast.Subscript)]
    taken = [node.lineno for node in indexed if ast.unparse(node.value) == "sys.argv"]
    # What was typed, whole, is what a result says of itself.
    whole = [node.lineno for node in indexed if ast.unparse(node) == "sys.argv[1:]"]
    assert not set(taken) - set(whole) and (not whole or "parse_args" in ast.unparse(tree))


@pytest.mark.parametrize("name", ["tools/dist", "tools/lock", "tools/robots", "tools/corpus", "tools/counters"])
def test_a_script_says_how_it_is_used(name: str, tmp_path: Path) -> None:
    """Status 0 for --help, 2 for a flag that there is not, and nothing is made."""
    for flag, status in (("--help", 0), ("--nonsense", 2)):
        command = [sys.executable, str(CHECKOUT / f"{name}.py"), flag]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert done.returncode == status and f"usage: {Path(name).name}.py" in done.stdout + done.stderr
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "use",
    [
        "runpy.run_path('tools/dist.py')['promises']().promised('sim')",
        "runpy.run_path('tools/stop_trials.py')['prepare'](pathlib.Path(sys.argv[1]))",
        *(f"runpy.run_path('tools/{name}.py')" for name in ("attacks", "stranger", "viewer_pace", "walk_intervals")),
    ],
)
def test_a_script_finds_the_helpers_of_tests(use: str, tmp_path: Path) -> None:
    """Scripts that use them are run by hand, or at the end of a long build: a helper that moved would show there."""
    words = [sys.executable, "-c", f"import pathlib, runpy, sys; {use}", str(tmp_path)]
    done = subprocess.run(words, cwd=CHECKOUT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
def test_wheel_and_source_distribution_hold_the_same(tmp_path: Path) -> None:
    """Wheel and source distribution hold the whole package, with policies, templates, types and the licence."""
    wheel, sdist = script("dist").distributions(CHECKOUT, tmp_path)
    packed = script("dist").contents(wheel)
    source = [path for path in (CHECKOUT / "src/stiction").rglob("*") if path.is_file()]
    expected = {path.relative_to(CHECKOUT / "src").as_posix() for path in source if "__pycache__" not in path.parts}
    assert {name for name in packed if name.startswith("stiction/")} == expected and "stiction/py.typed" in expected
    assert {name.partition("/")[0] for name in packed} == {"stiction", wheel.name.partition("-py3")[0] + ".dist-info"}
    more = script("dist").contents(script("dist").experiments(CHECKOUT, tmp_path))
    assert {name.partition("/")[0].partition("-")[0] for name in more} == {"stiction_experiments"}
    assert any(name.endswith("licenses/LICENSE") for name in packed)
    with tarfile.open(sdist) as file:
        names = {name.partition("/")[2] for name in file.getnames()}
    assert {"README.md", "LICENSE", "pyproject.toml"} <= names and not any(name.startswith("tests/") for name in names)


def test_a_stranger_types_what_the_front_page_says() -> None:
    """The clock would time commands that nobody is told, or none."""
    tasks = {task.name: script("stranger").commands(task) for task in script("stranger").TASKS}
    assert {name: [words[1] for words in typed] for name, typed in tasks.items()} == {
        "own log to verdict": ["identify"],
        "demo": ["demo"],
        "own ONNX to evaluated under friction": ["import", "verify", "evaluate"],
        "own MJCF to first training iteration": ["robot", "train"],
    }


FLOWS = {path.stem: yaml.safe_load(path.read_text()) for path in (CHECKOUT / ".github/workflows").glob("*.yml")}


@pytest.mark.parametrize(
    ("name", "rights", "made"),
    [
        (
            "release",
            {"build": {"contents": "read"}, "publish": {"id-token": "write"}},
            "check test-mjlab test docs dist",
        ),
        ("pages", {"build": {"contents": "read"}, "deploy": {"pages": "write", "id-token": "write"}}, "docs"),
        ("ci", {"test": {"contents": "read"}, "site": {"contents": "read"}}, "check test docs"),
    ],
)
def test_a_workflow_pins_what_it_runs_and_asks_for_little(name: str, rights: dict, made: str) -> None:
    """A tag of somebody else's action can be moved; a token that is not needed can be stolen."""
    flow = FLOWS[name]
    steps = [step for job in flow["jobs"].values() for step in job["steps"]]
    used = [step["uses"] for step in steps if "uses" in step]
    assert used and all(re.fullmatch(r"[\w./-]+@[0-9a-f]{40}", name) for name in used), used
    assert flow["permissions"] == {} and {job: flow["jobs"][job]["permissions"] for job in flow["jobs"]} == rights
    assert "password" not in str(flow) and "secrets" not in str(flow)
    assert not [job for job, right in rights.items() if "write" in str(right) and flow["jobs"][job]["needs"] != "build"]
    rules = re.findall(r"^([a-z-]+):", (CHECKOUT / "Makefile").read_text(), re.MULTILINE)
    lines = [line for step in steps for line in re.findall(r"make ((?:[a-z-]+ ?)+)", step.get("run", ""))]
    assert {word for line in lines for word in line.split()} == set(made.split()) <= set(rules)


def test_pull_requests_are_tried_on_every_system_and_python_that_is_meant() -> None:
    """A version that pyproject.toml names, and nobody tries, is a promise without a test."""
    matrix = FLOWS["ci"]["jobs"]["test"]["strategy"]["matrix"]
    classes = " ".join(tomllib.loads((CHECKOUT / "pyproject.toml").read_text())["project"]["classifiers"])
    assert matrix["python"] == re.findall(r"Python :: (3\.\d+)", classes)
    assert {name.partition("-")[0] for name in matrix["os"]} == {"ubuntu", "macos"} and "MacOS" in classes
    # YAML 1.1 reads `on` as true.
    assert "pull_request" in FLOWS["ci"][True] and len(FLOWS) == 3


class Loaded(HTMLParser):
    """Addresses that a page makes a browser load."""

    def __init__(self) -> None:
        """Begin with nothing."""
        super().__init__()
        self.sources: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Keep addresses of what is shown or run, not of what is only linked to."""
        attributes = dict(attrs)
        if tag in ("script", "img", "iframe", "source", "video", "audio"):
            self.sources += [attributes["src"] or ""] if "src" in attributes else []
        elif tag == "link" and attributes.get("rel") not in ("canonical", "next", "prev"):
            self.sources += [attributes["href"] or ""] if "href" in attributes else []


@pytest.mark.slow
def test_the_site_builds_and_loads_nothing_from_the_net(tmp_path: Path) -> None:
    """A link that leads nowhere, or a page that tells somebody else who reads it."""
    for package in ("mkdocs", "material", "mkdocstrings"):
        pytest.importorskip(package, reason=f"{package}, of the extra 'docs', is needed to build the site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(tmp_path / "site")]
    done = subprocess.run(command, cwd=CHECKOUT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    pages = sorted((tmp_path / "site").rglob("index.html"))
    assert {"tutorial", "theory", "symptoms", "api", "results"} <= {page.parent.name for page in pages}
    for page in pages:
        reader = Loaded()
        reader.feed(page.read_text(encoding="utf-8"))
        assert not [name for name in reader.sources if "//" in name], page
    styles = "".join(path.read_text(encoding="utf-8") for path in (tmp_path / "site").rglob("*.css"))
    assert not re.search(r"@import|url\(['\"]?(https?:)?//", styles)
