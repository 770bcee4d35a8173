// Ranges of one input in which a mode closes, found dyad by dyad in the order of solving.
//
// A dyad closes where the square of its triple product is not negative. The square of an outer
// dyad is NaN where an inner one does not close. So the squares are examined in order, each
// only within the ranges that the squares before it leave. A point is {x, row}: an input and
// the results there.

const ROUNDING_OF_SQUARES = 1e-13;         // part of the largest square of a dyad on the way
const GOLDEN_STEPS = 40;                   // the lowest point is then known to 4e-9 of a step
const SURELY_POSITIVE = 0.3;               // part of the values around it that a lowest point has at least
const SAME_INPUT = 1e-6;                   // rad; meetings that are nearer are one
const BESIDE_MEETING = 1e-4;               // rad from a meeting to the samples beside it

function lastThatCloses(rowAt, good, bad) {  // the farthest number before the first dyad fails
  let last = bad;
  for (const closure of closures) {
    const square = x => rowAt(x)[closure];
    if (!(square(last) >= 0)) last = lastNonNegative(square, good, last);
  }
  return last;
}

function lastNonNegative(square, good, bad) {
  const [atGood, atBad] = [square(good), square(bad)];
  if (!(atGood >= 0)) return good;
  // Rounding can leave the square NaN at the very end of an inner dyad.
  let root = Number.isFinite(atBad) ? findZero(good, bad, atGood, atBad, square) : bad;
  if (!Number.isFinite(root)) root = bad;
  const span = Math.abs(bad - good), toGood = Math.sign(good - bad);
  for (let back = 1e-13 * span; !(square(root) >= 0); back *= 8) {
    root += toGood * back;
    if ((root - good) * toGood >= 0) return good;
  }
  return root;
}

// Samples of a mode along an input, with a point at each end of a range and one in each gap. At
// the inputs `passed` modes meet, and the mode goes on along its smooth curve.

function sampleFeasibleRanges(rowAt, inputsAlong, passed = []) {
  const pointAt = x => ({x, row: rowAt(x)});
  const nodes = inputsAlong.map(pointAt), first = nodes[0], last = nodes.at(-1);
  const largestSquares = [];
  let ranges = [[first, last]];
  let meets = [];
  for (const closure of closures) {
    let largest = 0;
    for (const {row} of nodes) largest = Math.max(largest, Math.abs(row[closure]) || 0);
    const tolerance = ROUNDING_OF_SQUARES * largest, found = [];
    largestSquares.push(largest);
    for (const [low, high] of ranges) {
      // Where inner dyads are in line, rounding may leave the square NaN: the nodes beside say enough.
      const inside = nodes.filter(({x, row}) => x > low.x && x < high.x && !Number.isNaN(row[closure]));
      const points = withLowestPoints([low, ...inside, high], closure, pointAt);
      meets.push(...points.filter(({row}) => Math.abs(row[closure]) <= tolerance));
      found.push(...rangesOfSquare(points, closure, tolerance, pointAt));
    }
    ranges = found;
  }
  const ends = ranges.flat().filter(point => point !== first && point !== last);
  const gaps = ranges.slice(1).map(([low], k) => ({x: 0.5 * (low.x + ranges[k][1].x), row: null}));
  const middles = ranges.map(([low, high]) => pointAt(0.5 * (low.x + high.x)));
  const inRange = ({x}) => ranges.some(([low, high]) => x >= low.x && x <= high.x);
  const near = (point, others) => others.some(other => Math.abs(other.x - point.x) < SAME_INPUT);
  meets = meets.filter((point, k) => inRange(point) && !near(point, ends) && !near(point, meets.slice(0, k)));
  // At a meeting of modes rates are not defined and may jump: the curve breaks off there.
  const besides = meets.flatMap(({x}) => [pointAt(x - BESIDE_MEETING), pointAt(x + BESIDE_MEETING)]).filter(inRange);
  // Along a smooth curve they are continuous: the curve goes from the sample before to the one beyond.
  const isBroken = ({x}) => !passed.some(other => Math.abs(other - x) < SAME_INPUT);
  const points = [...nodes, ...ends, ...gaps, ...middles, ...besides].filter(isBroken).sort((a, b) => a.x - b.x).map(point => {
    const isUsable = point.row && inRange(point) && closes(point.row) && !near(point, meets);
    return isUsable ? point : {x: point.x, row: null};
  });
  return {points, ends: ends.map(({x}) => x), meets: meets.map(({x}) => x), largestSquares};
}

// Squares may pass or touch zero between nodes: modes end and begin again there, or meet.

function withLowestPoints(points, closure, pointAt) {
  const found = [];
  points.forEach((point, k) => {
    found.push(point);
    if (k + 1 < points.length && mayTouchZero(points, closure, k)) {
      const sign = Math.sign(point.row[closure]) || 1;
      const lowest = lowestPoint(pointAt, ({row}) => sign * row[closure], point, points[k + 1]);
      if (lowest) found.push(lowest);
    }
  });
  return found;
}

function mayTouchZero(points, closure, k) {  // between the nodes k and k + 1, whose squares have one sign
  const sign = Math.sign(points[k].row[closure]) || 1, value = n => (points[n] ? sign * points[n].row[closure] : NaN);
  const before = value(k - 1), here = value(k), next = value(k + 1), after = value(k + 2);
  if (!(here >= 0 && next >= 0) || before < here || after < next) return false;
  if (Number.isNaN(before) || Number.isNaN(after)) return true;
  // A function that bends upwards is above the straight lines that lead here from both sides.
  const step = points[k + 1].x - points[k].x;
  const falls = (here - before) / (points[k].x - points[k - 1].x);
  const rises = (after - next) / (points[k + 2].x - points[k + 1].x);
  return rises === falls || here + (falls * (next - rises * step - here)) / (falls - rises) <= 0;
}

function lowestPoint(pointAt, value, low, high) {  // by golden section; null where it is surely positive
  const [atLow, atHigh, middle] = [value(low), value(high), value(pointAt(0.5 * (low.x + high.x)))];
  const bend = atLow + atHigh - 2 * middle, tilt = atHigh - atLow;
  const ofParabola = bend > 0 && Math.abs(tilt) < 2 * bend ? middle - (tilt * tilt) / (8 * bend) : Math.min(atLow, atHigh);
  if (ofParabola > SURELY_POSITIVE * Math.min(atLow, middle, atHigh)) return null;
  const part = 0.5 * (Math.sqrt(5) - 1), inner = (from, to) => pointAt(to + part * (from - to));
  let [start, stop] = [low.x, high.x];
  let [a, b] = [inner(start, stop), inner(stop, start)];
  for (let k = 0; k < GOLDEN_STEPS && value(a) >= 0 && value(b) >= 0; k++)
    if (value(a) < value(b)) { stop = b.x; b = a; a = inner(start, stop); }
    else { start = a.x; a = b; b = inner(stop, start); }
  return value(a) < value(b) ? a : b;
}

function rangesOfSquare(points, closure, tolerance, pointAt) {
  const ranges = [], square = x => pointAt(x).row[closure];
  const holds = ({row}) => row[closure] >= -tolerance;
  const end = (good, bad) => pointAt(lastNonNegative(square, good.x, bad.x));
  let start = holds(points[0]) ? points[0] : null;
  for (let k = 1; k < points.length; k++) {
    const [before, here] = [points[k - 1], points[k]];
    if (start === null && holds(here)) start = end(here, before);
    else if (start !== null && !holds(here)) {
      ranges.push([start, end(before, here)]);
      start = null;
    }
  }
  if (start !== null) ranges.push([start, points.at(-1)]);
  return ranges;
}
