"""The observation layout of `formats.observation`, built batched in torch. `deploy` builds the same in NumPy."""

from __future__ import annotations

import torch

from stiction.files.observation import PLACEHOLDERS, SLOW_TERMS, ObservationLayout


def roll_pitch(quaternion: torch.Tensor) -> torch.Tensor:
    """Return roll and pitch [rad], shape (N, 2), of base orientations w, x, y, z, shape (N, 4)."""
    w, x, y, z = quaternion.unbind(-1)
    roll = torch.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    # Rounding may lead out of asin's domain, and a robot on end would measure NaN.
    pitch = torch.asin((2 * (w * y - z * x)).clamp(-1.0, 1.0))
    return torch.stack((roll, pitch), -1)


class FrameBuilder:
    """Concatenates one frame from named raw quantities: clip((raw - offset) * scale)."""

    def __init__(self, layout: ObservationLayout, standing: torch.Tensor) -> None:
        """Precompute scale, offset and clip of every entry. `standing`: (joints,) [rad]."""
        self.layout, self.home = layout, standing.device
        self.scale = torch.cat([torch.tensor(term.scales) for term in layout.terms]).float().to(self.home)
        self.clip = torch.cat([torch.tensor(term.clips) for term in layout.terms]).float().to(self.home)
        zero = torch.zeros_like(standing[:1])
        self.offset = torch.cat(
            [standing if term.offset == "standing" else zero.expand(term.size) for term in layout.terms]
        ).float()

    def __call__(self, raw: dict[str, torch.Tensor]) -> torch.Tensor:
        """Return the frame, shape (N, frame_size). `raw`: every term but the placeholders, each (N, size), float32."""
        num = next(iter(raw.values())).shape[0]
        parts = [
            torch.zeros(num, t.size, device=self.home) if t.name in PLACEHOLDERS else raw[t.name]
            for t in self.layout.terms
        ]
        frame = (torch.cat(parts, -1) - self.offset) * self.scale
        return torch.minimum(torch.maximum(frame, -self.clip), self.clip)


class History:
    """The last frames, oldest first. `push` returns a fresh tensor: the caller's stored ones never change."""

    def __init__(self, num_envs: int, layout: ObservationLayout, home: torch.device | None = None) -> None:
        """Start with zeros, at `home`; every robot is reset before its first observation."""
        self.frames = torch.zeros(num_envs, layout.history_length, layout.frame_size, device=home)

    def push(self, frame: torch.Tensor, fresh: torch.Tensor) -> torch.Tensor:
        """Append `frame`, (N, frame_size); where `fresh`, (N,) bool, fill the history with it. Returns (N, size)."""
        self.frames = torch.cat((self.frames[:, 1:], frame[:, None]), 1)
        # On a GPU nobody waits to learn which ones there are.
        if fresh.is_cuda:
            self.frames = torch.where(fresh[:, None, None], frame[:, None], self.frames)
        elif len(ids := fresh.nonzero().flatten()):
            self.frames[ids] = frame[ids, None]
        return self.frames.flatten(1)


class SlowMeans:
    """Means of products of error and velocity that tell a joint's dry friction, see `SLOW_TERMS`."""

    def __init__(self, num_envs: int, num_joints: int, decay: float, home: torch.device | None = None) -> None:
        """Start with nothing, at `home`; `decay`: see `ObservationLayout.slow_kept`."""
        self.decay = decay
        # In float64, as on the robot: a mean goes on from its own rounding, and x_i may be large once.
        self.sums = torch.zeros(num_envs, len(SLOW_TERMS), num_joints, dtype=torch.float64, device=home)
        """Σ k^(t-i) x_i."""
        self.weight = torch.zeros(num_envs, 1, dtype=torch.float64, device=home)
        """Σ k^(t-i)."""

    def push(self, error: torch.Tensor, velocity: torch.Tensor, fresh: torch.Tensor) -> dict[str, torch.Tensor]:
        """Take in a frame and return the means by term, each (N, joints), float32.

        `error`: of the last target [rad], `velocity` [rad/s], (N, joints); where `fresh`, (N,) bool, what was before is
        forgotten.
        """
        products = torch.stack((error.abs(), velocity.abs(), error * velocity), 1)
        self.sums = products + torch.where(fresh[:, None, None], 0.0, self.decay * self.sums)
        self.weight = 1.0 + torch.where(fresh[:, None], 0.0, self.decay * self.weight)
        return dict(zip(SLOW_TERMS, (self.sums / self.weight[..., None]).float().unbind(1), strict=True))
