// Two inputs: where the mode closes, what the output reaches, and the singular curves of both.
//
// Both inputs are surveyed on a grid, with the other inputs as they are. A node is {q, row, direction}:
// the two inputs (rad), the results there, and the direction of the output in the ground frame, if
// there is an output. An outline is the list of nodes around the part of a cell in which the mode closes.

const FINE_NODE_COUNT = 33;                // nodes along each input
const QUICK_NODE_COUNT = 17;               // the same while sizes move
const MAP_MARGIN_PX = 20;                  // around the square of the map
const MAP_POINT_RADIUS_PX = 6.5;
const FAST_STEPS = 5;                      // steps of an arrow key with shift

const pad = document.getElementById("pad");
const hasSeveralInputs = inputs.length > 1;
let inputSurvey = null;                    // what `surveyInputs` returned for the chosen mode

// Curves on the map are the zeros of these values, in the colours of the style sheet.
const CURVE_KINDS = [
  {tint: "--fold", value: row => row[determinant]},
  {tint: "--stop", value: row => row[rows.place.get(model.stops)] * row[determinant]},
  ...limits.map(limit => ({tint: "--limit", value: (row, q) => marginOf(limit, row, q)})),
];

const withOtherInputs = twoInputs => [...twoInputs, ...state.q.slice(2)];

/**
 * Surveys a mode over the ranges of the first two inputs.
 * @param sizes - Sizes of the kernel.
 * @param count - Number of nodes along each input.
 * @returns {cells, curves, drawnMap} - The outlines; {tint, segments} for the border of the mode and each
 *   kind of curve, where a segment is two nodes; and the drawn map, which `drawPad` keeps here.
 */
function surveyInputs(mode, sizes, count) {
  const axes = inputs.slice(0, 2).map(input => inputGrid(input, count));
  const nodes = axes[0].map(firstInput => {
    const configurations = mode.along(1, axes[1], state.q.with(0, firstInput), sizes);
    return configurations.map((configuration, j) => configuration && makeNode([firstInput, axes[1][j]], configuration));
  });
  const borderSegments = [];
  const cells = [];
  for (let i = 0; i + 1 < count; i++)
    for (let j = 0; j + 1 < count; j++) {
      const {outline, border} = outlineCell(mode, axes, nodes, i, j, sizes);
      if (outline.length > 2) cells.push(outline);
      if (border.length === 2) borderSegments.push(border);
    }
  const curves = [{tint: "--fold", segments: borderSegments}];
  for (const {tint, value} of CURVE_KINDS)
    curves.push({tint, segments: cells.flatMap(outline => findZeroSegments(mode, outline, value, sizes))});
  return {cells, curves, drawnMap: null};
}

function makeNode(q, configuration) {
  return {q, row: configuration?.row, direction: configuration && outputDirection(configuration.row)};
}

/** Returns the node of a mode at two inputs; without results if the mode does not close there. */
function evaluateNode(mode, q, sizes) {
  return makeNode(q, mode.state(withOtherInputs(q), sizes));
}

/** Returns the direction of the first output that has a path; null if there is none. */
function outputDirection(row) {
  if (!model.paths.length) return null;
  return XYZ.map(letter => row[rows.place.get(`${model.paths[0].stem}_${letter}`)]);
}

/**
 * Finds the part of a cell in which a mode closes.
 * @param axes - Inputs (rad) of the nodes along both inputs.
 * @param nodes - Nodes by both indices, null where the mode does not close.
 * @param i, j - Indices of the corner of the cell with the least inputs.
 * @returns {outline, border} - The nodes around the part, and those of them where the mode ends.
 */
function outlineCell(mode, axes, nodes, i, j, sizes) {
  const cornerIndices = [[i, j], [i + 1, j], [i + 1, j + 1], [i, j + 1]];
  const corners = cornerIndices.map(([a, b]) => ({node: nodes[a][b], q: withOtherInputs([axes[0][a], axes[1][b]])}));
  const outline = [];
  const border = [];
  if (!corners.some(({node}) => node)) return {outline, border};
  corners.forEach((corner, k) => {
    const nextCorner = corners[(k + 1) % 4];
    if (corner.node) outline.push(corner.node);
    if (Boolean(corner.node) === Boolean(nextCorner.node)) return;
    const [good, bad] = corner.node ? [corner, nextCorner] : [nextCorner, corner];
    const lastInputs = mode.end(good.q, bad.q, sizes).slice(0, 2);
    const lastNode = evaluateNode(mode, lastInputs, sizes);
    outline.push(lastNode);
    border.push(lastNode);
  });
  return {outline, border};
}

/**
 * Returns the segments of the zeros of a value in a cell, between its zeros on the sides.
 * @param outline - Nodes around the cell.
 * @param value - Function of the results and all inputs.
 */
function findZeroSegments(mode, outline, value, sizes) {
  const values = outline.map(({row, q}) => (row ? value(row, withOtherInputs(q)) : NaN));
  const zeros = [];
  values.forEach((current, k) => {
    const nextIndex = (k + 1) % values.length;
    const next = values[nextIndex];
    if (!(current * next < 0)) return;
    const zeroInputs = interpolate(outline[k].q, outline[nextIndex].q, current / (current - next));
    zeros.push(evaluateNode(mode, zeroInputs, sizes));
  });
  // Four zeros can be joined to two segments in two ways. The shorter segments are taken.
  const distance = (a, b) => Math.hypot(zeros[a].q[0] - zeros[b].q[0], zeros[a].q[1] - zeros[b].q[1]);
  if (zeros.length === 4 && distance(0, 1) + distance(2, 3) > distance(1, 2) + distance(3, 0)) zeros.push(zeros.shift());
  const segments = [];
  for (let k = 0; k + 1 < zeros.length; k += 2) segments.push([zeros[k], zeros[k + 1]]);
  return segments;
}

/** Draws what the output reaches on the sphere as an area, and adds the singular curves to its lines. */
function drawWorkspace() {
  if (!inputSurvey) return;
  const areaColour = mixWithGrey(isDark() ? "#6cb6ff" : "#0b63b0", isDark() ? 0 : 255, 0.1);
  const polygons = inputSurvey.cells.map(outline => outline.filter(node => node.direction).map(node => projectPoint(node.direction)));
  for (const isFront of [false, true]) {
    pen.globalAlpha = isFront ? 0.2 : 0.07;
    pen.fillStyle = areaColour;
    pen.beginPath();
    for (const points of polygons) {
      const isPolygonInFront = points.every(([, , depth]) => depth >= 0);
      if (points.length > 2 && isPolygonInFront === isFront) tracePolygon(pen, points);
    }
    pen.fill();
  }
  pen.globalAlpha = 1;
  for (const {tint, segments} of inputSurvey.curves)
    for (const [start, end] of segments)
      if (start.direction && end.direction) addLine([start.direction, end.direction], themeColour(tint), 2);
}

/** Adds a polygon to a path, always in the same sense. Polygons that overlap are then filled once. */
function tracePolygon(context, points) {
  let doubleArea = 0;
  points.forEach(([x, y], k) => {
    const [nextX, nextY] = points[(k + 1) % points.length];
    doubleArea += x * nextY - y * nextX;
  });
  const ordered = doubleArea < 0 ? [...points].reverse() : points;
  ordered.forEach(([x, y], k) => {
    if (k) context.lineTo(x, y);
    else context.moveTo(x, y);
  });
  context.closePath();
}

// The map of both inputs

/** Draws the map and the point of the inputs. The map itself is drawn once for each survey and size. */
function drawPad() {
  const ratio = window.devicePixelRatio || 1;
  const size = pad.clientWidth;
  const context = pad.getContext("2d");
  if (inputSurvey.drawnMap?.size !== size) inputSurvey.drawnMap = {size, image: drawMap(size, ratio)};
  if (pad.width !== Math.round(size * ratio)) Object.assign(pad, {width: size * ratio, height: size * ratio});
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, size, size);
  context.drawImage(inputSurvey.drawnMap.image, 0, 0, size, size);
  context.beginPath();
  context.arc(toMapPixel(0, state.q[0], size), toMapPixel(1, state.q[1], size), MAP_POINT_RADIUS_PX, 0, 2 * Math.PI);
  context.fillStyle = modes[state.mode].results ? themeColour("--ink") : themeColour("--warn");
  context.fill();
  context.strokeStyle = themeColour("--card");
  context.stroke();
}

/**
 * Returns a canvas with the cells in which the mode closes, all curves, and the ranges of the inputs.
 * @param size - Side of the map in pixels of the page.
 * @param ratio - Pixels of the screen in one of the page.
 */
function drawMap(size, ratio) {
  const map = makeElement("canvas", {width: size * ratio, height: size * ratio});
  const context = map.getContext("2d");
  const toPixels = ({q}) => [toMapPixel(0, q[0], size), toMapPixel(1, q[1], size)];
  context.scale(ratio, ratio);
  context.fillStyle = mixWithGrey(isDark() ? "#6cb6ff" : "#0b63b0", isDark() ? 24 : 255, 0.76);
  context.beginPath();
  for (const outline of inputSurvey.cells) tracePolygon(context, outline.map(toPixels));
  context.fill();
  context.strokeStyle = themeColour("--rule");
  const side = size - 2 * MAP_MARGIN_PX;
  context.strokeRect(MAP_MARGIN_PX, MAP_MARGIN_PX, side, side);
  for (const {tint, segments} of inputSurvey.curves) {
    context.strokeStyle = themeColour(tint);
    context.lineWidth = 2;
    context.beginPath();
    for (const [start, end] of segments) {
      context.moveTo(...toPixels(start));
      context.lineTo(...toPixels(end));
    }
    context.stroke();
  }
  context.fillStyle = themeColour("--soft");
  context.font = "11px system-ui, sans-serif";
  context.textAlign = "center";
  const rangeText = ({pair, from, to}) => `input ${pair}: ${formatNumber(from / UNIT, false)} to ${formatNumber(to / UNIT, false)}${SIGN === "°" ? "" : " "}${SIGN}`;
  context.fillText(rangeText(inputs[0]), size / 2, size - 6);
  context.translate(11, size / 2);
  context.rotate(-Math.PI / 2);
  context.fillText(rangeText(inputs[1]), 0, 0);
  return map;
}

/** Returns the pixel of an input (0, to the right; 1, upwards) on a map of some size. */
function toMapPixel(k, value, size) {
  const {from, to} = inputs[k];
  const part = (value - from) / (to - from);
  return MAP_MARGIN_PX + (k ? 1 - part : part) * (size - 2 * MAP_MARGIN_PX);
}

/** Moves both inputs to where a pointer is on the map. */
function moveInputsTo(event) {
  const box = pad.getBoundingClientRect();
  const side = box.width - 2 * MAP_MARGIN_PX;
  const right = (event.clientX - box.left - MAP_MARGIN_PX) / side;
  const up = 1 - (event.clientY - box.top - MAP_MARGIN_PX) / side;
  [right, up].forEach((part, k) => {
    const {from, to} = inputs[k];
    setInput(k, from + clamp(part, 0, 1) * (to - from));
  });
}

pad.onpointerdown = event => {
  pad.setPointerCapture(event.pointerId);
  pause();
  moveInputsTo(event);
};
pad.onpointermove = event => {
  if (pad.hasPointerCapture(event.pointerId)) moveInputsTo(event);
};
pad.onkeydown = event => {
  const inputAndDirection = {ArrowLeft: [0, -1], ArrowRight: [0, 1], ArrowDown: [1, -1], ArrowUp: [1, 1]};
  if (!inputAndDirection[event.key]) return;
  event.preventDefault();
  const [k, direction] = inputAndDirection[event.key];
  nudge(k, direction * (event.shiftKey ? FAST_STEPS : 1));
};
