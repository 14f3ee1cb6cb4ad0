"use strict";

const PROPOSAL = "A proposal, not saved: the lines of the previous still, on the paint of this one. A accepts it, Esc drops it.";
const SIDES = ["left", "right"], COLOURS = ["#19b5ff", "#ff9d1e"], OURS = "#ff4fc3";
const canvas = document.getElementById("still"), picture = new Image();
// Of still k: its label, the marks of both lines (null: not visible), what Escape goes back to, our lines once shown,
// and the lines of still k - 1 on the paint of this one, until they are accepted or dropped.
let k = 0, still = null, marks = [[], []], past = [], ours = null, proposal = null;
let active = 0, cursor = [0, 0], view = { scale: 1, x: 0, y: 0 }, queue = Promise.resolve(), drag = null;

const write = (name, text) => { document.getElementById(name).textContent = text; };
const say = (text) => write("message", text);
const complete = () => marks.every((mark) => mark === null || mark.length > 1);
const fail = (error) => { say(error.message); return false; };
const clamp = (value, size) => Math.min(Math.max(value, 0), size - 1);

/** Data from the server; throws an Error with its sentence. */
async function ask(path, body) {
  const answer = await fetch(path, body && { method: "POST", body: JSON.stringify(body) });
  if (!answer.ok) throw new Error(await answer.text());
  return path.startsWith("end") || answer.json();
}

async function open(number) {
  const label = await ask("still/" + number);
  picture.src = "picture/" + number;
  await picture.decode().catch(() => { throw new Error(label.raw_file + ": the browser cannot show it; save it as PNG."); });
  [k, still, marks, past, ours, proposal, active] = [number, label, label.points, [], null, null, 0];
  cursor = [Math.round(picture.naturalWidth / 2), Math.round(picture.naturalHeight * 0.8)];
  write("name", label.raw_file);
  say("");
  fit();
}

/** Send the marks to the server, after those sent before; whether it took them. */
function send(save) {
  const [number, points] = [k, structuredClone(marks)];
  queue = queue.then(() => ask("still/" + number, { points, save })).then((answer) => {
    if (number === k) still = answer;
    draw();
    return true;
  }).catch(fail);
  return queue;
}

/** Take other marks; those before are kept for Escape, which gives none. */
function change(next, from = active) {
  if (ours || still.compared) return say("Our lines were shown, so this label stays as it is.");
  if (next) past.push([marks, active]);
  else if (past.length) [next, from] = past.pop();
  else return;
  [marks, active] = [next, from];
  say("");
  send(false);
}

/** Show the lines of the still before on the paint of this one; they become marks only when they are accepted. */
async function propose() {
  if (ours || still.compared) return change(null); // says that the label stays
  const number = k;
  await queue;
  const answer = await ask("proposal/" + number);
  if (number !== k) return;
  proposal = answer;
  say(PROPOSAL);
  draw();
}

function accept() {
  const accepted = proposal;
  proposal = null;
  if (accepted) change(accepted.points);
}

function undo() {
  if (!proposal) return change(null);
  proposal = null;
  say("The proposal is dropped.");
  draw();
}

const changeActive = (mark) => change(marks.map((old, side) => (side === active ? mark : old)));
const addPoint = () => changeActive([...(marks[active] || []), cursor.map((place) => Math.round(place * 10) / 10)]);

async function go(step) {
  if (complete() && !still.saved[k] && !(await send(true))) return;
  await queue;
  const left = complete() || marks.every((mark) => !mark?.length) ? "" : `${still.raw_file} is incomplete: its points are kept, but it is no label.`;
  if (k + step in still.saved) {
    await open(k + step);
    say(left);
  } else say(still.saved.includes(false) ? "No more stills this way; some are not labelled yet." : "All stills are labelled.");
}

/** Save the label, then show our lines and how far they are from it. */
async function compare() {
  if (!complete()) return say("Mark both lines first, each with two or more points, or as not visible.");
  if (!still.saved[k] && !(await send(true))) return;
  say("Saved. Our lines are being found …");
  for (const number = k; number === k && still.saved[k]; await new Promise((done) => setTimeout(done, 300))) {
    const answer = await ask("ours/" + number);
    if (number !== k || !(answer.lanes || answer.error)) continue;
    ours = answer.error ? null : answer;
    say(answer.error || "Saved. " + SIDES.map(distanceWords).join(", "));
    return draw();
  }
}

function distanceWords(side, line) {
  const at = new Map(ours.h_samples.map((row, i) => [row, ours.lanes[line][i]]));
  const gaps = still.h_samples.map((row, i) => [still.lanes[line][i], at.get(row)]).filter(([a, b]) => a >= 0 && b >= 0);
  const mean = gaps.reduce((sum, [a, b]) => sum + Math.abs(a - b), 0) / gaps.length;
  return `${side} line: ${gaps.length ? mean.toFixed(1) + " px from ours" : "not in both"}`;
}

async function end() {
  await queue;
  await ask("end/0", {});
  say("The session has ended; this page can be closed.");
}

// The view. Image coordinates are those of pixel centres.

const toScreen = ([x, y]) => [(x + 0.5) * view.scale + view.x, (y + 0.5) * view.scale + view.y];

function onCanvas(event) {
  const box = canvas.getBoundingClientRect();
  return [event.clientX - box.left, event.clientY - box.top];
}

function fit() {
  const { width, height } = canvas.getBoundingClientRect();
  const scale = Math.min(width / picture.naturalWidth, height / picture.naturalHeight);
  view = { scale, x: (width - scale * picture.naturalWidth) / 2, y: (height - scale * picture.naturalHeight) / 2 };
  draw();
}

function zoom(factor, [x, y] = toScreen(cursor)) {
  const scale = Math.min(Math.max(view.scale * factor, 0.05), 40), change = scale / view.scale;
  view = { scale, x: x - (x - view.x) * change, y: y - (y - view.y) * change };
  draw();
}

function moveCursor(right, down) {
  cursor = [clamp(Math.round(cursor[0]) + right, picture.naturalWidth), clamp(Math.round(cursor[1]) + down, picture.naturalHeight)];
  const [x, y] = toScreen(cursor), { width, height } = canvas.getBoundingClientRect();
  view.x += Math.max(20 - x, 0) - Math.max(x - width + 20, 0);
  view.y += Math.max(20 - y, 0) - Math.max(y - height + 20, 0);
  draw();
}

function draw() {
  const pixels = canvas.getContext("2d"), { width, height } = canvas.getBoundingClientRect();
  [canvas.width, canvas.height] = [width * devicePixelRatio, height * devicePixelRatio];
  pixels.scale(devicePixelRatio, devicePixelRatio);
  pixels.imageSmoothingEnabled = view.scale < 3;
  pixels.drawImage(picture, view.x, view.y, picture.naturalWidth * view.scale, picture.naturalHeight * view.scale);
  const stroke = (path, colour, thick) => { [pixels.strokeStyle, pixels.lineWidth] = [colour, thick]; pixels.stroke(new Path2D(path)); };
  const drawLine = (rows, columns, colour) => {
    const points = columns.map((column, i) => [column, rows[i]]).filter(([column]) => column >= 0).map(toScreen);
    if (points.length) stroke("M" + points.join("L"), colour, 2);
  };
  still.lanes.slice(0, 2).forEach((columns, side) => drawLine(still.h_samples, columns, COLOURS[side]));
  pixels.setLineDash([8, 6]);
  if (proposal) proposal.lanes.forEach((columns, side) => drawLine(proposal.h_samples, columns, COLOURS[side]));
  if (ours) ours.lanes.slice(0, 2).forEach((columns) => drawLine(ours.h_samples, columns, OURS));
  pixels.setLineDash([]);
  marks.forEach((mark, side) => (mark || []).map(toScreen).forEach(([x, y]) => {
    for (const [colour, thick] of [["#000", 3.5], [COLOURS[side], 2]]) stroke(`M${x - 5} ${y}a5 5 0 1 0 10 0a5 5 0 1 0 -10 0`, colour, thick);
    pixels.fillStyle = COLOURS[side];
    pixels.fillText(SIDES[side][0].toUpperCase(), x + 9, y + 4);
  }));
  const [x, y] = toScreen(cursor);
  for (const [colour, thick] of [["#000", 3], ["#fff", 1]]) stroke(`M${x - 14} ${y}h10m8 0h10M${x} ${y - 14}v10m0 8v10`, colour, thick);
  const words = (mark) => (mark === null ? "not visible" : mark.length + (mark.length === 1 ? " point" : " points"));
  write("progress", `Still ${k + 1} of ${still.saved.length}, ${still.saved.filter(Boolean).length} labelled`);
  const none = marks.every((mark) => mark === null), each = SIDES.map((side, line) => `${side} line: ${words(marks[line])}`);
  write("status", (none ? "no lane" : each.join(", ")) + (still.saved[k] ? "; saved" : complete() ? "" : "; incomplete") + (proposal ? "; a proposal, not saved" : ""));
  document.getElementById("accept").hidden = !proposal;
  SIDES.forEach((side, line) => document.querySelector("." + side).setAttribute("aria-pressed", line === active));
}

const ACTIONS = {
  n: () => go(1), p: () => go(-1), s: compare, q: end, Enter: () => addPoint(), " ": () => addPoint(), Escape: undo, c: propose, a: accept,
  l: () => { active = 0; draw(); }, r: () => { active = 1; draw(); }, x: () => changeActive(null), o: () => change([null, null]),
  "+": () => zoom(1.25), "-": () => zoom(0.8), 0: fit,
  ArrowLeft: (far) => moveCursor(-far, 0), ArrowRight: (far) => moveCursor(far, 0),
  ArrowUp: (far) => moveCursor(0, -far), ArrowDown: (far) => moveCursor(0, far),
};
const UNTIL_DECIDED = ["n", "p", "s", "q", "x", "o", "Enter", " "]; // they would save, leave or change the marks
const act = (key, far) => { if (proposal && UNTIL_DECIDED.includes(key)) say(PROPOSAL); else if (still) Promise.resolve(far).then(ACTIONS[key]).catch(fail); };

document.addEventListener("keydown", (event) => {
  const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
  const pressesButton = event.target.tagName === "BUTTON" && (key === "Enter" || key === " ");
  if (!Object.hasOwn(ACTIONS, key) || event.ctrlKey || event.metaKey || event.altKey || pressesButton) return;
  event.preventDefault();
  act(key, event.shiftKey ? 10 : 1);
});
for (const button of document.querySelectorAll("button")) {
  button.addEventListener("click", (event) => {
    act(button.dataset.key);
    if (event.detail) canvas.focus(); // clicked: the next Space sets a point
  });
}
canvas.addEventListener("pointerdown", (event) => {
  canvas.setPointerCapture(event.pointerId);
  drag = { from: onCanvas(event), moved: false };
});
canvas.addEventListener("pointermove", (event) => {
  if (!drag) return;
  const to = onCanvas(event), [x, y] = [to[0] - drag.from[0], to[1] - drag.from[1]];
  if (!drag.moved && Math.hypot(x, y) < 5) return;
  view = { scale: view.scale, x: view.x + x, y: view.y + y };
  drag = { from: to, moved: true };
  if (still) draw();
});
canvas.addEventListener("pointerup", (event) => {
  const [x, y] = onCanvas(event), { scale } = view;
  if (drag && !drag.moved && event.button === 0) {
    cursor = [clamp((x - view.x) / scale - 0.5, picture.naturalWidth), clamp((y - view.y) / scale - 0.5, picture.naturalHeight)];
    act("Enter");
  }
  drag = null;
});
canvas.addEventListener("wheel", (event) => {
  event.preventDefault();
  if (still) zoom(Math.exp(-event.deltaY / 400), onCanvas(event));
}, { passive: false });
addEventListener("resize", () => still && fit());
open(0).then(() => open(Math.max(still.saved.indexOf(false), 0))).catch(fail);
