// ---- the page ----
const $ = (id) => document.getElementById(id);
const SLIDERS = { // group, label, unit, least, largest, start, scale
  sigma0: ["friction", "Stiffness at rest, sigma0", "N m/rad", 0.1, 1e7, 100, "log"],
  Fc: ["friction", "Coulomb torque, Fc", "N m", 1e-3, 1e3, 0.5, "log"],
  bits: ["friction", "Encoder", "bit/turn", 8, 32, 16, "whole"],
  count: ["friction", "Encoder", "um/count", 1e-3, 100, 0.1, "log"],
  amplitude: ["motion", "Amplitude", "mrad", 0.01, 1000, 20, "log"],
  cycles: ["motion", "Cycles", "", 1, 40, 4, "whole"],
  decay: ["motion", "Decay of the amplitude", "1/cycle", 0, 2, 0.3, "linear"],
  frequency: ["motion", "Cycles per second", "Hz", 0.05, 20, 1, "log"],
  rate: ["motion", "Ticks per second", "Hz", 100, 20000, 1000, "log"],
  v0: ["speed", "Width of tanh, v0", "mrad/s", 0.1, 1000, 20, "log"],
  tau: ["speed", "Low-pass of the speed", "ms", 0, 100, 10, "linear"],
};
const CURVES = { log: "measured", sign: "Fc sign(v)", tanh: "Fc tanh(v/v0)", dahl: "dahl_step_counts", float: "float state" };
const MAX_TICKS = 200000;
const value = { kind: "sine" };
let dahl = null; // prepare(sigma0, Fc, theta_per_count) -> 0 or an error; step(counts) -> N m; set(N m)
let table = null; // of the file that was read
let read = null, log = null; // {theta [rad, m or counts], torque [N m, N], seconds, ...} before and after the units are confirmed

const digits = (x, n = 3) => (x && (Math.abs(x) >= 1e5 || Math.abs(x) < 1e-3) ? x.toExponential(n - 1) : `${+x.toPrecision(n)}`);
const clamp = (x, low, high) => Math.min(Math.max(x, low), high);
const isLinear = () => $("linear").checked;
/** A unit of a rotation, as the motion on the page has it. */
const named = (unit) => (isLinear() ? unit.replace("N m", "N").replace("mrad", "mm").replace("rad", "m") : unit);
const perCount = () => (isLinear() ? value.count * 1e-6 : (2 * Math.PI) / 2 ** value.bits);

/** Add a slider and a field of numbers that show the same value. */
function addSlider(name) {
  const [group, label, unit, low, high, start, scale] = SLIDERS[name], isLog = scale === "log", isWhole = scale === "whole";
  const steps = isWhole ? high - low : 1000, row = document.createElement("div");
  Object.assign(row, { className: "row", id: `row-${name}` });
  row.innerHTML = `<label for="${name}">${label}</label>` +
    `<input type="range" id="${name}-slider" aria-label="${label}, ${unit}" max="${steps}">` +
    `<input type="number" id="${name}" min="${low}" max="${high}" step="any"><span id="unit-${name}"></span>`;
  $(group).append(row);
  const slider = $(`${name}-slider`), field = $(name);
  const toSlider = (x) => (isLog ? Math.log(x / low) / Math.log(high / low) : (x - low) / (high - low)) * steps;
  const toValue = (s) => (isLog ? low * (high / low) ** (s / steps) : low + ((high - low) * s) / steps);
  const show = (x) => {
    value[name] = isWhole ? Math.round(clamp(x, low, high)) : clamp(x, low, high);
    slider.value = toSlider(value[name]);
    slider.setAttribute("aria-valuetext", `${digits(value[name])} ${named(unit)}`);
    field.value = digits(value[name], 6);
  };
  slider.oninput = () => { show(+toValue(+slider.value).toPrecision(3)); draw(); };
  field.onchange = () => { show(Number.isFinite(field.valueAsNumber) ? field.valueAsNumber : value[name]); draw(); };
  show(start);
}

// ---- motion and torques ----
/** Angles [rad] between which the shaft moves at constant speed; the segments are theta1, theta2 and theta3 of the paper. */
function turningPoints(A) {
  if (value.kind === "segments") return [0, A, -A / 2, 1.5 * A];
  return Array.from({ length: 2 * value.cycles + 1 }, (_, k) => k && (k % 2 ? A : -A) * Math.exp((-value.decay * (k - 1)) / 2));
}

/** {theta [rad], seconds} of n + 1 ticks. */
function motion() {
  const T = value.cycles / value.frequency, n = Math.min(Math.round(T * value.rate), MAX_TICKS), theta = new Float64Array(n + 1);
  const A = value.amplitude / 1000, points = turningPoints(A), travels = [0];
  for (let k = 1; k < points.length; k++) travels.push(travels[k - 1] + Math.abs(points[k] - points[k - 1]));
  for (let k = 0, part = 1; k <= n; k++) {
    const cycle = (value.cycles * k) / n, travel = (travels.at(-1) * k) / n;
    while (travel > travels[part] && part < points.length - 1) part++;
    theta[k] = value.kind === "sine" ? A * Math.exp(-value.decay * cycle) * Math.sin(2 * Math.PI * cycle)
      : points[part - 1] + Math.sign(points[part] - points[part - 1]) * (Math.min(travel, travels[part]) - travels[part - 1]);
  }
  return { theta, seconds: theta.map((_, k) => (T * k) / n) };
}

/** Run the library and the other laws over the counts of the encoder, tick by tick as a firmware does. */
function simulate() {
  const { theta, seconds, inCounts, torque, timed = true } = value.kind === "log" ? log : motion();
  const n = theta.length, size = perCount(), Fc = value.Fc, round = Math.fround, u = round(round(value.sigma0) / round(Fc)) * size;
  const counts = theta.map((x) => Math.round(inCounts ? x : x / size)), moves = counts.map((x, k) => (k ? x - counts[k - 1] : 0));
  const run = { log: torque, seconds, timed, angle: counts.map((x) => (x - counts[0]) * size) };
  for (const name of ["dahl", "sign", "tanh", "float"]) run[name] = new Float32Array(n);
  run.error = dahl.prepare(value.sigma0, Fc, size);
  if (run.error) return run;
  if (torque) dahl.set(torque[0]);
  for (let k = 0; k < n; k++) run.dahl[k] = dahl.step(clamp(moves[k], -(2 ** 31), 2 ** 31 - 1));
  let w = torque ? round(clamp(torque[0] / Fc, -1, 1)) : 0, v = 0;
  for (let k = 0; k < n; k++) {
    const direction = Math.sign(moves[k]), dt = k ? seconds[k] - seconds[k - 1] : 0;
    if (direction) w = round(w + round(round(direction - w) * round(-Math.expm1(-round(u * Math.abs(moves[k]))))));
    if (dt > 0) v += ((moves[k] * size) / dt - v) * (value.tau > 0 ? -Math.expm1((-dt * 1000) / value.tau) : 1);
    if (Math.abs(v) * dt < 1e-6 * size) v = 0;
    run.float[k] = Fc * w;
    run.sign[k] = Fc * Math.sign(v);
    run.tanh[k] = Fc * Math.tanh((v * 1000) / value.v0);
  }
  return run;
}

function r2(measured, computed) {
  const mean = sum(measured) / measured.length;
  return 1 - sum(measured.map((F, k) => (F - computed[k]) ** 2)) / sum(measured.map((F) => (F - mean) ** 2));
}

// ---- drawing ----
function ticksBetween(low, high, wanted) {
  const raw = (high - low) / wanted, power = 10 ** Math.floor(Math.log10(raw));
  const step = power * [1, 2, 5, 10].find((m) => m * power >= raw), first = Math.ceil(low / step);
  return Array.from({ length: Math.floor(high / step) - first + 1 }, (_, k) => +((first + k) * step).toPrecision(12));
}

function rangeOf(...arrays) {
  const high = Math.max(...arrays.map(largest)), low = Math.min(...arrays.map(smallest)), margin = (high - low || 1) * 0.05;
  return [low - margin, high + margin];
}

function plot(canvas, xs, curves, xLabel) {
  const scale = window.devicePixelRatio || 1, W = canvas.clientWidth, H = canvas.clientHeight, g = canvas.getContext("2d");
  Object.assign(canvas, { width: W * scale, height: H * scale });
  g.scale(scale, scale);
  const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`);
  const [x0, x1] = rangeOf(xs), [y0, y1] = rangeOf([-value.Fc, value.Fc], ...curves.map((curve) => curve.ys));
  const left = W < 250 ? 40 : 54, right = W - 10, top = 26, bottom = H - 40;
  const X = (x) => left + ((x - x0) / (x1 - x0)) * (right - left), Y = (y) => bottom - ((y - y0) / (y1 - y0)) * (bottom - top);
  const text = (words, x, y, align) => { g.textAlign = align; g.fillText(words, x, y); };
  const line = (...points) => { g.beginPath(); for (const [x, y] of points) g.lineTo(x, y); g.stroke(); };
  g.font = `${W < 250 ? 11 : 13}px system-ui, sans-serif`;
  g.fillStyle = colour("text");
  text(`F [${named("N m")}]`, 4, 15, "left");
  text(xLabel, (left + right) / 2, H - 5, "center");
  g.fillStyle = colour("quiet");
  g.strokeStyle = colour("rule");
  for (const x of ticksBetween(x0, x1, Math.max(W / 90, 3))) {
    line([X(x), top], [X(x), bottom]);
    text(digits(x), X(x), bottom + 17, "center");
  }
  for (const y of ticksBetween(y0, y1, H / 60)) {
    line([left, Y(y)], [right, Y(y)]);
    text(digits(y), left - 6, Y(y) + 4, "right");
  }
  g.strokeStyle = colour("quiet");
  g.setLineDash([5, 5]);
  for (const y of [-value.Fc, value.Fc]) line([left, Y(y)], [right, Y(y)]);
  for (const { name, ys } of curves) {
    g.strokeStyle = colour(name);
    g.setLineDash(name === "float" ? [4, 6] : []);
    g.lineWidth = { dahl: 2.2, log: 2.6 }[name] ?? 1.3;
    g.beginPath();
    for (let k = 0; k < xs.length; k++) g.lineTo(X(xs[k]), Y(ys[k]));
    g.stroke();
  }
}

function showControls() {
  const used = { bits: !isLinear(), count: isLinear(), decay: /sine|triangle/.test(value.kind), v0: $("tanh").checked,
    tau: $("sign").checked || $("tanh").checked };
  for (const [name, [group, , unit]] of Object.entries(SLIDERS)) {
    $(`row-${name}`).hidden = !(used[name] ?? (group !== "motion" || value.kind !== "log"));
    $(`unit-${name}`).textContent = named(unit);
  }
}

/** Curves in the order in which they are drawn. A log without time has no speed. */
function curvesOf(run) {
  const isDrawn = (name) => name === "dahl" || (name === "log" ? run.log : $(name).checked && (run.timed || name === "float"));
  return Object.entries(CURVES).filter(([name]) => isDrawn(name)).map(([name, label]) => ({ name, label, ys: run[name] }));
}

function warningOf(run) {
  if (run.error) return "dahl_prepare rejects these numbers: sigma0/Fc times the move of a count must be from 2^-30 to 2^20.";
  if (value.Fc / value.sigma0 < 3 * perCount()) return "Presliding is shorter than 3 counts: the encoder is too coarse to show it.";
  if (!run.timed) return "This log has no time, so it has no speed for sign and tanh.";
  return spanOf(run.angle) ? "" : "The motion is smaller than one count: nothing moves.";
}

function factsOf(run) {
  const length = value.Fc / value.sigma0, difference = largest(run.dahl.map((F, k) => Math.abs(F - run.float[k])));
  return {
    "Presliding length Fc/sigma0": `${digits(length * 1000)} ${named("mrad")}`,
    "the same in counts": `${digits(length / perCount())} counts`,
    "Torque reached": `${digits(smallest(run.dahl), 4)} to ${digits(largest(run.dahl), 4)} ${named("N m")}`,
    "Float state differs by up to": `${digits(difference / value.Fc)} Fc`,
  };
}

function draw() {
  const run = simulate(), R2 = ({ name, ys }) => (run.log && name !== "log" ? `, R² = ${r2(run.log, ys).toFixed(4)}` : "");
  showControls();
  $("warning").textContent = warningOf(run);
  if (run.error) return;
  const curves = curvesOf(run);
  const key = (one) => `<li><i style="border-color:var(--${one.name})"></i>${one.label}${R2(one)}</li>`;
  plot($("loop"), run.angle.map((x) => x * 1000), curves, `${isLinear() ? "position" : "angle"} [${named("mrad")}]`);
  plot($("trace"), run.seconds, curves, run.timed ? "time [s]" : "row");
  $("key").innerHTML = `${curves.map(key).join("")}<li>- - - ±Fc</li>`;
  $("facts").innerHTML = Object.entries(factsOf(run)).map(([name, text]) => `<div><dt>${name}</dt><dd>${text}</dd></div>`).join("");
  showCode();
}

// ---- code to copy ----
function shortestFloat(x) {
  const text = [1, 2, 3, 4, 5, 6, 7, 8, 9].map((n) => `${+x.toPrecision(n)}`).find((one) => Math.fround(one) === Math.fround(x));
  return /[.e]/.test(text) ? text : `${text}.0`;
}

function showCode() {
  const sigma0 = shortestFloat(value.sigma0), Fc = shortestFloat(value.Fc), N = named("N m"), size = perCount();
  const count = shortestFloat(size), modulus = isLinear() || value.bits === 32 ? 0 : 2 ** value.bits;
  const far = clamp(Math.round(value.Fc / value.sigma0 / size), 2, (modulus || 2 ** 32) / 8), half = far >> 1;
  const countInC = isLinear() ? `${count}f` : `6.2831853f / ${2 ** value.bits}.0f`;
  const countInPython = isLinear() ? count : `2 * math.pi / 2**${value.bits}`;
  dahl.prepare(value.sigma0, value.Fc, size);
  const torques = [half, far, -half].map((move) => +dahl.step(move).toPrecision(9)).join(", ");
  $("prints").textContent = `Both print ${torques} ${N}, as this page does.`;
  $("c").textContent = `#include <stdio.h>
#include "dahl.h"

static const dahl_params_t params = {${sigma0}f, ${Fc}f, ${countInC}}; /* ${named("N m/rad")}, ${N}, ${named("rad")}/count */
static dahl_plan_t plan;
static dahl_state_t bearing; /* all zeros: relaxed */

int main(void)
{
    static const uint32_t readings[] = {0, ${half}, ${half + far}, ${far}}; /* of ${modulus || "2^32"} values */
    if (dahl_prepare(&plan, &params) != DAHL_OK) { return 1; }
    for (int k = 1; k < 4; k++) { /* a firmware does this in each tick */
        int32_t move = dahl_counts_between(readings[k - 1], readings[k], ${modulus}${modulus ? "" : " /* 2^32 */"});
        printf("%.9g ${N}\\n", (double)dahl_step_counts(&plan, &bearing, move));
    }
}`;
  $("python").textContent = `${isLinear() ? "" : "import math\n\n"}import dahl

plan = dahl.Plan(sigma0=${sigma0}, Fc=${Fc}, theta_per_count=${countInPython})  # ${named("N m/rad")}, ${N}, ${named("rad")}
bearing = dahl.Friction(plan)
for move in (${half}, ${far}, ${-half}):  # counts of the encoder
    print(f"{bearing.step_counts(move):.9g} ${N}")`;
}

function copy(button) { // also from a file on a disk, where a page may not use navigator.clipboard
  getSelection().selectAllChildren($(button.dataset.copy));
  document.execCommand("copy");
  button.textContent = "Copied";
}

// ---- the measured log: a unit is confirmed or asked for, never assumed ----
function openLog(name, bytes) {
  table = null;
  try {
    table = readTable(decode(bytes));
    for (const role of ["angle", "torque"]) {
      const [place] = likeliest(role, table.names);
      $(role).replaceChildren(new Option("choose", ""), ...table.names.map((name, k) => new Option(name, k, false, k === place)));
    }
    preselectUnits();
    $("read").textContent = `${name}: ${table.rows.length} rows.`;
  } catch (error) {
    leaveLog(`${name}: ${error.message}`);
  }
  $("columns").hidden = !table;
}

/** Preselect the units that the names of the columns state. */
function preselectUnits() {
  for (const [role, known] of [["angle", ANGLES], ["torque", TORQUES]]) {
    $(`${role}Unit`).value = $(role).value && unitIn(table.names[$(role).value], known);
  }
  check();
}

/** Read the columns in their units. It throws an error that names what the user must answer first. */
function readLog() {
  const [angleAt, torqueAt, angleUnit, torqueUnit] = ["angle", "torque", "angleUnit", "torqueUnit"].map((id) => $(id).value);
  if (!angleAt || !torqueAt || angleAt === torqueAt) throw new Error("Which column is the angle, and which one is the torque?");
  const angle = columnOf(table, angleAt), torque = columnOf(table, torqueAt), inCounts = angleUnit === "counts";
  const doubt = unitQuestion(angle, angleUnit);
  if (!angleUnit) throw new Error(doubt);
  if (!torqueUnit) throw new Error(`Which unit has the torque? '${table.names[torqueAt]}' names none.`);
  if (RULES.currents.includes(torqueUnit)) throw new Error("A current is not a torque. Use dahl identify --torque-constant.");
  const linear = inCounts ? isLinear() : RULES.lengths.includes(angleUnit), isAngle = !inCounts && !linear;
  const theta = angle.map((x) => x * (inCounts ? 1 : ANGLES[angleUnit])), sign = $("invert").checked ? -1 : 1;
  const F = torque.map((x) => x * sign * TORQUES[torqueUnit]), time = timeOf(table, [+angleAt, +torqueAt]);
  return { theta: isAngle ? unwrap(theta) : theta, torque: F, inCounts, linear, doubt, ...time };
}

/** Ask for what is missing, or show what the units mean. Only the button makes the log move the shaft. */
function check() {
  leaveLog("");
  try {
    read = readLog();
    const span = spanOf(read.theta) * (read.inCounts ? perCount() : 1);
    const size = digits(largest(read.torque.map(Math.abs)));
    const [position, force] = read.linear ? ["m", "N"] : [`rad = ${digits((span * 180) / Math.PI)} deg`, "N m"];
    $("question").textContent = read.doubt;
    $("span").textContent = `The motion spans ${digits(span)} ${position}, F is within ${size} ${force}. ${read.note} Is that your rig?`;
  } catch (error) {
    $("question").textContent = error.message;
    $("span").textContent = "A wrong unit gives a wrong sigma0 without any other sign of it.";
  }
  $("confirm").disabled = !read;
  $("confirm").textContent = read?.doubt ? "I trust these units all the same: overlay" : "These units are right: overlay";
}

function leaveLog(words) {
  log = read = null;
  $("fit").textContent = words;
  setKind(value.kind === "log" ? "sine" : value.kind);
}

function confirmLog() {
  log = read;
  $("linear").checked = log.linear;
  $("fit").textContent = "The log moves the shaft, from its first row on. Move sigma0 and Fc until the curves agree. " +
    "For values with intervals and a verdict use: dahl identify.";
  setKind("log");
}

function setKind(kind) {
  $("kind").lastElementChild.disabled = !log;
  value.kind = $("kind").value = kind;
  draw();
}

// ---- start ----
function connect() {
  const open = async ([file]) => { if (file) openLog(file.name, new Uint8Array(await file.arrayBuffer())); };
  for (const [id, known] of [["angleUnit", ANGLES], ["torqueUnit", TORQUES]]) {
    $(id).replaceChildren(new Option("choose", ""), ...Object.keys(known).map((unit) => new Option(unit, unit)));
  }
  for (const id of ["angle", "torque"]) $(id).onchange = preselectUnits;
  for (const id of ["angleUnit", "torqueUnit", "invert"]) $(id).oninput = check;
  for (const id of ["sign", "tanh", "float"]) $(id).onchange = draw;
  $("linear").onchange = () => (table ? check() : draw());
  for (const name of ["bits", "count"]) $(`row-${name}`).onchange = () => { if (read && !log) check(); };
  for (const button of document.querySelectorAll("[data-copy]")) button.onclick = () => copy(button);
  $("kind").onchange = () => setKind($("kind").value);
  $("confirm").onclick = confirmLog;
  $("file").onchange = () => open($("file").files);
  document.ondragover = (event) => event.preventDefault();
  document.ondrop = (event) => { event.preventDefault(); open(event.dataTransfer.files); };
  addEventListener("resize", draw);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
}

WebAssembly.instantiate(Uint8Array.from(atob(LIBRARY), (c) => c.charCodeAt(0))).then(({ instance }) => {
  dahl = instance.exports;
  for (const name of Object.keys(SLIDERS)) addSlider(name);
  connect();
  draw();
}).catch((error) => { document.getElementById("warning").textContent = `This browser cannot run the library: ${error.message}`; });
