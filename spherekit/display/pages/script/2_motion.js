// Motion: the configurations of every assembly mode along one input, in the current sizes.

const CLOSED = 1e-9;                       // rad; the step made there leaves its square
const FARTHEST = 0.35;                     // rad that a variable may go in a step

const closures = [...rows.place.entries()].filter(([name]) => /^closure_\d+$/.test(name)).map(([, k]) => k);
const determinant = rows.place.get("determinant");

function evaluated(kernel, q, places, sizes, result = new Float64Array(kernel.count), turns = null) {
  return kernel.at(kernel.motion(q, turns), places, sizes, result);
}

function refined(good, bad, holds, count = 40) {  // the last place that holds, between two numbers
  for (let k = 0; k < count; k++) {
    const middle = 0.5 * (good + bad);
    if (holds(middle)) good = middle; else bad = middle;
  }
  return good;
}

function zero(a, b, fa, fb, f) {           // Illinois' rule: false position, with halved ends
  for (let k = 0; k < 24 && Math.abs(b - a) > 1e-12; k++) {
    const x = (a * fb - b * fa) / (fb - fa), y = f(x);
    if (!(y * fb > 0)) { a = b; fa = fb; } else fa *= 0.5;
    b = x;
    fb = y;
    if (y === 0) break;
  }
  return b;
}

// Where positions follow in closed form, a mode is its signs at every input.

const closes = row => closures.every(closure => row[closure] >= 0);

class SignedMode {
  constructor({values}) {
    this.places = values;
  }
  settle() {}
  rowAt(q, sizes) {                        // with NaN after the first dyad that does not close
    return evaluated(rows, q, this.places, sizes);
  }
  state(q, sizes) {                        // {places, row}, null where a dyad does not close
    const row = this.rowAt(q, sizes);
    return closes(row) ? {places: this.places, row} : null;
  }
  along(over, inputs, q, sizes) {
    return inputs.map(x => this.state(q.with(over, x), sizes));
  }
  sample(over, inputs, q, sizes) {
    return sampleFeasibleRanges(x => this.rowAt(q.with(over, x), sizes), inputs);
  }
  end(good, bad, sizes) {                  // the last inputs that close, on a straight way
    const rowAt = part => this.rowAt(between(good, bad, part), sizes);
    return between(good, bad, lastThatCloses(rowAt, 0, 1));
  }
}

// Others are followed by Newton's steps, from the configuration that is known.

function between(a, b, part) {
  return a.map((x, k) => x + part * (b[k] - x));
}

function newton(q, places, sizes) {
  const given = rows.motion(q);
  for (let k = 0; k < 12; k++) {
    const open = rows.step(given, places, sizes);
    if (!(open < 4)) return false;
    if (open < CLOSED) return true;
  }
  return false;
}

function follow(from, q, sizes, finest = 5) {  // a state {q, places, sizes, row} to other inputs and sizes
  const places = Float64Array.from(from.places);
  if (newton(q, places, sizes) && places.every((x, k) => Math.abs(x - from.places[k]) < FARTHEST)) {
    const row = evaluated(rows, q, places, sizes);
    if (determinant === undefined || row[determinant] * from.row[determinant] > 0) return {q, places, sizes, row};
  }
  if (!finest) return null;
  const reached = follow(from, between(from.q, q, 0.5), between(from.sizes, sizes, 0.5), finest - 1);
  return reached && follow(reached, q, sizes, finest - 1);
}

class FollowedMode {
  constructor({at, values}) {
    const sizes = inKernel(first.sizes);
    this.home = {q: at, places: values, sizes, row: evaluated(rows, at, values, sizes)};
    this.known = [];
  }
  settle(sizes) {                          // the first of what is known that comes along
    if (String(this.home.sizes) === String(sizes)) return true;
    for (const start of [this.home, ...this.known]) {
      const here = follow(start, start.q, sizes, 7);
      if (!here) continue;
      this.home = here;
      this.known = [];
      return true;
    }
    return false;
  }
  state(q, sizes) {
    if (!this.settle(sizes)) return null;
    const distance = x => Math.max(...x.q.map((value, k) => Math.abs(value - q[k])));
    const start = this.known.reduce((best, x) => (distance(x) < distance(best) ? x : best), this.home);
    return follow(start, q, sizes, 7);
  }
  along(over, inputs, q, sizes) {
    const reached = inputs.map(() => null);
    if (!this.settle(sizes)) return reached;
    const start = follow(this.home, q.with(over, this.home.q[over]), sizes, 7);
    if (!start) return reached;
    const nearest = inputs.findIndex(x => x >= start.q[over] - 1e-12);
    const middle = nearest < 0 ? inputs.length - 1 : nearest;
    for (const way of [1, -1]) {
      let here = start;
      for (let k = way > 0 ? middle : middle - 1; here && k >= 0 && k < inputs.length; k += way) {
        here = follow(here, q.with(over, inputs[k]), sizes);
        reached[k] = here;
      }
    }
    this.known = reached.filter(Boolean);
    return reached;
  }
  sample(over, inputs, q, sizes) {
    const states = this.along(over, inputs, q, sizes);
    const points = [], ends = [];
    states.forEach((state, k) => {
      if (k && !state !== !states[k - 1]) {
        const [good, bad] = state ? [inputs[k], inputs[k - 1]] : [inputs[k - 1], inputs[k]];
        const end = this.end(q.with(over, good), q.with(over, bad), sizes)[over];
        ends.push(end);
        points.push({x: end, row: this.state(q.with(over, end), sizes)?.row ?? null});
      }
      points.push({x: inputs[k], row: state?.row ?? null});
    });
    return {points, ends, meets: [], largestSquares: []};
  }
  end(good, bad, sizes) {
    let last = this.state(good, sizes);
    const part = refined(0, 1, middle => {
      const there = last && follow(last, between(good, bad, middle), sizes, 1);
      last = there ?? last;
      return Boolean(there);
    }, 24);
    return between(good, bad, part);
  }
}

function titled({number, name}) {          // as the file calls it, or by the signs of its dyads
  const said = name.split(", ").at(-1);
  return /^[-+~]*$/.test(said) ? `mode ${number} ${said.replaceAll("-", "−").replaceAll("~", "")}`.trim() : said;
}

const KindOfMode = !rows.about.closed_form ? FollowedMode : model.crossings ? SmoothMode : SignedMode;
const modes = rows.about.modes.map((mode, k) => Object.assign(new KindOfMode(mode), {number: k, name: titled(mode), curve: null}));

// A curve: the results of a mode at the samples, its dead centres and where its outputs rest.

const SAMPLES = rows.about.closed_form ? 181 : 121;

function grid({from, to}, count) {
  return Array.from({length: count}, (_, k) => from + (k * (to - from)) / (count - 1));
}

function sampled(mode, over, q, sizes) {
  const {points, ...marks} = mode.sample(over, grid(inputs[over], SAMPLES), q, sizes);
  const curve = {over, x: points.map(({x}) => x), values: points.map(({row}) => row), ...marks};
  countTurns(mode, q, sizes, curve);
  signCurve(mode, q, sizes, curve);
  mode.curve = curve;
  curve.rests = findRests(mode, q, sizes, curve);
  curve.beyond = rangesBeyondLimits(mode, q, sizes, curve);
  return curve;
}

// Inputs at which a coefficient of an output passes through zero.

function findRests(mode, q, sizes, {over, x, values}) {
  const marks = [];
  for (const name of model.coefficients[over]) {
    const k = rows.place.get(name), column = values.map(row => (row ? row[k] : NaN));
    const limit = 10 * median(column) + 1;
    const coefficient = value => {
      const there = q.with(over, value), row = mode.state(there, sizes)?.row;
      return row ? signedAt(mode, there, sizes, row)[k] : NaN;
    };
    for (let n = 1; n < x.length; n++) {
      const [a, b] = [column[n - 1], column[n]];
      if (a * b < 0 && Math.max(Math.abs(a), Math.abs(b)) <= limit) marks.push(zero(x[n - 1], x[n], a, b, coefficient));
    }
  }
  return marks.filter(Number.isFinite);
}

function median(numbers) {
  const sizes = Float64Array.from(numbers.filter(Number.isFinite), Math.abs).sort();
  return sizes.length ? sizes[sizes.length >> 1] : 0;
}
