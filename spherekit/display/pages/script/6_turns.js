// Whole turns of passive pairs that loads depend on, such as springs.
//
// A kernel gives the angle of a passive pair up to whole turns. The turns count from the anchor of
// the input, the reference pose or zero: there the angle is in (-180, 180] degrees, and it goes on
// from there along the mode. A range of the mode that does not reach the anchor begins at its
// least input after it. After a period of the input, the angle has grown by whole turns.

const TURN_RAD = 2 * Math.PI;
const HALF_TURN_RAD = Math.PI + 1e-3;      // half a turn is positive, whatever rounding makes of it
const CERTAIN_STEP_RAD = 1;                // longer steps between samples are halved
const STEP_HALVINGS = 20;
const woundPairs = model.wound.map(({pair, anchor, period}) => ({
  anchor, period: period ?? Infinity,
  column: rows.place.get(`theta_${pair}`), argument: `turns_of_${pair}`,
}));

const reduceAngle = angle => angle - TURN_RAD * Math.ceil((angle - HALF_TURN_RAD) / TURN_RAD);

// The angles of a wound pair along a whole period of the input, with all their turns: the gap-free
// runs {x, angles} of the mode, and by how much an angle grows in a period.

function followAngles(mode, q, sizes, {anchor, period, column}, {over, x}) {
  const [low, high] = Number.isFinite(period) ? [anchor, anchor + period] : [Math.min(anchor, x[0]), Math.max(anchor, x.at(-1))];
  const {points} = mode.sample(over, inputGrid({from: low, to: high}, SAMPLES), q, sizes);
  const runs = [];
  let open = null;
  for (const {x: at, row} of points) {
    if (!row) { open = null; continue; }
    if (!open) runs.push(open = {x: [], angles: []});
    open.x.push(at);
    open.angles.push(row[column]);
  }
  const [first, last] = [runs[0], runs.at(-1)];
  const isWhole = run => run.x[0] === low && run.x.at(-1) === high;
  const joins = Number.isFinite(period) && runs.length > 1 && first.x[0] === low && last.x.at(-1) === high;
  let growth = 0;
  for (const run of runs) {
    unwrap(run, at => mode.state(q.with(over, at), sizes)?.row[column] ?? NaN);
    // The last run of a period goes on over the anchor into the first one.
    const atEnd = joins && run === last, reference = atEnd ? run.angles.length - 1 : nearestPlace(run.x, anchor);
    const shift = reduceAngle(run.angles[reference]) - run.angles[reference];
    run.angles = run.angles.map(angle => angle + shift);
    if (isWhole(run) && Number.isFinite(period)) growth = TURN_RAD * Math.round((run.angles.at(-1) - run.angles[0]) / TURN_RAD);
  }
  return {runs, growth};
}

function unwrap({x, angles}, angleAt) {    // in place
  for (let k = 1; k < angles.length; k++)
    angles[k] = angles[k - 1] + angleChange(angleAt, [x[k - 1], angles[k - 1]], [x[k], angles[k]], STEP_HALVINGS);
}

function angleChange(angleAt, from, to, halvings) {  // from and to: [input, angle up to whole turns]
  const change = to[1] - from[1] - TURN_RAD * Math.round((to[1] - from[1]) / TURN_RAD);
  if (!(Math.abs(change) > CERTAIN_STEP_RAD) || !halvings) return change;
  const at = 0.5 * (from[0] + to[0]), middle = [at, angleAt(at)];
  if (Number.isNaN(middle[1])) return change;
  return angleChange(angleAt, from, middle, halvings - 1) + angleChange(angleAt, middle, to, halvings - 1);
}

function nearestPlace(x, wanted) {
  let best = 0;
  for (let k = 1; k < x.length; k++) if (Math.abs(x[k] - wanted) < Math.abs(x[best] - wanted)) best = k;
  return best;
}

function countTurns(mode, q, sizes, curve) {
  curve.followed = inputs.length === 1 ? woundPairs.map(pair => followAngles(mode, q, sizes, pair, curve)) : [];
  curve.values = curve.values.map((row, n) => row && withTurns(mode, q.with(curve.over, curve.x[n]), sizes, row, curve));
}

function turnsAt({anchor, period, column}, {runs, growth}, x, row) {  // rad that the kernel's angle lacks
  const laps = Number.isFinite(period) ? Math.floor((x - anchor) / period) : 0, place = x - (laps ? laps * period : 0);
  let near = NaN, distance = Infinity;
  for (const run of runs) {
    const k = nearestPlace(run.x, place);
    if (Math.abs(run.x[k] - place) < distance) { distance = Math.abs(run.x[k] - place); near = run.angles[k]; }
  }
  return TURN_RAD * Math.round((near - row[column]) / TURN_RAD) + laps * growth;
}

function withTurns(mode, q, sizes, row, {over, followed}) {  // a row once more, with its turns
  if (!followed?.length) return row;
  const turns = new Map(woundPairs.map((pair, j) => [pair.argument, turnsAt(pair, followed[j], q[over], row)]));
  if ([...turns.values()].every(value => value === 0)) return row;
  const closed = mode.state(q, sizes);
  return closed ? evaluateKernel(rows, q, closed.places, sizes, undefined, turns) : row;
}
