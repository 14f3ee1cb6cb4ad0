"use strict";

const data = JSON.parse(document.getElementById("data").textContent);
const SVG = "http://www.w3.org/2000/svg";

/** A new child element. Texts are set as text, never as HTML: names of files are not trusted. */
function add(parent, name, text = "") {
  const child = parent.appendChild(document.createElement(name));
  child.textContent = text;
  return child;
}

function addSvg(parent, name, attributes) {
  const child = parent.appendChild(document.createElementNS(SVG, name));
  for (const [key, value] of Object.entries(attributes)) child.setAttribute(key, value);
  return child;
}

function addTable(parent, title, [headings, rows]) {
  const card = add(parent, "div");
  card.className = "card";
  add(card, "h2", title[0].toUpperCase() + title.slice(1));
  const table = add(card, "table");
  const head = add(add(table, "thead"), "tr");
  for (const heading of ["", ...headings]) add(head, "th", heading);
  const body = add(table, "tbody");
  for (const [name, cells] of Object.entries(rows)) {
    const row = add(body, "tr");
    add(row, "th", name);
    for (const cell of cells) add(row, "td", cell);
  }
}

/** The path through the points of a line, from the top down; it is interrupted where a row has no point. */
function linePath(rows, columns) {
  const order = rows.map((_, k) => k).sort((a, b) => rows[a] - rows[b]);
  let path = "";
  let pen = false;
  for (const k of order) {
    if (columns[k] >= 0) path += (pen ? "L" : "M") + columns[k] + " " + rows[k];
    pen = columns[k] >= 0;
  }
  return path;
}

function addStill(parent, still) {
  const figure = add(parent, "figure");
  const [width, height] = still.size;
  const svg = addSvg(figure, "svg", { viewBox: `-0.5 -0.5 ${width} ${height}`, role: "img", "aria-label": still.name });
  if (still.jpeg) {
    const href = "data:image/jpeg;base64," + still.jpeg;
    addSvg(svg, "image", { href, x: -0.5, y: -0.5, width, height, preserveAspectRatio: "none" });
  }
  still.lanes.forEach(([rows, columns, ego], k) => {
    const kind = k ? "prediction" : "label";
    for (const line of columns) addSvg(svg, "path", { class: kind, d: linePath(rows, line) });
    for (const line of ego) addSvg(svg, "path", { class: kind + " ego", d: linePath(rows, line) });
  });
  const caption = add(figure, "figcaption", still.name);
  const noLane = still.lanes[0][1].every(line => line.every(column => column < 0));
  const facts = [{ true: "right", false: "wrong", null: "not compared" }[still.right]];
  if (noLane) facts.push("no lane is labelled");
  if (still.confidence !== null) facts.push(`confidence ${still.confidence.toFixed(2)}`);
  if (!still.jpeg) facts.push("the picture is not there");
  add(caption, "small", facts.join(", ")).className = still.right === false ? "wrong" : "";
}

const tables = document.getElementById("tables");
for (const [title, table] of Object.entries(data.tables)) addTable(tables, title, table);
const stills = document.getElementById("stills");
for (const still of data.stills) addStill(stills, still);
