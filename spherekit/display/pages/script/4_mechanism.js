// The mechanism on the sphere: links as arcs between their pairs, wheels and cams, knobs of inputs.
//
// `row` are the results of the picture kernel for one configuration. Directions are in the ground
// frame unless link axes are named.

const LINK_COLOURS = ["#b0b6c4", "#56b4e9", "#ee6c34", "#20be8e", "#de88bc", "#6884f5", "#c0ce5c", "#96e4f4", "#bc845c"];
const SIDE_STEP_RAD = 0.05;                // between points of a side of a link
const EQUAL_CORNERS = 1 - 1e-8;            // cosine above which corners of two modes are drawn as one: 1.4e-4 rad
const DISTINCT_AXES = 1e-6;                // sine of the angle between axes; nearer ones are one corner
const ON_AXIS = 0.9999;                    // cosine; no arm is drawn from an axis to a centre that is nearer
const KNOB_ON_AXIS = 0.995;                // cosine; a knob nearer to its axis (0.1 rad) could not be dragged
const KNOB_ANGLE_RAD = 0.5;                // from the axis to a knob on a link without other points
const SPOKE_COUNT = 6;
const HATCH_RAD = 0.045;                   // length of the hatching of the ground
const TICK_RAD = 0.05;                     // half the length of a mark across a track
const FIRST_PARTS = [1 / 6, 0.5, 0.3, 0.7, 0.1, 0.9, 0, 1];  // of the range of the input, tried for the first configuration
const STEEP = 0.2;                         // horizontal part of the mean axis; the yaw is arbitrary if it is less
const STEEP_YAW_RAD = 0.5;                 // yaw of the first view in that case
const FIRST_YAW_RAD = -0.24;               // of the first view, from the mean axis
const FIRST_PITCH_RAD = 0.17;
const MAX_FIRST_PITCH_RAD = 1.2;
const IDENTITY = [1, 0, 0, 0, 1, 0, 0, 0, 1];
const XYZ = ["x", "y", "z"];

// Colours

const isDark = () => document.documentElement.dataset.theme === "dark";
const style = getComputedStyle(document.documentElement);
const palette = new Map();                 // colours by their names in the style sheet, until the theme changes

/** Returns a colour of the style sheet by its name, such as "--rule". */
function themeColour(key) {
  if (!palette.has(key)) palette.set(key, style.getPropertyValue(key).trim());
  return palette.get(key);
}

/** Returns a colour #rrggbb mixed with grey: `part` (0 to 1) of the grey `level` (0 to 255). */
function mixWithGrey(hex, level, part) {
  const channels = [1, 3, 5].map(k => {
    const channel = parseInt(hex.slice(k, k + 2), 16);
    return Math.round(channel * (1 - part) + level * part);
  });
  return `#${channels.map(channel => channel.toString(16).padStart(2, "0")).join("")}`;
}

/** Returns the colour of a link by its number. The ground (0) has the first colour alone. */
function linkColour(number) {
  const tint = number ? LINK_COLOURS[1 + ((number - 1) % (LINK_COLOURS.length - 1))] : LINK_COLOURS[0];
  return isDark() ? tint : mixWithGrey(tint, 0, 0.24);
}

// Directions and orientations in a row

const linkNumber = new Map(model.links.map((link, number) => [link.name, number]));
const isGround = link => !linkNumber.get(link);

/** Returns the vector whose components are the results `stem`_x, _y and _z, each with the suffix. */
const readVector = (row, stem, suffix = "") => XYZ.map(letter => row[picture.place.get(`${stem}_${letter}${suffix}`)]);
const pairAxis = (row, pair) => readVector(row, `axis_${pair}`);

/** Returns the rotation matrix, row by row, from link axes to the ground frame. */
function linkOrientation(row, link) {
  if (isGround(link)) return IDENTITY;
  const entries = XYZ.flatMap(groundAxis => XYZ.map(linkAxis => groundAxis + linkAxis));
  return entries.map(entry => row[picture.place.get(`orientation_${link}_${entry}`)]);
}

// Links as arcs and areas

/**
 * Returns the shape of a link: the distinct axes of its pairs in convex order (`corners`), and the
 * arcs between neighbours as lists of points (`arcs`).
 */
function linkShape(row, link) {
  const corners = sortAroundMiddle(distinctDirections(link.pairs.map(pair => pairAxis(row, pair))));
  const sides = [];
  // Two corners have one side; more of them are a closed polygon.
  const sideCount = corners.length < 3 ? corners.length - 1 : corners.length;
  for (let k = 0; k < sideCount; k++) sides.push(arcPoints(corners[k], corners[(k + 1) % corners.length], SIDE_STEP_RAD));
  return {corners, arcs: sides.filter(points => points.length)};
}

/** Returns directions without those that are equal to an earlier one. Opposite ones are distinct. */
function distinctDirections(directions) {
  const isDistinct = (a, b) => Math.hypot(...cross(a, b)) > DISTINCT_AXES || dot(a, b) < 0;
  return directions.filter((a, k) => directions.slice(0, k).every(b => isDistinct(a, b)));
}

/** Sorts three or more directions in place by their angle about the middle of all of them. */
function sortAroundMiddle(directions) {
  if (directions.length < 3) return directions;
  const middle = normalize(directions.reduce(add));
  const firstAxis = perpendicularTo(middle);
  const secondAxis = cross(middle, firstAxis);
  const angle = a => Math.atan2(dot(a, secondAxis), dot(a, firstAxis));
  return directions.sort((a, b) => angle(a) - angle(b));
}

/** Adds the links of the other assembly modes as thin lines in the colours of the modes. */
function addOtherModes() {
  for (const link of model.links.slice(1)) {
    const earlierCorners = [];             // of this link in the modes before
    modes.forEach((mode, number) => {
      if (number === state.mode || !mode.pictureRow) return;
      const {corners, arcs} = linkShape(mode.pictureRow, link);
      // Where a link is the same in several modes, later ones are dashed so that all colours are seen.
      const equalCount = earlierCorners.filter(other => areSameCorners(other, corners)).length;
      const dash = equalCount ? [DASH_PX, DASH_PX * equalCount] : undefined;
      for (const points of arcs) addLine(points, modeColour(number), 1.8, {dash});
      earlierCorners.push(corners);
    });
  }
}

const areSameCorners = (some, others) => some.length === others.length && some.every((a, k) => dot(a, others[k]) > EQUAL_CORNERS);

/** Adds all links of the chosen mode, with their names and profiles. */
function addLinks(row) {
  model.links.forEach((link, number) => {
    const tint = linkColour(number);
    const {corners, arcs} = linkShape(row, link);
    if (corners.length > 2) addLine(arcs.flat(), tint, 0, {fill: tint, alpha: 0.16, faint: 0.3});
    for (const points of arcs) {
      addLine(points, tint, number ? 5 : 4);
      if (!number) addHatching(points, corners, tint);
    }
    const longest = arcs.reduce((best, points) => (points.length > best.length ? points : best), []);
    if (longest.length) addLabel(longest[longest.length >> 1], link.name, tint, {bold: true});
    for (const profile of link.profiles) addProfile(row, link, profile, tint);
    if (!longest.length && link.profiles.length) {
      const profilePoint = rotate(linkOrientation(row, link.name), link.profiles[0].curve[0]);
      addLabel(profilePoint, link.name, tint, {bold: true});
    }
  });
}

/** Adds the hatching of the ground along one of its sides, outside the area of its corners. */
function addHatching(points, corners, tint) {
  const middle = normalize(corners.reduce(add));
  for (let k = 1; k < points.length; k++) {
    const point = points[k];
    const along = normalize(add(point, scale(points[k - 1], -1)));
    let outward = cross(along, point);
    if (corners.length > 2 && dot(outward, middle) > 0) outward = scale(outward, -1);
    const slope = add(scale(outward, 0.8), scale(along, -0.6));
    addLine([point, normalize(add(point, scale(slope, HATCH_RAD)))], tint, 1.2);
  }
}

/**
 * Adds a contact profile of a link. A profile that rolls is drawn as a wheel through the point of
 * contact. An arm joins the centre with the axis of the first pair of the link.
 */
function addProfile(row, link, profile, tint) {
  const orientation = linkOrientation(row, link.name);
  const width = isGround(link.name) ? 2.5 : 3;
  const centre = profile.centre && rotate(orientation, profile.centre);
  const contact = profile.rolls && centre ? rollingContact(row, profile.pair) : null;
  if (contact) {
    addWheel(link, profile, orientation, {centre, contact, tint, width});
  } else {
    const points = profile.curve.map(point => rotate(orientation, point));
    addLine(points, tint, 0, {fill: tint, alpha: 0.14, faint: 0.3});
    addLine(points, tint, width);
  }
  if (!link.pairs.length || !centre) return;
  const axis = pairAxis(row, link.pairs[0]);
  if (Math.abs(dot(axis, centre)) < ON_AXIS) addLine(arcPoints(axis, centre), tint, width + 1);
}

/** Adds a circle about the centre of a wheel through its contact, with spokes unless it is fixed. */
function addWheel(link, {radius, curve}, orientation, {centre, contact, tint, width}) {
  // A pole axis has two ends. The contact is the end on the side of the circle.
  const isNearEnd = dot(contact, centre) * Math.cos(radius) >= 0;
  const rimPoint = isNearEnd ? contact : scale(contact, -1);
  const drawnRadius = Math.acos(clamp(dot(rimPoint, centre), -1, 1));
  addLine(circlePoints(centre, drawnRadius), tint, width);
  if (isGround(link.name)) return;
  for (let k = 0; k < SPOKE_COUNT; k++) {
    const spokeEnd = rotate(orientation, curve[Math.round((k * (curve.length - 1)) / SPOKE_COUNT)]);
    addLine(arcPoints(centre, spokeEnd), tint, 1.2, {alpha: k ? 0.5 : 1});  // the first one is stronger
  }
}

/** Returns the contact of two rolling wheels, which is the pole of their links; null if that is unknown. */
function rollingContact(row, pairName) {
  const {links} = model.pairs.find(pair => pair.name === pairName);
  const [larger, smaller] = [...links].sort((a, b) => linkNumber.get(b) - linkNumber.get(a));
  const contact = readVector(row, `pole_${larger}_${smaller}`, model.plans[0].end);
  return Number.isFinite(contact[0]) ? contact : null;
}

/** Draws discs with names at the axes of pairs, and squares at the output directions. */
function drawPairs(row) {
  for (const {name, axis: hasAxis, links} of model.pairs) {
    if (!hasAxis) continue;
    const axis = pairAxis(row, name);
    const tint = linkColour(Math.max(...links.map(link => linkNumber.get(link))));
    if (links.some(isGround)) drawDisc(axis, 5.5, themeColour("--card"), themeColour("--ink"));
    else drawDisc(axis, 5.5, tint, themeColour("--card"));
    addLabel(axis, name, themeColour("--soft"));
  }
  for (const {link, direction} of model.outputs) {
    if (!direction) continue;
    drawDisc(rotate(linkOrientation(row, link), direction), 7, themeColour("--gold"), themeColour("--card"), {square: true});
  }
}

/** Returns the mean direction of all axes, about which most of the mechanism is. */
function meanAxis(row) {
  const axes = model.pairs.filter(pair => pair.axis).map(pair => pairAxis(row, pair.name));
  return normalize(axes.reduce(add, [0, 0, 0]));
}

// The knob of an input is on the link that it drives. Its track shows where the mode closes.

// {q, row}: the inputs (rad) and picture of the drawn configuration; null if nothing is drawn. Where
// the assembly is lost, this is the nearest configuration of the mode instead.
let drawnConfiguration = null;

/**
 * Returns where the knob of an input is drawn.
 * @param k - Index of the input.
 * @returns {axis, knob, sense, isFixed} - Directions of the axis and the knob, the sense (1 or -1) in
 *   which the knob turns about the axis as the input grows, and whether the axis is on the ground.
 */
function knobGeometry(k) {
  const {row, q} = drawnConfiguration;
  const {links, pair} = inputs[k];
  const drivenName = isGround(links[1]) ? links[0] : links[1];
  const link = model.links[linkNumber.get(drivenName)];
  const orientation = linkOrientation(row, drivenName);
  const axis = pairAxis(row, pair);
  const isOffAxis = point => Math.abs(dot(point, axis)) < KNOB_ON_AXIS;
  // A knob is on another pair of the link, else on the centre of a profile, else beside the axis.
  const centres = link.profiles.filter(({centre}) => centre).map(({centre}) => rotate(orientation, centre));
  const linkPoint = link.pairs.map(name => pairAxis(row, name)).find(isOffAxis)
    ?? centres.find(isOffAxis)
    ?? rotate(orientation, pointBesideAxis(inputs[k].axes[drivenName]));
  // The knob is drawn at the input itself, even if the drawn configuration is at another input.
  const sense = drivenName === links[1] ? 1 : -1;
  const angle = sense * (state.q[k] - q[k]);
  const knob = angle ? circlePoint(axis, angleBetween(axis, linkPoint), angle, linkPoint) : linkPoint;
  return {axis, knob, sense, isFixed: links.some(isGround)};
}

const angleBetween = (a, b) => Math.acos(clamp(dot(a, b), -1, 1));

/** Returns a direction at some distance from an axis; both are in link axes. */
function pointBesideAxis(axis) {
  return add(scale(axis, Math.cos(KNOB_ANGLE_RAD)), scale(perpendicularTo(axis), Math.sin(KNOB_ANGLE_RAD)));
}

/**
 * Adds the track of the knob of an input with a fixed axis, over the range of the input. If curves
 * are drawn over this input, the track also shows where the chosen mode closes, and its marks.
 */
function addTrack(k) {
  const {axis, knob, sense, isFixed} = knobGeometry(k);
  if (!isFixed) return;
  const {from, to} = inputs[k];
  const radius = angleBetween(axis, knob);
  const turnTo = x => sense * (x - state.q[k]);  // from the knob to where it is at an input (rad)
  const addPart = (start, end, tint, {width = 1.6, ...options}) =>
    addLine(circlePoints(axis, radius, turnTo(start), turnTo(end), knob), tint, width, options);
  const {curve} = modes[state.mode];
  if (!curve || curve.over !== k) {
    addPart(from, to, themeColour("--soft"), {alpha: 0.7});
    return;
  }
  for (let n = 1; n < curve.x.length; n++) {
    if (curve.values[n] && curve.values[n - 1]) addPart(curve.x[n - 1], curve.x[n], themeColour("--soft"), {alpha: 0.8});
    else addPart(curve.x[n - 1], curve.x[n], themeColour("--warn"), {dash: [3, 3]});
  }
  for (const range of curve.beyond) addPart(range.from, range.to, themeColour("--limit"), {width: 3});
  const addMark = (x, tint, width) => addTick(circlePoint(axis, radius, turnTo(x), knob), axis, tint, width);
  for (const x of curve.ends) addMark(x, themeColour("--warn"), 3);
  for (const x of curve.meets) addMark(x, themeColour("--fold"), 2.5);
  for (const x of curve.rests) addMark(x, themeColour("--gold"), 2.5);
}

/** Adds a short line across a circle about an axis, at one of its points. */
function addTick(point, axis, tint, width) {
  const outward = scale(normalize(rejectFrom(point, axis)), TICK_RAD);
  addLine([normalize(add(point, outward)), normalize(add(point, scale(outward, -1)))], tint, width);
}

/** Adds the paths of the outputs along the curve of the chosen mode, one dotted line for each range. */
function addPaths() {
  const {curve} = modes[state.mode];
  if (!curve) return;
  for (const {stem, link} of model.paths) {
    const columns = XYZ.map(letter => rows.place.get(`${stem}_${letter}`));
    const tint = linkColour(linkNumber.get(link));
    const addRun = run => addLine(run, tint, 1.6, {alpha: 0.75, dash: [1, 3]});
    let run = [];
    for (const row of curve.values) {
      const point = row ? columns.map(column => row[column]) : [NaN, NaN, NaN];
      if (Number.isFinite(point[0])) {
        run.push(point);
      } else {
        addRun(run);
        run = [];
      }
    }
    addRun(run);
  }
}

// The first configuration is a sixth of the way along the range, or where mode 0 closes. The first
// view is from a little beside the mean axis.

for (const part of FIRST_PARTS) {
  // The first inputs are whole tenths of the unit of the file.
  first.q = inputs.map(({from, to}) => Math.round((from + part * (to - from)) / UNIT * 10) / 10 * UNIT);
  const kernelSizes = toKernelSizes(first.sizes);
  const configuration = modes[0].state(first.q, kernelSizes);
  if (!configuration) continue;
  const [x, y, z] = meanAxis(evaluateKernel(picture, first.q, configuration.places, kernelSizes));
  first.yaw = Math.hypot(x, y) > STEEP ? Math.atan2(y, x) + FIRST_YAW_RAD : STEEP_YAW_RAD;
  first.pitch = clamp(Math.asin(clamp(z, -1, 1)) + FIRST_PITCH_RAD, -MAX_FIRST_PITCH_RAD, MAX_FIRST_PITCH_RAD);
  break;
}
