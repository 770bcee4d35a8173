// The mechanism on the sphere: links as arcs between their pairs, wheels and cams, knobs.

const LINKS = ["#b0b6c4", "#56b4e9", "#ee6c34", "#20be8e", "#de88bc", "#6884f5", "#c0ce5c", "#96e4f4", "#bc845c"];
const dark = () => document.documentElement.dataset.theme === "dark";
const style = getComputedStyle(document.documentElement);
const palette = new Map();                 // until the theme changes
function colour(key) {
  if (!palette.has(key)) palette.set(key, style.getPropertyValue(key).trim());
  return palette.get(key);
}

function mixed(hex, other, part) {
  const parts = [1, 3, 5].map(k => Math.round(parseInt(hex.slice(k, k + 2), 16) * (1 - part) + other * part));
  return `#${parts.map(x => x.toString(16).padStart(2, "0")).join("")}`;
}
const linkColour = k => {
  const tint = k ? LINKS[1 + ((k - 1) % (LINKS.length - 1))] : LINKS[0];
  return dark() ? tint : mixed(tint, 0, 0.24);
};

const linkNumber = new Map(model.links.map((link, k) => [link.name, k]));
const xyz = (row, stem, end = "") => ["x", "y", "z"].map(x => row[picture.place.get(`${stem}_${x}${end}`)]);
const axisOf = (row, pair) => xyz(row, `axis_${pair}`);

function frameOf(row, link) {
  const entries = ["x", "y", "z"].flatMap(x => ["x", "y", "z"].map(y => row[picture.place.get(`orientation_${link}_${x}${y}`)]));
  return linkNumber.get(link) ? entries : [1, 0, 0, 0, 1, 0, 0, 0, 1];
}

function sidesOf(row, link) {              // arcs between the axes of a link's pairs, in convex order
  const corners = convex(distinct(link.pairs.map(pair => axisOf(row, pair))));
  const sides = corners.length < 3 ? corners.slice(1).map((b, n) => [corners[n], b]) : corners.map((a, n) => [a, corners[(n + 1) % corners.length]]);
  return {corners, arcs: sides.map(([a, b]) => arc(a, b, 0.05)).filter(points => points.length)};
}

function drawOthers() {                    // the other assembly modes, thin, in their colours
  for (const link of model.links.slice(1)) {
    const drawnCorners = [];               // of this link in modes before
    modes.forEach((mode, n) => {
      if (n === state.mode || !mode.row) return;
      const {corners, arcs} = sidesOf(mode.row, link), before = drawnCorners.filter(other => samePlaces(other, corners)).length;
      const dash = before ? [DASH, DASH * before] : undefined;
      for (const points of arcs) line(points, modeColour(n), 1.8, {dash});
      drawnCorners.push(corners);
    });
  }
}

const samePlaces = (one, other) => one.length === other.length && one.every((a, k) => dot(a, other[k]) > 1 - 1e-8);

function drawLinks(row) {
  for (const [k, link] of model.links.entries()) {
    const tint = linkColour(k), {corners, arcs} = sidesOf(row, link);
    if (corners.length > 2) line(arcs.flat(), tint, 0, {fill: tint, alpha: 0.16, faint: 0.3});
    for (const points of arcs) {
      line(points, tint, k ? 5 : 4);
      if (!k) hatch(points, corners, tint);
    }
    const longest = arcs.reduce((best, x) => (x.length > best.length ? x : best), []);
    if (longest.length) name(longest[longest.length >> 1], link.name, tint, {bold: true});
    for (const profile of link.profiles) drawProfile(row, link, profile, tint, k);
    if (!longest.length && link.profiles.length) name(turned(frameOf(row, link.name), link.profiles[0].curve[0]), link.name, tint, {bold: true});
  }
}

function distinct(points) {
  return points.filter((a, k) => points.slice(0, k).every(b => Math.hypot(...cross(a, b)) > 1e-6 || dot(a, b) < 0));
}

function convex(points) {
  if (points.length < 3) return points;
  const middle = unitOf(points.reduce(plus)), one = beside(middle), other = cross(middle, one);
  return points.sort((a, b) => Math.atan2(dot(a, other), dot(a, one)) - Math.atan2(dot(b, other), dot(b, one)));
}

function hatch(points, corners, tint) {
  const middle = unitOf(corners.reduce(plus));
  for (let k = 1; k < points.length; k++) {
    const here = points[k], along = unitOf(plus(here, scaled(points[k - 1], -1)));
    let out = cross(along, here);
    const inside = dot(out, middle);
    if (corners.length > 2 && inside > 0) out = scaled(out, -1);
    line([here, unitOf(plus(here, scaled(plus(scaled(out, 0.8), scaled(along, -0.6)), 0.045)))], tint, 1.2);
  }
}

function drawProfile(row, link, profile, tint, k) {
  const frame = frameOf(row, link.name), width = k ? 3 : 2.5;
  const centre = profile.centre && turned(frame, profile.centre);
  const touching = profile.rolls && centre && touchOf(row, profile.pair);
  if (touching) {           // a wheel: about its centre, through the contact
    const near = dot(touching, centre) * Math.cos(profile.radius) >= 0 ? touching : scaled(touching, -1);
    const radius = Math.acos(clamp(dot(near, centre), -1, 1));
    line(circle(centre, radius), tint, width);
    for (let n = 0; k && n < 6; n++) {
      const spoke = turned(frame, profile.curve[Math.round((n * (profile.curve.length - 1)) / 6)]);
      line(arc(centre, spoke), tint, 1.2, {alpha: n ? 0.5 : 1});
    }
  } else {
    const points = profile.curve.map(point => turned(frame, point));
    line(points, tint, 0, {fill: tint, alpha: 0.14, faint: 0.3});
    line(points, tint, width);
  }
  const held = link.pairs.length && axisOf(row, link.pairs[0]);
  if (held && centre && Math.abs(dot(held, centre)) < 0.9999) line(arc(held, centre), tint, width + 1);
}

function touchOf(row, name) {              // of wheels, the pole of their links
  const pair = model.pairs.find(x => x.name === name), [a, b] = [...pair.links].sort((x, y) => linkNumber.get(y) - linkNumber.get(x));
  const touch = xyz(row, `pole_${a}_${b}`, model.plans[0].end);
  return Number.isFinite(touch[0]) ? touch : null;
}

function drawPairs(row) {
  for (const pair of model.pairs) {
    if (!pair.axis) continue;
    const axis = axisOf(row, pair.name), ground = pair.links.some(link => !linkNumber.get(link));
    const tint = linkColour(Math.max(...pair.links.map(link => linkNumber.get(link))));
    disc(axis, 5.5, ground ? colour("--card") : tint, ground ? colour("--ink") : colour("--card"));
    name(axis, pair.name, colour("--soft"));
  }
  for (const {link, direction} of model.outputs) {
    if (!direction) continue;
    disc(turned(frameOf(row, link), direction), 7, colour("--gold"), colour("--card"), {square: true});
  }
}

function middleOf(row) {                   // where most of the mechanism is
  const axes = model.pairs.filter(pair => pair.axis).map(pair => axisOf(row, pair.name));
  return unitOf(axes.reduce(plus, [0, 0, 0]));
}

// The knob of an input is on the link that it drives; its track shows where the mode closes.

let shown = null;                          // {q, row}: what is drawn; where the mode is lost, its end

function knobOf(k) {
  const {row, q} = shown, {links, pair} = inputs[k], driven = linkNumber.get(links[1]) ? links[1] : links[0];
  const link = model.links[linkNumber.get(driven)], axis = axisOf(row, pair);
  const apart = point => Math.abs(dot(point, axis)) < 0.995;
  const end = link.pairs.map(name => axisOf(row, name)).find(apart)
    ?? link.profiles.flatMap(x => (x.centre ? [turned(frameOf(row, driven), x.centre)] : [])).find(apart)
    ?? turned(frameOf(row, driven), aside(link, k));
  const sense = driven === links[1] ? 1 : -1, turn = sense * (state.q[k] - q[k]);
  const far = turn ? circle(axis, Math.acos(clamp(dot(axis, end), -1, 1)), turn, turn, end)[0] : end;
  return {axis, far, sense, fixed: links.some(name => !linkNumber.get(name))};
}

function aside(link, k) {                  // a place beside the axis, in link axes
  const axis = inputs[k].axes[link.name], out = beside(axis);
  return plus(scaled(axis, Math.cos(0.5)), scaled(out, Math.sin(0.5)));
}

function drawTrack(k) {
  const {axis, far, sense, fixed} = knobOf(k), {from, to} = inputs[k];
  if (!fixed) return;
  const radius = Math.acos(clamp(dot(axis, far), -1, 1)), turn = x => sense * (x - state.q[k]);
  const track = (a, b, tint, {width = 1.6, ...more}) => line(circle(axis, radius, turn(a), turn(b), far), tint, width, more);
  const curve = modes[state.mode].curve;
  if (!curve || curve.over !== k) return track(from, to, colour("--soft"), {alpha: 0.7});
  for (let n = 1; n < curve.x.length; n++) {
    const holds = curve.values[n] && curve.values[n - 1];
    track(curve.x[n - 1], curve.x[n], holds ? colour("--soft") : colour("--warn"), holds ? {alpha: 0.8} : {dash: [3, 3]});
  }
  for (const {from: a, to: b} of curve.beyond) track(a, b, colour("--limit"), {width: 3});
  const place = x => circle(axis, radius, turn(x), turn(x), far)[0];
  curve.ends.forEach(x => tick(place(x), axis, colour("--warn"), 3));
  curve.meets.forEach(x => tick(place(x), axis, colour("--fold"), 2.5));
  curve.rests.forEach(x => tick(place(x), axis, colour("--gold"), 2.5));
}

function tick(point, axis, tint, width) {
  const out = scaled(unitOf(plus(axis, scaled(point, -dot(axis, point)))), 0.05);
  line([unitOf(plus(point, out)), unitOf(plus(point, scaled(out, -1)))], tint, width);
}

function drawPaths() {
  const curve = modes[state.mode].curve;
  for (const {stem, link} of curve ? model.paths : []) {
    const place = ["x", "y", "z"].map(x => rows.place.get(`${stem}_${x}`));
    const points = curve.values.map(row => (row ? place.map(k => row[k]) : [NaN, NaN, NaN]));
    let run = [];
    for (const point of [...points, [NaN]]) {
      if (Number.isFinite(point[0])) run.push(point);
      else { line(run, linkColour(linkNumber.get(link)), 1.6, {alpha: 0.75, dash: [1, 3]}); run = []; }
    }
  }
}

// The first configuration and view: a sixth of the way, or where some mode closes.

for (const part of [1 / 6, 0.5, 0.3, 0.7, 0.1, 0.9, 0, 1]) {
  first.q = inputs.map(({from, to}) => Math.round((from + part * (to - from)) / UNIT * 10) / 10 * UNIT);
  const closed = modes[0].state(first.q, toKernelSizes(first.sizes));
  if (!closed) continue;
  const [x, y, z] = middleOf(evaluateKernel(picture, first.q, closed.places, toKernelSizes(first.sizes)));
  first.yaw = Math.hypot(x, y) > 0.2 ? Math.atan2(y, x) - 0.24 : 0.5;
  first.pitch = clamp(Math.asin(clamp(z, -1, 1)) + 0.17, -1.2, 1.2);
  break;
}
