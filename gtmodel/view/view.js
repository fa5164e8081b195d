"use strict";
// A scene on a plain canvas: perspective, parts drawn from far to near, time, and signals beside it.
const scene = JSON.parse(document.getElementById("scene").textContent);
const names = Object.keys(scene.points), points = Object.values(scene.points), time = scene.time;
const COLOURS = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000"];
const LOOK = {
  bar: ["#4d4d4d", 0.008], joint: ["#222222", 0.010], cart: ["#555555", 0.022], face: ["#8db3d9", 0.002],
  guideway: ["#b0b0b0", 0.005], path: ["#d55e00", 0.002], axes: ["", 0.004],
};
const MARKS = ["disc", "cross", "ring", "square", "triangle"];
const MARK = { disc: "●", cross: "✕", ring: "○", square: "■", triangle: "▲" };
const AXES = ["#d55e00", "#009e73", "#0072b2"];
const moving = scene.unit === "s"; // or separate poses, a second each when played
let frame = 0; // between two instants it has a fraction

const add = (a, b) => a.map((x, k) => x + b[k]), scaled = (a, s) => a.map((x) => x * s);
const minus = (a, b) => a.map((x, k) => x - b[k]), dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const pointAt = (k, at = frame) => {
  const p = points[k];
  if (!Array.isArray(p[0])) return p;
  const n = Math.min(Math.floor(at), p.length - 2), part = at - n;
  return p.length < 2 ? p[0] : add(scaled(p[n], 1 - part), scaled(p[n + 1], part));
};

// bodies: vertices in a frame of twelve numbers, rows of rotation and position; -1 is the world
const frames = Object.values(scene.frames), triples = (flat) => Array.from({ length: flat.length / 3 }, (_, k) => flat.slice(3 * k, 3 * k + 3));
const bodies = scene.bodies.map(([at, name, colour, opacity, marker, closed, vertices, faces, edges]) => ({ at, name, colour, opacity, marker, closed, faces, edges, vertices: triples(vertices),
  rgb: [1, 3, 5].map((k) => parseInt(colour.slice(k, k + 2), 16)) }));
const placed = (f, list, at = frame) => {
  let m = frames[f];
  if (!m) return list;
  if (Array.isArray(m[0])) {
    const n = Math.min(Math.floor(at), m.length - 1), next = m[Math.min(n + 1, m.length - 1)], part = at - n;
    m = m[n].map((x, k) => x + part * (next[k] - x));
  }
  return list.map(([x, y, z]) => [m[0] * x + m[1] * y + m[2] * z + m[3], m[4] * x + m[5] * y + m[6] * z + m[7], m[8] * x + m[9] * y + m[10] * z + m[11]]);
};
const cornersOf = (list) => {
  const ends = [0, 1, 2].map((k) => list.reduce(([a, b], v) => [Math.min(a, v[k]), Math.max(b, v[k])], [Infinity, -Infinity]));
  return ends[0].flatMap((x) => ends[1].flatMap((y) => ends[2].map((z) => [x, y, z])));
};
const everything = points.flatMap((p) => (Array.isArray(p[0]) ? p : [p])).concat(bodies.flatMap((b) => {
  const corners = cornersOf(b.vertices), m = frames[b.at];
  return m && Array.isArray(m[0]) ? m.flatMap((_, k) => (k % 8 ? [] : placed(b.at, corners, k))) : placed(b.at, corners);
}));

// the box of everything at all times
const low = [1e9, 1e9, 1e9], high = [-1e9, -1e9, -1e9];
for (const x of everything) x.forEach((v, k) => { low[k] = Math.min(low[k], v); high[k] = Math.max(high[k], v); });
const size = Math.hypot(...minus(high, low)) || 1;
const HOME = { azimuth: -0.96, elevation: 0.35, distance: 4 * size, target: scaled(add(low, high), 0.5) };
let camera = structuredClone(HOME);

const make = (tag, parent, more = {}) => parent.appendChild(Object.assign(document.createElement(tag), more));
if (scene.note) document.querySelector("h1").after(make("p", document.body, { className: "note", textContent: scene.note }));
const main = document.querySelector("main"), space = make("div", main, { className: "space" });
const canvas = make("canvas", space, { tabIndex: 0 });
const within = window.parent && window.parent !== window; // another page, which scrolls over the scene until it is clicked
if (within) canvas.style.touchAction = "pan-y";
canvas.setAttribute("role", "img");
canvas.setAttribute("aria-label", `${scene.title}: ${scene.parts.length + bodies.length} parts in space. Arrow keys turn the view, plus and minus zoom, space plays.`);
make("div", space, { className: "help", textContent: `drag: turn · shift + drag: move · ${within ? "click, " : ""}wheel: zoom · keys: arrows, + −, 0: all, 1 2 3: front, side, top` });
const legend = bodies.filter((b) => b.marker && b.name);
if (legend.length) {
  const list = make("ul", space, { className: "legend" });
  for (const b of legend) make("span", make("li", list, { textContent: ` ${b.name}` }), { textContent: MARK[b.marker], style: `color:${b.colour}` });
}
const tip = make("div", space, { className: "tip", hidden: true });

let view = null; // axes of the camera, and the projection, of the last drawing
const look = () => {
  const [ca, sa, ce, se] = [Math.cos(camera.azimuth), Math.sin(camera.azimuth), Math.cos(camera.elevation), Math.sin(camera.elevation)];
  const out = [ce * ca, ce * sa, se], right = [-sa, ca, 0], up = [-se * ca, -se * sa, ce];
  const eye = add(camera.target, scaled(out, camera.distance));
  const [w, h] = [canvas.clientWidth, canvas.clientHeight], focal = 3 * Math.min(w, h);
  view = { out, right, up, eye, w, h, focal };
};
const project = (p) => {
  const d = minus(p, view.eye), depth = Math.max(-dot(d, view.out), 0.02 * size), f = view.focal / depth;
  return [view.w / 2 + f * dot(d, view.right), view.h / 2 - f * dot(d, view.up), depth, f];
};
const sized = (c) => {
  const ratio = window.devicePixelRatio || 1, w = Math.round(c.clientWidth * ratio), h = Math.round(c.clientHeight * ratio);
  if (c.width !== w || c.height !== h) [c.width, c.height] = [w, h];
  const g = c.getContext("2d");
  g.setTransform(ratio, 0, 0, ratio, 0, 0);
  return g;
};
const line = (g, a, b, width, colour, cap = "round") => {
  g.strokeStyle = colour; g.lineWidth = Math.max(width, 0.6); g.lineCap = cap;
  g.beginPath(); g.moveTo(a[0], a[1]); g.lineTo(b[0], b[1]); g.stroke();
};
const disc = (g, p, radius, colour) => {
  g.fillStyle = colour; g.beginPath(); g.arc(p[0], p[1], Math.max(radius, 1), 0, 7); g.fill();
  g.fillStyle = "rgba(255,255,255,.45)"; g.beginPath(); g.arc(p[0] - 0.3 * radius, p[1] - 0.3 * radius, 0.35 * radius, 0, 7); g.fill();
};

// grid of the floor, with a step of 1, 2 or 5
const step = (() => { const s = size / 8, e = 10 ** Math.floor(Math.log10(s)); return [1, 2, 5, 10].find((m) => m * e >= s) * e; })();
const drawFloor = (g) => {
  const [x0, x1, y0, y1] = [Math.floor(low[0] / step) - 1, Math.ceil(high[0] / step) + 1, Math.floor(low[1] / step) - 1, Math.ceil(high[1] / step) + 1];
  const z = low[2], at = (x, y) => project([x * step, y * step, z]);
  for (let x = x0; x <= x1; x++) line(g, at(x, y0), at(x, y1), 0.6, "#d8d8d8");
  for (let y = y0; y <= y1; y++) line(g, at(x0, y), at(x1, y), 0.6, "#d8d8d8");
  // numbers at the edges that are far from the eye: these are in the picture, and the robot does not stand on them
  const [xf, dx] = view.out[0] > 0 ? [x0, -0.35] : [x1, 0.35], [yf, dy] = view.out[1] > 0 ? [y0, -0.35] : [y1, 0.35];
  const text = (v, axis, middle) => `${middle ? `${axis} = ` : ""}${Number((v * step).toPrecision(4))}${middle ? " m" : ""}`;
  g.font = "12px sans-serif"; g.fillStyle = "#777"; g.textAlign = "center";
  const put = (words, [x, y]) => { const half = 3.4 * words.length, whole = Math.min(Math.max(x, half), view.w - half); g.fillText(words, Math.abs(whole - x) < 2 * half ? whole : x, y); }; // not cut off at an edge
  for (let x = x0; x <= x1; x++) if (x !== xf) put(text(x, "x", x === Math.round((x0 + x1) / 2)), at(x, yf + dy));
  for (let y = y0; y <= y1; y++) if (y !== yf) put(text(y, "y", y === Math.round((y0 + y1) / 2)), at(xf + dx, y));
  g.textAlign = "left";
};

// a mark of 4 pixels to each side
const mark = (g, [x, y], marker, colour) => {
  g.fillStyle = g.strokeStyle = colour; g.lineWidth = 1.5; g.beginPath();
  if (marker === "disc" || marker === "ring") g.arc(x, y, 3.2, 0, 7);
  else if (marker === "square") g.rect(x - 3, y - 3, 6, 6);
  else if (marker === "triangle") { g.moveTo(x, y - 4); g.lineTo(x + 4, y + 3); g.lineTo(x - 4, y + 3); g.closePath(); }
  else { g.moveTo(x - 3.2, y - 3.2); g.lineTo(x + 3.2, y + 3.2); g.moveTo(x - 3.2, y + 3.2); g.lineTo(x + 3.2, y - 3.2); }
  if (marker === "ring" || marker === "cross") g.stroke(); else g.fill();
};
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const drawBodies = (items) => {
  const light = add(view.out, scaled(view.up, 0.6));
  for (const b of bodies) {
    const world = placed(b.at, b.vertices), p = world.map(project);
    for (let n = 0; n < b.faces.length; n += 3) {
      const [i, j, k] = [b.faces[n], b.faces[n + 1], b.faces[n + 2]], [u, v, w] = [p[i], p[j], p[k]];
      if (b.closed && (v[0] - u[0]) * (w[1] - u[1]) - (v[1] - u[1]) * (w[0] - u[0]) >= 0) continue; // it looks away
      const normal = cross(minus(world[j], world[i]), minus(world[k], world[i]));
      const bright = 0.55 + 0.4 * Math.abs(dot(normal, light)) / (Math.hypot(...normal) * 1.17 || 1);
      const paint = `rgba(${b.rgb.map((x) => Math.round(x * bright))},${b.opacity})`;
      items.push([(u[2] + v[2] + w[2]) / 3, (g) => {
        g.fillStyle = paint; g.beginPath(); g.moveTo(u[0], u[1]); g.lineTo(v[0], v[1]); g.lineTo(w[0], w[1]); g.closePath(); g.fill();
        if (b.opacity === 1) { g.strokeStyle = paint; g.lineWidth = 0.8; g.stroke(); } // no gap between triangles
      }]);
    }
    for (let n = 0; n < b.edges.length; n += 2) {
      const [u, v] = [p[b.edges[n]], p[b.edges[n + 1]]];
      items.push([(u[2] + v[2]) / 2, (g) => line(g, u, v, 1.2, b.colour)]);
    }
    if (b.marker) for (const q of p) items.push([q[2], (g) => mark(g, q, b.marker, b.colour)]);
  }
};
const drawn = () => {
  const items = [];
  drawBodies(items);
  for (const [shape, of, name, own] of scene.parts) {
    const [usual, width] = LOOK[shape], colour = own || usual, p = of.map((k) => project(pointAt(k)));
    const thick = (q) => 2 * width * size * q[3];
    if (shape === "bar" || shape === "guideway") {
      // in pieces, so that a long bar is behind one part and before another
      const ends = of.map((k) => pointAt(k)), n = 8;
      let before = p[0];
      for (let k = 1; k <= n; k++) {
        const next = project(add(scaled(ends[0], 1 - k / n), scaled(ends[1], k / n))), from = before;
        items.push([(from[2] + next[2]) / 2 + (shape === "guideway" ? 0.05 * size : 0), (g) => {
          const d = Math.hypot(next[0] - from[0], next[1] - from[1]) || 1, over = 0.6 / d; // no gap between pieces
          const to = [next[0] + over * (next[0] - from[0]), next[1] + over * (next[1] - from[1])];
          line(g, from, to, thick(from), colour, "butt");
          if (shape === "bar") line(g, from, next, 0.25 * thick(from), "rgba(255,255,255,.3)", "butt");
        }]);
        before = next;
      }
    } else if (shape === "joint" || shape === "cart") {
      items.push([p[0][2] - 0.004 * size, (g) => {
        const r = thick(p[0]) / 2;
        if (shape === "joint") return disc(g, p[0], r, colour);
        g.fillStyle = colour; g.fillRect(p[0][0] - r, p[0][1] - r, 2 * r, 2 * r);
      }]);
    } else if (shape === "face") {
      items.push([p.reduce((s, q) => s + q[2], 0) / p.length, (g) => {
        g.fillStyle = colour + "b0"; g.strokeStyle = "#555"; g.lineWidth = 1;
        g.beginPath(); p.forEach((q) => g.lineTo(q[0], q[1])); g.closePath(); g.fill(); g.stroke();
      }]);
    } else if (shape === "path" && Array.isArray(points[of[0]][0])) {
      const trace = points[of[0]].map(project);
      items.push([Math.max(...trace.map((q) => q[2])), (g) => {
        g.strokeStyle = colour; g.lineWidth = 1.5; // not dashed: on a way to and fro the dashes would fill each other
        g.beginPath(); trace.forEach((q) => g.lineTo(q[0], q[1])); g.stroke();
      }]);
    } else if (shape === "axes") {
      for (let k = 1; k < 4; k++) items.push([p[k][2] - 0.01 * size, (g) => {
        line(g, p[0], p[k], thick(p[0]), AXES[k - 1]); g.fillStyle = AXES[k - 1]; g.font = "12px sans-serif"; g.fillText("xyz"[k - 1], p[k][0] + 3, p[k][1]);
      }]);
    }
  }
  return items.sort((a, b) => b[0] - a[0]);
};
const FILLED = 0.72; // of the canvas by the robot, at first
let fitted = false;
const fit = () => {
  // everything at all times, in a few steps, as the perspective changes with the distance
  for (let k = 0; k < 5; k++) {
    look();
    const q = everything.map(project), [x, y] = [q.map((p) => p[0]), q.map((p) => p[1])];
    const box = [Math.min(...x), Math.max(...x), Math.min(...y), Math.max(...y)], s = camera.distance / view.focal;
    const dx = view.w / 2 - (box[0] + box[1]) / 2, dy = view.h / 2 - (box[2] + box[3]) / 2;
    camera.target = add(camera.target, add(scaled(view.right, -dx * s), scaled(view.up, dy * s)));
    camera.distance *= Math.max((box[1] - box[0]) / view.w, (box[3] - box[2]) / view.h) / FILLED;
  }
};
const draw = () => {
  if (!fitted && canvas.clientWidth) { fitted = true; fit(); }
  look();
  const g = sized(canvas);
  g.clearRect(0, 0, view.w, view.h);
  drawFloor(g);
  for (const [, paint] of drawn()) paint(g);
  charts.forEach((chart) => chart());
  if (slider) { slider.value = frame; shown.textContent = moving ? `${timeAt(frame).toFixed(3)} s` : `${scene.unit} ${timeAt(frame)} of ${time.at(-1)}`; }
};

// signals beside the scene
const timeAt = (at) => { const n = Math.min(Math.floor(at), time.length - 2); return n < 0 ? time[0] : time[n] + (at - n) * (time[n + 1] - time[n]); };
const frameAt = (t) => { let n = time.findIndex((x) => x > t) - 1; if (n < 0) return t <= time[0] ? 0 : time.length - 1; return n + (t - time[n]) / (time[n + 1] - time[n]); };
const DASHES = [[], [7, 2], [2, 2]], FOOT = 16; // neighbouring curves differ in grey too; FOOT: height of the numbers below
const charts = [], beside = scene.signals.length ? make("div", main, { className: "beside" }) : null;
for (const { name, unit, values, limits } of scene.signals) {
  const c = make("canvas", beside), all = [...values.flat(), ...(limits ?? [])].filter(Number.isFinite);
  c.setAttribute("role", "img"); c.setAttribute("aria-label", `${name} over time`);
  let [bottom, top] = [Math.min(...all), Math.max(...all)];
  const constant = !(top - bottom > 1e-12 * Math.max(1, Math.abs(top)));
  if (constant) [bottom, top] = [bottom - 1, top + 1];
  const ticks = [bottom, (bottom + top) / 2, top];
  [bottom, top] = [bottom - 0.06 * (top - bottom), top + 0.06 * (top - bottom)];
  // three digits, and no more decimals than the range has: numbers of one width do not run into each other
  const decimals = constant ? 20 : Math.min(Math.max(3 - Math.floor(Math.log10(ticks[2] - ticks[0])), 0), 20);
  const left = 48, label = (v) => Number(Number(v.toFixed(decimals)).toPrecision(3)) + 0;
  const shown = values.slice(0, 6), head = shown.length > 3 ? 32 : 18; // many values stand below the name
  charts.push(() => {
    const g = sized(c), [w, h] = [c.clientWidth, c.clientHeight - FOOT];
    const x = (t) => left + (t - time[0]) / (time.at(-1) - time[0] || 1) * (w - left - 6), y = (v) => head + (top - v) / (top - bottom) * (h - head);
    g.clearRect(0, 0, w, h + FOOT);
    g.strokeStyle = "#ccc"; g.lineWidth = 1; g.strokeRect(left, head, w - left - 6, h - head);
    g.font = "12px sans-serif"; g.fillStyle = "#222"; g.textAlign = "left"; g.fillText(unit === "1" ? name : `${name} [${unit}]`, left, 12);
    g.textAlign = "right"; g.fillStyle = "#555"; for (const v of ticks) g.fillText(label(v), left - 4, Math.min(Math.max(y(v) + 4, head + 8), h));
    const ends = [time[0], time.at(-1)].map((t) => Number(t.toPrecision(4)));
    g.fillText(moving ? `${ends[1]} s` : `${scene.unit} ${ends[1]}`, w - 6, h + 12); g.textAlign = "left"; g.fillText(ends[0], left, h + 12);
    g.setLineDash([3, 3]); for (const v of limits ?? []) line(g, [left, y(v)], [w - 6, y(v)], 1, "#777"); g.setLineDash([]);
    values.forEach((row, k) => {
      g.strokeStyle = COLOURS[k % COLOURS.length]; g.lineWidth = 1.6; g.setLineDash(DASHES[k % DASHES.length]);
      if (moving) { g.beginPath(); row.forEach((v, n) => g.lineTo(x(time[n]), y(v))); g.stroke(); }
      else row.forEach((v, n) => mark(g, [x(time[n]), y(v)], MARKS[k % MARKS.length], COLOURS[k % COLOURS.length]));
    });
    g.setLineDash([]); line(g, [x(timeAt(frame)), head], [x(timeAt(frame)), h], 1, "#000");
    const n = Math.round(frame); g.textAlign = "right";
    shown.forEach((row, k) => { g.fillStyle = COLOURS[k]; g.fillText(label(row[n]), w - 6 - (shown.length - 1 - k) * 46, head - 6); });
  });
  c.addEventListener("pointerdown", (e) => { frame = frameAt(time[0] + (e.offsetX - left) / (c.clientWidth - left - 6) * (time.at(-1) - time[0])); draw(); });
}

// time
let slider = null, shown = null, playing = false, last = 0;
const last_frame = time.length - 1;
const play = (on) => { playing = on; button.textContent = on ? "pause" : "play"; last = performance.now(); if (on) { if (frame >= last_frame) frame = 0; requestAnimationFrame(tick); } };
const tick = (now) => {
  if (!playing) return;
  if (!moving && now - last < 1000 / Number(speed.value)) return requestAnimationFrame(tick);
  const t = moving ? timeAt(frame) + (now - last) / 1000 * Number(speed.value) : time[Math.min(Math.floor(frame) + 1, last_frame)];
  last = now; frame = t >= time.at(-1) ? last_frame : frameAt(t);
  draw();
  if (frame >= last_frame) play(false); else requestAnimationFrame(tick);
};
let button = null, speed = null;
if (last_frame > 0) {
  const bar = make("div", document.body, { className: "bar" });
  button = make("button", bar, { textContent: "play", onclick: () => play(!playing) });
  slider = make("input", bar, { type: "range", min: 0, max: last_frame, step: moving ? "any" : 1, value: 0 });
  slider.setAttribute("aria-label", "time");
  slider.oninput = () => { play(false); frame = Number(slider.value); draw(); };
  shown = make("output", bar);
  const choice = make("label", bar, { textContent: "speed " });
  speed = make("select", choice);
  for (const s of [0.1, 0.25, 0.5, 1, 2, 5]) make("option", speed, { value: s, textContent: `${s} x`, selected: s === 1 });
}

// pointer and keys
const turn = (da, de) => { camera.azimuth += da; camera.elevation = Math.min(1.57, Math.max(-1.57, camera.elevation + de)); draw(); };
const zoom = (factor) => { camera.distance = Math.min(20 * size, Math.max(0.05 * size, camera.distance * factor)); draw(); };
const shift = (dx, dy) => { const s = camera.distance / view.focal; camera.target = add(camera.target, add(scaled(view.right, -dx * s), scaled(view.up, dy * s))); draw(); };
const held = new Map();
canvas.addEventListener("pointerdown", (e) => { held.set(e.pointerId, [e.clientX, e.clientY]); canvas.setPointerCapture(e.pointerId); canvas.focus(); });
for (const over of ["pointerup", "pointercancel"]) canvas.addEventListener(over, (e) => held.delete(e.pointerId));
canvas.addEventListener("pointermove", (e) => {
  const before = held.get(e.pointerId);
  if (!before) return hover(e);
  const [dx, dy] = [e.clientX - before[0], e.clientY - before[1]];
  if (held.size === 2) {
    const [a, b] = [...held.keys()], other = held.get(e.pointerId === a ? b : a);
    const gap = (p) => Math.hypot(p[0] - other[0], p[1] - other[1]);
    zoom(gap(before) / (gap([e.clientX, e.clientY]) || 1));
  } else if (e.shiftKey || e.buttons === 2 || e.buttons === 4) shift(dx, dy); else turn(-0.008 * dx, 0.008 * dy);
  held.set(e.pointerId, [e.clientX, e.clientY]);
});
canvas.addEventListener("contextmenu", (e) => e.preventDefault());
canvas.addEventListener("wheel", (e) => {
  if (within && !e.ctrlKey && document.activeElement !== canvas) return;
  e.preventDefault(); zoom(Math.exp(0.001 * e.deltaY));
}, { passive: false });
canvas.addEventListener("pointerleave", () => { tip.hidden = true; });
const hover = (e) => {
  let best = 12, found = null;
  points.forEach((_, k) => { const p = pointAt(k), q = project(p), d = Math.hypot(q[0] - e.offsetX, q[1] - e.offsetY); if (d < best) [best, found] = [d, [names[k], p]]; });
  for (const b of bodies) if (b.marker) placed(b.at, b.vertices).forEach((p) => { const q = project(p), d = Math.hypot(q[0] - e.offsetX, q[1] - e.offsetY); if (d < best) [best, found] = [d, [b.name, p]]; });
  tip.hidden = !found;
  if (!found) return;
  tip.textContent = `${found[0]}\n${found[1].map((x) => x.toFixed(4)).join(", ")} m`;
  tip.style.left = `${e.offsetX + 14}px`; tip.style.top = `${e.offsetY + 8}px`;
};
const KEYS = {
  ArrowLeft: () => turn(-0.1, 0), ArrowRight: () => turn(0.1, 0), ArrowUp: () => turn(0, 0.1), ArrowDown: () => turn(0, -0.1),
  "+": () => zoom(0.87), "=": () => zoom(0.87), "-": () => zoom(1.15), "0": () => { camera = structuredClone(HOME); fitted = false; draw(); },
  "1": () => { Object.assign(camera, { azimuth: -Math.PI / 2, elevation: 0 }); fitted = false; draw(); }, "2": () => { Object.assign(camera, { azimuth: 0, elevation: 0 }); fitted = false; draw(); },
  "3": () => { Object.assign(camera, { azimuth: -Math.PI / 2, elevation: 1.57 }); fitted = false; draw(); },
  " ": () => last_frame > 0 && play(!playing), ",": () => { frame = Math.max(0, Math.ceil(frame) - 1); draw(); }, ".": () => { frame = Math.min(last_frame, Math.floor(frame) + 1); draw(); },
};
canvas.addEventListener("keydown", (e) => { if (KEYS[e.key]) { e.preventDefault(); KEYS[e.key](); } });
if (last_frame > 0 && location.hash) frame = frameAt(Number(location.hash.slice(1)) || 0); // file.html#0.5 begins there
new ResizeObserver(() => requestAnimationFrame(draw)).observe(canvas);
window.addEventListener("beforeprint", draw);
draw();
