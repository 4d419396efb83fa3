# SPDX-License-Identifier: MIT
"""Measure other simulators and compilers, with the Python of build/bench/venv.

Reads {"scenarios": {name: {"theta": rad per count, "moves": [...], "exact": [...]}}, "sigma0",
"Fc", "solved": ticks for solvers} from standard input. The last line of the output is {rival:
{"scenarios": {name: [worst, rms]}, "ns": per tick, median of the motions, "ticks"} or {"missing":
reason}}. Each simulator runs as its documentation describes: one step per tick, from Python. numba
and JAX compute all ticks in one call. A time is the least of 5 runs after one that compiles.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from functools import partial
from statistics import median
from typing import Any

import log_rivals

Task = dict[str, Any]  # parsed JSON, see above
Way = Callable[[Task], Any]  # from a scenario to F/Fc after each tick
SAMPLE = 0.001  # [s] between ticks, for simulators with time; Dahl's model is independent of time
ROUNDS = 5  # timed runs of each scenario


def mujoco_way(task: Task) -> Way:
    """Use dcmotor with lugre="sigma0 0 Fc Fc 1": exact if the speed is constant in a step."""
    import mujoco

    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco>
        <option timestep="{SAMPLE}" gravity="0 0 0"><flag constraint="disable"/></option>
        <worldbody><body>
        <joint name="shaft" type="hinge"/><geom size="0.1" mass="1"/>
        </body></worldbody>
        <actuator><dcmotor joint="shaft" motorconst="1 1" resistance="1" input="none"
        lugre="{task["sigma0"]} 0 {task["Fc"]} {task["Fc"]} 1"/></actuator>
        </mujoco>"""
    )
    data = mujoco.MjData(model)

    def run(scenario: Task) -> list[float]:
        mujoco.mj_resetData(model, data)
        scale, result = scenario["theta"] / SAMPLE, []
        stiffness = task["sigma0"] / task["Fc"]
        for move in scenario["moves"]:
            data.qvel[0] = move * scale
            mujoco.mj_step(model, data)
            result.append(data.act[0] * stiffness)
        return result

    return run


def newton_way(task: Task) -> Way:
    """Use _advance_dahl_axis of the rod solver: all ticks in one kernel on the CPU."""
    import numpy as np
    import warp as wp
    from outside_newton import advance

    def run(scenario: Task) -> Any:
        angles = (scenario["array"] * scenario["theta"]).astype(np.float32)
        moves = wp.array(angles, dtype=float, device="cpu")
        out = wp.empty(len(angles), dtype=float, device="cpu")
        inputs = [moves, out, task["Fc"], task["Fc"] / task["sigma0"]]
        wp.launch(advance, dim=1, inputs=inputs, device="cpu")
        return out.numpy().astype(float) / task["Fc"]

    return run


def scipy_way(task: Task) -> Way:
    """Use solve_ivp on Eq. 1, one tick at a time, with tolerances 1e-9. A travel above 40 is cut,
    because the solver would not end.
    """
    from scipy.integrate import solve_ivp

    a = task["sigma0"] / task["Fc"]

    def run(scenario: Task) -> list[float]:
        w, result = 0.0, []
        for move in scenario["moves"][: task["solved"]]:
            s, u = (1.0 if move > 0 else -1.0), min(a * abs(move) * scenario["theta"], 40.0)

            def slope(_: float, w: Any, s: float = s) -> Any:
                return s - w

            if u > 0:
                w = solve_ivp(slope, (0, u), [w], rtol=1e-9, atol=1e-9).y[0, -1]
            result.append(float(w))
        return result

    return run


def numba_way(task: Task) -> Way:
    import numpy as np

    torques = log_rivals.numba_loop()

    def run(scenario: Task) -> Any:
        out = np.empty(len(scenario["array"]), np.float32)
        torques(scenario["array"], scale_of(task, scenario), task["Fc"], out)
        return out.astype(float) / task["Fc"]

    return run


def jax_way(dtype: str, task: Task) -> Way:
    import numpy as np

    torques = log_rivals.jax_scan(dtype)

    def run(scenario: Task) -> Any:
        found = torques(scenario["array"], scale_of(task, scenario), task["Fc"])
        return np.asarray(found, float) / task["Fc"]

    return run


def scale_of(task: Task, scenario: Task) -> float:
    return float(task["sigma0"] / task["Fc"] * scenario["theta"])


WAYS: dict[str, Callable[[Task], Way]] = {
    "mujoco": mujoco_way,
    "newton": newton_way,
    "scipy": scipy_way,
    "numba": numba_way,
    "jax_float": partial(jax_way, "float32"),
    "jax_double": partial(jax_way, "float64"),
}


def errors(got: Any, exact: list[float]) -> list[float]:
    differences = [abs(float(x) - y) for x, y in zip(got, exact, strict=False)]
    return [max(differences), (sum(d * d for d in differences) / len(differences)) ** 0.5]


def time_run(run: Way, scenario: Task) -> tuple[float, Any]:
    """Return ns of a tick and the result."""
    start = time.perf_counter()
    got = run(scenario)
    return (time.perf_counter() - start) / len(got) * 1e9, got


def measure(make: Callable[[Task], Way], task: Task) -> dict[str, Any]:
    run = make(task)
    result, ticks, times = {}, 0, []
    for name, scenario in task["scenarios"].items():
        run(scenario)  # compiles, which must not be timed
        rounds = [time_run(run, scenario) for _ in range(ROUNDS)]
        times.append(min(ns for ns, _ in rounds))
        got = rounds[0][1]
        ticks += len(got)
        result[name] = errors(got, scenario["exact"])
    return {"scenarios": result, "ns": median(times), "ticks": ticks}


def read_task() -> Task:
    import numpy as np

    task: Task = json.load(sys.stdin)
    for scenario in task["scenarios"].values():
        scenario["array"] = np.array(scenario["moves"], np.int32)
    return task


def main() -> int:
    task = read_task()
    result = {}
    for name, make in WAYS.items():
        print(f"outside: {name}", file=sys.stderr, flush=True)
        try:
            result[name] = measure(make, task)
        except Exception as error:  # any failure of a package is reported as missing
            result[name] = {"missing": f"{type(error).__name__}: {error}".splitlines()[0]}
    print(json.dumps(result))
    return 0


if __name__ == "__main__":
    sys.exit(main())
