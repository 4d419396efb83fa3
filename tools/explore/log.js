// ---- a log: columns and units, by the rules of `dahl identify` (tools/dahl/io) ----
const { angle: ANGLES, torque: TORQUES, time: TIMES } = RULES.quantities;
const UNIT_OF = new Map(Object.entries(RULES.unitOf));
const NUMBER = /^[-+]?(\d+\.?\d*|\.\d+|\d*,\d+)(e[-+]?\d+)?$/i;
const numberIn = (cell) => (NUMBER.test(cell) ? Number(cell.replace(",", ".")) : NaN);
const sum = (numbers) => numbers.reduce((a, b) => a + b, 0);
const largest = (numbers) => numbers.reduce((a, b) => Math.max(a, b), -Infinity);
const smallest = (numbers) => numbers.reduce((a, b) => Math.min(a, b), Infinity);
const spanOf = (numbers) => largest(numbers) - smallest(numbers);

function decode(bytes) { // UTF-8, UTF-16 with its mark, or Windows-1252
  const wide = { "255,254": "utf-16le", "254,255": "utf-16be" }[bytes.slice(0, 2).join()];
  const text = new TextDecoder(wide).decode(bytes);
  return text.includes("\ufffd") ? new TextDecoder("windows-1252").decode(bytes) : text;
}

/** The cells of a line. A separator between quotes is none. */
function cellsOf(line, separator) {
  const parts = separator === " " ? line.trim().split(/\s+/)
    : line.includes('"') ? line.split(new RegExp(`${separator}(?=(?:[^"]*"[^"]*")*[^"]*$)`)) : line.split(separator);
  return parts.map((cell) => cell.trim().replace(/^"(.*)"$/, "$1").trim());
}

/** The separator with most numbers, and the first line whose cells are numbers as those of most lines. */
function formOf(lines) {
  let best = null;
  for (const separator of ["\t", ";", ",", " "]) {
    const shapes = lines.map(({ text }) => cellsOf(text, separator).map((cell) => NUMBER.test(cell)).join());
    const counts = new Map();
    for (const shape of shapes) if (/true.*true/.test(shape)) counts.set(shape, (counts.get(shape) ?? 0) + 1);
    const [shape, count] = [...counts].reduce((a, b) => (b[1] > a[1] ? b : a), ["", 0]);
    const words = shape.split(","), part = words.filter((word) => word === "true").length / words.length;
    if (count && (!best || part * count > best.score)) best = { separator, first: shapes.indexOf(shape), score: part * count };
  }
  if (!best) throw new Error("no rows with two numbers, between tabs, semicolons, commas or blanks");
  return best;
}

const isUnit = (word) => RULES.otherUnits.includes(word) || Object.values(RULES.quantities).some((known) => unitOf(word, known));

function namesOf(lines, separator, width) {
  const header = ({ text }) => {
    const cells = cellsOf(text.replace(/^[\s#%]+/, ""), separator);
    if (separator !== " " || cells.length <= width) return cells;
    return cells.reduce((all, cell) => (/^[[(]/.test(cell) ? [...all.slice(0, -1), `${all.at(-1)} ${cell}`] : [...all, cell]), []);
  };
  const rows = lines.map(header).filter((cells) => cells.length === width && /\p{L}/u.test(cells.join("")));
  const plain = (rows.at(-1) ?? []).map((cell) => cell.replace(/^[[(]+|[\])]+$/g, "")), filled = plain.filter(Boolean);
  const hasUnits = rows.length > 1 && filled.length <= 2 * filled.filter(isUnit).length;
  const names = rows.at(hasUnits ? -2 : -1) ?? [];
  return Array.from({ length: width }, (_, k) => (names[k] || `${k + 1}`) + (hasUnits && plain[k] ? ` [${plain[k]}]` : ""));
}

/** {names, rows: [{number, cells}]}; an error names the line. */
function readTable(text) {
  const isComment = (line) => /^\s*[#%]/.test(line);
  const lines = text.split(/\r\n|\r|\n/).map((one, k) => ({ text: one, number: k + 1 })).filter((line) => line.text.trim());
  const head = lines.slice(0, 400), { separator, first } = formOf(head), width = cellsOf(head[first].text, separator).length;
  const rows = lines.slice(first).filter((line) => !isComment(line.text));
  for (const row of rows) {
    row.cells = cellsOf(row.text, separator);
    if (row.cells.length !== width) throw new Error(`line ${row.number}: ${row.cells.length} cells over ${width} columns`);
  }
  return { names: namesOf(head.slice(0, first), separator, width), rows };
}

function columnOf(table, place) {
  return Float64Array.from(table.rows, ({ number, cells }) => {
    const x = numberIn(cells[place]);
    if (!Number.isFinite(x)) throw new Error(`line ${number}: column '${table.names[place]}': '${cells[place]}' is not a number`);
    return x;
  });
}

// ---- which column is what ----
const matches = (pattern, name) => new RegExp(pattern.replace("(?-i:t)", "t"), "i").test(name);

/** The columns whose names fit a role best: no setpoints, and a torque before a force. */
function likeliest(role, names) {
  let fitting = names.map((_, k) => k).filter((k) => matches(RULES.roles[role], names[k]));
  if (role === "time") return fitting.filter((k) => names[k] !== "T");
  fitting = fitting.filter((k) => !matches(RULES.derived, names[k]));
  const doubt = (k) => 4 * matches(RULES.setpoint, names[k]) + 2 * (role === "torque" && matches(RULES.current, names[k])) +
    matches(RULES.force, names[k]);
  const least = Math.min(...fitting.map(doubt));
  return fitting.filter((k) => doubt(k) === least);
}

/** {seconds, timed, note}: the time of each row, or its number if the log has no time. */
function timeOf(table, used) {
  const place = likeliest("time", table.names).find((k) => !used.includes(k));
  if (place === undefined) return { seconds: Float64Array.from(table.rows.keys()), timed: false, note: "No column has the time." };
  const unit = unitIn(table.names[place], TIMES), time = columnOf(table, place), back = time.findIndex((t, k) => t < time[k - 1]);
  if (back > 0) throw new Error(`line ${table.rows[back].number}: the clock goes backward`);
  const note = unit ? "" : `Time taken in s: '${table.names[place]}' names no unit.`;
  return { seconds: time.map((t) => (t - time[0]) * TIMES[unit || "s"]), timed: true, note };
}

// ---- units ----
function unitOf(word, known) {
  const letters = word.replace(/[ *\-.·⋅]/g, "").replace(/[µμ]/g, "u");
  const plain = UNIT_OF.get(letters) ?? UNIT_OF.get(letters.toLowerCase()) ?? letters, lower = plain.toLowerCase();
  if (Object.hasOwn(known, plain)) return plain;
  return Object.keys(known).find((unit) => unit.toLowerCase() === lower && lower !== "n" && lower !== "a") ?? "";
}

/** The unit in a column's name: the last one in brackets, else the last word; "" if there is none. */
function unitIn(name, known) {
  const inBrackets = [...name.matchAll(/[[(]\s*([^\])]+?)\s*[\])]/g)].map((found) => found[1]).reverse();
  const parts = name.split(/[\s_]+/), rest = parts.slice(1);
  const pairs = rest.map((word, k) => parts[k] + word).filter((pair) => new RegExp(RULES.twoWords, "i").test(pair)).reverse();
  const isFirstWord = parts[0].length > 2 || RULES.shortTimes.includes(parts[0]);
  let words = inBrackets.length ? inBrackets : [...pairs, ...rest.reverse(), ...(isFirstWord ? [parts[0]] : [])];
  if (!inBrackets.length && matches(RULES.rotating, name)) words = words.filter((word) => !RULES.shortLengths.includes(word));
  return words.map((word) => unitOf(word, known)).find(Boolean) ?? "";
}

/** The step of the grid on which all angles lie; 0 if there is no grid. */
function resolutionOf(angles) {
  const levels = Float64Array.from(new Set(angles.slice(0, RULES.headRows))).sort();
  const gaps = levels.slice(1).map((x, k) => x - levels[k]).filter((gap) => gap > 1e-9 * (levels.at(-1) - levels[0]));
  if (gaps.length < 3) return 0;
  const least = smallest(gaps), first = gaps.filter((gap) => gap < 1.3 * least).sort(), half = first.length / 2;
  const step = (first[Math.ceil(half) - 1] + first[Math.floor(half)]) / 2, small = gaps.filter((gap) => gap < 20.5 * step);
  const whole = small.map((gap) => Math.round(gap / step));
  const onGrid = small.filter((gap, k) => Math.abs(gap / step - whole[k]) < 0.1).length;
  return small.length < 3 || onGrid <= 0.95 * small.length ? 0 : sum(small) / sum(whole);
}

/** A question about the unit of an angle: if none is stated, or if only another unit fits the steps of an encoder. Else "". */
function unitQuestion(angles, stated) {
  const step = resolutionOf(angles), inTurns = !stated || spanOf(angles) < 1;
  if (!stated && step === 1 && angles.every(Number.isInteger)) return "Is the angle in counts? Its steps are whole numbers.";
  const isStep = ([unit, [turn]]) => {
    const bits = clamp(Math.round(Math.log2(turn / step)), ...RULES.bits);
    return step && Math.abs(turn / step / 2 ** bits - 1) < RULES.powerTolerance && (inTurns || unit !== "turn");
  };
  const found = Object.entries(RULES.turns).filter(isStep);
  const units = found.map(([unit]) => unit), steps = found.map(([, [turn, shown]]) => `${shown}/${(turn / step).toFixed(0)}`);
  if (stated && (!found.length || units.includes(stated) || !(stated in RULES.turns))) return "";
  if (!found.length) return "Which unit has the angle? Neither a name nor its steps say so.";
  return `Is the angle in ${units.join(" or ")}? Its steps are ${steps.join(" or ")}.`;
}

/** An angle that stays within a turn and jumps by one is unwrapped. theta [rad] */
function unwrap(theta) {
  const turn = 2 * Math.PI, jumps = theta.some((x, k) => k && Math.abs(x - theta[k - 1]) > RULES.wrap * turn);
  if (!jumps || spanOf(theta) > turn * (1 + 1e-9)) return theta;
  let turns = 0;
  return theta.map((x, k) => x + turn * (turns -= k ? Math.round((x - theta[k - 1]) / turn) : 0));
}
