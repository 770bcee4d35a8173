// Modes that follow smooth curves through crossings, for pages that were written so.
//
// A mode of dyads is named by the signs of their triple products. Where curves cross, a triple
// product passes through zero along a smooth curve, so the signs change there. Such inputs depend
// on the sizes: they are found again for the sizes on the page. A piece is {from, places}: the
// signs from an input on.

const COMPARISON_STEP_RAD = 1e-3;          // from a crossing at which curves are compared
const LARGEST_STEP_PART = 0.1;             // the same at most, as a part of the way to the crossing
const CLEAR_PART = 0.1;                    // part of the next best deviation that the best one may be
const SAME_COMPONENT = 1e-9;               // components of directions that differ by less are equal
const MAY_BE_IN_LINE = 1e-3;               // the squared triple product of a dyad beside a crossing is less

const placeColumns = [...picture.place].filter(([name]) => /^(axis|orientation)_/.test(name)).map(([, k]) => k);

class SmoothMode {
  constructor({values}) {
    this.places = values;                  // the signs at the input of `numberingInput`
    this.sizes = [];
    this.pieces = [];                      // rising; the first begins at -Infinity
    this.passed = [];                      // inputs at which the mode goes on along its smooth curve
    this.unclear = [];                     // inputs at which it keeps its signs, as the curve is not clear
  }
  /** Finds the pieces again if the sizes have changed. */
  settle(sizes) {
    if (sizes === this.sizes) return;
    const hasSameSizes = sizes.length === this.sizes.length && sizes.every((size, k) => size === this.sizes[k]);
    if (!hasSameSizes || !this.pieces.length) this.findPieces(sizes);
    this.sizes = sizes;
  }
  /** Returns the signs of the mode at an input (rad). */
  placesAt(x, sizes) {
    this.settle(sizes);
    return this.pieces.findLast(({from}) => !(x < from)).places;  // of an input NaN, any
  }
  rowAt(q, sizes) {
    return evaluateKernel(rows, q, this.placesAt(q[0], sizes), sizes);
  }
  state(q, sizes) {
    const row = this.rowAt(q, sizes);
    return closes(row) ? {places: this.placesAt(q[0], sizes), row} : null;
  }
  sample(over, inputs, q, sizes) {
    this.settle(sizes);
    return sampleFeasibleRanges(x => this.rowAt(q.with(over, x), sizes), inputs, this.passed);
  }
  /** Finds the inputs at which the signs change, from the one of the given signs up and down. */
  findPieces(sizes) {
    const {from, to} = inputs[0];
    const start = numberingInput(sizes);
    this.passed = [];
    this.unclear = [];
    const above = this.changesTowards(start, to, sizes);
    const below = this.changesTowards(start, from, sizes);
    // The signs that a change leads to are those on its far side, seen from the start.
    const lowest = below.length ? below.at(-1).places : this.places;
    const piecesBelow = below.map(({x}, k) => ({from: x, places: k ? below[k - 1].places : this.places})).reverse();
    const piecesAbove = above.map(({x, places}) => ({from: x, places}));
    this.pieces = [{from: -Infinity, places: lowest}, ...piecesBelow, ...piecesAbove];
  }
  /** Returns the changes [{x, places}] of signs between two inputs, in the order in which they are met. */
  changesTowards(start, goal, sizes) {
    const direction = Math.sign(goal - start) || 1;
    const changes = [];
    let last = start;
    let places = this.places;
    for (;;) {
      const isAhead = x => direction * (x - last) > SAME_INPUT_RAD && direction * (goal - x) > SAME_INPUT_RAD;
      const ahead = meetingsOf(places, sizes).filter(isAhead);
      if (!ahead.length) return changes;
      const x = direction > 0 ? Math.min(...ahead) : Math.max(...ahead);
      const placesBeyond = continuedPlaces(x, places, direction, sizes, LARGEST_STEP_PART * Math.abs(x - last));
      if (placesBeyond) this.passed.push(x);
      else this.unclear.push(x);
      places = placesBeyond ?? places;
      changes.push({x, places});
      last = x;
    }
  }
}

/**
 * Returns the input (rad) at which a curve has the number and the signs of a mode: that of the
 * reference pose, if no curves cross there, and otherwise the least one.
 */
function numberingInput(sizes) {
  const {anchor} = model.crossings;
  const {from} = inputs[0];
  if (anchor === null) return from;
  const isAnchor = x => Math.abs(x - anchor) < SAME_INPUT_RAD;
  const isCrossing = modes.some(({places}) => meetingsOf(places, sizes).some(isAnchor));
  return isCrossing ? from : anchor;
}

const meetings = {sizes: [], bySigns: new Map()};  // computed for some sizes

/** Returns the inputs (rad) at which modes with these signs meet others. */
function meetingsOf(places, sizes) {
  if (sizes !== meetings.sizes && String(sizes) !== String(meetings.sizes)) meetings.bySigns.clear();
  meetings.sizes = sizes;
  const signs = String(places);
  if (!meetings.bySigns.has(signs)) {
    const {meets} = sampleFeasibleRanges(x => evaluateKernel(rows, [x], places, sizes), inputGrid(inputs[0], SAMPLES));
    meetings.bySigns.set(signs, meets);
  }
  return meetings.bySigns.get(signs);
}

/**
 * Returns the signs with which a smooth curve goes on beyond an input; null where it is not clear.
 * Directions before the input are continued by a parabola, and compared with those that all signs of
 * the dyads near zero give beyond it.
 * @param x - Input (rad) at which dyads are in line.
 * @param places - Signs before it.
 * @param direction - 1 if the input rises, -1 if it falls.
 * @param largestStep - Largest distance (rad) from the input at which directions are compared.
 */
function continuedPlaces(x, places, direction, sizes, largestStep = COMPARISON_STEP_RAD) {
  const step = direction * Math.min(COMPARISON_STEP_RAD, largestStep);
  const directionsAt = (input, signs) => {
    const row = evaluateKernel(picture, [input], signs, sizes);
    return placeColumns.map(column => row[column]);
  };
  const third = directionsAt(x - 3 * step, places);
  const second = directionsAt(x - 2 * step, places);
  const nearest = directionsAt(x - step, places);
  // The parabola through the values at -3, -2 and -1 steps has this value at +1 step.
  const continued = nearest.map((value, k) => 6 * value - 8 * second[k] + 3 * third[k]);
  const candidates = signsNear(x - step, places, sizes).map(signs => {
    const beyond = directionsAt(x + step, signs);
    const deviation = Math.max(...beyond.map((value, k) => Math.abs(value - continued[k])));
    return {signs, beyond, deviation: Number.isNaN(deviation) ? Infinity : deviation};
  });
  const best = candidates.reduce((least, candidate) => (candidate.deviation < least.deviation ? candidate : least));
  const isEqual = ({beyond}) => beyond.every((value, k) => Math.abs(value - best.beyond[k]) < SAME_COMPONENT);
  const isClear = candidates.every(candidate =>
    candidate === best || best.deviation < CLEAR_PART * candidate.deviation || isEqual(candidate));
  return best.deviation < Infinity && isClear ? best.signs : null;
}

/** Returns all combinations of signs of the dyads that may be in line beside an input. */
function signsNear(x, places, sizes) {
  const row = evaluateKernel(rows, [x], places, sizes);
  let combinations = [Array.from(places)];
  closures.forEach((closure, k) => {
    if (row[closure] < MAY_BE_IN_LINE) combinations = combinations.flatMap(signs => [signs, signs.with(k, -signs[k])]);
  });
  return combinations;
}

/**
 * Returns the number of the mode that goes on where the input passes from one end of a whole turn to
 * the other. `direction` is 1 if the input rises.
 */
function modeAfterTurn(mode, direction, sizes) {
  if (!model.crossings) return mode.number;
  const {from, to} = inputs[0];
  const [leaving, arriving] = direction > 0 ? [to, from] : [from, to];
  const places = mode.placesAt(leaving, sizes);
  const placesBeyond = String(continuedPlaces(arriving, places, direction, sizes) ?? places);
  const nextMode = modes.find(other => String(Array.from(other.placesAt(arriving, sizes))) === placesBeyond);
  return nextMode ? nextMode.number : mode.number;
}

/** Returns in words what modes do where curves cross, for the sizes on the page. */
function crossingsText() {
  const unit = SIGN === "°" ? SIGN : ` ${SIGN}`;
  const inputsText = key => {
    const rising = modes.flatMap(mode => mode[key]).sort((a, b) => a - b);
    const numbers = [...new Set(rising.map(x => formatNumber(x / UNIT, false)))];
    return numbers.map(number => number + unit).join(", ");
  };
  const passed = inputsText("passed");
  const unclear = inputsText("unclear");
  const lines = [];
  if (passed) lines.push(`Modes follow their smooth curves through crossings at ${passed}.`);
  if (unclear) lines.push(`At ${unclear} it is not clear how curves go on: modes keep the signs of their dyads.`);
  return lines.join(" ") || "With these sizes no curves cross inside the range: modes keep the signs of their dyads.";
}
