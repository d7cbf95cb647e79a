"use strict";
// Draws what cameras see that turn: everything is far away. Frames: x ahead, y left, z up; see gaze.py.
function gaze(seen) {
  const SKY = ["#8fbfe8", "#dcecf8"], GROUND = ["#b7b39c", "#8f9078"], LINE = "#6f7159", HILL = "#8aa0a8";
  const RED = "#d8321f", PALE = "#fffdf6", DARK = "#17212d";

  // exp(e) by Rodrigues' formula, rows.
  function exp(e) {
    const a = Math.hypot(e[0], e[1], e[2]), s = a > 1e-9 ? Math.sin(a) / a : 1;
    const c = a > 1e-9 ? (1 - Math.cos(a)) / (a * a) : 0.5, [x, y, z] = e;
    return [[1 - c * (y * y + z * z), c * x * y - s * z, c * x * z + s * y],
      [c * x * y + s * z, 1 - c * (x * x + z * z), c * y * z - s * x],
      [c * x * z - s * y, c * y * z + s * x, 1 - c * (x * x + y * y)]];
  }
  const back = (R, p) => [0, 1, 2].map(k => R[0][k] * p[0] + R[1][k] * p[1] + R[2][k] * p[2]);
  // The camera's turn at a time between two frames.
  function turn(picture, time) {
    const t = seen.t, at = Math.min(Math.max((time - t[0]) / (t[1] - t[0]), 0), t.length - 1);
    const k = Math.min(Math.floor(at), t.length - 2), w = at - k, e = picture.turned;
    return [0, 1, 2].map(j => (1 - w) * e[k][j] + w * e[k + 1][j]);
  }
  // Where a direction of the wanted camera's frame lies in the picture: (-y/x, z/x), as a share of half its width.
  function place(picture, time, p) {
    const q = back(exp(turn(picture, time)), p);
    return q[0] > seen.near ? [-q[1] / q[0] / picture.half, q[2] / q[0] / picture.half] : null;
  }

  function draw(canvas, picture, time) {
    const ratio = window.devicePixelRatio || 1, w = canvas.clientWidth, h = canvas.clientHeight;
    if (!w || !h) return;
    if (canvas.width !== Math.round(w * ratio)) { canvas.width = Math.round(w * ratio); canvas.height = Math.round(h * ratio); }
    const c = canvas.getContext("2d"), R = exp(turn(picture, time)), f = w / 2 / picture.half;
    const at = q => [w / 2 - f * q[1] / q[0], h / 2 - f * q[2] / q[0]];
    c.setTransform(ratio, 0, 0, ratio, 0, 0);
    c.clearRect(0, 0, w, h);
    if (picture.long) paper(c, w, h); else world(c, R, w, h, f, at);
    target(c, picture, at(back(R, [1, 0, 0])), f, w);
    if (picture.long) trail(c, picture, time, w, h, f);
    reticle(c, picture, w, h, f);
  }

  function paper(c, w, h) { c.fillStyle = "#c9c5b2"; c.fillRect(0, 0, w, h); }

  function world(c, R, w, h, f, at) {
    const up = back(R, seen.up), far = 4 * (w + h);
    // Points of the picture whose ray leaves the horizon's plane downwards: up · (1, -a, b) < 0.
    const n = Math.hypot(up[1], up[2]) || 1e-9, x = w / 2 + f * up[0] * up[1] / (n * n), y = h / 2 + f * up[0] * up[2] / (n * n);
    const down = [up[1] / n, up[2] / n], side = [-down[1], down[0]];
    const sky = c.createLinearGradient(x - 0.6 * h * down[0], y - 0.6 * h * down[1], x, y);
    sky.addColorStop(0, SKY[0]); sky.addColorStop(1, SKY[1]);
    c.fillStyle = sky; c.fillRect(0, 0, w, h);
    shape(c, seen.hills.map(p => back(R, p)), at, HILL);
    const ground = c.createLinearGradient(x, y, x + h * down[0], y + h * down[1]);
    ground.addColorStop(0, GROUND[0]); ground.addColorStop(1, GROUND[1]);
    c.fillStyle = ground; c.beginPath();
    c.moveTo(x - far * side[0], y - far * side[1]); c.lineTo(x + far * side[0], y + far * side[1]);
    c.lineTo(x + far * (side[0] + down[0]), y + far * (side[1] + down[1]));
    c.lineTo(x - far * (side[0] - down[0]), y - far * (side[1] - down[1]));
    c.fill();
    c.strokeStyle = LINE; c.lineWidth = 1; c.globalAlpha = 0.55; c.beginPath();
    for (const l of seen.lines) {
      let a = back(R, l.slice(0, 3)), b = back(R, l.slice(3));
      if (a[0] <= seen.near && b[0] <= seen.near) continue;
      if (a[0] <= seen.near) a = cut(a, b); else if (b[0] <= seen.near) b = cut(b, a);
      c.moveTo(...at(a)); c.lineTo(...at(b));
    }
    c.stroke(); c.globalAlpha = 1;
    c.strokeStyle = DARK; c.lineWidth = 1.5; c.beginPath();
    c.moveTo(x - far * side[0], y - far * side[1]); c.lineTo(x + far * side[0], y + far * side[1]); c.stroke();
  }

  const cut = (a, b) => { const s = (seen.near * 1.001 - a[0]) / (b[0] - a[0]); return a.map((v, k) => v + s * (b[k] - v)); };

  function shape(c, points, at, colour) {
    const ahead = points.filter(q => q[0] > seen.near);
    if (ahead.length < 2) return;
    c.fillStyle = colour; c.beginPath();
    for (const q of ahead) c.lineTo(...at(q));
    c.lineTo(at(ahead[ahead.length - 1])[0], 4e3); c.lineTo(at(ahead[0])[0], 4e3); c.fill();
  }

  function target(c, picture, [x, y], f, w) {
    const radii = [...picture.rings].reverse().map(r => f * Math.tan(r));
    radii.forEach((r, k) => {
      c.beginPath(); c.arc(x, y, r, 0, 7); c.fillStyle = k % 2 ? PALE : picture.long ? "#e9e4d2" : RED; c.fill();
      c.lineWidth = picture.long ? Math.max(2, w / 160) : 1.5; c.strokeStyle = picture.long ? RED : PALE; c.stroke();
    });
    c.beginPath(); c.arc(x, y, Math.max(2.5, w / 110), 0, 7); c.fillStyle = RED; c.fill();
  }

  // Where the target's centre was in the last 0.4 s.
  function trail(c, picture, time, w, h, f) {
    const dt = seen.t[1] - seen.t[0];
    c.strokeStyle = DARK; c.lineWidth = 1.2; c.globalAlpha = 0.75; c.beginPath();
    for (let back_ = 0; back_ <= 24; back_++) {
      const when = time - back_ * dt;
      if (when < seen.t[0]) break;
      const p = place(picture, when, [1, 0, 0]);
      if (p) c.lineTo(w / 2 + p[0] * w / 2, h / 2 - p[1] * w / 2);
    }
    c.stroke(); c.globalAlpha = 1;
  }

  // What stays in the picture: a cross in its middle, and a long lens's scale.
  function reticle(c, picture, w, h, f) {
    const s = w / 34;
    c.strokeStyle = DARK; c.lineWidth = 1.5; c.globalAlpha = 0.9; c.beginPath();
    for (const [a, b] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
      c.moveTo(w / 2 + a * s, h / 2 + b * s); c.lineTo(w / 2 + 2.6 * a * s, h / 2 + 2.6 * b * s);
    }
    c.stroke(); c.globalAlpha = 1;
    if (!picture.long) return;
    const length = f * Math.tan(picture.rings[0]), x = 12, y = h - 12;
    c.beginPath(); c.moveTo(x, y - 5); c.lineTo(x, y); c.lineTo(x + length, y); c.lineTo(x + length, y - 5); c.stroke();
    c.fillStyle = DARK; c.font = "13px system-ui, sans-serif"; c.fillText(picture.scale, x + 4, y - 6);
  }

  return { draw, place };
}
