// Ranges of one input in which a mode closes, found dyad by dyad in the order of solving.
//
// A dyad closes where the square of its triple product is not negative. An outer dyad hangs on
// the inner ones: its square is NaN where one of these does not close. So the squares are
// examined in order, each only within the ranges that the squares before it leave.

const ROUNDING_OF_SQUARES = 1e-13;         // part of the largest square of a dyad on the way
const EXTREMUM_STEPS = 40;                 // of a golden section, to 4e-9 of a step
const SAME_INPUT = 1e-6;                   // rad; places that are nearer are one

function lastThatCloses(rowAt, good, bad) {  // the farthest input before the first dyad fails
  let last = bad;
  for (const closure of closures) {
    const square = x => rowAt(x)[closure];
    if (square(last) >= 0) continue;
    last = lastNonNegative(square, good, last);
  }
  return last;
}

function lastNonNegative(square, good, bad) {
  const [atGood, atBad] = [square(good), square(bad)];
  if (!(atGood >= 0)) return good;
  // Rounding can leave the square NaN at the very end of an inner dyad.
  let root = Number.isFinite(atBad) ? zero(good, bad, atGood, atBad, square) : bad;
  if (!Number.isFinite(root)) root = bad;
  const span = Math.abs(bad - good), toGood = Math.sign(good - bad);
  for (let back = 1e-13 * span; !(square(root) >= 0); back *= 8) {
    root += toGood * back;
    if ((root - good) * toGood >= 0) return good;
  }
  return root;
}

// Samples of a mode along an input, with a point at each end of a range and one in each gap.

function sampleFeasibleRanges(rowAt, nodes) {
  const known = new Map();
  const row = x => {
    if (!known.has(x)) known.set(x, rowAt(x));
    return known.get(x);
  };
  let ranges = [[nodes[0], nodes.at(-1)]];
  const meets = [];
  for (const closure of closures) {
    const square = x => row(x)[closure];
    const largest = nodes.reduce((most, x) => Math.max(most, Math.abs(square(x)) || 0), 0);
    const tolerance = ROUNDING_OF_SQUARES * largest;
    ranges = ranges.flatMap(([low, high]) => {
      // Where inner dyads are in line, rounding may leave the square NaN: the nodes beside say enough.
      const inside = nodes.filter(x => x > low && x < high && Number.isFinite(square(x)));
      return rangesOfSquare(square, withExtrema(square, [low, ...inside, high]), tolerance, meets);
    });
  }
  const first = nodes[0], last = nodes.at(-1);
  const ends = ranges.flat().filter(x => x !== first && x !== last);
  const gaps = ranges.slice(1).map(([low], k) => 0.5 * (low + ranges[k][1]));
  const middles = ranges.map(([low, high]) => 0.5 * (low + high));
  const inRange = x => ranges.some(([low, high]) => x >= low && x <= high);
  const inputsAlong = [...new Set([...nodes, ...ends, ...gaps, ...middles])].sort((a, b) => a - b);
  const points = [];
  for (const x of inputsAlong) {
    if (!inRange(x)) points.push({x, row: null});
    // At a meeting of modes rounding may leave the square negative: the curve runs on past it.
    else if (closes(row(x))) points.push({x, row: row(x)});
  }
  const isEnd = x => ends.some(end => Math.abs(end - x) < SAME_INPUT);
  const isFirst = (x, k) => !meets.slice(0, k).some(other => Math.abs(other - x) < SAME_INPUT);
  return {points, ends, meets: meets.filter((x, k) => inRange(x) && !isEnd(x) && isFirst(x, k))};
}

// Squares touch zero between samples, where a mode ends and begins again, or modes meet.

function withExtrema(square, x) {
  const values = x.map(square), points = [];
  x.forEach((here, k) => {
    points.push(here);
    if (k + 1 < x.length && mayTouchZero(x, values, k)) {
      const sign = Math.sign(values[k]) || 1;
      points.push(lowestPoint(t => sign * square(t), here, x[k + 1]));
    }
  });
  return points;
}

function mayTouchZero(x, values, k) {      // between the nodes k and k + 1, whose values have one sign
  const sign = Math.sign(values[k]) || 1, [before, here, next, after] = [-1, 0, 1, 2].map(n => sign * values[k + n]);
  if (!(here >= 0 && next >= 0) || before < here || after < next) return false;
  if (Number.isNaN(before) || Number.isNaN(after)) return true;
  // A function that bends upwards is above the straight lines that lead here from both sides.
  const falls = (here - before) / (x[k] - x[k - 1]), rises = (after - next) / (x[k + 2] - x[k + 1]);
  const lines = next - rises * (x[k + 1] - x[k]) - here;
  return rises === falls || here + (falls * lines) / (falls - rises) <= 0;
}

function lowestPoint(f, low, high) {       // of a function, by golden section
  const part = 0.5 * (Math.sqrt(5) - 1);
  let [a, b] = [high - part * (high - low), low + part * (high - low)];
  let [fa, fb] = [f(a), f(b)];
  for (let k = 0; k < EXTREMUM_STEPS; k++) {
    if (fa < fb) { high = b; b = a; fb = fa; a = high - part * (high - low); fa = f(a); }
    else { low = a; a = b; fa = fb; b = low + part * (high - low); fb = f(b); }
  }
  return fa < fb ? a : b;
}

function rangesOfSquare(square, x, tolerance, meets) {
  const ranges = [];
  const holds = value => square(value) >= -tolerance;
  meets.push(...x.filter(value => Math.abs(square(value)) <= tolerance));
  let start = holds(x[0]) ? x[0] : null;
  for (let k = 1; k < x.length; k++) {
    const [before, here] = [x[k - 1], x[k]];
    if (start === null && holds(here)) start = lastNonNegative(square, here, before);
    else if (start !== null && !holds(here)) {
      ranges.push([start, lastNonNegative(square, before, here)]);
      start = null;
    }
  }
  if (start !== null) ranges.push([start, x.at(-1)]);
  return ranges;
}
