"use strict";
// Runs the script of a scene's page on a canvas that only counts: node fake_browser.js page.html, then one JSON object.
const fs = require("fs"), vm = require("vm");
const html = fs.readFileSync(process.argv[2], "utf8");
const [, data] = html.match(/<script type="application\/json" id="scene">([^]*?)<\/script>/);
const [, script] = html.match(/<script>\n([^]*?)<\/script><\/body>/);

let strokes = [], waiting = [], now = 0;
const pen = () => new Proxy({ style: {} }, {
  get: (own, name) => (name in own ? own[name] : (...args) => { if (["lineTo", "moveTo", "arc", "rect", "fillRect", "fillText"].includes(name)) strokes.push([name, ...args]); }),
  set: (own, name, value) => { own[name] = value; return true; },
});
const element = (tag) => {
  const listeners = {}, g = pen();
  const e = { tag, children: [], clientWidth: 640, clientHeight: 480, attributes: {},
    appendChild: (child) => { e.children.push(child); return child; }, after() {}, focus() {}, setPointerCapture() {},
    setAttribute: (name, value) => { e.attributes[name] = value; }, getContext: () => g, style: {},
    addEventListener: (name, f) => { (listeners[name] ??= []).push(f); },
    fire: (name, event) => (listeners[name] ?? []).forEach((f) => f({ preventDefault() {}, ...event })) };
  return e;
};
const all = [], body = element("body"), fixed = { main: element("main"), h1: element("h1") };
const document = { body, getElementById: () => ({ textContent: data }), querySelector: (name) => fixed[name],
  createElement: (tag) => { const e = element(tag); all.push(e); return e; } };
const forbidden = () => { throw new Error("a request to a network"); };
const window = { devicePixelRatio: 1, addEventListener() {} };
const world = { document, window, location: { hash: "" }, structuredClone, performance: { now: () => now }, console, fetch: forbidden,
  XMLHttpRequest: forbidden, WebSocket: forbidden, requestAnimationFrame: (f) => waiting.push(f), ResizeObserver: class { observe() {} } };
vm.runInNewContext(script, world);

const canvas = all.find((e) => e.tag === "canvas"), slider = all.find((e) => e.type === "range"), button = all.find((e) => e.tag === "button");
const after = (act) => { strokes = []; act(); return JSON.stringify(strokes); };
const shown = after(() => canvas.fire("keydown", { key: "0" }));
const arcs = JSON.parse(shown).filter(([name]) => name === "arc").map(([, x, y]) => [x, y]);
const result = { strokes: JSON.parse(shown).length, arcs, label: canvas.attributes["aria-label"], focusable: canvas.tabIndex === 0,
  finite: !/null/.test(shown), keys: {}, legend: all.filter((e) => e.tag === "li").map((e) => e.textContent.trim()) };
let before = shown;
for (const key of ["ArrowLeft", "ArrowUp", "+", "-", "1", "2", "3", "0"]) {
  const next = after(() => canvas.fire("keydown", { key }));
  result.keys[key] = next !== before; before = next;
}
if (slider) {
  const still = after(() => canvas.fire("keydown", { key: "0" }));
  result.slider = after(() => { slider.value = Math.ceil(slider.max / 2); slider.oninput(); }) !== still;
  canvas.fire("keydown", { key: " " });
  result.plays = button.textContent === "pause";
  for (let k = 0; k < 5000 && waiting.length; k++) { now += 40; waiting.splice(0).forEach((f) => f(now)); }
  result.ends = button.textContent === "play";
}
console.log(JSON.stringify(result));
