# SPDX-License-Identifier: MIT
"""The page of tools/explore.sh in headless Chromium: bits, code to copy, logs, units, widths."""

import itertools
import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import dahl
import numpy as np
import pytest
from browser import Browser
from conftest import need
from dahl.errors import Error
from dahl.io import encoder_grid, log, readers, units
from programs import run

TURN = 2 * math.pi
CLAIM = "the page of tools/explore.sh runs the library"


@pytest.fixture(scope="module")
def page(root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    for tool in ("clang", "wasm-ld"):
        need(tool, CLAIM)
    made = tmp_path_factory.mktemp("page") / "explore.html"
    run(root / "tools/explore.sh", made)
    return made


@pytest.fixture(scope="module")
def chromium(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    with Browser(need("chromium", CLAIM), tmp_path_factory.mktemp("profile")) as one:
        yield one


@pytest.fixture
def browser(chromium: Browser, page: Path, library: Path) -> Iterator[Browser]:
    """The page as it opens. Each test ends without an error and without another request."""
    chromium.problems.clear()
    chromium.requests.clear()
    chromium.open(page)
    yield chromium
    assert chromium.problems == []
    assert {*chromium.requests} == {page.as_uri()}


def call(browser: Browser, function: str, *words: Any) -> Any:
    """Return the value of a function of the page, or its error."""
    given = ", ".join(json.dumps(word) for word in words)
    return browser.run(
        f"(() => {{ try {{ return {function}({given}) }} catch (e) {{ return e.message }} }})()"
    )


def set_field(browser: Browser, name: str, value: object) -> None:
    browser.run(f"$('{name}').value = '{value}'; $('{name}').dispatchEvent(new Event('input'))")
    browser.run(f"$('{name}').dispatchEvent(new Event('change', {{bubbles: true}}))")
    browser.settle()


# --- the library ----------------------------------------------------------------------------------

PLANS = [
    (100, 0.5, TURN / 16384),
    (3456.7, 12.3, TURN / 2**24),
    (1, 1, 2**-30),
    (1e10, 1e-10, 1e-14),
]
STEP_ALL = """(sigma0, Fc, theta, moves) => {
    const code = dahl.prepare(sigma0, Fc, theta), F = Float32Array.from(moves, dahl.step);
    return [code, ...new Uint32Array(F.buffer)];
}"""


@pytest.mark.parametrize("plan", PLANS)
def test_random_steps_have_the_bits_of_the_library(browser: Browser, plan: Any) -> None:
    rng = np.random.default_rng(1)
    sizes = rng.integers(-20, 21, 10000) * 10.0 ** rng.integers(0, 8, 10000)
    moves = [2**31 - 1, -(2**31), 0, -1, *map(int, sizes)]
    bearing = dahl.Friction(dahl.Plan(*plan))
    expected = np.array([bearing.step_counts(move) for move in moves], np.float32)
    code, *bits = call(browser, f"({STEP_ALL})", *plan, moves)
    assert code == 0 and np.array_equal(bits, expected.view(np.uint32))


def test_refused_numbers_are_named_and_the_curves_stay(browser: Browser) -> None:
    for name, value in {"bits": 32, "sigma0": 0.1, "Fc": 1000}.items():
        set_field(browser, name, value)
    assert "2^-30" in browser.run("$('warning').textContent")
    set_field(browser, "Fc", 0.001)
    assert browser.run("$('warning').textContent") == ""


NUMBERS: list[dict[str, object]] = [
    {},
    {"sigma0": 1234.5, "Fc": 0.07, "bits": 32},
    {"sigma0": 0.1, "Fc": 1000, "bits": 8},
    {"sigma0": 37349, "Fc": 2.666, "linear": True, "count": 0.1},
]
COPY = """(() => {
    let text = "";
    document.addEventListener("copy", () => text = getSelection().toString(), {once: true});
    document.querySelector("[data-copy=%s]").click();
    return text;
})()"""


@pytest.mark.parametrize("numbers", NUMBERS)
def test_the_copied_code_prints_the_torque_of_the_page(
    browser: Browser, root: Path, library: Path, tmp_path: Path, numbers: dict[str, object]
) -> None:
    for name, value in numbers.items():
        browser.run(f"$('{name}').click()") if value is True else set_field(browser, name, value)
    shown = (
        browser.run("$('prints').textContent")
        .removeprefix("Both print ")
        .split(" N")[0]
        .split(", ")
    )
    (tmp_path / "trial.c").write_text(browser.run(COPY % "c") + "\n")
    words = [
        "-std=c99",
        "-Wall",
        "-Wextra",
        "-Werror",
        f"-I{root / 'lib/include'}",
        tmp_path / "trial.c",
    ]
    run("cc", *words, library, f"-Wl,-rpath,{library.parent}", "-o", tmp_path / "trial")
    unit = "N" if "linear" in numbers else "N m"
    expected = [f"{float(one):.9g} {unit}" for one in shown]
    assert run(tmp_path / "trial").splitlines() == expected and len({*expected}) == 3
    printed: list[str] = []
    exec(browser.run(COPY % "python"), {"print": printed.append})
    assert printed == expected


# --- logs and units -------------------------------------------------------------------------------

STEMS = [
    "angle",
    "theta",
    "position",
    "Winkel",
    "q",
    "torque",
    "Kraft",
    "tau",
    "i_q",
    "current",
    "t",
    "T",
    "time",
]
STEMS += [
    "theta_ref",
    "theta_dot",
    "torque_cmd",
    "force",
    "N m",
    "load_cell",
    "count",
    "stamp",
    "constructor",
]
WORDS = [
    *units.ANGLES,
    *units.TORQUES,
    *units.TIMES,
    *units.SPELLINGS,
    "ft lb",
    "N·m",
    "N*m",
    "µm",
    "MM",
    "n",
    "x",
]
FORMS = [
    "{0}",
    "{0}_{1}",
    "{0} [{1}]",
    "{0} ({1})",
    "{1}",
    "{0}_{1}_raw",
    "{0} [{1}] [raw]",
    "{0} {1}",
]
COLUMN_NAMES = sorted(
    {form.format(*pair) for form in FORMS for pair in itertools.product(STEMS, WORDS)}
)


def test_the_units_of_names_are_those_of_identify(browser: Browser) -> None:
    for quantity, known in units.QUANTITIES.items():
        script = f"names => names.map(name => unitIn(name, RULES.quantities.{quantity}))"
        found = call(browser, f"({script})", COLUMN_NAMES)
        expected = [units.unit_in(name, known, "") for name in COLUMN_NAMES]
        pairs = zip(COLUMN_NAMES, found, expected, strict=True)
        assert [row for row in pairs if row[1] != row[2]] == []


@pytest.mark.parametrize("role", readers.ROLES)
def test_the_columns_are_those_of_identify(browser: Browser, role: str) -> None:
    tables = [list(pair) for pair in itertools.permutations(COLUMN_NAMES[::397], 2)] + [STEMS]
    script = f"(tables => tables.map(names => likeliest({role!r}, names)))"
    found = call(browser, script, tables)
    expected = [readers._likeliest(role, names, range(len(names))) for names in tables]
    pairs = zip(tables, found, expected, strict=True)
    assert [row for row in pairs if row[1] != row[2]] == []


GRIDS = [
    (turn / counts, span)
    for turn in (360, TURN, 1)
    for counts in (1024, 65536)
    for span in (0.3, 50)
]
GRIDS += [(1, 50), (0.001, 0.3)]


@pytest.mark.parametrize("stated", ["deg", "rad", ""])
def test_the_steps_of_an_angle_raise_the_questions_of_identify(
    browser: Browser, stated: str
) -> None:
    """Without a stated unit identify accepts deg if the steps confirm it. The page always asks."""
    for step, span in GRIDS:
        angle = step * np.round(span * np.sin(np.arange(500) ** 1.1 / 40) / step)
        asked = call(browser, "unitQuestion", list(angle), stated)
        theta = angle * units.ANGLES[stated or "deg"]
        try:
            expected = "" if stated else encoder_grid.question(angle, "deg", 0)
            encoder_grid.check_unit(log.Log("", theta, theta, resolution=log.resolution_of(theta)))
        except Error as error:
            expected = str(error) if stated else expected
        assert bool(asked) == bool(expected) or not stated, (step, span)
        if "Neither" not in expected and expected:
            assert asked.split("?")[0].lower() in expected, (step, span)


DROP = """async (name, text) => {
    const files = new DataTransfer();
    files.items.add(new File([text], name));
    document.body.dispatchEvent(new DragEvent("drop", {dataTransfer: files, bubbles: true}));
    await new Promise(done => setTimeout(done, 100));
}"""


def drop(browser: Browser, text: str) -> None:
    browser.run(f"({DROP})('log.csv', {json.dumps(text)})")


def state(browser: Browser) -> dict[str, Any]:
    """Return what the page shows of a log."""
    shown: dict[str, Any] = browser.run("""({
        angle: $("angleUnit").value, torque: $("torqueUnit").value,
        question: $("question").textContent, fit: $("fit").textContent,
        locked: $("confirm").disabled, read: $("read").textContent, key: $("key").innerText,
        columns: !$("columns").hidden, span: $("span").textContent, kind: $("kind").value})""")
    return shown


def rig(per_count: float, sigma0: float, Fc: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return counts, measured torque and time of a decaying motion, from within a stroke on."""
    t = np.arange(4000) * 1e-3
    counts = np.rint(6 * Fc / sigma0 * np.sin(TURN * t) * np.exp(-0.4 * t) / per_count).astype(int)
    noise = 0.03 * Fc * np.random.default_rng(2).normal(size=4000)
    true = dahl.Friction(dahl.Plan(sigma0, Fc, per_count))
    measured = noise + [true.step_counts(int(move)) for move in np.diff(counts, prepend=counts[0])]
    return counts[150:], np.round(measured, 6)[150:], t[150:]


@pytest.mark.parametrize(
    "names",
    ["angle_deg,torque_Nm", "angle,torque [mNm]", "position_mm,force_N", "counts,torque_Nm"],
)
def test_a_dropped_log_shows_its_r2_after_its_units_are_confirmed(
    browser: Browser, names: str
) -> None:
    linear = "mm" in names
    per_count = 1e-7 if linear else TURN / 65536
    counts, measured, t = rig(per_count, 90, 0.4)
    guess = dahl.Friction(dahl.Plan(100, 0.5, per_count))
    guess.torque = float(measured[0])
    computed = [guess.step_counts(int(move)) for move in np.diff(counts, prepend=counts[0])]
    size = {"counts": 1, "positi": 1e3 * per_count}.get(names[:6], math.degrees(per_count))
    shown = measured * (1000 if "mNm" in names else 1)
    rows = zip(t, counts * size, shown, strict=True)
    drop(browser, f"time_s,{names}\n" + "".join(f"{a:.3f},{b:.9g},{c:.9g}\n" for a, b, c in rows))
    before = state(browser)
    assert before["columns"] and before["kind"] == "sine" and "R²" not in before["key"]
    if names.startswith("angle,"):
        assert before["locked"] and before["angle"] == "" and "deg" in before["question"]
        set_field(browser, "angleUnit", "deg")
    if names.startswith("counts"):  # they mean the encoder on the page
        set_field(browser, "bits", 15)
        assert state(browser)["span"] != before["span"]
        set_field(browser, "bits", 16)
    assert not state(browser)["locked"] and state(browser)["kind"] == "sine"
    browser.run("$('confirm').click()")
    expected = 1 - np.mean((measured - computed) ** 2) / np.var(measured)
    assert f"R² = {expected:.4f}" in state(browser)["key"]
    set_field(browser, "sigma0", 90)
    set_field(browser, "Fc", 0.4)
    assert float(state(browser)["key"].split("R² = ")[1].split()[0]) > 0.99


READ = "new Promise(done => { const wait = () => read ? done() : setTimeout(wait, 20); wait() })"


def test_a_long_log_is_drawn(browser: Browser, tmp_path: Path) -> None:
    """A step that takes a time with the square of the rows would not end."""
    angle = np.round(30 * np.sin(np.arange(300000) / 300), 5)
    rows = "".join(f"{x},{y}\n" for x, y in zip(angle, np.sign(np.gradient(angle)), strict=True))
    (tmp_path / "long.csv").write_text("angle_deg,torque_Nm\n" + rows)
    browser.choose_file("#file", tmp_path / "long.csv")
    browser.run(READ)
    browser.run("$('confirm').click()")
    assert "R²" in state(browser)["key"]


REFUSED = {  # text of a file, and words of the answer
    "angle,torque_Nm\n0,0\n1.5,0.1\n2.25,0.2\n": "angle",
    "angle_deg,torque\n0,0\n1,0.1\n2,0.2\n": "'torque'",
    "angle_deg,current_A\n0,0\n1,0.1\n2,0.2\n": "current",
    "a,b,c\n0,0,1\n1,0.1,1\n2,0.2,1\n": "column",
    "angle_deg,torque_Nm\n0,0\n1,x\n2,0.2\n3,1\n": "line 3",
    "time_s,angle_deg,torque_Nm\n0,0,0\n2,1,0.1\n1,2,0.2\n": "line 4",
    "": "numbers",
    "hello\nworld\n": "numbers",
    "1\n2\n3\n": "numbers",
    "angle_deg,torque_Nm\n0,0\n1,0.1,7\n2,0.2\n": "line 3",
}


@pytest.mark.parametrize("text", REFUSED)
def test_a_log_without_an_answer_is_not_drawn(browser: Browser, text: str) -> None:
    drop(browser, text)
    shown = state(browser)
    assert shown["locked"] and REFUSED[text] in shown["question"] + shown["fit"]
    browser.run("$('confirm').click()")
    assert state(browser)["kind"] == "sine" and "R²" not in state(browser)["key"]


FORMS_OF_FILES = [
    "t;Winkel [°];Drehmoment [Nm]\n0;0,0;0,0\n0,1;1,5;0,2\n0,2;0,5;-0,1\n0,3;1,0;0,1\n",
    "# rig\n# time [s]\tangle [deg]\ttorque [Nm]\n0\t0\t0\n.1\t1.5\t0.2\n.2\t.5\t-0.1\n.3\t1\t.1\n",
    "time,angle,torque\ns,deg,Nm\n0,0,0\n0.1,1.5,0.2\n0.2,0.5,-0.1\n0.3,1,0.1\n",
    "time [s] angle [deg] torque [Nm]\n 0 0 0\n .1 1.5 0.2\n .2 5e-1 -0.1\n .3 1 0.1\n",
    '"time","angle_deg","torque_Nm"\n"0","0,0","0,0"\n"0,1","1,5","0,2"\n"0,2","0,5","-0,1"\n"0,3","1,0","0,1"\n',
]


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "cp1252"])
@pytest.mark.parametrize(
    "text", FORMS_OF_FILES, ids=["german", "comment", "units", "blanks", "quotes"]
)
def test_a_chosen_file_is_read_as_identify_reads_it(
    browser: Browser, tmp_path: Path, text: str, encoding: str
) -> None:
    (tmp_path / "log.csv").write_bytes(text.encode(encoding))
    expected = readers.read(tmp_path / "log.csv", readers.Source())
    browser.choose_file("#file", tmp_path / "log.csv")
    browser.run("new Promise(done => setTimeout(done, 100))")
    assert (state(browser)["angle"], state(browser)["torque"]) == ("deg", "Nm")
    found = browser.run("[[...read.theta], [...read.torque], [...read.seconds]]")
    assert np.allclose(found, [expected.theta, expected.torque, expected.time], rtol=1e-14, atol=0)


# --- what is seen ---------------------------------------------------------------------------------

CLIPPED = """[...document.querySelectorAll("body *")].filter(e => e.offsetWidth).filter(e => {
    const isBox = getComputedStyle(e).display !== "inline" && e.tagName !== "PRE";
    const isCut = isBox && e.scrollWidth > e.clientWidth + 1;
    return isCut || e.getBoundingClientRect().right > innerWidth;
}).map(e => e.outerHTML.slice(0, 99))"""
CUT_WORDS = """(() => {
    const canvas = CanvasRenderingContext2D.prototype, fillText = canvas.fillText, cut = [];
    canvas.fillText = function (words, x, y) {
        const box = this.measureText(words), right = x + box.actualBoundingBoxRight;
        const isCut = x < box.actualBoundingBoxLeft - 1 || right > this.canvas.clientWidth + 1;
        if (isCut) cut.push(words);
        fillText.call(this, words, x, y);
    };
    draw();
    canvas.fillText = fillText;
    return cut;
})()"""
DRAWN = """(() => {
    const {width, height} = $("loop"), found = new Set();
    const pixels = $("loop").getContext("2d").getImageData(0, 0, width, height).data;
    for (let k = 0; k < pixels.length; k += 4) found.add(pixels.slice(k, k + 3).join());
    const style = getComputedStyle(document.documentElement);
    const bytes = text => text.match(/\\w\\w/g).map(x => parseInt(x, 16));
    const isDrawn = name => found.has(bytes(style.getPropertyValue(`--${name}`)).join());
    return ["log", "sign", "tanh", "dahl", "float"].filter(isDrawn);
})()"""


@pytest.mark.parametrize("dark", [False, True])
@pytest.mark.parametrize("width", [390, 1280])
def test_nothing_is_clipped_on_a_phone_and_on_a_desk(
    browser: Browser, page: Path, tmp_path: Path, width: int, dark: bool
) -> None:
    browser.open(page, width, dark)
    for name in ("sign", "tanh", "float"):
        browser.run(f"$('{name}').click()")
    counts, measured, t = rig(TURN / 65536, 90, 0.4)
    rows = zip(t, counts, measured, strict=True)
    drop(
        browser,
        "time_s,a_long_name_of_the_angle_counts,torque\n"
        + "".join(f"{a:.3f},{b},{c:.9g}\n" for a, b, c in rows),
    )
    for _ in range(2):
        size = browser.run(
            "[document.documentElement.scrollWidth, document.documentElement.clientWidth]"
        )
        assert size[0] == size[1] and browser.run(CLIPPED) == []
        assert browser.run(CUT_WORDS) == []
        set_field(browser, "torqueUnit", "Nm")
        browser.run("$('confirm').click()")
    assert browser.run(DRAWN) == ["log", "sign", "tanh", "dahl", "float"]
    browser.picture(tmp_path / f"explore_{width}.png")
    assert browser.run("matchMedia('(prefers-color-scheme: dark)').matches") == dark
    back = browser.run("getComputedStyle(document.body).backgroundColor")
    assert (sum(map(int, back[4:-1].split(", "))) < 300) == dark


CONTROLS = """[...document.querySelectorAll("input, select, button, pre")]
    .filter(e => e.offsetWidth).map(e => [e.id || e.dataset.copy + "_copy",
        e.getAttribute("aria-label") || e.innerText ||
        [...e.labels ?? []].map(label => label.innerText).join()])"""


def test_each_control_has_a_name_and_is_reached_by_the_keyboard(browser: Browser) -> None:
    browser.run("$('sigma0-slider').focus()")
    before = browser.run("$('prints').textContent")
    browser.press("ArrowRight")
    assert browser.run("$('prints').textContent") != before
    seen: list[str] = []
    name = "document.activeElement.id || document.activeElement.dataset.copy + '_copy'"
    while not seen or seen[-1] != "python_copy":
        browser.press("Tab")
        seen.append(browser.run(name))
        assert len(seen) < 60
    visible = browser.run(CONTROLS)
    assert {name for name, _ in visible} <= {*seen, "sigma0", "sigma0-slider"}
    assert all(label for _, label in visible)
