// The page: what is asked of the console, what becomes of the answers.
"use strict";
const $ = (id) => document.getElementById(id);
const TABS = [["run", "Run"], ["watch", "Watch"], ["tune", "Tune"], ["timing", "Timing"], ["steer", "Steer"], ["runs", "Runs"]];
const SIDES = ["left", "right"], XYZ = ["x", "y", "z"], SERVICES = ["rig", "vehicle", "multibody", "logger"];
const RM = "rig_measurement.", VS = "vehicle_state.", SS = "suspension_state.", RS = "rig_status.";
const each = (prefix, labels) => labels.map((l) => prefix + l);
const TIMING = ["wake_lateness_s", "start_s", "compute_s", "done_s", "margin_s", "output_lateness_s", "output_compute_s", "late_wake_count", "overrun_count", "missed_count", "caught_up_count", "epoch"];
// Signals of which the newest value is enough.
const LATEST = [
  ...each(RS, ["state", "trip_code", "trip_tick", "trip_limit", "trip_value", "force_fade_ratio", "stale_count", "late_command_count", "clamped", "port_energy_j", "port_power_w", "loop_delay_s", "parameters_version", "tie_rod_force_applied_n.left", "tie_rod_force_applied_n.right"]),
  ...each(RM, ["steering_wheel_angle_rad", "steering_wheel_torque_n_m", "rack_displacement_m", "tie_rod_force_n.left", "tie_rod_force_n.right"]),
  ...each(VS, ["position_m.x", "position_m.y", "yaw_rad", "velocity_m_s.x", "acceleration_m_s2.y", "target_speed_m_s", "held_count", "parameters_version", "steer_rad.fl", "steer_rad.fr", "steer_rad.rl", "steer_rad.rr"]),
  ...["fl", "fr"].flatMap((w) => XYZ.map((a) => `${VS}tyre_force_n.${w}_${a}`)),
  ...each(SS, ["solver_status", "iterations", "residual_m", "held_count", "parameters_version", "rack_displacement_m", "tie_rod_force_n.left", "tie_rod_force_n.right"]),
  ...SIDES.flatMap((s) => XYZ.map((a) => `${SS}wheel_centre_m.${s}_${a}`)),
  ...SIDES.flatMap((s) => ["w", ...XYZ].map((a) => `${SS}knuckle_quaternion.${s}_${a}`)),
  ...["bench.emergency_stop", "bench.end_tick", ...SERVICES.flatMap((s) => [`bench.alive.${s}`, `bench.restarts.${s}`])],
  ...["rig", "vehicle", "multibody"].flatMap((s) => TIMING.map((f) => `${s}_timing.${f}`)),
  ...each("logger_status.", ["read_tick", "written_tick", "lost_count", "missing_count", "byte_count"]),
];
const DEFAULT_LAYOUTS = {
  "steering": [[RM + "steering_wheel_angle_rad", RS + "steering_wheel_angle_applied_rad"], [RM + "steering_wheel_torque_n_m", RM + "torsion_bar_torque_n_m"], [RS + "tie_rod_force_applied_n.left", RM + "tie_rod_force_n.left", RS + "tie_rod_force_applied_n.right", RM + "tie_rod_force_n.right"], [VS + "acceleration_m_s2.y", VS + "angular_velocity_rad_s.z"]],
  "force tracking": [[RS + "tie_rod_force_applied_n.left", RM + "tie_rod_force_n.left"], [RS + "tie_rod_force_applied_n.right", RM + "tie_rod_force_n.right"], [RS + "horizontal_valve_ratio.left", RS + "horizontal_valve_ratio.right"], [RM + "rack_displacement_m"]],
  "car": [[VS + "velocity_m_s.x", VS + "target_speed_m_s"], [VS + "acceleration_m_s2.y"], [VS + "angular_velocity_rad_s.z"], [VS + "roll_rad", VS + "side_slip_rad"]],
};
const TIMING_CHARTS = [["rig_timing.wake_lateness_s", "rig_timing.output_lateness_s"], ["vehicle_timing.done_s", "multibody_timing.done_s"]];
const STEER_CHARTS = [[RM + "steering_wheel_torque_n_m"], [VS + "angular_velocity_rad_s.z", VS + "acceleration_m_s2.y"]];

let tab = "run", names = [], now = {}, state = "no bench", trips = {}, states = [], units = {}, mayWrite = false, about = null, parameters = null, snapshot = null;
let layout = null, charts = [], held = null, frame = null, chosen = [], replaying = null, wheelbase = 2.7, events = [];
const traces = new Map();
// How the page does: for itself and for who tests it.
const stats = { updates: 0, intervals: [], work: [], last: 0, dropped: 0 };
window.kingpin = { stats, traces, value: (name) => now[name], state: () => state, mayWrite: () => mayWrite, steer: null };

const store = { get: (key, or) => { try { return JSON.parse(localStorage.getItem(key)) || or; } catch { return or; } }, set: (key, v) => localStorage.setItem(key, JSON.stringify(v)) };
const p95 = (list) => { const s = list.slice(-400).sort((a, b) => a - b); return s.length ? s[Math.floor(0.95 * (s.length - 1))] : NaN; };
const row = (...cells) => {
  const tr = document.createElement("tr");
  cells.forEach((c, i) => { const td = document.createElement("td"); if (c instanceof Node) td.append(c); else td.textContent = c ?? "–"; if (i) td.className = "n"; tr.append(td); });
  return tr;
};
const heads = (...cells) => { const tr = document.createElement("tr"); cells.forEach((c) => { const th = document.createElement("th"); th.textContent = c; tr.append(th); }); return tr; };
function banner(text, info) { $("banner").hidden = !text; $("banner").textContent = text || ""; $("banner").classList.toggle("info", !!info); }
function happened(text) {
  const at = frame && frame.tick !== null && frame.tick !== undefined ? `tick ${frame.tick}: ` : "";
  const li = document.createElement("li"); li.textContent = at + text; $("events").prepend(li);
  events.push(text); while ($("events").children.length > 100) $("events").lastChild.remove();
}
async function doing(kind, what, quiet) {
  const answer = await Link.ask(kind, what);
  if (answer.error) { banner(answer.error); happened(answer.error); setTimeout(() => $("banner").textContent === answer.error && banner(""), 8000); }
  else if (!quiet) banner("");
  return answer;
}

// ---- tabs
TABS.forEach(([id, name]) => {
  const b = document.createElement("button"); b.type = "button"; b.textContent = name; b.id = `tab-${id}`; b.setAttribute("role", "tab"); b.onclick = () => show(id); $("tabs").append(b);
});
function show(id) {
  tab = id;
  TABS.forEach(([t]) => { $(t).classList.toggle("on", t === id); $(`tab-${t}`).setAttribute("aria-selected", t === id); });
  if (id === "tune") { readParameters(); listSnapshots(); }
  if (id === "runs") listRuns();
  buildCharts(); subscribe();
}

// ---- what is watched
function wantedCharts() {
  if (tab === "watch") return layout;
  if (tab === "timing") return TIMING_CHARTS;
  return tab === "steer" ? STEER_CHARTS : [];
}
async function subscribe() {
  names = [...new Set(wantedCharts().flat())];
  const answer = await Link.ask("subscribe", { traces: names, latest: LATEST, rate_hz: 20, points_hz: 100 });
  if (answer.error) happened(answer.error);
}
function buildCharts() {
  const parent = { watch: $("charts"), timing: $("timing-charts"), steer: $("steer-charts") }[tab];
  charts.forEach((c) => c.box.remove()); charts = [];
  if (!parent) return;
  charts = wantedCharts().map((signals, i) => {
    const chart = new StripChart(parent, tab === "watch" ? 168 : 150);
    chart.set(signals.map((name) => { if (!traces.has(name)) traces.set(name, new Trace(name)); return traces.get(name); }), units);
    if (tab === "watch") chart.remove = (name) => { layout[i] = layout[i].filter((n) => n !== name); layout = layout.filter((l) => l.length); changedLayout(); };
    return chart;
  });
  $("signal-chart").replaceChildren(...(layout || []).map((_, i) => new Option(`${i + 1}`, i)), new Option("a new one", "new"));
}
function changedLayout() { store.set("layout", layout); buildCharts(); subscribe(); }
function listLayouts(selected) {
  const own = store.get("layouts", {});
  $("layouts").replaceChildren(...[...Object.keys(DEFAULT_LAYOUTS), ...Object.keys(own)].map((n) => new Option(n, n)));
  if (selected) $("layouts").value = selected;
}
layout = store.get("layout", null) || structuredClone(DEFAULT_LAYOUTS.steering);
listLayouts();
$("layouts").onchange = () => { layout = structuredClone({ ...DEFAULT_LAYOUTS, ...store.get("layouts", {}) }[$("layouts").value]); changedLayout(); };
$("layout-save").onclick = () => { const name = $("layout-name").value.trim(); if (name) { store.set("layouts", { ...store.get("layouts", {}), [name]: layout }); listLayouts(name); } };
$("layout-delete").onclick = () => { const own = store.get("layouts", {}); delete own[$("layouts").value]; store.set("layouts", own); listLayouts(); };
$("signal-add").onchange = () => {
  const name = $("signal-add").value.trim(), at = $("signal-chart").value;
  if (!(name in units)) return;
  if (at === "new" || !layout[at]) layout.push([name]); else if (!layout[at].includes(name)) layout[at].push(name);
  $("signal-add").value = ""; changedLayout();
};
$("hold").onclick = () => { held = held === null ? newestTime() : null; $("hold").textContent = held === null ? "Hold" : "Go on"; };
const newestTime = () => Math.max(0, ...names.map((n) => (traces.get(n) ? traces.get(n).time() : 0)));

// ---- frames
const gauges = {}, above = {};
[["gauges", ["angle", "torque", "speed", "left", "right"]], ["steer-gauges", ["torque", "angle", "speed", "lateral"]]].forEach(([id, which]) => {
  const kinds = { angle: ["steering angle", "deg", -180, 180, 1], torque: ["steering torque", "N·m", -8, 8, 2], speed: ["speed", "km/h", 0, 160, 1], left: ["tie rod left", "kN", -6, 6, 2], right: ["tie rod right", "kN", -6, 6, 2], lateral: ["lateral acceleration", "m/s²", -10, 10, 2] };
  gauges[id] = Object.fromEntries(which.map((k) => [k, new Gauge($(id), ...kinds[k])]));
});
const suspension = new SuspensionView($("suspension"));
above.watch = new TopView($("top")); above.steer = new TopView($("steer-top"));
const steer = new SteerInput($("wheel"), $("wheel-slider"));
window.kingpin.steer = steer;

let drawPending = false;
Link.on("frame", (value) => {
  const begin = performance.now();
  frame = value;
  if (value.note) { happened(value.note); banner(value.note, /as planned/.test(value.note)); }
  if (value.live && value.live.anew) {
    traces.forEach((t) => t.clear()); Object.values(above).forEach((t) => t.clear());
    if (value.live.about) newRun(value.live.about);
  }
  value.latest.forEach((v, i) => { now[LATEST[i]] = v; });
  if (!value.live && !value.replay) now = {};
  if (value.rows.length === names.length) {
    value.rows.forEach((samples, i) => { const t = traces.get(names[i]); if (t) samples.forEach((v, k) => t.push(value.time_s[k], v)); });
  }
  stats.updates++;
  if (stats.last) stats.intervals.push(begin - stats.last);
  stats.last = begin;
  if (drawPending) stats.dropped++;
  else { drawPending = true; requestAnimationFrame(() => { const b = performance.now(); draw(); drawPending = false; stats.work.push(performance.now() - b + received); if (stats.work.length > 2000) stats.work.splice(0, 1000); if (stats.intervals.length > 2000) stats.intervals.splice(0, 1000); }); }
  const received = performance.now() - begin;
});
function newRun(what) {
  about = what;
  $("about").textContent = what.description || "";
  suspension.geometry(what.geometry); wheelbase = what.wheelbase_m || 2.7;
  happened(`run of ${what.scenario}`);
}
const deg = (v) => (v ?? NaN) * 180 / Math.PI;
function draw() {
  const f = frame;
  const live = f && f.live, replay = f && f.replay;
  const code = now[RS + "state"];
  const before = state;
  state = !live && !replay ? "no bench" : states[code] || "starting up";
  if (state !== before) { happened(`state ${state}`); $("state").textContent = state; $("state").className = `state ${state}`; }
  replaying = replay || null;
  $("replaybar").hidden = !replay;
  if (replay && document.activeElement !== $("replay-at")) { $("replay-at").min = replay.from_s; $("replay-at").max = replay.to_s; $("replay-at").value = replay.at_s; }
  if (replay) { $("replay-time").textContent = `${replay.run}: ${replay.at_s.toFixed(2)} of ${replay.to_s.toFixed(2)} s`; $("replay-pause").textContent = replay.paused ? "Play" : "Pause"; }
  $("scenario").textContent = replay ? "replay" : live ? (about ? about.scenario : "–") : "–";
  const t = live || replay ? newestTime() || (f.tick ?? 0) * 1e-3 : null;
  $("clock").textContent = t === null ? "–" : `${t.toFixed(2)} s`;
  const pressed = now["bench.emergency_stop"] === 1;
  $("estop").classList.toggle("pressed", pressed);
  const car = { x: now[VS + "position_m.x"], y: now[VS + "position_m.y"], yaw: now[VS + "yaw_rad"], wheelbase, steer: ["fl", "fr", "rl", "rr"].map((w) => now[`${VS}steer_rad.${w}`]) };
  if (Number.isFinite(car.x)) Object.values(above).forEach((v) => v.move(car.x, car.y));
  steer.measured = now[RM + "steering_wheel_angle_rad"] ?? NaN; steer.torque = now[RM + "steering_wheel_torque_n_m"] ?? NaN;
  if (tab === "run") drawRun(pressed);
  const end = held === null ? newestTime() : held, window_s = tab === "watch" ? +$("window").value : 10;
  charts.forEach((c) => c.draw(end, window_s));
  if (tab === "watch") {
    const g = gauges.gauges;
    g.angle.set(deg(steer.measured)); g.torque.set(steer.torque); g.speed.set((now[VS + "velocity_m_s.x"] ?? NaN) * 3.6);
    g.left.set((now[RM + "tie_rod_force_n.left"] ?? NaN) / 1000); g.right.set((now[RM + "tie_rod_force_n.right"] ?? NaN) / 1000);
    suspension.draw(pose()); above.watch.draw(car);
  }
  if (tab === "timing") drawTiming();
  if (tab === "steer") {
    const g = gauges["steer-gauges"];
    g.angle.set(deg(steer.measured)); g.torque.set(steer.torque); g.speed.set((now[VS + "velocity_m_s.x"] ?? NaN) * 3.6); g.lateral.set(now[VS + "acceleration_m_s2.y"]);
    steer.draw(); above.steer.draw(car);
  }
}
function pose() {
  const v = (name) => now[name] ?? NaN;
  return {
    rack: now[SS + "rack_displacement_m"] ?? 0,
    centre: SIDES.map((s) => XYZ.map((a) => v(`${SS}wheel_centre_m.${s}_${a}`))),
    q: SIDES.map((s) => ["w", ...XYZ].map((a) => v(`${SS}knuckle_quaternion.${s}_${a}`))),
    force: SIDES.map((s) => v(`${SS}tie_rod_force_n.${s}`)),
    tyre: ["fl", "fr"].map((w) => XYZ.map((a) => v(`${VS}tyre_force_n.${w}_${a}`))),
  };
}
function tripText() {
  const code = now[RS + "trip_code"];
  if (!code) return null;
  const [name, unit] = trips[code] || [`code ${code}`, ""], n = (v) => (v === null || v === undefined ? "" : shortNumber(v));
  // Some causes have no number.
  if (!unit) return `${name} at tick ${now[RS + "trip_tick"]}`;
  return `${name}: ${n(now[RS + "trip_value"])} ${unit}, limit ${n(now[RS + "trip_limit"])} ${unit}, at tick ${now[RS + "trip_tick"]}`;
}
function drawRun(pressed) {
  const trip = tripText();
  $("trip").textContent = trip || (pressed ? "emergency stop is pressed" : "none"); $("trip").className = trip || pressed ? "bad" : "";
  const shown = (v, d, s = 1) => (v === null || v === undefined ? "–" : (v * s).toFixed(d));
  $("run-state").replaceChildren(
    row("state", state), row("force fade", shown(now[RS + "force_fade_ratio"], 2)), row("speed [km/h]", shown(now[VS + "velocity_m_s.x"], 1, 3.6)),
    row("target speed [km/h]", shown(now[VS + "target_speed_m_s"], 1, 3.6)), row("steering angle [deg]", shown(now[RM + "steering_wheel_angle_rad"], 1, 180 / Math.PI)),
    row("lateral acceleration [m/s²]", shown(now[VS + "acceleration_m_s2.y"], 2)), row("parameters version", now[RS + "parameters_version"]));
  $("services").replaceChildren(...SERVICES.map((s) => row(s, now[`bench.alive.${s}`] === 1 ? "running" : now[`bench.alive.${s}`] === 0 ? "not running" : "–", `restarts ${now[`bench.restarts.${s}`] ?? "–"}`)));
  const can = (...list) => list.includes(state);
  const allowed = { arm: can("idle"), start: can("armed"), stop: can("armed", "starting", "running", "holding", "resuming"), acknowledge: can("tripped") && !pressed, release: pressed, end: !!(frame && frame.live) };
  document.querySelectorAll("[data-operate]").forEach((b) => { b.disabled = !mayWrite || !!replaying || !allowed[b.dataset.operate]; });
  $("launch").disabled = !mayWrite || !!(frame && frame.live && frame.live.supervised) || !!replaying;
}
function drawTiming() {
  const us = (v) => (v === null || v === undefined ? "–" : (v * 1e6).toFixed(0));
  $("timing-table").replaceChildren(heads("service", "wake-up late [µs]", "starts at [µs]", "computes [µs]", "done at [µs]", "margin [µs]", "output late [µs]", "output takes [µs]", "late wake-ups", "overruns", "missed", "caught up", "restarts"),
    ...["rig", "vehicle", "multibody"].map((s) => { const v = (f) => now[`${s}_timing.${f}`]; return row(s, ...TIMING.slice(0, 7).map((f) => us(v(f))), ...TIMING.slice(7, 11).map((f) => v(f) ?? "–"), now[`bench.restarts.${s}`] ?? "–"); }));
  $("freshness").replaceChildren(row("stale output phases now", now[RS + "stale_count"]), row("commands late so far", now[RS + "late_command_count"]), row("vehicle: inputs held", now[VS + "held_count"]), row("multibody: inputs held", now[SS + "held_count"]), row("logger: ticks lost", now["logger_status.lost_count"]), row("logger: ticks behind", (frame.tick ?? 0) - (now["logger_status.read_tick"] ?? 0)));
  const n = (v, d) => (v === null || v === undefined ? "–" : v.toFixed(d));
  $("energy").replaceChildren(row("into the steering since the start [J]", n(now[RS + "port_energy_j"], 2)), row("over the last second [W]", n(now[RS + "port_power_w"], 2)), row("delay, command to force [ms]", n(now[RS + "loop_delay_s"] === null ? null : now[RS + "loop_delay_s"] * 1e3, 2)));
  $("page-timing").replaceChildren(row("updates a second", n(1000 / (stats.intervals.slice(-100).reduce((a, b) => a + b, 0) / Math.max(1, stats.intervals.slice(-100).length)), 1)), row("95 % of intervals below [ms]", n(p95(stats.intervals), 1)), row("95 % of updates drawn in [ms]", n(p95(stats.work), 1)), row("clients", frame.clients ?? "–"));
}

// ---- run
document.querySelectorAll("[data-operate]").forEach((b) => { b.onclick = () => doing("operate", { operation: b.dataset.operate }).then((a) => a.done && happened(`${b.textContent.toLowerCase()} asked for`)); });
$("estop").onclick = () => doing("operate", { operation: "emergency_stop" }).then((a) => a.done && happened("EMERGENCY STOP"));
$("launch").onclick = () => { const s = parseFloat($("launch-duration").value); banner("getting ready …", true); doing("launch", { scenario: $("launch-scenario").value, duration_s: Number.isFinite(s) ? s : null }, true).then((a) => a.launched && happened(`run ${a.launched}`)).then(() => setTimeout(() => $("banner").textContent === "getting ready …" && banner(""), 4000)); };

// ---- tune
const human = (p, v) => (p.choices ? p.choices[v] ?? v : `${+v.toPrecision(7)}`);
function said(text, bad) { $("tune-said").textContent = text; $("tune-said").className = `said ${bad ? "bad" : "good"}`; }
async function readParameters() {
  const answer = await Link.ask("parameters");
  parameters = answer.parameters || null;
  if (answer.error) said(answer.error, true);
  drawParameters();
}
function drawParameters() {
  if (!parameters) { $("parameters").replaceChildren(); return; }
  $("tune-version").textContent = `version ${parameters.version}, ${parameters.undo_depth} to undo`;
  $("undo").disabled = !mayWrite || !parameters.undo_depth;
  const mode = $("diff").value, base = (p) => (mode === "snapshot" && snapshot && p.path in snapshot ? number(p, snapshot[p.path]) : p.default);
  const rows = parameters.rows.filter((p) => mode === "all" || p.value !== base(p)).map((p) => {
    let input;
    if (p.choices) { input = document.createElement("select"); p.choices.forEach((c, i) => input.append(new Option(c, i))); input.value = p.value; }
    else { input = document.createElement("input"); input.type = "number"; input.step = "any"; input.value = +p.value.toPrecision(7); input.size = 10; }
    input.disabled = !mayWrite || !!p.fixed; input.id = `p-${p.path}`; input.setAttribute("aria-label", p.path);
    input.onchange = () => input.value !== "" && set([[p.path, p.choices ? setting(p, +input.value) : Number(input.value)]]);
    const slider = document.createElement("input");
    if (p.choices) slider.hidden = true;
    else { slider.type = "range"; slider.min = p.min; slider.max = p.max; slider.step = (p.max - p.min) / 200; slider.value = p.value; slider.disabled = !mayWrite || !!p.fixed; slider.setAttribute("aria-label", `${p.path} slider`); slider.onchange = () => set([[p.path, Number(slider.value)]]); }
    const back = document.createElement("button"); back.type = "button"; back.textContent = "default"; back.disabled = !mayWrite || p.value === p.default; back.onclick = () => set([[p.path, p.choices ? setting(p, p.default) : p.default]]);
    const tr = row(p.path, input, slider, p.unit === "1" ? "" : p.unit, p.fixed ? "fixed" : p.choices ? p.choices.join(", ") : `${p.min} … ${p.max}`, human(p, base(p)), p.service, back, p.doc);
    [...tr.children].forEach((td) => { td.className = ""; });
    if (p.value !== p.default) tr.className = "changed";
    tr.title = p.fixed || `may be changed in ${p.states}`;
    return tr;
  });
  $("parameters").replaceChildren(heads("parameter", "value", "", "unit", "range", mode === "snapshot" ? "snapshot" : "default", "applied by", "", "meaning"), ...rows);
}
const number = (p, v) => (typeof v === "boolean" ? +v : p.choices && typeof v === "string" ? p.choices.indexOf(v) : v);
const setting = (p, v) => (p.choices && p.choices[0] === "off" && p.choices.length === 2 ? !!v : p.choices ? p.choices[v] : v);
async function set(settings) {
  const answer = await Link.ask("set", { settings });
  if (answer.error) said(answer.error, true);
  else said(answer.changed.changes.map((c) => `${c.path}: ${+c.from.toPrecision(7)} → ${+c.to.toPrecision(7)}`).join("; ") + ` (version ${answer.changed.version}, tick ${answer.changed.tick})`);
  readParameters();
}
$("undo").onclick = async () => { const a = await Link.ask("undo"); said(a.error || `undone: ${a.changed.changes.map((c) => `${c.path} = ${+c.to.toPrecision(7)}`).join("; ")}`, a.error); readParameters(); };
$("diff").onchange = async () => { if ($("diff").value === "snapshot") await readSnapshot(); drawParameters(); };
async function listSnapshots() { const a = await Link.ask("snapshots"); $("snapshots").replaceChildren(...(a.snapshots || []).map((n) => new Option(n, n))); }
async function readSnapshot() { const name = $("snapshots").value; if (!name) { said("there is no snapshot", true); return null; } const a = await Link.ask("snapshot_read", { name }); if (a.error) { said(a.error, true); return null; } snapshot = Object.fromEntries(a.settings); return a.settings; }
$("snapshot").onclick = async () => { const a = await Link.ask("snapshot", { name: $("snapshot-name").value.trim() }); said(a.error || `saved as ${a.saved}`, a.error); listSnapshots(); };
$("snapshot-set").onclick = async () => { const s = await readSnapshot(); if (s) set(s); };

// ---- steer
$("steer-take").onclick = () => steer.take(!steer.on);
$("steer-by").onchange = () => { steer.by = $("steer-by").value; };
$("steer-centre").onchange = () => { steer.centre = $("steer-centre").checked; };
$("steer-range").onchange = () => { steer.range = +$("steer-range").value * Math.PI / 180; };
steer.onchange = (on) => { $("steer-take").textContent = on ? "Give the wheel back" : "Take the wheel"; $("steer-take").classList.toggle("go", !on); if (on) $("wheel").focus(); };
steer.onrefused = (reason) => banner(reason);

// ---- runs and replay
async function listRuns() {
  const a = await Link.ask("runs");
  const rows = (a.runs || []).map((r) => {
    const pick = document.createElement("input"); pick.type = "checkbox"; pick.setAttribute("aria-label", `compare ${r.name}`); pick.checked = chosen.includes(r.name);
    pick.onchange = () => { chosen = chosen.filter((n) => n !== r.name); if (pick.checked) chosen.push(r.name); };
    const open = document.createElement("a"); open.textContent = "report"; open.href = `report/${encodeURIComponent(r.name)}`; open.target = "_blank"; open.rel = "noopener"; open.hidden = !r.report;
    const play = document.createElement("button"); play.type = "button"; play.textContent = "Replay"; play.className = "replay"; play.dataset.run = r.name; play.onclick = () => replay(r.name);
    const tr = row(pick, r.name, new Date(r.unix_s * 1000).toISOString().slice(0, 19).replace("T", " "), r.scenario || "–", r.duration_s ? `${r.duration_s.toFixed(1)} s` : "–", r.end_state || "–", (r.failures || []).join("; "), open, play);
    [...tr.children].forEach((td) => { td.className = ""; });
    return tr;
  });
  $("run-list").replaceChildren(heads("", "run", "made (UTC)", "scenario", "length", "ended", "not as planned", "", ""), ...rows);
}
async function replay(run) {
  banner("reading the log …", true);
  const a = await Link.ask("replay", { run });
  banner(a.error || "");
  if (a.error) return;
  traces.forEach((t) => t.clear()); Object.values(above).forEach((t) => t.clear());
  if (a.about) newRun(a.about);
  show("watch");
}
$("runs-again").onclick = listRuns;
$("replay-pause").onclick = () => replaying && Link.ask("play", { speed: +$("replay-speed").value, paused: !replaying.paused });
$("replay-speed").onchange = () => replaying && Link.ask("play", { speed: +$("replay-speed").value, paused: replaying.paused });
$("replay-at").oninput = () => { traces.forEach((t) => t.clear()); Object.values(above).forEach((t) => t.clear()); Link.ask("seek", { to_s: +$("replay-at").value }); };
$("replay-at").onchange = () => $("replay-at").blur();
$("replay-live").onclick = () => { traces.forEach((t) => t.clear()); Object.values(above).forEach((t) => t.clear()); now = {}; Link.ask("live"); };
let plotly = null;
const loadPlotly = () => (plotly = plotly || new Promise((done) => { const s = document.createElement("script"); s.src = "plotly.js"; s.onload = done; document.head.append(s); }));
$("compare").onclick = async () => {
  if (chosen.length !== 2) { $("compare-said").textContent = "choose two runs"; return; }
  $("compare-said").textContent = "reading …";
  const a = await Link.ask("compare", { a: chosen[0], b: chosen[1], signal: $("compare-signal").value });
  $("compare-said").textContent = a.error || "";
  if (a.error) return;
  $("compare-page").href = `compare/${encodeURIComponent(chosen[0])}/${encodeURIComponent(chosen[1])}`; $("compare-page").hidden = false;
  await loadPlotly();
  const runs = a.compare.runs;
  Plotly.newPlot("compare-plot", runs.map((r) => ({ x: r.time_s, y: r.value, name: r.name, mode: "lines" })), { height: 360, margin: { t: 20 }, xaxis: { title: { text: "time [s]" } }, yaxis: { title: { text: `${a.compare.signal} [${runs[0].unit}]` } } }, { responsive: true, displaylogo: false });
  const flat = (o, at, into) => { for (const [k, v] of Object.entries(o || {})) { const name = at ? `${at}.${k}` : k; if (v && typeof v === "object") flat(v, name, into); else if (typeof v === "number") into[name] = v; } return into; };
  const [x, y] = runs.map((r) => flat(r.summary, "", {}));
  const keys = [...new Set([...Object.keys(x), ...Object.keys(y)])].filter((k) => x[k] !== y[k] && !/^run\.(wall|simulated_per)/.test(k)).slice(0, 120);
  $("compare-table").replaceChildren(heads("figure", runs[0].name, runs[1].name, "difference"), ...keys.map((k) => row(k, shortNumber(x[k]), shortNumber(y[k]), shortNumber(y[k] - x[k]))));
};

// ---- beginning
Link.on("greeting", async (g) => {
  states = g.states; trips = g.trips;
  $("launch-scenario").replaceChildren(...g.scenarios.map((s) => new Option(s, s, false, s === "growing_slalom_80")));
  if (Link.token()) { const a = await Link.ask("token", { token: Link.token() }); mayWrite = !!a.may_write; }
  $("right").textContent = mayWrite ? "may write" : "reading only"; $("right").className = mayWrite ? "rights write" : "rights";
  $("right").title = mayWrite ? "" : "open the address with the token to write";
  const a = await Link.ask("signals");
  units = Object.fromEntries((a.signals || []).map(([n, u]) => [n, u]));
  $("signal-list").replaceChildren(...(a.signals || []).map(([n, u, d]) => { const o = document.createElement("option"); o.value = n; o.label = `${u === "1" ? "" : `[${u}] `}${d}`; return o; }));
  show(tab);
  if (g.log && !replaying) replay(g.log);
});
Link.on("down", () => { frame = null; now = {}; state = "no console"; $("state").textContent = state; $("state").className = "state"; if (steer.on) steer.take(false); });
show("run");
Link.connect();
