"use strict";

const frames = JSON.parse(document.getElementById("data").textContent);
const video = document.getElementById("video");
const track = document.getElementById("track");
const cursor = document.getElementById("cursor");
const times = frames.time_s;
const last = times.length - 1;
// The last frame lasts as long as the previous one.
const length = last > 0 ? 2 * times[last] - times[last - 1] : 1;

function loadVideo() {
  const text = document.getElementById("video-data").textContent;
  video.addEventListener("error", () => {
    document.getElementById("missing").hidden = false;
  });
  if (!text) {
    video.src = video.dataset.link;
    return;
  }
  const binary = atob(text);
  const bytes = new Uint8Array(binary.length);
  for (let i = 0; i < binary.length; i++) bytes[i] = binary.charCodeAt(i);
  video.src = URL.createObjectURL(new Blob([bytes], { type: "video/mp4" }));
}

/**
 * The last of `count` indices whose value, in ascending order by `valueAt`, is at most
 * `limit`; 0 if none is.
 */
function lastUpTo(limit, count, valueAt) {
  let low = 0;
  let high = count - 1;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (valueAt(middle) <= limit) low = middle;
    else high = middle - 1;
  }
  return low;
}

/** Index of the frame shown at a time: the last frame that starts before it. */
const frameAt = (time) => lastUpTo(time + 1e-4, times.length, (i) => times[i]);

/** The words in frame i; `changes` has [first frame, words] for each change. */
function wordsAt(changes, i) {
  const k = lastUpTo(i, changes.length, (change) => changes[change][0]);
  return changes[k][1];
}

function clock(time) {
  const tenths = Math.round(time * 10);
  const seconds = ((tenths % 600) / 10).toFixed(1);
  return Math.floor(tenths / 600) + ":" + seconds.padStart(4, "0");
}

function show() {
  const time = Math.min(video.currentTime, length);
  const i = frameAt(time);
  const offset = wordsAt(frames.offset, i);
  const width = frames.lane_width_m[i];
  const left = wordsAt(frames.left_types, i);
  const right = wordsAt(frames.right_types, i);
  const write = (name, text) => {
    document.getElementById("now-" + name).textContent = text;
  };
  cursor.style.left = (100 * time) / length + "%";
  write("time", clock(time) + ", frame " + frames.frame[i]);
  write("state", frames.state[i]);
  write("offset", offset);
  write("bend", wordsAt(frames.bend, i));
  write("confidence", frames.confidence[i].toFixed(2));
  write("width", width === null ? "unknown" : width.toFixed(2) + " m");
  write("lines", left + " | " + right);
  track.setAttribute("aria-valuenow", time.toFixed(2));
  const words = [clock(time), frames.state[i], offset].join(", ");
  track.setAttribute("aria-valuetext", words);
}

function seek(time) {
  // One millisecond after the start of the frame, so that rounding does not show the
  // previous frame.
  video.currentTime = Math.max(0, Math.min(time, times[last])) + 1e-3;
}

function seekToPointer(event) {
  const box = track.getBoundingClientRect();
  seek((length * (event.clientX - box.left)) / box.width);
}

function seekByKey(event) {
  const i = frameAt(video.currentTime);
  const target = {
    ArrowLeft: video.currentTime - 1,
    ArrowRight: video.currentTime + 1,
    ArrowDown: video.currentTime - 1,
    ArrowUp: video.currentTime + 1,
    PageDown: video.currentTime - 10,
    PageUp: video.currentTime + 10,
    Home: 0,
    End: times[last],
    ",": times[Math.max(i - 1, 0)],
    ".": times[Math.min(i + 1, last)],
  }[event.key];
  if (event.key === " ") video.paused ? video.play() : video.pause();
  else if (target !== undefined) seek(target);
  else return;
  event.preventDefault();
}

/** Runs of equal labels of the frames: label, first frame, one past the last frame. */
function runsOf(labels) {
  const runs = [];
  for (let first = 0, end; first <= last; first = end) {
    for (end = first; end <= last && labels[end] === labels[first];) end++;
    runs.push([labels[first], first, end]);
  }
  return runs;
}

const MAX_MOMENTS = 3;

/** Runs of the wanted labels, longest first: frames, texts with label and seconds. */
function longestRuns(labels, wanted, words) {
  const runs = [];
  for (const [label, first, end] of runsOf(labels)) {
    const seconds = (times[end] ?? length) - times[first];
    if (wanted.includes(label)) runs.push([first, words(label), seconds]);
  }
  runs.sort((a, b) => b[2] - a[2]);
  return runs.map(([first, text, seconds]) => [
    first,
    text + seconds.toFixed(seconds < 0.1 ? 2 : 1) + " s",
  ]);
}

/**
 * The lowest values within a second to either side, two seconds apart: closer moments
 * show the same situation.
 */
function lowestValues(values, words) {
  const order = [...times.keys()].filter((i) => values[i] !== null);
  order.sort((a, b) => values[a] - values[b]);
  const chosen = [];
  for (const i of order) {
    const near = values.slice(frameAt(times[i] - 1), frameAt(times[i] + 1) + 1);
    const lowest = near.every((value) => value === null || value >= values[i]);
    const apart = chosen.every((k) => Math.abs(times[k] - times[i]) > 1.99);
    if (lowest && apart) chosen.push(i);
    if (chosen.length === MAX_MOMENTS) break;
  }
  return chosen.map((i) => [i, words(Math.abs(values[i]))]);
}

function scaled(values, factor) {
  return values.map((value) => (value === null ? null : factor * value));
}

/** The worst moments by kind, from the worst on. */
function worstMoments() {
  const confidence = frames.confidence.map((value, i) =>
    frames.state[i] === "lost" ? null : value,
  );
  // Negative, so that the largest standard deviations are the lowest values.
  const offset = scaled(frames.offset_std_m, -1);
  const bend = scaled(frames.curvature_std_per_m, -1000);
  const notSeen = (state) => state + " for ";
  const towards = (side) => `towards the ${side} line, `;
  const confident = (value) => "confidence " + value.toFixed(2);
  const metres = (std) => `± ${Math.max(std, 0.01).toFixed(2)} m`;
  const perKilometre = (std) => `± ${std.toFixed(2)} per km`;
  return {
    "Lane not seen": longestRuns(frames.state, ["lost", "coasting"], notSeen),
    "Another camera pose": frames.poses,
    "Lane departures": longestRuns(frames.departure, ["left", "right"], towards),
    "Lowest confidence": lowestValues(confidence, confident),
    "Least certain offset": lowestValues(offset, metres),
    "Least certain bend": lowestValues(bend, perKilometre),
  };
}

function add(parent, name, ...content) {
  const child = parent.appendChild(document.createElement(name));
  child.append(...content);
  return child;
}

/**
 * Show the command that explains the frame at a time, and copy it where the browser
 * allows that.
 */
function copyCommand(time) {
  const box = document.getElementById("command");
  const text = frames.command + (frames.first_s + time).toFixed(3);
  const say = (words) => { box.querySelector("span").textContent = words; };
  box.querySelector("code").textContent = text;
  box.hidden = false;
  say("Copy and run:");
  navigator.clipboard?.writeText(text).then(() => say("Copied:"), () => {});
}

function listMoments() {
  const nav = document.querySelector(".moments");
  for (const [kind, moments] of Object.entries(worstMoments())) {
    if (!moments.length) continue;
    add(nav, "h3", kind);
    let list = add(nav, "ul");
    for (const [number, [i, text]] of moments.entries()) {
      if (number === MAX_MOMENTS) {
        const rest = add(nav, "details");
        add(rest, "summary", `${moments.length - number} more`);
        list = add(rest, "ul");
      }
      const item = add(list, "li");
      const button = add(item, "button");
      add(button, "b", clock(times[i]));
      button.append(" " + text);
      button.addEventListener("click", () => seek(times[i]));
      if (!frames.command) continue;
      const explain = add(item, "button", "explain");
      explain.className = "explain";
      explain.addEventListener("click", () => copyCommand(times[i]));
    }
  }
}

function addPath(svg, kind, d) {
  const path = svg.appendChild(document.createElementNS(svg.namespaceURI, "path"));
  path.setAttribute("class", kind);
  path.setAttribute("d", d);
}

/** Drawings are 1000 units wide and 100 high; the browser stretches them. */
function toX(time) {
  return ((1000 * time) / length).toFixed(2);
}

function drawLevels() {
  const svg = document.querySelector(".states svg");
  const counts = {};
  for (const [level, first, end] of runsOf(frames.level)) {
    const from = toX(times[first]);
    const to = toX(times[end] ?? length);
    addPath(svg, level, `M${from} 0H${to}V100H${from}Z`);
    counts[level] = (counts[level] ?? 0) + end - first;
  }
  for (const [level, words] of Object.entries(frames.levels)) {
    const item = add(document.querySelector(".legend"), "li");
    add(item, "i").className = level;
    item.append(`${words} ${Math.round((100 * (counts[level] ?? 0)) / times.length)}%`);
  }
}

/**
 * The limits of an axis and three to six round values between them; 1 % of the values
 * may lie outside at each end.
 */
function ticksOf(values, [low, high]) {
  const known = values.filter((value) => value !== null).sort((a, b) => a - b);
  if (known.length) {
    low = Math.min(low, known[Math.round(0.01 * (known.length - 1))]);
    high = Math.max(high, known[Math.round(0.99 * (known.length - 1))]);
  }
  const wanted = (high - low) / 4;
  const power = 10 ** Math.floor(Math.log10(wanted));
  const steps = [1, 2, 5, 10].map((factor) => factor * power);
  steps.sort((a, b) => Math.abs(a - wanted) - Math.abs(b - wanted));
  const step = steps[0];
  const ticks = [];
  const lastTick = Math.ceil(high / step - 1e-9);
  for (let k = Math.floor(low / step + 1e-9); k <= lastTick; k++) ticks.push(k * step);
  return ticks;
}

/**
 * Runs of frames with a value; of a long drive those with the lowest and highest value
 * of each of 1000 columns.
 */
function partsOf(values) {
  const size = times.length > 2000 ? times.length / 1000 : 1;
  const parts = [[]];
  for (let first = 0; first <= last; first += size) {
    const known = [];
    for (let i = Math.ceil(first); i < first + size && i <= last; i++) {
      if (values[i] !== null) known.push(i);
    }
    if (!known.length) {
      parts.push([]);
      continue;
    }
    known.sort((a, b) => values[a] - values[b]);
    const ends = [...new Set([known[0], known.at(-1)])];
    parts.at(-1).push(...ends.sort((a, b) => a - b));
  }
  return parts.filter((part) => part.length);
}

/**
 * Draw values of the frames, null where unknown, with a band of one standard deviation
 * to either side.
 */
function drawCurve(name, values, std, span) {
  const figure = document.getElementById("curve-" + name);
  const svg = figure.querySelector("svg");
  const ticks = ticksOf(values, span);
  const height = ticks.at(-1) - ticks[0];
  const toY = (value) => ((100 * (ticks.at(-1) - value)) / height).toFixed(2);
  const toPoint = ([i, value]) => toX(times[i]) + " " + toY(value);
  const join = (points) => "M" + points.map(toPoint).join("L");
  for (const tick of ticks) {
    const text = Number(tick.toPrecision(6));
    const mark = add(figure.querySelector(".ticks"), "span", text);
    mark.style.top = toY(tick) + "%";
  }
  addPath(svg, "grid", ticks.map((tick) => `M0 ${toY(tick)}H1000`).join(""));
  const parts = partsOf(values);
  const beside = (part, sign) => part.map((i) => [i, values[i] + sign * std[i]]);
  if (std) {
    const bands = parts.map(
      (part) => join([...beside(part, 1), ...beside(part, -1).reverse()]) + "Z",
    );
    addPath(svg, "band", bands.join(""));
  }
  const lines = parts.map((part) => join(part.map((i) => [i, values[i]])));
  addPath(svg, "line", lines.join(""));
}

function drawAxis() {
  const steps = [0.1, 0.2, 0.5, 1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 1200, 3600];
  const step = steps.find((s) => length / s <= 10) || 7200;
  for (let time = 0; time <= length * 0.98; time += step) {
    const label = step < 1 ? clock(time) : clock(time).slice(0, -2);
    const mark = add(document.querySelector(".axis"), "span", label);
    mark.style.left = (100 * time) / length + "%";
  }
}

function follow() {
  show();
  if (!video.paused && !video.ended) requestAnimationFrame(follow);
}

track.setAttribute("aria-valuemax", length.toFixed(2));
track.addEventListener("pointerdown", (event) => {
  track.setPointerCapture(event.pointerId);
  seekToPointer(event);
});
track.addEventListener("pointermove", (event) => {
  if (event.buttons & 1) seekToPointer(event);
});
track.addEventListener("keydown", seekByKey);
for (const name of ["seeking", "seeked", "timeupdate", "pause", "loadeddata"]) {
  video.addEventListener(name, show);
}
video.addEventListener("play", follow);
// The style limits the height of the video. The width follows from it, so that there
// are no black bars.
video.addEventListener("loadedmetadata", () => {
  const width = (62 * video.videoWidth) / video.videoHeight;
  video.style.width = `min(100%, ${width}vh)`;
});
listMoments();
drawLevels();
drawCurve("offset", frames.offset_m, frames.offset_std_m, [-0.5, 0.5]);
drawCurve(
  "curvature",
  scaled(frames.curvature_per_m, 1000),
  scaled(frames.curvature_std_per_m, 1000),
  [-1, 1],
);
drawCurve("confidence", frames.confidence, null, [0, 1]);
drawAxis();
show();
loadVideo();
