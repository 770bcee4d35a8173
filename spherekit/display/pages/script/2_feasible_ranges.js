// Ranges of one input in which a mode closes, found dyad by dyad in the order of solving.
//
// A dyad closes where the square of its triple product is not negative. The square of an outer
// dyad is NaN where an inner one does not close. So the squares are examined in order, each
// only within the ranges that the squares before it leave. A point is {x, row}: an input and
// the results there.

const ROUNDING_OF_SQUARES = 1e-13;         // part of the largest square of a dyad on the way
const BACK_STEP = 1e-13;                   // part of a step by which an end is first moved back, if its square is negative
const BACK_GROWTH = 8;                     // of that part, until the square is not negative
const GOLDEN_STEPS = 40;                   // the lowest point is then known to 4e-9 of a step
const SURELY_POSITIVE = 0.3;               // part of the values around it that a lowest point has at least
const SAME_INPUT_RAD = 1e-6;               // meetings that are nearer are one
const BESIDE_MEETING_RAD = 1e-4;           // from a meeting to the samples beside it

/**
 * Returns the last number, on the way from `good` to `bad`, before the first dyad fails to close.
 * @param rowAt - Function from a number to its row.
 * @param good, bad - A number at which all dyads close, and one at which some may not.
 */
function lastThatCloses(rowAt, good, bad) {
  let last = bad;
  for (const closure of closures) {
    const square = x => rowAt(x)[closure];
    if (!(square(last) >= 0)) last = lastNonNegative(square, good, last);
  }
  return last;
}

/** Returns the last number, on the way from `good` to `bad`, at which the square of a dyad is not negative. */
function lastNonNegative(square, good, bad) {
  const squareAtGood = square(good);
  const squareAtBad = square(bad);
  if (!(squareAtGood >= 0)) return good;
  // Rounding can leave the square NaN at the very end of an inner dyad.
  let root = Number.isFinite(squareAtBad) ? findZero(good, bad, squareAtGood, squareAtBad, square) : bad;
  if (!Number.isFinite(root)) root = bad;
  // The root may be on the negative side by rounding. It is moved back in growing steps.
  const towardsGood = Math.sign(good - bad);
  for (let step = BACK_STEP * Math.abs(bad - good); !(square(root) >= 0); step *= BACK_GROWTH) {
    root += towardsGood * step;
    if ((root - good) * towardsGood >= 0) return good;
  }
  return root;
}

/**
 * Returns samples of a mode along an input, with a point at each end of a range and one in each gap.
 * @param rowAt - Function from an input (rad) to the row of the mode.
 * @param inputsAlong - Rising inputs (rad).
 * @param passed - Inputs (rad) at which modes meet and this one goes on along its smooth curve.
 * @returns {points, ends, meets, largestSquares} - The points; their row is null where the mode does
 *   not close. The inputs where ranges end, and where modes meet. The largest square of each dyad.
 */
function sampleFeasibleRanges(rowAt, inputsAlong, passed = []) {
  const pointAt = x => ({x, row: rowAt(x)});
  const nodes = inputsAlong.map(pointAt);
  const firstNode = nodes[0];
  const lastNode = nodes.at(-1);
  const largestSquares = [];
  let ranges = [[firstNode, lastNode]];
  let meets = [];
  for (const closure of closures) {
    let largest = 0;
    for (const {row} of nodes) largest = Math.max(largest, Math.abs(row[closure]) || 0);
    largestSquares.push(largest);
    const tolerance = ROUNDING_OF_SQUARES * largest;
    const narrowedRanges = [];
    for (const [low, high] of ranges) {
      // Where inner dyads are in line, rounding may leave the square NaN: the nodes beside say enough.
      const inside = nodes.filter(({x, row}) => x > low.x && x < high.x && !Number.isNaN(row[closure]));
      const points = withLowestPoints([low, ...inside, high], closure, pointAt);
      meets.push(...points.filter(({row}) => Math.abs(row[closure]) <= tolerance));
      narrowedRanges.push(...rangesOfSquare(points, closure, tolerance, pointAt));
    }
    ranges = narrowedRanges;
  }
  const ends = ranges.flat().filter(point => point !== firstNode && point !== lastNode);
  const gaps = ranges.slice(1).map(([low], k) => ({x: 0.5 * (low.x + ranges[k][1].x), row: null}));
  const middles = ranges.map(([low, high]) => pointAt(0.5 * (low.x + high.x)));
  const isInRange = ({x}) => ranges.some(([low, high]) => x >= low.x && x <= high.x);
  const isNearAny = (point, others) => others.some(other => Math.abs(other.x - point.x) < SAME_INPUT_RAD);
  meets = meets.filter((point, k) => isInRange(point) && !isNearAny(point, ends) && !isNearAny(point, meets.slice(0, k)));
  // At a meeting of modes rates are not defined and may jump: the curve breaks off there.
  const besides = meets.flatMap(({x}) => [pointAt(x - BESIDE_MEETING_RAD), pointAt(x + BESIDE_MEETING_RAD)]).filter(isInRange);
  // Along a smooth curve they are continuous: the curve goes from the sample before to the one beyond.
  const isSample = ({x}) => !passed.some(other => Math.abs(other - x) < SAME_INPUT_RAD);
  const samples = [...nodes, ...ends, ...gaps, ...middles, ...besides].filter(isSample).sort((a, b) => a.x - b.x);
  const points = samples.map(point => {
    const isUsable = point.row && isInRange(point) && closes(point.row) && !isNearAny(point, meets);
    return isUsable ? point : {x: point.x, row: null};
  });
  return {points, ends: ends.map(({x}) => x), meets: meets.map(({x}) => x), largestSquares};
}

// Squares may pass or touch zero between nodes: modes end and begin again there, or meet.

/** Returns points with a lowest point added wherever the square of a dyad may touch zero between two of them. */
function withLowestPoints(points, closure, pointAt) {
  const allPoints = [];
  points.forEach((point, k) => {
    allPoints.push(point);
    if (k + 1 >= points.length || !mayTouchZero(points, closure, k)) return;
    const sign = Math.sign(point.row[closure]) || 1;
    const lowest = lowestPoint(pointAt, ({row}) => sign * row[closure], point, points[k + 1]);
    if (lowest) allPoints.push(lowest);
  });
  return allPoints;
}

/**
 * Returns whether a square may touch zero between the points k and k + 1, at which it has one sign.
 * It is judged by the values there and at the points before and after.
 */
function mayTouchZero(points, closure, k) {
  const sign = Math.sign(points[k].row[closure]) || 1;
  const valueAt = n => (points[n] ? sign * points[n].row[closure] : NaN);
  const before = valueAt(k - 1);
  const start = valueAt(k);
  const end = valueAt(k + 1);
  const after = valueAt(k + 2);
  if (!(start >= 0 && end >= 0) || before < start || after < end) return false;
  if (Number.isNaN(before) || Number.isNaN(after)) return true;
  // A function that bends upwards is above the straight lines that lead here from both sides. So it
  // may touch zero only if these lines intersect below zero.
  const step = points[k + 1].x - points[k].x;
  const leftSlope = (start - before) / (points[k].x - points[k - 1].x);
  const rightSlope = (after - end) / (points[k + 2].x - points[k + 1].x);
  if (rightSlope === leftSlope) return true;
  return start + (leftSlope * (end - rightSlope * step - start)) / (leftSlope - rightSlope) <= 0;
}

/**
 * Returns the lowest point of a value between two points, by golden section. It ends early at a
 * negative value. It is null if the value is surely positive.
 */
function lowestPoint(pointAt, value, low, high) {
  const valueAtLow = value(low);
  const valueAtHigh = value(high);
  const valueInMiddle = value(pointAt(0.5 * (low.x + high.x)));
  // There is no search if the parabola through three points stays clearly above zero.
  const bend = valueAtLow + valueAtHigh - 2 * valueInMiddle;
  const tilt = valueAtHigh - valueAtLow;
  const hasVertexInside = bend > 0 && Math.abs(tilt) < 2 * bend;
  const estimate = hasVertexInside ? valueInMiddle - (tilt * tilt) / (8 * bend) : Math.min(valueAtLow, valueAtHigh);
  if (estimate > SURELY_POSITIVE * Math.min(valueAtLow, valueInMiddle, valueAtHigh)) return null;

  const goldenPart = 0.5 * (Math.sqrt(5) - 1);
  const innerPoint = (from, to) => pointAt(to + goldenPart * (from - to));
  let start = low.x;
  let stop = high.x;
  let left = innerPoint(start, stop);
  let right = innerPoint(stop, start);
  for (let k = 0; k < GOLDEN_STEPS && value(left) >= 0 && value(right) >= 0; k++) {
    if (value(left) < value(right)) {
      stop = right.x;
      right = left;
      left = innerPoint(start, stop);
    } else {
      start = left.x;
      left = right;
      right = innerPoint(stop, start);
    }
  }
  return value(left) < value(right) ? left : right;
}

/**
 * Returns the ranges [first point, last point] in which the square of a dyad is not negative.
 * @param points - Points with rising inputs, from one end to the other.
 * @param tolerance - Squares that are less negative than this count as zero.
 */
function rangesOfSquare(points, closure, tolerance, pointAt) {
  const ranges = [];
  const square = x => pointAt(x).row[closure];
  const isClosed = ({row}) => row[closure] >= -tolerance;
  const findEnd = (good, bad) => pointAt(lastNonNegative(square, good.x, bad.x));
  let start = isClosed(points[0]) ? points[0] : null;
  for (let k = 1; k < points.length; k++) {
    const before = points[k - 1];
    const point = points[k];
    if (start === null && isClosed(point)) {
      start = findEnd(point, before);
    } else if (start !== null && !isClosed(point)) {
      ranges.push([start, findEnd(before, point)]);
      start = null;
    }
  }
  if (start !== null) ranges.push([start, points.at(-1)]);
  return ranges;
}
