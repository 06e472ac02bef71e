"""Compare the task on the device with the task on the host, both on a GPU, in the mean over robots.

    python tools/gpu_agreement.py cuda 2048 > agreement.json

The two draw from different generators and a GPU adds up in any order, so no robot has a twin. The same number of robots
take random actions for `STEPS` control steps in both. Of every entry of every observation group, at three moments, and
of every robot's sum of rewards and number of ends: the difference of the means, and of the means of squares, by its
standard error. One JSON object: how many numbers were compared, how many of those are the same in every robot, the
largest |z|, how many are above 4, the names of the worst, and each task's means of the logged figures.

`chance` is the share of equal tasks in which one or more of that many numbers have a |z| of the largest or more: at
most, since it is the sum over the numbers, and so holds for those that depend on each other too. A history repeats its
frames, and so does its next look. What it cannot see: a difference smaller than some standard errors, and one that
leaves every entry's mean and mean square, such as two joints of one kind that changed places.
"""

from __future__ import annotations

import argparse
import json
import math

import torch
from gpu_throughput import make_robots

STEPS = 120
LOOKED_AT = (20, 60, 120)
WRONG = 1e6
"""In place of a |z| where there is none: JSON has no infinity."""


def walked(device: str, robots: int, on_host: bool) -> tuple[dict[str, torch.Tensor], dict[str, float]]:
    """Return samples by name, each (robots, entries), and the means of the logged figures."""
    env = make_robots(device, robots, on_host, seed=int(on_host))
    generator = torch.Generator(env.device).manual_seed(7 + on_host)
    rewards, ends = torch.zeros(robots, device=env.device), torch.zeros(robots, device=env.device)
    samples: dict[str, torch.Tensor] = {}
    logged: dict[str, list[float]] = {}
    for step in range(1, STEPS + 1):
        # For half of the time they thrash, so that some fall.
        wild = 1.5 if step % 40 > 20 else 0.3
        actions = wild * torch.randn(robots, env.num_actions, device=env.device, generator=generator)
        observation, reward, dones, extras = env.step(actions)
        rewards += reward
        ends += dones
        for name, value in extras["log"].items():
            logged.setdefault(name, []).append(float(value))
        if step in LOOKED_AT:
            samples |= {f"{name}@{step}": value.double().cpu().flatten(1) for name, value in observation.items()}
    samples |= {"reward": rewards.double().cpu()[:, None], "ends": ends.double().cpu()[:, None]}
    return samples, {name: sum(values) / len(values) for name, values in logged.items()}


def compare(one: dict[str, torch.Tensor], other: dict[str, torch.Tensor]) -> dict[str, object]:
    """Return the figures of two samples of the same names."""
    scores: list[tuple[float, str]] = []
    same = 0
    for name, first in one.items():
        second = other[name]
        for power in (1, 2):
            a, b = first**power, second**power
            error = ((a.var(0) + b.var(0)) / len(a)).sqrt()
            gap = (a.mean(0) - b.mean(0)).abs()
            # What is the same number in every robot must be the same in both; what is no number is never.
            z = torch.where(error > 1e-9, gap / error.clamp(min=1e-9), torch.where(gap > 1e-6, WRONG, 0.0))
            z = torch.where((error + gap).isfinite(), z, WRONG)
            same += int((error <= 1e-9).sum())
            scores += [(float(value), f"{name}[{k}]^{power}") for k, value in enumerate(z)]
    scores.sort(reverse=True)
    return {
        "compared": len(scores),
        "same_in_every_robot": same,
        "chance": round(min(1.0, (len(scores) - same) * math.erfc(scores[0][0] / math.sqrt(2))), 3),
        "largest_z": round(scores[0][0], 2),
        "above_4": sum(z > 4 for z, _ in scores),
        "worst": [f"{name}: {z:.1f}" for z, name in scores[:8]],
    }


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("device", help="of MuJoCo Warp and torch, such as cuda")
    parser.add_argument("robots", type=int, help="robots that walk on each side")
    asked = parser.parse_args()
    host, on_host = walked(asked.device, asked.robots, on_host=True)
    own, on_device = walked(asked.device, asked.robots, on_host=False)
    figures = {name: [round(on_host[name], 5), round(on_device[name], 5)] for name in on_host}
    print(json.dumps({"robots": asked.robots, **compare(host, own), "host_and_device": figures}))


if __name__ == "__main__":
    main()
