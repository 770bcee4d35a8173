// Signs of the coefficients of links that no pair joins.
//
// The kernel gives the size of their relative angular velocity w. A pole axis has two senses, and
// the coefficient is signed along the one that goes on along the mode, as in `evaluate`: at the
// first sample it is on the side of the sum of all axes; later it reverses nowhere, so the
// coefficient changes its sign where w passes through zero.

const AT_REST = 1e-12;                     // angular velocity per unit rate that is rounding
const REVERSAL_HALVINGS = 24;              // of a step between samples in which w reverses

const signedPoles = model.signed.map(({links, end, names}) => ({
  w: links.map(link => (linkNumber.get(link) ? ["x", "y", "z"].map(x => rows.place.get(`angular_velocity_${link}_${x}${end}`)) : null)),
  columns: names.map(name => rows.place.get(name)),
}));

function relativeVelocity({w: [link, other]}, row) {
  const of = columns => (columns ? columns.map(k => row[k]) : [0, 0, 0]);
  return plus(of(link), scaled(of(other), -1));
}

function signCurve(mode, q, sizes, curve) {  // signs of all poles at the samples, put into their rows
  const {x, values, over} = curve;
  curve.signs = values.map(row => (row ? signedPoles.map(() => 1) : null));
  if (!signedPoles.length) return;
  signedPoles.forEach((pole, j) => {
    let last = -1;
    values.forEach((row, n) => {
      if (!row) return;
      const velocity = relativeVelocity(pole, row);
      if (last < 0 && isDirection(velocity)) {
        const side = sideOfAxes(mode, q.with(over, x[n]), sizes);
        curve.signs[n][j] = dot(side, velocity) < 0 ? -1 : 1;
      } else if (last >= 0) curve.signs[n][j] = continuedSign(mode, q, sizes, curve, j, last, x[n], row);
      if (isDirection(velocity)) last = n;
    });
  });
  curve.values = values.map((row, n) => (row ? withSigns(row, curve.signs[n]) : row));
}

function continuedSign(mode, q, sizes, {over, x, values, signs}, j, n, to, row) {  // from the sample n on
  const pole = signedPoles[j], velocity = input => {
    const there = mode.state(q.with(over, input), sizes)?.row;
    return there ? relativeVelocity(pole, there) : null;
  };
  const [atSample, atEnd] = [values[n], row].map(each => relativeVelocity(pole, each));
  return reversesBetween(velocity, x[n], atSample, to, atEnd, REVERSAL_HALVINGS) ? -signs[n][j] : signs[n][j];
}

function reversesBetween(velocity, a, atA, b, atB, halvings) {
  if (!isDirection(atB) || !(dot(atA, atB) < 0)) return false;
  const middle = 0.5 * (a + b), there = velocity(middle);
  if (!there) return false;                // a gap of the mode: the coefficient keeps its sign
  if (!halvings || !isDirection(there)) return true;
  return reversesBetween(velocity, a, atA, middle, there, halvings - 1) !== reversesBetween(velocity, middle, there, b, atB, halvings - 1);
}

const isDirection = vector => Number.isFinite(vector[0]) && Math.hypot(...vector) > AT_REST;

function withSigns(row, signs) {
  const signed = row.slice();
  signedPoles.forEach(({columns}, j) => { for (const k of columns) signed[k] *= signs[j]; });
  return signed;
}

function signedAt(mode, q, sizes, row) {   // a row of a mode anywhere along its curve
  const {curve} = mode;
  if (!signedPoles.length || !curve?.signs.some(Boolean)) return row;
  const distance = n => (curve.signs[n] ? Math.abs(curve.x[n] - q[curve.over]) : Infinity);
  const nearest = curve.x.reduce((best, _, n) => (distance(n) < distance(best) ? n : best), 0);
  return withSigns(row, signedPoles.map((_, j) => continuedSign(mode, q, sizes, curve, j, nearest, q[curve.over], row)));
}

function sideOfAxes(mode, q, sizes) {      // the sum of the axes of all pairs, and of the points of contact
  const closed = mode.state(q, sizes), row = evaluateKernel(picture, q, closed.places, sizes);
  const directions = model.pairs.map(({name, axis, variables}) => scaled(axis ? axisOf(row, name) : contactOf(row, name), variables));
  return directions.reduce(plus, [0, 0, 0]);
}
