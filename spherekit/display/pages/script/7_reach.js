// Two inputs: which of them close, what the output reaches, and the singular curves of both.

const pad = document.getElementById("pad");
const FINE = 33, QUICK = 17;               // nodes along each input, the fewer while sizes move
const several = inputs.length > 1;
let reach = null;

const KINDS = [
  {tint: "--fold", value: row => row[determinant]},
  {tint: "--stop", value: row => row[rows.place.get(model.stops)] * row[determinant]},
  ...limits.map(limit => ({tint: "--limit", value: (row, q) => marginOf(limit, row, q)})),
];

function surveyed(mode, sizes, count) {
  const axes = inputs.slice(0, 2).map(input => inputGrid(input, count));
  const nodes = axes[0].map(a => {
    const states = mode.along(1, axes[1], state.q.with(0, a), sizes);
    return states.map((closed, j) => closed && reachedAt([a, axes[1][j]], closed));
  });
  const border = {tint: "--fold", segments: []}, curves = [border], cells = [];
  for (let i = 0; i + 1 < count; i++)
    for (let j = 0; j + 1 < count; j++) {
      const {outline, edge} = cellOf(mode, axes, nodes, i, j, sizes);
      if (outline.length > 2) cells.push(outline);
      if (edge.length === 2) border.segments.push(edge);
    }
  for (const {tint, value} of KINDS) curves.push({tint, segments: cells.flatMap(outline => zeros(mode, outline, value, sizes))});
  return {cells, curves, drawn: null};
}

function reachedAt(q, closed) {            // inputs, and where the output then points
  return {q, row: closed?.row, at: closed && directionOf(closed.row)};
}

function placed(mode, q, sizes) {
  return reachedAt(q, mode.state([...q, ...state.q.slice(2)], sizes));
}

// The part of a cell in which a mode closes, and its edge to where it does not.

function cellOf(mode, axes, nodes, i, j, sizes) {
  const corners = [[i, j], [i + 1, j], [i + 1, j + 1], [i, j + 1]].map(([a, b]) => ({closed: nodes[a][b], q: [axes[0][a], axes[1][b]]}));
  const outline = [], edge = [];
  if (!corners.some(corner => corner.closed)) return {outline, edge};
  corners.forEach((a, k) => {
    const b = corners[(k + 1) % 4];
    if (a.closed) outline.push(a.closed);
    if (!a.closed === !b.closed) return;
    const [good, bad] = (a.closed ? [a, b] : [b, a]).map(({q}) => [...q, ...state.q.slice(2)]);
    const last = placed(mode, mode.end(good, bad, sizes).slice(0, 2), sizes);
    outline.push(last);
    edge.push(last);
  });
  return {outline, edge};
}

function directionOf(row) {
  return model.paths.length ? ["x", "y", "z"].map(x => row[rows.place.get(`${model.paths[0].stem}_${x}`)]) : null;
}

function zeros(mode, outline, value, sizes) {  // segments between zeros on the sides of a cell
  const numbers = outline.map(({row, q}) => (row ? value(row, [...q, ...state.q.slice(2)]) : NaN)), found = [], segments = [];
  numbers.forEach((x, k) => {
    const next = (k + 1) % numbers.length, y = numbers[next];
    if (x * y < 0) found.push(placed(mode, interpolate(outline[k].q, outline[next].q, x / (x - y)), sizes));
  });
  const apart = (a, b) => Math.hypot(a.q[0] - b.q[0], a.q[1] - b.q[1]);
  const crosses = found.length === 4 && apart(found[0], found[1]) + apart(found[2], found[3]) > apart(found[1], found[2]) + apart(found[3], found[0]);
  if (crosses) found.push(found.shift());
  for (let k = 0; k + 1 < found.length; k += 2) segments.push([found[k], found[k + 1]]);
  return segments;
}

function drawReach() {
  if (!reach) return;
  const tint = mixed(dark() ? "#6cb6ff" : "#0b63b0", dark() ? 0 : 255, 0.1);
  const faces = reach.cells.map(outline => outline.flatMap(({at}) => (at ? [seen(at)] : [])));
  for (const front of [false, true]) {
    pen.globalAlpha = front ? 0.2 : 0.07;
    pen.fillStyle = tint;
    pen.beginPath();
    for (const points of faces) if (points.length > 2 && points.every(p => p[2] >= 0) === front) outlined(pen, points);
    pen.fill();
  }
  pen.globalAlpha = 1;
  for (const {tint, segments} of reach.curves)
    for (const [a, b] of segments) if (a.at && b.at) line([a.at, b.at], colour(tint), 2);
}

function outlined(brush, points) {         // all in one sense, so that what overlaps is filled
  let area = 0;
  points.forEach(([x, y], k) => { const [u, v] = points[(k + 1) % points.length]; area += x * v - y * u; });
  (area < 0 ? [...points].reverse() : points).forEach(([x, y], k) => (k ? brush.lineTo(x, y) : brush.moveTo(x, y)));
  brush.closePath();
}

function drawPad() {
  const ratio = window.devicePixelRatio || 1, size = pad.clientWidth, brush = pad.getContext("2d");
  if (reach.drawn?.size !== size) reach.drawn = {size, map: mapOf(size, ratio)};
  if (pad.width !== Math.round(size * ratio)) Object.assign(pad, {width: size * ratio, height: size * ratio});
  brush.setTransform(ratio, 0, 0, ratio, 0, 0);
  brush.clearRect(0, 0, size, size);
  brush.drawImage(reach.drawn.map, 0, 0, size, size);
  brush.beginPath();
  brush.arc(padded(0, state.q[0], size), padded(1, state.q[1], size), 6.5, 0, 2 * Math.PI);
  brush.fillStyle = modes[state.mode].here ? colour("--ink") : colour("--warn");
  brush.fill();
  brush.strokeStyle = colour("--card");
  brush.stroke();
}

function mapOf(size, ratio) {
  const map = made("canvas", {width: size * ratio, height: size * ratio}), brush = map.getContext("2d");
  const [x, y] = [0, 1].map(k => value => padded(k, value, size));
  brush.scale(ratio, ratio);
  brush.fillStyle = mixed(dark() ? "#6cb6ff" : "#0b63b0", dark() ? 24 : 255, 0.76);
  brush.beginPath();
  for (const outline of reach.cells) outlined(brush, outline.map(({q: [a, b]}) => [x(a), y(b)]));
  brush.fill();
  brush.strokeStyle = colour("--rule");
  brush.strokeRect(EDGE, EDGE, size - 2 * EDGE, size - 2 * EDGE);
  for (const {tint, segments} of reach.curves) {
    brush.strokeStyle = colour(tint);
    brush.lineWidth = 2;
    brush.beginPath();
    for (const [{q: [a, b]}, {q: [c, d]}] of segments) { brush.moveTo(x(a), y(b)); brush.lineTo(x(c), y(d)); }
    brush.stroke();
  }
  brush.fillStyle = colour("--soft");
  brush.font = "11px system-ui, sans-serif";
  brush.textAlign = "center";
  const said = ({pair, from, to}) => `${pair}: ${text(from / UNIT, false)} … ${text(to / UNIT, false)} ${SIGN}`;
  brush.fillText(said(inputs[0]), size / 2, size - 6);
  brush.translate(11, size / 2);
  brush.rotate(-Math.PI / 2);
  brush.fillText(said(inputs[1]), 0, 0);
  return map;
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
