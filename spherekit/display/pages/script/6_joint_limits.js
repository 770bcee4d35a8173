// Joint limits of the file: ranges that the variables of R pairs cannot leave. The page shows
// where a mode is beyond them, but does not stop there.
//
// The angle of a passive pair is known up to whole turns: it is within the limits if any number
// of turns brings it there. A margin is the angle (rad) to the nearer limit, negative beyond it.

const limits = model.limits.map(({pair, low, high}) => {
  const inputIndex = inputs.findIndex(input => input.pair === pair);  // -1 of a passive pair
  const column = rows.place.get(`theta_${pair}`);
  const isPassive = inputIndex < 0;
  return {pair, low, high, isPassive, angle: (row, q) => (isPassive ? row[column] : q[inputIndex])};
});

/** Returns the angle (rad) of a limited pair; of a passive one with the turns that bring it nearest to the limits. */
function angleNearLimits({low, high, isPassive, angle}, row, q) {
  const middle = 0.5 * (low + high);
  const difference = angle(row, q) - middle;
  return middle + (isPassive ? Math.atan2(Math.sin(difference), Math.cos(difference)) : difference);
}

/** Returns the margin of a limit: results `row` at the inputs `q` (rad). */
function marginOf(limit, row, q) {
  const angle = angleNearLimits(limit, row, q);
  return Math.min(angle - limit.low, limit.high - angle);
}

const leastMargin = (row, q) => limits.reduce((least, limit) => Math.min(least, marginOf(limit, row, q)), Infinity);

/** Returns the ranges {from, to} (rad) of the input of a curve in which the mode is beyond a limit. */
function rangesBeyondLimits(mode, q, sizes, {over, x, values}) {
  if (!limits.length) return [];
  const inputsAt = value => q.with(over, value);
  const marginAt = value => {
    const row = mode.state(inputsAt(value), sizes)?.row;
    return row ? leastMargin(row, inputsAt(value)) : NaN;
  };
  const isWithin = value => marginAt(value) >= 0;
  const margins = values.map((row, n) => (row ? leastMargin(row, inputsAt(x[n])) : NaN));
  // The last input within the limits, between the samples n and n + 1 on both sides of one.
  const borderAfter = n => (margins[n] >= 0 ? bisect(x[n], x[n + 1], isWithin) : bisect(x[n + 1], x[n], isWithin));
  const ranges = [];
  let from = margins[0] < 0 ? x[0] : null;
  for (let n = 0; n + 1 < x.length; n++) {
    const margin = margins[n];
    const nextMargin = margins[n + 1];
    if (from !== null && !(nextMargin < 0)) {
      // In a gap of the mode, whose margin is NaN, the range ends at the sample before.
      ranges.push({from, to: nextMargin >= 0 ? borderAfter(n) : x[n]});
      from = null;
    } else if (from === null && nextMargin < 0) {
      from = margin >= 0 ? borderAfter(n) : x[n + 1];
    }
  }
  if (from !== null) ranges.push({from, to: x.at(-1)});
  return ranges;
}

/** Returns a limit in words, such as "41 may go from 0° to 90°". */
function limitText({pair, low, high}) {
  const angleText = angle => `${formatNumber(angle / UNIT, false)}${SIGN === "°" ? SIGN : " rad"}`;
  return `${pair} may go from ${angleText(low)} to ${angleText(high)}`;
}

/** Returns in words the limits that a configuration is beyond, empty if there are none. */
function beyondText(row, q) {
  const exceeded = limits.filter(limit => marginOf(limit, row, q) < 0);
  return exceeded.length ? `beyond a joint limit: ${exceeded.map(limitText).join("; ")}` : "";
}
