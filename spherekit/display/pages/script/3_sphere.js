// The sphere: points on the unit sphere, seen from far away; what is behind it is faint.

const canvas = document.getElementById("sphere");
const pen = canvas.getContext("2d");
const sight = {x: 0, y: 0, radius: 1, right: [0, 1, 0], up: [0, 0, 1], eye: [1, 0, 0]};

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const scaled = (a, s) => [a[0] * s, a[1] * s, a[2] * s];
const plus = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
const unitOf = a => scaled(a, 1 / (Math.hypot(...a) || 1));
const turned = (r, a) => [dot(r.slice(0, 3), a), dot(r.slice(3, 6), a), dot(r.slice(6, 9), a)];
const beside = a => unitOf(cross(a, Math.abs(a[2]) < 0.8 ? [0, 0, 1] : [1, 0, 0]));

const chord = () => 0.09 / Math.sqrt(state.zoom);  // rad; off its arc by a third of a pixel

function arc(a, b, step = chord()) {       // points of the shorter great-circle arc
  const angle = Math.atan2(Math.hypot(...cross(a, b)), dot(a, b));
  if (!(angle > 1e-6)) return [];
  const toward = unitOf(plus(b, scaled(a, -dot(a, b)))), count = Math.ceil(angle / step) + 1;
  return Array.from({length: count}, (_, k) => {
    const t = (angle * k) / (count - 1);
    return plus(scaled(a, Math.cos(t)), scaled(toward, Math.sin(t)));
  });
}

function circle(centre, radius, from = 0, to = 2 * Math.PI, start = null) {
  const one = start ? unitOf(plus(start, scaled(centre, -dot(start, centre)))) : beside(centre);
  const other = cross(centre, one), count = Math.max(2, Math.ceil(Math.abs(to - from) / chord()) + 1);
  return Array.from({length: count}, (_, k) => {
    const t = from + ((to - from) * k) / (count - 1);
    const out = plus(scaled(one, Math.cos(t)), scaled(other, Math.sin(t)));
    return plus(scaled(centre, Math.cos(radius)), scaled(out, Math.sin(radius)));
  });
}

const frame = {width: 0, height: 0};       // of the canvas, in pixels of the page
new ResizeObserver(([{contentRect}]) => {
  Object.assign(frame, {width: contentRect.width, height: contentRect.height});
  change("view");
}).observe(canvas);

function look() {
  const box = frame, ratio = window.devicePixelRatio || 1;
  const wide = Math.round(box.width * ratio), high = Math.round(box.height * ratio);
  if (canvas.width !== wide || canvas.height !== high) Object.assign(canvas, {width: wide, height: high});
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, box.width, box.height);
  const [sy, cy, sp, cp] = [Math.sin(state.yaw), Math.cos(state.yaw), Math.sin(state.pitch), Math.cos(state.pitch)];
  Object.assign(sight, {
    x: box.width / 2, y: box.height / 2,
    radius: 0.44 * Math.min(box.width, box.height) * state.zoom,
    right: [-sy, cy, 0], up: [-sp * cy, -sp * sy, cp], eye: [cp * cy, cp * sy, sp],
  });
}

function seen(point) {
  return [
    sight.x + sight.radius * dot(point, sight.right),
    sight.y - sight.radius * dot(point, sight.up),
    dot(point, sight.eye),
  ];
}

function pointAt(x, y, behind) {           // on the sphere, or on its rim beyond it
  const a = (x - sight.x) / sight.radius, b = (sight.y - y) / sight.radius;
  const rest = 1 - a * a - b * b, depth = rest > 0 ? Math.sqrt(rest) * (behind ? -1 : 1) : 0;
  return unitOf(plus(plus(scaled(sight.right, a), scaled(sight.up, b)), scaled(sight.eye, depth)));
}

// Lines are collected, then drawn: behind, the sphere itself, in front.

let drawn = [];

function line(points, colour, width = 1, more = {}) {
  if (points.length > 1 && Number.isFinite(points[0][0])) drawn.push({points: points.map(seen), colour, width, ...more});
}

function strokes(front) {
  for (const {points, colour, width, dash, fill, faint = 0.22, alpha = 1} of drawn) {
    pen.globalAlpha = alpha * (front ? 1 : faint);
    if (fill) {
      if (points.every(p => p[2] > 0) !== front || (!front && points.some(p => p[2] > 0))) continue;
      pen.fillStyle = fill;
      pen.beginPath();
      points.forEach(p => pen.lineTo(p[0], p[1]));
      pen.fill();
      continue;
    }
    pen.strokeStyle = colour;
    pen.lineWidth = width;
    pen.setLineDash(dash ?? []);
    pen.beginPath();
    let down = false;
    for (let k = 1; k < points.length; k++) {
      const [a, b] = [points[k - 1], points[k]];
      if (a[2] + b[2] >= 0 !== front || !Number.isFinite(a[0] + b[0])) { down = false; continue; }
      if (!down) pen.moveTo(a[0], a[1]);
      pen.lineTo(b[0], b[1]);
      down = true;
    }
    pen.stroke();
  }
  pen.globalAlpha = 1;
  pen.setLineDash([]);
}

function ball() {
  const {x, y, radius} = sight, shade = pen.createRadialGradient(x - radius / 3, y - radius / 3, radius / 8, x, y, radius);
  const [light, rim] = dark() ? ["#3c466455", "#1c213299"] : ["#ffffffa0", "#cfd6e4a0"];
  shade.addColorStop(0, light);
  shade.addColorStop(1, rim);
  pen.fillStyle = shade;
  pen.strokeStyle = colour("--rule");
  pen.lineWidth = 1.2;
  pen.beginPath();
  pen.arc(x, y, radius, 0, 2 * Math.PI);
  pen.fill();
  pen.stroke();
}

function graticule() {
  const tint = dark() ? "#3e445a" : "#c3cad8";
  for (let east = 0; east < 180; east += 30)
    line(circle([Math.cos(east * DEG), Math.sin(east * DEG), 0], Math.PI / 2), tint, 0.7, {faint: 0.5});
  for (let north = -60; north < 90; north += 30)
    line(circle([0, 0, 1], (90 - north) * DEG), tint, 0.7, {faint: 0.5});
}

// Names keep off dots and each other; those in front come first.

let words = [], taken = [];

function name(point, text, tint, more = {}) {
  const [x, y, depth] = seen(point);
  if (Number.isFinite(x)) words.push({x, y, depth, text, tint, ...more});
}

function writeNames() {
  words.sort((a, b) => b.depth - a.depth);
  pen.textAlign = "center";
  pen.textBaseline = "middle";
  for (const {x, y, depth, text, tint, bold} of words) {
    pen.font = `${bold ? "700 13px" : "600 12px"} system-ui, sans-serif`;
    const half = pen.measureText(text).width / 2 + 2;
    const out = Math.atan2(y - sight.y, x - sight.x);
    const boxes = [0, 1, -1, 2, -2, 3, -3, 4].flatMap(turn => [14, 24].map(far => {
      const angle = out + (turn * Math.PI) / 4, reach = far + half * Math.abs(Math.cos(angle));
      return [x + reach * Math.cos(angle), y + far * Math.sin(angle)];
    }));
    const inside = boxes.map(([u, v]) => [clamp(u, half, frame.width - half), v]);
    const free = inside.find(([u, v]) => taken.every(t => Math.abs(t[0] - u) > t[2] + half || Math.abs(t[1] - v) > t[3] + 7)) ?? inside[0];
    taken.push([...free, half, 7]);
    pen.globalAlpha = depth < -0.05 ? 0.35 : 1;
    pen.lineWidth = 3.5;
    pen.lineJoin = "round";
    pen.strokeStyle = colour("--halo");
    pen.strokeText(text, ...free);
    pen.fillStyle = tint;
    pen.fillText(text, ...free);
  }
  pen.globalAlpha = 1;
}

function disc(point, radius, fill, edge, {ring = 0, square = false, width = 2} = {}) {
  const [x, y, depth] = seen(point);
  if (!Number.isFinite(x)) return;
  taken.push([x, y, radius, radius]);
  pen.globalAlpha = depth < 0 ? 0.3 : 1;
  pen.beginPath();
  if (square) {
    pen.moveTo(x, y - radius); pen.lineTo(x + radius, y); pen.lineTo(x, y + radius); pen.lineTo(x - radius, y); pen.closePath();
  } else pen.arc(x, y, radius, 0, 2 * Math.PI);
  pen.fillStyle = fill;
  pen.fill();
  pen.strokeStyle = edge;
  pen.lineWidth = width;
  pen.stroke();
  if (ring) {
    pen.beginPath();
    pen.arc(x, y, ring, 0, 2 * Math.PI);
    pen.lineWidth = 1.5;
    pen.strokeStyle = colour("--accent");
    pen.stroke();
  }
  pen.globalAlpha = 1;
}
