"""Simulation of dry friction in MuJoCo, in two ways, as data. Without mujoco.

`rows`: each joint has a row in the constraint solver, bounded by the friction. Below the bound the joint creeps, by the
row's impedance (see `FRICTION_D0`). All evaluations use these.

`plastic`: each joint hangs on a spring of `stiffness` k that yields, an elastoplastic slider (Prandtl's element). With
p the angle at which the spring is slack:

  τ = -k (q - p),   and p follows q as soon as |q - p| would exceed f/k.

Its torque is bounded by exactly f, and below the bound the joint yields by τ/k and swings, damped only by the motor,
instead of creeping. No solver row is needed, which makes a physics step nearly twice as fast. The spring is explicit:
steps of h need k h² well below four times the inertia that a joint moves, or it breaks away too early, and beyond
chatters within ±f (`robots.sliders`). Contacts and limits, which sliders leave to the solver, are as exact as its
iterations are many: ten of PGS have not converged, and do not even commute with the robot's mirror to rounding.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Literal, get_args

from stiction.core.effects import needs
from stiction.core.errors import ConfigurationError, unknown_name
from stiction.core.flags import FLAG, flag

FrictionPhysics = Literal["rows", "plastic", "plastic-first"]
"""Ways to simulate friction, see above; `plastic-first`: sliders in most of a training, and rows at its end."""

ROWS_FROM = 0.6
"""Share of the first phase of a training after which rows replace sliders, for `plastic-first`."""

Solver = Literal["newton", "pgs"]

SOLVERS: dict[FrictionPhysics, tuple[Solver, int]] = {
    "rows": ("newton", 100),
    "plastic": ("pgs", 10),
    "plastic-first": ("newton", 10),
}
"""Default solver and maximum iterations. Newton needs five or so on rows; PGS takes all that it is given. Two policies
that had learned on ten sweeps of it stood still in places where one of Newton did not (results/following)."""

STIFFNESSES = (1.0, 1e6)
"""Range of a slider's stiffness [N m/rad]: below it no joint of a legged robot would stick, above it steps of some
microseconds are needed."""

MOST_ITERATIONS = 10_000
"""Upper bound of the solver's maximum iterations."""

FRICTION_D0 = 0.999
"""Impedance of the dry-friction constraint. Below its limit a joint creeps at (τ/J)(1 - d0)/d0 · timeconst/2.
With a time constant of two steps that is some thousandths of a rad/s; with MuJoCo's default of 0.9, which simulates
faster, a hundred times more."""


def friction_row(timestep: float, impedance: float = FRICTION_D0) -> tuple[tuple[float, float], tuple[float, ...]]:
    """Return `solref` and `solimp` of the stiffest row of dry friction at a physics step [s].

    MuJoCo raises a time constant below two steps to that (refsafe).
    """
    return (2 * timestep, 1.0), (impedance, impedance, 0.001, 0.5, 2)


LEAST_ITERATIONS, LEAST_LS_ITERATIONS = 20, 50
"""Minimum budget of MuJoCo's solver, and of its line search, at which such rows hold a loaded joint. At 10 and 20 a
joint under 0.8 of its friction turned 0.2 rad in 2 s, at 10 and 30 0.001; on the ground it takes 20 and 50."""

CONTACT_TIME = 0.02
"""Default time constant of the contact of feet and ground [s]: MuJoCo's, softer than PhysX and ODE."""

SMALLEST_YIELD = 1e-9
"""Yield of a joint without friction [rad]: MuJoCo takes 0 for a spring that never yields."""


@dataclass(frozen=True)
class PhysicsCfg:
    """Dry friction and constraint solver of a simulation; the default is what evaluation has."""

    friction: Annotated[FrictionPhysics, flag("--physics")] = "rows"
    """Simulation of joint friction. rows: by constraints of the solver; plastic: by sliders, twice as fast, for
    training only; plastic-first: by sliders in the first 60 % of a training's first phase, then by rows."""
    impedance: float = field(default=FRICTION_D0, metadata=needs("--physics rows"))
    """Impedance d0 of the rows, below 1 [1]: the nearer, the less a held joint creeps."""
    stiffness: Annotated[float, FLAG] = field(default=1000.0, metadata=needs("--physics plastic or plastic-first"))
    """Stiffness k of the slider [N m/rad]. A training warns where it is too stiff for its step."""
    solver: Annotated[Solver | None, FLAG] = None
    """Solver of contacts, limits and rows; by default Newton, for `plastic` PGS."""
    iterations: int | None = None
    """Maximum iterations of the solver in a physics step; by default 100 for `rows`, else 10."""

    def __post_init__(self) -> None:
        """Validate the values."""
        for name, value, names in (
            ("friction", self.friction, get_args(FrictionPhysics)),
            ("solver", self.solver or "newton", get_args(Solver)),
        ):
            if value not in names:
                raise ConfigurationError(unknown_name(f"physics.{name}", value, names))
        if not 0 < self.impedance < 1:
            raise ConfigurationError(f"physics.impedance is {self.impedance}; expected a number in (0, 1)")
        soft, stiff = STIFFNESSES
        if not soft <= self.stiffness <= stiff or not 1 <= self.solver_iterations <= MOST_ITERATIONS:
            raise ConfigurationError(
                f"physics: stiffness {self.stiffness} N m/rad, {self.solver_iterations} iterations; "
                f"expected a stiffness in [{soft:g}, {stiff:g}] and 1 to {MOST_ITERATIONS} iterations"
            )
        if self.friction == "rows" and self.solver_name != "newton":
            raise ConfigurationError(
                f"physics.solver {self.solver!r} does not converge on rows of joint friction; "
                "use it with --physics plastic"
            )

    @property
    def plastic(self) -> bool:
        """True if the joints hang on sliders, at least at first."""
        return self.friction != "rows"

    @property
    def at_last(self) -> PhysicsCfg:
        """Physics at the end of a training."""
        return EXACT if self.friction == "plastic-first" else self

    @property
    def solver_name(self) -> Solver:
        """Name of the solver, the default included."""
        return self.solver or SOLVERS[self.friction][0]

    @property
    def solver_iterations(self) -> int:
        """Maximum iterations, the default included."""
        return SOLVERS[self.friction][1] if self.iterations is None else self.iterations


def budget_objection(iterations: int, ls_iterations: int) -> str | None:
    """Return the fault of a budget of MuJoCo's solver for rows of dry friction, or None."""
    if iterations >= LEAST_ITERATIONS and ls_iterations >= LEAST_LS_ITERATIONS:
        return None
    return (
        f"with iterations {iterations} and ls_iterations {ls_iterations} MuJoCo's solver lets joints slip below their "
        f"dry friction; expected at least {LEAST_ITERATIONS} and {LEAST_LS_ITERATIONS}"
    )


EXACT = PhysicsCfg()
"""Physics of evaluation and of every claim."""

FAST = PhysicsCfg("plastic")
"""Fastest physics for training: sliders, and ten iterations of PGS for the contacts."""
