"""The program `stiction`: finds the verb, imports its module alone, and turns errors into one line and a status."""

from __future__ import annotations

import importlib
import sys
import warnings
from collections.abc import Callable

from stiction import __version__
from stiction.cli.process import DEBUG, begin, failed, stopped
from stiction.core.errors import ConfigurationError, StictionError, unknown_name
from stiction.core.extras import require, without_experiments
from stiction.core.plugins import VERBS as VERB_GROUP
from stiction.core.plugins import find_installed
from stiction.core.provenance import limit_library_threads

GROUPS = {
    "Measure": {
        "excite": "design the log for identification, before any motion",
        "identify": "find a joint's inertia and friction from a log, with intervals",
        "train-actuator": "fit an Actuator Net to logs of walks",
        "convert": "write joints and ranges for simulators and trainers",
    },
    "Train": {
        "train": "train a policy to walk, with or without joint friction",
        "runs": "list training runs, or compare some of them",
        "export": "turn a run into a bundle, or a bundle into others' formats",
        "import": "turn a policy in ONNX, trained elsewhere, into a bundle",
    },
    "Check": {
        "robot": "check a robot's file, show its values and their origins",
        "verify": "check a policy bundle: files, contract, golden vectors",
        "evaluate": "drive a bundle over engines, friction, grounds, commands",
        "report": "put a day's runs on a robot beside their prediction",
    },
    "Run": {
        "demo": "run the whole line on small input, explained on one page",
        "deploy": "run a bundle on a robot, real or virtual, under a supervisor",
        "view": "interactive browser viewer with friction sliders",
    },
    "Tools": {
        "list": "list the robots, policies and engines that come with stiction",
        "doctor": "describe the machine; audit randomisation, also mjlab's",
        "sign": "sign a policy bundle, or make a key",
        "bench": "benchmark simulation and training throughput",
        "study": "run an experiment behind the results, and write its page",
        "replicate": "run the paper's comparison, and judge its sentences",
    },
}
"""Heading of `stiction --help` -> verb -> what it does. The module is `stiction.cli.<verb>`, with _ for -."""

VERBS = {verb: text for verbs in GROUPS.values() for verb, text in verbs.items()}
"""Verb -> what it does."""

INSTALLED = frozenset({"replicate", "study", "bench"})
"""Verbs that are entry points of the distribution of the experiments."""

NEEDS = {"demo": "sim", "evaluate": "sim", "replicate": "sim", "import": "sim", "sign": "sign"}
NEEDS |= {"robot": "sim", "view": "view"}
NEEDS |= dict.fromkeys(("train", "train-actuator", "bench"), "train")
"""Verbs that do nothing without an extra: it is asked for before anything is done, unless they are asked for help."""

HELP = frozenset({"-h", "--help", "--help-all"})
"""Words that ask for help."""

USAGE = "usage: stiction VERB [--help] [options]\n"
EPILOG = """
Verbs with [sim], [train] and the like need that extra, and print the command
that installs it where it is missing.

Examples:
  stiction demo
  stiction identify log.csv --kp 20 --kd 1 --torque-limit 45
  stiction verify saturn_lite-flat-deception-0.2

`stiction VERB --help` explains a verb. `stiction --version` prints the version.
`--debug`, with any verb, prints the traceback of an error before its line.
"""


def overview() -> str:
    """Return the text of `stiction --help`."""
    extras = {verb: f" [{extra}]" for verb, extra in NEEDS.items()}
    lines = []
    for heading, verbs in GROUPS.items():
        lines += ["", f"{heading}:", *(f"  {verb:<16}{VERBS[verb]}{extras.get(verb, '')}" for verb in verbs)]
    return "\n".join((USAGE.rstrip(), *lines, EPILOG))


def main(arguments: list[str]) -> int:
    """Run one verb; return the exit status (0 done, 1 a failure the user can act on, 2 wrong usage)."""
    # Taken out first, for no verb's parser knows it.
    debug, arguments = DEBUG in arguments, [word for word in arguments if word != DEBUG]
    if not arguments:
        print(overview(), end="", file=sys.stderr)
        return 2
    verb, *rest = arguments
    if verb in HELP or verb == "help":
        print(overview(), end="")
        return 0
    if verb == "--version":
        print(f"stiction {__version__}")
        return 0
    if verb not in VERBS:
        where = "; options stand behind the verb" if verb.startswith("-") else ""
        print(f"stiction: {unknown_name('verb', verb, VERBS)}{where}", file=sys.stderr)
        return 2
    name = _named(verb, rest)
    if odd := next((word for word in rest if not _is_text(word)), None):
        explanation = f"{odd!r} is no UTF-8 text, in which results name the command that made them; rename it"
        print(f"stiction {name}: {explanation}", file=sys.stderr)
        return 1
    # Before the verb's module: NumPy and torch read their settings when they are imported.
    limit_library_threads()
    try:
        with warnings.catch_warnings():
            # Python's own form is two lines, the second one of our source code.
            warnings.showwarning = lambda message, *_, **__: print(
                f"stiction {name}: warning: {' '.join(str(message).split())}", file=sys.stderr
            )
            asked = not HELP.isdisjoint(rest)
            run = find_verb(verb)
            if run is None:
                if not asked:
                    raise ConfigurationError(without_experiments("this"))
                print(f"stiction {name}: {VERBS[verb]}; {without_experiments('this')}")
                return 0
            if verb in NEEDS and not asked:
                require(NEEDS[verb])
            return int(run(rest) or 0)
    except KeyboardInterrupt as stop:
        explanation, status = stopped(stop)
        print(f"stiction {name}: {explanation}", file=sys.stderr)
        return status
    except Exception as error:
        return failed(error, name, debug)


def find_verb(verb: str) -> Callable[[list[str]], int | None] | None:
    """Return the `main` of a verb, None where its distribution is not installed."""
    if verb in INSTALLED:
        return find_installed(VERB_GROUP, verb)
    name = "import_policy" if verb == "import" else verb.replace("-", "_")
    return importlib.import_module(f"stiction.cli.{name}").main


def _named(verb: str, words: list[str]) -> str:
    """Return what a message stands behind: a verb, or a study by its name."""
    study = verb == "study" and words and _is_text(words[0]) and not words[0].startswith("-")
    return f"{verb} {words[0]}" if study else verb


def _is_text(word: str) -> bool:
    """Return whether a word of the command line can be written into a file."""
    try:
        word.encode()
    except UnicodeEncodeError:
        return False
    return True


def entry() -> None:
    """Console-script entry point."""
    begin()
    try:
        status = main(sys.argv[1:])
        # Here, where a full disk or a reader that is gone still becomes a line and a status; at exit Python would do
        # it.
        sys.stdout.flush()
    except StictionError as error:
        status = failed(error, "", False)
    except KeyboardInterrupt as stop:
        status = stopped(stop)[1]
    sys.exit(status)
