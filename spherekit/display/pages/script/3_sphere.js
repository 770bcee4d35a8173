// The sphere: points on the unit sphere, seen from far away, and how lines, discs and labels are
// drawn on it. The hemisphere that faces away is faint.
//
// Directions are unit vectors [x, y, z] in the ground frame. A point on the canvas is [x, y, depth]:
// pixels from the left and the top, and the component towards the eye (1 in front, -1 behind).

const CHORD_RAD = 0.09;                    // longest chord of a drawn arc; it is off the arc by a third of a pixel
const LEAST_ARC_RAD = 1e-6;                // shorter arcs have no direction and are not drawn
const SPHERE_RADIUS = 0.44;                // part of the shorter side of the canvas, at zoom 1
const PARALLEL_TO_Z = 0.8;                 // z component from which a direction counts as near the z axis
const FAINT = 0.22;                        // opacity of lines behind the sphere, unless they have their own
const GRATICULE_STEP_DEG = 30;
const LABEL_DISTANCES_PX = [14, 24];       // from a point to the middle of its label
const LABEL_TURNS = [0, 1, -1, 2, -2, 3, -3, 4];  // eighths of a turn away from the outward direction, nearest first
const LABEL_MARGIN_PX = 2;
const HALF_LABEL_HEIGHT_PX = 7;
const FAINT_LABEL_DEPTH = -0.05;           // labels of points behind this depth are faint

const canvas = document.getElementById("sphere");
const pen = canvas.getContext("2d");

// The orthographic projection: centre and radius of the sphere in pixels, and the directions that
// point right, up and towards the eye.
const projection = {x: 0, y: 0, radius: 1, right: [0, 1, 0], up: [0, 0, 1], eye: [1, 0, 0]};

// Vectors

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const scale = (a, factor) => [a[0] * factor, a[1] * factor, a[2] * factor];
const add = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];

/** Returns the unit vector along a vector; the zero vector stays as it is. */
const normalize = a => scale(a, 1 / (Math.hypot(...a) || 1));

/** Returns a vector turned by a rotation matrix, which is given as nine entries row by row. */
const rotate = (matrix, a) => [dot(matrix.slice(0, 3), a), dot(matrix.slice(3, 6), a), dot(matrix.slice(6, 9), a)];

/** Returns the part of a vector that is perpendicular to a unit vector. */
const rejectFrom = (axis, a) => add(a, scale(axis, -dot(a, axis)));

/** Returns some direction perpendicular to a. It is made with the x axis if a is near the z axis. */
const perpendicularTo = a => normalize(cross(a, Math.abs(a[2]) < PARALLEL_TO_Z ? [0, 0, 1] : [1, 0, 0]));

// Arcs and circles as points

/** Returns the longest chord (rad) for the zoom: its distance from the arc grows with its square. */
const chordLength = () => CHORD_RAD / Math.sqrt(state.zoom);

/**
 * Returns points along the shorter great-circle arc from a to b.
 * @param a, b - Directions.
 * @param step - Largest angle (rad) between neighbouring points.
 * @returns Directions from a to b; none if the arc has no direction.
 */
function arcPoints(a, b, step = chordLength()) {
  const angle = Math.atan2(Math.hypot(...cross(a, b)), dot(a, b));
  if (!(angle > LEAST_ARC_RAD)) return [];
  const tangent = normalize(rejectFrom(a, b));
  const count = Math.ceil(angle / step) + 1;
  return Array.from({length: count}, (_, k) => {
    const t = (angle * k) / (count - 1);
    return add(scale(a, Math.cos(t)), scale(tangent, Math.sin(t)));
  });
}

/**
 * Returns points of a circle on the sphere.
 * @param centre - Direction of its axis.
 * @param radius - Angle (rad) from the axis to its points.
 * @param from, to - Angles (rad) about the axis of the first and the last point, from `start` on.
 * @param start - Direction on whose side of the axis the angle is zero; null for any.
 */
function circlePoints(centre, radius, from = 0, to = 2 * Math.PI, start = null) {
  const firstAxis = start ? normalize(rejectFrom(centre, start)) : perpendicularTo(centre);
  const secondAxis = cross(centre, firstAxis);
  const count = Math.max(2, Math.ceil(Math.abs(to - from) / chordLength()) + 1);
  return Array.from({length: count}, (_, k) => {
    const t = from + ((to - from) * k) / (count - 1);
    const outward = add(scale(firstAxis, Math.cos(t)), scale(secondAxis, Math.sin(t)));
    return add(scale(centre, Math.cos(radius)), scale(outward, Math.sin(radius)));
  });
}

/** Returns the point of a circle at an angle (rad) about its axis, counted from `start`. */
const circlePoint = (centre, radius, angle, start) => circlePoints(centre, radius, angle, angle, start)[0];

// The view

const canvasSize = {width: 0, height: 0};  // in pixels of the page
new ResizeObserver(([{contentRect}]) => {
  canvasSize.width = contentRect.width;
  canvasSize.height = contentRect.height;
  change("view");
}).observe(canvas);

/** Fits the canvas to its place on the page, clears it, and computes the projection of the state. */
function updateProjection() {
  const {width, height} = canvasSize;
  const ratio = window.devicePixelRatio || 1;
  const pixelWidth = Math.round(width * ratio);
  const pixelHeight = Math.round(height * ratio);
  // Setting a size clears the canvas and costs time, even if the size is the same.
  if (canvas.width !== pixelWidth || canvas.height !== pixelHeight) Object.assign(canvas, {width: pixelWidth, height: pixelHeight});
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, width, height);

  const sinYaw = Math.sin(state.yaw);
  const cosYaw = Math.cos(state.yaw);
  const sinPitch = Math.sin(state.pitch);
  const cosPitch = Math.cos(state.pitch);
  projection.x = width / 2;
  projection.y = height / 2;
  projection.radius = SPHERE_RADIUS * Math.min(width, height) * state.zoom;
  projection.right = [-sinYaw, cosYaw, 0];
  projection.up = [-sinPitch * cosYaw, -sinPitch * sinYaw, cosPitch];
  projection.eye = [cosPitch * cosYaw, cosPitch * sinYaw, sinPitch];
}

/** Returns the point [x, y, depth] of the canvas at which a direction is seen. */
function projectPoint(point) {
  return [
    projection.x + projection.radius * dot(point, projection.right),
    projection.y - projection.radius * dot(point, projection.up),
    dot(point, projection.eye),
  ];
}

/**
 * Returns the direction that is seen at a pixel of the canvas.
 * @param x, y - Pixels from the left and the top; beyond the rim, the nearest point of the rim is taken.
 * @param isBehind - Whether the point on the hemisphere behind is meant.
 */
function unprojectPixel(x, y, isBehind) {
  const right = (x - projection.x) / projection.radius;
  const up = (projection.y - y) / projection.radius;
  const depthSquare = 1 - right * right - up * up;
  const depth = depthSquare > 0 ? Math.sqrt(depthSquare) * (isBehind ? -1 : 1) : 0;
  const inPlane = add(scale(projection.right, right), scale(projection.up, up));
  return normalize(add(inPlane, scale(projection.eye, depth)));
}

// Lines are collected first. They are then drawn behind the sphere, and again in front of it.

let sphereLines = [];

/**
 * Adds a line to those that are drawn. Lines without a position are left out.
 * @param points - Directions along the line.
 * @param tint - Colour of the line.
 * @param width - Width in pixels.
 * @param options - `dash` (pixels), `fill` (colour of the area; no line is drawn), `alpha` (opacity) and
 *   `faint` (factor of the opacity behind the sphere).
 */
function addLine(points, tint, width = 1, options = {}) {
  if (points.length > 1 && Number.isFinite(points[0][0]))
    sphereLines.push({points: points.map(projectPoint), tint, width, ...options});
}

/** Draws the parts of all collected lines on the front hemisphere, or on the one behind. */
function drawLines(isFront) {
  for (const sphereLine of sphereLines) {
    const {faint = FAINT, alpha = 1} = sphereLine;
    pen.globalAlpha = alpha * (isFront ? 1 : faint);
    if (sphereLine.fill) fillLine(sphereLine, isFront);
    else strokeLine(sphereLine, isFront);
  }
  pen.globalAlpha = 1;
  pen.setLineDash([]);
}

/** Fills an area. One across the rim of the sphere is not filled, as its parts would have to be cut. */
function fillLine({points, fill}, isFront) {
  const isInHemisphere = isFront ? points.every(([, , depth]) => depth > 0) : !points.some(([, , depth]) => depth > 0);
  if (!isInHemisphere) return;
  pen.fillStyle = fill;
  pen.beginPath();
  points.forEach(([x, y]) => pen.lineTo(x, y));
  pen.fill();
}

/** Draws the chords of a line whose middle is in one hemisphere, without those that have no position. */
function strokeLine({points, tint, width, dash}, isFront) {
  pen.strokeStyle = tint;
  pen.lineWidth = width;
  pen.setLineDash(dash ?? []);
  pen.beginPath();
  let isPenDown = false;
  for (let k = 1; k < points.length; k++) {
    const [startX, startY, startDepth] = points[k - 1];
    const [endX, endY, endDepth] = points[k];
    const isInHemisphere = startDepth + endDepth >= 0 === isFront;
    if (!isInHemisphere || !Number.isFinite(startX + endX)) {
      isPenDown = false;
      continue;
    }
    if (!isPenDown) pen.moveTo(startX, startY);
    pen.lineTo(endX, endY);
    isPenDown = true;
  }
  pen.stroke();
}

/** Draws the sphere itself as a translucent ball, lit from the upper left. */
function drawBall() {
  const {x, y, radius} = projection;
  const shade = pen.createRadialGradient(x - radius / 3, y - radius / 3, radius / 8, x, y, radius);
  const [light, rim] = isDark() ? ["#3c466455", "#1c213299"] : ["#ffffffa0", "#cfd6e4a0"];
  shade.addColorStop(0, light);
  shade.addColorStop(1, rim);
  pen.fillStyle = shade;
  pen.strokeStyle = themeColour("--rule");
  pen.lineWidth = 1.2;
  pen.beginPath();
  pen.arc(x, y, radius, 0, 2 * Math.PI);
  pen.fill();
  pen.stroke();
}

/** Adds meridians and parallels of the ground frame, as thin lines. */
function addGraticule() {
  const tint = isDark() ? "#3e445a" : "#c3cad8";
  const options = {faint: 0.5};
  for (let east = 0; east < 180; east += GRATICULE_STEP_DEG) {
    const pole = [Math.cos(east * DEG), Math.sin(east * DEG), 0];
    addLine(circlePoints(pole, Math.PI / 2), tint, 0.7, options);
  }
  for (let north = -60; north < 90; north += GRATICULE_STEP_DEG)
    addLine(circlePoints([0, 0, 1], (90 - north) * DEG), tint, 0.7, options);
}

// Labels are collected first. They are then placed where they cover no disc and no other label.

let labels = [];
let occupiedBoxes = [];                    // {x, y, halfWidth, halfHeight} in pixels, of discs and placed labels

/** Adds the label of a direction; `options` may have `bold`. */
function addLabel(point, text, tint, options = {}) {
  const [x, y, depth] = projectPoint(point);
  if (Number.isFinite(x)) labels.push({x, y, depth, text, tint, ...options});
}

/** Draws all labels, those of the nearest points first, as later ones have to avoid them. */
function drawLabels() {
  labels.sort((a, b) => b.depth - a.depth);
  pen.textAlign = "center";
  pen.textBaseline = "middle";
  for (const label of labels) {
    pen.font = `${label.bold ? "700 13px" : "600 12px"} system-ui, sans-serif`;
    const halfWidth = pen.measureText(label.text).width / 2 + LABEL_MARGIN_PX;
    const [x, y] = findLabelPlace(label, halfWidth);
    occupiedBoxes.push({x, y, halfWidth, halfHeight: HALF_LABEL_HEIGHT_PX});
    pen.globalAlpha = label.depth < FAINT_LABEL_DEPTH ? 0.35 : 1;
    pen.lineWidth = 3.5;
    pen.lineJoin = "round";
    pen.strokeStyle = themeColour("--halo");
    pen.strokeText(label.text, x, y);
    pen.fillStyle = label.tint;
    pen.fillText(label.text, x, y);
  }
  pen.globalAlpha = 1;
}

/**
 * Returns the middle [x, y] of a label in pixels. Places around the point are tried, away from the
 * middle of the sphere first. If all of them are occupied, the first one is taken.
 */
function findLabelPlace({x, y}, halfWidth) {
  const outwardAngle = Math.atan2(y - projection.y, x - projection.x);
  const candidates = [];
  for (const turn of LABEL_TURNS)
    for (const distance of LABEL_DISTANCES_PX) {
      const angle = outwardAngle + (turn * Math.PI) / 4;
      // A label is wide, so beside the point its middle is farther away.
      const reach = distance + halfWidth * Math.abs(Math.cos(angle));
      const middleX = x + reach * Math.cos(angle);
      candidates.push([clamp(middleX, halfWidth, canvasSize.width - halfWidth), y + distance * Math.sin(angle)]);
    }
  const isFree = ([middleX, middleY]) => occupiedBoxes.every(box =>
    Math.abs(box.x - middleX) > box.halfWidth + halfWidth
    || Math.abs(box.y - middleY) > box.halfHeight + HALF_LABEL_HEIGHT_PX);
  return candidates.find(isFree) ?? candidates[0];
}

/**
 * Draws a disc, or a square on its corner, at a direction. Discs behind the sphere are faint.
 * @param point - Direction.
 * @param radius - Radius, or half a diagonal, in pixels.
 * @param fill, edge - Colours.
 * @param options - `ring` (radius in pixels of a circle around it, 0 for none), `square`, and `width` of the edge.
 */
function drawDisc(point, radius, fill, edge, {ring = 0, square = false, width = 2} = {}) {
  const [x, y, depth] = projectPoint(point);
  if (!Number.isFinite(x)) return;
  occupiedBoxes.push({x, y, halfWidth: radius, halfHeight: radius});
  pen.globalAlpha = depth < 0 ? 0.3 : 1;
  pen.beginPath();
  if (square) {
    pen.moveTo(x, y - radius);
    pen.lineTo(x + radius, y);
    pen.lineTo(x, y + radius);
    pen.lineTo(x - radius, y);
    pen.closePath();
  } else {
    pen.arc(x, y, radius, 0, 2 * Math.PI);
  }
  pen.fillStyle = fill;
  pen.fill();
  pen.strokeStyle = edge;
  pen.lineWidth = width;
  pen.stroke();
  if (ring) {
    pen.beginPath();
    pen.arc(x, y, ring, 0, 2 * Math.PI);
    pen.lineWidth = 1.5;
    pen.strokeStyle = themeColour("--accent");
    pen.stroke();
  }
  pen.globalAlpha = 1;
}
