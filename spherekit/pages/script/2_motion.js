// Motion: the configurations of every assembly mode along one input, in the current sizes.

const SAMPLES = 241;
const CLOSED = 1e-9;                       // rad; the step made there leaves its square
const FARTHEST = 0.35;                     // rad that a variable may go in a step

const closures = [...rows.place.entries()].filter(([name]) => /^closure_\d+$/.test(name)).map(([, k]) => k);
const determinant = rows.place.get("determinant");
const scratch = new Float64Array(rows.count);

function evaluated(kernel, q, places, sizes, result = new Float64Array(kernel.count)) {
  return kernel.at(kernel.motion(q), places, sizes, result);
}

function gap(q, places, sizes) {           // negative where a dyad does not close
  evaluated(rows, q, places, sizes, scratch);
  return Math.min(...closures.map(k => scratch[k]));
}

function refined(good, bad, holds) {       // the last place that holds, between two numbers
  for (let k = 0; k < 50; k++) {
    const middle = 0.5 * (good + bad);
    if (holds(middle)) good = middle; else bad = middle;
  }
  return good;
}

// Where positions follow in closed form, a mode is its signs at every input.

class SignedMode {
  constructor({values}) {
    this.places = values;
  }
  at(q, sizes) {
    const open = closures.length ? gap(q, this.places, sizes) : 0;
    return open >= 0 ? this.places : null;
  }
  along(over, inputs, q, sizes) {
    return inputs.map(x => this.at(q.with(over, x), sizes));
  }
  settle() {}
}

// Others are followed by Newton's steps, from the configuration that is known.

function between(a, b, part) {
  return a.map((x, k) => x + part * (b[k] - x));
}

function side(q, values, sizes) {
  if (determinant === undefined) return 0;
  return Math.sign(evaluated(rows, q, values, sizes, scratch)[determinant]);
}

function newton(q, values, sizes) {
  const given = rows.motion(q);
  for (let k = 0; k < 12; k++) {
    const open = rows.step(given, values, sizes);
    if (!(open < 4)) return false;
    if (open < CLOSED) return true;
  }
  return false;
}

function follow(from, to, finest = 5) {    // a configuration {q, values, sizes} goes to {q, sizes}
  const values = Float64Array.from(from.values);
  const near = newton(to.q, values, to.sizes)
    && values.every((x, k) => Math.abs(x - from.values[k]) < FARTHEST)
    && side(to.q, values, to.sizes) === side(from.q, from.values, from.sizes);
  if (near) return {...to, values};
  if (!finest) return null;
  const half = {q: between(from.q, to.q, 0.5), sizes: between(from.sizes, to.sizes, 0.5)};
  const reached = follow(from, half, finest - 1);
  return reached && follow(reached, to, finest - 1);
}

class FollowedMode {
  constructor({at, values}) {
    this.home = {q: at, values, sizes: inKernel(first.sizes)};
    this.known = [];
  }
  settle(q, sizes) {                       // the first of what is known that comes along
    for (const start of [this.home, ...this.known]) {
      const way = {q: start.q, sizes};
      const here = follow(start, way, 7);
      if (here) { this.home = here; return; }
    }
  }
  at(q, sizes) {
    const distance = x => Math.max(...x.q.map((value, k) => Math.abs(value - q[k])));
    const start = this.known.reduce((best, x) => (distance(x) < distance(best) ? x : best), this.home);
    if (String(start.sizes) !== String(sizes)) return null;
    return follow(start, {q, sizes}, 7)?.values ?? null;
  }
  along(over, inputs, q, sizes) {
    const reached = inputs.map(() => null);
    this.settle(q, sizes);
    let start = this.home;
    if (String(start.sizes) !== String(sizes)) { this.known = []; return reached; }
    start = follow(start, {q: q.with(over, start.q[over]), sizes}, 7);
    if (!start) { this.known = [this.home]; return reached; }
    const nearest = inputs.findIndex(x => x >= start.q[over] - 1e-12);
    const middle = nearest < 0 ? inputs.length - 1 : nearest;
    for (const way of [1, -1]) {
      let here = start;
      for (let k = way > 0 ? middle : middle - 1; here && k >= 0 && k < inputs.length; k += way) {
        here = follow(here, {q: q.with(over, inputs[k]), sizes});
        reached[k] = here?.values ?? null;
      }
    }
    this.known = inputs.flatMap((x, k) => (reached[k] ? [{q: q.with(over, x), values: reached[k], sizes}] : []));
    return reached;
  }
}

function titled({number, name}) {          // names of the file, or signs of dyads after the number
  return /^[-+~]*$/.test(name) ? `mode ${number} ${name.replaceAll("-", "−").replaceAll("~", "")}`.trim() : name;
}

const modes = rows.about.modes.map((mode, k) => {
  const made = rows.about.closed_form ? new SignedMode(mode) : new FollowedMode(mode);
  return Object.assign(made, {number: k, name: titled(mode), curve: null});
});

// A curve: the results of a mode at the samples, its dead centres and where its outputs rest.

function sampled(mode, over, q, sizes) {
  const {from, to} = inputs[over];
  const grid = Array.from({length: SAMPLES}, (_, k) => from + (k * (to - from)) / (SAMPLES - 1));
  const places = mode.along(over, grid, q, sizes);
  const x = [], values = [], ends = [];
  const add = (value, place) => {
    x.push(value);
    values.push(place ? Float64Array.from(evaluated(rows, q.with(over, value), place, sizes)) : null);
  };
  grid.forEach((value, k) => {
    if (k && !places[k] !== !places[k - 1]) {
      const [good, bad] = places[k] ? [k, k - 1] : [k - 1, k];
      const start = {q: q.with(over, grid[good]), values: places[good], sizes};
      let last = places[good];
      const end = refined(grid[good], grid[bad], middle => {
        const way = q.with(over, middle);
        const there = rows.about.closed_form ? mode.at(way, sizes) : follow(start, {q: way, sizes}, 2)?.values;
        last = there ?? last;
        return Boolean(there);
      });
      ends.push(end);
      add(end, last);
    }
    add(value, places[k]);
  });
  return {over, x, values, ends, rests: rests(mode, over, q, sizes, x, values)};
}

function rests(mode, over, q, sizes, x, values) {
  const marks = [];
  for (const name of model.coefficients[over]) {
    const k = rows.place.get(name), column = values.map(row => row?.[k] ?? NaN);
    const scale = median(column.map(Math.abs).filter(Number.isFinite));
    for (let n = 1; n < x.length; n++) {
      const small = Math.max(Math.abs(column[n]), Math.abs(column[n - 1])) < 10 * scale + 1;
      if (!(column[n] * column[n - 1] < 0) || !small) continue;
      const sign = Math.sign(column[n - 1]);
      marks.push(refined(x[n - 1], x[n], middle => {
        const way = q.with(over, middle), place = mode.at(way, sizes);
        return place && Math.sign(evaluated(rows, way, place, sizes, scratch)[k]) === sign;
      }));
    }
  }
  return marks;
}

function median(numbers) {
  return numbers.length ? numbers.sort((a, b) => a - b)[numbers.length >> 1] : 0;
}
