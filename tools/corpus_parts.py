"""List the commands of the corpus, part by part."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import corpus_logs as logs

if TYPE_CHECKING:
    from corpus import Corpus

CHECKOUT = Path(__file__).resolve().parents[1]
NONE, DIRECT, DECEPTION = (f"saturn_lite-flat-{method}-0.2" for method in ("none", "direct", "deception"))
STAIRS = "saturn_lite-stairs-deception-0.2"
METHODS = ("none", "direct", "compensation", "finetune", "iterative", "deception", "dreamwaq", "hinf")

OLD = "ac5f2cd39bf8"
"""Revision from whose history older bundles and results are taken; they need not be in the working tree."""

OLD_BUNDLES = (
    "results/friction-training/drawn-ground/policies/coulomb20-deception-s0",
    "results/friction-training/one-phase/policies/coulomb20-deception-s0",
    "results/friction-training/rows/policies/coulomb20-deception-s0",
    "results/gpu/policies/deception-s0",
    "results/literal/policies/literal01-mujoco-s0",
    "results/methods/policies/coulomb20-compensated-s0",
    "results/policies/coulomb20-actuator-output-s0",
    "results/robots/policies/g1-flat-none-s0",
    "results/stairs/policies/half-hour-deception-s0",
    "results/student/policies/coulomb20-alternate-s1",
    "tests/data/walker",
)

GO2 = {
    **{"kp": 20, "kd": 1.5, "test_condition": "in_air", "torque_limit": 23.7},
    "names": [f"{leg}_{joint}" for leg in ("FL", "FR", "RL", "RR") for joint in ("hip", "thigh", "calf")],
    "joints": {"calf": {"torque_limit": 45.43}},
}
"""Sidecar of the measured robot, see results/identification."""

EMPS = (
    "--columns time=t position=qm target=qg torque=vir --torque-scale 35.15065 --kp 1370750 --kd 8557.5 "
    "--velocity-delay 0.001 --axis linear --joint drive --torque-source motor_side --test-condition loaded"
)

API = """
import inspect, re, stiction
for name in sorted(stiction.__all__):
    value = getattr(stiction, name)
    if callable(value):
        signature = re.sub(r"stiction\\.[a-z_.]+\\.(?=[A-Z])", "", str(inspect.signature(value)))
        print(f"{name}{signature}\\n    {(inspect.getdoc(value) or '').splitlines()[0]}")
    else:
        print(name)
def members(value):
    return ", ".join(name for name in dir(value) if not name.startswith("_"))
log = stiction.load_log("log.csv")
result = stiction.identify(log)
for value in (log, result, stiction.load_robot("go2"), stiction.load_policy("saturn_lite-flat-none-0.2")):
    print(f"== {type(value).__name__}: {members(value)}")
print(result)
result.save("saved")
print(stiction.load_joints("saved/joints.json").joints.keys())
print(stiction.list_robots(), stiction.list_policies())
for call in (lambda: stiction.load_robot("saturn_lita"), lambda: stiction.identify("no.csv"), lambda: stiction.evalute):
    try:
        call()
    except (stiction.StictionError, AttributeError) as error:
        print(f"{type(error).__name__}: {error}")
"""

OWN_POLICY = '''"""A policy in Python: stand."""

import numpy as np

POSE = np.tile([0.0, 0.85, -1.5], 6)


def stand(sensors, command, fresh):
    """Return the standing pose."""
    return np.zeros_like(sensors.joint_position) + POSE
'''

MODEL = """<mujoco model="leg"><!-- a comment that stays --><compiler angle="radian"/>
<default><joint damping="0.3" armature="0.01"/></default><worldbody><body name="thigh" pos="0 0 1">
<joint name="FL_hip_joint" axis="1 0 0"/><geom type="capsule" fromto="0 0 0 0 0 -.2" size=".02"/>
<body name="calf" pos="0 0 -.2"><joint name="FL_calf_joint" axis="0 1 0" frictionloss="0.2"/>
<geom type="capsule" fromto="0 0 0 0 0 -.2" size=".02"/></body></body></worldbody></mujoco>
"""

WRONG = (
    *("", "wlak", "--out x", "identify", "identify no.csv", "identify log.csv --kq 3", "identify log.csv --kp many"),
    *("identify log.csv --torque-source motor", "identify folder", "identify empty.csv", "identify image.png"),
    *("convert no.json --to mujoco", "convert log.csv --to mujoco", "convert log.csv --to gazebo", "verify no-bundle"),
    *("verify folder", "evaluate no-bundle", f"evaluate {NONE} --engines bullet", f"evaluate {NONE} --commands vx"),
    *(
        f"evaluate {NONE} --friction-levels -1",
        "robot check go3",
        "robot check log.csv",
        "robot",
        "study",
        "study dampin",
    ),
    *("train --method magic", "train --robot go3", "train --friction-level 3", "train --teacher.iteratoins 3"),
    *("train --resume folder", "export folder", "export no-run", "import log.csv --robot go2", "sign folder"),
    *(
        "list nothing",
        "excite --joint shank --robot go2",
        "deploy no-bundle",
        "deploy --robot virtual",
        "view no-bundle",
    ),
    *("train-actuator log.csv", "doctor --task.friction.range 1", "demo --bundles folder", "bench --blocks 0"),
)
"""Wrong usage and input that is refused: one line each, or the help."""


@dataclass(frozen=True)
class Part:
    """A part of the corpus."""

    make: Callable[[Corpus], None]
    """Run its commands."""
    long: bool = False
    """True if it is made only when named."""


def helps(corpus: Corpus) -> None:
    """Print every help."""
    corpus.run("overview", "--help")
    corpus.run("version", "--version")
    corpus.run("study", "study --help")
    verbs = re.findall(r"^  ([a-z-]+)  ", corpus.artefacts["help/overview/printed"].partition("\nExamples")[0], re.M)
    studies = re.findall(r"^  ([a-z-]+)  ", corpus.artefacts["help/study/printed"], re.M)
    nested = ["robot check", "robot show", "robot list", "identify walk"]
    for words in (*verbs, *nested, *(f"study {name}" for name in studies)):
        name = words.replace(" ", "-")
        corpus.run(name, f"{words} --help")
        if "--help-all" in corpus.artefacts[f"help/{name}/printed"]:
            corpus.run(f"{name}-all", f"{words} --help-all")


def api(corpus: Corpus) -> None:
    """Use `import stiction`."""
    logs.sidecar(logs.text(corpus.folder / "log.csv", logs.simulate(logs.Joint(), 1)), kp=20, kd=1, torque_limit=40,
                 torque_source="motor_side", test_condition="in_air")  # fmt: skip
    done = corpus.script(API)
    corpus.add("names", f"{done.stdout}\n--- standard error\n{done.stderr}")


def wrong(corpus: Corpus) -> None:
    """Ask for what is refused."""
    logs.text(corpus.folder / "log.csv", logs.simulate(logs.Joint(), 1, seconds=2))
    (corpus.folder / "folder").mkdir()
    (corpus.folder / "empty.csv").write_text("")
    (corpus.folder / "image.png").write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(64))
    for number, words in enumerate(WRONG):
        corpus.run(f"{number:02}-{re.sub('[^a-z]+', '-', words).strip('-')}", words)


def identify(corpus: Corpus) -> None:
    """Identify joints and a limb from logs of every format."""
    for case in logs.cases():
        folder = corpus.folder / case.name
        folder.mkdir()
        case.make(folder)
        corpus.run(case.name, f"identify {case.words} --out out", case.name)
    logs.text(corpus.folder / "log.csv", logs.simulate(logs.Joint(), 1))
    corpus.run("init", "identify log.csv --init")
    corpus.file("init/log.json", corpus.folder / "log.json")


def measured(corpus: Corpus) -> None:
    """Identify the measured records, where STICTION_DATA names their folder."""
    data = os.environ.get("STICTION_DATA")
    if data is None:
        print("measured: STICTION_DATA is not set, nothing made", file=sys.stderr)
        return
    logs.sidecar(corpus.folder / "go2.txt", **GO2)
    corpus.run("emps", f"identify {data}/emps/DATA_EMPS.mat {EMPS} --out emps")
    corpus.run("go2", f"identify {data}/go2/traj_0.pt --sidecar go2.json --out go2")


def walks(corpus: Corpus) -> None:
    """Log walks, identify them, and fit an Actuator Net."""
    corpus.run("log", f"evaluate {DECEPTION} --friction-levels 0.1 0.2 --commands vx=0.5 --seconds 3 --episodes 1 "
               "--jobs 1 --log walks --log-robots 1 --log-seconds 8 --out evaluation", quiet=True)  # fmt: skip
    first, second = sorted((corpus.folder / "walks").glob("*.npz"))
    corpus.file("log/walk.npz", first)
    logs.walk_csv(corpus.folder / "walk.csv", second)
    corpus.run("walk", f"identify walk walks/{first.name} --out walk")
    corpus.run("walk-mass-known", f"identify walk walks/{second.name} --mass-known --json --out mass-known")
    corpus.run("walk-csv", "identify walk walk.csv --robot saturn_lite --kp 100 --kd 2.5 --torque-source motor_side "
               "--out walk-csv")  # fmt: skip
    corpus.run("actuator", "train-actuator walks --epochs 1 --out actuator")


def rows(corpus: Corpus) -> None:
    """Drive the shipped policies in each engine and on a virtual robot."""
    short = "--seconds 3 --episodes 2 --jobs 1"
    flat = "--friction-levels 0 0.2 --commands vx=0.5 vx=-0.5"
    one = f"evaluate {DECEPTION} --friction-levels 0.2 --commands vx=0.5"
    corpus.run("mujoco", f"evaluate {NONE} {DIRECT} {DECEPTION} {flat} {short} --out mujoco")
    corpus.run("mujoco-again", "evaluate --judge-again --out mujoco")
    corpus.run("stairs", f"evaluate {STAIRS} --friction-levels 0.2 --commands vx=0.4 --terrains stairs=0.1 slope=0.2 "
               f"rough=0.05 {short} --out stairs")  # fmt: skip
    corpus.run("engines", f"{one} {short} --engines mujoco-alone physx ode ode-webots --out engines")
    corpus.run("robots", f"{one} {short} --engines mujoco-alone+all mujoco-alone+friction --robots 1000 "
               "--robot-levels 0.1 bench --out robots")  # fmt: skip
    for law in ("stribeck", "load", "effort"):
        corpus.run(f"law-{law}", f"{one.replace('0.2 --c', '0.05 --c')} {short} --friction-law {law} --out {law}")
    corpus.run("commands", f"{one} vy=0.3 wz=0.5 vx=0.4,wz=0.5 stand {short} --json --out commands")
    corpus.run("forward", f"{one} {short} --forward {DECEPTION} --out forward")
    own = corpus.folder / "own"
    own.mkdir()
    (own / "corpus_policy.py").write_text(OWN_POLICY)
    corpus.run("function", "evaluate --policy-callable corpus_policy:stand --robot saturn_lite --friction-levels 0 "
               f"--commands stand {short} --out function")  # fmt: skip


def convert(corpus: Corpus) -> None:
    """Convert identified joints and ranges to every target."""
    folder = corpus.folder
    logs.text(folder / "log.csv", logs.two_joints(2))
    corpus.run("identify", f"identify log.csv {logs.FLAGS} --out out", quiet=True)
    (folder / "leg.xml").write_text(MODEL)
    (folder / "arm.urdf").write_text(logs.ARM)
    names = "--joint-map FL_hip=FL_hip_joint FL_calf=FL_calf_joint"
    trainers = ("isaaclab", "isaaclab_newton", "playground", "legged_gym", "genesis")
    for target in ("mujoco", "urdf", "webots", "mjlab", *trainers):
        corpus.run(f"joints-{target}", f"convert out/joints.json --to {target}")
    corpus.run("joints-mujoco-model", f"convert out/joints.json --to mujoco --model leg.xml {names} --out new.xml")
    corpus.run("joints-urdf-model", "convert out/joints.json --to urdf --model arm.urdf --joint-map FL_hip=shoulder "
               "FL_calf=elbow --out new.urdf")  # fmt: skip
    corpus.run("joints-json", f"convert out/joints.json --to isaaclab {names} --assumed-load 20 --json")
    for target in ("mujoco", *trainers):
        corpus.run(f"training-{target}", f"convert out/training.json --to {target} --robot go2 --out {target}.txt")
    corpus.run("training-mjlab", "convert out/training.json --to mjlab")
    corpus.run("training-own", "convert out/training.json --to isaaclab")


def robots(corpus: Corpus) -> None:
    """List, check, show and design; say what the machine is."""
    corpus.run("list", "list")
    corpus.run("list-json", "list --json")
    corpus.run("robot-list", "robot list")
    for robot in ("saturn_lite", "go1", "go2", "g1"):
        corpus.run(f"check-{robot}", f"robot check {robot}")
        corpus.run(f"show-{robot}", f"robot show {robot} --out {robot}")
    (corpus.folder / "arm.urdf").write_text(logs.ARM)
    corpus.run("check-yaml", "robot check go2/robot.yaml --json")
    corpus.run("check-mjcf", "robot check go2/robot.xml")
    corpus.run("check-urdf", "robot check arm.urdf")
    corpus.run("show-urdf", "robot show arm.urdf")
    corpus.run("excite", "excite --robot saturn_lite --joint shank --duration 8 --out excite")
    corpus.run("excite-position-only", "excite --position-only --duration 5 --json --out plain")
    corpus.run("doctor", "doctor --json", moving=True)
    corpus.run("doctor-randomization", "doctor --randomization --robot go1 --json")


def bundles(corpus: Corpus) -> None:
    """Verify, sign, export and import policies."""
    folder = corpus.folder
    for policy in (NONE, DIRECT, DECEPTION, STAIRS):
        corpus.run(f"verify-{policy}", f"verify {policy}")
    corpus.run("robot", "robot show saturn_lite --out robot", quiet=True)
    corpus.run("verify-against", f"verify {NONE} --against robot/robot.xml --json")
    corpus.run("verify-wrong-digest", f"verify {NONE} --expect-digest {'0' * 64}")
    (folder / "allowed.txt").write_text(f"# none of ours\n{'1' * 64}\n")
    corpus.run("verify-not-allowed", f"verify {NONE} --allow allowed.txt")
    for target in ("webots", "deploy.yaml", "rl_sar", "mjlab"):
        corpus.run(f"export-{target}", f"export {NONE} --to {target} --out {target}")
    for target in ("deploy.yaml", "rl_sar", "mjlab"):
        networks = sorted((folder / target).rglob("*.onnx"))
        settings = " ".join(str(path.relative_to(folder)) for path in sorted((folder / target).rglob("*.yaml")))
        if networks:
            words = f"--robot saturn_lite {f'--settings {settings}' if settings else ''}"
            corpus.run(f"import-{target}", f"import {networks[0].relative_to(folder)} {words} --out from-{target}")
            corpus.run(f"import-{target}-verify", f"verify from-{target}")
    corpus.run("new-key", "sign --new-key random.pem")
    corpus.file("new-key/random.pub", folder / "random.pub")
    key(folder / "maker.pem")
    shutil.copytree(CHECKOUT / "tests/data/walker", folder / "mine")
    corpus.run("sign", "sign mine --key maker.pem")
    corpus.file("sign/SHA256SUMS.sig", folder / "mine/SHA256SUMS.sig")
    corpus.run("verify-key", "verify mine --key maker.pub")
    corpus.run("verify-unsigned", f"verify {NONE} --key maker.pub")
    (folder / "mine/card.md").write_text("altered\n")
    corpus.run("verify-altered", "verify mine")


def key(path: Path) -> None:
    """Write a fixed key pair, as PEM."""
    from cryptography.hazmat.primitives import serialization as s
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

    private = Ed25519PrivateKey.from_private_bytes(bytes(range(32)))
    path.write_bytes(private.private_bytes(s.Encoding.PEM, s.PrivateFormat.PKCS8, s.NoEncryption()))
    path.chmod(0o600)
    public = private.public_key().public_bytes(s.Encoding.PEM, s.PublicFormat.SubjectPublicKeyInfo)
    path.with_suffix(".pub").write_bytes(public)


def training(corpus: Corpus) -> None:
    """Train each method for an iteration, export one run, and go on with it."""
    tiny = "--num-envs 16 --teacher.iterations 1 --video-every 0 --friction-level 0.2"
    for method in METHODS:
        preset = "--preset two-phase --student.iterations 1" if method == "direct" else "--preset quick"
        corpus.run(method, f"train {preset} --method {method} {tiny} --out {method}")
    corpus.run("export", "export deception --out bundle")
    corpus.run("resume", "train --resume deception --teacher.iterations 2")
    corpus.file("resume/config.json", corpus.folder / "deception/config.json")


def ground(corpus: Corpus) -> None:
    """Train on stairs, on another robot, with an identified range, and with the plastic slider."""
    tiny = "--preset quick --num-envs 16 --teacher.iterations 1 --video-every 0"
    logs.text(corpus.folder / "log.csv", logs.simulate(logs.Joint(), 1))
    corpus.run("identify", f"identify log.csv {logs.FLAGS} --out out", quiet=True)
    corpus.run("stairs", f"train {tiny} --terrain stairs --friction-level 0.2 --out stairs")
    corpus.run("identified", f"train {tiny} --robot go2 --friction-from out/training.json --json --out identified")
    corpus.run("plastic", f"train {tiny} --physics plastic --friction-law stribeck --friction-level 0.1 --out plastic")


def run_logs(corpus: Corpus) -> None:
    """Deploy on the virtual robot, in real time: the layout of its report and log."""
    words = f"deploy {DECEPTION} --robot virtual --armed --command vx=0.3 --duration 2 --stale 0.5 --silence 2"
    for _ in range(3):  # A busy machine ends a run in real time too soon.
        if corpus.run("walk", f"{words} --out run", moving=True) == 0:
            return
        shutil.rmtree(corpus.folder / "run")


def demo(corpus: Corpus) -> None:
    """Make the page of the demo, short."""
    corpus.run("page", "demo --episodes 1 --seconds 3 --out demo")


def studies(corpus: Corpus) -> None:
    """Run a study short: the conformance of the engines."""
    corpus.run("engines", "study engines --no-walks --jobs 1 --out engines")


def old(corpus: Corpus) -> None:
    """Read older bundles, as git has them."""
    packed = subprocess.run(["git", "archive", OLD, *OLD_BUNDLES], cwd=CHECKOUT, capture_output=True, check=False)
    if packed.returncode:
        print(f"old: this clone has no revision {OLD}, nothing made", file=sys.stderr)
        return
    subprocess.run(["tar", "x"], cwd=corpus.folder, input=packed.stdout, check=True)
    for name in OLD_BUNDLES:
        corpus.run(f"verify-{name.replace('/', '-')}", f"verify {name}")
    corpus.run("evaluate-walker", "evaluate tests/data/walker --friction-levels 0 --commands vx=0.5 --seconds 3 "
               "--episodes 2 --jobs 1 --out walker")  # fmt: skip


PARTS = {
    "help": Part(helps),
    "api": Part(api),
    "wrong": Part(wrong),
    "identify": Part(identify),
    "measured": Part(measured),
    "walks": Part(walks),
    "rows": Part(rows),
    "convert": Part(convert),
    "robots": Part(robots),
    "bundles": Part(bundles),
    "training": Part(training),
    "ground": Part(ground, long=True),
    "run": Part(run_logs),
    "demo": Part(demo),
    "studies": Part(studies, long=True),
    "old": Part(old),
}
"""Part -> its commands."""
