// Modes that follow smooth curves through crossings, for pages that were written so.
//
// A mode of dyads is named by the signs of their triple products. Where curves cross, a triple
// product passes through zero along a smooth curve, so the signs change there. Such inputs depend
// on the sizes: they are found again for the sizes on the page. A piece is {from, places}: the
// signs from an input on.

const COMPARED_AT = 1e-3;                  // rad from a crossing at which curves are compared
const LONGEST_COMPARISON = 0.1;            // the same as a part of the way to the crossing
const CLEARLY = 0.1;                       // part of the next best deviation that the best one may be
const SAME_PLACE = 1e-9;                   // components of directions that differ by less are equal
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
  settle(sizes) {
    if (sizes === this.sizes) return;
    if (sizes.length !== this.sizes.length || !this.pieces.length || sizes.some((x, k) => x !== this.sizes[k])) this.findPieces(sizes);
    this.sizes = sizes;
  }
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
  findPieces(sizes) {
    const {from, to} = inputs[0], start = numberingInput(sizes);
    Object.assign(this, {passed: [], unclear: []});
    const up = this.changesTowards(start, to, sizes), down = this.changesTowards(start, from, sizes);
    // The signs that a change leads to are those on its far side, seen from the start.
    const below = down.map(({x}, k) => ({from: x, places: k ? down[k - 1].places : this.places})).reverse();
    const lowest = down.length ? down.at(-1).places : this.places;
    this.pieces = [{from: -Infinity, places: lowest}, ...below, ...up.map(({x, places}) => ({from: x, places}))];
  }
  changesTowards(start, goal, sizes) {     // [{x, places}] in the order in which they are met
    const way = Math.sign(goal - start) || 1, changes = [];
    let last = start, places = this.places;
    for (;;) {
      const ahead = meetingsOf(places, sizes).filter(x => way * (x - last) > SAME_INPUT && way * (goal - x) > SAME_INPUT);
      if (!ahead.length) return changes;
      const x = way > 0 ? Math.min(...ahead) : Math.max(...ahead);
      const after = continuedPlaces(x, places, way, sizes, LONGEST_COMPARISON * Math.abs(x - last));
      (after ? this.passed : this.unclear).push(x);
      places = after ?? places;
      changes.push({x, places});
      last = x;
    }
  }
}

// The input at which a curve has the number and the signs of a mode: that of the reference pose, if
// no curves cross there, and otherwise the least one.

function numberingInput(sizes) {
  const {anchor} = model.crossings, {from} = inputs[0];
  const isCrossing = anchor !== null && modes.some(({places}) => meetingsOf(places, sizes).some(x => Math.abs(x - anchor) < SAME_INPUT));
  return anchor === null || isCrossing ? from : anchor;
}

// Inputs at which modes with these signs meet others.

const meetings = {sizes: [], bySigns: new Map()};

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

// The signs with which a smooth curve goes on beyond an input; null where it is not clear. Directions
// before the input are continued by a parabola, and compared with those that all signs of the dyads
// near zero give beyond it.

function continuedPlaces(x, places, way, sizes, longest = COMPARED_AT) {
  const step = way * Math.min(COMPARED_AT, longest);
  const directions = (input, signs) => {
    const all = evaluateKernel(picture, [input], signs, sizes);
    return placeColumns.map(k => all[k]);
  };
  const [third, second, first] = [3, 2, 1].map(k => directions(x - k * step, places));
  const continued = first.map((value, k) => 6 * value - 8 * second[k] + 3 * third[k]);
  const candidates = signsNear(x - step, places, sizes).map(signs => {
    const beyond = directions(x + step, signs);
    const miss = Math.max(...beyond.map((value, k) => Math.abs(value - continued[k])));
    return {signs, beyond, miss: Number.isNaN(miss) ? Infinity : miss};
  });
  const best = candidates.reduce((least, one) => (one.miss < least.miss ? one : least));
  const isSame = ({beyond}) => beyond.every((value, k) => Math.abs(value - best.beyond[k]) < SAME_PLACE);
  const isClear = candidates.every(one => one === best || best.miss < CLEARLY * one.miss || isSame(one));
  return best.miss < Infinity && isClear ? best.signs : null;
}

function signsNear(x, places, sizes) {     // all signs of the dyads that may be in line beside an input
  const row = evaluateKernel(rows, [x], places, sizes);
  let signs = [Array.from(places)];
  closures.forEach((closure, k) => {
    if (row[closure] < MAY_BE_IN_LINE) signs = signs.flatMap(one => [one, one.with(k, -one[k])]);
  });
  return signs;
}

// The mode that goes on where the input passes from one end of a whole turn to the other.

function modeAfterTurn(mode, way, sizes) {
  if (!model.crossings) return mode.number;
  const {from, to} = inputs[0], [leaving, arriving] = way > 0 ? [to, from] : [from, to];
  const places = mode.placesAt(leaving, sizes), after = String(continuedPlaces(arriving, places, way, sizes) ?? places);
  const next = modes.find(other => String(Array.from(other.placesAt(arriving, sizes))) === after);
  return next ? next.number : mode.number;
}

function crossingsText() {                 // what modes do where curves cross, for the sizes on the page
  const inputsOf = key => [...new Set(modes.flatMap(mode => mode[key]).sort((a, b) => a - b).map(x => formatNumber(x / UNIT, false)))];
  const [passed, unclear] = [inputsOf("passed"), inputsOf("unclear")], unit = SIGN === "°" ? SIGN : ` ${SIGN}`;
  const list = numbers => numbers.map(x => x + unit).join(", ");
  const lines = [];
  if (passed.length) lines.push(`Modes follow their smooth curves through crossings at ${list(passed)}.`);
  if (unclear.length) lines.push(`At ${list(unclear)} it is not clear how curves go on: modes keep the signs of their dyads.`);
  return lines.join(" ") || "With these sizes no curves cross inside the range: modes keep the signs of their dyads.";
}
