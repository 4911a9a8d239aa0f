// The human in the loop: wheel, slider, keys or gamepad give an angle (or torque) thirty times a second.
"use strict";
class SteerInput {
  constructor(canvas, slider) {
    Object.assign(this, { canvas, slider, on: false, by: "angle", wanted: 0, centre: true, range: Math.PI, keys: new Set(), dragging: false, measured: NaN, torque: NaN, slow: false });
    let last = null;
    const angle = (e) => {
      const r = canvas.getBoundingClientRect();
      return Math.atan2(-(e.clientY - r.top - r.height / 2), e.clientX - r.left - r.width / 2);
    };
    canvas.onpointerdown = (e) => { last = angle(e); this.dragging = true; canvas.setPointerCapture(e.pointerId); canvas.focus(); };
    canvas.onpointermove = (e) => {
      if (!this.dragging) return;
      const now = angle(e);
      let d = now - last;
      if (d > Math.PI) d -= 2 * Math.PI; else if (d < -Math.PI) d += 2 * Math.PI;
      last = now;
      this.wanted = this.within(this.wanted + d);
    };
    canvas.onpointerup = canvas.onpointercancel = () => { this.dragging = false; };
    slider.onpointerdown = () => { this.sliding = true; };
    slider.oninput = () => { this.wanted = this.within(-slider.value * Math.PI / 180); };
    slider.onchange = slider.onpointerup = () => { this.sliding = false; };
    const typing = (e) => /^(INPUT|SELECT|TEXTAREA)$/.test(e.target.tagName) && e.target.type !== "range";
    window.addEventListener("keydown", (e) => {
      this.slow = e.shiftKey;
      if (!typing(e) && (e.key === "ArrowLeft" || e.key === "ArrowRight") && this.on) { this.keys.add(e.key); e.preventDefault(); }
    });
    window.addEventListener("keyup", (e) => { this.slow = e.shiftKey; this.keys.delete(e.key); });
    window.addEventListener("blur", () => { this.keys.clear(); this.dragging = false; });
    this.at = performance.now();
    setInterval(() => this.tick(), 33);
  }
  within(v) { return Math.max(-this.range, Math.min(this.range, v)); }
  gamepad() {
    for (const pad of navigator.getGamepads ? navigator.getGamepads() : []) {
      if (pad && pad.connected && pad.axes.length) return pad.axes[0];
    }
    return null;
  }
  tick() {
    const now = performance.now(), dt = Math.min(0.1, (now - this.at) / 1000);
    this.at = now;
    const key = (this.keys.has("ArrowLeft") ? 1 : 0) - (this.keys.has("ArrowRight") ? 1 : 0), rate = (this.slow ? 0.5 : 2.5);
    const pad = this.gamepad();
    if (key) { this.wanted = this.within(this.wanted + key * rate * dt); }
    // A stick that is moved is in charge; left is negative on a gamepad.
    else if (pad !== null && Math.abs(pad) > 0.06) { this.wanted = -pad * this.range; this.padded = true; }
    else if ((this.centre || this.padded) && !this.dragging && !this.sliding) {
      const back = 3 * dt;
      this.wanted = Math.abs(this.wanted) < back ? 0 : this.wanted - Math.sign(this.wanted) * back;
      this.padded = false;
    }
    if (!this.sliding) this.slider.value = -this.wanted * 180 / Math.PI;
    if (this.on && !this.waiting) {
      this.waiting = true;
      // By torque the whole range is 8 N·m.
      const torque = this.wanted / this.range * 8;
      Link.ask("steer", { mode: this.by === "torque" ? 2 : 1, angle_rad: this.by === "torque" ? 0 : this.wanted, torque_n_m: this.by === "torque" ? torque : 0 })
        .then((answer) => { this.waiting = false; if (answer.error) this.refused(answer.error); });
    }
  }
  refused(reason) { this.take(false); if (this.onrefused) this.onrefused(reason); }
  take(on) {
    this.on = on; this.waiting = false;
    if (on && this.by === "angle" && Number.isFinite(this.measured)) this.wanted = this.within(this.measured);
    if (!on) { this.keys.clear(); Link.ask("steer", { mode: 0, angle_rad: 0, torque_n_m: 0 }); }
    if (this.onchange) this.onchange(on);
  }
  draw() {
    const c = this.canvas, g = c.getContext("2d"), w = c.width, m = w / 2, r = 0.4 * w;
    g.clearRect(0, 0, w, w);
    // Left is counter-clockwise, as the driver sees it.
    const wheel = (angle, colour, width) => {
      g.save(); g.translate(m, m); g.rotate(-angle); g.strokeStyle = colour; g.lineWidth = width;
      g.beginPath(); g.arc(0, 0, r, 0, 7); g.stroke(); g.beginPath(); g.moveTo(-r, 0); g.lineTo(r, 0); g.moveTo(0, 0); g.lineTo(0, r); g.stroke();
      g.fillStyle = "#ffd23f"; g.fillRect(-6, -r - width / 2, 12, width); g.restore();
    };
    if (Number.isFinite(this.measured)) wheel(this.measured, "#34414e", 26);
    if (this.on) { g.globalAlpha = 0.45; wheel(this.wanted, "#1c5fa8", 12); g.globalAlpha = 1; }
    g.textAlign = "center"; g.strokeStyle = "#fff"; g.lineWidth = 8; g.lineJoin = "round"; g.fillStyle = "#16202a";
    const write = (text, y) => { g.strokeText(text, m, y); g.fillText(text, m, y); };
    g.font = "700 38px system-ui, sans-serif"; write(Number.isFinite(this.measured) ? `${(this.measured * 180 / Math.PI).toFixed(1)}°` : "–", m - 40);
    g.font = "700 28px system-ui, sans-serif"; write(`${Number.isFinite(this.torque) ? this.torque.toFixed(2) : "–"} N·m`, m + 80);
  }
}
