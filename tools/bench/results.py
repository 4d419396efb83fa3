# SPDX-License-Identifier: MIT
"""Compute results.json from target.json and host.json.

Each method has a cost and an error on each core and motion. A cost is instructions (or cycles) per
tick on a core, ns per tick on the host. The results also list which of our methods another method
beats, and the ratios of speed.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import prod
from typing import Any

JUMPS = (
    "leap_14"  # giant jumps: a solver of Eq. 1 cannot follow them, so they are reported separately
)
CORES = ("m0", "m3", "m4f")
SAME = 0.95  # errors within 5 % count as equal: both are the rounding of the result


@dataclass(frozen=True)
class Way:
    """A method to compute the torque: its key in the two files, and its title."""

    key: str
    title: str
    ours: bool = False
    on_target: bool = True
    on_host: bool = True


WAYS = (
    Way("counts_q30", "`dahl_step_counts_q30`", ours=True, on_host=False),
    Way("counts", "`dahl_step_counts`", ours=True, on_host=False),
    Way("angle", "`dahl_step`", ours=True, on_host=False),
    Way("batch_counts", "`dahl_batch_counts`", ours=True, on_target=False),
    Way("throughput_counts", "`dahl_throughput_counts`", ours=True, on_target=False),
    Way("throughput_angle", "`dahl_throughput`", ours=True, on_target=False),
    Way("expm1f", "`expm1f` step"),
    Way("core_math", "CORE-MATH `cr_expm1f` step", on_target=False),
    Way("expf", "`1 - expf` step"),
    Way("exp_double", "`1 - exp` (double) step"),
    Way("expm1_double", "`expm1` (double) step"),
    Way("double_state", "`expm1` step, state in double", on_target=False),
    Way("vector_exp", "vector `exp` of glibc, serial loop in double", on_target=False),
    Way("sleef", "vector `expm1` of SLEEF, serial loop in double", on_target=False),
    Way("anchored", "Eq. 18, anchored at each reversal"),
    Way("direct", "Eqs. 7, 18, 27, one running exponent"),
    Way("table", "table of g(u), interpolated"),
    Way("table_counts", "table of g by counts, float state"),
    Way("euler", "forward Euler"),
    Way("rk4", "RK4"),
    Way("backward", "backward Euler"),
    Way("trapezoid", "trapezoid"),
)
HOST_KEY = {"backward": "backward_parts", "trapezoid": "trapezoid_parts"}
SOLVERS = {"euler": "forward Euler", "rk4": "RK4", "backward": "backward Euler"}
SOLVERS["trapezoid"] = "trapezoid"


@dataclass(frozen=True)
class Point:
    """One method on one core: cost and error by motion."""

    key: str
    title: str
    ours: bool
    cost: dict[str, float]
    error: dict[str, float]

    def mean_cost(self) -> float:
        return mean([self.cost[name] for name in self.cost if name != JUMPS])

    def worst(self) -> float:
        return max(self.error[name] for name in self.error if name != JUMPS)


def mean(values: list[float]) -> float:
    return sum(values) / len(values)


def errors_of(host: dict[str, Any], key: str) -> dict[str, float]:
    name = HOST_KEY.get(key, key)
    return {scenario: ways[name][0] for scenario, ways in host["errors"].items()}


def in_cycles(target: dict[str, Any]) -> dict[str, Any]:
    """Return the cores whose cycles are known, with cycles as the cost of a motion."""
    return {
        name: core | {"motions": core["motion_cycles"]}
        for name, core in target.items()
        if "motion_cycles" in core
    }


def motions_of(target: dict[str, Any], core: str) -> dict[str, dict[str, float]]:
    """Return the costs by motion and method, with newlib if it was counted."""
    counted = target[core]["motions"]
    found: dict[str, dict[str, float]] = counted.get("newlib") or counted["picolibc"]
    return found


def parts_cost(counted: dict[str, float], solver: str, parts: int) -> float:
    """Return the cost with this number of parts, on the line through 9 and 17 parts."""
    nine, seventeen = (counted[f"{solver}_parts_{n}"] for n in (9, 17))
    return nine + (parts - 9) * (seventeen - nine) / 8


def solver_points(target: dict[str, Any], host: dict[str, Any], core: str) -> list[Point]:
    points = []
    for entry in host["parts"]:
        solver = entry["way"].removesuffix("_parts")
        if entry["parts"] > 1:
            cost = {
                name: parts_cost(counted, solver, entry["parts"])
                for name, counted in motions_of(target, core).items()
            }
            title = f"{SOLVERS[solver]}, {entry['parts']} parts"
            points.append(Point(f"{solver}_{entry['parts']}", title, False, cost, entry["worst"]))
    return points


def core_points(target: dict[str, Any], host: dict[str, Any], core: str) -> list[Point]:
    counted = motions_of(target, core)
    points = [
        Point(
            way.key,
            way.title,
            way.ours,
            {name: ways[way.key] for name, ways in counted.items()},
            errors_of(host, way.key),
        )
        for way in WAYS
        if way.on_target
    ]
    return points + solver_points(target, host, core)


def host_points(host: dict[str, Any]) -> list[Point]:
    points = []
    for way in WAYS:
        name = HOST_KEY.get(way.key, way.key)
        if way.on_host and name in host["errors"][JUMPS]:  # SLEEF and CORE-MATH may be missing
            cost = {scenario: ways[name] for scenario, ways in host["speed"].items()}
            points.append(Point(way.key, way.title, way.ours, cost, errors_of(host, way.key)))
    for name, entry in host["outside"].items():
        if "missing" not in entry:
            error = {scenario: pair[0] for scenario, pair in entry["scenarios"].items()}
            cost = dict.fromkeys(error, entry["ns"])
            points.append(Point(name, OUTSIDE[name], False, cost, error))
    return points


OUTSIDE = {
    "mujoco": "MuJoCo `dcmotor`",
    "newton": "Newton's Dahl axis, float (dead band: within 1e-6 rad the direction stays)",
    "scipy": "SciPy `solve_ivp`",
    "numba": "numba loop, state in double",
    "jax_float": "JAX `associative_scan`, float",
    "jax_double": "JAX `associative_scan`, double",
}


def find_dominated(points: list[Point], core: str) -> list[dict[str, Any]]:
    """Return each of our points that another method beats in cost and error, by motion."""
    found = []
    for our in (p for p in points if p.ours):
        for rival in (p for p in points if not p.ours):
            for motion in sorted(our.cost.keys() & rival.cost.keys() & rival.error.keys()):
                cheaper = rival.cost[motion] < our.cost[motion]
                if cheaper and rival.error[motion] < SAME * our.error[motion]:
                    found.append(
                        {"core": core, "motion": motion, "ours": our.key, "rival": rival.key}
                    )
    return found


def ratios(host: dict[str, Any]) -> dict[str, float]:
    """Return how many times faster than the expm1f loop a tick is: geometric mean over motions."""
    speed = host["speed"]

    def over(way: str, least: bool = False) -> float:
        each: list[float] = [ways["expm1f"] / ways[way] for ways in speed.values()]
        return min(each) if least else prod(each) ** (1 / len(each))

    names = {
        "bitwise_counts_x": "batch_counts",
        "throughput_angle_x": "throughput_angle",
        "throughput_counts_x": "throughput_counts",
        "throughput_channels16_x": "throughput_counts_16",
        "throughput_channels16_apart_x": "throughput_counts_16_apart",
        "throughput_angle_channels16_x": "throughput_angle_16",
    }
    result = {key: over(way) for key, way in names.items()}
    result |= {f"{key}_least": over(way, least=True) for key, way in names.items()}
    for threads, ns in host.get("threads", {}).items():
        result[f"threads_{threads}_x"] = host["threads"]["1"] / ns
    return {key: round(value, 2) for key, value in result.items()}


def distances(host: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Return the time of each way over that of a plain copy of the arrays: `mean` is geometric,
    over the motions, `most` is that of the worst motion.
    """
    speed = host["speed"]
    found = {}
    for way in speed[JUMPS]:
        each = {motion: ways[way] / ways["copy"] for motion, ways in speed.items()}
        motion = max(each, key=lambda name: each[name])
        average = prod(each.values()) ** (1 / len(each))
        ns = mean([ways[way] for ways in speed.values()])
        found[way] = {"ns": ns, "mean": average, "most": each[motion], "motion": motion}
    return found


def combine(target: dict[str, Any], host: dict[str, Any]) -> dict[str, Any]:
    points = {core: core_points(target, host, core) for core in CORES if core in target}
    points["host"] = host_points(host)
    listed = {
        core: {
            p.key: {"ours": p.ours, "cost": round(p.mean_cost(), 2), "worst": p.worst()} for p in ps
        }
        for core, ps in points.items()
    }
    return {
        "host": ratios(host),
        "copies": distances(host),
        "dominated": [d for core, ps in points.items() for d in find_dominated(ps, core)],
        "missing": {k: e["missing"] for k, e in host["outside"].items() if "missing" in e},
        "points": listed,
        "python": host["python"],
        "calls": host["calls"],
        "machine": {key: host[key] for key in ("cpu", "compiler", "quick", "ticks")},
    }
