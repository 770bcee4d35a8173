// Pictures: what has changed is computed again, once for each picture.

let playing = false, pending = 0, clock = 0, way = 1;
const TURN = 9;                            // seconds to play through the range
const system = matchMedia("(prefers-color-scheme: dark)");
const timing = {pictures: 0, busy: 0};
const NO_CURVE = {over: 0, x: [], values: [], ends: [], meets: [], rests: [], beyond: [], signs: [], largestSquares: []};

function wake() {
  pending ||= requestAnimationFrame(next);
}

function start() {
  playing = true;
  clock = performance.now();
  wake();
  showPlay();
}

function pause() {
  playing = false;
  showPlay();
}

function showPlay() {
  play.textContent = playing ? "❚❚" : "▶";
  play.setAttribute("aria-label", playing ? "Pause" : "Play");
}

function advance(now) {
  const k = state.over, {from, to} = inputs[k], span = to - from, whole = span > 2 * Math.PI - 1e-9;
  let q = state.q[k] + (way * span * Math.min(now - clock, 100)) / 1000 / TURN;
  clock = now;
  const turnsBack = x => !whole && (x > to || x < from);
  if (turnsBack(q) || (!whole && !modes[state.mode].state(state.q.with(k, clamp(q, from, to)), toKernelSizes(state.sizes)))) way = q > state.q[k] ? -1 : 1;
  if (whole && q > to) { q -= span; passTurn(1); }
  setInput(k, q);
}

function next(now) {
  pending = 0;
  if (playing) advance(now);
  const began = performance.now();
  renew();
  timing.pictures += 1;
  timing.busy += performance.now() - began;
  if (playing) wake();
}

const BUDGET = 9;                          // ms of a picture that curves of other modes may take

// Everything that changed is computed first, then written as fields and numbers, then drawn. An
// error in one part is shown to the reader and stops no other part.

const troubles = new Map();                // messages, by the part of the page that they are about

function attempt(part, action) {
  try { action(); troubles.delete(part); } catch (error) {
    if (!troubles.has(part)) console.error(error);
    troubles.set(part, error.message);
  }
}

function showTroubles() {
  const lines = [...troubles].map(([part, message]) => `${part} cannot be shown for these numbers (${message})`);
  element("trouble").textContent = lines.length ? `${lines.join("; ")}. Fields and numbers are those of this state.` : "";
}

function renew() {
  const began = performance.now();
  const does = (...names) => names.some(name => changed.has(name)), all = does("all");
  const now = toKernelSizes(state.sizes);
  if (all || does("theme")) showTheme();
  if (all || does("sizes") || (several && does("input"))) for (const mode of modes) mode.stale = true;
  const chosen = modes[state.mode], computed = modes.some(mode => mode.stale);
  const moves = all || computed || does("sizes", "input", "mode", "others");
  for (const mode of [chosen, ...modes])
    if (mode.stale && (mode === chosen || !mode.curve || performance.now() - began < BUDGET)) {
      attempt(`The curve of ${mode.name}`, () => { mode.curve = NO_CURVE; mode.curve = sampleCurve(mode, state.over, state.q, now); });
      mode.stale = false;
    }
  if (moves) for (const mode of modes) {
    Object.assign(mode, {here: null, row: null, isSingular: false});
    attempt(`The configuration of ${mode.name}`, () => locate(mode, now));
  }
  if (moves || does("theme")) { showControls(); showNumbers(); }
  const maps = several && (all || does("sizes", "mode", "theme", "reach") || inputs.length > 2);
  if (maps) attempt("The map of inputs", () => survey(chosen, now, does("reach")));
  attempt("The sphere", draw);
  if (all || computed || does("theme", "mode")) attempt("A curve", fillCurves);
  else if (does("input")) attempt("A curve", () => figures.forEach(x => x.plot?.redraw(false)));
  if (all || does("plan")) attempt("The Table", buildTable);
  if (all || does("plan", "step")) attempt("A step", showStep);
  if (several && pad.clientWidth && reach) attempt("The map of inputs", drawPad);
  showTroubles();
  changed.clear();
  clearTimeout(renew.later);
  if (!playing) renew.later = setTimeout(keepLink, 400);
  if (modes.some(mode => mode.stale)) wake();
}

function showNow() {                       // what waits for the next picture, at once
  if (!pending) return;
  cancelAnimationFrame(pending);
  next(performance.now());
}

function survey(mode, now, fine) {         // quick while changes follow each other, then fine
  const moves = !fine && performance.now() - survey.last < 400;
  reach = surveyed(mode, now, moves ? QUICK : FINE);
  survey.last = performance.now();
  clearTimeout(survey.later);
  if (moves) survey.later = setTimeout(() => change("reach"), 250);
}

function locate(mode, now) {               // where a mode is at the inputs, and what is drawn of it
  const closed = mode.state(state.q, now) ?? besideMeeting(mode, state.q, now);
  if (!closed) return;
  mode.isSingular = isSingular(mode, closed.row);
  const row = withTurns(mode, state.q, now, closed.row, mode.curve);
  mode.here = mode.isSingular ? row.map(() => NaN) : signedAt(mode, state.q, now, row);
  const drawn = state.others || modes[state.mode] === mode;
  mode.row = drawn ? evaluateKernel(picture, closed.q ?? state.q, closed.places, now) : null;
}

// Rates divide by the square of a dyad, or by the determinant of the loops. Near a dead centre,
// or where modes meet, rounding is a large part of these, and the page has no numbers.

const USABLE_SQUARE = 1e-10;               // part of the largest; rates are then right to 1e-6

function isSingular({curve}, row) {
  return closures.some((closure, k) => row[closure] < USABLE_SQUARE * curve.largestSquares[k]);
}

// Where modes meet, rounding decides whether a dyad in line closes. The links are drawn a little
// farther on.

const BESIDE_RAD = 3e-8;                   // links are then drawn within 1e-7 of their places

function besideMeeting(mode, q, sizes) {
  const {meets, over} = mode.curve;
  if (!meets.some(x => Math.abs(x - q[over]) < BESIDE_RAD)) return null;
  for (const aside of [BESIDE_RAD, -BESIDE_RAD]) {
    const beside = q.with(over, q[over] + aside), closed = mode.state(beside, sizes);
    if (closed) return {...closed, q: beside};
  }
  return null;
}

function ghost() {                         // where the chosen mode is lost: it closes there last
  const {curve} = modes[state.mode], now = toKernelSizes(state.sizes), at = state.q[curve.over];
  let nearest = null;
  curve.x.forEach((x, k) => {
    if (curve.values[k] && (nearest === null || Math.abs(x - at) < Math.abs(nearest - at))) nearest = x;
  });
  if (nearest === null) return null;
  const q = state.q.with(curve.over, nearest), closed = modes[state.mode].state(q, now);
  return closed && {q, row: evaluateKernel(picture, q, closed.places, now)};
}

function draw() {
  look();
  drawn = []; words = []; taken = [];
  graticule();
  strokes(false);
  drawn = [];
  drawReach();
  const {row} = modes[state.mode];
  shown = row ? {q: state.q, row} : ghost();
  let poles = [];
  if (shown) {
    drawPaths();
    inputs.forEach((input, k) => drawTrack(k));
    if (state.others) drawOthers();
    drawLinks(shown.row);
    if (row) poles = drawPoles(row);
  }
  if (!row) for (const one of drawn) one.alpha = 0.35 * (one.alpha ?? 1);
  strokes(false);
  ball();
  const front = drawn;
  drawn = [];
  graticule();
  strokes(true);
  drawn = front;
  strokes(true);
  if (!shown) return;
  drawPairs(shown.row);
  inputs.forEach((input, k) => disc(knobOf(k).far, 6.5, row ? colour("--accent") : colour("--warn"), colour("--card"), {ring: 12}));
  markPoles(poles);
  writeNames();
}

function showTheme() {
  const wanted = state.theme || (system.matches ? "dark" : "light");
  document.documentElement.dataset.theme = wanted;
  palette.clear();
  document.body.classList.toggle("alone", state.alone);
  element("theme").setAttribute("aria-pressed", wanted === "dark");
  element("reach").hidden = !several;
}

function keepLink() {
  const words = link(), now = location.hash.slice(1);
  if (words !== now) history.replaceState(null, "", words ? `#${words}` : location.pathname + location.search);
}

window.addEventListener("hashchange", () => { if (location.hash.slice(1) !== link()) followLink(); });
window.addEventListener("resize", () => { resizeCurves(); change("view"); });
system.addEventListener("change", () => change("theme"));
function knobPlace(k) {                    // in the window, for who drives this page by program
  const box = canvas.getBoundingClientRect(), [x, y] = seen(knobOf(k).far);
  return [box.left + x, box.top + y];
}

window.spherekit = {
  state, change, modes, timing, toml, link, knobPlace, figures, modeColour,
  resultNames: [...rows.place.keys()],
  modeNumbers: rows.about.modes.map(({number}) => number),
};
followLink();
