# SPDX-License-Identifier: MIT
"""tools/bench.sh report and docs place each number in its row, column and page. All numbers of the
made-up run are different.
"""

from __future__ import annotations

import os
import re

import numpy as np
import pytest
from bench_tools import (
    CALLS,
    DIRECTED,
    HOST_NAMES,
    JUMPS,
    KEYS,
    MOTIONS,
    PAGES,
    RIVALS,
    SMALL,
    Bench,
    block_of,
    made_host,
    made_target,
    rows_of,
)
from conftest import ROOT

TOP = 3.0  # larger errors are shown as diverging


@pytest.fixture(scope="module")
def docs(tmp_path_factory):
    bench = Bench(tmp_path_factory.mktemp("bench"))
    bench.put(target=made_target(), host=made_host())
    done = bench.run("report", "--docs")
    assert done.code == 0 and "tribometer" in done.out, done.err
    return bench


@pytest.fixture
def bench(tmp_path) -> Bench:
    bench = Bench(tmp_path)
    bench.put(target=made_target(), host=made_host())
    return bench


# Words that the title of a row must have, by the words of its key.
IN_TITLE = {word: word for word in """prepare slip parallel work tip newlib picolibc
    expm1f expf double euler rk4 code const static plan state stack between below units control
    reversal jump q30 1000 worst table""".split()}  # fmt: skip
IN_TITLE |= {name: name for name in DIRECTED}
IN_TITLE |= {
    "c": "by the c",
    "eight": "8",
    "encoder": "reading",
    "float": "n m",
    "loaded": "load",
    "one": "one count",
    "set": "set_torque",
    "zero": "no motion",
}


def test_each_count_is_in_its_row_and_core(docs):
    target = made_target()
    block = docs.block("docs/microcontroller.md", "target")
    cores, rows = rows_of(block)
    assert cores == [core["core"] for core in target.values()]
    keys = {tuple(str(c.get(key, "-")) for c in target.values()): key for key in KEYS}
    assert len(rows) > 60
    assert len({keys[tuple(cells)] for cells in rows.values()}) == len(rows)
    for title, cells in rows.items():
        words = {IN_TITLE[word] for word in keys[tuple(cells)].split("_") if word in IN_TITLE}
        words -= {"q30"} if "the same" in title else set()
        assert all(word in title.lower() for word in words), (title, words)
    for name, core in target.items():
        assert re.search(rf"{core['core']} `__help_{name}` \(.*?: no function\)", block)


IN_WAY = {"angle": "`dahl_step`", "direct": "one running exponent"}


def slow(values: dict) -> list[float]:
    """Return the values of all motions but the giant jumps."""
    return [value for motion, value in values.items() if motion != JUMPS]


def test_each_method_has_its_errors_and_mean_cost(docs):
    """Errors are of the host, costs of the small cores with newlib."""
    target, host = made_target(), made_host()
    counted = [target[core]["motions"]["newlib"] for core in SMALL]
    costs = {way: [{m: c[m][way] for m in MOTIONS} for c in counted] for way in (*CALLS, *RIVALS)}
    errors = {
        way: {m: host["errors"][m][HOST_NAMES.get(way, way)][0] for m in MOTIONS} for way in costs
    }
    costs["rk4_25"] = [  # 25 parts: as far from 17 as 9 is
        {m: 2 * ways["rk4_parts_17"] - ways["rk4_parts_9"] for m, ways in c.items()}
        for c in counted
    ]
    errors["rk4_25"] = dict.fromkeys(MOTIONS, 3e-7)
    block = docs.block("docs/speed.md", "ways")
    head, rows = rows_of(block)
    assert head[2:] == ["Core m0", "Core m3", "Core m4f"] and len(rows) == len(costs)
    titles = {tuple(cells): title for title, cells in rows.items()}
    for way, error in errors.items():
        shown = [max(slow(error)), error[JUMPS]]
        cells = ["diverges" if x > TOP else f"{x:.0e}" for x in shown]
        cells += [f"{np.mean(slow(cost)):.0f}" for cost in costs[way]]
        title = titles[tuple(cells)]
        assert title.startswith("**") == (way in CALLS)
        assert IN_WAY.get(way, way.split("_")[0]) in title.lower()
    assert "**`dahl_step_counts`**" in rows and "RK4, 25 parts" in rows
    assert re.search(r"4096 .*: backward Euler 1e-06, trapezoid 1e-03\.$", block, re.M)


def test_the_ratios_are_over_the_plain_loop(docs):
    """Geometric means and least values over all motions; times of other programs over ours."""
    speed, block = made_host()["speed"], docs.block("docs/speed.md", "host")
    wanted = []
    for way in """batch_counts batch_counts_16 batch_counts_16_apart throughput_counts
            throughput_angle throughput_counts_16 throughput_counts_16_apart""".split():
        over = [ways["expm1f"] / ways[way] for ways in speed.values()]
        wanted += [np.prod(over) ** 0.25, min(over)]
    of_batches = block.partition("- `dahl_batch")[2].partition("plain copy")[0]
    printed = re.findall(r"\d+\.\d", of_batches)
    assert [float(x) for x in printed] == pytest.approx(wanted, abs=0.056)
    for words in (
        r"plain copy\D+{:.1f} times\D+{:.1f} times".format(
            *(np.mean([w[f"throughput_{n}"] / w["copy"] for w in speed.values()])
              for n in ("counts", "counts_16"))
        ),
        r"parallel_counts`.* 2\.5, 7\.5, 12\.5, 17\.5; .* 22\.5$",
        r"threads=2.* 1\.5 times .* 7,000 ticks",
        r"`Throughput\.run_counts` is 3000 times.* 2000 times .* 12\.0 times",
        r"newton \(not here\)",
        r"^a processor, a compiler; ",
    ):  # fmt: skip
        assert re.search(words, block, re.M), words


def test_the_host_table_has_ours_and_each_package_that_ran(docs):
    head, rows = rows_of(docs.block("docs/speed.md", "host"))
    assert head == ["ns a tick", "worst error of F/Fc"] and len(rows) == 5
    assert rows["MuJoCo `dcmotor`"] == ["6,000", "1e-04"]
    slow = [ways["batch_counts"] for name, ways in made_host()["speed"].items() if name != JUMPS]
    assert rows["**`dahl_batch_counts`**"][0] == f"{np.mean(slow):,.0f}"


def test_calls_from_python_are_next_to_those_of_other_packages(docs):
    block = docs.block("docs/speed.md", "python")
    head, rows = rows_of(block)
    assert head == ["1", "10", "100", "1,000,000"]
    assert rows == {"**`Friction.run_counts(moves, out)`**": ["3.0", "3.1", "3.2", "2,700"]}
    assert "numba (no numba)" in block
    printed = re.findall(r": (\S+) us, (\S+) times", block)
    assert printed == [("0.25", "5.0"), ("1.64", "4.1"), ("2.12", "5.3")]


def test_a_cheaper_and_better_method_is_reported(bench):
    """In one motion on one core. An error within 5 % of ours is equal."""
    target, host = made_target(), made_host()
    counted, errors = target["m3"]["motions"]["newlib"]["sine_12"], host["errors"]["sine_12"]
    counted["rk4"] = counted["expf"] = 1.0
    errors["rk4"][0] = 0.9 * errors["counts"][0]
    errors["expf"][0] = 0.96 * errors["counts"][0]
    bench.put(target=target, host=host)
    done = bench.run("report")
    found = bench.get("results")["dominated"]
    of_counts = [x for x in found if (x["core"], x["ours"]) == ("m3", "counts")]
    assert of_counts == [{"core": "m3", "motion": "sine_12", "ours": "counts", "rival": "rk4"}]
    assert re.search(rf"of our points, {len(found)} ", done.out)


@pytest.mark.checks
def test_the_pictures_are_drawn_and_copied_to_the_docs(bench):
    assert bench.run("report", "--docs", draw=True).code == 0
    for name in ("speed", "pareto", "growth"):
        assert (bench.folder / f"docs/pictures/{name}.png").read_bytes()[:4] == b"\x89PNG"
        drawing = (bench.folder / f"build/bench/{name}.svg").read_text()
        assert "<svg" in drawing and "<dc:date>" not in drawing  # equal runs give equal files


def test_the_docs_change_between_their_marks_only(docs):
    for page in PAGES:
        before, after = (
            re.sub(r"(<!-- bench:(?!measured)\w+ -->).*?(<!-- /)", r"\1\2", text, flags=re.S)
            for text in ((folder / page).read_text() for folder in (ROOT, docs.folder))
        )
        assert before == after


@pytest.mark.parametrize(
    ("broken", "named"),
    [
        ("quick", r"build/bench/host\.json "),
        ("few cores", r"build/bench/target\.json "),
        ("no target", r"tools/bench\.sh target "),
        ("no host", r"tools/bench\.sh host "),
        ("no mark", r"docs/microcontroller\.md .*<!-- bench:target -->"),
    ],
)
def test_a_part_of_a_run_is_refused_and_changes_no_page(bench, broken, named):
    """A table with fewer columns or empty cells must not replace a complete one."""
    target, page = made_target(), bench.folder / "docs/microcontroller.md"
    if broken == "quick":
        bench.put(host=made_host() | {"quick": True})
    elif broken == "few cores":
        bench.put(target={core: target[core] for core in SMALL})
    elif broken == "no mark":
        page.write_text(page.read_text().replace("<!-- bench:target -->", ""))
    else:
        (bench.folder / f"build/bench/{broken.split()[1]}.json").unlink()
    before = page.read_text()
    done = bench.run("report", "--docs")
    assert done.code == 2 and re.search(rf"^error: .*{named}", done.err)
    assert page.read_text() == before


@pytest.mark.parametrize(
    ("words", "code", "named"),
    [("host --quick", 1, "reason"), ("target --quick m3", 1, "reason"), ("target m3 m9", 2, "m9")],
)
def test_a_failed_run_is_an_error_without_a_result(bench, monkeypatch, words, code, named):
    fails = dict.fromkeys(("cc", "cmake"), "echo reason >&2; exit 1")
    works = dict.fromkeys(("qemu-system-arm", "arm-none-eabi-gcc", "arm-none-eabi-nm"), "")
    (bench.folder / "bin").mkdir()
    for name, script in (fails | works).items():
        path = bench.folder / "bin" / name
        path.write_text(f"#!/bin/sh\n{script}\n")
        path.chmod(0o755)
    monkeypatch.setenv("PATH", f"{bench.folder}/bin:{os.environ['PATH']}")
    command, *rest = words.split()
    result = bench.folder / f"build/bench/{command}.json"
    result.unlink()
    done = bench.run(command, *rest)
    assert done.code == code and named in done.err and "error: " in done.err
    assert not result.exists()


@pytest.mark.checks
def test_the_page_shows_the_fit_of_each_measured_log(bench):
    """Compare R2 of each model and log with the page. After a change: tools/bench.sh docs"""
    (bench.folder / "data/tribometer").rmdir()
    done = bench.run("report", "--docs")
    if "is not in reach" in done.out:
        pytest.skip(f"unproven: the page's R2: {done.out.splitlines()[-2]}")
    (head, now), (page_head, before) = (
        rows_of(block_of(folder / "docs/speed.md", "measured")) for folder in (bench.folder, ROOT)
    )
    assert (head, list(now)) == (page_head, list(before))
    costs, *scores = now.values()
    cases = "coulomb one_count_q30 euler slip_1_q30 slip_2_q30 slip_4_q30 mixed_4_q30".split()
    assert costs == [str(made_target()["m3"][case]) for case in cases]
    for cells, wanted in zip(scores, list(before.values())[1:], strict=True):
        assert [*map(float, cells)] == pytest.approx([*map(float, wanted)], abs=5e-4)
