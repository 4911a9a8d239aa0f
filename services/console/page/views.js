// Gauges, the front suspension in space, the car from above. Frames: ISO 8855, x forward, y left, z up.
"use strict";
class Gauge {
  constructor(parent, label, unit, low, high, digits) {
    Object.assign(this, { low, high, unit, digits, value: NaN });
    const box = document.createElement("div");
    box.className = "gauge";
    this.canvas = document.createElement("canvas"); this.canvas.width = 200; this.canvas.height = 96;
    this.v = document.createElement("div"); this.v.className = "v";
    const l = document.createElement("div"); l.className = "l"; l.textContent = `${label} [${unit}]`;
    box.append(this.canvas, this.v, l);
    parent.append(box);
  }
  set(value) {
    if (value === null || value === undefined) value = NaN;
    const shown = Number.isFinite(value) ? value.toFixed(this.digits) : "–";
    if (shown === this.v.textContent && this.value === value) return;
    this.v.textContent = shown; this.value = value;
    const g = this.canvas.getContext("2d"), cx = 100, cy = 88, r = 72;
    g.clearRect(0, 0, 200, 96);
    const angle = (v) => Math.PI + Math.PI * Math.min(1, Math.max(0, (v - this.low) / (this.high - this.low)));
    g.lineWidth = 13; g.strokeStyle = "#e3e8ec"; g.beginPath(); g.arc(cx, cy, r, Math.PI, 2 * Math.PI); g.stroke();
    if (Number.isFinite(value)) {
      const zero = angle(Math.max(this.low, Math.min(this.high, 0))), to = angle(value);
      g.strokeStyle = "#1c5fa8"; g.beginPath(); g.arc(cx, cy, r, Math.min(zero, to), Math.max(zero, to)); g.stroke();
      g.strokeStyle = "#16202a"; g.lineWidth = 3; g.beginPath();
      g.moveTo(cx + 20 * Math.cos(to), cy + 20 * Math.sin(to)); g.lineTo(cx + (r + 8) * Math.cos(to), cy + (r + 8) * Math.sin(to)); g.stroke();
    }
    g.fillStyle = "#5b6875"; g.font = "12px system-ui, sans-serif"; g.textAlign = "left"; g.fillText(`${this.low}`, 4, 92);
    g.textAlign = "right"; g.fillText(`${this.high}`, 196, 92);
  }
}

const add = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]], sub = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const times = (s, a) => [s * a[0], s * a[1], s * a[2]], size = (a) => Math.hypot(...a);
// Turns a vector by a unit quaternion, scalar first.
function turn(q, a) {
  const [w, x, y, z] = q, t = [2 * (y * a[2] - z * a[1]), 2 * (z * a[0] - x * a[2]), 2 * (x * a[1] - y * a[0])];
  return [a[0] + w * t[0] + y * t[2] - z * t[1], a[1] + w * t[1] + z * t[0] - x * t[2], a[2] + w * t[2] + x * t[1] - y * t[0]];
}

// Points on the body stay, points on the knuckle go with its pose, the tie rod's inner ball goes with the rack.
class SuspensionView {
  constructor(canvas) {
    this.canvas = canvas; this.azimuth = 0.62; this.elevation = 0.32; this.sides = null;
    let from = null;
    canvas.onpointerdown = (e) => { from = [e.clientX, e.clientY]; canvas.setPointerCapture(e.pointerId); };
    canvas.onpointermove = (e) => {
      if (!from) return;
      this.azimuth += (e.clientX - from[0]) * 0.008;
      this.elevation = Math.max(-1.4, Math.min(1.4, this.elevation + (e.clientY - from[1]) * 0.006));
      from = [e.clientX, e.clientY];
    };
    canvas.onpointerup = () => { from = null; };
  }
  geometry(axle) {
    if (!axle || !axle.left) { this.sides = null; return; }
    const named = (points, mirror) => {
      const found = {};
      for (const [key, p] of Object.entries(points || {})) {
        if (key.endsWith("_m") && Array.isArray(p)) found[key.slice(0, -2)] = mirror ? [p[0], -p[1], p[2]] : p.slice();
      }
      return found;
    };
    this.type = axle.type;
    this.sides = [named(axle.left, false), axle.right ? named(axle.right, false) : named(axle.left, true)];
  }
  links() {
    if (this.type === "strut") return [["lca_front", "lca_ball"], ["lca_rear", "lca_ball"], ["strut_top", "strut_lower"]];
    if (this.type === "double_wishbone") return [["uca_front", "uca_ball"], ["uca_rear", "uca_ball"], ["lca_front", "lca_ball"], ["lca_rear", "lca_ball"]];
    return [...new Set(Object.keys(this.sides[0]).filter((k) => k.endsWith("_inner") && !k.startsWith("tierod")))].map((k) => [k, k.replace("_inner", "_outer")]);
  }
  draw(pose) {
    const c = this.canvas, g = c.getContext("2d"), w = c.width, h = c.height;
    g.clearRect(0, 0, w, h);
    if (!this.sides) { g.fillStyle = "#5b6875"; g.font = "16px system-ui, sans-serif"; g.fillText("no geometry", 20, 30); return; }
    const ca = Math.cos(this.azimuth), sa = Math.sin(this.azimuth), ce = Math.cos(this.elevation), se = Math.sin(this.elevation);
    const project = (p) => {
      const x = p[0] * ca - p[1] * sa, y = p[0] * sa + p[1] * ca, z = p[2] - 0.05;
      const depth = 3.4 - (x * ce - z * se), scale = 1.3 * w / depth;
      return [w / 2 - y * scale, h / 2 - (x * se + z * ce) * scale];
    };
    const line = (a, b, colour, width) => {
      const p = project(a), q = project(b);
      g.strokeStyle = colour; g.lineWidth = width; g.beginPath(); g.moveTo(p[0], p[1]); g.lineTo(q[0], q[1]); g.stroke();
    };
    const dot = (a, colour, r) => { const p = project(a); g.fillStyle = colour; g.beginPath(); g.arc(p[0], p[1], r, 0, 7); g.fill(); };
    const arrow = (from, vector, colour) => {
      if (!(size(vector) > 0.01)) return;
      const p = project(from), q = project(add(from, vector)), a = Math.atan2(q[1] - p[1], q[0] - p[0]);
      g.strokeStyle = g.fillStyle = colour; g.lineWidth = 4; g.beginPath(); g.moveTo(p[0], p[1]); g.lineTo(q[0], q[1]); g.stroke();
      g.beginPath(); g.moveTo(q[0], q[1]); g.lineTo(q[0] - 12 * Math.cos(a - 0.4), q[1] - 12 * Math.sin(a - 0.4));
      g.lineTo(q[0] - 12 * Math.cos(a + 0.4), q[1] - 12 * Math.sin(a + 0.4)); g.fill();
    };
    const rack = pose ? pose.rack : 0, inner = this.sides.map((s) => add(s.tierod_inner, [0, rack, 0]));
    line(inner[0], inner[1], "#4b5563", 5);
    this.sides.forEach((side, i) => {
      const known = pose && pose.q[i].every(Number.isFinite), q = known ? pose.q[i] : [1, 0, 0, 0];
      const centre = known ? pose.centre[i] : side.wheel_centre;
      const moved = (p) => add(centre, turn(q, sub(p, side.wheel_centre)));
      for (const [body, knuckle] of this.links()) {
        if (side[body] && side[knuckle]) { line(side[body], moved(side[knuckle]), "#1c5fa8", 3); dot(side[body], "#16202a", 3); dot(moved(side[knuckle]), "#c8501e", 4); }
      }
      if (side.spring_upper && side.spring_lower) line(side.spring_upper, side.spring_lower, "#9aa7b3", 2);
      const ball = moved(side.tierod_outer);
      line(inner[i], ball, "#16794a", 4); dot(ball, "#c8501e", 4); dot(inner[i], "#16202a", 4);
      for (const key of ["uca_ball", "lca_ball", "strut_lower", "tierod_outer"]) if (side[key]) line(centre, moved(side[key]), "#c9ced4", 2);
      const radius = size(sub(side.contact_patch, side.wheel_centre)), sign = i ? -1 : 1;
      for (const [off, colour] of [[-0.09, "#8b96a1"], [0.09, "#5b6875"]]) {
        g.strokeStyle = colour; g.lineWidth = 2; g.beginPath();
        for (let k = 0; k <= 40; k++) {
          const a = k / 40 * 2 * Math.PI, p = project(moved(add(side.wheel_centre, [radius * Math.cos(a), sign * off, radius * Math.sin(a)])));
          if (k) g.lineTo(p[0], p[1]); else g.moveTo(p[0], p[1]);
        }
        g.stroke();
      }
      if (known) {
        // 1 m of arrow is 4 kN at the rod, 6 kN along and across at the tyre, 12 kN of wheel load. Tension pulls the knuckle towards the rack.
        const patch = moved(side.contact_patch), rod = sub(inner[i], ball);
        arrow(patch, times(1 / 6000, [pose.tyre[i][0], pose.tyre[i][1], 0]), "#c8501e");
        arrow(patch, times(1 / 12000, [0, 0, pose.tyre[i][2]]), "#8a3ea8");
        arrow(ball, times(pose.force[i] / 4000 / size(rod), rod), "#b3261e");
      }
    });
    g.fillStyle = "#5b6875"; g.font = "13px system-ui, sans-serif"; g.textAlign = "left";
    g.fillText("arrows: red tie rod 4 kN/m, orange tyre 6 kN/m, violet wheel load 12 kN/m", 8, h - 8);
  }
}

class TopView {
  constructor(canvas) { this.canvas = canvas; this.clear(); }
  clear() { this.path = []; }
  move(x, y) {
    const last = this.path[this.path.length - 1];
    if (last && Math.hypot(x - last[0], y - last[1]) < 0.4) return;
    // Another run starts elsewhere.
    if (last && Math.hypot(x - last[0], y - last[1]) > 60) this.path = [];
    this.path.push([x, y]);
    if (this.path.length > 3000) this.path.splice(0, 500);
  }
  draw(car) {
    const c = this.canvas, g = c.getContext("2d"), w = c.width, h = c.height;
    g.clearRect(0, 0, w, h); g.fillStyle = "#eef1f4"; g.fillRect(0, 0, w, h);
    if (!car || !Number.isFinite(car.x)) return;
    const scale = 9, x = (px, py) => w * 0.62 + (px - car.x) * scale, y = (px, py) => h / 2 - (py - car.y) * scale;
    g.strokeStyle = "#d3dae0"; g.lineWidth = 1; g.fillStyle = "#7a8691"; g.font = "12px system-ui, sans-serif"; g.beginPath();
    const step = 10;
    for (let k = Math.floor((car.x - w / scale) / step) * step; k < car.x + w / scale; k += step) { g.moveTo(x(k, 0), 0); g.lineTo(x(k, 0), h); g.fillText(`${k} m`, x(k, 0) + 2, h - 4); }
    for (let k = Math.floor((car.y - h / scale) / step) * step; k < car.y + h / scale; k += step) { g.moveTo(0, y(0, k)); g.lineTo(w, y(0, k)); g.fillText(`${k}`, 2, y(0, k) - 2); }
    g.stroke();
    g.strokeStyle = "#1c5fa8"; g.lineWidth = 2; g.beginPath();
    this.path.forEach(([px, py], i) => (i ? g.lineTo(x(px, py), y(px, py)) : g.moveTo(x(px, py), y(px, py))));
    g.stroke();
    const cy = Math.cos(car.yaw), sy = Math.sin(car.yaw), at = (f, l) => [x(car.x + f * cy - l * sy, 0), y(0, car.y + f * sy + l * cy)];
    const shape = (points, colour) => { g.fillStyle = colour; g.beginPath(); points.forEach((p, i) => (i ? g.lineTo(...p) : g.moveTo(...p))); g.closePath(); g.fill(); };
    shape([at(2.1, 0.85), at(2.1, -0.85), at(-2.3, -0.85), at(-2.3, 0.85)], "#34414e");
    shape([at(1.1, 0.7), at(0.3, 0.65), at(0.3, -0.65), at(1.1, -0.7)], "#9fc4ea");
    const half = (car.wheelbase || 2.7) / 2;
    [[half, 0.78, 0], [half, -0.78, 1], [-half, 0.78, 2], [-half, -0.78, 3]].forEach(([f, l, i]) => {
      const a = car.steer[i] || 0, ca = Math.cos(a), sa = Math.sin(a), p = (u, v) => at(f + u * ca - v * sa, l + u * sa + v * ca);
      shape([p(0.38, 0.14), p(0.38, -0.14), p(-0.38, -0.14), p(-0.38, 0.14)], "#c8501e");
    });
  }
}
