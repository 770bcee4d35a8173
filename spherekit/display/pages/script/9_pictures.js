// Pictures: whatever has changed is computed again, once for each picture.
//
// A mode has four parts that change: `isStale` (whether its curve has to be computed again), `curve`,
// `results` (the row at the inputs, null if the assembly is lost), and `pictureRow` (the row of the
// picture kernel, null if the mode is not drawn).

const PLAY_SECONDS = 9;                    // to play through the range of an input
const MAX_FRAME_MS = 100;                  // longer pauses between pictures count as this, so that the input does not jump
const CURVE_BUDGET_MS = 9;                 // of a picture that curves of other modes may take
const SURVEY_PAUSE_MS = 400;               // surveys that follow each other faster have fewer nodes
const FINE_SURVEY_DELAY_MS = 250;          // from the last quick survey to a fine one
const LINK_DELAY_MS = 400;                 // from the last change to the link that keeps it
const USABLE_SQUARE = 1e-10;               // part of the largest square of a dyad; rates are then right to 1e-6
const BESIDE_RAD = 3e-8;                   // links are then drawn within 1e-7 of their places
const LOST_ALPHA = 0.35;                   // opacity of a mechanism whose assembly is lost
const EMPTY_CURVE = {over: 0, x: [], values: [], ends: [], meets: [], rests: [], beyond: [], signs: [], largestSquares: []};

const systemTheme = matchMedia("(prefers-color-scheme: dark)");
const timing = {pictures: 0, busy: 0};     // number of pictures, and time (ms) that they took
let isPlaying = false;
let playDirection = 1;                     // 1 while the input grows, -1 while it falls
let lastFrameMs = 0;
let frameRequest = 0;                      // of the next picture; 0 if none is requested
let lastSurveyMs = -Infinity;
let surveyTimer = 0;
let linkTimer = 0;

// When pictures are made

/** Requests a picture, unless one is requested already. */
function wake() {
  frameRequest ||= requestAnimationFrame(showPicture);
}

function play() {
  isPlaying = true;
  lastFrameMs = performance.now();
  wake();
  showPlay();
}

function pause() {
  isPlaying = false;
  showPlay();
}

function showPlay() {
  playButton.textContent = isPlaying ? "❚❚" : "▶";
  playButton.setAttribute("aria-label", isPlaying ? "Pause" : "Play");
}

/**
 * Moves the input while the page plays. At the end of the range, or where the mode ends, it turns
 * back. An input of a whole turn goes on at the other end instead.
 * @param nowMs - Time of the picture.
 */
function advanceInput(nowMs) {
  const k = state.over;
  const {from, to} = inputs[k];
  const span = to - from;
  const isWhole = isWholeTurn(inputs[k]);
  let value = state.q[k] + (playDirection * span * Math.min(nowMs - lastFrameMs, MAX_FRAME_MS)) / 1000 / PLAY_SECONDS;
  lastFrameMs = nowMs;
  if (!isWhole) {
    const canGoOn = value <= to && value >= from
      && modes[state.mode].state(state.q.with(k, clamp(value, from, to)), toKernelSizes(state.sizes));
    if (!canGoOn) playDirection = value > state.q[k] ? -1 : 1;
  } else if (value > to) {
    value -= span;
    passTurn(1);
  }
  setInput(k, value);
}

/** Shows the next picture; `nowMs` is its time. */
function showPicture(nowMs) {
  frameRequest = 0;
  if (isPlaying) advanceInput(nowMs);
  const startMs = performance.now();
  updatePage();
  timing.pictures += 1;
  timing.busy += performance.now() - startMs;
  if (isPlaying) wake();
}

/** Shows at once what waits for the next picture. */
function updateNow() {
  if (!frameRequest) return;
  cancelAnimationFrame(frameRequest);
  showPicture(performance.now());
}

// An error in one part of the page is shown to the reader and stops no other part.

const messageByPart = new Map();           // of errors, by the part of the page that they are about

function attempt(part, action) {
  try {
    action();
    messageByPart.delete(part);
  } catch (error) {
    if (!messageByPart.has(part)) console.error(error);
    messageByPart.set(part, error.message);
  }
}

function showErrors() {
  const lines = [...messageByPart].map(([part, message]) => `${part} cannot be shown for these numbers (${message})`);
  elementById("trouble").textContent = lines.length ? `${lines.join("; ")}. Fields and numbers are those of this state.` : "";
}

/** Computes everything that changed, then writes it as fields and numbers, then draws it. */
function updatePage() {
  const startMs = performance.now();
  const hasChanged = (...kinds) => changed.has("all") || kinds.some(kind => changed.has(kind));
  const kernelSizes = toKernelSizes(state.sizes);
  const chosenMode = modes[state.mode];
  if (hasChanged("theme")) showTheme();

  // Curves depend on the other inputs, so with several inputs each change of one makes them stale.
  if (hasChanged("sizes") || (hasSeveralInputs && hasChanged("input")))
    for (const mode of modes) mode.isStale = true;
  const hasStaleModes = modes.some(mode => mode.isStale);
  // The chosen mode is always up to date. Other modes keep an old curve until a picture has time for them.
  for (const mode of [chosenMode, ...modes]) {
    const isDue = mode === chosenMode || !mode.curve || performance.now() - startMs < CURVE_BUDGET_MS;
    if (!mode.isStale || !isDue) continue;
    attempt(`The curve of ${mode.name}`, () => {
      mode.curve = EMPTY_CURVE;            // stays if there is an error
      mode.curve = sampleCurve(mode, state.over, state.q, kernelSizes);
    });
    mode.isStale = false;
  }

  const hasMoved = hasStaleModes || hasChanged("sizes", "input", "mode", "others");
  if (hasMoved)
    for (const mode of modes) {
      Object.assign(mode, {results: null, pictureRow: null, isSingular: false});
      attempt(`The configuration of ${mode.name}`, () => updateConfiguration(mode, kernelSizes));
    }
  if (hasMoved || hasChanged("theme")) {
    showControls();
    showNumbers();
  }

  // The map shows two inputs, so with more of them each change makes it another one.
  if (hasSeveralInputs && (hasChanged("sizes", "mode", "theme", "survey") || inputs.length > 2))
    attempt("The map of inputs", () => updateSurvey(chosenMode, kernelSizes, changed.has("survey")));
  attempt("The sphere", drawSphere);
  if (hasStaleModes || hasChanged("theme", "mode")) attempt("A curve", fillCurves);
  else if (hasChanged("input")) attempt("A curve", () => figures.forEach(figure => figure.plot?.redraw(false)));
  if (hasChanged("plan")) attempt("The Table", buildTable);
  if (hasChanged("plan", "step")) attempt("A step", showStep);
  if (hasSeveralInputs && pad.clientWidth && inputSurvey) attempt("The map of inputs", drawPad);
  showErrors();

  changed.clear();
  clearTimeout(linkTimer);
  if (!isPlaying) linkTimer = setTimeout(keepLink, LINK_DELAY_MS);
  if (modes.some(mode => mode.isStale)) wake();
}

/** Surveys the inputs again: with few nodes while changes follow each other, and then with all. */
function updateSurvey(mode, kernelSizes, mustBeFine) {
  const isQuick = !mustBeFine && performance.now() - lastSurveyMs < SURVEY_PAUSE_MS;
  inputSurvey = surveyInputs(mode, kernelSizes, isQuick ? QUICK_NODE_COUNT : FINE_NODE_COUNT);
  lastSurveyMs = performance.now();
  clearTimeout(surveyTimer);
  if (isQuick) surveyTimer = setTimeout(() => change("survey"), FINE_SURVEY_DELAY_MS);
}

// Configurations at the cursor

/** Computes the results of a mode at the inputs, and its picture if it is drawn. */
function updateConfiguration(mode, kernelSizes) {
  const configuration = mode.state(state.q, kernelSizes) ?? findBesideMeeting(mode, state.q, kernelSizes);
  if (!configuration) return;
  mode.isSingular = isSingular(mode, configuration.row);
  const row = withTurns(mode, state.q, kernelSizes, configuration.row, mode.curve);
  mode.results = mode.isSingular ? row.map(() => NaN) : signedAt(mode, state.q, kernelSizes, row);
  const isDrawn = state.others || modes[state.mode] === mode;
  mode.pictureRow = isDrawn ? evaluateKernel(picture, configuration.q ?? state.q, configuration.places, kernelSizes) : null;
}

/**
 * Returns whether the page has no numbers in a row of a mode. Rates divide by the square of a dyad, or
 * by the determinant of the loops. Near a dead centre, or where modes meet, rounding is a large part
 * of these.
 */
function isSingular({curve}, row) {
  return closures.some((closure, k) => row[closure] < USABLE_SQUARE * curve.largestSquares[k]);
}

/**
 * Returns the configuration {q, places, row} a little beside a meeting of modes, null if the inputs
 * are at none. Where modes meet, rounding decides whether a dyad in line closes, so the links are
 * drawn a little farther on.
 */
function findBesideMeeting(mode, q, kernelSizes) {
  const {meets, over} = mode.curve;
  if (!meets.some(x => Math.abs(x - q[over]) < BESIDE_RAD)) return null;
  for (const offset of [BESIDE_RAD, -BESIDE_RAD]) {
    const besideInputs = q.with(over, q[over] + offset);
    const configuration = mode.state(besideInputs, kernelSizes);
    if (configuration) return {...configuration, q: besideInputs};
  }
  return null;
}

/** Returns the drawn configuration where the chosen mode is lost: the nearest one along its curve. */
function findNearestConfiguration() {
  const mode = modes[state.mode];
  const {curve} = mode;
  const kernelSizes = toKernelSizes(state.sizes);
  const input = state.q[curve.over];
  let nearest = null;
  curve.x.forEach((x, k) => {
    if (!curve.values[k]) return;
    if (nearest === null || Math.abs(x - input) < Math.abs(nearest - input)) nearest = x;
  });
  if (nearest === null) return null;
  const q = state.q.with(curve.over, nearest);
  const configuration = mode.state(q, kernelSizes);
  return configuration && {q, row: evaluateKernel(picture, q, configuration.places, kernelSizes)};
}

// Drawing

/** Draws the sphere: the hemisphere behind, the ball, the hemisphere in front, discs, and labels. */
function drawSphere() {
  updateProjection();
  sphereLines = [];
  labels = [];
  occupiedBoxes = [];
  addGraticule();
  drawLines(false);

  sphereLines = [];
  drawWorkspace();
  const {pictureRow} = modes[state.mode];
  const isLost = !pictureRow;
  drawnConfiguration = isLost ? findNearestConfiguration() : {q: state.q, row: pictureRow};
  let poleMarks = [];
  if (drawnConfiguration) {
    addPaths();
    inputs.forEach((input, k) => addTrack(k));
    if (state.others) addOtherModes();
    addLinks(drawnConfiguration.row);
    if (!isLost) poleMarks = addPoleCircles(pictureRow);
  }
  if (isLost)
    for (const sphereLine of sphereLines) sphereLine.alpha = LOST_ALPHA * (sphereLine.alpha ?? 1);
  drawLines(false);
  drawBall();

  // The graticule is below the mechanism in front, too.
  const mechanismLines = sphereLines;
  sphereLines = [];
  addGraticule();
  drawLines(true);
  sphereLines = mechanismLines;
  drawLines(true);
  if (!drawnConfiguration) return;
  drawPairs(drawnConfiguration.row);
  const knobColour = themeColour(isLost ? "--warn" : "--accent");
  inputs.forEach((input, k) => drawDisc(knobGeometry(k).knob, 6.5, knobColour, themeColour("--card"), {ring: 12}));
  drawPoles(poleMarks);
  drawLabels();
}

/** Sets the colours of the page: those of the state, else those of the system. */
function showTheme() {
  const theme = state.theme || (systemTheme.matches ? "dark" : "light");
  document.documentElement.dataset.theme = theme;
  palette.clear();
  document.body.classList.toggle("alone", state.alone);
  document.body.classList.toggle("framed", window !== window.top);
  elementById("theme").setAttribute("aria-pressed", theme === "dark");
  elementById("reach").hidden = !hasSeveralInputs;
}

/** Writes the state to the address of the page, without a new entry of the history. */
function keepLink() {
  const fragment = link();
  if (fragment === location.hash.slice(1)) return;
  history.replaceState(null, "", fragment ? `#${fragment}` : location.pathname + location.search);
}

/** Returns the pixel [x, y] of a knob in the window, for programs that drive this page. */
function knobPlace(k) {
  const box = canvas.getBoundingClientRect();
  const [x, y] = projectPoint(knobGeometry(k).knob);
  return [box.left + x, box.top + y];
}

window.addEventListener("hashchange", () => {
  if (location.hash.slice(1) !== link()) followLink();
});
window.addEventListener("resize", () => {
  resizeCurves();
  change("view");
});
systemTheme.addEventListener("change", () => change("theme"));

window.spherekit = {
  state, change, modes, timing, link, knobPlace, figures, modeColour,
  toml: writeToml,
  resultNames: [...rows.place.keys()],
  modeNumbers: rows.about.modes.map(({number}) => number),
};
followLink();
