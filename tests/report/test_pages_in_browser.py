"""Every page in a real browser, on a desk and on a telephone, by day and by night: what it says can be read."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread

import pytest

pytest.importorskip("websockets", reason="the package websockets, of the extra 'view', is needed to drive a browser")

import numpy as np
import test_day_page
import test_evaluation
import test_excitation
import test_identification
import test_walking_page

from browser import Browser, chromium
from bundles import make_bundle, make_contract
from page_audit import page_faults
from stiction.cli.main import main
from stiction.deploy.check import check_bundle
from stiction.report.bench import PAGE
from stiction.report.demo import render_demo
from stiction.report.evaluation import write_evaluation
from stiction.report.excitation import write_excitation_page
from stiction.report.identification import write_identification_page
from stiction.report.page import (
    Section,
    bullets,
    figure_block,
    fold,
    label_ends,
    legend,
    new_figure,
    paragraph,
    render_page,
    row_table,
    same_scale,
    settings_table,
)

CHECKOUT = Path(__file__).parents[2]


@pytest.fixture(scope="module", name="browser")
def one_browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    """Start one browser for all pages."""
    with chromium(tmp_path_factory.mktemp("profile")) as started:
        yield started


def demo(folder: Path) -> Path:
    """Write the page of `stiction demo` from two bundles, made rows and the film of the front page."""
    contracts = {"none": make_contract(), "deception": make_contract(method="deception")}
    contracts["deception"] = replace(contracts["deception"], friction_range=(0.0, 0.24))
    checks = [check_bundle(make_bundle(folder / name, contract)) for name, contract in contracts.items()]
    rows = [
        replace(test_evaluation.walked(level, command, ratio * 0.5), policy=check.bundle.name, speed_ratio=ratio)
        for check in checks
        for command in ("vx=0.5", "vx=-0.5", "wz=0.5")
        for level, ratio in ((0.0, 1.0), (0.12, 0.9), (0.24, 0.7))
    ]
    policies = dict(zip(("trained without friction", "trained at 0 to 24 % friction"), checks, strict=True))
    film = CHECKOUT / "docs" / "hero.webp"
    page = folder / "report.html"
    page.write_text(render_demo([], policies, rows, test_evaluation.SUMMARY, ("vx=0.5", 0.24, film)))
    return page


def excite(folder: Path) -> Path:
    """Write the page of `stiction excite`."""
    test_excitation.results(folder)
    return write_excitation_page(folder)


def identify(folder: Path) -> Path:
    """Write the page of `stiction identify` of one joint."""
    test_identification.results(folder)
    return write_identification_page(folder)


def walk(folder: Path) -> Path:
    """Write the page of `stiction identify` of a walk."""
    test_walking_page.write(folder, test_walking_page.make_records(), test_walking_page.make_fit())
    return folder / "report.html"


def evaluate(folder: Path) -> Path:
    """Write the page of `stiction evaluate`."""
    return write_evaluation(folder, test_evaluation.ROWS, test_evaluation.SUMMARY)


def day(folder: Path) -> Path:
    """Write the page of `stiction report --bench`."""
    for run in ("none-1", "none-2"):
        test_day_page.made_run(folder, f"plain/{run}")
    assert main(["report", "--bench", str(folder)]) == 0
    return folder / PAGE


def actuator(folder: Path) -> Path:
    """Write the page of `stiction train-actuator` of a small training."""
    training = pytest.importorskip("stiction.learning.actuator", reason="the extra 'train' is needed to train")
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(CHECKOUT / "tests" / "learning"))
        import test_actuator_training as made
    runs = [made.read_run(made.write_run(folder / f"{index}.npz", index)) for index in range(4)]
    made.write_trained(folder / "net", training.train_actuator(runs, made.CFG, "a command"))
    return made.write_actuator_page(folder / "net")


def everything(folder: Path) -> Path:
    """Write a page of every kind of block: what a study may show."""
    figure, axes = new_figure(2, 2, size=(9.6, 4.0))
    for number, axis in enumerate(axes):
        axis.plot([1, 10], [number, 1], label=f"line {number}")
        axis.plot(np.linspace(1, 10, 3000), np.linspace(0, 1, 3000), ".", label="cloud")
        axis.set(title="small", xlabel="speed [m/s]", ylabel="friction [N m]", xscale="log")
        axis.title.set_fontsize(4)
        axis.text(2, 0.5, "a word", color="black")
    same_scale(axes)
    label_ends(axes[1])
    legend(axes[0])
    drawn = figure_block(figure, "A caption with `code`.")
    blocks = (bullets(["a warning of one part"]), fold("More", [settings_table({"a": {"b": [1, 2]}})], "more"))
    parts = [Section(name, (paragraph("Text with `code`."), *blocks)) for name in ("One", "Two", "Three")]
    parts.append(Section("Wide", (row_table(test_evaluation.ROWS, "A table"), figure_block(new_figure()[0], ""))))
    warnings = [f"warning {number}" for number in range(5)]
    page = folder / "report.html"
    page.write_text(
        render_page("A page", parts, ["It holds.", "Here."], warnings, "stiction " + "x" * 90, figure=drawn)
    )
    return page


PAGES = [demo, excite, walk, day, actuator, everything, identify, evaluate]


@pytest.mark.parametrize("make", PAGES)
def test_a_page_can_be_read_anywhere(make: Callable[[Path], Path], browser: Browser, tmp_path: Path) -> None:
    """Holds contrast, sizes, the first screen and a quiet console, in windows of two widths and both schemes."""
    tab = browser.tab(make(tmp_path).as_uri())
    faults = page_faults(tab)
    assert not faults, "\n".join(faults)


@pytest.mark.parametrize(
    ("body", "fault"),
    [
        ("<p id=answer style='color:#888'>pale</p>", "contrast 3.54: pale"),
        ("<p id=answer>x</p><p style='opacity:.5'>thin</p>", "contrast"),
        (
            "<p id=answer>x</p><figure><svg viewBox='0 0 90 9' width=45><text y=8 font-size=20>s</svg></figure>",
            "10.0 px",
        ),
        ("<p id=answer>x</p><p style='width:2000px'>wide</p>", "scrolls sideways"),
        ("<p style='height:900px'>late</p><p id=answer>x</p>", "no answer in the first screen"),
        ("<p>none</p>", "no answer in the first screen"),
        ("<p id=answer>x</p><figure><div style='height:900px'></div></figure>", "the figure leaves the first screen"),
        ("<p id=answer>x</p><script>console.error('no')</script>", "console: no"),
    ],
)
def test_the_gate_sees_each_fault(body: str, fault: str, browser: Browser, tmp_path: Path) -> None:
    """Every rule fails on a page that breaks it, or none of the other tests would mean anything."""
    page = tmp_path / "page.html"
    page.write_text(f"<!doctype html><html lang=en><body style='background:#fff;color:#000'>{body}</body></html>")
    tab = browser.tab(page.as_uri())
    assert [text for text in page_faults(tab) if fault in text]


@pytest.mark.slow
def test_the_front_page_of_the_site_can_be_read_and_begins_with_the_film(browser: Browser, tmp_path: Path) -> None:
    """Builds the site around its front page: the film in the first screen, and text read as on the other pages."""
    config = pytest.importorskip("mkdocs.config", reason="the extra 'docs' is needed to build the site")
    from mkdocs.commands.build import build

    build(
        config.load_config(
            str(CHECKOUT / "mkdocs.yml"), site_dir=str(tmp_path), nav=[{"Start": ["docs/index.md"]}], plugins=["search"]
        )
    )
    handler = partial(SimpleHTTPRequestHandler, directory=str(tmp_path))
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        tab = browser.tab(f"http://127.0.0.1:{server.server_port}/index.html")
        assert page_faults(tab, ".md-content", answered=False) == []
        film = tab.run(
            "(({top, width}) => [top, width])(document.querySelector('.md-content img').getBoundingClientRect())"
        )
        assert film[0] < 400 and film[1] > 300
        server.shutdown()
