// Motion: the configurations of every assembly mode along one input, in the current sizes.
//
// `q` are the inputs (rad), `sizes` those of the kernel, `over` is the number of the input along
// which curves are drawn. The places of a mode are the signs of its dyads in closed form, otherwise
// the variables of all pairs.

const CLOSED = 1e-9;                       // closure residual (rad); after one more step it is far smaller
const FARTHEST = 0.35;                     // largest change (rad) of a variable in one step along a mode
const LARGEST_RESIDUAL = 4;                // closure residual (rad) beyond which Newton's method has failed
const NEWTON_STEPS = 12;
const MAX_ZERO_STEPS = 24;                 // of false position
const ZERO_TOLERANCE = 1e-12;              // width of the interval around a zero, in the unit of its ends
const START_HALVINGS = 7;                  // of the way to other inputs or sizes, from a known configuration
const CURVE_HALVINGS = 5;                  // of the step between samples of a curve

const closures = [...rows.place.entries()].filter(([name]) => /^closure_\d+$/.test(name)).map(([, index]) => index);
const determinant = rows.place.get("determinant");

function evaluateKernel(kernel, q, places, sizes, result = new Float64Array(kernel.count), turns = null) {
  return kernel.at(kernel.motion(q, turns), places, sizes, result);
}

/** Returns the last number with a property between one that has it and one that has not, by bisection. */
function bisect(good, bad, hasProperty, halvings = 40) {
  for (let k = 0; k < halvings; k++) {
    const middle = 0.5 * (good + bad);
    if (hasProperty(middle)) good = middle;
    else bad = middle;
  }
  return good;
}

/**
 * Returns a zero of a function f between a and b, at which it has the values fa and fb of unlike signs.
 * This is false position with Illinois' rule: the value at an end that remains is halved.
 */
function findZero(a, b, fa, fb, f) {
  for (let k = 0; k < MAX_ZERO_STEPS && Math.abs(b - a) > ZERO_TOLERANCE; k++) {
    const x = (a * fb - b * fa) / (fb - fa);
    const fx = f(x);
    if (fx * fb > 0) {
      fa *= 0.5;
    } else {
      a = b;
      fa = fb;
    }
    b = x;
    fb = fx;
    if (fx === 0) break;
  }
  return b;
}

// Modes in closed form. A mode has the same signs at every input.

const closes = row => closures.every(closure => row[closure] >= 0);

class SignedMode {
  constructor({values}) {
    this.places = values;
  }
  settle() {}                              // nothing has to be followed when sizes change
  rowAt(q, sizes) {                        // results are NaN after the first dyad that does not close
    return evaluateKernel(rows, q, this.places, sizes);
  }
  state(q, sizes) {                        // {places, row}, or null if a dyad does not close
    const row = this.rowAt(q, sizes);
    return closes(row) ? {places: this.places, row} : null;
  }
  along(over, inputsAlong, q, sizes) {     // the state at each of several values of one input
    return inputsAlong.map(x => this.state(q.with(over, x), sizes));
  }
  sample(over, inputsAlong, q, sizes) {
    return sampleFeasibleRanges(x => this.rowAt(q.with(over, x), sizes), inputsAlong);
  }
  end(good, bad, sizes) {                  // the last inputs at which the mode closes, on the straight line to others
    const rowAt = part => this.rowAt(interpolate(good, bad, part), sizes);
    return interpolate(good, bad, lastThatCloses(rowAt, 0, 1));
  }
}

// Other modes are followed by Newton's steps, from a known configuration.

/** Returns the numbers a part (0 to 1) of the way from a to b. */
function interpolate(a, b, part) {
  return a.map((x, k) => x + part * (b[k] - x));
}

/** Changes the places so that the loops close. Returns whether Newton's method converges. */
function closeLoops(q, places, sizes) {
  const motion = rows.motion(q);
  for (let k = 0; k < NEWTON_STEPS; k++) {
    const residual = rows.step(motion, places, sizes);
    if (!(residual < LARGEST_RESIDUAL)) return false;
    if (residual < CLOSED) return true;
  }
  return false;
}

/**
 * Returns the state {q, places, sizes, row} at other inputs and sizes that continues a known one; null
 * if there is none. The way is halved up to `halvings` times if variables change by too much. A change
 * of sign of the determinant would be another mode.
 */
function followState(known, q, sizes, halvings = CURVE_HALVINGS) {
  const places = Float64Array.from(known.places);
  const isNear = () => places.every((x, k) => Math.abs(x - known.places[k]) < FARTHEST);
  if (closeLoops(q, places, sizes) && isNear()) {
    const row = evaluateKernel(rows, q, places, sizes);
    if (determinant === undefined || row[determinant] * known.row[determinant] > 0) return {q, places, sizes, row};
  }
  if (!halvings) return null;
  const middleInputs = interpolate(known.q, q, 0.5);
  const middleSizes = interpolate(known.sizes, sizes, 0.5);
  const middle = followState(known, middleInputs, middleSizes, halvings - 1);
  return middle && followState(middle, q, sizes, halvings - 1);
}

class FollowedMode {
  constructor({at, values}) {
    const sizes = toKernelSizes(first.sizes);
    this.home = {q: at, places: values, sizes, row: evaluateKernel(rows, at, values, sizes)};
    this.known = [];                       // states along the last curve
  }
  settle(sizes) {                          // follow a known state to other sizes; whether one can be followed
    if (String(this.home.sizes) === String(sizes)) return true;
    for (const knownState of [this.home, ...this.known]) {
      const newHome = followState(knownState, knownState.q, sizes, START_HALVINGS);
      if (!newHome) continue;
      this.home = newHome;
      this.known = [];
      return true;
    }
    return false;
  }
  state(q, sizes) {
    if (!this.settle(sizes)) return null;
    const distance = knownState => Math.max(...knownState.q.map((value, k) => Math.abs(value - q[k])));
    const nearest = this.known.reduce((best, x) => (distance(x) < distance(best) ? x : best), this.home);
    return followState(nearest, q, sizes, START_HALVINGS);
  }
  along(over, inputsAlong, q, sizes) {     // from the known configuration up and down along the input
    const states = inputsAlong.map(() => null);
    if (!this.settle(sizes)) return states;
    const start = followState(this.home, q.with(over, this.home.q[over]), sizes, START_HALVINGS);
    if (!start) return states;
    const firstAbove = inputsAlong.findIndex(x => x >= start.q[over] - 1e-12);
    const middle = firstAbove < 0 ? inputsAlong.length - 1 : firstAbove;
    for (const direction of [1, -1]) {
      let last = start;
      for (let k = direction > 0 ? middle : middle - 1; last && k >= 0 && k < inputsAlong.length; k += direction) {
        last = followState(last, q.with(over, inputsAlong[k]), sizes);
        states[k] = last;
      }
    }
    this.known = states.filter(Boolean);
    return states;
  }
  sample(over, inputsAlong, q, sizes) {    // as sampleFeasibleRanges, with a point at each end of the mode
    const states = this.along(over, inputsAlong, q, sizes);
    const points = [];
    const ends = [];
    states.forEach((state, k) => {
      const isBorder = k && !state !== !states[k - 1];
      if (isBorder) {
        const [good, bad] = state ? [inputsAlong[k], inputsAlong[k - 1]] : [inputsAlong[k - 1], inputsAlong[k]];
        const end = this.end(q.with(over, good), q.with(over, bad), sizes)[over];
        ends.push(end);
        points.push({x: end, row: this.state(q.with(over, end), sizes)?.row ?? null});
      }
      points.push({x: inputsAlong[k], row: state?.row ?? null});
    });
    return {points, ends, meets: [], largestSquares: []};
  }
  end(good, bad, sizes) {
    let last = this.state(good, sizes);
    const part = bisect(0, 1, middle => {
      const next = last && followState(last, interpolate(good, bad, middle), sizes, 1);
      last = next ?? last;
      return Boolean(next);
    }, 24);
    return interpolate(good, bad, part);
  }
}

/** Returns the number of a mode with its name in the file, or with the signs of its dyads. */
function modeTitle({number, name}) {
  const lastPart = name.split(", ").at(-1);
  const isSigns = /^[-+~]*$/.test(lastPart);
  const label = isSigns ? lastPart.replaceAll("-", "−").replaceAll("~", "") : lastPart;
  return label ? `mode ${number} (${label})` : `mode ${number}`;
}

const KindOfMode = !rows.about.closed_form ? FollowedMode : model.crossings ? SmoothMode : SignedMode;
const modes = rows.about.modes.map((modeFacts, number) => {
  const mode = new KindOfMode(modeFacts);
  return Object.assign(mode, {number, name: modeTitle(modeFacts), curve: null});
});

const POLE_FACTOR = 10;                    // times the median size of a coefficient; larger ones are near infinity
const SAMPLES = rows.about.closed_form ? 181 : 121;

/** Returns equally spaced inputs (rad) over a range, with both ends. */
function inputGrid({from, to}, count) {
  return Array.from({length: count}, (_, k) => from + (k * (to - from)) / (count - 1));
}

/**
 * Computes the curve of a mode along the input `over`, with the other inputs at `q` (rad).
 * @returns The curve: rising inputs `x` and rows `values` (null in gaps) of the samples, and the inputs
 *   at which ranges end (`ends`), modes meet (`meets`) and outputs rest (`rests`), with the ranges
 *   `beyond` joint limits.
 */
function sampleCurve(mode, over, q, sizes) {
  const {points, ...marks} = mode.sample(over, inputGrid(inputs[over], SAMPLES), q, sizes);
  const curve = {over, x: points.map(({x}) => x), values: points.map(({row}) => row), ...marks};
  countTurns(mode, q, sizes, curve);
  signCurve(mode, q, sizes, curve);
  mode.curve = curve;                      // signs at inputs between the samples follow from it
  curve.rests = findRests(mode, q, sizes, curve);
  curve.beyond = rangesBeyondLimits(mode, q, sizes, curve);
  return curve;
}

/**
 * Returns the inputs (rad) at which the velocity coefficient of an output passes through zero, but not
 * those at which it changes its sign at infinity: near these, it is far larger than usual.
 */
function findRests(mode, q, sizes, {over, x, values}) {
  const rests = [];
  for (const name of model.coefficients[over]) {
    const index = rows.place.get(name);
    const column = values.map(row => (row ? row[index] : NaN));
    const limit = POLE_FACTOR * medianSize(column) + 1;
    const coefficient = value => {
      const inputsThere = q.with(over, value);
      const row = mode.state(inputsThere, sizes)?.row;
      return row ? signedAt(mode, inputsThere, sizes, row)[index] : NaN;
    };
    for (let n = 1; n < x.length; n++) {
      const before = column[n - 1];
      const after = column[n];
      const isSmall = Math.max(Math.abs(before), Math.abs(after)) <= limit;
      if (before * after < 0 && isSmall) rests.push(findZero(x[n - 1], x[n], before, after, coefficient));
    }
  }
  return rests.filter(Number.isFinite);
}

/** Returns the median of the absolute values of finite numbers. */
function medianSize(numbers) {
  const sizes = Float64Array.from(numbers.filter(Number.isFinite), Math.abs).sort();
  return sizes.length ? sizes[sizes.length >> 1] : 0;
}
