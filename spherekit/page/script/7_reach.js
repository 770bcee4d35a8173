// Two inputs: which of them close, what the output reaches, and the singular curves of both.

const pad = document.getElementById("pad");
const GRID = 49;
const several = inputs.length > 1;
let reach = null;

const KINDS = [
  {tint: "--fold", place: determinant},
  {tint: "--stop", place: rows.place.get(model.stops)},
];

function surveyed(mode, sizes) {
  const axes = inputs.slice(0, 2).map(({from, to}) => Array.from({length: GRID}, (_, k) => from + (k * (to - from)) / (GRID - 1)));
  const nodes = axes[0].map(a => {
    const base = state.q.with(0, a);
    const places = mode.along(1, axes[1], base, sizes);
    return axes[1].map((b, j) => (places[j] ? Float64Array.from(evaluated(rows, base.with(1, b), places[j], sizes)) : null));
  });
  const inside = (i, j) => nodes[i][j] !== null;
  const curves = [borderOf(mode, axes, inside, sizes)];
  for (const {tint, place} of KINDS)
    if (place !== undefined) curves.push({tint, segments: zeros(axes, (i, j) => nodes[i][j]?.[place] ?? NaN)});
  return {axes, nodes, curves: curves.map(curve => ({...curve, on: curve.segments.map(ends => ends.map(q => output(mode, q, sizes)))}))};
}

function output(mode, [a, b], sizes) {
  const q = state.q.with(0, a).with(1, b), place = mode.at(q, sizes);
  return place ? directionOf(evaluated(rows, q, place, sizes, scratch)) : [NaN, NaN, NaN];
}

function directionOf(row) {
  return row && model.paths.length ? ["x", "y", "z"].map(x => row[rows.place.get(`${model.paths[0].stem}_${x}`)]) : [NaN, NaN, NaN];
}

function crossings(axes, changes, placed) {  // marching squares: segments between the edges' places
  const segments = [];
  for (let i = 0; i + 1 < GRID; i++)
    for (let j = 0; j + 1 < GRID; j++) {
      const corners = [[i, j], [i + 1, j], [i + 1, j + 1], [i, j + 1]];
      const places = corners.flatMap((a, k) => {
        const b = corners[(k + 1) % 4];
        return changes(a, b) ? [placed(a, b)] : [];
      });
      for (let k = 0; k + 1 < places.length; k += 2) segments.push([places[k], places[k + 1]]);
    }
  return segments;
}

const atNode = (axes, [i, j]) => [axes[0][i], axes[1][j]];

function zeros(axes, value) {
  const between2 = (a, b) => {
    const [x, y] = [value(...a), value(...b)];
    return between(atNode(axes, a), atNode(axes, b), x / (x - y));
  };
  return crossings(axes, (a, b) => value(...a) * value(...b) < 0, between2);
}

function borderOf(mode, axes, inside, sizes) {  // where the mode ends, from the side that closes
  const placed = (a, b) => {
    const [good, bad] = (inside(...a) ? [a, b] : [b, a]).map(x => atNode(axes, x));
    let part = [0, 1];
    for (let k = 0; k < 30; k++) {
      const middle = 0.5 * (part[0] + part[1]), [x, y] = between(good, bad, middle);
      part = mode.at(state.q.with(0, x).with(1, y), sizes) ? [middle, part[1]] : [part[0], middle];
    }
    return between(good, bad, part[0]);
  };
  return {tint: "--fold", segments: crossings(axes, (a, b) => inside(...a) !== inside(...b), placed)};
}

function drawReach() {
  if (!reach) return;
  const tint = mixed(dark() ? "#6cb6ff" : "#0b63b0", dark() ? 0 : 255, 0.1);
  const points = reach.nodes.map(column => column.map(row => (row ? directionOf(row) : null)));
  pen.save();
  for (const front of [false, true]) {
    pen.globalAlpha = front ? 0.2 : 0.07;
    pen.fillStyle = tint;
    pen.beginPath();
    for (let i = 0; i + 1 < GRID; i++)
      for (let j = 0; j + 1 < GRID; j++) {
        const quad = [points[i][j], points[i + 1][j], points[i + 1][j + 1], points[i][j + 1]];
        if (quad.some(p => !p)) continue;
        const flat = quad.map(seen);
        if (flat.every(p => p[2] >= 0) !== front) continue;
        const turn = (flat[2][0] - flat[0][0]) * (flat[3][1] - flat[1][1]) - (flat[2][1] - flat[0][1]) * (flat[3][0] - flat[1][0]);
        pen.moveTo(flat[0][0], flat[0][1]);
        for (const k of turn > 0 ? [1, 2, 3] : [3, 2, 1]) pen.lineTo(flat[k][0], flat[k][1]);
        pen.closePath();
      }
    pen.fill();
  }
  pen.restore();
  for (const {tint, on} of reach.curves) for (const segment of on) if (segment.every(p => Number.isFinite(p[0]))) line(segment, colour(tint), 2);
}

function drawPad() {
  const ratio = window.devicePixelRatio || 1, size = pad.clientWidth, brush = pad.getContext("2d");
  Object.assign(pad, {width: size * ratio, height: size * ratio});
  brush.setTransform(ratio, 0, 0, ratio, 0, 0);
  const [x, y] = [0, 1].map(k => value => padded(k, value, size));
  const cellSize = (size - 2 * EDGE) / (GRID - 1);
  brush.fillStyle = `color-mix(in srgb, ${colour("--accent")} 22%, transparent)`;
  reach.nodes.forEach((column, i) => column.forEach((row, j) => {
    if (row) brush.fillRect(x(reach.axes[0][i]) - cellSize / 2, y(reach.axes[1][j]) - cellSize / 2, cellSize + 0.3, cellSize + 0.3);
  }));
  brush.strokeStyle = colour("--rule");
  brush.strokeRect(EDGE, EDGE, size - 2 * EDGE, size - 2 * EDGE);
  for (const {tint, segments} of reach.curves) {
    brush.strokeStyle = colour(tint);
    brush.lineWidth = 2;
    brush.beginPath();
    for (const [[a, b], [c, d]] of segments) { brush.moveTo(x(a), y(b)); brush.lineTo(x(c), y(d)); }
    brush.stroke();
  }
  brush.fillStyle = colour("--soft");
  brush.font = "11px system-ui, sans-serif";
  brush.textAlign = "center";
  const [one, other] = inputs, said = value => text(value / UNIT, false);
  brush.fillText(`${one.pair}: ${said(one.from)} … ${said(one.to)} ${SIGN}`, size / 2, size - 7);
  brush.save();
  brush.translate(11, size / 2);
  brush.rotate(-Math.PI / 2);
  brush.fillText(`${other.pair}: ${said(other.from)} … ${said(other.to)} ${SIGN}`, 0, 0);
  brush.restore();
  brush.beginPath();
  brush.arc(x(state.q[0]), y(state.q[1]), 6.5, 0, 2 * Math.PI);
  brush.fillStyle = modes[state.mode].here ? colour("--ink") : colour("--warn");
  brush.fill();
  brush.strokeStyle = colour("--card");
  brush.stroke();
}

const EDGE = 20;

function padded(k, value, size) {
  const {from, to} = inputs[k], part = (value - from) / (to - from);
  return EDGE + (k ? 1 - part : part) * (size - 2 * EDGE);
}

function fromPad(event) {
  const box = pad.getBoundingClientRect(), wide = box.width - 2 * EDGE;
  const parts = [(event.clientX - box.left - EDGE) / wide, 1 - (event.clientY - box.top - EDGE) / wide];
  parts.forEach((part, k) => setInput(k, inputs[k].from + clamp(part, 0, 1) * (inputs[k].to - inputs[k].from)));
}

pad.onpointerdown = event => { pad.setPointerCapture(event.pointerId); pause(); fromPad(event); };
pad.onpointermove = event => { if (pad.hasPointerCapture(event.pointerId)) fromPad(event); };
pad.onkeydown = event => {
  const way = {ArrowLeft: [0, -1], ArrowRight: [0, 1], ArrowDown: [1, -1], ArrowUp: [1, 1]}[event.key];
  if (!way) return;
  event.preventDefault();
  nudge(way[0], way[1] * (event.shiftKey ? 5 : 1));
};
