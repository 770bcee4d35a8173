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
  const border = {tint: "--fold", segments: []}, curves = [border], cells = [];
  for (let i = 0; i + 1 < GRID; i++)
    for (let j = 0; j + 1 < GRID; j++) {
      const {outline, edge} = cellOf(mode, axes, nodes, i, j, sizes);
      if (outline.length > 2) cells.push(outline);
      if (edge.length === 2) border.segments.push(edge);
    }
  for (const {tint, place} of KINDS)
    if (place !== undefined) curves.push({tint, segments: zeros(axes, (i, j) => nodes[i][j]?.[place] ?? NaN)});
  const on = outline => outline.map(q => output(mode, q, sizes)).filter(p => Number.isFinite(p[0]));
  return {cells, curves, faces: cells.map(on), lines: curves.flatMap(({tint, segments}) => segments.map(ends => ({tint, ends: on(ends)})))};
}

// The part of a cell in which a mode closes, and its edge to where it does not.

function cellOf(mode, axes, nodes, i, j, sizes) {
  const corners = [[i, j], [i + 1, j], [i + 1, j + 1], [i, j + 1]], closes = ([a, b]) => nodes[a][b] !== null;
  const outline = [], edge = [];
  if (!corners.some(closes)) return {outline, edge};
  corners.forEach((a, k) => {
    const b = corners[(k + 1) % 4];
    if (closes(a)) outline.push(atNode(axes, a));
    if (closes(a) === closes(b)) return;
    const place = lastThat(mode, ...(closes(a) ? [a, b] : [b, a]).map(x => atNode(axes, x)), sizes);
    outline.push(place);
    edge.push(place);
  });
  return {outline, edge};
}

function lastThat(mode, good, bad, sizes) {  // closes, on the way from one that does
  const part = refined(0, 1, middle => {
    const [x, y] = between(good, bad, middle);
    return mode.at(state.q.with(0, x).with(1, y), sizes);
  });
  return between(good, bad, part);
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

function drawReach() {
  if (!reach) return;
  const tint = mixed(dark() ? "#6cb6ff" : "#0b63b0", dark() ? 0 : 255, 0.1);
  const faces = reach.faces.map(points => points.map(seen));
  for (const front of [false, true]) {
    pen.globalAlpha = front ? 0.2 : 0.07;
    pen.fillStyle = tint;
    pen.beginPath();
    for (const points of faces) if (points.length > 2 && points.every(p => p[2] >= 0) === front) outlined(pen, points);
    pen.fill();
  }
  pen.globalAlpha = 1;
  for (const {tint, ends} of reach.lines) if (ends.length > 1) line(ends, colour(tint), 2);
}

function outlined(brush, points) {         // all in one sense, so that what overlaps is filled
  let area = 0;
  points.forEach(([x, y], k) => { const [u, v] = points[(k + 1) % points.length]; area += x * v - y * u; });
  (area < 0 ? [...points].reverse() : points).forEach(([x, y], k) => (k ? brush.lineTo(x, y) : brush.moveTo(x, y)));
  brush.closePath();
}

function drawPad() {
  const ratio = window.devicePixelRatio || 1, size = pad.clientWidth, brush = pad.getContext("2d");
  Object.assign(pad, {width: size * ratio, height: size * ratio});
  brush.setTransform(ratio, 0, 0, ratio, 0, 0);
  const [x, y] = [0, 1].map(k => value => padded(k, value, size));
  brush.fillStyle = mixed(dark() ? "#6cb6ff" : "#0b63b0", dark() ? 24 : 255, 0.76);
  brush.beginPath();
  for (const outline of reach.cells) outlined(brush, outline.map(([a, b]) => [x(a), y(b)]));
  brush.fill();
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
