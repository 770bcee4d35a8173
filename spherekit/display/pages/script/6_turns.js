// Whole turns of passive pairs that loads depend on, such as springs.
//
// A kernel gives the angle of a passive pair up to whole turns. The turns count from the anchor of
// the input, the reference pose or zero: there the angle is in (-180, 180] degrees, and it is
// continued from there along the mode. A range of the mode that does not reach the anchor begins at
// its least input after it. After a period of the input, the angle has grown by whole turns.
//
// A run is {x, angles}: inputs without a gap, and the continuous angles (rad) of a pair at them.

const TURN_RAD = 2 * Math.PI;
const HALF_TURN_RAD = Math.PI + 1e-3;      // half a turn is positive, also if rounding makes it larger
const CERTAIN_STEP_RAD = 1;                // longer steps between samples are halved
const STEP_HALVINGS = 20;
const woundPairs = model.wound.map(({pair, anchor, period}) => ({
  anchor, period: period ?? Infinity,
  column: rows.place.get(`theta_${pair}`), argument: `turns_of_${pair}`,
}));

/** Returns an angle (rad) without whole turns, in (-180, 180] degrees. */
const reduceAngle = angle => angle - TURN_RAD * Math.ceil((angle - HALF_TURN_RAD) / TURN_RAD);

/**
 * Follows the angle of a wound pair along a whole period of the input.
 * @returns {runs, growth} - The runs of the mode, with all turns, and the growth of the angle (rad) in
 *   a period.
 */
function followAngles(mode, q, sizes, {anchor, period, column}, {over, x}) {
  const isPeriodic = Number.isFinite(period);
  const from = isPeriodic ? anchor : Math.min(anchor, x[0]);
  const to = isPeriodic ? anchor + period : Math.max(anchor, x.at(-1));
  const {points} = mode.sample(over, inputGrid({from, to}, SAMPLES), q, sizes);
  const runs = splitIntoRuns(points, column);
  const firstRun = runs[0];
  const lastRun = runs.at(-1);
  const isWholePeriod = run => isPeriodic && run.x[0] === from && run.x.at(-1) === to;
  // The last run of a period may continue over the anchor into the first one.
  const isJoined = isPeriodic && runs.length > 1 && firstRun.x[0] === from && lastRun.x.at(-1) === to;
  let growth = 0;
  for (const run of runs) {
    unwrapAngles(run, input => mode.state(q.with(over, input), sizes)?.row[column] ?? NaN);
    const isCountedAtEnd = isJoined && run === lastRun;
    const reference = isCountedAtEnd ? run.angles.length - 1 : nearestIndex(run.x, anchor);
    const shift = reduceAngle(run.angles[reference]) - run.angles[reference];
    run.angles = run.angles.map(angle => angle + shift);
    if (isWholePeriod(run)) growth = TURN_RAD * Math.round((run.angles.at(-1) - run.angles[0]) / TURN_RAD);
  }
  return {runs, growth};
}

/** Returns the runs of points without gaps, with the angles of one column as they are. */
function splitIntoRuns(points, column) {
  const runs = [];
  let run = null;
  for (const {x, row} of points) {
    if (!row) {                            // a gap of the mode
      run = null;
      continue;
    }
    if (!run) {
      run = {x: [], angles: []};
      runs.push(run);
    }
    run.x.push(x);
    run.angles.push(row[column]);
  }
  return runs;
}

/** Makes the angles of a run continuous. `angleAt` gives them up to whole turns at any input. */
function unwrapAngles({x, angles}, angleAt) {
  for (let k = 1; k < angles.length; k++) {
    const before = [x[k - 1], angles[k - 1]];
    angles[k] = angles[k - 1] + angleChange(angleAt, before, [x[k], angles[k]], STEP_HALVINGS);
  }
}

/**
 * Returns the change of an angle (rad) between two points [input, angle up to whole turns]. Long steps
 * are halved, since they may contain whole turns.
 */
function angleChange(angleAt, start, end, halvings) {
  const difference = end[1] - start[1];
  const change = difference - TURN_RAD * Math.round(difference / TURN_RAD);
  if (!(Math.abs(change) > CERTAIN_STEP_RAD) || !halvings) return change;
  const middleInput = 0.5 * (start[0] + end[0]);
  const middle = [middleInput, angleAt(middleInput)];
  if (Number.isNaN(middle[1])) return change;
  return angleChange(angleAt, start, middle, halvings - 1) + angleChange(angleAt, middle, end, halvings - 1);
}

/** Returns the index of the number that is nearest to a target. */
function nearestIndex(numbers, target) {
  let best = 0;
  for (let k = 1; k < numbers.length; k++)
    if (Math.abs(numbers[k] - target) < Math.abs(numbers[best] - target)) best = k;
  return best;
}

/** Computes the rows of a curve again with the whole turns of passive pairs. With several inputs there are none. */
function countTurns(mode, q, sizes, curve) {
  curve.followed = inputs.length === 1 ? woundPairs.map(pair => followAngles(mode, q, sizes, pair, curve)) : [];
  curve.values = curve.values.map((row, n) => row && withTurns(mode, q.with(curve.over, curve.x[n]), sizes, row, curve));
}

/** Returns the whole turns (rad) that the kernel's angle of a pair lacks at an input. */
function turnsAt({anchor, period, column}, {runs, growth}, input, row) {
  const periods = Number.isFinite(period) ? Math.floor((input - anchor) / period) : 0;
  const inputInPeriod = input - (periods ? periods * period : 0);
  let nearestAngle = NaN;
  let leastDistance = Infinity;
  for (const run of runs) {
    const k = nearestIndex(run.x, inputInPeriod);
    const distance = Math.abs(run.x[k] - inputInPeriod);
    if (distance < leastDistance) {
      leastDistance = distance;
      nearestAngle = run.angles[k];
    }
  }
  return TURN_RAD * Math.round((nearestAngle - row[column]) / TURN_RAD) + periods * growth;
}

/** Returns a row, evaluated again with its whole turns if there are any. */
function withTurns(mode, q, sizes, row, {over, followed}) {
  if (!followed?.length) return row;
  const turns = new Map(woundPairs.map((pair, j) => [pair.argument, turnsAt(pair, followed[j], q[over], row)]));
  if ([...turns.values()].every(value => value === 0)) return row;
  const configuration = mode.state(q, sizes);
  return configuration ? evaluateKernel(rows, q, configuration.places, sizes, undefined, turns) : row;
}
