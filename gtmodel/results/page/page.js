"use strict";
// Zoom and values of the pictures: wheel, drag and keys move the view box; the pointer reads the nearest curve.
const NEAR = 14, STEP = 1.25, SIGNS = new Map([["+", 1 / STEP], ["=", 1 / STEP], ["-", STEP]]);
const shown = (v) => Number(v.toPrecision(5)).toString();
const along = ([low, high, scale], part) =>
  scale === "log" ? low * Math.pow(high / low, part) : low + part * (high - low);

for (const figure of document.querySelectorAll("figure")) {
  const svg = figure.querySelector("svg"), read = figure.querySelector(".read");
  const panels = JSON.parse(figure.querySelector("script").textContent);
  const whole = svg.getAttribute("viewBox").split(" ").map(Number);
  let view = [...whole];
  const set = (next) => { view = next; svg.setAttribute("viewBox", view.join(" ")); };
  const inside = (event) => {
    const p = new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse());
    return [p.x, p.y];
  };
  const zoom = (factor, [x, y] = [view[0] + view[2] / 2, view[1] + view[3] / 2]) => {
    if (view[2] * factor >= whole[2]) return set([...whole]);
    set([x - (x - view[0]) * factor, y - (y - view[1]) * factor, view[2] * factor, view[3] * factor]);
  };
  const move = (dx, dy) => set([view[0] + dx * view[2], view[1] + dy * view[3], view[2], view[3]]);

  const ring = document.createElementNS("http://www.w3.org/2000/svg", "circle");
  ring.setAttribute("fill", "none"); ring.setAttribute("stroke", "black"); ring.setAttribute("r", 4);
  const points = new Map();
  const pointsOf = (id) => {
    if (!points.has(id)) {
      const found = [];
      for (const path of document.getElementById(id)?.querySelectorAll("path") ?? [])
        for (const m of path.getAttribute("d").matchAll(/[ML] (\S+) (\S+)/g)) found.push([+m[1], +m[2]]);
      const uses = document.getElementById(id)?.querySelectorAll("use") ?? [];
      points.set(id, uses.length ? [...uses].map((u) => [+u.getAttribute("x"), +u.getAttribute("y")]) : found);
    }
    return points.get(id);
  };
  svg.addEventListener("pointermove", (event) => {
    if (from) {
      const to = inside(event);
      return set([view[0] + from[0] - to[0], view[1] + from[1] - to[1], view[2], view[3]]);
    }
    const [x, y] = inside(event);
    const panel = panels.find(({ box: b }) => b[0] <= x && x <= b[2] && b[1] <= y && y <= b[3]);
    ring.remove();
    if (!panel) { read.textContent = ""; return; }
    let [px, py] = [x, y], name = "", least = NEAR * view[2] / whole[2];
    for (const [id, label] of Object.entries(panel.curves)) for (const [cx, cy] of pointsOf(id)) {
      const distance = Math.hypot(cx - x, cy - y);
      if (distance < least) { [px, py, name, least] = [cx, cy, label, distance]; ring.setAttribute("cx", cx); ring.setAttribute("cy", cy); svg.append(ring); }
    }
    const [x0, y0, x1, y1] = panel.box;
    const values = [[panel.x, (px - x0) / (x1 - x0)], [panel.y, (y1 - py) / (y1 - y0)]];
    const text = values.map(([axis, part]) => `${axis[3]} = ${shown(along(axis, part))}`).join(", ");
    read.textContent = name ? `${name}: ${text}` : text;
  });
  let from = null;
  svg.addEventListener("pointerdown", (event) => {
    if (view[2] < whole[2]) { from = inside(event); svg.setPointerCapture(event.pointerId); }
  });
  svg.addEventListener("pointerup", () => { from = null; });
  svg.addEventListener("wheel", (event) => {
    if (!event.ctrlKey && view[2] === whole[2] && document.activeElement !== svg) return; // the page scrolls
    event.preventDefault();
    zoom(event.deltaY < 0 ? 1 / STEP : STEP, inside(event));
  }, { passive: false });
  const ARROWS = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1] };
  svg.addEventListener("keydown", (event) => {
    if (SIGNS.has(event.key)) zoom(SIGNS.get(event.key));
    else if (event.key === "0") set([...whole]);
    else if (event.key in ARROWS && view[2] < whole[2]) move(...ARROWS[event.key]);
    else return;
    event.preventDefault();
  });
  const tools = document.createElement("span");
  tools.className = "tools";
  for (const [sign, name, act] of [["+", "zoom in", () => zoom(1 / STEP)], ["−", "zoom out", () => zoom(STEP)], ["0", "whole picture", () => set([...whole])]]) {
    const button = document.createElement("button");
    button.textContent = sign; button.title = name; button.setAttribute("aria-label", name); button.onclick = act;
    tools.append(button);
  }
  figure.append(tools);
}
window.addEventListener("beforeprint", () => { for (const d of document.querySelectorAll("details")) d.open = true; });
