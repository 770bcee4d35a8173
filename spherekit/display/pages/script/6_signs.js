// Signs of the coefficients of links that no pair joins.
//
// The kernel gives the size of their relative angular velocity w. A pole axis has two senses. The
// coefficient is signed along the one that is continued along the mode, as in `evaluate`: at the
// first sample it is on the side of the sum of all axes; later it reverses nowhere, so the
// coefficient changes its sign where w passes through zero.

const AT_REST = 1e-12;                     // angular velocity per unit rate that is rounding
const REVERSAL_HALVINGS = 24;              // of a step between samples in which w reverses

// For each pole the columns of a row with the angular velocities of its two links (null for the
// ground), and the columns that get the sign.

const signedPoles = model.signed.map(({links, end, names}) => {
  const velocityColumns = link => XYZ.map(letter => rows.place.get(`angular_velocity_${link}_${letter}${end}`));
  return {
    velocities: links.map(link => (isGround(link) ? null : velocityColumns(link))),
    columns: names.map(name => rows.place.get(name)),
  };
});

/** Returns the angular velocity (rad/s, ground frame) of the first link of a pole relative to the second. */
function relativeVelocity({velocities: [link, reference]}, row) {
  const velocityOf = columns => (columns ? columns.map(k => row[k]) : [0, 0, 0]);
  return add(velocityOf(link), scale(velocityOf(reference), -1));
}

/** Finds the signs of all poles at the samples of a curve, and puts them into its rows. */
function signCurve(mode, q, sizes, curve) {
  const {x, values, over} = curve;
  curve.signs = values.map(row => (row ? signedPoles.map(() => 1) : null));
  if (!signedPoles.length) return;
  signedPoles.forEach((pole, j) => {
    let lastSample = -1;                   // the last one at which the pole has a direction
    values.forEach((row, n) => {
      if (!row) return;
      const velocity = relativeVelocity(pole, row);
      if (lastSample >= 0) {
        curve.signs[n][j] = continuedSign(mode, q, sizes, curve, j, lastSample, x[n], row);
      } else if (isDirection(velocity)) {
        const side = sumOfAxes(mode, q.with(over, x[n]), sizes);
        curve.signs[n][j] = dot(side, velocity) < 0 ? -1 : 1;
      }
      if (isDirection(velocity)) lastSample = n;
    });
  });
  curve.values = values.map((row, n) => (row ? withSigns(row, curve.signs[n]) : row));
}

/** Returns the sign of the pole j at an input with a row, continued from the sample n of a curve. */
function continuedSign(mode, q, sizes, {over, x, values, signs}, j, n, input, row) {
  const pole = signedPoles[j];
  const velocityAt = value => {
    const rowThere = mode.state(q.with(over, value), sizes)?.row;
    return rowThere ? relativeVelocity(pole, rowThere) : null;
  };
  const start = {x: x[n], velocity: relativeVelocity(pole, values[n])};
  const end = {x: input, velocity: relativeVelocity(pole, row)};
  return reversesBetween(velocityAt, start, end, REVERSAL_HALVINGS) ? -signs[n][j] : signs[n][j];
}

/**
 * Returns whether the velocity of a pole passes through zero between two points {x, velocity}. If its
 * direction turns by more than a right angle, the step is halved: the axis may have turned without
 * passing zero.
 */
function reversesBetween(velocityAt, start, end, halvings) {
  if (!isDirection(end.velocity) || !(dot(start.velocity, end.velocity) < 0)) return false;
  const x = 0.5 * (start.x + end.x);
  const middle = {x, velocity: velocityAt(x)};
  if (!middle.velocity) return false;      // a gap of the mode: the coefficient keeps its sign
  if (!halvings || !isDirection(middle.velocity)) return true;
  const reversesBefore = reversesBetween(velocityAt, start, middle, halvings - 1);
  return reversesBefore !== reversesBetween(velocityAt, middle, end, halvings - 1);
}

const isDirection = vector => Number.isFinite(vector[0]) && Math.hypot(...vector) > AT_REST;

/** Returns a copy of a row with the signs of all poles. */
function withSigns(row, signs) {
  const signedRow = row.slice();
  signedPoles.forEach(({columns}, j) => {
    for (const k of columns) signedRow[k] *= signs[j];
  });
  return signedRow;
}

/** Returns a row with its signs, anywhere along the curve of a mode. */
function signedAt(mode, q, sizes, row) {
  const {curve} = mode;
  if (!signedPoles.length || !curve?.signs.some(Boolean)) return row;
  const input = q[curve.over];
  const distance = n => (curve.signs[n] ? Math.abs(curve.x[n] - input) : Infinity);
  const nearest = curve.x.reduce((best, _, n) => (distance(n) < distance(best) ? n : best), 0);
  return withSigns(row, signedPoles.map((_, j) => continuedSign(mode, q, sizes, curve, j, nearest, input, row)));
}

/** Returns the sum of the axes or contact points of all pairs, each as often as it has variables. */
function sumOfAxes(mode, q, sizes) {
  const {places} = mode.state(q, sizes);
  const row = evaluateKernel(picture, q, places, sizes);
  const directions = model.pairs.map(({name, axis: hasAxis, variables}) => {
    const direction = hasAxis ? pairAxis(row, name) : contactPoint(row, name);
    return scale(direction, variables);
  });
  return directions.reduce(add, [0, 0, 0]);
}
