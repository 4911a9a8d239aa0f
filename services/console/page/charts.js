// Strip charts on a canvas: a window of time that moves, as many signals as one likes, each chart its own scale.
"use strict";
const COLOURS = ["#1c5fa8", "#c8501e", "#16794a", "#8a3ea8", "#b3261e", "#0b7a8a", "#9a6b00", "#4b5563"];
const SAMPLES = 12288;

// One signal's newest samples in a ring.
class Trace {
  constructor(name) { this.name = name; this.clear(); }
  clear() { this.t = new Float64Array(SAMPLES); this.v = new Float32Array(SAMPLES); this.n = 0; }
  push(t, v) {
    const last = this.n ? this.t[(this.n - 1) % SAMPLES] : -Infinity;
    if (t < last) this.n = 0;
    const at = this.n % SAMPLES;
    this.t[at] = t; this.v[at] = v === null ? NaN : v; this.n++;
  }
  last() { return this.n ? this.v[(this.n - 1) % SAMPLES] : NaN; }
  time() { return this.n ? this.t[(this.n - 1) % SAMPLES] : 0; }
}

const shortNumber = (v) => {
  if (!Number.isFinite(v)) return "–";
  const a = Math.abs(v);
  return a >= 1000 ? v.toFixed(0) : a >= 100 ? v.toFixed(1) : a >= 1 ? v.toFixed(2) : a === 0 ? "0" : v.toFixed(4);
};

// Steps of 1, 2 or 5 times a power of ten: where, and what to write there.
function ticks(low, high, count) {
  const raw = (high - low) / count, power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map((m) => m * power).find((s) => s >= raw) || raw;
  const found = [];
  const digits = Math.max(0, Math.min(9, -Math.floor(Math.log10(step) + 1e-9)));
  for (let v = Math.ceil(low / step) * step; v <= high + 1e-9 * step; v += step) found.push([v, (Math.abs(v) < 1e-9 * step ? 0 : v).toFixed(digits)]);
  return found;
}

class StripChart {
  constructor(parent, height) {
    this.box = document.createElement("div");
    this.box.className = "chart";
    this.legend = document.createElement("div");
    this.legend.className = "legend";
    this.canvas = document.createElement("canvas");
    this.canvas.height = height;
    this.canvas.style.height = `${height}px`;
    this.box.append(this.legend, this.canvas);
    parent.append(this.box);
    this.traces = [];
    this.units = {};
    this.cursor = null;
    this.canvas.onmousemove = (e) => { this.cursor = e.offsetX; };
    this.canvas.onmouseleave = () => { this.cursor = null; };
    this.remove = null;
  }
  set(traces, units) {
    this.traces = traces;
    this.legend.replaceChildren(...traces.map((trace, i) => {
      const item = document.createElement("span"), line = document.createElement("i"), value = document.createElement("b");
      line.style.background = COLOURS[i % COLOURS.length];
      item.append(line, `${trace.name} [${units[trace.name] || "1"}] `, value);
      item.title = "click to take it off";
      item.onclick = () => this.remove && this.remove(trace.name);
      return item;
    }));
  }
  draw(end, window_s) {
    const canvas = this.canvas, width = canvas.clientWidth;
    if (!width) return;
    if (canvas.width !== width) canvas.width = width;
    const g = canvas.getContext("2d"), height = canvas.height, left = 62, bottom = 20;
    g.clearRect(0, 0, width, height);
    const from = end - window_s;
    let low = Infinity, high = -Infinity;
    for (const trace of this.traces) {
      for (let i = Math.max(0, trace.n - SAMPLES); i < trace.n; i++) {
        const at = i % SAMPLES, v = trace.v[at];
        if (trace.t[at] >= from && trace.t[at] <= end && v === v) { if (v < low) low = v; if (v > high) high = v; }
      }
    }
    if (!(low <= high)) { low = -1; high = 1; }
    const room = Math.max((high - low) * 0.08, Math.abs(high) * 1e-3, 1e-6);
    low -= room; high += room;
    const x = (t) => left + (t - from) / window_s * (width - left - 4), y = (v) => 4 + (high - v) / (high - low) * (height - bottom - 4);
    g.font = "12px system-ui, sans-serif"; g.lineWidth = 1; g.strokeStyle = "#e3e8ec"; g.fillStyle = "#5b6875";
    g.textAlign = "right"; g.textBaseline = "middle";
    g.beginPath();
    for (const [v, text] of ticks(low, high, 4)) { g.moveTo(left, y(v)); g.lineTo(width - 4, y(v)); g.fillText(text, left - 6, y(v)); }
    g.textAlign = "center"; g.textBaseline = "top";
    for (const [t, text] of ticks(from, end, Math.max(3, width / 90))) { g.moveTo(x(t), 4); g.lineTo(x(t), height - bottom); g.fillText(text, x(t), height - bottom + 4); }
    g.stroke();
    this.traces.forEach((trace, i) => {
      g.strokeStyle = COLOURS[i % COLOURS.length]; g.lineWidth = 1.6; g.beginPath();
      let pen = false;
      for (let k = Math.max(0, trace.n - SAMPLES); k < trace.n; k++) {
        const at = k % SAMPLES, t = trace.t[at], v = trace.v[at];
        if (t < from || t > end || v !== v) { pen = false; continue; }
        if (pen) g.lineTo(x(t), y(v)); else g.moveTo(x(t), y(v));
        pen = true;
      }
      g.stroke();
    });
    let at = null;
    if (this.cursor !== null && this.cursor > left) {
      at = from + (this.cursor - left) / (width - left - 4) * window_s;
      g.strokeStyle = "#16202a"; g.lineWidth = 1; g.beginPath(); g.moveTo(this.cursor, 4); g.lineTo(this.cursor, height - bottom); g.stroke();
      g.fillStyle = "#16202a"; g.fillText(`${at.toFixed(3)} s`, this.cursor, 6);
    }
    this.traces.forEach((trace, i) => {
      const value = this.legend.children[i].lastChild, shown = shortNumber(at === null ? trace.last() : near(trace, at));
      if (value.textContent !== shown) value.textContent = shown;
    });
  }
}

function near(trace, t) {
  let best = NaN, away = Infinity;
  for (let k = Math.max(0, trace.n - SAMPLES); k < trace.n; k++) {
    const d = Math.abs(trace.t[k % SAMPLES] - t);
    if (d < away) { away = d; best = trace.v[k % SAMPLES]; }
  }
  return best;
}
